//! What survives a reset of the board: the latest fault as it was when it came, and what was under way.
//!
//! It lies in RAM that nothing clears at start-up. After a loss of power that RAM is noise, and nothing is known.
//! There are two copies, each with a generation number and a CRC:
//!
//! - A write goes to the older copy, from its first byte to its last, so a reset in the midst of it leaves the newer
//!   one whole.
//! - A write that changes what a start must do (whether work was under way, which fault is latched) goes to both
//!   copies, one after the other, so that either copy alone says what matters.
//! - A start takes the newer of the copies that are whole. If this firmware cannot decode that copy, another version
//!   has written it. The memory has had power then, and the copy may say that work was under way or a fault latched:
//!   the start is a fault, after any cause.
//! - Where no copy is whole, the cause of the reset decides: see [`survives`].

use growbot_core::link::frame;
use growbot_core::link::message::{Fault, FaultRecord, ResetCause, State};
use serde::{Deserialize, Serialize};

use crate::hal::RetainedMemory;

/// Copies in the memory.
pub const COPIES: usize = 2;
/// Bytes of a copy: its content, its generation number and its checksum.
pub const COPY_BYTES: usize = 128;
/// Bytes of the memory.
pub const RETAINED_BYTES: usize = COPIES * COPY_BYTES;
/// Bytes of a generation number, and of a checksum.
const NUMBER_BYTES: usize = 4;

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

/// What a board retains through a reset.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Retained {
    /// The latest fault.
    pub record: Option<FaultRecord>,
    /// None while the robot rests.
    pub under_way: Option<UnderWay>,
}

impl Retained {
    /// The bytes of a copy.
    #[must_use]
    pub fn to_bytes(&self, generation: u32) -> [u8; COPY_BYTES] {
        let mut bytes = [0; COPY_BYTES];
        if let Some((covered, checksum)) = bytes.split_last_chunk_mut::<NUMBER_BYTES>() {
            if let Some((content, number)) = covered.split_last_chunk_mut::<NUMBER_BYTES>() {
                // It fits: a test says so of the longest one. If it did not, an empty one would be retained.
                let _ = postcard::to_slice(self, content);
                *number = generation.to_le_bytes();
            }
            *checksum = frame::checksum(covered).to_le_bytes();
        }
        bytes
    }

    /// Decodes the bytes of a copy; none where they are not what [`Retained::to_bytes`] made.
    #[must_use]
    pub fn from_bytes(bytes: &[u8; COPY_BYTES]) -> Option<Self> {
        generation_of(bytes)?;
        postcard::take_from_bytes(bytes).ok().map(|(retained, _)| retained)
    }

    /// What a start must do because of it.
    fn meaning(&self) -> Meaning {
        Meaning {
            under_way: self.under_way.is_some(),
            latched: self.record.filter(|record| !record.cleared).map(|record| record.fault),
        }
    }
}

/// The generation number of a copy; none where it is not whole.
fn generation_of(bytes: &[u8; COPY_BYTES]) -> Option<u32> {
    let (covered, checksum) = bytes.split_last_chunk::<NUMBER_BYTES>()?;
    let (_, number) = covered.split_last_chunk::<NUMBER_BYTES>()?;
    (frame::checksum(covered).to_le_bytes() == *checksum).then_some(u32::from_le_bytes(*number))
}

/// Why a start does not know what was under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unknown {
    /// No copy is whole: the memory was without power, or is destroyed.
    NotWhole,
    /// The newer copy is whole, and this firmware cannot decode it: another one has written it.
    NotDecodable,
}

impl Unknown {
    /// Whether it may hide work that was under way, or a fault, so that a start after a reset of this cause is a fault.
    #[must_use]
    pub const fn is_fault(self, cause: ResetCause) -> bool {
        match self {
            Self::NotWhole => survives(cause),
            Self::NotDecodable => true,
        }
    }
}

/// The part of what is retained that decides what a start must do.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Meaning {
    /// Work was under way: its end is a fault.
    under_way: bool,
    /// What is latched: a fault, or the emergency stop, which is none.
    latched: Option<Option<Fault>>,
}

/// The two copies in the memory.
#[derive(Debug, Clone, Copy, Default)]
pub struct Copies {
    /// The newer one.
    newer: usize,
    /// Its generation number.
    generation: u32,
    /// The meaning of both copies; none before the first write after a start.
    meaning: Option<Meaning>,
}

