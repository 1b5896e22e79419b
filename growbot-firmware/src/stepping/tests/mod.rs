//! Tests of layers from [`TurnPlanner`] through [`Engine`] to the pins, and the simulated hardware at the pins: motors,
//! an index mark, an encoder of the filament and an emergency stop. Conditions that must hold for every pulse are
//! asserted at every pulse.

mod laying;
mod mark;
mod ramps;
mod stopping;

use core::f64::consts::TAU;
use std::cell::{Cell, RefCell};
use std::convert::Infallible;
use std::rc::Rc;
use std::vec::Vec;

use embedded_hal::digital::{ErrorType, InputPin, OutputPin};
use growbot_core::layer::{Layer, SECTORS};
use growbot_core::layer_bytes::{HEIGHT_UNITS_PER_MM, LayerBytes, LayerEncoder, RawLayer, decode, decode_checked};
use growbot_core::robot::{FeedStrategy, HeadRotation, Robot, RobotDescription};

use super::*;
use crate::testing::{FakeOutputs, FakePins, robot_a};

const HEAD: usize = 0;
const FEED: usize = 1;

/// The behaviour of the simulated index sensor.
#[derive(Clone, Copy, PartialEq)]
enum Sensor {
    Whole,
    Dead,
    Stuck,
    /// The sensor inverts its level for a number of head steps, from this position of the head on.
    Disturbed {
        from: i64,
        steps: i64,
    },
}

/// A simulated motor and the levels of its driver's pins.
struct Motor {
    high: Cell<bool>,
    backwards: Cell<bool>,
    enabled: Cell<bool>,
    /// Number of steps made: forward minus reverse.
    moved: Cell<i64>,
    changed_at: Cell<u64>,
    direction_at: Cell<u64>,
}

/// A rising edge of a step pin.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Rise {
    tick: u64,
    motor: usize,
    backwards: bool,
}

/// The simulated hardware at the pins of the step engine.
struct World {
    now: Cell<u64>,
    motors: [Motor; 2],
    /// Rising edges of the step pins. `None` if they are not recorded.
    rises: RefCell<Option<Vec<Rise>>>,
    steps_per_turn: i64,
    mark: i64,
    mark_width: i64,
    /// Number of commanded steps that the head has not made.
    lost: Cell<i64>,
    sensor: Cell<Sensor>,
    pressed: Cell<bool>,
}

impl World {
    fn on_index(&self) -> bool {
        let place = self.motors[HEAD].moved.get() - self.lost.get();
        let on = (place - self.mark).rem_euclid(self.steps_per_turn) < self.mark_width;
        match self.sensor.get() {
            Sensor::Whole => on,
            Sensor::Dead => false,
            Sensor::Stuck => true,
            Sensor::Disturbed { from, steps } => on ^ ((place - from).rem_euclid(self.steps_per_turn) < steps),
        }
    }
}

struct Pin {
    world: Rc<World>,
    motor: usize,
    kind: Kind,
}

#[derive(Clone, Copy)]
enum Kind {
    Step,
    Direction,
    Enable,
    Index,
    Filament,
    Stop,
}

impl ErrorType for Pin {
    type Error = Infallible;
}

impl Pin {
    fn set(&self, high: bool) {
        let (now, motor) = (self.world.now.get(), &self.world.motors[self.motor]);
        match self.kind {
            Kind::Step if high == motor.high.get() => {}
            Kind::Step => {
                assert!(now > motor.changed_at.get() || now == 0, "a pulse is high, and low, for a tick at least");
                motor.changed_at.set(now);
                motor.high.set(high);
                if high {
                    assert!(motor.enabled.get(), "a step that the driver does not make");
                    assert!(now > motor.direction_at.get(), "a step with the direction not yet settled");
                    motor.moved.set(motor.moved.get() + if motor.backwards.get() { -1 } else { 1 });
                    if let Some(rises) = &mut *self.world.rises.borrow_mut() {
                        rises.push(Rise { tick: now, motor: self.motor, backwards: motor.backwards.get() });
                    }
                }
            }
            Kind::Direction => {
                assert!(!motor.high.get(), "the direction changes while the pulse is high");
                motor.direction_at.set(now);
                motor.backwards.set(!high);
            }
            Kind::Enable => motor.enabled.set(high),
            Kind::Index | Kind::Filament | Kind::Stop => unreachable!(),
        }
    }

