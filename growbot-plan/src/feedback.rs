//! Feedback of a growth: estimates the tip from the measurements of each layer, and plans the remaining layers again
//! from this estimate.
//!
//! [`Tracker`] contains the estimate and the new plan; this module converts its input and output.
//! [`Feedback::record_layer`] converts pulses of the filament's encoder to mm of growth, and gravity to a direction.
//! [`Feedback::replan_rest`] converts the rest of the path to layers in the bytes of the link. `growbot_client::growth`
//! decides which of these layers are sent to the board, and when.
//!
//! From a layer to an amendment:
//!
//! | from | to | where | how |
//! |---|---|---|---|
//! | a laid layer | `LayerReadings` | the board's controller | encoder and gravity, read when the layer is committed |
//! | `LayerReadings` | `LayerLaid` | the board's controller | for the latest 16 layers; not in the journal |
//! | `LayerLaid` | growth and direction | here | pulses to mm of body; gravity to a direction |
//! | growth, direction | estimate, rest of the path | [`growbot_core::tracking`] | filter and reference trajectory |
//! | rest of the path | layers in bytes, a plan id | here | as for a new job |
//! | layers, plan id | `Amend`, `AppendLayers` | `growbot_client::growth` | from the first layer that can still be changed |
//! | an amendment | line of the run log | [`crate::run_log`] | before it is sent |
//!
//! A board that restarted counts pulses from 0. The host therefore reads the encoder while no filament is fed and
//! stores the reading with the boot number of the board ([`EncoderReference`]). Layers that were laid without such a
//! reference get their expected growth. The tracker receives the layer as built, from the steps that were really made,
//! as the commanded layer. The rounding of the units (0.7 % of robot A's layer by its encoder, a thousandth of gravity)
//! is added to the noise of the sensors.

use growbot_core::job::plan_id;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, LayerEncoder, decode};
use growbot_core::link::message::LayerReadings;
use growbot_core::path::{Leg, Segment, length};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_core::simulation::ErrorModel;
use growbot_core::tracking::{Estimate, MeasuredQuantities, Measurement, SensorNoise, Tracker};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

use crate::arrival::Arrival;
use crate::clearance_guard::{ClearanceGuard, ClearanceViolation, Detour, SceneContext};
use crate::plan::Plan;
use crate::robot_kind::RobotKind;

/// Reports whether a robot has a sensor for feedback: an encoder of the filament, or an orientation sensor.
pub fn can_measure(robot: &Robot) -> bool {
    let sensors = &robot.description().sensors;
    sensors.filament_motion.is_some() || sensors.orientation
}

/// Default noise of a robot's sensors, as standard deviations: 1 % of a layer's growth for odometry, half a degree for
/// a direction.
pub const DEFAULT_SENSOR_NOISE: SensorNoise =
    SensorNoise { odometry: 0.01, direction: 0.5 * std::f64::consts::PI / 180.0 };

/// Returns the noise that the feedback assumes if the user gives none. Simulated sensors measure exactly unless they
/// are given noise, and real ones have [`DEFAULT_SENSOR_NOISE`].
pub fn assumed_noise(kind: RobotKind) -> SensorNoise {
    match kind {
        RobotKind::Real => DEFAULT_SENSOR_NOISE,
        RobotKind::Simulated => ErrorModel::default().noise,
    }
}

/// Standard deviation of the rounding error of a value that is rounded to whole units, in these units: the root of
/// 1/12.
const ROUNDING_STD_DEV: f64 = 0.288_675_134_594_812_9;
/// Unit of the gravity that the board reports, g.
const MILLI_G: f64 = 1e-3;

/// Feedback of one growth.
#[derive(Debug, Clone)]
pub struct Feedback<'a> {
    robot: &'a Robot,
    tracker: Tracker<'a>,
    /// Check that the rest of the path is clear of all obstacles. `None` without a scene.
    guard: Option<ClearanceGuard<'a>>,
    /// Growth per pulse of the filament's encoder, mm. `None` without an encoder.
    mm_per_pulse: Option<f64>,
    /// Reading of the encoder at the last measured layer, pulses. `None` without a reading.
    counted: Option<u32>,
    /// Expected growth of the layers since the reading `counted`, mm.
    expected: f64,
    /// Index of the first layer after the latest [`EncoderReference`].
    counts_from: u32,
    /// Expected growth of layers that the encoder has not measured, mm. It is added to the growth of the next measured
    /// layer.
    uncounted: f64,
    /// Number of laid layers that were recorded by `record_layer`.
    laid: u32,
    /// Boot number of the board at the latest [`EncoderReference`].
    boot_id: Option<u32>,
    amendments: u32,
    /// Position of the start, followed by the estimated position of the tip after each layer, mm.
    path: Vec<Vector3<f64>>,
}

