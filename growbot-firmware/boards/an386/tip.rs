//! Drivers of the emulated tip's pins and sensors, which are words of the shared memory
//! (`growbot_firmware::emulated_tip`).

use core::convert::Infallible;
use core::sync::atomic::{Ordering, fence};

use embedded_hal::digital::{ErrorType, InputPin, OutputPin};
use embedded_hal::pwm::{self, SetDutyCycle};
use growbot_firmware::emulated_tip::{self as table, EncoderMapping, RecordedMotor, StepRecord};
use growbot_firmware::hal::{Adc, GravitySensor, Outputs};

use crate::registers::Register;

/// Returns the word at a byte offset of the shared memory. An offset outside of the memory is mapped to a word inside.
pub fn word(offset: usize) -> Register {
    let inside = offset & (table::SIZE - 4);
    // SAFETY: aligned and inside the expansion RAM. No linker region covers it, so that Rust code owns nothing there.
    unsafe { Register::at(table::ADDRESS + inside) }
}

fn count(offset: usize) {
    word(offset).write(word(offset).read().wrapping_add(1));
}

/// Kind of a boot, as the shared memory shows it.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Boot {
    /// The first boot on this memory.
    Cold,
    /// A boot after a reset.
    Warm,
}

/// All outputs and inputs of the emulated tip, each once.
pub struct TipPins {
    /// STEP pin of the head's driver.
    pub head_step: RecordedStepPin,
    /// DIR pin of the head's driver.
    pub head_direction: RecordedDirectionPin,
    /// Enable pin of the head's driver. High energises the motor.
    pub head_enable: Switch,
    /// STEP pin of the feed's driver.
    pub feed_step: RecordedStepPin,
    /// DIR pin of the feed's driver.
    pub feed_direction: RecordedDirectionPin,
    /// Enable pin of the feed's driver. High energises the motor.
    pub feed_enable: Switch,
    /// Duty of the heater's power stage.
    pub heater: Power,
    /// Second switch, in series with the heater's power stage. High closes it.
    pub heater_enable: Switch,
    /// ADC channel of the nozzle's thermistor.
    pub thermistor: TipAdc,
    /// Input of the index sensor. Low while the head is on the index mark.
    pub index: IndexSensor,
    /// Duty of the fan that cools the print.
    pub fan: Power,
    /// ADC channel of the supply voltage.
    pub supply: TipAdc,
    /// Input that is high while filament is present.
    pub filament_presence: Flag,
    /// Input of the filament's encoder. It rises once for each encoder pitch of filament.
    pub filament_motion: FilamentEncoder,
    /// Input that is high while a stepper driver reports a fault.
    pub driver_fault: Flag,
    /// Input that is high while the emergency stop is pressed.
    pub emergency_stop: Flag,
    /// Orientation sensor of the tip.
    pub orientation: OrientationSensor,
}