    fn get(&self) -> bool {
        match self.kind {
            Kind::Index => self.world.on_index(),
            // The encoder has a pulse for every 100 steps.
            Kind::Filament => self.world.motors[FEED].moved.get().rem_euclid(100) >= 50,
            Kind::Stop => self.world.pressed.get(),
            _ => unreachable!(),
        }
    }
}

impl OutputPin for Pin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.set(false);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.set(true);
        Ok(())
    }
}

impl InputPin for Pin {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(self.get())
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(!self.get())
    }
}

/// A step engine with its simulated hardware.
struct Rig {
    robot: Robot,
    world: Rc<World>,
    handover: Mailbox,
    engine: Engine<Pin, Pin, Pin, Pin, Pin, Pin, Pin, Pin, Pin, FakeOutputs>,
    outputs: FakeOutputs,
    skipping: bool,
}

impl Rig {
    fn new(robot: Robot) -> Self {
        let head = &robot.description().head;
        let steps = |degrees: f64| libm::rint(degrees / 360.0 * f64::from(head.steps_per_turn)) as i64;
        let motor = || Motor {
            high: Cell::new(false),
            backwards: Cell::new(false),
            enabled: Cell::new(false),
            moved: Cell::new(0),
            changed_at: Cell::new(0),
            direction_at: Cell::new(0),
        };
        let world = Rc::new(World {
            now: Cell::new(0),
            motors: [motor(), motor()],
            rises: RefCell::new(None),
            steps_per_turn: i64::from(head.steps_per_turn),
            mark: steps(head.index_angle_deg),
            mark_width: steps(head.index_width_deg),
            lost: Cell::new(0),
            sensor: Cell::new(Sensor::Whole),
            pressed: Cell::new(false),
        });
        let pin = |motor: usize, kind: Kind| Pin { world: Rc::clone(&world), motor, kind };
        let axis = |motor: usize| StepperPins {
            step: pin(motor, Kind::Step),
            direction: pin(motor, Kind::Direction),
            enable: pin(motor, Kind::Enable),
        };
        let inputs = EngineInputs {
            index: pin(0, Kind::Index),
            filament_motion: pin(0, Kind::Filament),
            emergency_stop: pin(0, Kind::Stop),
        };
        let outputs = FakeOutputs::default();
        let engine = Engine::new(axis(HEAD), axis(FEED), inputs, outputs.clone(), EngineConfig::for_robot(&robot));
        Self { robot, world, handover: Mailbox::new(), engine, outputs, skipping: true }
    }

    /// Creates a step engine whose head has homed and stands at the tip's x axis.
    fn homed(robot: Robot) -> Self {
        let mut rig = Self::new(robot);
        let report = rig.order(Move::Home(rig.homing()));
        assert_eq!(report, Report::Homed);
        assert_eq!(rig.moved(HEAD) % rig.world.steps_per_turn, 0);
        rig
    }

    fn homing(&self) -> HomingMove {
        let turn = self.robot.description().head.steps_per_turn;
        let mark = self.world.mark.rem_euclid(i64::from(turn)) as u32;
        HomingMove { ticks_per_step: 4, max_steps: turn + turn / 2, steps_to_zero: (turn - mark) % turn }
    }

    fn moved(&self, motor: usize) -> i64 {
        self.world.motors[motor].moved.get()
    }

    fn energised(&self) -> bool {
        self.world.motors.iter().any(|motor| motor.enabled.get())
    }

    fn record(&self) {
        *self.world.rises.borrow_mut() = Some(Vec::new());
    }

    fn rises(&self) -> Vec<Rise> {
        self.world.rises.borrow().clone().unwrap()
    }

    /// Runs the next tick in which something happens, after all ticks before it, but at most `max` ticks in total.
    fn advance(&mut self, max: u32) {
        let quiet = if self.skipping { self.engine.ticks_to_event(&self.handover).min(max) - 1 } else { 0 };
        self.engine.skip(quiet);
        self.world.now.set(self.world.now.get() + u64::from(quiet) + 1);
        self.engine.tick(&self.handover);
        assert_eq!(u64::from(self.handover.ticks()), self.world.now.get());
    }

