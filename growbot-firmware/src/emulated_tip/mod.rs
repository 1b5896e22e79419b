//! The memory that the emulated board shares with the simulation of the tip on the desktop (the host). This module
//! defines its layout for the board and the host.
//!
//! QEMU's mps2-an386 has no pins. Its firmware writes these words instead of driving a heater and two stepper drivers.
//! It reads these words instead of a thermistor and an index sensor. The desktop maps the same memory (QEMU's
//! `memory-backend-file`, at [`ADDRESS`] for the board) and simulates the tip.
//!
//! Every word is a little-endian `u32` and is named here by its byte offset. Each word has one writer:
//!
//! | offset | word | writer | unit |
//! |---|---|---|---|
//! | `0x000` | [`MAGIC`] | board | [`MAGIC_VALUE`] once the board's words are valid |
//! | `0x004` | [`VERSION`] | board | [`VERSION_VALUE`] |
//! | `0x010` | [`BOOTS`] | board | boots since the memory was zero; 1 on the first |
//! | `0x014` | [`RESET_CAUSE`] | board | `RESET_*` |
//! | `0x018` | [`BOOT_WRITE_INDEX`] | board | [`STEP_WRITE_INDEX`] when this boot began |
//! | `0x01C` | [`WATCHDOG_FEEDS`] | board | times the watchdog was fed in this boot, wrapping |
//! | `0x020` | [`TICKS_LO`], [`TICKS_HI`] | board | step interrupts since this boot began: the board's clock |
//! | `0x028` | [`TICK_HZ`] | board | ticks a second |
//! | `0x030` | [`HEATER_DUTY`] | board | 0 to 65535, full power |
//! | `0x034` | [`HEATER_ENABLE`] | board | 1: the second switch in the heater's supply is closed |
//! | `0x038` | [`HEAD_ENABLE`] | board | 1: the head's driver is energised |
//! | `0x03C` | [`FEED_ENABLE`] | board | 1: the feed's driver is energised |
//! | `0x040` | [`HEAD_STEPS`] | board | `i32`: steps the head has turned, survives a reset of the board |
//! | `0x044` | [`FEED_STEPS`] | board | `i32`: steps the feed has turned, survives a reset of the board |
//! | `0x048` | [`HEATER_ENERGY_LO`], [`HEATER_ENERGY_HI`] | board | duty x ticks with the heater on, in this boot |
//! | `0x050` | [`STEP_WRITE_INDEX`] | board | records written, wrapping, survives a reset of the board |
//! | `0x050` | [`STEP_WRITE_INDEX`] | board | step records written, wrapping, survives a reset of the board |
//! | `0x054` | [`STEP_OVERRUN`] | board | step records dropped because the ring was full, in this boot |
//! | `0x05C` | [`STACK_UNUSED`] | board | bytes of the stack never used in this boot; 0 until they are counted |
//! | `0x060` | [`FAN_DUTY`] | board | 0 to 65535, full speed |
//! | `0x100` | [`THERMISTOR_RAW`] | host | 0 to 4095, as the board's ADC would read |
//! | `0x104` | [`THERMISTOR_LIVE`] | host | 1: the ADC delivers readings; 0: it has stopped |
//! | `0x108` | [`STEP_READ_INDEX`] | host | records read, wrapping |
//! | `0x108` | [`STEP_READ_INDEX`] | host | step records read, wrapping |
//! | `0x114` | [`INDEX_POSITION`] | host | where the mark begins, in head steps from 0 |
//! | `0x114` | [`INDEX_POSITION`] | host | head step at which the mark begins |
//! | `0x11C` | [`INDEX_FAULT`] | host | `INDEX_FAULT_*` |
//! | `0x120` | [`ENTROPY`] | host | a number that differs in each run, for boot ids |
//! | `0x124` | [`ROBOT_LENGTH`] | host | bytes of [`ROBOT`] that are valid, at most [`ROBOT_CAPACITY`] |
//! | `0x128` | [`SUPPLY_RAW`] | host | 0 to 4095, as the board's ADC would read |
//! | `0x12C` | [`SUPPLY_LIVE`] | host | as [`THERMISTOR_LIVE`] |
//! | `0x130` | [`FILAMENT_PRESENT`] | host | 1: there is filament |
//! | `0x134` | [`DRIVER_FAULT`] | host | 1: a stepper driver reports a fault |
//! | `0x138` | [`EMERGENCY_STOP`] | host | 1: the emergency stop is pressed |
//! | `0x13C` | [`ENCODER_PITCH`] | host | feed steps between rising edges of the encoder, in 1/256; 0: no encoder |
//! | `0x140` | [`ENCODER_STATE`] | host | `ENCODER_*`: whether filament follows the feed |
//! | `0x144` | [`GRAVITY_X`], [`GRAVITY_Y`], [`GRAVITY_Z`] | host | `i32`: gravity in the tip's frame, 1/1000 g |
//! | `0x150` | [`GRAVITY_LIVE`] | host | 1: the orientation sensor answers |
//! | `0x154` | [`OVERFLOW_STACK`] | host | 1: the board is to overflow its stack, as a test |
//! | `0x158` | [`ENCODER_SEQUENCE`] | host | odd while the host changes the three words after it |
//! | `0x15C` | [`ENCODER_ORIGIN`] | host | `i32`; the [`FEED_STEPS`] from which the encoder continues |
//! | `0x160` | [`ENCODER_PHASE`] | host | how far it is turned there, in 1/256 steps |
//! | `0x160` | [`ENCODER_PHASE`] | host | angle of the encoder at [`ENCODER_ORIGIN`], in 1/256 steps |
//! | `0x164` | [`ENCODER_SLIP`] | host | `i32`; extra filament that each step moves, in 1/65536 of a step |
//! | `0x16C` | [`HANG`] | host | 1: the main loop is to hang while the watchdog is fed, as a test |
//! | `0x1000` | [`ROBOT`] | host | the robot description, bytes |
//! | `0x2_0000` | [`JOURNAL_FLASH`] | board | its flash, [`FLASH_AREA_BYTES`] bytes: survives a reset of the board |
//! | `0x8_0000` | [`DESCRIPTION_FLASH`] | board | the flash of the robot's description, like [`JOURNAL_FLASH`] |
//! | `0xC_0000` | [`ALARMS`] | board | the latest tick number of each remainder modulo [`ALARM_WORDS`] |
//! | `0x10_0000` | [`STEP_RING`] | board | [`STEP_RING_RECORDS`] step records, see [`StepRecord`] |
//!
//! # Order of accesses
//!
//! - The host creates the memory ([`SIZE`] bytes of zero), writes its words, then starts the board. The board never
//!   changes the host's words. It also keeps its own running indices if it finds [`MAGIC_VALUE`]. All its outputs start
//!   at 0.
//! - A new boot shows as a change of [`BOOTS`], which the board writes last. The records from [`BOOT_WRITE_INDEX`] on
//!   belong to this boot.
//! - The board writes a step record, then [`STEP_WRITE_INDEX`]. The host reads the index, then the records below it,
//!   then writes [`STEP_READ_INDEX`]. The board never waits: when the ring is full it drops the record and counts it in
//!   [`STEP_OVERRUN`]. The positions [`HEAD_STEPS`] and [`FEED_STEPS`] still count such steps.
//! - The host writes [`THERMISTOR_RAW`], then 1 to [`THERMISTOR_LIVE`]. From then on the board reads the latest value
//!   at any rate, like that of its own ADC, so that a slow host does not look like a broken sensor.
//! - The board writes to [`JOURNAL_FLASH`] and [`DESCRIPTION_FLASH`] as to flash: it programs words by clearing bits,
//!   and erases sectors of [`FLASH_SECTOR_BYTES`] bytes by setting all bits. The zeros of the new memory do not count
//!   as erased.
//! - Pairs (`_LO`, `_HI`) are read high, low, high, until both highs agree. Each pair lies in eight aligned bytes.
//!
//! # Meaning of the pins
//!
//! A step counts at the rising edge of STEP. DIR high turns forward (counts up). A driver that is not energised does
//! not turn, so its edges are recorded with `enabled` false and do not count in the positions. The index sensor pulls
//! its line low while `(HEAD_STEPS - INDEX_POSITION) mod INDEX_STEPS_PER_TURN < INDEX_WIDTH`. The board computes the
//! level from its own edges, so that homing takes the same steps in every run. A host simulates slip of the head by
//! changing [`INDEX_POSITION`]. The level of the filament's encoder follows from [`FEED_STEPS`] in the same way: it is
//! high in the first half of each [`ENCODER_PITCH`]. If the filament slips in its drive, the host sets where the slip
//! begins and how large it is. If the filament does not follow the feed at all, the host sets a fixed level. The words
//! of the other inputs have logical levels, not those of a wire.
//!
//! The model does not include step pulse widths, set-up times of DIR, micro-step tables, and the two directions of a
//! worn gear.

