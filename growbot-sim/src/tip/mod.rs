//! The simulated tip: the reaction of a robot's head, feed and nozzle to their signals, and the readings of its
//! sensors.
//!
//! The tip does not use plans or layers. Head and feed steps become plastic by angle, plastic becomes height and tilt,
//! and layers of this height and tilt chain to a body (Eq 4). The nozzle warms and cools, and its thermistor follows.
//! The index sensor passes its mark once a turn, the filament turns its encoder, and gravity turns as the body bends.
//! Faults of a controller therefore appear in the body, as they would on a robot. Faults of a robot can be injected
//! ([`TipFault`]).
//!
//! The clock of the tip is the board's: ticks of the step interrupt. The results do not depend on how often the tip is
//! polled.
//!
//! The tip lays exactly what its steps command, unless an [`ErrorModel`] is set.
//!
//! The limits of the model are in the book's chapter "Limits" (`book/src/limits.md`).
//!
//! Retracted filament lays nothing. Filament that is pushed forward again first fills the space from which it was
//! retracted. Filament that is fed against a cold nozzle does not move.
//!
//! | file | what |
//! |---|---|
//! | `plastic.rs` | plastic by angle, layers, the tip's frame |
//! | `nozzle.rs`, `nozzle_inputs.rs`, `cartridge.rs`, `heat.rs` | nozzle, heater and thermistor |
//! | `filament.rs` | the filament between spool and nozzle, and the encoder that it turns |
//! | `sensors.rs`, `noise.rs` | readings of a 12-bit ADC, the index sensor, the switches and the orientation sensor; noise is a function of seed, channel and tick |
//! | `variation.rs` | differences of one copy of a robot from its description: power, heat capacity, heat loss, room temperature, supply, lag, noise |
//! | `fault.rs` | faults: [`TipFault`], added and removed at any time by `inject` and `clear_fault` |
//! | `pins.rs` | pins, ADC channels and sensors of a simulated board that are connected to the tip |

mod cartridge;
mod fault;
mod filament;
pub mod flash;
mod heat;
mod index_mark;
pub mod manual_action;
mod noise;
mod nozzle;
mod nozzle_inputs;
pub mod pins;
mod plastic;
mod sensors;
#[cfg(test)]
mod tests;
mod variation;

pub use cartridge::{CartridgeParameters, STEINHART_HART_104GT_2};
pub use fault::{Faults, TipFault};
pub use index_mark::IndexMark;
pub use sensors::encoder_pitch;
pub use variation::Variation;

use growbot_core::layer::Layer;
use growbot_core::link::message::Motor;
use growbot_core::pose::{Frame, Pose};
use growbot_core::robot::Robot;
use growbot_core::simulation::ErrorModel;
use growbot_firmware::stepping::MotorDirection;

use fault::StuckReading;
use filament::{FeedResult, SimulatedFilament};
use nozzle::Nozzle;
use plastic::Plastic;

/// The simulated tip of one robot.
#[derive(Debug, Clone)]
pub struct TipModel {
    robot: Robot,
    variation: Variation,
    faults: Faults,
    mark: IndexMark,
    /// The board's clock, ticks.
    now: u64,
    head: Axis,
    feed: Axis,
    /// Position of the head, steps from the tip's x axis. Counter-clockwise is positive.
    position: i64,
    /// Difference between the head's true position and the position that its steps command, steps.
    slipped: i64,
    /// Number of extra steps that the head will make because of a fault. Negative for steps that the head will miss.
    to_slip: i64,
    heater: HeaterInput,
    fan: f64,
    nozzle: Nozzle,
    /// Temperature to which the nozzle jumps when its heater first gets power, degrees Celsius. `None` for normal
    /// heating.
    warm_at_once: Option<f64>,
    /// True if the nozzle has jumped since the second switch was closed.
    warmed: bool,
    /// Constant readings of a thermistor that no longer follows the temperature, because of a fault.
    held: StuckReading,
    /// End of a dip of the supply, ticks. `None` without a dip.
    dip_until: Option<u64>,
    filament: SimulatedFilament,
    plastic: Plastic,
    imperfection: ErrorModel,
    /// Index of the current layer, and the distance by which each feed step in this layer turns the encoder, in feed
    /// steps.
    seen_per_step: (u64, f64),
    /// Pose at which the first layer began, in the base's frame.
    start: Frame,
    feed_steps: i64,
    cold_feed_steps: u64,
}

/// The signals of a motor's driver.
#[derive(Debug, Clone, Copy)]
struct Axis {
    enabled: bool,
    direction: MotorDirection,
}

