//! Frames: the bytes of a message on the link.
//!
//! ```text
//! COBS( version u8 | kind u8 | session u32 | seq u16 | ack u16 | body, up to 224 bytes | CRC-32C u32 ) 00
//! ```
//!
//! Numbers are little-endian. A zero byte ends a frame and occurs nowhere inside it, so that a receiver resynchronises
//! at the next zero after any error. The CRC-32C (Castagnoli) covers all bytes before it. It has a Hamming distance of
//! 6 at this length, so it detects any five flipped bits.

use crc::{CRC_32_ISCSI, Crc};
use heapless::Vec;

use crate::hash::CrcTable;

static CRC: Crc<u32, CrcTable> = Crc::<u32, CrcTable>::new(&CRC_32_ISCSI);

/// Returns the CRC-32C of some bytes.
pub fn crc32c(bytes: &[u8]) -> u32 {
    CRC.checksum(bytes)
}

/// Version of the frame format and of its header. It is the first byte of a frame, before the COBS encoding.
pub const FRAME_VERSION: u8 = 2;
/// Max length of a frame's body, bytes.
pub const MAX_BODY_LEN: usize = 224;
/// Length of a frame's header, bytes: version, kind, session, sequence number, acknowledgement.
const HEADER_LEN: usize = 10;
const CHECKSUM_LEN: usize = 4;
/// Max length of a frame before its COBS encoding, bytes.
const MAX_RAW_LEN: usize = HEADER_LEN + MAX_BODY_LEN + CHECKSUM_LEN;
/// Max length of a frame on the link, bytes. The COBS encoding adds one byte for up to 254 bytes, and a zero ends the
/// frame.
pub const MAX_FRAME_LEN: usize = MAX_RAW_LEN + 2;

/// The header of a frame, without the byte for the version.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameHeader {
    /// Kind of the message ([`super::message::Message::kind`]).
    pub kind: u8,
    /// The session that the host opened with its `Hello`. A response has the session of its request.
    pub session: u32,
    /// Sequence number of this request, or of this event, in its session. The numbers count from 1 and skip 0 when they
    /// wrap. The field is 0 in a response, which has no sequence number.
    pub seq: u16,
    /// In a response, the sequence number of the request. In a frame from a host, the sequence number of the latest
    /// event such that the host has received this event and all events before it. 0 if there is none.
    pub ack: u16,
}

/// Returns the sequence number after `seq`. After 65,535 it continues with 1.
pub const fn next_seq(seq: u16) -> u16 {
    match seq.wrapping_add(1) {
        0 => 1,
        seq => seq,
    }
}

/// Reports whether `seq` comes after `other`. Because sequence numbers wrap, the shorter way round the range of `u16`
/// decides.
pub const fn is_seq_after(seq: u16, other: u16) -> bool {
    (seq.wrapping_sub(other) as i16) > 0
}

/// A received frame, after its checksum and version have been checked.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LinkFrame {
    /// Header of the frame.
    pub header: FrameHeader,
    /// Body of the frame: the message in postcard form.
    pub body: Vec<u8, MAX_BODY_LEN>,
}

/// The bytes of a frame as sent on the link, with the zero that ends it.
pub type FrameBytes = Vec<u8, MAX_FRAME_LEN>;

/// Error of bytes that are not a valid frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum FrameError {
    /// The bytes are not a COBS encoding, or are too short, or the checksum does not match.
    #[error(
        "a frame was received garbled: check the wire for noise, the baud rate, and that the other end runs growbot \
         firmware"
    )]
    Garbled,
    /// More bytes arrived without a zero than the longest frame has.
    #[error(
        "received {MAX_FRAME_LEN} bytes without the end of a frame: check the baud rate, and that the other end runs \
         growbot firmware"
    )]
    TooLong,
    /// The frame is valid, but has another version.
    #[error(
        "the other end uses version {version} of the link protocol, but this end uses version {FRAME_VERSION}: install \
         the same release of growbot on the host and on the board"
    )]
    Version {
        /// Version in the received frame.
        version: u8,
    },
}