impl TipPins {
    /// Writes the board's words of the shared memory for a new boot, with all outputs off, and returns the pins. Call
    /// it once.
    ///
    /// `cause` returns the cause of the board's start.
    pub fn start(cause: impl FnOnce(Boot) -> u32) -> Self {
        let is_written =
            word(table::MAGIC).read() == table::MAGIC_VALUE && word(table::VERSION).read() == table::VERSION_VALUE;
        let boot = if is_written { Boot::Warm } else { Boot::Cold };
        make_safe();
        if boot == Boot::Cold {
            for survivor in [table::BOOTS, table::HEAD_STEPS, table::FEED_STEPS, table::STEP_WRITE_INDEX] {
                word(survivor).write(0);
            }
        }
        for fresh in [
            table::WATCHDOG_FEEDS,
            table::TICKS_LO,
            table::TICKS_HI,
            table::HEATER_ENERGY_LO,
            table::HEATER_ENERGY_HI,
            table::STEP_OVERRUN,
            table::LINK_BYTES_LOST,
            table::STACK_UNUSED,
        ] {
            word(fresh).write(0);
        }
        word(table::RESET_CAUSE).write(cause(boot));
        word(table::BOOT_WRITE_INDEX).write(word(table::STEP_WRITE_INDEX).read());
        word(table::VERSION).write(table::VERSION_VALUE);
        word(table::MAGIC).write(table::MAGIC_VALUE);
        fence(Ordering::Release);
        count(table::BOOTS);

        TipPins {
            head_step: RecordedStepPin { axis: RecordedMotor::Head, high: false },
            head_direction: RecordedDirectionPin { axis: RecordedMotor::Head },
            head_enable: Switch { offset: table::HEAD_ENABLE },
            feed_step: RecordedStepPin { axis: RecordedMotor::Feed, high: false },
            feed_direction: RecordedDirectionPin { axis: RecordedMotor::Feed },
            feed_enable: Switch { offset: table::FEED_ENABLE },
            heater: Power { offset: table::HEATER_DUTY },
            heater_enable: Switch { offset: table::HEATER_ENABLE },
            thermistor: TipAdc { raw: table::THERMISTOR_RAW, live: table::THERMISTOR_LIVE },
            index: IndexSensor(()),
            fan: Power { offset: table::FAN_DUTY },
            supply: TipAdc { raw: table::SUPPLY_RAW, live: table::SUPPLY_LIVE },
            filament_presence: Flag { offset: table::FILAMENT_PRESENT },
            filament_motion: FilamentEncoder { mapping: EncoderMapping::default() },
            driver_fault: Flag { offset: table::DRIVER_FAULT },
            emergency_stop: Flag { offset: table::EMERGENCY_STOP },
            orientation: OrientationSensor(()),
        }
    }
}

/// All outputs of the tip (heater, fan and both stepper drivers), which the step interrupt switches off in an
/// emergency.
pub struct EmulatedOutputs;

impl Outputs for EmulatedOutputs {
    fn make_safe(&mut self) {
        make_safe();
    }
}

/// Switches heater, fan and both stepper drivers off at once, from any context.
pub fn make_safe() {
    for output in [table::HEATER_ENABLE, table::HEATER_DUTY, table::HEAD_ENABLE, table::FEED_ENABLE, table::FAN_DUTY] {
        word(output).write(0);
    }
}

/// Returns the cause of this boot, a `RESET_*` of `emulated_tip`, from the shared memory.
pub fn reset_cause() -> u32 {
    word(table::RESET_CAUSE).read()
}

/// Returns an identifier of this boot. It differs from that of all earlier boots, if the host writes a different
/// [`table::ENTROPY`] in each run.
pub fn boot_id() -> u32 {
    // An odd factor spreads the small boot counter over all bits and keeps it one-to-one.
    word(table::ENTROPY).read() ^ word(table::BOOTS).read().wrapping_mul(0x9E37_79B1)
}

/// Copies the robot description that the host has written into `into`, and returns its length in bytes. Returns 0 if
/// the host has written none, or one that does not fit.
pub fn copy_robot_description(into: &mut [u8]) -> usize {
    let length = word(table::ROBOT_LENGTH).read() as usize;
    if length > table::ROBOT_CAPACITY || length > into.len() {
        return 0;
    }
    for (index, bytes) in into[..length].chunks_mut(4).enumerate() {
        let word = word(table::ROBOT + 4 * index).read().to_le_bytes();
        for (byte, from) in bytes.iter_mut().zip(word) {
            *byte = from;
        }
    }
    length
}

/// Publishes the tick rate, Hz, for the host.
pub fn set_tick_hz(tick_hz: u32) {
    word(table::TICK_HZ).write(tick_hz);
}

/// Publishes the count of ticks for the host, and adds the heater's energy of the past tick. The step interrupt calls
/// this.
pub fn publish_tick(low: u32, high: u32) {
    if low == 0 {
        word(table::TICKS_HI).write(high);
    }
    word(table::TICKS_LO).write(low);
    if word(table::HEATER_ENABLE).read() == 1 {
        let before = word(table::HEATER_ENERGY_LO).read();
        let after = before.wrapping_add(word(table::HEATER_DUTY).read());
        if after < before {
            count(table::HEATER_ENERGY_HI);
        }
        word(table::HEATER_ENERGY_LO).write(after);
    }
    // Last, because the host may stop the board here.
    word(table::alarm_offset(low)).write(low);
}