mod sensors;
mod step_record;

pub use sensors::{EncoderMapping, encoder_level, index_level};
pub use step_record::{RecordedMotor, StepRecord, step_record_offset};

/// Address of the shared memory on the board: the expansion RAM of the mps2 boards.
pub const ADDRESS: usize = 0x2100_0000;
/// Length of the memory, bytes, a power of two. QEMU requires the file to have exactly this length.
pub const SIZE: usize = 16 * 1024 * 1024;

/// Byte offset of the word that is [`MAGIC_VALUE`] once the board's words are valid.
pub const MAGIC: usize = 0x000;
/// Byte offset of the word with the version of this memory layout, [`VERSION_VALUE`].
pub const VERSION: usize = 0x004;
/// Value of the word [`MAGIC`]: `GBTP`.
pub const MAGIC_VALUE: u32 = u32::from_le_bytes(*b"GBTP");
/// Value of the word [`VERSION`].
pub const VERSION_VALUE: u32 = 6;

/// Byte offset of a word that the board writes: boots since the memory was zero.
pub const BOOTS: usize = 0x010;
/// Byte offset of a word that the board writes: cause of the board's start, one of `RESET_*`.
pub const RESET_CAUSE: usize = 0x014;
/// Byte offset of a word that the board writes: [`STEP_WRITE_INDEX`] when this boot began.
pub const BOOT_WRITE_INDEX: usize = 0x018;
/// Byte offset of a word that the board writes: times the watchdog was fed in this boot.
pub const WATCHDOG_FEEDS: usize = 0x01C;
/// Byte offset of a word that the board writes: low half of the board's clock, in ticks of [`TICK_HZ`].
pub const TICKS_LO: usize = 0x020;
/// Byte offset of a word that the board writes: high half of the board's clock, in ticks of [`TICK_HZ`].
pub const TICKS_HI: usize = 0x024;
/// Byte offset of a word that the board writes: ticks of the board's clock in a second.
pub const TICK_HZ: usize = 0x028;
/// Byte offset of a word that the board writes: heater duty, 0 to 65535. Heats only while [`HEATER_ENABLE`] is 1.
pub const HEATER_DUTY: usize = 0x030;
/// Byte offset of a word that the board writes: 1 while the heater's second switch is closed.
pub const HEATER_ENABLE: usize = 0x034;
/// Byte offset of a word that the board writes: 1 while the head's driver is energised.
pub const HEAD_ENABLE: usize = 0x038;
/// Byte offset of a word that the board writes: 1 while the feed's driver is energised.
pub const FEED_ENABLE: usize = 0x03C;
/// Byte offset of a word that the board writes: steps the head has turned, as an `i32`.
pub const HEAD_STEPS: usize = 0x040;
/// Byte offset of a word that the board writes: steps the feed has turned, as an `i32`.
pub const FEED_STEPS: usize = 0x044;
/// Byte offset of a word that the board writes: low half of the sum of the heater's duty over the ticks with the heater
/// on. The energy between two reads is the difference of the sums, at any rate of reading.
pub const HEATER_ENERGY_LO: usize = 0x048;
/// Byte offset of a word that the board writes: high half of the sum of [`HEATER_ENERGY_LO`].
pub const HEATER_ENERGY_HI: usize = 0x04C;
/// Byte offset of a word that the board writes: number of step records written, wrapping.
pub const STEP_WRITE_INDEX: usize = 0x050;
/// Byte offset of a word that the board writes: step records dropped in this boot because the host read too slowly.
pub const STEP_OVERRUN: usize = 0x054;
/// Byte offset of a word that the board writes: received bytes dropped in this boot.
pub const LINK_BYTES_LOST: usize = 0x058;
/// Byte offset of a word that the board writes: bytes of the stack that were never used in this boot; 0 until they are
/// counted.
pub const STACK_UNUSED: usize = 0x05C;
/// Byte offset of a word that the board writes: duty of the fan, 0 to 65535.
pub const FAN_DUTY: usize = 0x060;