/// Signals of the heater's two switches.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct HeaterInput {
    /// Fraction of full power, 0 to 1.
    duty: f64,
    /// True if the second switch is commanded to close.
    closed: bool,
}

impl TipModel {
    /// Creates a cold tip on an upright body. The head is at the position `head_steps`, in steps from the tip's x axis.
    pub fn new(robot: Robot, head_steps: i64, variation: Variation) -> Self {
        Self {
            variation,
            faults: Faults::default(),
            mark: IndexMark::of(&robot),
            now: 0,
            head: Axis { enabled: false, direction: MotorDirection::Backward },
            feed: Axis { enabled: false, direction: MotorDirection::Backward },
            position: head_steps,
            slipped: 0,
            to_slip: 0,
            heater: HeaterInput::default(),
            fan: 0.0,
            nozzle: Nozzle::new(&robot, &variation),
            warm_at_once: None,
            warmed: false,
            held: StuckReading::default(),
            dip_until: None,
            filament: SimulatedFilament::new(&robot),
            plastic: Plastic::new(&robot, head_steps),
            imperfection: ErrorModel::default(),
            seen_per_step: (0, 1.0),
            start: Frame::identity(),
            feed_steps: 0,
            cold_feed_steps: 0,
            robot,
        }
    }

    /// Places the tip at this pose, where the next layer begins. The body that was laid before moves with it. By
    /// default, the first layer begins at the origin with the direction upwards.
    pub fn start_at(&mut self, pose: &Pose) {
        let start_from_tip = self.plastic.start_from_tip(&self.robot, &self.imperfection);
        self.start = pose.frame() * start_from_tip.inverse();
    }

    /// Sets the disturbances of layers and measurements, from the first layer on. It must be called before growth.
    pub fn disturb(&mut self, imperfection: &ErrorModel) {
        self.imperfection = *imperfection;
        self.seen_per_step = (0, imperfection.encoder_ratio(0));
    }

    /// Sets the remaining filament, mm. By default, the spool is full.
    pub fn load_filament(&mut self, mm: f64) {
        self.filament.set_left(mm);
    }

    /// Advances the time to this tick of the board's clock.
    pub fn advance(&mut self, tick: u64) {
        self.now = self.now.max(tick);
    }

    /// Returns the board's clock, ticks.
    pub fn now(&self) -> u64 {
        self.now
    }

    /// Sets the enable signal of a motor's driver.
    pub fn set_enabled(&mut self, motor: Motor, enabled: bool) {
        self.axis(motor).enabled = enabled;
    }

    /// Sets the direction signal of a motor's driver.
    pub fn set_direction(&mut self, motor: Motor, direction: MotorDirection) {
        self.axis(motor).direction = direction;
    }

    fn axis(&mut self, motor: Motor) -> &mut Axis {
        match motor {
            Motor::Head => &mut self.head,
            Motor::Feed => &mut self.feed,
        }
    }

    /// Applies a step pulse to a motor's driver. A disabled driver does not move its motor.
    pub fn step(&mut self, motor: Motor) {
        let Axis { enabled, direction } = *self.axis(motor);
        if !enabled {
            return;
        }
        match motor {
            Motor::Head => self.step_head(direction),
            Motor::Feed => self.step_feed(direction),
        }
    }

    fn step_head(&mut self, direction: MotorDirection) {
        let sign = if direction == MotorDirection::Forward { 1 } else { -1 };
        self.slipped -= sign;
        if self.head_is_held() {
            return;
        }
        if self.to_slip < 0 {
            self.to_slip += 1;
            return;
        }
        for _ in 0..=std::mem::take(&mut self.to_slip) {
            self.plastic.turn(direction, self.now);
            self.position += sign;
            self.slipped += sign;
        }
    }

    fn step_feed(&mut self, direction: MotorDirection) {
        if self.faults.has(TipFault::DriverFault) {
            return;
        }
        self.feed_steps += if direction == MotorDirection::Forward { 1 } else { -1 };
        if self.filament_is_held() {
            self.plastic.pass(self.now);
            return;
        }
        // Cold plastic in the nozzle stops the filament at its foremost position.
        if direction == MotorDirection::Forward && self.filament.is_at_front() {
            self.sync_slot();
            if self.nozzle.at_slot() < self.robot.description().heater.extrusion_min_c {
                self.cold_feed_steps += 1;
                self.plastic.pass(self.now);
                return;
            }
        }
        let seen = self.seen_per_step();
        match self.filament.step(direction, seen) {
            FeedResult::Extruded => {
                self.nozzle.feed();
                self.plastic.lay(self.now);
            }
            FeedResult::Retracted => self.plastic.hold_back(true, self.now),
            FeedResult::Refilled => self.plastic.hold_back(!self.filament.is_at_front(), self.now),
            FeedResult::Blocked => self.plastic.pass(self.now),
        }
    }

