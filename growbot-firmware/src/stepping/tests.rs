//! Layers through [`Material`] and [`Engine`] to the pins, and what stands at the other end of the pins: motors, an
//! index mark, a filament's encoder and a button. What must hold for every pulse is asserted at every pulse.

use core::f64::consts::TAU;
use std::cell::{Cell, RefCell};
use std::convert::Infallible;
use std::rc::Rc;
use std::vec::Vec;

use embedded_hal::digital::{ErrorType, InputPin, OutputPin};
use growbot_core::layer::{Layer, SECTORS};
use growbot_core::layer_bytes::{Encoder, Fields, HEIGHT_UNITS, LayerBytes, decode, decode_checked};
use growbot_core::robot::{FeedStrategy, Robot, RobotDescription, Turning};

use super::*;
use crate::testing::{FakeOutputs, FakePins, robot_a};

const HEAD: usize = 0;
const FEED: usize = 1;

/// What the index sensor is like.
#[derive(Clone, Copy, PartialEq)]
enum Sensor {
    Whole,
    Dead,
    Stuck,
    /// It shows the opposite at this place of the head, for so many steps.
    Disturbed(i64, i64),
}

/// One motor, as its pins drive it.
struct Motor {
    high: Cell<bool>,
    backwards: Cell<bool>,
    enabled: Cell<bool>,
    /// Steps made, forwards less backwards.
    moved: Cell<i64>,
    changed_at: Cell<u64>,
    direction_at: Cell<u64>,
}

/// The world at the other end of the pins.
struct World {
    now: Cell<u64>,
    motors: [Motor; 2],
    /// Rising edges: tick, motor, whether backwards. Only if they are wanted.
    rises: RefCell<Option<Vec<(u64, usize, bool)>>>,
    steps_per_turn: i64,
    mark: i64,
    mark_width: i64,
    /// Steps that the head has not made, although it was told to.
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
            Sensor::Disturbed(from, steps) => on ^ ((place - from).rem_euclid(self.steps_per_turn) < steps),
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
                        rises.push((now, self.motor, motor.backwards.get()));
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
            // A pulse for 100 steps.
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

/// An engine with its world.
struct Rig {
    robot: Robot,
    world: Rc<World>,
    handover: Handover,
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
        let axis = |motor: usize| Axis {
            step: pin(motor, Kind::Step),
            direction: pin(motor, Kind::Direction),
            enable: pin(motor, Kind::Enable),
        };
        let inputs = Inputs {
            index: pin(0, Kind::Index),
            filament_motion: pin(0, Kind::Filament),
            emergency_stop: pin(0, Kind::Stop),
        };
        let outputs = FakeOutputs::default();
        let engine = Engine::new(axis(HEAD), axis(FEED), inputs, outputs.clone(), EngineSettings::of(&robot));
        Self { robot, world, handover: Handover::new(), engine, outputs, skipping: true }
    }

    /// The same, with the head at the tip's x axis.
    fn homed(robot: Robot) -> Self {
        let mut rig = Self::new(robot);
        let report = rig.order(Order::Home(rig.homing()));
        assert_eq!(report, Report::Homed);
        assert_eq!(rig.moved(HEAD) % rig.world.steps_per_turn, 0);
        rig
    }

    fn homing(&self) -> Homing {
        let turn = self.robot.description().head.steps_per_turn;
        let mark = self.world.mark.rem_euclid(i64::from(turn)) as u32;
        Homing { ticks_per_step: 4, max_steps: turn + turn / 2, steps_to_zero: (turn - mark) % turn }
    }

    fn moved(&self, motor: usize) -> i64 {
        self.world.motors[motor].moved.get()
    }

    fn holds(&self) -> bool {
        self.world.motors.iter().any(|motor| motor.enabled.get())
    }

    fn record(&self) {
        *self.world.rises.borrow_mut() = Some(Vec::new());
    }

    fn rises(&self) -> Vec<(u64, usize, bool)> {
        self.world.rises.borrow().clone().unwrap()
    }

    /// One event, and the quiet ticks before it, of which there are fewer than `max`.
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

    fn order(&mut self, order: Order) -> Report {
        self.handover.give(order);
        self.report()
    }