/// Byte offset of a word that the host writes: thermistor reading, 0 to 4095.
pub const THERMISTOR_RAW: usize = 0x100;
/// Byte offset of a word that the host writes: 1 while the thermistor's ADC delivers readings.
pub const THERMISTOR_LIVE: usize = 0x104;
/// Byte offset of a word that the host writes: number of step records read, wrapping.
pub const STEP_READ_INDEX: usize = 0x108;
/// Byte offset of a word that the host writes: head steps in a turn; 0 for no index mark.
pub const INDEX_STEPS_PER_TURN: usize = 0x110;
/// Byte offset of a word that the host writes: the head step at which the mark begins.
pub const INDEX_POSITION: usize = 0x114;
/// Byte offset of a word that the host writes: width of the mark in head steps.
pub const INDEX_WIDTH: usize = 0x118;
/// Byte offset of a word that the host writes: a broken index sensor, one of `INDEX_FAULT_*`.
pub const INDEX_FAULT: usize = 0x11C;
/// Byte offset of a word that the host writes: a number that differs from run to run.
pub const ENTROPY: usize = 0x120;
/// Byte offset of a word that the host writes: length of the robot description in bytes; 0 for none.
pub const ROBOT_LENGTH: usize = 0x124;
/// Byte offset of a word that the host writes: reading of the supply's voltage, 0 to 4095.
pub const SUPPLY_RAW: usize = 0x128;
/// Byte offset of a word that the host writes: 1 while the supply's ADC delivers readings.
pub const SUPPLY_LIVE: usize = 0x12C;
/// Byte offset of a word that the host writes: 1 while there is filament.
pub const FILAMENT_PRESENT: usize = 0x130;
/// Byte offset of a word that the host writes: 1 while a stepper driver reports a fault.
pub const DRIVER_FAULT: usize = 0x134;
/// Byte offset of a word that the host writes: 1 while the emergency stop is pressed.
pub const EMERGENCY_STOP: usize = 0x138;
/// Byte offset of a word that the host writes: feed steps between two rising edges of the filament's encoder, in 1/256
/// steps; 0 for no encoder.
pub const ENCODER_PITCH: usize = 0x13C;
/// Byte offset of a word that the host writes: whether filament follows the feed, one of `ENCODER_*`.
pub const ENCODER_STATE: usize = 0x140;
/// Byte offset of a word that the host writes: gravity along the tip's x axis, thousandths of the earth's, as an `i32`;
/// upwards, as a resting accelerometer shows it.
pub const GRAVITY_X: usize = 0x144;
/// Byte offset of a word that the host writes: gravity along the tip's y axis, in the form of [`GRAVITY_X`].
pub const GRAVITY_Y: usize = 0x148;
/// Byte offset of a word that the host writes: gravity along the tip's z axis, in the form of [`GRAVITY_X`].
pub const GRAVITY_Z: usize = 0x14C;
/// Byte offset of a word that the host writes: 1 while the orientation sensor answers.
pub const GRAVITY_LIVE: usize = 0x150;
/// Byte offset of a word that the host writes: 1 to make the board overflow its stack.
pub const OVERFLOW_STACK: usize = 0x154;
/// Byte offset of a word that the host writes: odd while the host changes [`ENCODER_ORIGIN`], [`ENCODER_PHASE`] and
/// [`ENCODER_SLIP`].
pub const ENCODER_SEQUENCE: usize = 0x158;
/// Byte offset of a word that the host writes: position of the feed, as in [`FEED_STEPS`], from which the encoder
/// continues, as an `i32`.
pub const ENCODER_ORIGIN: usize = 0x15C;
/// Byte offset of a word that the host writes: angle of the encoder at [`ENCODER_ORIGIN`], in 1/256 feed steps, below
/// [`ENCODER_PITCH`].
pub const ENCODER_PHASE: usize = 0x160;
/// Byte offset of a word that the host writes: filament that each feed step from [`ENCODER_ORIGIN`] on moves in
/// addition to the length of a step, in 1/65536 of a step, as an `i32`.
pub const ENCODER_SLIP: usize = 0x164;
/// Byte offset of a word that the host writes: the way in which the board must crash, one of `CRASH_*`; 0 for no crash.
pub const CRASH: usize = 0x168;
/// Byte offset of a word that the host writes: 1 to make the board's main loop hang while its watchdog is fed.
pub const HANG: usize = 0x16C;
/// Byte offset of the bytes that the host writes: the robot description.
pub const ROBOT: usize = 0x1000;
/// Max length of the robot description, bytes.
pub const ROBOT_CAPACITY: usize = 0x1000;