    /// Returns the distance by which each feed step in the current layer turns the encoder, in feed steps.
    fn seen_per_step(&mut self) -> f64 {
        let index = self.plastic.layer_index();
        if self.seen_per_step.0 != index {
            self.seen_per_step = (index, self.imperfection.encoder_ratio(index));
        }
        self.seen_per_step.1
    }

    /// Reports whether the head is blocked, whatever its motor's signals are.
    fn head_is_held(&self) -> bool {
        self.faults.has(TipFault::HeadBlocked) || self.faults.has(TipFault::DriverFault)
    }

    /// Reports whether the filament is blocked, whatever the feed does.
    fn filament_is_held(&self) -> bool {
        self.faults.has(TipFault::FilamentJam) || self.faults.has(TipFault::FilamentOut)
    }

    /// Injects a fault. The fault replaces an active fault of the same kind.
    pub fn inject(&mut self, fault: TipFault) {
        self.sync();
        match fault {
            TipFault::ThermistorFrozen => self.held.number = self.converted_thermistor(),
            TipFault::ThermistorStuck => self.held.counts = self.thermistor_counts(),
            TipFault::HeadLosesSteps { steps } => self.to_slip = -i64::from(steps),
            TipFault::HeadGainsSteps { steps } => self.to_slip = i64::from(steps),
            TipFault::SupplyDip { seconds, .. } => {
                let ticks = seconds * f64::from(self.robot.description().motion.tick_hz);
                self.dip_until = Some(self.now + libm::rint(ticks) as u64);
            }
            _ => {}
        }
        self.faults.add(fault);
    }

    /// Removes the active fault of the same kind as `fault`. Steps that the head has lost stay lost.
    pub fn clear_fault(&mut self, fault: TipFault) {
        self.sync();
        if let TipFault::HeadLosesSteps { .. } | TipFault::HeadGainsSteps { .. } = fault {
            self.to_slip = 0;
        }
        self.faults.remove(fault);
    }

    /// Returns the active faults.
    pub fn faults(&self) -> &Faults {
        &self.faults
    }

    /// Returns the differences of the tip from its robot's description.
    pub fn variation(&self) -> &Variation {
        &self.variation
    }

    /// Returns the robot of the tip.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Reports whether a motor is energised.
    pub fn is_enabled(&self, motor: Motor) -> bool {
        match motor {
            Motor::Head => self.head.enabled,
            Motor::Feed => self.feed.enabled,
        }
    }

    /// Returns the position of the head, steps from the tip's x axis.
    pub fn head_position(&self) -> i64 {
        self.position
    }

    /// Returns the difference between the head's true position and the position that its steps command, steps.
    pub fn head_slip(&self) -> i64 {
        self.slipped
    }

    /// Returns the layers laid so far, computed from the simulated plastic.
    pub fn body(&self) -> Vec<Layer> {
        self.plastic.layers(&self.robot, &self.imperfection)
    }

    /// Returns the layers of [`TipModel::body`] whose plastic no longer changes, from this index on.
    #[must_use]
    pub fn settled(&mut self, from: usize) -> &[Layer] {
        self.plastic.settled(&self.robot, &self.imperfection).get(from..).unwrap_or_default()
    }

    /// Returns the pose of the tip in the base's frame.
    pub fn base_from_tip(&mut self) -> Frame {
        self.start * self.plastic.start_from_tip(&self.robot, &self.imperfection)
    }

    /// Returns the remaining filament, mm.
    pub fn filament_left(&self) -> f64 {
        self.filament.left()
    }

    /// Returns the net number of feed steps that were made while the feed motor was enabled: the steps forwards minus
    /// the steps backwards.
    pub fn feed_steps(&self) -> u64 {
        u64::try_from(self.feed_steps).unwrap_or(0)
    }

    /// Returns the position of the feed motor, steps. It is negative after more steps backwards than forwards.
    pub fn feed_position(&self) -> i64 {
        self.feed_steps
    }

    /// Returns the number of feed steps that were made against a cold nozzle, and laid nothing.
    pub fn cold_feed_steps(&self) -> u64 {
        self.cold_feed_steps
    }
}