/// Counts a feed of the watchdog in the shared memory.
pub fn count_feed() {
    count(table::WATCHDOG_FEEDS);
}

/// Counts, in the shared memory, a received byte that was lost because the queue was full.
pub fn count_lost_byte() {
    count(table::LINK_BYTES_LOST);
}

/// Returns whether the host requests that the board's main loop hang, as a test.
pub fn wants_hang() -> bool {
    word(table::HANG).read() == 1
}

/// Publishes for the host the number of bytes of the stack that were never used.
pub fn publish_unused_stack(bytes: u32) {
    word(table::STACK_UNUSED).write(bytes);
}

/// Returns whether the host requests that the board overflow its stack, as a test.
pub fn wants_overflow() -> bool {
    word(table::OVERFLOW_STACK).read() == 1
}

/// Returns the kind of crash that the host requests as a test, one of `CRASH_*`; 0 for none.
pub fn wanted_crash() -> u32 {
    word(table::CRASH).read()
}

const fn enable_of(axis: RecordedMotor) -> usize {
    match axis {
        RecordedMotor::Head => table::HEAD_ENABLE,
        RecordedMotor::Feed => table::FEED_ENABLE,
    }
}

const fn steps_of(axis: RecordedMotor) -> usize {
    match axis {
        RecordedMotor::Head => table::HEAD_STEPS,
        RecordedMotor::Feed => table::FEED_STEPS,
    }
}

/// Levels of the DIR pins. They are not in the shared memory, because the host reads the direction from each step.
static FORWARD: [core::sync::atomic::AtomicBool; 2] = [const { core::sync::atomic::AtomicBool::new(false) }; 2];

const fn wire_of(axis: RecordedMotor) -> &'static core::sync::atomic::AtomicBool {
    let [head, feed] = &FORWARD;
    match axis {
        RecordedMotor::Head => head,
        RecordedMotor::Feed => feed,
    }
}

/// DIR pin of a stepper driver. Its level is stored in each step record.
pub struct RecordedDirectionPin {
    axis: RecordedMotor,
}

impl ErrorType for RecordedDirectionPin {
    type Error = Infallible;
}

impl OutputPin for RecordedDirectionPin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        wire_of(self.axis).store(false, Ordering::Relaxed);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        wire_of(self.axis).store(true, Ordering::Relaxed);
        Ok(())
    }
}

/// STEP pin of a stepper driver. Each rising edge is stored as a step record in the shared memory. Only the step
/// interrupt drives the two STEP pins, because they share the write index of the ring buffer.
pub struct RecordedStepPin {
    axis: RecordedMotor,
    high: bool,
}

impl ErrorType for RecordedStepPin {
    type Error = Infallible;
}

impl OutputPin for RecordedStepPin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.high = false;
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        if !self.high {
            self.high = true;
            rising_edge(self.axis);
        }
        Ok(())
    }
}

fn rising_edge(axis: RecordedMotor) {
    let forward = wire_of(axis).load(Ordering::Relaxed);
    let enabled = word(enable_of(axis)).read() == 1;
    if enabled {
        let steps = word(steps_of(axis));
        let change = if forward { 1 } else { u32::MAX };
        steps.write(steps.read().wrapping_add(change));
    }

    let index = word(table::STEP_WRITE_INDEX).read();
    let unread = index.wrapping_sub(word(table::STEP_READ_INDEX).read());
    if unread >= table::STEP_RING_RECORDS {
        count(table::STEP_OVERRUN);
        return;
    }
    let record = StepRecord { axis, forward, enabled, tick: word(table::TICKS_LO).read() };
    word(table::step_record_offset(index)).write(record.to_word());
    fence(Ordering::Release);
    word(table::STEP_WRITE_INDEX).write(index.wrapping_add(1));
}

