//! The step interrupt: the end of each period of a PWM slice that has no pin, so that every tick rate is exact to a
//! clock of the processor. The interrupt also detects a crystal that stops.

use growbot_core::robot::STEP_SLICE;
use growbot_firmware::stepping::Engine;
use rp2040_pac as pac;
use rp2040_pac::interrupt;

use crate::clock::{CrystalMonitor, PROCESSOR_HZ};
use crate::interrupt_cell::InterruptCell;
use crate::mailbox::MAILBOX;
use crate::{pins, reset};

/// Number of the PWM slice whose period is the step tick.
const SLICE: usize = STEP_SLICE as usize;
/// Max number of counts in a period of the PWM slice.
const MAX_COUNTS: u32 = 1 << 16;
const ENABLE: u32 = 1;

/// The step engine with the pins of this board.
pub type StepEngine = Engine<
    pins::Output,
    pins::Direction,
    pins::Enable,
    pins::Output,
    pins::Direction,
    pins::Enable,
    pins::Sensor,
    pins::Level,
    pins::Sensor,
    pins::PicoOutputs,
>;

/// The data that the step interrupt uses.
struct StepInterruptData {
    engine: StepEngine,
    crystal: CrystalMonitor,
}

static INTERRUPT_DATA: InterruptCell<StepInterruptData> = InterruptCell::empty();

/// Starts the timer of the step interrupt. The ticks begin once the interrupts are enabled.
/// [`growbot_core::robot::Robot::check_for_board`] has checked the rate.
pub fn start(engine: StepEngine, pwm: &pac::PWM, tick_hz: u32) {
    INTERRUPT_DATA.init(StepInterruptData { engine, crystal: CrystalMonitor::new() });
    let clocks = PROCESSOR_HZ / tick_hz.max(1);
    // The smallest whole divider, up to 255, with which a period fits.
    let divider = clocks.div_ceil(MAX_COUNTS).clamp(1, 255);
    let counts = (clocks / divider).clamp(1, MAX_COUNTS);
    let slice = pwm.ch(SLICE);
    // SAFETY: values within the registers' ranges.
    unsafe {
        slice.div().write(|w| w.bits(divider << 4));
        slice.top().write(|w| w.bits(counts - 1));
        pwm.inte().write(|w| w.bits(1 << SLICE));
        slice.csr().write(|w| w.bits(ENABLE));
    }
}

#[interrupt]
fn PWM_IRQ_WRAP() {
    // SAFETY: clears the flag of one slice, which only this interrupt does.
    unsafe { (*pac::PWM::ptr()).intr().write(|w| w.bits(1 << SLICE)) };
    // SAFETY: only the step interrupt calls this.
    unsafe {
        INTERRUPT_DATA.with(|data| {
            if data.crystal.has_stopped() {
                reset::reset_on_clock_failure();
            }
            data.engine.tick(&MAILBOX);
        });
    }
}
