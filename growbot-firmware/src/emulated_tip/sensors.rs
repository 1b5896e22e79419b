//! Levels of the sensors that the emulated board computes from its own steps: the index sensor and the filament
//! encoder.

use super::{ENCODER_STUCK_HIGH, ENCODER_STUCK_LOW, INDEX_FAULT_STUCK_HIGH, INDEX_FAULT_STUCK_LOW};

/// Returns the level of the index sensor's line (`true` is high) while the head is at `head_steps`. The other arguments
/// are the `INDEX_*` words of the shared memory.
///
/// ```
/// use growbot_firmware::emulated_tip::{INDEX_FAULT_NONE, index_level};
///
/// // A mark 5 steps wide that begins at step 100 of a turn of 3200.
/// assert!(index_level(99, 3200, 100, 5, INDEX_FAULT_NONE));
/// assert!(!index_level(100, 3200, 100, 5, INDEX_FAULT_NONE));
/// assert!(!index_level(100 - 3200, 3200, 100, 5, INDEX_FAULT_NONE));
/// ```
pub const fn index_level(head_steps: i32, steps_per_turn: u32, position: u32, width: u32, fault: u32) -> bool {
    match fault {
        INDEX_FAULT_STUCK_LOW => false,
        INDEX_FAULT_STUCK_HIGH => true,
        _ if steps_per_turn == 0 => true,
        _ => {
            let from_mark = (head_steps as i64).wrapping_sub(position as i64);
            from_mark.rem_euclid(steps_per_turn as i64) >= width as i64
        }
    }
}

/// Relation between the steps of the feed and the angle of the filament's encoder: three words of the shared memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EncoderMapping {
    /// Position of the feed from which this mapping applies, steps. See [`ENCODER_ORIGIN`](super::ENCODER_ORIGIN).
    pub origin: i32,
    /// Angle of the encoder at `origin`, in 1/256 feed steps. See [`ENCODER_PHASE`](super::ENCODER_PHASE).
    pub phase: u32,
    /// Filament that each feed step moves in addition to the length of a step, in 1/65536 of a step; negative if the
    /// filament slips. See [`ENCODER_SLIP`](super::ENCODER_SLIP).
    pub slip: i32,
}

/// Returns the level of the filament's encoder (`true` is high) while the feed is at `feed_steps`. The other arguments
/// are the `ENCODER_*` words of the shared memory.
///
/// ```
/// use growbot_firmware::emulated_tip::{ENCODER_OK, EncoderMapping, encoder_level};
/// // An edge every 112.5 steps.
/// let (pitch, mapping) = (225 * 128, EncoderMapping::default());
/// let level = |steps| encoder_level(steps, pitch, ENCODER_OK, mapping);
/// assert!(level(0) && level(56) && !level(57) && !level(112) && level(113) && !level(-1));
/// ```
pub const fn encoder_level(feed_steps: i32, pitch: u32, state: u32, mapping: EncoderMapping) -> bool {
    match state {
        ENCODER_STUCK_LOW => false,
        ENCODER_STUCK_HIGH => true,
        _ if pitch == 0 => false,
        _ => {
            let steps = feed_steps as i64 - mapping.origin as i64;
            let turned = mapping.phase as i64 + steps * 256 + ((steps * mapping.slip as i64) >> 8);
            turned.rem_euclid(pitch as i64) * 2 < pitch as i64
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulated_tip::{ENCODER_OK, INDEX_FAULT_NONE};

    #[test]
    fn index_input_is_low_only_on_the_mark() {
        let low = (0..3200).filter(|&step| !index_level(step, 3200, 3198, 5, INDEX_FAULT_NONE)).count();
        assert_eq!(low, 5);
        assert!(!index_level(0, 3200, 3198, 5, INDEX_FAULT_NONE));
        assert!(!index_level(-2, 3200, 3198, 5, INDEX_FAULT_NONE));
        assert!(index_level(-3, 3200, 3198, 5, INDEX_FAULT_NONE));
        assert!(index_level(0, 0, 0, 5, INDEX_FAULT_NONE));
        assert!(!index_level(1000, 3200, 0, 5, INDEX_FAULT_STUCK_LOW));
        assert!(index_level(0, 3200, 0, 5, INDEX_FAULT_STUCK_HIGH));
    }

    #[test]
    fn encoder_level_follows_the_filament_position() {
        let mapping = EncoderMapping::default();
        assert!(!encoder_level(0, 0, ENCODER_OK, mapping));
        assert!(!encoder_level(0, 100 * 256, ENCODER_STUCK_LOW, mapping));
        assert!(encoder_level(70, 100 * 256, ENCODER_STUCK_HIGH, mapping));
        assert_eq!(rises(mapping), 888);
    }

    /// Counts the rising edges of the encoder in 100,000 feed steps, at 112.5 steps between edges without slip.
    fn rises(mapping: EncoderMapping) -> usize {
        let level = |step| encoder_level(step, 225 * 128, ENCODER_OK, mapping);
        (1..=100_000).filter(|step| level(*step) && !level(step - 1)).count()
    }

    #[test]
    fn encoder_follows_slipping_filament() {
        assert_eq!(rises(EncoderMapping { slip: -65_536 / 10, ..EncoderMapping::default() }), 800);
        assert_eq!(rises(EncoderMapping { slip: 65_536 / 4, ..EncoderMapping::default() }), 1111);
        // At a change of the mapping, the encoder continues at its present angle.
        let (pitch, before) = (225 * 128, EncoderMapping { origin: 0, phase: 0, slip: 6554 });
        let phase = ((70_i64 * 256 + ((70 * 6554) >> 8)) % i64::from(pitch)) as u32;
        let after = EncoderMapping { origin: 70, phase, slip: -6554 };
        let level = |mapping| encoder_level(70, pitch, ENCODER_OK, mapping);
        assert_eq!(level(before), level(after));
    }
}
