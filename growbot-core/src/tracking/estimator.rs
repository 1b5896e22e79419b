//! The estimate of the tip: dead reckoning from the layers as commanded, corrected by measurements.
//!
//! The estimator is an extended Kalman filter (Kalman 1960). Its nine errors are those of the position (3), of the
//! attitude (3), and of three systematic errors that it learns: tilt gain, offset of the deposition angle, twist. The
//! error of the attitude is a small rotation in the base's frame (Sola 2017, section 7), so that it stays constant
//! while the tip turns. The fourth systematic error, that of the growth, is learned by a separate filter from the
//! odometry.

use nalgebra::{Rotation3, SMatrix, SVector, Vector3};

use super::measurement::{MeasuredQuantities, Measurement, SensorNoise};
use crate::kinematics::step;
use crate::layer::Layer;
use crate::pose::Frame;
use crate::trigonometry;

/// Number of the filter's errors: position (3), attitude (3), tilt gain, deposition angle, twist.
const ERRORS: usize = 9;
const TILT_GAIN: usize = 6;
const ALPHA: usize = 7;
const TWIST: usize = 8;

type Covariance = SMatrix<f64, ERRORS, ERRORS>;
type Errors = SVector<f64, ERRORS>;

/// Standard deviations that are assumed for any robot before the first measurement.
mod prior {
    use core::f64::consts::PI;

    const DEGREE: f64 = PI / 180.0;
    /// Standard deviation of the systematic error of the growth, as a fraction of the layer's height.
    /// [`GROWTH_BIAS_DRIFT`] is that of its change from layer to layer.
    pub const GROWTH_BIAS: f64 = 0.1;
    pub const GROWTH_BIAS_DRIFT: f64 = 1e-4;
    /// Initial standard deviation of the random error of a single layer's growth, as a fraction of the layer's height.
    /// The filter estimates the later values, which never fall below [`GROWTH_MIN`].
    pub const GROWTH: f64 = 0.06;
    pub const GROWTH_MIN: f64 = 1e-3;
    /// Number of layers over which the variance of a single layer's growth is estimated.
    pub const GROWTH_WINDOW: f64 = 100.0;
    /// Standard deviation of the systematic error of the tilt, as a fraction of the tilt.
    pub const TILT_GAIN: f64 = 0.05;
    /// Standard deviation of the systematic error of the deposition angle, radians.
    pub const ALPHA: f64 = 2.0 * DEGREE;
    /// Standard deviation of the systematic twist, which is the same in every layer, radians.
    pub const TWIST: f64 = 0.002 * DEGREE;
    /// Max systematic error of growth and of tilt that the filter learns, as a fraction. [`MAX_ALPHA`] and
    /// [`MAX_TWIST`] are the limits for the deposition angle and the twist, radians.
    pub const MAX_SHARE: f64 = 0.5;
    pub const MAX_ALPHA: f64 = 30.0 * DEGREE;
    pub const MAX_TWIST: f64 = DEGREE;
    /// Standard deviation of the random error of a single layer's tilt, about each axis of the deposition plane,
    /// radians.
    pub const LEAN_NOISE: f64 = 0.003 * DEGREE;
    /// Standard deviation of the random twist of a single layer, radians.
    pub const TWIST_NOISE: f64 = 0.001 * DEGREE;
    /// Number of measured angles, two for each layer, over which the normalised innovation squared (NIS) is averaged.
    pub const NIS_WINDOW: f64 = 60.0;
    /// Max excess of the mean normalised innovation squared (NIS) over 1 that counts as chance. One in some 10,000
    /// growths of a thousand layers exceeds it by chance.
    pub const NIS_EXCESS_BY_CHANCE: f64 = 0.7;
}

/// The systematic errors of the robot, which are the same in every layer, as learned so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SystematicErrors {
    /// Over-deposition, as a fraction of the height. Negative for under-deposition.
    pub growth: f64,
    /// Excess of the tilt, as a fraction of the commanded tilt.
    pub tilt: f64,
    /// Offset of the deposition angle, radians.
    pub alpha: f64,
    /// Twist of each layer about the tip's axis, radians.
    pub twist: f64,
}

impl SystematicErrors {
    /// Returns the systematic errors, each clamped to a max, so that broken sensors cannot lead to larger errors.
    fn clamped(&self) -> Self {
        Self {
            growth: self.growth.clamp(-prior::MAX_SHARE, prior::MAX_SHARE),
            tilt: self.tilt.clamp(-prior::MAX_SHARE, prior::MAX_SHARE),
            alpha: self.alpha.clamp(-prior::MAX_ALPHA, prior::MAX_ALPHA),
            twist: self.twist.clamp(-prior::MAX_TWIST, prior::MAX_TWIST),
        }
    }