/// Encodes a message as a frame.
///
/// # Errors
/// Returns [`FrameError::TooLong`] if the body is longer than [`MAX_BODY_LEN`].
pub fn encode(header: &FrameHeader, body: &[u8]) -> Result<FrameBytes, FrameError> {
    let mut raw: Vec<u8, MAX_RAW_LEN> = Vec::new();
    let mut put = |bytes: &[u8]| raw.extend_from_slice(bytes).map_err(|_| FrameError::TooLong);
    put(&[FRAME_VERSION, header.kind])?;
    put(&header.session.to_le_bytes())?;
    put(&header.seq.to_le_bytes())?;
    put(&header.ack.to_le_bytes())?;
    if body.len() > MAX_BODY_LEN {
        return Err(FrameError::TooLong);
    }
    put(body)?;
    let checksum = crc32c(&raw);
    raw.extend_from_slice(&checksum.to_le_bytes()).map_err(|_| FrameError::TooLong)?;

    let mut stuffed = [0; MAX_FRAME_LEN];
    let length = cobs::try_encode(&raw, &mut stuffed).map_err(|_| FrameError::TooLong)?;
    // The byte after the encoded ones is still 0 and ends the frame.
    let whole = stuffed.get(..=length).ok_or(FrameError::TooLong)?;
    FrameBytes::from_slice(whole).map_err(|_| FrameError::TooLong)
}

/// Decodes a frame from the bytes between two zeros.
fn decode(bytes: &[u8]) -> Result<LinkFrame, FrameError> {
    let raw = unstuff(bytes).ok_or(FrameError::Garbled)?;
    let (content, checksum) = raw.split_last_chunk::<CHECKSUM_LEN>().ok_or(FrameError::Garbled)?;
    if crc32c(content) != u32::from_le_bytes(*checksum) {
        return Err(FrameError::Garbled);
    }
    let (header, body) = content.split_first_chunk::<HEADER_LEN>().ok_or(FrameError::Garbled)?;
    let [version, kind, s0, s1, s2, s3, q0, q1, a0, a1] = *header;
    if version != FRAME_VERSION {
        return Err(FrameError::Version { version });
    }
    Ok(LinkFrame {
        header: FrameHeader {
            kind,
            session: u32::from_le_bytes([s0, s1, s2, s3]),
            seq: u16::from_le_bytes([q0, q1]),
            ack: u16::from_le_bytes([a0, a1]),
        },
        body: Vec::from_slice(body).map_err(|_| FrameError::Garbled)?,
    })
}

/// Decodes COBS (Consistent Overhead Byte Stuffing). Each run of bytes begins with its length, which counts the length
/// byte too. Each run stands for its bytes and a zero after them, unless it is of max length or the last. `None` if the
/// bytes are not a COBS encoding. (The decoder of the `cobs` crate leaves panics in the firmware.)
fn unstuff(bytes: &[u8]) -> Option<Vec<u8, MAX_RAW_LEN>> {
    let mut raw = Vec::new();
    let mut left = bytes;
    while let Some((length, after)) = left.split_first() {
        let (run, next) = after.split_at_checked(usize::from(*length).checked_sub(1)?)?;
        raw.extend_from_slice(run).ok()?;
        if *length < u8::MAX && !next.is_empty() {
            raw.push(0).ok()?;
        }
        left = next;
    }
    Some(raw)
}

/// Decoder that finds frames in a stream of bytes.
#[derive(Debug, Clone, Default)]
pub struct FrameDecoder {
    bytes: Vec<u8, MAX_FRAME_LEN>,
    /// True if more bytes arrived without a zero than the longest frame has. Further bytes up to the next zero are
    /// ignored.
    overrun: bool,
}

