//! Conversion of layers to turns. It carries the rounding error of each turn to the next, so that height and direction
//! do not drift.
//!
//! A turn makes whole steps. A layer as laid is therefore off by a fraction of a step in height, and by about a quarter
//! of a step in its lean to one side. Without correction both errors would add up, because the layers of a segment are
//! all alike and rounded alike. Feed steps are therefore counted from the beginning of the job, and the lean that one
//! layer lacks is added to the next one. Height and direction of a body stay within a step's worth of the plan, however
//! long it grows.

use growbot_core::angle::wrap_positive;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{HEIGHT_UNITS_PER_MM, LayerBytes, RawLayer};
use growbot_core::robot::Robot;
use growbot_core::trigonometry;
use nalgebra::Vector2;

use crate::journal::RoundingCarry;

use super::direction::MotorDirection;
use super::ramp::EndSpeeds;
use super::turn::{StepRateError, Turn};

/// Max lean that the laid layers can lack because of rounding, in units of the height of one feed step spread over the
/// whole ring. With every edge of a sector off by half a step, the first harmonic is off by `2 pi` at most. A larger
/// lean is missing only if a layer is too thin to correct it, and the excess is dropped.
const MAX_RESIDUAL_LEAN_STEPS: f64 = core::f64::consts::TAU;

/// Number of units in a feed step, in which the missing lean is stored, so that it can be recorded exactly.
const LEAN_UNITS: f64 = 4096.0;

/// Planner of the turns of a job. It carries the rounding errors of each turn to the next.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TurnPlanner {
    carry: RoundingCarry,
    /// Speeds at the end of the previous turn. `None` if the head is at rest.
    before: Option<EndSpeeds>,
}

impl From<RoundingCarry> for TurnPlanner {
    /// Continues with the rounding errors of earlier layers, with the head at rest.
    fn from(carry: RoundingCarry) -> Self {
        Self { carry, before: None }
    }
}

/// Returns the lean of a layer: the height of its highest side above its mean height, as a vector towards that side,
/// mm.
fn lean(layer: &Layer, robot: &Robot) -> Vector2<f64> {
    let (sin, cos) = trigonometry::sin_cos(layer.alpha);
    Vector2::new(cos, sin) * (robot.tip_radius() * layer.tilt)
}

impl TurnPlanner {
    /// Returns the rounding errors that the layers planned so far carry over to the next layers.
    pub fn carry(&self) -> RoundingCarry {
        self.carry
    }