    /// Returns the layer that a robot with these systematic errors lays for a commanded layer if the tip grows by
    /// `growth` (mm), and the twist of the tip after this layer (radians).
    fn of(&self, commanded: &Layer, growth: f64) -> (Layer, f64) {
        let tilt = commanded.tilt * (1.0 + self.tilt);
        (Layer { alpha: commanded.alpha + self.alpha, height: growth, tilt }, self.twist)
    }

    /// Returns `base_from_tip` after a commanded layer that a robot with these systematic errors lays.
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

/// The estimate of the tip's frame, its covariance, and the systematic errors.
#[derive(Debug, Clone, PartialEq)]
pub struct Estimator {
    noise: SensorNoise,
    base_from_tip: Frame,
    systematic: SystematicErrors,
    covariance: Covariance,
    /// Variance of the systematic error of the growth, as a squared fraction of the layer's height.
    bias_variance: f64,
    /// Variance of the random error of a single layer's growth, as a squared fraction of the layer's height.
    growth_variance: f64,
    /// Expected growth of the layers since the latest measurement of the odometry.
    unmeasured: UnmeasuredGrowth,
    /// Mean square of the latest innovations of directions, divided by its expected value.
    mean_nis: f64,
}

/// The expected growth of layers that the odometry has not measured yet.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct UnmeasuredGrowth {
    /// Sum of the expected growth, mm.
    growth: f64,
    /// Variance of the expected growth, mm^2.
    variance: f64,
}

/// Growth of a layer, as measured by the odometry or, without a measurement, as expected.
struct MeasuredGrowth {
    /// Growth of the layer, mm.
    growth: f64,
    /// Variance of the growth of the layer, mm^2.
    variance: f64,
    /// Correction of the growth of the unmeasured layers before this layer, mm.
    correction: f64,
}

impl Estimator {
    /// Creates an estimate that begins with a known frame of the tip.
    pub fn new(base_from_tip: Frame, noise: SensorNoise) -> Self {
        let mut covariance = Covariance::zeros();
        covariance[(TILT_GAIN, TILT_GAIN)] = square(prior::TILT_GAIN);
        covariance[(ALPHA, ALPHA)] = square(prior::ALPHA);
        covariance[(TWIST, TWIST)] = square(prior::TWIST);
        Self {
            noise,
            base_from_tip,
            systematic: SystematicErrors::default(),
            covariance,
            bias_variance: square(prior::GROWTH_BIAS),
            growth_variance: square(prior::GROWTH),
            unmeasured: UnmeasuredGrowth::default(),
            mean_nis: 1.0,
        }
    }

    /// Returns the estimated frame of the tip.
    pub fn base_from_tip(&self) -> &Frame {
        &self.base_from_tip
    }

    /// Returns the systematic errors learned so far.
    pub fn systematic(&self) -> &SystematicErrors {
        &self.systematic
    }

    /// Returns the standard deviation of the tip's position, mm: the root of the sum of the variances along the three
    /// axes.
    pub fn position_deviation(&self) -> f64 {
        libm::sqrt((0..3).map(|axis| self.covariance[(axis, axis)]).sum())
    }

    /// Returns the standard deviation of the direction of growth, radians: the root of the sum of the variances about
    /// the two axes perpendicular to it.
    pub fn direction_deviation(&self) -> f64 {
        let attitude = self.covariance.fixed_view::<3, 3>(3, 3);
        let direction = self.direction();
        libm::sqrt((attitude.trace() - direction.dot(&(attitude * direction))).max(0.0))
    }

    /// Returns the factor by which the actual standard deviations exceed those of the covariance. It is 1 for a robot
    /// whose layers and sensors behave as assumed.
    ///
    /// The variance of an innovation is the sum of the variances of the direction's error and of the sensor. So if
    /// innovations exceed the expected ones by more than chance, the excess is due to an error of the direction that
    /// the covariance does not include.
    pub fn sigma_scale(&self) -> f64 {
        let unexpected = self.mean_nis - 1.0;
        if unexpected < prior::NIS_EXCESS_BY_CHANCE {
            return 1.0;
        }
        let variance = (0.5 * square(self.direction_deviation())).max(f64::MIN_POSITIVE);
        libm::sqrt(1.0 + unexpected * (1.0 + square(self.noise.direction) / variance))
    }