impl Copies {
    /// Finds the newer of the copies that are whole, and decodes it.
    pub fn find(memory: &mut impl RetainedMemory) -> (Self, Result<Retained, Unknown>) {
        let bytes = memory.read();
        let mut found = Self::default();
        let mut newest = None;
        for (copy, bytes) in bytes.as_chunks::<COPY_BYTES>().0.iter().enumerate() {
            let Some(generation) = generation_of(bytes) else { continue };
            // The shorter way round: the number wraps.
            if newest.is_none() || (generation.wrapping_sub(found.generation) as i32) > 0 {
                found = Self { newer: copy, generation, meaning: None };
                newest = Some(bytes);
            }
        }
        let bytes = newest.ok_or(Unknown::NotWhole);
        (found, bytes.and_then(|bytes| Retained::from_bytes(bytes).ok_or(Unknown::NotDecodable)))
    }

    /// Writes to the older copy, or to both copies if a start would have to do something else because of it.
    pub fn write(&mut self, memory: &mut impl RetainedMemory, retained: &Retained) {
        let meaning = Some(retained.meaning());
        if self.meaning != meaning {
            self.write_older(memory, retained);
        }
        self.write_older(memory, retained);
        self.meaning = meaning;
    }

    fn write_older(&mut self, memory: &mut impl RetainedMemory, retained: &Retained) {
        self.newer = (self.newer + 1) % COPIES;
        self.generation = self.generation.wrapping_add(1);
        memory.write(self.newer, &retained.to_bytes(self.generation));
    }
}

/// The fault that a reset in the midst of work is latched as.
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

