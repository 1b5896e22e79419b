//! Simulation of the tip for tests: a nozzle that warms and cools, a thermistor that can break, a head with an index
//! mark.

use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::vec::Vec;

use growbot_core::link::message::{DriverReport, ImageCheck};
use growbot_core::robot::Robot;

use crate::hal;
use crate::journal::Journal;
use crate::safety::retained::{COPY_BYTES, RETAINED_BYTES};
use crate::testing::flash::Flash;
use crate::testing::{FakePins, FakePower};
use crate::thermistor::{FULL_SCALE, raw_from_celsius};

/// Number of the head's step pin in [`FakePins`]. Its direction and enable pins follow. The next constants are the
/// numbers of the feed's step pin, the index sensor, the heater's second switch, and the inputs.
pub const HEAD: usize = 0;
pub const FEED: usize = 3;
pub const INDEX: usize = 6;
pub const HEATER_ENABLE: usize = 7;
pub const FILAMENT_PRESENCE: usize = 8;
pub const FILAMENT_MOTION: usize = 9;
pub const DRIVER_FAULT: usize = 10;
pub const EMERGENCY_STOP: usize = 11;
/// Temperature of the surroundings, degrees Celsius.
const ROOM: f64 = 25.0;

/// State of the thermistor's wires.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Wire {
    Whole,
    Open,
    Shorted,
    /// The ADC of the thermistor delivers no readings.
    Silent,
}

/// The state of the simulated tip and board hardware, which the controller's drivers and the tests share. It survives a
/// reset of the board.
pub struct World {
    pub nozzle_c: Cell<f64>,
    pub wire: Cell<Wire>,
    /// Heat loss of the nozzle as a multiple of that in still air.
    pub draught: Cell<f64>,
    /// Time of the ADC's latest conversion, us.
    pub sampled_at: Cell<u64>,
    pub now: Cell<u64>,
    /// Voltage of the supply, V. `None` if its ADC has stopped.
    pub supply_v: Cell<Option<f64>>,
    /// Flash of the journal. It is erased and ready, as when a board is delivered.
    pub flash: Flash,
    /// Flash of the robot's description.
    pub descriptions: Flash,
    /// True if the board starts with a robot description.
    pub configured: Cell<bool>,
    /// Result of the image check at the board's next start.
    pub image: Cell<ImageCheck>,
    /// Content of the memory that survives a reset.
    pub retained: Cell<[u8; RETAINED_BYTES]>,
    /// All writes to the memory that survives a reset: the index of the copy, and its bytes.
    pub retained_writes: RefCell<Vec<(usize, [u8; COPY_BYTES])>>,
    /// True if a debug probe has enabled debugging.
    pub debugging: Cell<bool>,
    /// True if the stepper drivers are not configured.
    pub drivers_unconfigured: Cell<bool>,
    /// Problem that a stepper driver reports over its serial line.
    pub driver_problem: Cell<Option<DriverReport>>,
    /// True if the motors were in use at the latest poll of the stepper drivers.
    pub motors_in_use: Cell<bool>,
    /// True if the crystal does not start at the board's next start.
    pub without_crystal: Cell<bool>,
    robot: Robot,
}

/// Returns a flash with an empty journal that has room for a job.
fn prepared_flash() -> Flash {
    let flash = Flash::new(2);
    let mut journal = Journal::open(flash.clone());
    while journal.erase_step(journal.capacity()).expect("nothing is in the way") {}
    flash
}

impl World {
    pub fn new(robot: &Robot, nozzle_c: f64) -> Rc<Self> {
        Rc::new(Self {
            nozzle_c: Cell::new(nozzle_c),
            wire: Cell::new(Wire::Whole),
            draught: Cell::new(1.0),
            sampled_at: Cell::new(0),
            now: Cell::new(0),
            supply_v: Cell::new(Some(12.0)),
            flash: prepared_flash(),
            descriptions: Flash::new(2),
            configured: Cell::new(true),
            image: Cell::new(ImageCheck::Unsealed),
            retained: Cell::new([0; RETAINED_BYTES]),
            retained_writes: RefCell::default(),
            debugging: Cell::new(false),
            drivers_unconfigured: Cell::new(false),
            driver_problem: Cell::new(None),
            motors_in_use: Cell::new(false),
            without_crystal: Cell::new(false),
            robot: robot.clone(),
        })
    }