/// Byte offset of the bytes that the board writes: the flash of the board's journal.
pub const JOURNAL_FLASH: usize = 0x2_0000;
/// Length of a sector of the emulated flash, bytes. A sector is erased as a unit, and is as large as on the robot's
/// board.
pub const FLASH_SECTOR_BYTES: usize = 0x2_0000;
/// Length of the journal's flash, bytes. The flash of the robot's description has the same length.
pub const FLASH_AREA_BYTES: usize = 2 * FLASH_SECTOR_BYTES;
/// Byte offset of the bytes that the board writes: the flash of the robot's description. It has the same number of
/// sectors and bytes as the journal's flash.
pub const DESCRIPTION_FLASH: usize = 0x8_0000;

/// Byte offset of the words that the board writes at each tick, after [`TICKS_LO`] and [`TICKS_HI`]: the board writes
/// the low half of the tick's number into the word with the index `tick % ALARM_WORDS`. A debugger that watches one
/// word stops the board at one tick.
pub const ALARMS: usize = 0xC_0000;
/// Number of words of [`ALARMS`], a power of two.
pub const ALARM_WORDS: u32 = 1024;

/// Byte offset of the ring buffer of step records, which the board writes. Record `i` is at `STEP_RING + 4 * (i %
/// STEP_RING_RECORDS)`.
pub const STEP_RING: usize = 0x10_0000;
/// Number of step records in the ring buffer, a power of two. They suffice for over four minutes at one step a tick and
/// 4 kHz.
pub const STEP_RING_RECORDS: u32 = 1 << 20;