/// Whether the memory has had power through a reset of this cause, and only this firmware has written there: what is
/// not whole then was destroyed. (A debug probe, which is [`ResetCause::External`], flashes a board by code in RAM.)
#[must_use]
pub const fn survives(cause: ResetCause) -> bool {
    matches!(
        cause,
        ResetCause::Watchdog | ResetCause::ProcessorFault | ResetCause::StackOverflow | ResetCause::ClockFailed
    )
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use growbot_core::link::message::{DriverProblem, DriverTrouble, Motor, SensorReadings};

    fn longest() -> Retained {
        let sensors = SensorReadings {
            supply_mv: Some(u32::MAX),
            on_index: true,
            filament_present: Some(true),
            filament_pulses: Some(u32::MAX),
            driver_fault: Some(true),
            driver_trouble: Some(DriverTrouble { motor: Motor::Feed, problem: DriverProblem::Stall }),
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
        Retained { record: Some(record), under_way: Some(under_way) }
    }

    /// The memory as a test sees it.
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

    /// What a start finds.
    fn found(memory: &Memory) -> Option<Retained> {
        Copies::find(&mut memory.clone()).1.ok()
    }

    /// A copy that is whole, and that this firmware cannot decode.
    pub(crate) fn of_another_firmware(generation: u32) -> [u8; COPY_BYTES] {
        let mut bytes = [0xff; COPY_BYTES];
        let (covered, checksum) = bytes.split_last_chunk_mut::<NUMBER_BYTES>().unwrap();
        *covered.last_chunk_mut().unwrap() = generation.to_le_bytes();
        *checksum = frame::checksum(covered).to_le_bytes();
        bytes
    }

    #[test]
    fn what_another_firmware_has_left_is_not_decodable_and_hides_what_is_older() {
        let (own, other) = (|generation| longest().to_bytes(generation), of_another_firmware);
        for (copies, expected) in [
            ([other(7), other(8)], Err(Unknown::NotDecodable)),
            ([own(7), other(8)], Err(Unknown::NotDecodable)),
            ([other(8), own(7)], Err(Unknown::NotDecodable)),
            // The first write of this firmware has come to its end.
            ([other(7), own(8)], Ok(longest())),
            ([other(7), [0; COPY_BYTES]], Err(Unknown::NotDecodable)),
            ([own(7), [0; COPY_BYTES]], Ok(longest())),
            ([[0; COPY_BYTES]; 2], Err(Unknown::NotWhole)),
        ] {
            let mut memory = Memory([0; RETAINED_BYTES]);
            memory.0.as_chunks_mut::<COPY_BYTES>().0.copy_from_slice(&copies);
            assert_eq!(Copies::find(&mut memory).1, expected);
        }
    }

    #[test]
    fn it_survives_and_the_longest_fits() {
        for retained in [Retained::default(), longest()] {
            for generation in [0, 1, u32::MAX] {
                let bytes = retained.to_bytes(generation);
                assert_eq!((Retained::from_bytes(&bytes), generation_of(&bytes)), (Some(retained), Some(generation)));
            }
        }
        let mut buffer = [0; COPY_BYTES - 2 * NUMBER_BYTES];
        assert!(postcard::to_slice(&longest(), &mut buffer).is_ok());
    }

    #[test]
    fn what_memory_comes_up_with_is_nothing() {
        for byte in [0, 0x55, 0xff] {
            assert_eq!(found(&Memory([byte; RETAINED_BYTES])), None);
        }
        let bytes = longest().to_bytes(7);
        for bit in 0..8 * COPY_BYTES {
            let mut flipped = bytes;
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert_eq!(Retained::from_bytes(&flipped), None, "bit {bit}");
        }
    }

    #[test]
    fn both_copies_say_what_a_start_must_do_and_the_rest_takes_one_write() {
        let (mut memory, mut copies) = (Memory([0xA5; RETAINED_BYTES]), Copies::default());
        // Of each of the story: whether a start would have to do something else than after the one before.
        let otherwise = [true, true, true, false, true, false, false, false, true, true, true, false, true, true];
        for (retained, otherwise) in story().iter().zip(otherwise) {
            let before = copies.generation;
            copies.write(&mut memory, retained);
            assert_eq!(copies.generation.wrapping_sub(before), if otherwise { 2 } else { 1 }, "{retained:?}");
            assert_eq!(found(&memory), Some(*retained));
        }
    }

    #[test]
    fn only_resets_of_the_processor_alone_leave_the_memory_its_power() {
        for (cause, expected, fault) in [
            (ResetCause::PowerOn, false, Fault::PowerLost),
            (ResetCause::External, false, Fault::PowerLost),
            (ResetCause::BrownOut, false, Fault::BrownOut),
            (ResetCause::Watchdog, true, Fault::WatchdogReset),
            (ResetCause::ProcessorFault, true, Fault::ProcessorFault),
            (ResetCause::StackOverflow, true, Fault::StackOverflow),
            (ResetCause::ClockFailed, true, Fault::ClockFailed),
        ] {
            assert_eq!((survives(cause), fault_of(cause)), (expected, fault));
        }
    }

    /// What a board retains one after the other: at rest, a fault of the self-test, at rest, at work, a fault, the
    /// fault cleared, at work again, an emergency stop.
    fn story() -> std::vec::Vec<Retained> {
        let record = |fault, cleared| longest().record.map(|record| FaultRecord { fault, cleared, ..record });
        let at = |state, sectors| longest().under_way.map(|under_way| UnderWay { state, sectors, ..under_way });
        let fault = Some(Fault::ThermistorOpen);
        std::vec![
            Retained::default(),
            // A fault of the self-test, before anything was under way.
            Retained { record: record(Some(Fault::SupplyLow), false), under_way: None },
            Retained { record: record(Some(Fault::SupplyLow), true), under_way: None },
            Retained::default(),
            Retained { record: None, under_way: at(State::Heating, 0) },
            Retained { record: None, under_way: at(State::Growing, 0) },
            Retained { record: None, under_way: at(State::Growing, 7) },
            Retained { record: None, under_way: at(State::Growing, 14) },
            Retained { record: record(fault, false), under_way: None },
            Retained { record: record(fault, true), under_way: None },
            Retained { record: record(fault, true), under_way: at(State::Heating, 0) },
            Retained { record: record(fault, true), under_way: at(State::Growing, 1) },
            Retained { record: record(None, false), under_way: None },
            Retained { record: record(None, true), under_way: None },
        ]
    }

    /// The memory after some bytes of a write. The byte that the reset met may be anything.
    fn torn(before: &Memory, copy: usize, bytes: &[u8; COPY_BYTES], written: usize, noise: u8) -> Memory {
        let mut memory = before.clone();
        let into = &mut memory.0.as_chunks_mut::<COPY_BYTES>().0[copy];
        into[..written].copy_from_slice(&bytes[..written]);
        into[written] = noise;
        memory
    }

    #[test]
    fn a_write_that_is_torn_at_any_byte_leaves_what_was_there_or_what_was_to_be() {
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
        // Generation numbers that wrap at each of the writes, and memory that comes up with anything.
        for first in (u32::MAX - 24..=u32::MAX).chain([0, 1 << 31, (1 << 31) - 3]) {
            let mut memory = Memory([0xA5; RETAINED_BYTES]);
            let mut copies = Copies { generation: first, ..Copies::default() };
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
    fn one_copy_that_is_destroyed_hides_neither_work_nor_a_fault() {
        let mut memory = Memory([0; RETAINED_BYTES]);
        let mut copies = Copies::default();
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
