//! Plastic by angle, turn by turn.
//!
//! Each feed step lays the same volume where the head stands. Over a turn the sum gives the mean height and the first
//! harmonic the tilt: `h = sum`, `r_t phi = 2 |sum e^(i psi)|`, in units of the height that one step spread over the
//! whole ring would have.

use growbot_core::angle::wrap_positive;
use growbot_core::layer::Layer;
use growbot_core::robot::Robot;

/// What one turn has laid: how many steps, and their first harmonic.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Ring {
    steps: f64,
    cosine: f64,
    sine: f64,
}

impl Ring {
    fn lay(&mut self, steps: f64, (cosine, sine): (f64, f64)) {
        self.steps += steps;
        self.cosine += steps * cosine;
        self.sine += steps * sine;
    }

    fn layer(&self, robot: &Robot) -> Layer {
        let height_of_step = 1.0 / robot.feed_steps_per_length();
        let tilt = 2.0 * height_of_step * libm::hypot(self.cosine, self.sine) / robot.tip_radius();
        Layer { alpha: wrap_positive(libm::atan2(self.sine, self.cosine)), height: self.steps * height_of_step, tilt }
    }
}

/// All plastic laid.
#[derive(Debug, Clone)]
pub(super) struct Plastic {
    steps_per_turn: i64,
    /// Cosine and sine of each head step.
    directions: Vec<(f64, f64)>,
    /// The turn that the head is in.
    turn: i64,
    ring: Ring,
    /// Steps laid with the head on the tip's x axis, where one turn ends and the next begins.
    on_axis: f64,
    /// What of those the turn under way was given for a beginning.
    given: f64,
    done: Vec<Ring>,
}

/// The direction of the tip's x axis.
const AXIS: (f64, f64) = (1.0, 0.0);

impl Plastic {
    pub fn new(robot: &Robot) -> Self {
        let steps = robot.description().head.steps_per_turn;
        let directions = (0..steps).map(|step| {
            let (sine, cosine) = libm::sincos(f64::from(step) / f64::from(steps) * std::f64::consts::TAU);
            (cosine, sine)
        });
        Self {
            steps_per_turn: i64::from(steps),
            directions: directions.collect(),
            turn: 0,
            ring: Ring::default(),
            on_axis: 0.0,
            given: 0.0,
            done: Vec::new(),
        }
    }

    /// The head has moved. What was laid on the axis lies half at the end of the old turn and half at the beginning of the
    /// new one, as the head stood there for half a step before the axis and half a step after it.
    pub fn turn_to(&mut self, head: i64) {
        let turn = (head - 1).div_euclid(self.steps_per_turn);
        if turn == self.turn {
            return;
        }
        self.turn = turn;
        let on_axis = std::mem::take(&mut self.on_axis);
        let mut over = std::mem::take(&mut self.ring);
        let given = std::mem::take(&mut self.given);
        if over.steps == 0.0 {
            // The head turned without laying anything: what the turn was given belongs to the one before.
            match self.done.last_mut() {
                Some(before) => before.lay(given, AXIS),
                None => self.given = given,
            }
            self.given += on_axis;
        } else {
            over.lay(given + 0.5 * on_axis, AXIS);
            self.done.push(over);
            self.given = 0.5 * on_axis;
        }
    }

    /// A feed step with the head standing here.
    pub fn lay(&mut self, head: i64) {
        match head.rem_euclid(self.steps_per_turn) {
            0 => self.on_axis += 1.0,
            step => self.ring.lay(1.0, self.directions[step as usize]),
        }
    }

    /// The turns as layers, that under way included.
    pub fn layers(&self, robot: &Robot) -> Vec<Layer> {
        let mut rings = self.done.clone();
        let on_axis = self.given + self.on_axis;
        match rings.last_mut() {
            Some(last) if self.ring.steps == 0.0 => last.lay(on_axis, AXIS),
            _ => {
                let mut under_way = self.ring;
                under_way.lay(on_axis, AXIS);
                if under_way.steps > 0.0 {
                    rings.push(under_way);
                }
            }
        }
        rings.iter().map(|ring| ring.layer(robot)).collect()
    }
}
