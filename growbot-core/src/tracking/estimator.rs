//! Where the tip is: dead reckoning from the layers as commanded, corrected by what is measured.
//!
//! An extended Kalman filter (Kalman 1960; the error of the attitude is a small rotation in the base's frame, as in
//! Sola 2017, section 7, so that it stands still while the tip turns). Its errors are those of the position (3), of the
//! attitude (3), and of three things that a robot does in every layer and that are learned: tilt gain, offset of the
//! deposition angle, twist. How much more or less than asked for a layer grows is learned beside it, from the odometry.

use nalgebra::{Rotation3, SMatrix, SVector, Vector3};

use super::measurement::{Measurement, SensorNoise};
use crate::kinematics::step;
use crate::layer::Layer;
use crate::pose::Frame;
use crate::trigonometry;

/// Errors that the filter keeps: position, attitude, tilt gain, deposition angle, twist.
const ERRORS: usize = 9;
const TILT_GAIN: usize = 6;
const ALPHA: usize = 7;
const TWIST: usize = 8;

type Covariance = SMatrix<f64, ERRORS, ERRORS>;
type Errors = SVector<f64, ERRORS>;

/// What is assumed of a robot of which nothing is known but its description: standard deviations.
mod assumed {
    use core::f64::consts::PI;

    const DEGREE: f64 = PI / 180.0;
    /// How much more or less than asked for layers grow, a share; and how that changes from layer to layer.
    pub const GROWTH_BIAS: f64 = 0.1;
    pub const GROWTH_BIAS_DRIFT: f64 = 1e-4;
    /// Of the growth of a single layer, a share: what is found takes its place.
    pub const GROWTH: f64 = 0.06;
    pub const GROWTH_MIN: f64 = 1e-3;
    /// Layers over which the growth's noise is found.
    pub const GROWTH_WINDOW: f64 = 100.0;
    /// How much more or less than asked for layers tilt, a share.
    pub const TILT_GAIN: f64 = 0.05;
    /// An offset of the deposition angle, radians.
    pub const ALPHA: f64 = 2.0 * DEGREE;
    /// Twist of every layer, radians.
    pub const TWIST: f64 = 0.002 * DEGREE;
    /// Max that is learned: shares, and radians.
    pub const MAX_SHARE: f64 = 0.5;
    pub const MAX_ALPHA: f64 = 30.0 * DEGREE;
    pub const MAX_TWIST: f64 = DEGREE;
    /// Lean of a single layer about each axis of the deposition plane, radians.
    pub const LEAN_NOISE: f64 = 0.003 * DEGREE;
    /// Twist of a single layer, radians.
    pub const TWIST_NOISE: f64 = 0.001 * DEGREE;
}

/// The systematic errors of the robot, the same in every layer, as far as they have been learned.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SystematicErrors {
    /// Over-deposition, a share of the height; negative for under-deposition.
    pub growth: f64,
    /// How much more layers tilt than asked for, a share.
    pub tilt: f64,
    /// Offset of the deposition angle, radians.
    pub alpha: f64,
    /// Twist of each layer, radians.
    pub twist: f64,
}

impl SystematicErrors {
    /// Nothing beyond what a robot can do: no more is learned from sensors that are broken.
    fn within_reason(&self) -> Self {
        Self {
            growth: self.growth.clamp(-assumed::MAX_SHARE, assumed::MAX_SHARE),
            tilt: self.tilt.clamp(-assumed::MAX_SHARE, assumed::MAX_SHARE),
            alpha: self.alpha.clamp(-assumed::MAX_ALPHA, assumed::MAX_ALPHA),
            twist: self.twist.clamp(-assumed::MAX_TWIST, assumed::MAX_TWIST),
        }
    }

    /// The layer that comes out when this one is commanded, and the twist after it.
    fn of(&self, commanded: &Layer, growth: f64) -> (Layer, f64) {
        let tilt = commanded.tilt * (1.0 + self.tilt);
        (Layer { alpha: commanded.alpha + self.alpha, height: growth, tilt }, self.twist)
    }