    fn direction(&self) -> Vector3<f64> {
        self.base_from_tip.rotation * Vector3::z()
    }

    /// Updates the estimate with a layer that has been laid, as commanded and as measured. Returns the growth of the
    /// tip since the previous call, mm.
    pub fn update(&mut self, commanded: &Layer, measured: &Measurement) -> f64 {
        let MeasuredGrowth { growth, variance, correction } =
            self.odometry(commanded, measured.growth.filter(|grown| grown.is_finite()));
        self.predict(commanded, growth, variance);
        self.base_from_tip.translation.vector += self.direction() * correction;
        if let Some(direction) = measured.direction.and_then(unit) {
            self.update_by_direction(&direction);
        }
        if let Some(up) = measured.up.and_then(unit) {
            self.update_by_up(&up);
        }
        growth + correction
    }

    /// Updates the estimate as a future layer with these kinds of measurement will change it: the covariance as it will
    /// be, and the tip as expected. The systematic errors do not change.
    pub fn forecast_layer(&mut self, commanded: &Layer, seen: MeasuredQuantities) {
        let height = commanded.height;
        let (variance, noise) = (square(height) * self.growth_variance, square(height * self.noise.odometry));
        let left = if seen.growth { variance * noise / (variance + noise).max(f64::MIN_POSITIVE) } else { variance };
        self.predict(commanded, height * (1.0 + self.systematic.growth), left);
        if seen.direction {
            self.update_by_direction(&self.direction());
        }
        if seen.up {
            self.update_by_up(&(self.base_from_tip.rotation.inverse() * Vector3::z()));
        }
    }

    /// Returns the growth of the layer from the odometry's measurement, or the expected growth if there is no
    /// measurement.
    fn odometry(&mut self, commanded: &Layer, measured: Option<f64>) -> MeasuredGrowth {
        let height = commanded.height;
        let expected = height * (1.0 + self.systematic.growth);
        let variance = square(height) * self.growth_variance;
        let before = self.unmeasured;
        let Some(measured) = measured else {
            self.unmeasured =
                UnmeasuredGrowth { growth: before.growth + expected, variance: before.variance + variance };
            return MeasuredGrowth { growth: expected, variance, correction: 0.0 };
        };
        self.unmeasured = UnmeasuredGrowth::default();
        let noise = square(height * self.noise.odometry);
        let innovation = measured - before.growth - expected;
        let all = variance + before.variance;
        if height > 0.0 && before.growth == 0.0 {
            self.learn_growth(innovation / height, square(self.noise.odometry));
        }
        let share = all / (all + noise).max(f64::MIN_POSITIVE);
        let correction = share * innovation;
        let left = share * noise;
        // The fraction for earlier layers has been in the position's variance since each of them.
        let own = if all > 0.0 { variance / all } else { 1.0 };
        MeasuredGrowth { growth: expected + own * correction, variance: left, correction: (1.0 - own) * correction }
    }

    /// Learns the systematic error and the noise of the growth from one layer. `innovation` is the measured minus the
    /// expected growth, as a fraction of the layer's height. `odometry` is the variance of the measurement, a squared
    /// fraction.
    fn learn_growth(&mut self, innovation: f64, odometry: f64) {
        self.bias_variance += square(prior::GROWTH_BIAS_DRIFT);
        let variance = self.bias_variance + self.growth_variance + odometry;
        let gain = self.bias_variance / variance;
        self.systematic.growth += gain * innovation;
        self.systematic = self.systematic.clamped();
        self.bias_variance *= 1.0 - gain;
        // An outlier counts as three standard deviations at most.
        let noise = (square(innovation) - odometry - self.bias_variance).min(9.0 * self.growth_variance);
        let found = self.growth_variance + (noise - self.growth_variance) / prior::GROWTH_WINDOW;
        self.growth_variance = found.max(square(prior::GROWTH_MIN));
    }