/// The remaining layers of a job, planned again.
#[derive(Debug, Clone, PartialEq)]
pub struct Correction {
    /// The remaining layers.
    pub layers: Vec<LayerBytes>,
    /// New path of the remaining layers, if the previous path was too near to an obstacle.
    pub detour: Option<Detour>,
}

/// A reading of the filament's encoder from which the feedback measures growth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct EncoderReference {
    /// Boot number of the board when the encoder was read.
    pub boot_id: u32,
    /// Number of layers that were laid before the reading.
    pub laid: u32,
    /// The reading, pulses. Null without an encoder.
    #[serde(default, deserialize_with = "crate::run_log::lenient")]
    pub filament_pulses: Option<u32>,
}

/// Result of the feedback of a growth.
#[derive(Debug, Clone, PartialEq)]
pub struct FeedbackReport {
    /// Number of amendments of the job.
    pub amendments: u32,
    /// Estimate of the tip from all measurements.
    pub estimate: Estimate,
    /// Position of the start, followed by the position of the tip after each layer as it was estimated after that
    /// layer, mm.
    pub path: Vec<Vector3<f64>>,
}

impl FeedbackReport {
    /// Returns the estimated pose of the tip and its errors from the goal of a plan.
    pub fn arrival(&self, plan: &Plan) -> Arrival {
        Arrival::of(&self.estimate.base_from_tip, &plan.goal, length(&plan.path))
    }
}

impl<'a> Feedback<'a> {
    /// Creates the feedback before the first layer of a path. `noise` is the noise of the sensors without rounding. The
    /// rounding to the units in which the board reports is added.
    pub fn new(robot: &'a Robot, start: &Pose, path: &'a [Segment], legs: &'a [Leg], noise: SensorNoise) -> Self {
        let description = robot.description();
        let filament_per_length = robot.feed_steps_per_length() / description.feed.steps_per_mm;
        let mm_per_pulse = description.sensors.filament_motion.map(|motion| motion.mm_per_pulse / filament_per_length);
        // The growth of a layer is the difference of two counts, each of which is rounded.
        let counts =
            mm_per_pulse.unwrap_or(0.0) * ROUNDING_STD_DEV * std::f64::consts::SQRT_2 / description.layer.height_mm;
        let noise = SensorNoise {
            odometry: libm::hypot(noise.odometry, counts),
            direction: libm::hypot(noise.direction, MILLI_G * ROUNDING_STD_DEV),
        };
        Self {
            robot,
            tracker: Tracker::new(robot, start, path, legs, noise),
            guard: None,
            mm_per_pulse,
            counted: None,
            expected: 0.0,
            counts_from: 0,
            uncounted: 0.0,
            laid: 0,
            boot_id: None,
            amendments: 0,
            path: vec![start.position()],
        }
    }

    /// Adds a scene. Each correction is then checked to stay clear of the scene's obstacles before it is sent to a
    /// board.
    #[must_use]
    pub fn with_scene(mut self, around: &'a SceneContext<'a>) -> Self {
        let growth = self.mm_per_pulse.is_some();
        let up = self.robot.description().sensors.orientation;
        self.guard = Some(ClearanceGuard::new(around, MeasuredQuantities { growth, direction: false, up }));
        self
    }

    /// Checks that the growth can begin: the plan, or the detour that the first correction will take, must stay clear
    /// of all obstacles by the expected uncertainty of the tip.
    ///
    /// # Errors
    /// If the plan or detour does not stay clear.
    pub fn check_start(&self) -> Result<(), ClearanceViolation> {
        let mut trial = self.clone();
        let Self { guard: Some(guard), tracker, .. } = &mut trial else { return Ok(()) };
        guard.ensure_clear(tracker, &[]).map(drop)
    }

