//! The emergency stop on the link: eight bytes that the receiver recognises at any position in the stream of bytes,
//! before any queue and in any session.
//!
//! The sequence begins and ends with the zero that ends frames, and the bytes between are shorter than any frame. So no
//! sequence of whole frames contains it. A receiver checks each byte as it arrives, before any queue.

/// The bytes of the emergency stop, in the order of sending.
pub const EMERGENCY_STOP: [u8; 8] = [0x00, 0xE5, 0x70, 0x9E, 0xE5, 0x70, 0x9E, 0x00];

/// Detector of [`EMERGENCY_STOP`] in a stream of bytes.
#[derive(Debug, Clone, Copy, Default)]
pub struct EmergencyStopDetector {
    /// The latest eight bytes of the stream. The newest is the least significant.
    latest: u64,
}

impl EmergencyStopDetector {
    /// Creates a detector at the beginning of a stream.
    pub const fn new() -> Self {
        Self { latest: u64::MAX }
    }

    /// Takes the next byte of the stream, and reports whether this byte completes an emergency stop.
    pub const fn push(&mut self, byte: u8) -> bool {
        self.latest = self.latest << 8 | byte as u64;
        self.latest == u64::from_be_bytes(EMERGENCY_STOP)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::link::frame::{FrameHeader, MAX_BODY_LEN, encode};
    use proptest::prelude::*;

    fn found(bytes: &[u8]) -> usize {
        let mut recogniser = EmergencyStopDetector::new();
        bytes.iter().filter(|byte| recogniser.push(**byte)).count()
    }

    #[test]
    fn the_stop_is_recognised_after_any_bytes_and_each_time() {
        let twice = [EMERGENCY_STOP, EMERGENCY_STOP].concat();
        assert_eq!(found(&twice), 2);
        for noise in [&[0x00][..], &[0xE5, 0x70], &EMERGENCY_STOP[..6], &[0xFF; 300]] {
            assert_eq!(found(&[noise, &EMERGENCY_STOP].concat()), 1, "after {noise:02x?}");
        }
        assert_eq!(found(&EMERGENCY_STOP[..7]), 0);
    }

    proptest! {
        #[test]
        fn no_frame_contains_the_stop(bodies in prop::collection::vec(prop::collection::vec(any::<u8>(), 0..=MAX_BODY_LEN), 1..4)) {
            let header = FrameHeader { kind: 4, session: 0x9E70_E500, seq: 0x70E5, ack: 0x009E };
            let mut bytes = std::vec![0];
            for mut body in bodies {
                // The bytes of the emergency stop, as a body.
                let at = body.len().saturating_sub(EMERGENCY_STOP.len()) / 2;
                for (slot, byte) in body.iter_mut().skip(at).zip(EMERGENCY_STOP) {
                    *slot = byte;
                }
                bytes.extend(encode(&header, &body).unwrap());
            }
            prop_assert_eq!(found(&bytes), 0);
        }
    }
}
