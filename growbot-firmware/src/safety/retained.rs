//! The state that survives a reset of the board: the record of the latest fault, and the activity before the reset.
//!
//! The state is stored in RAM that is not cleared at start-up. After a loss of power that RAM contains noise, and the
//! state is unknown. There are two copies, each with a generation number and a CRC:
//!
//! - A write goes to the older copy, from its first byte to its last, so that a reset during the write leaves the newer
//!   copy whole.
//! - A write that changes the action of the next start (whether work is in progress, which fault is latched, where the
//!   filament is) goes to both copies, one after the other, so that either copy alone has the decisive part.
//! - At a start the board loads the newer of the copies whose checksum is right. If this firmware cannot decode that
//!   copy, another version has written it. The memory has kept its power then, and the copy may contain current work or
//!   a latched fault. The start is therefore a fault, whatever the cause of the reset.
//! - If no copy has the right checksum, the cause of the reset decides: see [`keeps_ram`].

use growbot_core::link::frame;
use growbot_core::link::message::{Fault, FaultRecord, ResetCause, State};
use serde::{Deserialize, Serialize};

use crate::hal::RetainedMemory;
pub use crate::hal::{COPIES, COPY_BYTES, RETAINED_BYTES};

/// Length of a generation number, and of a checksum, bytes.
const NUMBER_BYTES: usize = 4;

/// The work that was in progress before a reset, as retained in memory.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ActiveWork {
    /// State of the robot.
    pub state: State,
    /// Identifier of the job's plan.
    pub plan_id: u64,
    /// Number of layers of the job that are laid.
    pub layers_laid: u32,
    /// Number of layers of the job that are begun.
    pub layers_begun: u32,
    /// Number of finished sectors of the current layer, up to some tenths of a second ago.
    pub sectors_done: u8,
}

/// The state that a board retains through a reset.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct RetainedState {
    /// Record of the latest fault or emergency stop. `None` if there was none.
    pub record: Option<FaultRecord>,
    /// Work in progress. `None` while the robot is at rest.
    pub under_way: Option<ActiveWork>,
    /// Number of feed steps by which the end of the filament is behind the nozzle.
    pub retracted_steps: u32,
}

impl RetainedState {
    /// Encodes the state as a copy for the memory, with a generation number and a checksum.
    pub fn to_bytes(&self, generation: u32) -> [u8; COPY_BYTES] {
        let mut bytes = [0; COPY_BYTES];
        if let Some((covered, checksum)) = bytes.split_last_chunk_mut::<NUMBER_BYTES>() {
            if let Some((content, number)) = covered.split_last_chunk_mut::<NUMBER_BYTES>() {
                // The content fits, as a test checks for the longest one. If it did not, an empty content would be
                // retained.
                let _ = postcard::to_slice(self, content);
                *number = generation.to_le_bytes();
            }
            *checksum = frame::crc32c(covered).to_le_bytes();
        }
        bytes
    }

    /// Decodes a copy of the state. `None` if the bytes are not a valid result of [`RetainedState::to_bytes`].
    pub fn from_bytes(bytes: &[u8; COPY_BYTES]) -> Option<Self> {
        generation_of(bytes)?;
        postcard::take_from_bytes(bytes).ok().map(|(retained, _)| retained)
    }

    /// Returns the part of the state that decides what the next start does.
    fn meaning(&self) -> StartupAction {
        StartupAction {
            under_way: self.under_way.is_some(),
            latched: self.record.filter(|record| !record.cleared).map(|record| record.fault),
            retracted_steps: self.retracted_steps,
        }
    }
}

/// Returns the generation number of a copy. `None` if the checksum of the copy is wrong.
fn generation_of(bytes: &[u8; COPY_BYTES]) -> Option<u32> {
    let (covered, checksum) = bytes.split_last_chunk::<NUMBER_BYTES>()?;
    let (_, number) = covered.split_last_chunk::<NUMBER_BYTES>()?;
    (frame::crc32c(covered).to_le_bytes() == *checksum).then_some(u32::from_le_bytes(*number))
}

/// The reason why the retained state could not be loaded at start-up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RetainedError {
    /// No copy has the right checksum: the memory was without power, or was destroyed.
    NotWhole,
    /// The newer copy has the right checksum, but this firmware cannot decode it, because another version has written
    /// it.
    NotDecodable,
}