/// Output pin that is a word of the shared memory: 0 for low, 1 for high.
pub struct Switch {
    offset: usize,
}

impl ErrorType for Switch {
    type Error = Infallible;
}

impl OutputPin for Switch {
    fn set_low(&mut self) -> Result<(), Infallible> {
        word(self.offset).write(0);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        word(self.offset).write(1);
        Ok(())
    }
}

/// Duty that is a word of the shared memory: that of the heater or of the fan, 0 to 65,535.
pub struct Power {
    offset: usize,
}

impl pwm::ErrorType for Power {
    type Error = Infallible;
}

impl SetDutyCycle for Power {
    fn max_duty_cycle(&self) -> u16 {
        u16::MAX
    }

    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        word(self.offset).write(u32::from(duty));
        Ok(())
    }
}

/// ADC channel that is two words of the shared memory: the thermistor's or the supply's.
pub struct TipAdc {
    raw: usize,
    live: usize,
}

impl Adc for TipAdc {
    fn sample(&mut self) -> Option<u16> {
        if word(self.live).read() != 1 {
            return None;
        }
        fence(Ordering::Acquire);
        Some((word(self.raw).read() & 0xFFF) as u16)
    }
}

/// Input pin that is a word of the shared memory: high if the word is 1.
pub struct Flag {
    offset: usize,
}

impl ErrorType for Flag {
    type Error = Infallible;
}

impl InputPin for Flag {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(word(self.offset).read() == 1)
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        self.is_high().map(|high| !high)
    }
}

/// Input of the filament's encoder, computed from the feed steps and the encoder's words of the shared memory.
pub struct FilamentEncoder {
    mapping: EncoderMapping,
}

impl FilamentEncoder {
    /// Reads the encoder's mapping from the shared memory. While the host is changing it, returns the mapping that was
    /// read before.
    fn look(&mut self) -> EncoderMapping {
        let sequence = word(table::ENCODER_SEQUENCE).read();
        let mapping = EncoderMapping {
            origin: word(table::ENCODER_ORIGIN).read().cast_signed(),
            phase: word(table::ENCODER_PHASE).read(),
            slip: word(table::ENCODER_SLIP).read().cast_signed(),
        };
        if sequence.is_multiple_of(2) && word(table::ENCODER_SEQUENCE).read() == sequence {
            self.mapping = mapping;
        }
        self.mapping
    }
}

impl ErrorType for FilamentEncoder {
    type Error = Infallible;
}

impl InputPin for FilamentEncoder {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(table::encoder_level(
            word(table::FEED_STEPS).read().cast_signed(),
            word(table::ENCODER_PITCH).read(),
            word(table::ENCODER_STATE).read(),
            self.look(),
        ))
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        self.is_high().map(|high| !high)
    }
}

/// Orientation sensor of the tip, whose readings are words of the shared memory.
pub struct OrientationSensor(());

impl GravitySensor for OrientationSensor {
    fn gravity(&mut self) -> Option<[i16; 3]> {
        if word(table::GRAVITY_LIVE).read() != 1 {
            return None;
        }
        let [x, y, z] = [table::GRAVITY_X, table::GRAVITY_Y, table::GRAVITY_Z].map(|offset| word(offset).read() as i16);
        Some([x, y, z])
    }
}

/// Index sensor of the head, computed from the head steps. Its level is low on the index mark.
pub struct IndexSensor(());

impl ErrorType for IndexSensor {
    type Error = Infallible;
}

impl IndexSensor {
    fn level(&self) -> bool {
        table::index_level(
            word(table::HEAD_STEPS).read().cast_signed(),
            word(table::INDEX_STEPS_PER_TURN).read(),
            word(table::INDEX_POSITION).read(),
            word(table::INDEX_WIDTH).read(),
            word(table::INDEX_FAULT).read(),
        )
    }
}

impl InputPin for IndexSensor {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(self.level())
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(!self.level())
    }
}
