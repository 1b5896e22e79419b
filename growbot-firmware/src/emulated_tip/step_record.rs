//! The records of motor steps, and their addresses in the ring buffer that the emulated board and the simulated tip
//! share.

use super::{STEP_RING, STEP_RING_RECORDS};

/// One rising edge of a STEP pin, as stored in the ring buffer of the shared memory:
///
/// | bits | meaning |
/// |---|---|
/// | 31 | axis: 0 head, 1 feed |
/// | 30 | DIR: 1 forward |
/// | 29 | the driver was energised |
/// | 28..0 | low bits of the tick at which the edge came |
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StepRecord {
    /// The motor whose STEP pin rose.
    pub axis: RecordedMotor,
    /// True if the DIR pin was high, which means forward.
    pub forward: bool,
    /// True if the driver was energised, so that the motor turned.
    pub enabled: bool,
    /// Tick of the edge modulo 2^29 (37 hours at 4 kHz). [`StepRecord::tick_after`] returns the complete tick.
    pub tick: u32,
}

/// The two motors of the emulated tip.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RecordedMotor {
    /// The motor that turns the print head.
    Head,
    /// The motor that pushes the filament.
    Feed,
}

const AXIS_BIT: u32 = 1 << 31;
const FORWARD_BIT: u32 = 1 << 30;
const ENABLED_BIT: u32 = 1 << 29;
const TICK_MASK: u32 = ENABLED_BIT - 1;

impl StepRecord {
    /// Encodes the record as a word of the ring buffer. Only the low 29 bits of the tick are kept.
    pub const fn to_word(self) -> u32 {
        let axis = match self.axis {
            RecordedMotor::Head => 0,
            RecordedMotor::Feed => AXIS_BIT,
        };
        let forward = if self.forward { FORWARD_BIT } else { 0 };
        let enabled = if self.enabled { ENABLED_BIT } else { 0 };
        axis | forward | enabled | (self.tick & TICK_MASK)
    }

    /// Decodes a word of the ring buffer. Every word is a valid record.
    pub const fn from_word(word: u32) -> Self {
        StepRecord {
            axis: if word & AXIS_BIT == 0 { RecordedMotor::Head } else { RecordedMotor::Feed },
            forward: word & FORWARD_BIT != 0,
            enabled: word & ENABLED_BIT != 0,
            tick: word & TICK_MASK,
        }
    }

    /// Returns the complete number of this record's tick. `earlier` is a tick less than 2^29 ticks before it: that of
    /// an earlier record, or the start of the boot.
    pub const fn tick_after(self, earlier: u64) -> u64 {
        let modulus = TICK_MASK as u64 + 1;
        let gap = (self.tick as u64).wrapping_sub(earlier) % modulus;
        earlier.wrapping_add(gap)
    }
}

/// Returns the byte offset of a step record in the shared memory. `index` is the number of records written before it,
/// wrapping.
pub const fn step_record_offset(index: u32) -> usize {
    STEP_RING + 4 * (index % STEP_RING_RECORDS) as usize
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emulated_tip::SIZE;

    #[test]
    fn a_step_record_round_trips_through_a_word() {
        for axis in [RecordedMotor::Head, RecordedMotor::Feed] {
            for (forward, enabled) in [(false, false), (false, true), (true, false), (true, true)] {
                let record = StepRecord { axis, forward, enabled, tick: 0x1234_5678 & TICK_MASK };
                assert_eq!(StepRecord::from_word(record.to_word()), record);
            }
        }
    }

    #[test]
    fn ticks_are_extended_across_the_wrap() {
        let record = |tick| StepRecord { axis: RecordedMotor::Head, forward: true, enabled: true, tick };
        assert_eq!(record(7).tick_after(7), 7);
        assert_eq!(record(3).tick_after((1 << 29) - 2), (1 << 29) + 3);
        assert_eq!(record(1).tick_after((5 << 29) + 1), (5 << 29) + 1);
    }

    #[test]
    fn the_ring_wraps_with_the_write_index() {
        assert_eq!(step_record_offset(0), STEP_RING);
        assert_eq!(step_record_offset(STEP_RING_RECORDS), STEP_RING);
        assert_eq!(step_record_offset(u32::MAX), STEP_RING + 4 * (STEP_RING_RECORDS as usize - 1));
        assert!(step_record_offset(u32::MAX) + 4 <= SIZE);
    }
}