impl RetainedError {
    /// Returns whether the lost state may have contained current work or a fault, so that a start after a reset of this
    /// cause is a fault.
    pub const fn is_fault(self, cause: ResetCause) -> bool {
        match self {
            Self::NotWhole => keeps_ram(cause),
            Self::NotDecodable => true,
        }
    }
}

/// The part of the retained state that decides what the next start does.
#[derive(Debug, Clone, Copy, PartialEq)]
struct StartupAction {
    /// True if work was in progress, so that a reset during it is a fault.
    under_way: bool,
    /// The latched fault: `Some(Some(fault))`, or `Some(None)` for the emergency stop. `None` if nothing is latched.
    latched: Option<Option<Fault>>,
    /// Number of feed steps by which the filament is pushed forward before the next layer.
    retracted_steps: u32,
}

/// Access to the two copies of the retained state in the memory.
#[derive(Debug, Clone, Copy, Default)]
pub struct RetainedStore {
    /// Index of the copy that was written last.
    newer: usize,
    /// Generation number of the copy that was written last.
    generation: u32,
    /// Startup action of both copies. `None` before the first write after a start.
    meaning: Option<StartupAction>,
}

impl RetainedStore {
    /// Finds the copies whose checksum is right, and decodes the newer one of them.
    pub fn find(memory: &mut impl RetainedMemory) -> (Self, Result<RetainedState, RetainedError>) {
        let bytes = memory.read();
        let mut found = Self::default();
        let mut newest = None;
        for (copy, bytes) in bytes.as_chunks::<COPY_BYTES>().0.iter().enumerate() {
            let Some(generation) = generation_of(bytes) else { continue };
            // The comparison wraps, because the number wraps.
            if newest.is_none() || (generation.wrapping_sub(found.generation) as i32) > 0 {
                found = Self { newer: copy, generation, meaning: None };
                newest = Some(bytes);
            }
        }
        let bytes = newest.ok_or(RetainedError::NotWhole);
        (found, bytes.and_then(|bytes| RetainedState::from_bytes(bytes).ok_or(RetainedError::NotDecodable)))
    }

    /// Writes the state to the older copy, or to both copies if the state changes what the next start does.
    pub fn write(&mut self, memory: &mut impl RetainedMemory, retained: &RetainedState) {
        let meaning = Some(retained.meaning());
        if self.meaning != meaning {
            self.write_older(memory, retained);
        }
        self.write_older(memory, retained);
        self.meaning = meaning;
    }

    fn write_older(&mut self, memory: &mut impl RetainedMemory, retained: &RetainedState) {
        self.newer = (self.newer + 1) % COPIES;
        self.generation = self.generation.wrapping_add(1);
        memory.write(self.newer, &retained.to_bytes(self.generation));
    }
}

/// Returns the fault that is latched after a reset of this cause during work.
pub const fn fault_for_reset(cause: ResetCause) -> Fault {
    match cause {
        ResetCause::BrownOut => Fault::BrownOut,
        ResetCause::Watchdog => Fault::WatchdogReset,
        ResetCause::ProcessorFault => Fault::ProcessorFault,
        ResetCause::StackOverflow => Fault::StackOverflow,
        ResetCause::ClockFailed => Fault::ClockFailed,
        ResetCause::PowerOn | ResetCause::External => Fault::PowerLost,
    }
}