    /// Advances the nozzle's temperature by a time at this duty, with one heat capacity: `C dT/dt = P duty - k (T -
    /// room)`.
    pub fn heat(&self, duty: f64, seconds: f64) {
        let heater = &self.robot.description().heater;
        let loss = heater.loss_w_per_k * self.draught.get();
        let power = heater.power_w * duty - loss * (self.nozzle_c.get() - ROOM);
        self.nozzle_c.set(self.nozzle_c.get() + power / heater.heat_capacity_j_per_k * seconds);
    }
}

/// ADC channel of the simulated thermistor.
pub struct FakeThermistor(pub Rc<World>);

impl hal::Adc for FakeThermistor {
    fn sample(&mut self) -> Option<u16> {
        let thermistor = &self.0.robot.description().thermistor;
        let raw = match self.0.wire.get() {
            Wire::Whole => raw_from_celsius(self.0.nozzle_c.get(), thermistor).round() as u16,
            Wire::Open => FULL_SCALE,
            Wire::Shorted => 0,
            Wire::Silent => return None,
        };
        self.0.sampled_at.set(self.0.now.get());
        Some(raw)
    }
}

/// ADC channel of the simulated supply voltage.
pub struct FakeSupply(pub Rc<World>);

impl hal::Adc for FakeSupply {
    fn sample(&mut self) -> Option<u16> {
        let full_scale = self.0.robot.description().supply.full_scale_v;
        self.0.supply_v.get().map(|volts| (volts / full_scale * f64::from(FULL_SCALE)).round() as u16)
    }
}

/// Orientation sensor of a tip that points upwards.
pub struct FakeOrientation;

impl hal::GravitySensor for FakeOrientation {
    fn gravity(&mut self) -> Option<[i16; 3]> {
        Some([0, 0, 1000])
    }
}

/// Retained memory in [`World`], which is kept when the board restarts.
pub struct FakeRetained(pub Rc<World>);

impl hal::RetainedMemory for FakeRetained {
    fn read(&mut self) -> [u8; RETAINED_BYTES] {
        self.0.retained.get()
    }

    fn write(&mut self, copy: usize, bytes: &[u8; COPY_BYTES]) {
        let mut retained = self.0.retained.get();
        retained.as_chunks_mut::<COPY_BYTES>().0[copy] = *bytes;
        self.0.retained.set(retained);
        self.0.retained_writes.borrow_mut().push((copy, *bytes));
    }
}

/// Debug port whose state a test sets in [`World`].
pub struct FakeDebugPort(pub Rc<World>);

impl hal::DebugPort for FakeDebugPort {
    fn is_on(&self) -> bool {
        self.0.debugging.get()
    }
}

/// Stepper drivers whose state a test sets in [`World`].
pub struct FakeDrivers(pub Rc<World>);

impl hal::StepperDrivers for FakeDrivers {
    fn poll(&mut self, _now: u64, in_use: bool) {
        self.0.motors_in_use.set(in_use);
    }

    fn are_configured(&self) -> bool {
        !self.0.drivers_unconfigured.get()
    }

    fn problem(&self) -> Option<DriverReport> {
        self.0.driver_problem.get()
    }
}

/// Watchdog that only counts its feeds.
#[derive(Clone, Default)]
pub struct FakeWatchdog(pub Rc<RefCell<u32>>);

impl hal::Watchdog for FakeWatchdog {
    fn feed(&mut self) {
        *self.0.borrow_mut() += 1;
    }
}

/// Movement of head and feed, counted from the rising edges of their step pins.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Moved {
    /// Position of the head, in steps from the tip's x axis.
    pub head: i64,
    pub feed: i64,
    /// Number of rising edges of both step pins.
    pub pulses: u64,
}