/// Value of the word [`CRASH`]: the board executes an instruction that does not exist.
pub const CRASH_BY_INSTRUCTION: u32 = 1;
/// Value of [`CRASH`]: the board reads at [`NOWHERE`], where it has no memory.
pub const CRASH_BY_ACCESS: u32 = 2;
/// Value of [`CRASH`]: the board hangs until the watchdog expires.
pub const CRASH_BY_HANGING: u32 = 3;
/// Address at which the emulated board has no memory.
pub const NOWHERE: usize = 0x2FFF_FFF0;

/// Value of [`RESET_CAUSE`]: the first start on this memory.
pub const RESET_POWER_ON: u32 = 1;
/// Value of [`RESET_CAUSE`]: the watchdog was not fed.
pub const RESET_WATCHDOG: u32 = 2;
/// Value of [`RESET_CAUSE`]: the processor faulted.
pub const RESET_FAULT: u32 = 4;
/// Value of [`RESET_CAUSE`]: reset from outside, by the emulator's monitor.
pub const RESET_EXTERNAL: u32 = 5;
/// Value of [`RESET_CAUSE`]: the stack of the firmware overflowed.
pub const RESET_STACK_OVERFLOW: u32 = 6;

/// Value of [`INDEX_FAULT`]: the sensor works.
pub const INDEX_FAULT_NONE: u32 = 0;
/// Value of [`INDEX_FAULT`]: the line stays low, as if always on the mark.
pub const INDEX_FAULT_STUCK_LOW: u32 = 1;
/// Value of [`INDEX_FAULT`]: the line stays high, as if never on the mark.
pub const INDEX_FAULT_STUCK_HIGH: u32 = 2;

