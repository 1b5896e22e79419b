//! Simulated pins, and the head and the filament behind them. An access costs as much as on the robot: a store or a
//! load, and the inversion of the level.

use core::convert::Infallible;
use core::sync::atomic::{AtomicBool, Ordering};

use embedded_hal::digital::{ErrorType, InputPin, OutputPin, PinState};
use growbot_core::robot::Robot;
use growbot_firmware::hal::Outputs;
use growbot_firmware::invertible_pin::InvertiblePin;
use growbot_firmware::stepping::{Engine, EngineConfig, EngineInputs, Mailbox, StepperPins};

static HEAD_STEP: AtomicBool = AtomicBool::new(false);
static HEAD_DIRECTION: AtomicBool = AtomicBool::new(false);
static HEAD_ENABLE: AtomicBool = AtomicBool::new(false);
static FEED_STEP: AtomicBool = AtomicBool::new(false);
static FEED_DIRECTION: AtomicBool = AtomicBool::new(false);
static FEED_ENABLE: AtomicBool = AtomicBool::new(false);
static INDEX: AtomicBool = AtomicBool::new(false);
static FILAMENT: AtomicBool = AtomicBool::new(false);
static STOP: AtomicBool = AtomicBool::new(false);

/// A simulated pin.
pub struct Pin(&'static AtomicBool);

impl ErrorType for Pin {
    type Error = Infallible;
}

impl OutputPin for Pin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.0.store(false, Ordering::Relaxed);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.0.store(true, Ordering::Relaxed);
        Ok(())
    }
}

impl InputPin for Pin {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(self.0.load(Ordering::Relaxed))
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        self.is_high().map(|high| !high)
    }
}

type WiredPin = InvertiblePin<Pin>;

/// The step engine with pins that may be inverted where the robot's may be.
pub type BenchmarkEngine =
    Engine<Pin, WiredPin, WiredPin, Pin, WiredPin, WiredPin, WiredPin, Pin, WiredPin, BenchmarkOutputs>;

fn wired(pin: &'static AtomicBool) -> WiredPin {
    InvertiblePin::new(Pin(pin), PinState::High)
}

/// Creates a step engine with the simulated pins.
pub fn engine(settings: EngineConfig) -> BenchmarkEngine {
    STOP.store(false, Ordering::Relaxed);
    Engine::new(
        StepperPins { step: Pin(&HEAD_STEP), direction: wired(&HEAD_DIRECTION), enable: wired(&HEAD_ENABLE) },
        StepperPins { step: Pin(&FEED_STEP), direction: wired(&FEED_DIRECTION), enable: wired(&FEED_ENABLE) },
        EngineInputs { index: wired(&INDEX), filament_motion: Pin(&FILAMENT), emergency_stop: wired(&STOP) },
        BenchmarkOutputs,
        settings,
    )
}

/// All outputs of the tip (heater, fan and both stepper drivers). Switching them off takes five stores, as on the
/// robot's board.
pub struct BenchmarkOutputs;

impl Outputs for BenchmarkOutputs {
    fn make_safe(&mut self) {
        crate::tip::make_safe();
    }
}

/// Presses or releases the simulated emergency stop.
pub fn press_emergency_stop(pressed: bool) {
    STOP.store(pressed, Ordering::Relaxed);
}

/// Runs one tick of the step engine, as the step interrupt does.
#[inline(never)]
pub fn tick(engine: &mut BenchmarkEngine, handover: &Mailbox) {
    engine.tick(handover);
}

/// Simulated head with its index mark, and filament with its encoder.
pub struct World {
    steps_per_turn: u32,
    mark: u32,
    mark_width: u32,
    /// Position of the head within a turn, in head steps.
    head: u32,
    fed: u32,
}

impl World {
    /// Creates the simulated hardware of a robot, with its head a little before its index mark.
    pub fn of(robot: &Robot) -> Self {
        let head = &robot.description().head;
        let steps = |degrees: f64| libm::rint(degrees / 360.0 * f64::from(head.steps_per_turn)) as i32;
        let turn = head.steps_per_turn;
        let mark = steps(head.index_angle_deg).rem_euclid(turn.max(1) as i32) as u32;
        Self {
            steps_per_turn: turn,
            mark,
            mark_width: steps(head.index_width_deg) as u32,
            head: mark - mark / 8,
            fed: 0,
        }
    }

    /// Returns the number of head steps from the mark's leading edge to the tip's x axis.
    pub fn steps_from_mark_to_zero(&self) -> u32 {
        self.steps_per_turn - self.mark
    }

    /// Reads the step pins after a tick, and moves head and filament. Returns whether the head and the feed have made a
    /// step.
    pub fn watch(&mut self) -> (bool, bool) {
        let (head, feed) = (HEAD_STEP.load(Ordering::Relaxed), FEED_STEP.load(Ordering::Relaxed));
        if head {
            let last = self.steps_per_turn - 1;
            self.head = match (HEAD_DIRECTION.load(Ordering::Relaxed), self.head) {
                (true, at) if at == last => 0,
                (true, at) => at + 1,
                (false, 0) => last,
                (false, at) => at - 1,
            };
        }
        self.fed += u32::from(feed);
        INDEX.store((self.mark..self.mark + self.mark_width).contains(&self.head), Ordering::Relaxed);
        FILAMENT.store(self.fed & 32 != 0, Ordering::Relaxed);
        (head, feed)
    }
}