    fn run(&mut self, ticks: u64) {
        let until = self.world.now.get() + ticks;
        while self.world.now.get() < until {
            self.advance((until - self.world.now.get()) as u32);
        }
    }

    fn report(&mut self) -> Report {
        loop {
            if let Some(report) = self.handover.pop_report() {
                return report;
            }
            self.advance(1 << 22);
        }
    }

    fn order(&mut self, order: Move) -> Report {
        self.handover.submit(order);
        self.report()
    }

    /// Lays turns without a stop between them. Returns the reports of the laid turns, and the first report of another
    /// kind, after which it stops.
    fn lay(&mut self, turns: impl IntoIterator<Item = Turn>) -> (Vec<TurnReport>, Option<Report>) {
        let (mut turns, mut reports, mut given) = (turns.into_iter(), Vec::new(), 0);
        loop {
            if self.handover.can_accept_move()
                && let Some(turn) = turns.next()
            {
                self.handover.submit(Move::Lay(turn));
                given += 1;
            }
            if let Some(report) = self.handover.pop_report() {
                let Report::Laid(report) = report else { return (reports, Some(report)) };
                reports.push(report);
            }
            if reports.len() == given && self.handover.can_accept_move() {
                return (reports, None);
            }
            self.advance(1 << 22);
        }
    }
}

fn with(change: impl FnOnce(&mut RobotDescription)) -> Robot {
    let mut description = robot_a().description().clone();
    change(&mut description);
    Robot::new(description).unwrap()
}

fn robot_a_with(strategy: FeedStrategy, turning: HeadRotation) -> Robot {
    with(|description| {
        description.motion.strategy = strategy;
        description.motion.turning = turning;
    })
}

/// Returns a fast variant of robot A for wide bends, whose motors need ramps.
fn ramping(strategy: FeedStrategy, turning: HeadRotation) -> Robot {
    with(|description| {
        description.planning_radius_mm = 150.0;
        description.layer.period_s = 3.0;
        description.motion.tick_hz = 20_000;
        description.motion.strategy = strategy;
        description.motion.turning = turning;
        description.head.speed_jump_turns_per_s = 0.1;
        description.feed.steps_per_mm = 25.0;
    })
}

const ALL: [(FeedStrategy, HeadRotation); 4] = [
    (FeedStrategy::Feed, HeadRotation::Continuous),
    (FeedStrategy::Feed, HeadRotation::Alternate),
    (FeedStrategy::Speed, HeadRotation::Continuous),
    (FeedStrategy::Speed, HeadRotation::Alternate),
];

/// Returns layers of all kinds that a robot can lay. Their height is at least the share `thinnest` of the robot's layer
/// height.
fn layers(robot: &Robot, count: usize, thinnest: f64) -> Vec<LayerBytes> {
    let limits = robot.description().layer;
    let part = |i: usize, factor: f64| (i as f64 * factor).fract();
    let curvature = 1.0 / robot.description().planning_radius_mm;
    let mut encoder = LayerEncoder::default();
    let layer = |i: usize| {
        let height = limits.height_mm * (thinnest + (1.0 - thinnest) * part(i, 0.754_877_666));
        Layer { alpha: TAU * part(i, 0.618_033_989), height, tilt: height * curvature * part(i, 0.569_840_291) }
    };
    let bytes: Vec<LayerBytes> = (0..count).map(|i| encoder.encode(&layer(i))).collect();
    bytes.iter().for_each(|bytes| assert!(decode_checked(bytes, robot).is_ok()));
    bytes
}

fn turns(robot: &Robot, layers: &[LayerBytes]) -> Vec<Turn> {
    let alternate = robot.description().motion.turning == HeadRotation::Alternate;
    let mut material = TurnPlanner::default();
    let lay = |(i, bytes): (usize, &LayerBytes)| {
        let direction = if alternate && i % 2 == 1 { MotorDirection::Backward } else { MotorDirection::Forward };
        material.next_turn(bytes, robot, direction).unwrap()
    };
    layers.iter().enumerate().map(lay).collect()
}

fn feed_steps(layers: &[LayerBytes], robot: &Robot) -> i64 {
    let units: u64 = layers.iter().map(|bytes| u64::from(RawLayer::from_bytes(bytes).height)).sum();
    libm::rint(units as f64 / HEIGHT_UNITS_PER_MM * robot.feed_steps_per_length()) as i64
}
