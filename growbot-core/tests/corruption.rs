//! Tests with random bytes, and with frames that were corrupted on the link: a receiver must not accept a frame that
//! was not sent.

use growbot_core::link::frame::{self, FrameDecoder, FrameHeader, MAX_BODY_LEN, MAX_FRAME_LEN};
use growbot_core::random::Rng;

/// Number of corrupted pieces of data that are decoded, unless GROWBOT_FRAMES gives another: 100,000,000 take some
/// minutes in a release build.
const PIECES: u64 = 300_000;

/// Returns a random integer below `end`.
fn below(random: &mut Rng, end: usize) -> usize {
    random.below(end as u64) as usize
}

/// Returns frames with random contents and bodies of lengths from 0 to [`MAX_BODY_LEN`], in steps of 4 bytes.
fn frames(random: &mut Rng) -> Vec<Vec<u8>> {
    let frame = |length: usize, random: &mut Rng| {
        let body: Vec<u8> = (0..length).map(|_| random.next_u64() as u8).collect();
        let [kind, seq, ack] = [(); 3].map(|()| random.next_u64() as u16);
        let header = FrameHeader { kind: kind as u8, session: random.next_u64() as u32, seq, ack };
        frame::encode(&header, &body).unwrap().to_vec()
    };
    (0..=MAX_BODY_LEN).step_by(4).map(|length| frame(length, random)).collect()
}

/// Writes a corrupted part of the stream to `piece`, with the zero that ends it.
fn spoil(frames: &[Vec<u8>], random: &mut Rng, piece: &mut Vec<u8>) {
    piece.clear();
    let one = &frames[below(random, frames.len())];
    match below(random, 5) {
        // Noise.
        0 => piece.extend((0..below(random, MAX_FRAME_LEN)).map(|_| random.next_u64() as u8)),
        // The head of one frame and the tail of another.
        1 => {
            let other = &frames[below(random, frames.len())];
            piece.extend_from_slice(&one[..below(random, one.len())]);
            piece.extend_from_slice(&other[below(random, other.len())..]);
        }
        // Bytes lost or inserted.
        2 => {
            piece.extend_from_slice(one);
            let at = below(random, piece.len());
            if below(random, 2) == 0 {
                piece.drain(at..(at + 1 + below(random, 4)).min(one.len()));
            } else {
                piece.insert(at, random.next_u64() as u8);
            }
        }
        // Flipped bits.
        _ => {
            piece.extend_from_slice(one);
            for _ in 0..=below(random, 8) {
                let at = below(random, piece.len());
                piece[at] ^= 1 << below(random, 8);
            }
        }
    }
    piece.push(0);
}

#[test]
fn corrupted_bytes_never_yield_a_valid_frame() {
    let pieces = std::env::var("GROWBOT_FRAMES").map_or(PIECES, |text| text.parse().expect("a number of frames"));
    let mut random = Rng::new(&[1]);
    let frames = frames(&mut random);
    let sent = |bytes: &[u8]| frames.iter().any(|frame| frame == bytes);
    let (mut receiver, mut piece, mut whole) = (FrameDecoder::default(), Vec::new(), 0_u64);
    for _ in 0..pieces {
        spoil(&frames, &mut random, &mut piece);
        for byte in &piece {
            if let Some(Ok(received)) = receiver.push(*byte) {
                let again = frame::encode(&received.header, &received.body).unwrap();
                assert!(sent(&again), "received {received:?} from {piece:02x?}");
                whole += 1;
            }
        }
    }
    // These were corrupted and then restored by chance, or are tails with a whole frame in them.
    assert!(whole < pieces / 20, "{whole} of {pieces} were whole");
    println!("{pieces} spoilt pieces, {whole} of them with a whole frame that was sent, none with another");
}
