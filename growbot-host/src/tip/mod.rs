//! The simulated tip: what a robot's head, feed and nozzle would do with the signals they get.
//!
//! It knows nothing of plans or layers. Head and feed steps become plastic by angle, plastic becomes height
//! and tilt, and these chain to a body (Eq 4). The nozzle warms and cools. The index sensor passes
//! once a turn. Faults of a controller therefore show as they would on a robot: in the body.
//!
//! Not modelled: play in the gears, the flow's delay behind the feed, sag, and heat carried away by the filament.

mod nozzle;
mod plastic;

pub use nozzle::{Nozzle, ROOM_C};

use growbot_core::angle::{radians, wrap_positive};
use growbot_core::layer::Layer;
use growbot_core::robot::Robot;

use plastic::Plastic;

/// The simulated tip of one robot.
#[derive(Debug, Clone)]
pub struct Tip {
    robot: Robot,
    /// Where the head stands, steps from the tip's x axis; counter-clockwise is positive.
    head: i64,
    head_enabled: bool,
    feed_enabled: bool,
    head_forwards: bool,
    feed_forwards: bool,
    nozzle: Nozzle,
    plastic: Plastic,
    feed_steps: u64,
    cold_feed_steps: u64,
}

/// A motor of the tip.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motor {
    /// Turns the head.
    Head,
    /// Pushes filament.
    Feed,
}

impl Tip {
    /// A cold tip whose head stands somewhere, `head_steps` from the tip's x axis.
    #[must_use]
    pub fn new(robot: Robot, head_steps: i64) -> Self {
        let plastic = Plastic::new(&robot, head_steps);
        Self {
            nozzle: Nozzle::new(&robot.description().heater),
            plastic,
            robot,
            head: head_steps,
            head_enabled: false,
            feed_enabled: false,
            head_forwards: false,
            feed_forwards: false,
            feed_steps: 0,
            cold_feed_steps: 0,
        }
    }

    /// The enable signal of a motor's driver.
    pub fn enable(&mut self, motor: Motor, enabled: bool) {
        match motor {
            Motor::Head => self.head_enabled = enabled,
            Motor::Feed => self.feed_enabled = enabled,
        }
    }

    /// The direction signal of a motor's driver.
    pub fn direct(&mut self, motor: Motor, forwards: bool) {
        match motor {
            Motor::Head => self.head_forwards = forwards,
            Motor::Feed => self.feed_forwards = forwards,
        }
    }

    /// A step pulse at this tick of the board's clock.
    pub fn step(&mut self, motor: Motor, tick: u64) {
        match motor {
            Motor::Head if self.head_enabled => {
                self.head += if self.head_forwards { 1 } else { -1 };
                self.plastic.turn_to(self.head, tick);
            }
            Motor::Feed if self.feed_enabled && self.feed_forwards => {
                self.feed_steps += 1;
                if self.nozzle.temperature() < self.robot.description().heater.extrusion_min_c {
                    self.cold_feed_steps += 1;
                    self.plastic.pass(tick);
                } else {
                    self.plastic.lay(tick);
                }
            }
            // A driver that is off lets its motor stand; filament pulled back lays nothing.
            _ => {}
        }
    }

    /// Whether the index sensor sees its mark.
    #[must_use]
    pub fn on_index(&self) -> bool {
        let mark = IndexMark::of(&self.robot);
        (self.head - i64::from(mark.position)).rem_euclid(i64::from(mark.steps_per_turn)) < i64::from(mark.width)
    }

    /// The robot that it belongs to.
    #[must_use]
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// The nozzle.
    #[must_use]
    pub fn nozzle(&self) -> &Nozzle {
        &self.nozzle
    }

    /// The nozzle, to be heated.
    pub fn nozzle_mut(&mut self) -> &mut Nozzle {
        &mut self.nozzle
    }

    /// The layers laid so far, from the plastic itself.
    #[must_use]
    pub fn body(&self) -> Vec<Layer> {
        self.plastic.layers(&self.robot)
    }

