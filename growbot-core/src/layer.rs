//! One layer: a ring of material that is laid in one turn of the head, higher on one side.
//!
//! A layer of mean height `h` tilted by `phi` has, at angle `psi` round the ring of radius `r_t`, the height
//! `h(psi) = h + r_t phi cos(psi - alpha)`. Laying it moves the tip by one step of Eq 4: `step(alpha, phi, h)`.

use crate::trigonometry;
#[cfg(feature = "planning")]
use crate::{kinematics, pose::Frame};

/// Number of equal sectors into which a turn of the head is divided. At the edges of each sector, head and feed are at
/// the motor steps that [`Layer::material_fraction`] gives for the angle of the edge. Within a sector, both move at
/// constant speed.
pub const SECTORS: usize = 64;

/// A layer: a ring of printed material, which is higher on one side if it is tilted.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Layer {
    /// Angle of max deposition from the tip's x axis, `[0, 2 pi)`, radians. 0 if the layer has the same height all
    /// round.
    pub alpha: f64,
    /// Mean height of the ring, mm.
    pub height: f64,
    /// Angle between the lower and the upper plane of the layer, radians, not negative.
    pub tilt: f64,
}

/// Reasons why a layer cannot be laid. Heights are in mm, tilts in radians.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum LayerError {
    /// A number is NaN or infinite.
    #[error("the layer holds a number that is not finite: plan again")]
    NotFinite,
    /// The outer side would be higher than the nozzle can lay.
    #[error(
        "the layer is {height} mm high on its outer side, but the robot lays at most {limit} mm: plan with a larger \
         radius"
    )]
    TooHigh {
        /// Height of the outer side, mm.
        height: f64,
        /// Max height that the robot can lay, mm.
        limit: f64,
    },
    /// The tilt is negative or greater than the robot can lay.
    #[error(
        "the layer tilts by {tilt} rad, but the robot lays layers that tilt by 0 to {limit} rad: plan with a larger \
         radius"
    )]
    Tilt {
        /// Tilt of the layer, radians.
        tilt: f64,
        /// Limit of the tilt that the layer violates, radians: 0, or the robot's max tilt.
        limit: f64,
    },
    /// The inner side would have a height of zero or less.
    #[error(
        "the layer is {height} mm high on its inner side, but a layer must be higher than 0 mm all round: plan with a \
         larger radius"
    )]
    NoMaterial {
        /// Height of the inner side, mm.
        height: f64,
    },
    /// Head or feed would have to make more than one step in two ticks of the step interrupt.
    #[error(
        "the layer needs more than one motor step in two ticks of the step interrupt: raise motion.tick_hz, or lower \
         head.steps_per_turn or feed.steps_per_mm"
    )]
    StepRate,
    /// The speed of an axis would have to change faster, from sector to sector, than its motor can follow.
    #[error(
        "the layer needs an acceleration of {value} of the {axis}, above the limit of {limit}: plan with a larger \
         radius, raise layer.period_s, or raise the axis's acceleration and speed jump"
    )]
    Acceleration {
        /// Name of the axis, with the unit of the acceleration.
        axis: &'static str,
        /// Acceleration that the layer needs, in the unit that `axis` names.
        value: f64,
        /// Acceleration that the profile of a layer may use, which is a fraction of the robot's limit, in the unit that
        /// `axis` names.
        limit: f64,
    },
}

impl Layer {
    /// Returns the height (mm) at angle `psi` (radians) from the tip's x axis, on a ring of radius `tip_radius` (mm).
    pub fn height_at(&self, psi: f64, tip_radius: f64) -> f64 {
        self.height + tip_radius * self.tilt * trigonometry::cos(psi - self.alpha)
    }

    /// Returns the height of the layer on the outer side of the bend, on a ring of radius `tip_radius` (mm), mm.
    pub fn max_height(&self, tip_radius: f64) -> f64 {
        self.height + tip_radius * self.tilt
    }

    /// Returns the height of the layer on the inner side of the bend, on a ring of radius `tip_radius` (mm), mm.
    pub fn min_height(&self, tip_radius: f64) -> f64 {
        self.height - tip_radius * self.tilt
    }

    /// Returns the fraction (0 to 1) of the layer's material that lies between angle 0 and angle `psi` (radians, 0 to
    /// `2 pi`). With `lean = r_t phi (sin(psi - alpha) + sin alpha)`, it is `(h psi + lean) / (2 pi h)`.
    pub fn material_fraction(&self, psi: f64, tip_radius: f64) -> f64 {
        let lean = tip_radius * self.tilt * (trigonometry::sin(psi - self.alpha) + trigonometry::sin(self.alpha));
        (psi + lean / self.height) / core::f64::consts::TAU
    }

    /// Returns `tip_from_next_tip`, the motion of the tip while this layer is laid (Eq 4).
    #[cfg(feature = "planning")]
    pub fn step(&self) -> Frame {
        kinematics::step(self.alpha, self.tilt, self.height)
    }
}

/// Returns the frame of the tip, `base_from_tip`, after these layers have been laid (Eq 5).
#[cfg(feature = "planning")]
pub fn grow(base_from_start: &Frame, layers: impl IntoIterator<Item = Layer>) -> Frame {
    layers.into_iter().fold(*base_from_start, |base_from_tip, layer| kinematics::advance(&base_from_tip, &layer.step()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;

    #[test]
    fn material_fraction_is_the_integral_of_the_height() {
        let (layer, tip_radius) = (Layer { alpha: 2.0, height: 0.77, tilt: 0.0077 }, 22.0);
        assert_eq!(layer.material_fraction(0.0, tip_radius), 0.0);
        assert!((layer.material_fraction(TAU, tip_radius) - 1.0).abs() < 1e-15);
        let (mut sum, n) = (0.0, 20_000);
        for i in 0..n {
            let psi = TAU * (f64::from(i) + 0.5) / f64::from(n);
            sum += layer.height_at(psi, tip_radius) / (layer.height * f64::from(n));
            let upto = TAU * f64::from(i + 1) / f64::from(n);
            assert!((layer.material_fraction(upto, tip_radius) - sum).abs() < 1e-8);
        }
    }
}
