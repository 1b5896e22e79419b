//! What survives a reset of the board: the latest fault as it was when it came, and what was under way.
//!
//! It lies in RAM that nothing clears at start-up, with a CRC: after a loss of power it holds anything, and then nothing is known.

use growbot_core::link::frame;
use growbot_core::link::message::{Fault, FaultRecord, ResetCause, State};
use serde::{Deserialize, Serialize};

/// Bytes of it.
pub const KEPT_BYTES: usize = 128;
/// Those of the checksum, at the end.
const CHECKSUM_BYTES: usize = 4;

/// What was under way.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct UnderWay {
    /// What the board was doing.
    pub state: State,
    /// The job.
    pub plan_id: u64,
    /// Layers laid.
    pub laid: u32,
    /// Layers begun.
    pub begun: u32,
    /// Sectors made of the layer under way, some tenths of a second ago.
    pub sectors: u8,
}

/// What is kept.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Kept {
    /// The latest fault.
    pub record: Option<FaultRecord>,
    /// None while the robot rests.
    pub under_way: Option<UnderWay>,
}

impl Kept {
    /// As bytes.
    #[must_use]
    pub fn to_bytes(&self) -> [u8; KEPT_BYTES] {
        let mut bytes = [0; KEPT_BYTES];
        if let Some((content, checksum)) = bytes.split_last_chunk_mut::<CHECKSUM_BYTES>() {
            // It fits: a test says so of the longest. If not, an empty one would be kept.
            let _ = postcard::to_slice(self, content);
            *checksum = frame::checksum(content).to_le_bytes();
        }
        bytes
    }

    /// From bytes; none where they are not what [`Kept::to_bytes`] made.
    #[must_use]
    pub fn from_bytes(bytes: &[u8; KEPT_BYTES]) -> Option<Self> {
        let (content, checksum) = bytes.split_last_chunk::<CHECKSUM_BYTES>()?;
        if frame::checksum(content).to_le_bytes() != *checksum {
            return None;
        }
        postcard::take_from_bytes(content).ok().map(|(kept, _)| kept)
    }
}

/// The fault that a reset in the midst of work is.
#[must_use]
pub const fn fault_of(cause: ResetCause) -> Fault {
    match cause {
        ResetCause::BrownOut => Fault::BrownOut,
        ResetCause::Watchdog => Fault::WatchdogReset,
        ResetCause::ProcessorFault => Fault::ProcessorFault,
        ResetCause::StackOverflow => Fault::StackOverflow,
        ResetCause::ClockFailed => Fault::ClockFailed,
        ResetCause::PowerOn | ResetCause::External => Fault::PowerLost,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use growbot_core::link::message::SensorReadings;

    fn longest() -> Kept {
        let sensors = SensorReadings {
            supply_mv: Some(u32::MAX),
            on_index: true,
            filament_present: Some(true),
            filament_pulses: Some(u32::MAX),
            driver_fault: Some(true),
            emergency_stop: Some(true),
            gravity_milli_g: Some([i16::MIN; 3]),
        };
        let record = FaultRecord {
            fault: Some(Fault::PowerLost),
            cleared: true,
            state: State::EmergencyStop,
            uptime_ms: u64::MAX,
            temperature_centi_c: Some(i32::MIN),
            target_centi_c: Some(i32::MIN),
            duty: u16::MAX,
            sensors,
            plan_id: u64::MAX,
            laid: u32::MAX,
            begun: u32::MAX,
        };
        let under_way =
            UnderWay { state: State::EmergencyStop, plan_id: u64::MAX, laid: u32::MAX, begun: u32::MAX, sectors: 64 };
        Kept { record: Some(record), under_way: Some(under_way) }
    }

    #[test]
    fn it_survives_and_the_longest_fits() {
        for kept in [Kept::default(), longest()] {
            assert_eq!(Kept::from_bytes(&kept.to_bytes()), Some(kept));
        }
    }

    #[test]
    fn what_memory_comes_up_with_is_nothing() {
        assert_eq!(Kept::from_bytes(&[0; KEPT_BYTES]), None);
        assert_eq!(Kept::from_bytes(&[0xff; KEPT_BYTES]), None);
        let bytes = longest().to_bytes();
        for bit in 0..8 * KEPT_BYTES {
            let mut flipped = bytes;
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(Kept::from_bytes(&flipped), None, "bit {bit}");
        }
    }
}