/// The simulated motors, and the index sensor and filament encoder that they move.
#[derive(Clone)]
pub struct Motors {
    pub pins: FakePins,
    pub moved: Moved,
    before: [bool; 2],
    steps_per_turn: i64,
    mark: i64,
    mark_width: i64,
    /// True if the index sensor no longer detects the mark.
    pub index_dead: bool,
    /// Number of feed steps for one pulse of the filament's encoder.
    steps_per_pulse: f64,
    /// True if the feed turns but the filament stands still.
    pub jammed: bool,
    moved_filament: f64,
}

impl Motors {
    pub fn new(pins: FakePins, robot: &Robot, head: i64) -> Self {
        let turn = &robot.description().head;
        let steps = |degrees: f64| libm::rint(degrees / 360.0 * f64::from(turn.steps_per_turn)) as i64;
        let mut motors = Self {
            pins,
            moved: Moved { head, ..Moved::default() },
            before: [false; 2],
            steps_per_turn: i64::from(turn.steps_per_turn),
            mark: steps(turn.index_angle_deg),
            mark_width: steps(turn.index_width_deg),
            index_dead: false,
            steps_per_pulse: robot
                .description()
                .sensors
                .filament_motion
                .map_or(1e9, |motion| motion.mm_per_pulse * robot.description().feed.steps_per_mm),
            jammed: false,
            moved_filament: 0.0,
        };
        motors.show_index();
        motors
    }

    /// Reads the step pins after a tick and moves head and feed. Returns whether one of the step pins has risen.
    pub fn watch(&mut self) -> bool {
        let mut risen = false;
        for (axis, at) in [HEAD, FEED].into_iter().enumerate() {
            let level = self.pins.level(at);
            if level && !self.before[axis] {
                assert!(self.pins.level(at + 2), "a step of pin {at} that its driver does not make");
                risen = true;
                self.moved.pulses += 1;
                let step = if self.pins.level(at + 1) { 1 } else { -1 };
                match at {
                    HEAD => self.moved.head += step,
                    _ => self.moved.feed += step,
                }
                if at == FEED && !self.jammed {
                    self.moved_filament += step as f64;
                }
            }
            self.before[axis] = level;
        }
        self.show_index();
        risen
    }

    fn show_index(&mut self) {
        let beyond = (self.moved.head - self.mark).rem_euclid(self.steps_per_turn);
        self.pins.set(INDEX, beyond < self.mark_width && !self.index_dead);
        self.pins.set(FILAMENT_MOTION, (self.moved_filament / self.steps_per_pulse).rem_euclid(1.0) < 0.5);
    }

    pub fn enabled(&self) -> bool {
        self.pins.level(HEAD + 2) || self.pins.level(FEED + 2)
    }
}

/// All outputs of the tip (heater, fan and both stepper drivers), which the step interrupt switches off in an
/// emergency.
pub struct FakeOutputs {
    pub power: FakePower,
    pub fan: FakePower,
    pub pins: FakePins,
}

impl hal::Outputs for FakeOutputs {
    fn make_safe(&mut self) {
        self.power.set(0);
        self.fan.set(0);
        for pin in [HEATER_ENABLE, HEAD + 2, FEED + 2] {
            if self.pins.works(pin) {
                self.pins.set(pin, false);
            }
        }
    }
}

/// The heater's power stage and second switch.
pub struct HeaterWires {
    pub power: FakePower,
    pub pins: FakePins,
}

impl HeaterWires {
    /// Returns the share of the heater's full power that reaches the nozzle.
    pub fn share(&self) -> f64 {
        if self.pins.level(HEATER_ENABLE) { self.power.share() } else { 0.0 }
    }

    /// Returns whether both switches are open. A second switch whose pin is broken counts as open.
    pub fn off(&self) -> bool {
        self.power.share() == 0.0 && !(self.pins.level(HEATER_ENABLE) && self.pins.works(HEATER_ENABLE))
    }
}