    /// `base_from_tip` after a layer that is commanded so.
    pub fn lay(&self, base_from_tip: &Frame, commanded: &Layer) -> Frame {
        self.lay_grown(base_from_tip, commanded, commanded.height * (1.0 + self.growth))
    }

    fn lay_grown(&self, base_from_tip: &Frame, commanded: &Layer, growth: f64) -> Frame {
        let (layer, twist) = self.of(commanded, growth);
        let mut next = base_from_tip * step(layer.alpha, layer.tilt, layer.height);
        if twist != 0.0 {
            next.rotation *= rotation(&(Vector3::z() * twist));
        }
        next
    }
}

/// Where the tip is, and what is known of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimator {
    noise: SensorNoise,
    base_from_tip: Frame,
    systematic: SystematicErrors,
    covariance: Covariance,
    /// Of the growth's bias.
    bias_variance: f64,
    /// Of the growth of a single layer, a share squared.
    growth_variance: f64,
    /// Layers since the odometry last said something: growth and variance that are reckoned with, mm.
    unmeasured: (f64, f64),
}

impl Estimator {
    /// A tip that is known to be there.
    pub fn new(base_from_tip: Frame, noise: SensorNoise) -> Self {
        let mut covariance = Covariance::zeros();
        covariance[(TILT_GAIN, TILT_GAIN)] = square(assumed::TILT_GAIN);
        covariance[(ALPHA, ALPHA)] = square(assumed::ALPHA);
        covariance[(TWIST, TWIST)] = square(assumed::TWIST);
        Self {
            noise,
            base_from_tip,
            systematic: SystematicErrors::default(),
            covariance,
            bias_variance: square(assumed::GROWTH_BIAS),
            growth_variance: square(assumed::GROWTH),
            unmeasured: (0.0, 0.0),
        }
    }

    /// Where the tip is.
    pub fn base_from_tip(&self) -> &Frame {
        &self.base_from_tip
    }

    /// What has been learned.
    pub fn systematic(&self) -> &SystematicErrors {
        &self.systematic
    }

    /// Standard deviation of the position, mm: the root of the sum over the axes.
    pub fn position_deviation(&self) -> f64 {
        libm::sqrt((0..3).map(|axis| self.covariance[(axis, axis)]).sum())
    }

    /// Standard deviation of the direction of growth, radians: the root of the sum over the two axes across it.
    pub fn direction_deviation(&self) -> f64 {
        let attitude = self.covariance.fixed_view::<3, 3>(3, 3);
        let direction = self.direction();
        libm::sqrt((attitude.trace() - direction.dot(&(attitude * direction))).max(0.0))
    }

    fn direction(&self) -> Vector3<f64> {
        self.base_from_tip.rotation * Vector3::z()
    }

    /// A layer has been laid, as commanded, and measured. How far the tip has grown, mm, by all that is known.
    pub fn laid(&mut self, commanded: &Layer, measured: &Measurement) -> f64 {
        let (growth, variance, correction) =
            self.odometry(commanded, measured.growth.filter(|grown| grown.is_finite()));
        self.predict(commanded, growth, variance);
        self.base_from_tip.translation.vector += self.direction() * correction;
        if let Some(direction) = measured.direction.and_then(unit) {
            self.see_direction(&direction);
        }
        if let Some(up) = measured.up.and_then(unit) {
            self.see_up(&up);
        }
        growth + correction
    }

    /// Growth of the layer and its variance, mm and mm^2; and what the layers before it, which were not measured, grew
    /// besides.
    fn odometry(&mut self, commanded: &Layer, measured: Option<f64>) -> (f64, f64, f64) {
        let height = commanded.height;
        let expected = height * (1.0 + self.systematic.growth);
        let variance = square(height) * self.growth_variance;
        let (before, before_variance) = self.unmeasured;
        let Some(measured) = measured else {
            self.unmeasured = (before + expected, before_variance + variance);
            return (expected, variance, 0.0);
        };
        self.unmeasured = (0.0, 0.0);
        let noise = square(height * self.noise.odometry);
        let innovation = measured - before - expected;
        let all = variance + before_variance;
        if height > 0.0 && before == 0.0 {
            self.learn_growth(innovation / height, square(self.noise.odometry));
        }
        let share = all / (all + noise).max(f64::MIN_POSITIVE);
        let correction = share * innovation;
        let left = share * noise;
        // What the layers before have to bear of it was added to the position's variance with each of them.
        let own = if all > 0.0 { variance / all } else { 1.0 };
        (expected + own * correction, left, (1.0 - own) * correction)
    }

