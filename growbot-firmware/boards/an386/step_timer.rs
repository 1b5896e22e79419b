//! The step interrupt of the emulated board: TIMER0, and the board's clock, which counts its ticks.

use core::sync::atomic::{AtomicU32, Ordering};

use growbot_firmware::invertible_pin::InvertiblePin;
use growbot_firmware::stepping::Engine;

use crate::interrupt_cell::InterruptCell;
use crate::mailbox::MAILBOX;
use crate::registers::Register;
use crate::tip::{
    self, EmulatedOutputs, FilamentEncoder, Flag, IndexSensor, RecordedDirectionPin, RecordedStepPin, Switch,
};

const BASE: usize = 0x4000_0000;
// SAFETY: the registers of TIMER0, which only this file uses.
const CONTROL: Register = unsafe { Register::at(BASE) };
// SAFETY: as above.
const VALUE: Register = unsafe { Register::at(BASE + 0x04) };
// SAFETY: as above.
const RELOAD: Register = unsafe { Register::at(BASE + 0x08) };
// SAFETY: as above.
const INTERRUPT_CLEAR: Register = unsafe { Register::at(BASE + 0x0C) };

const CONTROL_ENABLE: u32 = 1 << 0;
const CONTROL_INTERRUPT: u32 = 1 << 3;

/// The step engine with the pins of the emulated board.
pub type StepEngine = Engine<
    RecordedStepPin,
    RecordedDirectionPin,
    Switch,
    RecordedStepPin,
    RecordedDirectionPin,
    Switch,
    InvertiblePin<IndexSensor>,
    FilamentEncoder,
    Flag,
    EmulatedOutputs,
>;

static ENGINE: InterruptCell<StepEngine> = InterruptCell::empty();

static TICKS_LO: AtomicU32 = AtomicU32::new(0);
static TICKS_HI: AtomicU32 = AtomicU32::new(0);

static TICK_HZ: AtomicU32 = AtomicU32::new(1);

/// Starts the timer of the step interrupt. The ticks begin once the interrupts are enabled.
/// [`growbot_core::robot::Robot::check_for_board`] has checked the rate.
pub fn start(engine: StepEngine, tick_hz: u32, clock_hz: u32) {
    ENGINE.init(engine);
    TICK_HZ.store(tick_hz, Ordering::Relaxed);
    tip::set_tick_hz(tick_hz);
    let reload = (clock_hz / tick_hz.max(1)).saturating_sub(1);
    RELOAD.write(reload);
    VALUE.write(reload);
    CONTROL.write(CONTROL_ENABLE | CONTROL_INTERRUPT);
}

/// Handles the step interrupt: counts a tick and runs the step engine.
pub fn on_tick() {
    INTERRUPT_CLEAR.write(1);
    let low = TICKS_LO.load(Ordering::Relaxed).wrapping_add(1);
    let high = TICKS_HI.load(Ordering::Relaxed).wrapping_add(u32::from(low == 0));
    // The high word is stored before the low one. `ticks` reads both in the reverse order and so detects a carry.
    TICKS_HI.store(high, Ordering::Release);
    TICKS_LO.store(low, Ordering::Release);
    tip::publish_tick(low, high);
    // SAFETY: only the step interrupt calls this.
    unsafe { ENGINE.with(|engine| engine.tick(&MAILBOX)) };
}

/// Returns the number of step ticks since the board started.
fn ticks() -> u64 {
    loop {
        let high = TICKS_HI.load(Ordering::Acquire);
        let low = TICKS_LO.load(Ordering::Acquire);
        if high == TICKS_HI.load(Ordering::Acquire) {
            return u64::from(high) << 32 | u64::from(low);
        }
    }
}

/// Returns the time since the board started, us. It is computed from the count of step ticks, so that an emulator that
/// falls behind slows down steps and time alike.
pub fn now_us() -> u64 {
    microseconds(ticks(), TICK_HZ.load(Ordering::Relaxed))
}

/// Converts step ticks to microseconds. Whole seconds are computed separately, so that nothing overflows in the life of
/// a board.
fn microseconds(ticks: u64, tick_hz: u32) -> u64 {
    let hz = u64::from(tick_hz.max(1));
    (ticks / hz) * 1_000_000 + (ticks % hz) * 1_000_000 / hz
}