    /// Advances the estimate by a layer with this growth (mm) and variance of the growth (mm^2).
    fn predict(&mut self, commanded: &Layer, growth: f64, growth_variance: f64) {
        let before = self.base_from_tip;
        let after = self.systematic.lay_grown(&before, commanded, growth);
        let (layer, _) = self.systematic.of(commanded, growth);
        let moved = after.translation.vector - before.translation.vector;
        let (sine, cosine) = trigonometry::sin_cos(layer.alpha);
        // The tilt turns the tip about the first axis. An offset of the deposition angle turns it about the second
        // axis.
        let turns = before.rotation * Vector3::new(sine, -cosine, 0.0) * commanded.tilt;
        let strays = before.rotation * Vector3::new(cosine, sine, 0.0) * layer.tilt;
        let twists = after.rotation * Vector3::z();

        let mut change = Covariance::identity();
        change.fixed_view_mut::<3, 3>(0, 3).copy_from(&-moved.cross_matrix());
        for (error, turn) in [(TILT_GAIN, turns), (ALPHA, strays), (TWIST, twists)] {
            change.fixed_view_mut::<3, 1>(3, error).copy_from(&turn);
            // While the tip moves, it has made half of the turn on average.
            change.fixed_view_mut::<3, 1>(0, error).copy_from(&(turn.cross(&moved) * 0.5));
        }
        self.covariance = change * self.covariance * change.transpose();
        let along = moved.try_normalize(0.0).unwrap_or_else(|| self.direction());
        let mut position = self.covariance.fixed_view_mut::<3, 3>(0, 0);
        position += along * along.transpose() * growth_variance;
        let (lean, twist) = (square(prior::LEAN_NOISE), square(prior::TWIST_NOISE));
        let mut attitude = self.covariance.fixed_view_mut::<3, 3>(3, 3);
        attitude += SMatrix::<f64, 3, 3>::identity() * lean + twists * twists.transpose() * (twist - lean);
        self.base_from_tip = after;
    }

    /// Updates the estimate with the direction of growth, measured in the base's frame.
    fn update_by_direction(&mut self, direction: &Vector3<f64>) {
        let rotation = self.base_from_tip.rotation;
        let (x, y) = (rotation * Vector3::x(), rotation * Vector3::y());
        // An error w turns the direction d by w x d: along x by w.y, along y by -w.x.
        self.update_attitude([(y, x.dot(direction)), (-x, y.dot(direction))]);
    }

    /// Updates the estimate with the direction upwards, measured in the tip's frame.
    fn update_by_up(&mut self, up: &Vector3<f64>) {
        let seen = self.base_from_tip.rotation * up;
        // An error w appears as z - w x z.
        self.update_attitude([(-Vector3::y(), seen.x), (Vector3::x(), seen.y)]);
    }