/// Returns whether the memory keeps its power through a reset of this cause, and only this firmware can have written to
/// it. A copy with a wrong checksum after such a reset was destroyed. [`ResetCause::External`] is excluded, because a
/// debug probe flashes a board by code in RAM.
pub const fn keeps_ram(cause: ResetCause) -> bool {
    matches!(
        cause,
        ResetCause::Watchdog | ResetCause::ProcessorFault | ResetCause::StackOverflow | ResetCause::ClockFailed
    )
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use growbot_core::link::message::{DriverProblem, DriverReport, Motor, SensorReadings};

    fn longest() -> RetainedState {
        let sensors = SensorReadings {
            supply_mv: Some(u32::MAX),
            on_index: true,
            filament_present: Some(true),
            filament_pulses: Some(u32::MAX),
            driver_fault: Some(true),
            driver_problem: Some(DriverReport { motor: Motor::Feed, problem: DriverProblem::Stall }),
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
            layers_begun: u32::MAX,
        };
        let under_way = ActiveWork {
            state: State::EmergencyStop,
            plan_id: u64::MAX,
            layers_laid: u32::MAX,
            layers_begun: u32::MAX,
            sectors_done: 64,
        };
        RetainedState { record: Some(record), under_way: Some(under_way), retracted_steps: u32::MAX }
    }

    /// Retained memory of a board, for tests.
    #[derive(Clone)]
    struct Memory([u8; RETAINED_BYTES]);

    impl RetainedMemory for Memory {
        fn read(&mut self) -> [u8; RETAINED_BYTES] {
            self.0
        }

        fn write(&mut self, copy: usize, bytes: &[u8; COPY_BYTES]) {
            self.0.as_chunks_mut::<COPY_BYTES>().0[copy] = *bytes;
        }
    }

    /// Returns the state that a start of the board finds in the memory.
    fn found(memory: &Memory) -> Option<RetainedState> {
        RetainedStore::find(&mut memory.clone()).1.ok()
    }

    /// Returns a copy with the right checksum that this firmware cannot decode.
    pub(crate) fn of_another_firmware(generation: u32) -> [u8; COPY_BYTES] {
        let mut bytes = [0xff; COPY_BYTES];
        let (covered, checksum) = bytes.split_last_chunk_mut::<NUMBER_BYTES>().unwrap();
        *covered.last_chunk_mut().unwrap() = generation.to_le_bytes();
        *checksum = frame::crc32c(covered).to_le_bytes();
        bytes
    }

    #[test]
    fn state_of_another_firmware_is_undecodable_and_hides_older_copies() {
        let (own, other) = (|generation| longest().to_bytes(generation), of_another_firmware);
        for (copies, expected) in [
            ([other(7), other(8)], Err(RetainedError::NotDecodable)),
            ([own(7), other(8)], Err(RetainedError::NotDecodable)),
            ([other(8), own(7)], Err(RetainedError::NotDecodable)),
            // The first write of this firmware is complete.
            ([other(7), own(8)], Ok(longest())),
            ([other(7), [0; COPY_BYTES]], Err(RetainedError::NotDecodable)),
            ([own(7), [0; COPY_BYTES]], Ok(longest())),
            ([[0; COPY_BYTES]; 2], Err(RetainedError::NotWhole)),
        ] {
            let mut memory = Memory([0; RETAINED_BYTES]);
            memory.0.as_chunks_mut::<COPY_BYTES>().0.copy_from_slice(&copies);
            assert_eq!(RetainedStore::find(&mut memory).1, expected);
        }
    }

    #[test]
    fn retained_state_round_trips_and_the_longest_fits() {
        for retained in [RetainedState::default(), longest()] {
            for generation in [0, 1, u32::MAX] {
                let bytes = retained.to_bytes(generation);
                assert_eq!(
                    (RetainedState::from_bytes(&bytes), generation_of(&bytes)),
                    (Some(retained), Some(generation))
                );
            }
        }
        let mut buffer = [0; COPY_BYTES - 2 * NUMBER_BYTES];
        assert!(postcard::to_slice(&longest(), &mut buffer).is_ok());
    }

    #[test]
    fn uninitialised_memory_holds_no_state() {
        for byte in [0, 0x55, 0xff] {
            assert_eq!(found(&Memory([byte; RETAINED_BYTES])), None);
        }
        let bytes = longest().to_bytes(7);
        for bit in 0..8 * COPY_BYTES {
            let mut flipped = bytes;
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(RetainedState::from_bytes(&flipped), None, "bit {bit}");
        }
    }

    #[test]
    fn both_copies_are_written_only_if_the_start_behaviour_changes() {
        let (mut memory, mut copies) = (Memory([0xA5; RETAINED_BYTES]), RetainedStore::default());
        // True for each state of the sequence after which a start acts differently than after the state before it.
        let otherwise = [true, true, true, false, true, false, false, false, true, true, true, false, true, true];
        for (retained, otherwise) in story().iter().zip(otherwise) {
            let before = copies.generation;
            copies.write(&mut memory, retained);
            assert_eq!(copies.generation.wrapping_sub(before), if otherwise { 2 } else { 1 }, "{retained:?}");
            assert_eq!(found(&memory), Some(*retained));
        }
    }

    #[test]
    fn only_processor_resets_keep_ram_powered() {
        for (cause, expected, fault) in [
            (ResetCause::PowerOn, false, Fault::PowerLost),
            (ResetCause::External, false, Fault::PowerLost),
            (ResetCause::BrownOut, false, Fault::BrownOut),
            (ResetCause::Watchdog, true, Fault::WatchdogReset),
            (ResetCause::ProcessorFault, true, Fault::ProcessorFault),
            (ResetCause::StackOverflow, true, Fault::StackOverflow),
            (ResetCause::ClockFailed, true, Fault::ClockFailed),
        ] {
            assert_eq!((keeps_ram(cause), fault_for_reset(cause)), (expected, fault));
        }
    }

    /// Returns states that a board retains one after the other: at rest, a fault of the self-test, at rest, at work, a
    /// fault, the fault cleared, at work again, an emergency stop.
    fn story() -> std::vec::Vec<RetainedState> {
        let record = |fault, cleared| longest().record.map(|record| FaultRecord { fault, cleared, ..record });
        let at = |state, sectors| {
            longest().under_way.map(|under_way| ActiveWork { state, sectors_done: sectors, ..under_way })
        };
        let fault = Some(Fault::ThermistorOpen);
        let state = |record, under_way| RetainedState { record, under_way, retracted_steps: 0 };
        std::vec![
            RetainedState::default(),
            // The self-test raised a fault before any work began.
            state(record(Some(Fault::SupplyLow), false), None),
            state(record(Some(Fault::SupplyLow), true), None),
            RetainedState::default(),
            state(None, at(State::Heating, 0)),
            state(None, at(State::Growing, 0)),
            state(None, at(State::Growing, 7)),
            state(None, at(State::Growing, 14)),
            state(record(fault, false), None),
            state(record(fault, true), None),
            state(record(fault, true), at(State::Heating, 0)),
            state(record(fault, true), at(State::Growing, 1)),
            state(record(None, false), None),
            state(record(None, true), None),
        ]
    }

    /// Returns the memory after a part of a write. The byte that was being written when the reset occurred may have any
    /// value.
    fn torn(before: &Memory, copy: usize, bytes: &[u8; COPY_BYTES], written: usize, noise: u8) -> Memory {
        let mut memory = before.clone();
        let into = &mut memory.0.as_chunks_mut::<COPY_BYTES>().0[copy];
        into[..written].copy_from_slice(&bytes[..written]);
        into[written] = noise;
        memory
    }

    #[test]
    fn a_torn_write_leaves_the_old_or_the_new_state() {
        struct Recording(Memory, std::vec::Vec<(usize, [u8; COPY_BYTES])>);
        impl RetainedMemory for Recording {
            fn read(&mut self) -> [u8; RETAINED_BYTES] {
                self.0.read()
            }
            fn write(&mut self, copy: usize, bytes: &[u8; COPY_BYTES]) {
                self.1.push((copy, *bytes));
            }
        }
        let mut tears = 0;
        // The generation numbers wrap at each of the writes, and the initial memory may have any content.
        for first in (u32::MAX - 24..=u32::MAX).chain([0, 1 << 31, (1 << 31) - 3]) {
            let mut memory = Memory([0xA5; RETAINED_BYTES]);
            let mut copies = RetainedStore { generation: first, ..RetainedStore::default() };
            let mut before = None;
            for retained in story() {
                let mut recording = Recording(memory.clone(), std::vec![]);
                copies.write(&mut recording, &retained);
                for (copy, bytes) in recording.1 {
                    for written in 0..COPY_BYTES {
                        for noise in [0, 0xff, bytes[written], !bytes[written]] {
                            let found = found(&torn(&memory, copy, &bytes, written, noise));
                            assert!(
                                found == before || found == Some(retained),
                                "{written} bytes of {retained:?}: {found:?}"
                            );
                            tears += 1;
                        }
                    }
                    memory.write(copy, &bytes);
                    before = Some(retained);
                    assert_eq!(found(&memory), before);
                }
            }
        }
        assert!(tears > 100_000, "{tears}");
    }

    #[test]
    fn one_destroyed_copy_hides_neither_work_nor_a_fault() {
        let mut memory = Memory([0; RETAINED_BYTES]);
        let mut copies = RetainedStore::default();
        for retained in story() {
            copies.write(&mut memory, &retained);
            for byte in 0..RETAINED_BYTES {
                let mut damaged = memory.clone();
                damaged.0[byte] ^= 0x10;
                let found = found(&damaged).unwrap();
                assert_eq!(found.meaning(), retained.meaning(), "byte {byte}");
            }
        }
    }
}