    /// Lays turns without a stop between them; the first report that is none of a layer ends it.
    fn lay(&mut self, turns: impl IntoIterator<Item = Turn>) -> (Vec<TurnReport>, Option<Report>) {
        let (mut turns, mut reports, mut given) = (turns.into_iter(), Vec::new(), 0);
        loop {
            if self.handover.accepts_orders()
                && let Some(turn) = turns.next()
            {
                self.handover.give(Order::Lay(turn));
                given += 1;
            }
            if let Some(report) = self.handover.pop_report() {
                let Report::Laid(report) = report else { return (reports, Some(report)) };
                reports.push(report);
            }
            if reports.len() == given && self.handover.accepts_orders() {
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

fn robot_a_with(strategy: FeedStrategy, turning: Turning) -> Robot {
    with(|description| {
        description.motion.strategy = strategy;
        description.motion.turning = turning;
    })
}

/// A quick robot A, for wide bends, whose motors need ramps.
fn ramping(strategy: FeedStrategy, turning: Turning) -> Robot {
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

const ALL: [(FeedStrategy, Turning); 4] = [
    (FeedStrategy::Feed, Turning::Continuous),
    (FeedStrategy::Feed, Turning::Alternate),
    (FeedStrategy::Speed, Turning::Continuous),
    (FeedStrategy::Speed, Turning::Alternate),
];

/// Layers of all kinds that a robot can lay, those of half its height at least or thinner ones too.
fn layers(robot: &Robot, count: usize, thinnest: f64) -> Vec<LayerBytes> {
    let limits = robot.description().layer;
    let part = |i: usize, factor: f64| (i as f64 * factor).fract();
    let curvature = 1.0 / robot.description().planning_radius_mm;
    let mut encoder = Encoder::default();
    let layer = |i: usize| {
        let height = limits.height_mm * (thinnest + (1.0 - thinnest) * part(i, 0.754_877_666));
        Layer { alpha: TAU * part(i, 0.618_033_989), height, tilt: height * curvature * part(i, 0.569_840_291) }
    };
    let bytes: Vec<LayerBytes> = (0..count).map(|i| encoder.encode(&layer(i))).collect();
    bytes.iter().for_each(|bytes| assert!(decode_checked(bytes, robot).is_ok()));
    bytes
}

fn turns(robot: &Robot, layers: &[LayerBytes]) -> Vec<Turn> {
    let alternate = robot.description().motion.turning == Turning::Alternate;
    let mut material = Material::default();
    let lay = |(i, bytes): (usize, &LayerBytes)| material.lay(bytes, robot, alternate && i % 2 == 1).unwrap();
    layers.iter().enumerate().map(lay).collect()
}

fn feed_steps(layers: &[LayerBytes], robot: &Robot) -> i64 {
    let units: u64 = layers.iter().map(|bytes| u64::from(Fields::of(bytes).height)).sum();
    libm::rint(units as f64 / HEIGHT_UNITS * robot.feed_steps_per_length()) as i64
}

#[test]
fn five_thousand_layers_are_laid_to_the_step() {
    for (strategy, turning) in ALL {
        let robot = robot_a_with(strategy, turning);
        let layers = layers(&robot, 1250, 0.5);
        let mut rig = Rig::homed(robot.clone());
        let (head, feed) = (rig.moved(HEAD), rig.moved(FEED));
        let (reports, end) = rig.lay(turns(&robot, &layers));
        assert_eq!((reports.len(), end), (layers.len(), None));
        assert_eq!(rig.moved(FEED) - feed, feed_steps(&layers, &robot));
        let turned = if turning == Turning::Alternate { 0 } else { 1250 * 3200 };
        assert_eq!(rig.moved(HEAD) - head, turned);
        assert!(reports.iter().all(|report| report.head == 3200));
        for (report, bytes) in reports.iter().zip(&layers) {
            let layer = decode(bytes);
            let steps = layer.height * robot.feed_steps_per_length();
            let edge = |i: usize| steps * layer.share_of_material(TAU * i as f64 / SECTORS as f64, robot.tip_radius());
            for (i, made) in report.feed.iter().enumerate() {
                let closed_form = edge(i + 1) - edge(i);
                let off = (f64::from(*made) - closed_form).abs();
                // A step by rounding; what the layers before owe is a tenth of a step in a sector at max.
                assert!(off <= (0.01 * closed_form).max(1.1), "sector {i}: {made} for {closed_form}");
            }
        }
    }
}

#[test]
fn both_strategies_and_both_ways_lay_the_same_plastic_in_each_sector() {
    for at in [robot_a_with, ramping] {
        let layers = layers(&at(FeedStrategy::Feed, Turning::Continuous), 40, 0.02);
        let laid = ALL.map(|(strategy, turning)| {
            let robot = at(strategy, turning);
            let mut rig = Rig::homed(robot.clone());
            let (reports, end) = rig.lay(turns(&robot, &layers));
            assert_eq!(end, None);
            reports
        });
        assert!(laid.iter().all(|reports| reports.len() == 40 && *reports == laid[0]));
    }
}

#[test]
fn skipping_quiet_ticks_changes_nothing() {
    for robot in ALL.map(|(strategy, turning)| ramping(strategy, turning)).into_iter().chain([robot_a()]) {
        let runs = [false, true].map(|skipping| {
            let mut rig = Rig::new(robot.clone());
            rig.record();
            rig.skipping = skipping;
            let mut reports = std::vec![rig.order(Order::Home(rig.homing()))];
            reports.push(rig.order(Order::Feed(FeedMove { steps: 40, backwards: true, ticks_per_step: 7 })));
            rig.run(1000);
            reports.push(rig.order(Order::Feed(FeedMove { steps: 40, backwards: false, ticks_per_step: 9 })));
            let turns = turns(&robot, &layers(&robot, 6, 0.3));
            let (laid, end) = rig.lay(turns[..3].iter().copied());
            rig.run(12_345);
            // The next two come while it lays: the second one late, while it brakes.
            rig.handover.give(Order::Lay(turns[3]));
            rig.run(u64::from(turns[3].ticks));
            rig.handover.give(Order::Lay(turns[4]));
            reports.push(rig.report());
            reports.push(rig.report());
            rig.run(100);
            (rig.rises(), reports, laid, end, rig.world.now.get(), rig.handover.filament_pulses())
        });
        assert!(runs[0].0.len() > 10_000);
        assert_eq!(runs[0], runs[1]);
    }
}

#[test]
fn without_a_need_for_ramps_turns_follow_each_other_to_the_tick() {
    let robot = robot_a_with(FeedStrategy::Feed, Turning::Continuous);
    let mut rig = Rig::homed(robot.clone());
    rig.run(100);
    let began = rig.world.now.get();
    rig.lay(turns(&robot, &layers(&robot, 5, 0.5)));
    // One tick for the directions to settle.
    assert_eq!(rig.world.now.get() - began, 5 * 72_000 + 1);
}

/// Positions of a motor, in units of its limits, at even times: from the edges of its pulses.
fn positions(rises: &[(u64, usize, bool)], motor: usize, steps_per_unit: f64, every: u64, until: u64) -> Vec<f64> {
    let (mut rises, mut at) = (rises.iter().filter(|rise| rise.1 == motor).peekable(), 0_i64);
    (0..until / every)
        .map(|i| {
            while let Some((_, _, backwards)) = rises.next_if(|rise| rise.0 <= i * every) {
                at += if *backwards { -1 } else { 1 };
            }
            at as f64 / steps_per_unit
        })
        .collect()
}

/// Over any time, the speed changes by no more than the jump and what the acceleration makes of that time.
fn assert_limits(rig: &Rig, rises: &[(u64, usize, bool)]) {
    let description = rig.robot.description();
    let (head, feed) = (&description.head, &description.feed);
    let hz = f64::from(description.motion.tick_hz);
    let (every, until) = (u64::from(description.motion.tick_hz) / 20, rig.world.now.get());
    for (motor, per_unit, jump, acceleration) in [
        (HEAD, f64::from(head.steps_per_turn), head.speed_jump_turns_per_s, head.acceleration_turns_per_s2),
        (FEED, feed.steps_per_mm, feed.speed_jump_mm_per_s, feed.acceleration_mm_per_s2),
    ] {
        let window = every as f64 / hz;
        let positions = positions(rises, motor, per_unit, every, until);
        let speeds: Vec<f64> = positions.windows(2).map(|pair| (pair[1] - pair[0]) / window).collect();
        assert!(speeds.iter().any(|speed| speed.abs() > 2.0 * jump), "no ramp is needed");
        // Each end of a window is a step off at max, by rounding.
        let grain = 4.0 / per_unit / window;
        for (i, a) in speeds.iter().enumerate() {
            for (n, b) in speeds[i..].iter().enumerate() {
                let limit = jump + acceleration * n as f64 * window + grain;
                assert!((b - a).abs() <= limit, "motor {motor}: {a} to {b} in {n} windows, over {limit}");
            }
        }
    }
}

#[test]
fn ramps_keep_to_the_limits_of_the_motors() {
    for (strategy, turning) in ALL {
        let robot = ramping(strategy, turning);
        // Thin and thick ones next to each other: the speed of the feed jumps between them.
        let layers = layers(&robot, 8, 0.1);
        let mut rig = Rig::homed(robot.clone());
        rig.record();
        rig.run(5000);
        let began = rig.world.now.get();
        let turns = turns(&robot, &layers);
        let longest: u32 = turns.iter().map(Turn::longest_ticks).sum();
        let (reports, end) = rig.lay(turns);
        assert_eq!((reports.len(), end), (8, None));
        assert!(rig.world.now.get() - began <= u64::from(longest) + 8);
        let took = (rig.world.now.get() - began) as f64 / 20_000.0;
        // Ramps take time, and not much of it.
        assert!(took > 24.5 && took < 33.0, "{took} s for 24 s of layers, {strategy:?} {turning:?}");
        rig.run(5000);
        assert_limits(&rig, &rig.rises());
    }
}

#[test]
fn orders_that_come_late_cost_no_step_and_break_no_limit() {
    for (strategy, turning) in ALL {
        let robot = ramping(strategy, turning);
        let layers = layers(&robot, 10, 0.2);
        let mut rig = Rig::homed(robot.clone());
        let (head, feed) = (rig.moved(HEAD), rig.moved(FEED));
        rig.record();
        rig.run(5000);
        let (mut laid, mut given) = (0, 0);
        let turns = turns(&robot, &layers);
        while laid < 10 {
            // In time; while it brakes, ever later; after the end.
            let wait = [50_000, 57_000, 59_000, 61_000, 63_000, 65_000, 67_000, 70_000, 90_000, 1000][given.min(9)];
            if given < 10 {
                rig.handover.give(Order::Lay(turns[given]));
                given += 1;
            }
            let until = rig.world.now.get() + wait;
            while rig.world.now.get() < until || (given < 10 && !rig.handover.accepts_orders()) {
                if rig.handover.pop_report().is_some() {
                    laid += 1;
                }
                rig.advance(10);
            }
        }
        assert_eq!(rig.moved(FEED) - feed, feed_steps(&layers, &robot));
        assert_eq!((rig.moved(HEAD) - head) % 3200, 0);
        rig.run(5000);
        assert_limits(&rig, &rig.rises());
    }
}

#[test]
fn a_report_that_nobody_takes_loses_nothing() {
    let robot = ramping(FeedStrategy::Feed, Turning::Continuous);
    let layers = layers(&robot, 3, 0.5);
    let turns = turns(&robot, &layers);
    let mut rig = Rig::homed(robot.clone());
    let feed = rig.moved(FEED);
    rig.handover.give(Order::Lay(turns[0]));
    rig.run(100);
    rig.handover.give(Order::Lay(turns[1]));
    rig.run(150_000);
    rig.handover.give(Order::Lay(turns[2]));
    rig.run(150_000);
    // The second is laid and waits to say so.
    assert!(!rig.handover.accepts_orders());
    assert_eq!(rig.engine.ticks_to_event(&rig.handover), u32::MAX);
    for _ in 0..3 {
        assert!(matches!(rig.report(), Report::Laid(_)));
    }
    assert_eq!(rig.moved(FEED) - feed, feed_steps(&layers, &robot));
}

#[test]
fn turning_back_keeps_the_wires_from_winding_up() {
    let robot = robot_a_with(FeedStrategy::Speed, Turning::Alternate);
    let turns = turns(&robot, &layers(&robot, 4, 0.5));
    let mut rig = Rig::homed(robot);
    rig.record();
    let head = rig.moved(HEAD);
    rig.lay(turns.clone());
    assert_eq!(rig.moved(HEAD), head);
    let rises = rig.rises();
    let backwards = |motor: usize| rises.iter().filter(|rise| rise.1 == motor && rise.2).count();
    assert_eq!((backwards(HEAD), backwards(FEED)), (2 * 3200, 0));
    // The last sector comes first.
    assert!(turns[1].backwards && !turns[2].backwards);
}

#[test]
fn feed_moves_are_exact_both_ways() {
    let mut rig = Rig::new(robot_a());
    for (steps, backwards) in [(180, true), (180, false), (1, true), (0, true), (7, false)] {
        let before = rig.moved(FEED);
        let began = rig.world.now.get();
        assert_eq!(rig.order(Order::Feed(FeedMove { steps, backwards, ticks_per_step: 8 })), Report::Fed);
        let moved = i64::from(steps) * if backwards { -1 } else { 1 };
        assert_eq!(rig.moved(FEED) - before, moved);
        assert_eq!(rig.world.now.get() - began, u64::from(steps + 1) * 8 + 1);
    }
    assert_eq!(rig.moved(HEAD), 0);
}

#[test]
fn the_engine_counts_the_filament_and_sees_the_index() {
    let robot = robot_a();
    let mut rig = Rig::homed(robot.clone());
    let layers = layers(&robot, 2, 0.5);
    rig.lay(turns(&robot, &layers));
    assert_eq!(i64::from(rig.handover.filament_pulses()), (feed_steps(&layers, &robot) + 50) / 100);
    let before = rig.handover.filament_pulses();
    for steps in [180, 333, 7] {
        for backwards in [true, false] {
            rig.order(Order::Feed(FeedMove { steps, backwards, ticks_per_step: 8 }));
            let pulled = before.wrapping_sub(rig.handover.filament_pulses());
            assert!(if backwards { pulled.abs_diff(steps / 100) <= 1 } else { pulled == 0 }, "{steps}: {pulled}");
        }
    }
    assert!(!rig.handover.on_index());
    rig.world.sensor.set(Sensor::Stuck);
    rig.run(1);
    assert!(rig.handover.on_index());
}

#[test]
fn an_emergency_stop_lets_go_at_once_and_refuses_orders_until_the_controller_knows() {
    let robot = robot_a();
    let turn = turns(&robot, &layers(&robot, 1, 0.5))[0];
    let mut rig = Rig::homed(robot);
    rig.handover.give(Order::Lay(turn));
    rig.run(1000);
    rig.handover.give(Order::Lay(turn));
    rig.world.pressed.set(true);
    rig.run(1);
    assert!(!rig.holds() && rig.handover.emergency_stop() && !rig.handover.accepts_orders());
    assert_eq!(*rig.outputs.0.borrow(), 1, "the heater waits for the main loop");
    rig.world.pressed.set(false);
    let moved = [rig.moved(HEAD), rig.moved(FEED)];
    rig.handover.give(Order::Lay(turn));
    rig.run(1000);
    assert!(!rig.holds() && rig.handover.emergency_stop(), "it was pressed, however short");
    rig.handover.halt();
    rig.run(2);
    assert!(!rig.handover.emergency_stop() && rig.handover.accepts_orders());
    rig.run(1000);
    assert_eq!([rig.moved(HEAD), rig.moved(FEED)], moved);
    // Pressed, a halt changes nothing.
    rig.world.pressed.set(true);
    rig.run(1);
    rig.handover.halt();
    rig.run(2);
    assert!(rig.handover.emergency_stop());

    let mut without = Rig::new(with(|description| description.sensors.emergency_stop = None));
    without.world.pressed.set(true);
    without.run(10);
    assert!(!without.handover.emergency_stop());
}

/// Lays turns with a fault that comes at the beginning of the second one: the report, and the turns laid after it.
fn index_fault(robot: &Robot, fault: impl Fn(&World)) -> (Option<Report>, usize) {
    index_fault_at(0.0, robot, fault)
}

/// The same, after a share of the second turn.
fn index_fault_at(share: f64, robot: &Robot, fault: impl Fn(&World)) -> (Option<Report>, usize) {
    let turns = turns(robot, &layers(robot, 5, 0.5));
    let mut rig = Rig::homed(robot.clone());
    let (first, none) = rig.lay(turns[..1].iter().copied());
    assert_eq!((first.len(), none), (1, None));
    rig.handover.give(Order::Lay(turns[1]));
    rig.run((f64::from(turns[1].ticks) * share) as u64);
    assert_eq!(rig.handover.pop_report(), None);
    fault(&rig.world);
    let (laid, report) = match rig.report() {
        Report::Laid(_) => {
            let (more, report) = rig.lay(turns[2..].iter().copied());
            (1 + more.len(), report)
        }
        other => (0, Some(other)),
    };
    if report.is_some() {
        assert!(!rig.holds(), "the engine lets go by itself");
        rig.run(1000);
    }
    (report, laid)
}

#[test]
fn lost_and_gained_steps_are_noticed_within_a_turn() {
    for (strategy, turning) in ALL {
        let robot = robot_a_with(strategy, turning);
        // 2 degrees are 18 steps; two samples must contradict.
        for steps in [20, 21, 25, 30, 44, 60, 61, 62, 63, 64, 100, 200, 320, 321, 399, 400, 1600, 3000] {
            for lost in [steps, -steps] {
                let (report, laid) = index_fault(&robot, |world| world.lost.set(lost));
                assert_eq!(report, Some(Report::HeadStepsLost), "{lost} lost, {turning:?}");
                assert!(laid <= 1, "{lost} lost: noticed after {laid} more layers");
                // Lost in the midst of a turn, it may end before the mark comes.
                let (report, laid) = index_fault_at(0.5, &robot, |world| world.lost.set(lost));
                assert!(
                    matches!(report, Some(Report::HeadStepsLost | Report::IndexMissing)),
                    "{lost} lost: {report:?}"
                );
                assert!(laid <= 2, "{lost} lost: noticed after {laid} more layers");
            }
        }
        for lost in [0, 8, -8, 18, -18] {
            assert_eq!(index_fault(&robot, |world| world.lost.set(lost)), (None, 4), "{lost} are within the tolerance");
        }
    }
}

#[test]
fn a_narrow_mark_is_looked_for_too() {
    // Three steps wide with a tolerance of one; and one that is narrower than its tolerances.
    let coarse = |steps, width, tolerance| {
        with(|description| {
            description.head.steps_per_turn = steps;
            description.head.index_width_deg = width;
            description.head.index_tolerance_deg = tolerance;
        })
    };
    for (robot, tolerance) in [(coarse(200, 5.0, 2.0), 1), (coarse(3200, 2.0, 2.0), 18)] {
        for steps in [tolerance + 2, 60, 100] {
            for lost in [steps, -steps] {
                let (report, laid) = index_fault(&robot, |world| world.lost.set(lost));
                assert_eq!((report, laid <= 1), (Some(Report::HeadStepsLost), true), "{lost} {laid}");
            }
        }
        for lost in [tolerance, -tolerance] {
            assert_eq!(index_fault(&robot, |world| world.lost.set(lost)), (None, 4));
        }
        assert_eq!(index_fault(&robot, |world| world.sensor.set(Sensor::Dead)).0, Some(Report::IndexMissing));
        assert_eq!(index_fault(&robot, |world| world.sensor.set(Sensor::Stuck)).0, Some(Report::IndexStuck));
    }
    // A coarse head: 8 steps of 200 are 14 degrees.
    for lost in (8..=192).step_by(8) {
        let (report, _) = index_fault(&coarse(200, 5.0, 2.0), |world| world.lost.set(lost));
        assert_eq!(report, Some(Report::HeadStepsLost), "{lost}");
    }
}

#[test]
fn a_mark_at_the_edge_between_turns_is_looked_for_too() {
    for turning in [Turning::Continuous, Turning::Alternate] {
        for angle in [0.0, -5.0, -2.0, 1.0, 359.9] {
            let robot = with(|description| {
                description.motion.turning = turning;
                description.head.index_angle_deg = angle;
            });
            assert_eq!(index_fault(&robot, |_| {}), (None, 4), "{angle}");
            for lost in [-400, -25, 25, 400] {
                let (report, _) = index_fault(&robot, |world| world.lost.set(lost));
                assert_eq!(report, Some(Report::HeadStepsLost), "{lost} lost, mark at {angle}, {turning:?}");
            }
        }
    }
}

#[test]
fn a_dead_and_a_stuck_sensor_are_told_from_lost_steps() {
    for (strategy, turning) in ALL {
        let robot = robot_a_with(strategy, turning);
        let (report, laid) = index_fault(&robot, |world| world.sensor.set(Sensor::Dead));
        assert_eq!((report, laid <= 1), (Some(Report::IndexMissing), true));
        let (report, laid) = index_fault(&robot, |world| world.sensor.set(Sensor::Stuck));
        assert_eq!((report, laid), (Some(Report::IndexStuck), 0));
    }
}

#[test]
fn a_single_disturbed_sample_is_no_alarm() {
    let robot = robot_a();
    let mark = -320;
    for place in [0, 100, 1600, mark - 20, mark - 10, mark, mark + 20, mark + 21, mark + 43, mark + 60, mark + 63] {
        assert_eq!(index_fault(&robot, |world| world.sensor.set(Sensor::Disturbed(place, 1))), (None, 4), "{place}");
    }
    for place in [100, 1600, mark + 20] {
        let (report, _) = index_fault(&robot, |world| world.sensor.set(Sensor::Disturbed(place, 2)));
        assert_eq!(report, Some(Report::HeadStepsLost), "{place}");
    }
}

#[test]
fn homing_tells_what_is_wrong_with_the_mark() {
    for (sensor, report, max) in
        [(Sensor::Dead, Report::IndexNotFound, 4800), (Sensor::Stuck, Report::IndexStuck, 44 + 18)]
    {
        let mut rig = Rig::new(robot_a());
        rig.world.sensor.set(sensor);
        assert_eq!(rig.order(Order::Home(rig.homing())), report);
        assert!(!rig.holds() && rig.moved(HEAD) <= max, "{} steps", rig.moved(HEAD));
    }
    // From within the mark it goes round once more.
    let mut rig = Rig::new(robot_a());
    rig.world.lost.set(320 - 20);
    assert_eq!(rig.order(Order::Home(rig.homing())), Report::Homed);
    assert_eq!((rig.moved(HEAD) - 300) % 3200, 0);
}

#[test]
fn a_halt_lets_go_at_the_next_tick() {
    let robot = robot_a();
    let turn = turns(&robot, &layers(&robot, 1, 0.5))[0];
    let mut rig = Rig::new(robot);
    assert!(!rig.holds());
    rig.handover.give(Order::Lay(turn));
    rig.run(1000);
    assert!(rig.holds());
    rig.handover.halt();
    assert_eq!(rig.engine.ticks_to_event(&rig.handover), 1);
    rig.run(1);
    assert!(!rig.holds());
    assert_eq!(rig.engine.ticks_to_event(&rig.handover), u32::MAX);
}

#[test]
fn nothing_is_fed_any_more_once_the_engine_has_let_go() {
    let robot = robot_a();
    let turn = turns(&robot, &layers(&robot, 1, 0.5))[0];
    let ends: [fn(&mut Rig); 3] = [
        |rig| rig.handover.halt(),
        |rig| rig.world.pressed.set(true),
        // The next step of the head finds its mark nowhere.
        |rig| rig.world.sensor.set(Sensor::Stuck),
    ];
    for (number, end) in ends.into_iter().enumerate() {
        let mut rig = Rig::homed(robot.clone());
        assert_eq!(rig.handover.feed_rate(), 0.0);
        rig.handover.give(Order::Lay(turn));
        rig.run(1000);
        assert!(rig.handover.feed_rate() > 0.0);
        end(&mut rig);
        rig.run(1_000_000);
        assert!(!rig.holds());
        assert_eq!(rig.handover.feed_rate(), 0.0, "end {number}");
    }
}

#[test]
fn a_pin_that_fails_switches_everything_off() {
    let robot = robot_a();
    let turn = turns(&robot, &layers(&robot, 1, 0.5))[0];
    for broken in [0, 1, 2, 3, 4, 5, 6, 7, 8] {
        let (pins, handover) = (FakePins::default(), Handover::new());
        let axis = |at: usize| Axis { step: pins.pin(at), direction: pins.pin(at + 1), enable: pins.pin(at + 2) };
        let inputs = Inputs { index: pins.pin(6), filament_motion: pins.pin(7), emergency_stop: pins.pin(8) };
        let outputs = FakeOutputs::default();
        let mut engine = Engine::new(axis(0), axis(3), inputs, outputs.clone(), EngineSettings::of(&robot));
        engine.tick(&handover);
        assert_eq!(handover.pop_report(), None);
        pins.fail(broken);
        handover.give(Order::Lay(turn));
        for _ in 0..1000 {
            engine.tick(&handover);
        }
        assert_eq!(handover.pop_report(), Some(Report::Hardware), "pin {broken}");
        assert!(*outputs.0.borrow() > 0, "pin {broken}: the heater waits for the main loop");
        assert!([2, 5].into_iter().all(|enable| enable == broken || !pins.level(enable)));
    }
}
