//! Changes bytes of an encoded frame. The decoder must return the frame as it was sent, or not at all.
//!
//! The first two bytes of the input are the length of the frame's body and the number of changes. The body follows, and
//! then the changes: each is a position and a value that is XORed with the byte there.

#![no_main]

use growbot_core::link::frame::{self, FrameDecoder, FrameHeader};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|bytes: &[u8]| {
    let [length, changes, rest @ ..] = bytes else { return };
    let (body, rest) = rest.split_at(rest.len().min(usize::from(*length)));
    let header = FrameHeader { kind: 4, session: 0x1A2B_3C4D, seq: 7, ack: 0 };
    let Ok(sent) = frame::encode(&header, body) else { return };
    let mut arrived = sent.to_vec();
    for change in rest.chunks_exact(2).take(usize::from(*changes)) {
        let at = usize::from(change[0]) % arrived.len();
        arrived[at] ^= change[1];
    }
    arrived.extend_from_slice(rest);
    arrived.push(0);
    let mut receiver = FrameDecoder::default();
    for received in arrived.iter().filter_map(|byte| receiver.push(*byte)).flatten() {
        let again = frame::encode(&received.header, &received.body).expect("what was received can be sent");
        // The rest may contain whole frames, because the fuzzer finds such inputs.
        let inside = rest.windows(again.len() - 1).any(|part| part == &again[..again.len() - 1]);
        assert!(again == sent || inside, "received {received:?} from {arrived:02x?}");
    }
});