    /// A layer grew by this share of its height more than expected; the odometry's variance is a share squared.
    fn learn_growth(&mut self, innovation: f64, odometry: f64) {
        self.bias_variance += square(assumed::GROWTH_BIAS_DRIFT);
        let variance = self.bias_variance + self.growth_variance + odometry;
        let gain = self.bias_variance / variance;
        self.systematic.growth += gain * innovation;
        self.systematic = self.systematic.within_reason();
        self.bias_variance *= 1.0 - gain;
        // One that is far off is no more than three times the noise.
        let noise = (square(innovation) - odometry - self.bias_variance).min(9.0 * self.growth_variance);
        let found = self.growth_variance + (noise - self.growth_variance) / assumed::GROWTH_WINDOW;
        self.growth_variance = found.max(square(assumed::GROWTH_MIN));
    }

    fn predict(&mut self, commanded: &Layer, growth: f64, growth_variance: f64) {
        let before = self.base_from_tip;
        let after = self.systematic.lay_grown(&before, commanded, growth);
        let (layer, _) = self.systematic.of(commanded, growth);
        let moved = after.translation.vector - before.translation.vector;
        let (sine, cosine) = trigonometry::sin_cos(layer.alpha);
        // The tip turns about this axis, by the tilt; and about the other one where the deposition angle is off.
        let turns = before.rotation * Vector3::new(sine, -cosine, 0.0) * commanded.tilt;
        let strays = before.rotation * Vector3::new(cosine, sine, 0.0) * layer.tilt;
        let twists = after.rotation * Vector3::z();

        let mut change = Covariance::identity();
        change.fixed_view_mut::<3, 3>(0, 3).copy_from(&-moved.cross_matrix());
        for (error, turn) in [(TILT_GAIN, turns), (ALPHA, strays), (TWIST, twists)] {
            change.fixed_view_mut::<3, 1>(3, error).copy_from(&turn);
            // Half of the turn is made on the way.
            change.fixed_view_mut::<3, 1>(0, error).copy_from(&(turn.cross(&moved) * 0.5));
        }
        self.covariance = change * self.covariance * change.transpose();
        let along = moved.try_normalize(0.0).unwrap_or_else(|| self.direction());
        let mut position = self.covariance.fixed_view_mut::<3, 3>(0, 0);
        position += along * along.transpose() * growth_variance;
        let (lean, twist) = (square(assumed::LEAN_NOISE), square(assumed::TWIST_NOISE));
        let mut attitude = self.covariance.fixed_view_mut::<3, 3>(3, 3);
        attitude += SMatrix::<f64, 3, 3>::identity() * lean + twists * twists.transpose() * (twist - lean);
        self.base_from_tip = after;
    }

    /// The direction of growth, measured in the base's frame.
    fn see_direction(&mut self, direction: &Vector3<f64>) {
        let rotation = self.base_from_tip.rotation;
        let (x, y) = (rotation * Vector3::x(), rotation * Vector3::y());
        // An error w turns the direction d by w x d: along x by w.y, along y by -w.x.
        self.see([(y, x.dot(direction)), (-x, y.dot(direction))]);
    }

    /// The direction upwards, measured in the tip's frame.
    fn see_up(&mut self, up: &Vector3<f64>) {
        let seen = self.base_from_tip.rotation * up;
        // An error w shows as z - w x z.
        self.see([(-Vector3::y(), seen.x), (Vector3::x(), seen.y)]);
    }