    /// Computes the turn that lays the next layer. `head` is the direction of the head. The planner then counts the
    /// layer as laid.
    ///
    /// # Errors
    /// Returns [`StepRateError`] if a sector needs more than one step in two ticks, the layer has no height or needs
    /// feed in reverse, or its profile needs more acceleration than the motors have. A layer that
    /// [`growbot_core::layer_bytes::decode_checked`] has accepted never fails. After an error the layer does not count
    /// as laid.
    pub fn next_turn(
        &mut self,
        bytes: &LayerBytes,
        robot: &Robot,
        head: MotorDirection,
    ) -> Result<Turn, StepRateError> {
        let fields = RawLayer::from_bytes(bytes);
        if fields.height == 0 {
            return Err(StepRateError);
        }
        let layer = fields.to_layer();
        let below = self.carry.height_units as f64;
        // Length of a unit of lean, mm.
        let unit = 1.0 / (LEAN_UNITS * robot.feed_steps_per_length());
        let [x, y] = self.carry.residual_lean;
        let feed_steps = |share: f64| {
            (below + f64::from(fields.height) * share) / HEIGHT_UNITS_PER_MM * robot.feed_steps_per_length()
        };
        let asked = lean(&layer, robot) + Vector2::new(f64::from(x), f64::from(y)) * unit;
        let paying = Layer {
            alpha: wrap_positive(libm::atan2(asked.y, asked.x)),
            tilt: asked.norm() / robot.tip_radius(),
            ..layer
        };
        let lay = |profile: &Layer| Turn::new(profile, feed_steps, robot, head, self.before.as_ref());
        // A layer close to its limits is laid without the correction, which the next layer then makes.
        let (turn, ends) = lay(&paying).or_else(|StepRateError| lay(&layer))?;
        self.before = Some(ends);
        let mut owed = (asked - lean(&turn.layer(robot), robot)) / unit;
        let max = MAX_RESIDUAL_LEAN_STEPS * LEAN_UNITS;
        if owed.norm() > max {
            owed *= max / owed.norm();
        }
        self.carry = RoundingCarry {
            height_units: self.carry.height_units + u64::from(fields.height),
            residual_lean: [libm::rint(owed.x) as i16, libm::rint(owed.y) as i16],
        };
        Ok(turn)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{fast_robot, robot_a};
    use growbot_core::layer_bytes::{LayerEncoder, decode, decode_checked};
    use growbot_core::robot::FeedStrategy;

    fn bytes(layer: &Layer) -> LayerBytes {
        LayerEncoder::default().encode(layer)
    }

    #[test]
    fn lean_does_not_drift_with_coarse_steps() {
        for robot in [robot_a(), fast_robot()] {
            let step = 1.0 / robot.feed_steps_per_length();
            for layer in [
                Layer { alpha: 0.0, height: 0.7733, tilt: 0.0 },
                Layer { alpha: 2.5, height: 0.7733, tilt: 0.0077 },
                Layer { alpha: 4.0, height: 0.4, tilt: 0.001 },
            ] {
                let (mut material, mut owed) = (TurnPlanner::default(), Vector2::zeros());
                for _ in 0..2000 {
                    let bytes = bytes(&layer);
                    let turn = material.next_turn(&bytes, &robot, MotorDirection::Forward).unwrap();
                    owed += lean(&decode(&bytes), &robot) - lean(&turn.layer(&robot), &robot);
                    assert!(
                        owed.norm() <= MAX_RESIDUAL_LEAN_STEPS * step,
                        "{} owes {} steps",
                        robot.name(),
                        owed.norm() / step
                    );
                }
            }
        }
    }

    #[test]
    fn layers_at_a_limit_have_a_turn_for_any_rounding() {
        let quick = fast_robot();
        let mut by_speed = quick.description().clone();
        by_speed.motion.strategy = FeedStrategy::Speed;
        let by_speed = Robot::new(by_speed).unwrap();
        // The layer has nearly no height on the inner side, or nearly more than one head step in two ticks there.
        for (robot, height, leans) in [(robot_a(), 0.17, 0.999..1.0), (by_speed, 0.5, 0.2888..0.2889)] {
            let (mut material, mut laid) = (TurnPlanner::default(), 0);
            for i in 0..4000 {
                let lean = leans.start + (leans.end - leans.start) * f64::from(i) / 4000.0;
                let alpha = wrap_positive(f64::from(i) * 0.37);
                let bytes = bytes(&Layer { alpha, height, tilt: lean * height / robot.tip_radius() });
                if decode_checked(&bytes, &robot).is_ok() {
                    let turn = material.next_turn(&bytes, &robot, MotorDirection::Forward).unwrap();
                    assert!(
                        turn.sectors.iter().all(|sector| 2 * sector.head_steps.max(sector.feed_steps) <= sector.ticks)
                    );
                    laid += 1;
                }
            }
            assert!(laid > 2000, "{laid} passed their check");
        }
    }

    #[test]
    fn feed_steps_do_not_drift_over_5000_layers() {
        let robot = robot_a();
        let layer = Layer { alpha: 1.0, height: 0.7731, tilt: 0.0077 };
        let (mut encoder, mut material, mut steps, mut height) =
            (LayerEncoder::default(), TurnPlanner::default(), 0_u64, 0.0);
        for _ in 0..5000 {
            let bytes = encoder.encode(&layer);
            let turn = material.next_turn(&bytes, &robot, MotorDirection::Forward).unwrap();
            steps += turn.sectors.iter().map(|sector| u64::from(sector.feed_steps)).sum::<u64>();
            height += decode(&bytes).height;
            assert!((steps as f64 - height * robot.feed_steps_per_length()).abs() < 0.51);
        }
    }

    #[test]
    fn layers_beyond_the_step_interrupt_capacity_are_refused() {
        let robot = robot_a();
        assert_eq!(TurnPlanner::default().next_turn(&[0; 12], &robot, MotorDirection::Forward), Err(StepRateError));
        let absurd = Layer { alpha: 0.0, height: 200.0, tilt: 0.1 };
        assert_eq!(
            TurnPlanner::default().next_turn(&bytes(&absurd), &robot, MotorDirection::Forward),
            Err(StepRateError)
        );
        let more_lean_than_height = Layer { alpha: 0.0, height: 0.1, tilt: 0.1 };
        assert_eq!(
            TurnPlanner::default().next_turn(&bytes(&more_lean_than_height), &robot, MotorDirection::Forward),
            Err(StepRateError)
        );
    }
}