    /// Reports whether the latest [`EncoderReference`] was read since the board's start with this boot number.
    pub fn counts_since_boot(&self, boot_id: u32) -> bool {
        self.boot_id == Some(boot_id)
    }

    /// Sets the reading of the encoder from which growth is measured from now on. It must be taken while no filament is
    /// fed. Laid layers that were not measured count with their expected growth.
    pub fn set_encoder_reference(&mut self, count: &EncoderReference) {
        self.uncounted += std::mem::take(&mut self.expected);
        (self.boot_id, self.counts_from, self.counted) = (Some(count.boot_id), count.laid, count.filament_pulses);
    }

    /// Records that the next layer has been laid. `layer` is the layer as built if known, and as commanded otherwise.
    /// `measured` are the readings of the board's sensors after the layer.
    pub fn record_layer(&mut self, layer: &LayerBytes, measured: Option<&LayerReadings>) {
        let layer = decode(layer);
        let measured = measured.copied().unwrap_or_default();
        let growth = self.growth(&layer, measured.filament_pulses);
        self.laid += 1;
        let up = measured.gravity_milli_g.map(|[x, y, z]| Vector3::new(x, y, z).map(|part| f64::from(part) * MILLI_G));
        self.tracker.record_layer(&layer, &Measurement { growth, direction: None, up });
        self.path.push(self.tracker.estimate().base_from_tip.translation.vector);
        if let Some(guard) = &mut self.guard {
            guard.record_layer(&layer, &self.tracker.estimate().systematic_errors);
        }
    }

    /// Returns the growth of the tip since the last measured layer, mm. `None` if the encoder did not measure this
    /// layer.
    fn growth(&mut self, layer: &Layer, pulses: Option<u32>) -> Option<f64> {
        let expected = layer.height * (1.0 + self.tracker.estimate().systematic_errors.growth);
        if self.laid < self.counts_from {
            self.uncounted += expected;
            return None;
        }
        self.expected += expected;
        let (mm_per_pulse, pulses) = (self.mm_per_pulse?, pulses?);
        let from = self.counted.replace(pulses);
        let expected = std::mem::take(&mut self.expected);
        let uncounted = std::mem::take(&mut self.uncounted);
        // Counts wrap around. A difference is negative after filament was retracted.
        let counted = from.map(|from| f64::from(pulses.wrapping_sub(from).cast_signed()) * mm_per_pulse);
        Some(uncounted + counted.unwrap_or(expected))
    }

    /// Plans the remaining layers again. They start at the forecast pose of the tip after the layers `under_way`, which
    /// can no longer be changed.
    ///
    /// # Errors
    /// In a scene, if the remaining layers would be too near to an obstacle and no detour was found.
    pub fn replan_rest(&mut self, under_way: &[LayerBytes]) -> Result<Correction, ClearanceViolation> {
        let under_way: Vec<Layer> = under_way.iter().map(decode).collect();
        self.tracker.replan(&under_way);
        let detour = match &mut self.guard {
            Some(guard) => guard.ensure_clear(&mut self.tracker, &under_way)?,
            None => None,
        };
        let mut encoder = LayerEncoder::default();
        let layers = self
            .tracker
            .remaining_layers()
            .map(|layer| encoder.encode_clamped(&layer, self.robot.tip_radius()))
            .collect();
        Ok(Correction { layers, detour })
    }

    /// Returns the plan id of a job that consists of these layers. Laid layers must be given as commanded, not as
    /// built.
    pub fn plan_id(&self, layers: &[LayerBytes]) -> u64 {
        plan_id(self.robot, layers)
    }

    /// Records that the job has been amended.
    pub fn record_amendment(&mut self) {
        self.amendments += 1;
    }

    /// Returns the number of amendments of the job.
    pub fn amendments(&self) -> u32 {
        self.amendments
    }

    /// Returns the number of amendments so far and the current estimate of the tip.
    pub fn result(&self) -> FeedbackReport {
        FeedbackReport { amendments: self.amendments, estimate: self.tracker.estimate(), path: self.path.clone() }
    }
}

#[cfg(test)]
mod tests {
    use growbot_core::layer::grow;
    use growbot_core::path::end;

    use super::*;

    const EXACT: SensorNoise = SensorNoise { odometry: 0.0, direction: 0.0 };
    /// Growth of a layer, mm. `PULSES` is this growth in pulses of robot A's encoder.
    const HEIGHT: f64 = 0.774;
    const PULSES: f64 = 56.935;