    /// Two numbers, each of which shows the attitude's error along an axis.
    fn see(&mut self, seen: [(Vector3<f64>, f64); 2]) {
        let mut found = Errors::zeros();
        for (axis, value) in seen {
            let toward = self.covariance.fixed_view::<ERRORS, 3>(0, 3) * axis;
            let variance = axis.dot(&toward.fixed_rows::<3>(3)) + square(self.noise.direction);
            if variance > 0.0 {
                let innovation = value - axis.dot(&found.fixed_rows::<3>(3));
                found += toward * (innovation / variance);
                self.covariance -= toward * toward.transpose() / variance;
            }
        }
        self.base_from_tip.translation.vector += found.fixed_rows::<3>(0);
        let turned = rotation(&found.fixed_rows::<3>(3).into_owned()) * self.base_from_tip.rotation;
        self.base_from_tip.rotation = orthonormal(&turned);
        self.systematic.tilt += found[TILT_GAIN];
        self.systematic.alpha += found[ALPHA];
        self.systematic.twist += found[TWIST];
        self.systematic = self.systematic.within_reason();
    }
}

fn square(value: f64) -> f64 {
    value * value
}

fn unit(vector: Vector3<f64>) -> Option<Vector3<f64>> {
    vector.iter().all(|part| part.is_finite()).then_some(vector)?.try_normalize(1e-9)
}

/// The rotation by a vector: about it, by its length (Rodrigues).
pub fn rotation(by: &Vector3<f64>) -> Rotation3<f64> {
    let angle = by.norm();
    let Some(axis) = by.try_normalize(0.0) else { return Rotation3::identity() };
    let (sine, cosine) = trigonometry::sin_cos(angle);
    let matrix =
        nalgebra::Matrix3::identity() * cosine + axis.cross_matrix() * sine + axis * axis.transpose() * (1.0 - cosine);
    Rotation3::from_matrix_unchecked(matrix)
}

