//! What the layers of a job amount to so far, to the step, and what rounding has left owing.
//!
//! A turn makes whole steps, so a layer as laid is off by a fraction of a step in height, and by about a quarter of a step in its
//! lean to one side. Left alone both would add up, since layers of a segment are all alike and rounded alike. So feed steps are
//! counted from the beginning of the job, and the lean that one layer lacked is asked of the next one: height and direction of a
//! body stay within a step's worth of the plan however long it grows.

use growbot_core::angle::wrap_positive;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{Fields, HEIGHT_UNITS, LayerBytes};
use growbot_core::robot::Robot;
use nalgebra::Vector2;

use super::turn::{StepRate, Turn};

/// The lean that rounding can leave owing, in the height of a step spread over the whole ring: with every edge of a sector off by
/// half a step, the first harmonic is off by `2 pi` at most. What goes beyond, because a layer was too thin to pay, is forgotten.
const MOST_OWED_STEPS: f64 = core::f64::consts::TAU;

/// What a job has laid so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Material {
    /// Sum of the heights of all layers, in the units of [`Fields::height`].
    height_units: u64,
    /// Lean that was asked for and not laid, in the tip's x and y, mm.
    lean_owed: Vector2<f64>,
}

/// By how much a layer is higher on its outer side than on average, as a vector towards that side, mm.
fn lean(layer: &Layer, robot: &Robot) -> Vector2<f64> {
    let (sin, cos) = libm::sincos(layer.alpha);
    Vector2::new(cos, sin) * (robot.tip_radius() * layer.tilt)
}

impl Material {
    /// The turn that lays a layer next. The layer counts as laid.
    ///
    /// # Errors
    /// [`StepRate`] if a sector asks for more than one step in two ticks, or the layer for no height or for feed taken back.
    /// No layer does that which [`growbot_core::layer_bytes::decode_checked`] has passed. The layer does not count then.
    pub fn lay(&mut self, bytes: &LayerBytes, robot: &Robot, _backwards: bool) -> Result<Turn, StepRate> {
        let fields = Fields::of(bytes);
        if fields.height == 0 {
            return Err(StepRate);
        }
        let layer = fields.layer();
        let below = self.height_units as f64;
        let feed_steps =
            |share: f64| (below + f64::from(fields.height) * share) / HEIGHT_UNITS * robot.feed_steps_per_length();
        let asked = lean(&layer, robot) + self.lean_owed;
        let paying = Layer {
            alpha: wrap_positive(libm::atan2(asked.y, asked.x)),
            tilt: asked.norm() / robot.tip_radius(),
            ..layer
        };
        // A layer close to its limits goes as it is, and the next one pays.
        let turn = Turn::new(&paying, feed_steps, robot).or_else(|StepRate| Turn::new(&layer, feed_steps, robot))?;
        self.height_units += u64::from(fields.height);
        self.lean_owed = asked - lean(&turn.layer(robot), robot);
        let most = MOST_OWED_STEPS / robot.feed_steps_per_length();
        if self.lean_owed.norm() > most {
            self.lean_owed *= most / self.lean_owed.norm();
        }
        Ok(turn)
    }
}