impl FrameDecoder {
    /// Takes the next byte of the stream. If the byte ends a frame, returns the frame, or the error of the bytes before
    /// it.
    pub fn push(&mut self, byte: u8) -> Option<Result<LinkFrame, FrameError>> {
        if byte != 0 {
            if self.bytes.push(byte).is_err() {
                self.overrun = true;
            }
            return None;
        }
        let overrun = core::mem::take(&mut self.overrun);
        if self.bytes.is_empty() {
            return None; // zeros between frames have no meaning
        }
        let frame = if overrun { Err(FrameError::TooLong) } else { decode(&self.bytes) };
        self.bytes.clear();
        Some(frame)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::vec::Vec as StdVec;

    fn receive(bytes: &[u8]) -> StdVec<Result<LinkFrame, FrameError>> {
        let mut receiver = FrameDecoder::default();
        bytes.iter().filter_map(|byte| receiver.push(*byte)).collect()
    }

    fn header() -> impl Strategy<Value = FrameHeader> {
        (any::<u8>(), any::<u32>(), any::<u16>(), any::<u16>()).prop_map(|(kind, session, seq, ack)| FrameHeader {
            kind,
            session,
            seq,
            ack,
        })
    }

    #[test]
    fn sequence_numbers_wrap_and_skip_0() {
        assert_eq!((next_seq(0), next_seq(7), next_seq(u16::MAX)), (1, 8, 1));
        assert!(is_seq_after(8, 7) && !is_seq_after(7, 8) && !is_seq_after(7, 7));
        assert!(is_seq_after(next_seq(u16::MAX), u16::MAX) && !is_seq_after(u16::MAX, 1));
    }

    proptest! {
        #[test]
        fn sent_frames_are_received(header in header(), body in prop::collection::vec(any::<u8>(), 0..=MAX_BODY_LEN)) {
            let bytes = encode(&header, &body).unwrap();
            let frames = receive(&bytes);
            prop_assert_eq!(frames.len(), 1);
            let frame = frames[0].clone().unwrap();
            prop_assert_eq!(frame.header, header);
            prop_assert_eq!(&frame.body[..], &body[..]);
        }

        #[test]
        fn a_flipped_bit_is_detected(body in prop::collection::vec(any::<u8>(), 0..=MAX_BODY_LEN), at in any::<prop::sample::Index>(), bit in 0_u8..8) {
            let header = FrameHeader { kind: 1, session: 2, seq: 3, ack: 4 };
            let mut bytes = encode(&header, &body).unwrap();
            let index = at.index(bytes.len());
            bytes[index] ^= 1_u8 << bit;
            for frame in receive(&bytes) {
                prop_assert!(frame.is_err());
            }
        }

        #[test]
        fn noise_is_not_a_frame(noise in prop::collection::vec(any::<u8>(), 0..1000)) {
            prop_assert!(receive(&noise).iter().all(Result::is_err));
        }

        #[test]
        fn a_frame_after_noise_is_received(noise in prop::collection::vec(any::<u8>(), 0..600)) {
            let header = FrameHeader { kind: 9, session: 8, seq: 7, ack: 6 };
            let mut bytes = noise;
            bytes.push(0);
            bytes.extend_from_slice(&encode(&header, b"body").unwrap());
            prop_assert_eq!(receive(&bytes).last().unwrap().as_ref().unwrap().header, header);
        }
    }

    proptest! {
        #[test]
        fn output_of_the_cobs_crate_is_unstuffed(raw in prop::collection::vec(prop_oneof![Just(0_u8), any::<u8>()], 1..=MAX_RAW_LEN)) {
            let mut stuffed = [0; MAX_FRAME_LEN];
            let length = cobs::try_encode(&raw, &mut stuffed).unwrap();
            prop_assert_eq!(&unstuff(&stuffed[..length]).unwrap()[..], &raw[..]);
        }
    }

    #[test]
    fn an_overlong_body_is_refused() {
        let header = FrameHeader { kind: 1, session: 2, seq: 3, ack: 4 };
        assert_eq!(encode(&header, &[1; MAX_BODY_LEN + 1]), Err(FrameError::TooLong));
        assert_eq!(encode(&header, &[1; MAX_BODY_LEN]).unwrap().len(), MAX_FRAME_LEN);
    }

    #[test]
    fn another_version_is_distinguished_from_noise() {
        let mut raw = std::vec![FRAME_VERSION + 1, 1, 0, 0, 0, 0, 0, 0, 0, 0];
        raw.extend_from_slice(&crc32c(&raw).to_le_bytes());
        let mut stuffed = [0; MAX_FRAME_LEN];
        let length = cobs::try_encode(&raw, &mut stuffed).unwrap();
        assert_eq!(receive(&stuffed[..=length]), [Err(FrameError::Version { version: FRAME_VERSION + 1 })]);
    }
}