    /// Feed steps made with the motor held.
    #[must_use]
    pub fn feed_steps(&self) -> u64 {
        self.feed_steps
    }

    /// Feed steps made against a cold nozzle, which laid nothing.
    #[must_use]
    pub fn cold_feed_steps(&self) -> u64 {
        self.cold_feed_steps
    }
}

/// The index mark in head steps.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct IndexMark {
    /// Head steps in a turn.
    pub steps_per_turn: u32,
    /// Where it begins, from the tip's x axis.
    pub position: u32,
    /// How wide it is.
    pub width: u32,
}

impl IndexMark {
    /// The mark of a robot, to the nearest step.
    #[must_use]
    pub fn of(robot: &Robot) -> Self {
        let head = &robot.description().head;
        let per_degree = f64::from(head.steps_per_turn) / 360.0;
        let angle = wrap_positive(radians(head.index_angle_deg)) / std::f64::consts::TAU * 360.0;
        Self {
            steps_per_turn: head.steps_per_turn,
            position: libm::rint(angle * per_degree) as u32 % head.steps_per_turn,
            width: (libm::rint(head.index_width_deg * per_degree) as u32).max(1),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use growbot_firmware::thermistor;

    fn robot() -> Robot {
        crate::robot_file::load("growbot-a".as_ref()).unwrap()
    }

    fn hot_tip() -> Tip {
        let mut tip = Tip::new(robot(), 0);
        tip.nozzle_mut().heat(1.0, 120.0);
        for motor in [Motor::Head, Motor::Feed] {
            tip.enable(motor, true);
            tip.direct(motor, true);
        }
        tip
    }

    #[test]
    fn the_index_passes_once_a_turn() {
        let mut tip = hot_tip();
        let mut edges = 0;
        let mut before = tip.on_index();
        for _ in 0..5 * 3200 {
            tip.step(Motor::Head, 0);
            edges += u32::from(tip.on_index() && !before);
            before = tip.on_index();
        }
        assert_eq!(edges, 5);
    }

    #[test]
    fn motors_that_are_not_held_do_nothing() {
        let mut tip = Tip::new(robot(), 17);
        tip.step(Motor::Head, 1);
        tip.step(Motor::Feed, 2);
        assert_eq!((tip.head, tip.feed_steps), (17, 0));
    }

    #[test]
    fn a_cold_nozzle_lays_nothing() {
        let mut tip = Tip::new(robot(), 0);
        tip.enable(Motor::Feed, true);
        tip.direct(Motor::Feed, true);
        tip.step(Motor::Feed, 1);
        assert_eq!((tip.feed_steps(), tip.cold_feed_steps()), (1, 1));
        assert!(tip.body().is_empty());
    }

    #[test]
    fn more_plastic_on_one_side_tilts_the_layer_away_from_it() {
        let mut tip = hot_tip();
        let mut tick = 0;
        for step in 0..3200 {
            // Twice the plastic in the quarter round 90 degrees.
            for _ in 0..if (400..1200).contains(&step) { 4 } else { 2 } {
                tick += 1;
                tip.step(Motor::Feed, tick);
            }
            tip.step(Motor::Head, tick);
        }
        let body = tip.body();
        assert_eq!(body.len(), 1);
        assert!((body[0].alpha - std::f64::consts::FRAC_PI_2).abs() < 2e-3, "{body:?}");
        let height = 8000.0 / robot().feed_steps_per_length();
        assert!((body[0].height - height).abs() < 1e-9);
    }

    #[test]
    fn the_nozzle_reads_as_the_thermistor_says() {
        let tip = hot_tip();
        let thermistor = robot().description().thermistor;
        let raw = thermistor::reading(tip.nozzle().temperature(), &thermistor);
        assert!((thermistor::temperature(raw, &thermistor).unwrap() - tip.nozzle().temperature()).abs() < 1.0);
    }
}