    /// Updates the estimate with two measurements of the attitude's error, each as an axis and the component of the
    /// error along it (radians).
    fn update_attitude(&mut self, measured: [(Vector3<f64>, f64); 2]) {
        let mut found = Errors::zeros();
        for (axis, value) in measured {
            let toward = self.covariance.fixed_view::<ERRORS, 3>(0, 3) * axis;
            let variance = axis.dot(&toward.fixed_rows::<3>(3)) + square(self.noise.direction);
            if variance > 0.0 {
                let innovation = value - axis.dot(&found.fixed_rows::<3>(3));
                self.mean_nis += (square(innovation) / variance - self.mean_nis) / prior::NIS_WINDOW;
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
        self.systematic = self.systematic.clamped();
    }
}

fn square(value: f64) -> f64 {
    value * value
}

fn unit(vector: Vector3<f64>) -> Option<Vector3<f64>> {
    vector.iter().all(|part| part.is_finite()).then_some(vector)?.try_normalize(1e-9)
}

/// Returns the rotation about the direction of a vector by the length of the vector, radians (Rodrigues' formula).
pub fn rotation(by: &Vector3<f64>) -> Rotation3<f64> {
    let angle = by.norm();
    let Some(axis) = by.try_normalize(0.0) else { return Rotation3::identity() };
    let (sine, cosine) = trigonometry::sin_cos(angle);
    let matrix =
        nalgebra::Matrix3::identity() * cosine + axis.cross_matrix() * sine + axis * axis.transpose() * (1.0 - cosine);
    Rotation3::from_matrix_unchecked(matrix)
}

/// Returns the rotation as an orthonormal matrix, without accumulated rounding errors.
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
    use crate::simulation::{DirectionSensor, Disturbance, SimulatedSensors};

    const NOISE: SensorNoise = SensorNoise { odometry: 0.01, direction: 0.0087 };

    fn start() -> Frame {
        Pose::from_degrees([0.0, 0.0, 0.0, 20.0, 30.0]).unwrap().frame()
    }

    /// Returns the layers of a bend, a line, a bend in another direction and a line, two times.
    fn layers() -> impl Iterator<Item = Layer> {
        (0..800).map(|index| match index / 100 % 4 {
            0 => Layer { alpha: 1.0, height: 0.77, tilt: 0.0077 },
            2 => Layer { alpha: 3.0, height: 0.77, tilt: 0.0077 },
            _ => Layer { alpha: 0.0, height: 0.77, tilt: 0.0 },
        })
    }

    /// Returns the estimate and the true frame of the tip after all layers.
    fn follow(disturbance: &Disturbance, direction: DirectionSensor, seed: u64) -> (Estimator, Frame) {
        let sensors = SimulatedSensors { noise: NOISE, odometry_scale: 0.0, direction };
        let (mut estimator, mut truth) = (Estimator::new(start(), NOISE), start());
        for (index, layer) in (0..).zip(layers()) {
            let laid = disturbance.lay(seed, index, &layer);
            truth *= laid.step();
            estimator.update(&layer, &sensors.measure(seed, index, &layer, &laid, &truth));
        }
        (estimator, truth)
    }

    fn off(estimator: &Estimator, truth: &Frame) -> (f64, f64) {
        let position = (estimator.base_from_tip().translation.vector - truth.translation.vector).norm();
        (position, angle_between(&estimator.direction(), &tip_direction(truth)))
    }

    #[test]
    fn errors_match_the_standard_deviations() {
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
    fn sigma_scale_grows_with_unmodelled_tilt_noise() {
        let doubt = |tilt_noise| {
            let disturbance = Disturbance { growth_noise: 0.1, tilt_noise, ..Disturbance::default() };
            let doubted = (0..20).map(|seed| follow(&disturbance, DirectionSensor::Tip, seed));
            let (mut error, mut predicted, mut max) = (0.0, 0.0, 0.0_f64);
            for (estimator, truth) in doubted {
                let doubt = estimator.sigma_scale();
                error += square(off(&estimator, &truth).1);
                predicted += square(doubt * estimator.direction_deviation());
                max = max.max(doubt);
            }
            (libm::sqrt(error / predicted), max)
        };
        let (share, max) = doubt(0.0);
        assert!((0.4..1.2).contains(&share) && max < 3.0, "{share} {max}");
        for tilt_noise in [0.1, 0.25, 0.5] {
            let (share, _) = doubt(radians(tilt_noise));
            assert!((0.4..1.5).contains(&share), "{tilt_noise} {share}");
        }
    }

    #[test]
    fn direction_deviation_grows_if_only_gravity_is_measured() {
        let twisting = Disturbance { twist_noise: radians(0.2), ..Disturbance::default() };
        let (by_tip, _) = follow(&twisting, DirectionSensor::Tip, 1);
        let (by_gravity, truth) = follow(&twisting, DirectionSensor::Gravity, 1);
        let (blind, seeing) = (by_gravity.direction_deviation(), by_tip.direction_deviation());
        assert!(blind > 1.5 * seeing, "{blind} {seeing}");
        // Gravity shows the pitch.
        let (pitch, true_pitch) = (by_gravity.direction().z, tip_direction(&truth).z);
        assert!((pitch - true_pitch).abs() < 0.005, "{pitch} {true_pitch}");
        // Without errors of the robot the heading is that of dead reckoning.
        let (estimator, truth) = follow(&Disturbance::default(), DirectionSensor::Gravity, 1);
        assert!(degrees(off(&estimator, &truth).1) < 1.0);
    }

    #[test]
    fn sparse_odometry_covers_the_layers_in_between() {
        let layer = Layer { alpha: 0.0, height: 0.77, tilt: 0.0 };
        let mut estimator = Estimator::new(start(), NOISE);
        for index in 1..=100 {
            let growth = (index % 5 == 0).then_some(5.0 * 0.8);
            estimator.update(&layer, &Measurement { growth, ..Measurement::default() });
        }
        let grown = (estimator.base_from_tip().translation.vector - start().translation.vector).norm();
        assert!((grown - 80.0).abs() < 0.3, "{grown}");
    }

    #[test]
    fn invalid_measurements_are_ignored() {
        let layer = Layer { alpha: 1.0, height: 0.77, tilt: 0.005 };
        let nothing = Measurement {
            growth: Some(f64::NAN),
            direction: Some(Vector3::new(f64::INFINITY, 0.0, 0.0)),
            up: Some(Vector3::zeros()),
        };
        let (mut told_nonsense, mut told_nothing) = (Estimator::new(start(), NOISE), Estimator::new(start(), NOISE));
        for _ in 0..10 {
            told_nonsense.update(&layer, &nothing);
            told_nothing.update(&layer, &Measurement::default());
        }
        assert_eq!(told_nonsense, told_nothing);
    }
}