/// Value of [`ENCODER_STATE`]: the filament moves with the feed.
pub const ENCODER_OK: u32 = 0;
/// Value of [`ENCODER_STATE`]: the filament does not move, with the encoder's line low.
pub const ENCODER_STUCK_LOW: u32 = 1;
/// Value of [`ENCODER_STATE`]: the filament does not move, with the encoder's line high.
pub const ENCODER_STUCK_HIGH: u32 = 2;

/// Returns the byte offset of the word of [`ALARMS`] that the board writes at a tick.
pub const fn alarm_offset(tick: u32) -> usize {
    ALARMS + 4 * (tick % ALARM_WORDS) as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn register_addresses_do_not_overlap() {
        let words = [
            MAGIC,
            VERSION,
            BOOTS,
            RESET_CAUSE,
            BOOT_WRITE_INDEX,
            WATCHDOG_FEEDS,
            TICKS_LO,
            TICKS_HI,
            TICK_HZ,
            HEATER_DUTY,
            HEATER_ENABLE,
            HEAD_ENABLE,
            FEED_ENABLE,
            HEAD_STEPS,
            FEED_STEPS,
            HEATER_ENERGY_LO,
            HEATER_ENERGY_HI,
            STEP_WRITE_INDEX,
            STEP_OVERRUN,
            LINK_BYTES_LOST,
            STACK_UNUSED,
            FAN_DUTY,
            THERMISTOR_RAW,
            THERMISTOR_LIVE,
            STEP_READ_INDEX,
            INDEX_STEPS_PER_TURN,
            INDEX_POSITION,
            INDEX_WIDTH,
            INDEX_FAULT,
            ENTROPY,
            ROBOT_LENGTH,
            SUPPLY_RAW,
            SUPPLY_LIVE,
            FILAMENT_PRESENT,
            DRIVER_FAULT,
            EMERGENCY_STOP,
            ENCODER_PITCH,
            ENCODER_STATE,
            GRAVITY_X,
            GRAVITY_Y,
            GRAVITY_Z,
            GRAVITY_LIVE,
            OVERFLOW_STACK,
            ENCODER_SEQUENCE,
            ENCODER_ORIGIN,
            ENCODER_PHASE,
            ENCODER_SLIP,
            CRASH,
            HANG,
            ROBOT,
            JOURNAL_FLASH,
            DESCRIPTION_FLASH,
        ];
        assert!(words.windows(2).all(|pair| pair[0] + 4 <= pair[1]));
        assert!(words.iter().all(|offset| offset % 4 == 0));
        const { assert!(ROBOT + ROBOT_CAPACITY <= JOURNAL_FLASH && JOURNAL_FLASH + FLASH_AREA_BYTES <= DESCRIPTION_FLASH) };
        const { assert!(DESCRIPTION_FLASH + FLASH_AREA_BYTES <= ALARMS) };
        const { assert!(ALARMS + 4 * ALARM_WORDS as usize <= STEP_RING) };
    }
}