    /// An upright path of this many layers.
    struct Upright {
        robot: Robot,
        start: Pose,
        path: [Segment; 1],
        legs: [Leg; 1],
    }

    impl Upright {
        fn new(layers: u32) -> Self {
            let path = [Segment::Straight { length: HEIGHT * f64::from(layers) }];
            let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
            let legs = [Leg { goal: Pose::from_frame(&end(&path, &start.frame())), segment_count: 1 }];
            Self { robot: crate::robot_file::load("growbot-a".as_ref()).unwrap(), start, path, legs }
        }

        /// Returns the feedback of the path and one of its layers.
        fn feedback(&self) -> (Feedback<'_>, LayerBytes) {
            let layer = LayerEncoder::default().encode(&Layer { alpha: 0.0, height: HEIGHT, tilt: 0.0 });
            (Feedback::new(&self.robot, &self.start, &self.path, &self.legs, EXACT), layer)
        }
    }

    fn counted(pulses: u32) -> LayerReadings {
        LayerReadings { filament_pulses: Some(pulses), gravity_milli_g: Some([0, 0, 1000]) }
    }

    fn height(feedback: &Feedback) -> f64 {
        feedback.result().estimate.base_from_tip.translation.z
    }

    fn count(boot_id: u32, laid: u32, pulses: u32) -> EncoderReference {
        EncoderReference { boot_id, laid, filament_pulses: Some(pulses) }
    }

    #[test]
    fn growth_is_computed_from_pulses_with_any_offset_and_gaps() {
        let upright = Upright::new(200);
        let (mut feedback, layer) = upright.feedback();
        // The count wraps within the first layers.
        let before = u32::MAX - 100;
        feedback.set_encoder_reference(&count(1, 0, before));
        for index in 1..=100 {
            let pulses = before.wrapping_add((1.1 * PULSES * f64::from(index)) as u32);
            feedback.record_layer(&layer, (index % 7 != 0).then_some(counted(pulses)).as_ref());
        }
        let grown = 1.1 * HEIGHT * 100.0;
        assert!((height(&feedback) / grown - 1.0).abs() < 0.002, "{} {grown}", height(&feedback));
        assert!((feedback.result().estimate.systematic_errors.growth - 0.1).abs() < 0.01);
        // The remaining layers are commanded lower, and end at the planned height.
        let rest = feedback.replan_rest(&[]).unwrap().layers;
        let end = grow(&feedback.result().estimate.base_from_tip, rest.iter().map(decode));
        let commanded = end.translation.z - height(&feedback);
        assert!((1.1 * commanded + height(&feedback) - 200.0 * HEIGHT).abs() < 0.5, "{commanded}");
    }

    #[test]
    fn a_restarted_pulse_count_adds_no_growth() {
        let upright = Upright::new(200);
        let (mut feedback, layer) = upright.feedback();
        feedback.set_encoder_reference(&count(1, 0, 7));
        assert!(feedback.counts_since_boot(1) && !feedback.counts_since_boot(2));
        for index in 1..=50 {
            feedback.record_layer(&layer, Some(&counted(7 + (PULSES * f64::from(index)) as u32)));
        }
        // Ten more layers were laid before the board restarted, without any reading.
        feedback.set_encoder_reference(&count(2, 60, 2));
        for _ in 0..10 {
            feedback.record_layer(&layer, None);
        }
        for index in 1..=40 {
            feedback.record_layer(&layer, Some(&counted(2 + (PULSES * f64::from(index)) as u32)));
        }
        assert!((height(&feedback) - 100.0 * HEIGHT).abs() < 0.05, "{}", height(&feedback));
        assert!(feedback.result().estimate.systematic_errors.growth.abs() < 0.005);
    }

    #[test]
    fn a_job_of_the_planned_layers_has_the_plan_id_of_the_plan() {
        let upright = Upright::new(20);
        let (feedback, _) = upright.feedback();
        let path = [Segment::Arc { alpha: 1.0, bend: 0.5, length: 60.0 }];
        let layers: Vec<LayerBytes> = growbot_core::job::job_layers(&path, &upright.robot).collect();
        assert_eq!(feedback.plan_id(&layers), growbot_core::job::summarize(&path, &upright.robot).plan_id);
    }
}