/// The rotation without what rounding has added to it.
fn orthonormal(rotation: &Rotation3<f64>) -> Rotation3<f64> {
    let matrix = rotation.matrix();
    let z = matrix.column(2).normalize();
    let x = matrix.column(0).into_owned();
    let x = (x - z * z.dot(&x)).normalize();
    Rotation3::from_matrix_unchecked(nalgebra::Matrix3::from_columns(&[x, z.cross(&x), z]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::{degrees, radians};
    use crate::pose::{Pose, angle_between, tip_direction};
    use crate::simulation::{DirectionSensor, Disturbance, Sensors};

    const NOISE: SensorNoise = SensorNoise { odometry: 0.01, direction: 0.0087 };

    fn start() -> Frame {
        Pose::from_degrees([0.0, 0.0, 0.0, 20.0, 30.0]).unwrap().frame()
    }

    /// A bend, a line and a bend to another side, twice over.
    fn layers() -> impl Iterator<Item = Layer> {
        (0..800).map(|index| match index / 100 % 4 {
            0 => Layer { alpha: 1.0, height: 0.77, tilt: 0.0077 },
            2 => Layer { alpha: 3.0, height: 0.77, tilt: 0.0077 },
            _ => Layer { alpha: 0.0, height: 0.77, tilt: 0.0 },
        })
    }

    /// The estimate and the truth after all layers.
    fn follow(disturbance: &Disturbance, direction: DirectionSensor, seed: u64) -> (Estimator, Frame) {
        let sensors = Sensors { noise: NOISE, odometry_scale: 0.0, direction };
        let (mut estimator, mut truth) = (Estimator::new(start(), NOISE), start());
        for (index, layer) in (0..).zip(layers()) {
            let laid = disturbance.lay(seed, index, &layer);
            truth *= laid.step();
            estimator.laid(&layer, &sensors.measure(seed, index, &layer, &laid, &truth));
        }
        (estimator, truth)
    }

    fn off(estimator: &Estimator, truth: &Frame) -> (f64, f64) {
        let position = (estimator.base_from_tip().translation.vector - truth.translation.vector).norm();
        (position, angle_between(&estimator.direction(), &tip_direction(truth)))
    }

    #[test]
    fn what_it_does_not_know_is_as_much_as_it_says() {
        let disturbance = Disturbance { growth_noise: 0.1, tilt_noise: radians(0.005), ..Disturbance::default() };
        let (mut position, mut direction) = (0.0, 0.0);
        for seed in 0..60 {
            let (estimator, truth) = follow(&disturbance, DirectionSensor::Tip, seed);
            let (distance, angle) = off(&estimator, &truth);
            position += square(distance / estimator.position_deviation()) / 60.0;
            direction += square(angle / estimator.direction_deviation()) / 60.0;
        }
        assert!((0.5..1.5).contains(&position) && (0.5..1.5).contains(&direction), "{position} {direction}");
    }

    #[test]
    fn systematic_errors_are_learned() {
        let disturbance = Disturbance {
            growth_noise: 0.1,
            growth_bias: 0.05,
            tilt_bias: -0.04,
            alpha_bias: radians(3.0),
            twist_bias: radians(0.005),
            ..Disturbance::default()
        };
        for direction in [DirectionSensor::Tip, DirectionSensor::Gravity] {
            let (estimator, _) = follow(&disturbance, direction, 1);
            let SystematicErrors { growth, tilt, alpha, twist } = *estimator.systematic();
            assert!((growth - 0.05).abs() < 0.01, "{growth}");
            assert!((tilt + 0.04).abs() < 0.005, "{tilt}");
            assert!((degrees(alpha) - 3.0).abs() < 0.5, "{alpha}");
            assert!((degrees(twist) - 0.005).abs() < 0.002, "{twist}");
        }
    }

    #[test]
    fn gravity_tells_no_heading_and_the_estimate_says_so() {
        let twisting = Disturbance { twist_noise: radians(0.2), ..Disturbance::default() };
        let (by_tip, _) = follow(&twisting, DirectionSensor::Tip, 1);
        let (by_gravity, truth) = follow(&twisting, DirectionSensor::Gravity, 1);
        let (blind, seeing) = (by_gravity.direction_deviation(), by_tip.direction_deviation());
        assert!(blind > 1.5 * seeing, "{blind} {seeing}");
        // What gravity does tell is the pitch.
        let (pitch, true_pitch) = (by_gravity.direction().z, tip_direction(&truth).z);
        assert!((pitch - true_pitch).abs() < 0.005, "{pitch} {true_pitch}");
        // Without errors of the robot the heading is that of dead reckoning.
        let (estimator, truth) = follow(&Disturbance::default(), DirectionSensor::Gravity, 1);
        assert!(degrees(off(&estimator, &truth).1) < 1.0);
    }

    #[test]
    fn odometry_that_comes_seldom_covers_the_layers_between() {
        let layer = Layer { alpha: 0.0, height: 0.77, tilt: 0.0 };
        let mut estimator = Estimator::new(start(), NOISE);
        for index in 1..=100 {
            let growth = (index % 5 == 0).then_some(5.0 * 0.8);
            estimator.laid(&layer, &Measurement { growth, ..Measurement::default() });
        }
        let grown = (estimator.base_from_tip().translation.vector - start().translation.vector).norm();
        assert!((grown - 80.0).abs() < 0.3, "{grown}");
    }

    #[test]
    fn what_is_no_measurement_is_passed_over() {
        let layer = Layer { alpha: 1.0, height: 0.77, tilt: 0.005 };
        let nothing = Measurement {
            growth: Some(f64::NAN),
            direction: Some(Vector3::new(f64::INFINITY, 0.0, 0.0)),
            up: Some(Vector3::zeros()),
        };
        let (mut told_nonsense, mut told_nothing) = (Estimator::new(start(), NOISE), Estimator::new(start(), NOISE));
        for _ in 0..10 {
            told_nonsense.laid(&layer, &nothing);
            told_nothing.laid(&layer, &Measurement::default());
        }
        assert_eq!(told_nonsense, told_nothing);
    }
}
