//! The closed loop: after each layer it updates the estimate of the tip, and plans the rest of the path from there.

use core::f64::consts::PI;

use nalgebra::Vector2;

use super::estimator::{Estimator, SystematicErrors};
use super::measurement::{MeasuredQuantities, Measurement, SensorNoise};
use super::reference::ReferenceTrajectory;
use crate::angle::wrap_positive;
use crate::layer::Layer;
use crate::path::{Leg, MAX_SEGMENTS, Segment, end};
use crate::plan::GoalError;
use crate::pose::{Frame, Pose};
use crate::robot::Robot;

/// Estimate of the tip from all measurements so far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Estimated frame of the tip, `base_from_tip`.
    pub base_from_tip: Frame,
    /// Standard deviation of the tip's position, mm: the root of the sum of the variances along the three axes.
    pub position_sd: f64,
    /// Standard deviation of the direction of growth, radians: the root of the sum of the variances about the two axes
    /// perpendicular to it.
    pub direction_sd: f64,
    /// Systematic errors of the robot's layers, as learned so far.
    pub systematic_errors: SystematicErrors,
}

/// Controller of a growth, which plans the rest of the path again after each layer.
#[derive(Debug, Clone)]
pub struct Tracker<'a> {
    robot: &'a Robot,
    estimator: Estimator,
    /// The reference trajectory to the next goal. It begins with the next layer that can still be changed.
    reference: ReferenceTrajectory,
    /// Estimated frame of the tip at the beginning of the reference trajectory.
    begins: Frame,
    stages: Stages<'a>,
    /// Number of layers laid.
    laid: u64,
    /// Number of layers that can no longer be changed. The reference trajectory no longer contains them.
    committed: u64,
    /// Difference between the end of the reference trajectory and the next goal.
    miss: GoalError,
}

impl<'a> Tracker<'a> {
    /// Creates a tracker before the first layer. The path leads from the start through the goals of its legs. The
    /// tracker steers to one goal after the other.
    pub fn new(robot: &'a Robot, start: &Pose, path: &'a [Segment], legs: &'a [Leg], noise: SensorNoise) -> Self {
        let mut stages = Stages::new(robot, start, path, legs);
        let reference =
            stages.next(&start.frame()).unwrap_or_else(|| ReferenceTrajectory::from_path(&[], stages.radius));
        let (estimator, begins) = (Estimator::new(start.frame(), noise), start.frame());
        let mut tracker =
            Self { robot, estimator, reference, begins, stages, laid: 0, committed: 0, miss: GoalError::default() };
        tracker.replan(&[]);
        tracker
    }

    /// Updates the estimate with a layer that has been laid, as commanded and as measured.
    pub fn record_layer(&mut self, commanded: &Layer, measured: &Measurement) {
        let growth = self.estimator.update(commanded, measured);
        self.laid += 1;
        if self.committed < self.laid {
            self.commit(growth);
        }
    }

    /// Removes a layer of this growth (mm), which can no longer be changed, from the reference trajectory.
    fn commit(&mut self, growth: f64) {
        self.committed += 1;
        self.reference.advance(growth);
        self.reference.roll(self.estimator.systematic().twist);
    }

    /// Plans the rest of the path again, from the pose of the tip after the layers `under_way`, which can no longer be
    /// changed.
    pub fn replan(&mut self, under_way: &[Layer]) {
        let systematic = *self.estimator.systematic();
        self.begins = *self.estimator.base_from_tip();
        for (index, layer) in (self.laid..).zip(under_way) {
            self.begins = systematic.lay(&self.begins, layer);
            if self.committed <= index {
                self.commit(layer.height * (1.0 + systematic.growth));
            }
        }
        while too_thin(&self.reference, self.robot) && self.start_next_stage().is_some() {}
        self.correct_reference();
    }

    /// Continues with the next stage. Returns `None` after the last stage.
    fn start_next_stage(&mut self) -> Option<()> {
        self.reference = self.stages.next(&self.begins)?;
        Some(())
    }

    // Inlined, its 14 KiB of stack would also be taken during the change of the stage.
    #[inline(never)]
    fn correct_reference(&mut self) {
        let resolution = self.robot.description().layer.height_mm;
        self.miss = self.reference.correct(&self.begins, &self.stages.goal, self.max_curvature(), resolution);
    }

    /// Replaces the rest of the path by another path. `start` is the pose at the beginning of the reference trajectory,
    /// where the other path begins.
    pub fn switch_path(&mut self, start: &Pose, path: &'a [Segment], legs: &'a [Leg]) {
        self.stages = Stages::new(self.robot, start, path, legs);
        if self.start_next_stage().is_some() {
            self.correct_reference();
        }
    }

    /// Returns the estimated frame of the tip at the beginning of the reference trajectory. It lies after the layers
    /// that can no longer be changed.
    pub fn reference_start(&self) -> &Frame {
        &self.begins
    }

    /// Returns the goals of the legs whose end has not been reached, in order.
    pub fn remaining_goals(&self) -> impl Iterator<Item = Pose> {
        let Stages { legs, goal, ends_leg, .. } = &self.stages;
        ends_leg.then_some(*goal).into_iter().chain(legs.iter().map(|leg| leg.goal))
    }

    /// Returns the forecast standard deviations of the position (mm, as in [`Estimate`]) after each of these layers,
    /// which are the next to be laid. `seen` are the kinds of measurement after each layer.
    pub fn forecast(&self, layers: impl Iterator<Item = Layer>, seen: MeasuredQuantities) -> impl Iterator<Item = f64> {
        let mut estimator = self.estimator.clone();
        layers.map(move |layer| {
            estimator.forecast_layer(&layer, seen);
            estimator.position_deviation()
        })
    }

    /// Returns the layers from the beginning of the reference trajectory to the last goal, as they are planned now and
    /// will be commanded.
    pub fn remaining_layers(&self) -> impl Iterator<Item = Layer> + use<'a> {
        let (robot, systematic, max_curvature) = (self.robot, *self.estimator.systematic(), self.max_curvature());
        let (mut reference, mut stages) = (self.reference.clone(), self.stages.clone());
        let mut ends = reference.end(&self.begins);
        core::iter::from_fn(move || {
            while too_thin(&reference, robot) {
                reference = stages.next(&ends)?;
                reference.correct(&ends, &stages.goal, max_curvature, robot.description().layer.height_mm);
                ends = reference.end(&ends);
            }
            let (layer, length) = first_layer(&reference, robot, &systematic, max_curvature)?;
            reference.advance(length);
            reference.roll(systematic.twist);
            Some(layer)
        })
    }

    /// Returns the next layer to command. `None` at the end of the path.
    pub fn next_layer(&self) -> Option<Layer> {
        let (layer, _) = first_layer(&self.reference, self.robot, self.estimator.systematic(), self.max_curvature())?;
        Some(layer)
    }

    /// Returns the estimate of the tip.
    pub fn estimate(&self) -> Estimate {
        Estimate {
            base_from_tip: *self.estimator.base_from_tip(),
            position_sd: self.estimator.position_deviation(),
            direction_sd: self.estimator.direction_deviation(),
            systematic_errors: *self.estimator.systematic(),
        }
    }

    /// Returns the factor by which the standard deviations of estimate and forecast must be multiplied, derived from
    /// the normalised innovations of the measured directions. It is 1 if layers and sensors behave as modelled.
    pub fn sigma_scale(&self) -> f64 {
        self.estimator.sigma_scale()
    }

    /// Returns the difference between the end of the reference trajectory and the next goal.
    pub fn goal_error(&self) -> GoalError {
        self.miss
    }

    /// Returns the max curvature of the body as laid, 1/mm. It follows from the packaging limit, and from the limits of
    /// a layer with the systematic errors learned so far.
    fn max_curvature(&self) -> f64 {
        let SystematicErrors { growth, tilt, .. } = *self.estimator.systematic();
        let laid = (1.0 + tilt) / (self.robot.min_radius_by_layers() * (1.0 + growth));
        laid.min(1.0 / self.robot.min_radius_by_packaging())
    }
}

/// The successive poses to which the tracker steers: the goals of the legs of a path. A leg with more than
/// [`MAX_SEGMENTS`] segments is divided at poses of the planned path.
#[derive(Debug, Clone)]
struct Stages<'a> {
    path: &'a [Segment],
    legs: &'a [Leg],
    /// Number of segments of the first leg that are not part of a stage yet.
    left: usize,
    /// Planned frame of the tip at the beginning of the rest of the path.
    planned: Frame,
    /// The pose to which the tracker steers.
    goal: Pose,
    /// True if a leg ends at the pose `goal`.
    ends_leg: bool,
    /// Radius of the path's tightest bend, mm.
    radius: f64,
}

impl<'a> Stages<'a> {
    fn new(robot: &Robot, start: &Pose, path: &'a [Segment], legs: &'a [Leg]) -> Self {
        let curvature = path.iter().map(Segment::curvature).fold(0.0, f64::max);
        let radius = if curvature > 0.0 { 1.0 / curvature } else { robot.min_radius() };
        let left = legs.first().map_or(0, |leg| leg.segment_count);
        Self { path, legs, left, planned: start.frame(), goal: *start, ends_leg: false, radius }
    }

    /// Continues with the next stage, and returns its reference trajectory, for a tip that is approximately at the
    /// beginning of the stage. `None` after the last stage.
    fn next(&mut self, base_from_tip: &Frame) -> Option<ReferenceTrajectory> {
        let (leg, later) = self.legs.split_first()?;
        let count = self.left.min(MAX_SEGMENTS);
        let (segments, rest) = self.path.split_at_checked(count).unwrap_or((self.path, &[]));
        let planned_end = end(segments, &self.planned);
        self.left -= count;
        self.ends_leg = self.left == 0;
        self.goal = if self.ends_leg { leg.goal } else { Pose::from_frame(&planned_end) };
        // Bends are in the frame that the path carries along. The tip may be rolled relative to that frame.
        let planned_from_tip = self.planned.rotation.inverse() * base_from_tip.rotation;
        let matrix = planned_from_tip.matrix();
        let mut reference = ReferenceTrajectory::from_path(segments, self.radius);
        reference.roll(libm::atan2(matrix[(1, 0)], matrix[(0, 0)]));
        (self.path, self.planned) = (rest, planned_end);
        if self.left == 0 {
            self.legs = later;
            self.left = later.first().map_or(0, |leg| leg.segment_count);
        }
        Some(reference)
    }
}

/// Reports whether the rest of a reference trajectory is too short for a layer: less than half the min height of a
/// layer.
fn too_thin(reference: &ReferenceTrajectory, robot: &Robot) -> bool {
    reference.length() < 0.5 * robot.description().layer.height_min_mm
}

/// Returns the first layer of a reference trajectory, as it must be commanded, and its expected growth, mm. `None` if
/// the rest of the trajectory is too short for a layer.
fn first_layer(
    reference: &ReferenceTrajectory,
    robot: &Robot,
    systematic: &SystematicErrors,
    max_curvature: f64,
) -> Option<(Layer, f64)> {
    if too_thin(reference, robot) {
        return None;
    }
    let limits = &robot.description().layer;
    let left = reference.length();
    let (grown, tilted) = (1.0 + systematic.growth, 1.0 + systematic.tilt);
    let mut length = left.min(limits.height_mm * grown);
    let mut curvature = Vector2::zeros();
    // The curvature over the layer bounds its height, and depends on it.
    for _ in 0..2 {
        curvature = reference.curvature_over(length);
        let tightness = curvature.norm().min(max_curvature);
        let highest = robot.max_mean_height(tightness * grown / tilted) * grown;
        let count = -libm::floor(-left / highest + 1e-9);
        length = (left / count.max(1.0)).max(limits.height_min_mm.min(highest * (1.0 - 1e-9)));
    }
    let tightness = curvature.norm().min(max_curvature);
    let tilt = tightness * length / tilted;
    let alpha = if tilt > 0.0 { libm::atan2(curvature.y, curvature.x) + PI - systematic.alpha } else { 0.0 };
    Some((Layer { alpha: wrap_positive(alpha), height: length / grown, tilt }, length))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layer::grow;
    use crate::plan::{Planner, goal_error, plan};
    use crate::random::Rng;
    use crate::simulation::{DirectionSensor, Disturbance, GrowthTask, SimulatedSensors, grow_closed_loop};
    use crate::slicing::LIMIT_SLACK;
    use crate::testing::robot_a;
    use std::collections::VecDeque;
    use std::vec::Vec;

    const NOISE: SensorNoise = SensorNoise { odometry: 0.01, direction: 0.0087 };

    fn poses() -> (Pose, Pose) {
        let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
        (start, Pose::from_degrees([300.0, 200.0, 450.0, 120.0, -25.0]).unwrap())
    }

    #[test]
    fn remaining_layers_are_valid_and_reach_the_goal() {
        let (robot, (start, goal)) = (robot_a(), poses());
        let path = plan(&robot, &start, &goal, 100.0, Planner::Shortest).unwrap().path;
        let legs = [Leg { goal, segment_count: path.len() }];
        let tracker = Tracker::new(&robot, &start, &path, &legs, NOISE);
        let missed = goal_error(&grow(&start.frame(), tracker.remaining_layers()), &goal);
        assert!(missed.distance < 0.05 && missed.angle < 1e-4, "{missed:?}");
        for layer in tracker.remaining_layers() {
            robot.check_layer(&layer, LIMIT_SLACK).unwrap();
        }
    }

    /// Simulates a growth in which the next `under_way` layers after the measured layer can no longer be changed.
    /// Returns the distance of the tip from the goal at the end, mm.
    fn grow_behind(under_way: usize, disturbance: &Disturbance, seed: u64) -> f64 {
        let (robot, (start, goal)) = (robot_a(), poses());
        let path = plan(&robot, &start, &goal, 100.0, Planner::Shortest).unwrap().path;
        let legs = [Leg { goal, segment_count: path.len() }];
        let sensors = SimulatedSensors { noise: NOISE, odometry_scale: 0.0, direction: DirectionSensor::Tip };
        let mut tracker = Tracker::new(&robot, &start, &path, &legs, NOISE);
        let (mut truth, mut index) = (start.frame(), 0);
        let mut queue: VecDeque<Layer> = tracker.remaining_layers().take(under_way).collect();
        tracker.replan(queue.make_contiguous());
        loop {
            queue.extend(tracker.next_layer());
            let Some(layer) = queue.pop_front() else { break };
            robot.check_layer(&layer, LIMIT_SLACK).unwrap();
            let laid = disturbance.lay(seed, index, &layer);
            truth *= laid.step();
            tracker.record_layer(&layer, &sensors.measure(seed, index, &layer, &laid, &truth));
            tracker.replan(queue.make_contiguous());
            index += 1;
        }
        (truth.translation.vector - goal.position()).norm()
    }

    #[test]
    fn layers_in_flight_are_taken_into_account() {
        let disturbance = Disturbance { growth_noise: 0.1, growth_bias: 0.05, ..Disturbance::default() };
        for under_way in [0, 1, 3] {
            let mean = (0..10).map(|seed| grow_behind(under_way, &disturbance, seed)).sum::<f64>() / 10.0;
            assert!(mean < 0.7, "{under_way} under way: {mean} mm");
        }
    }

    #[test]
    fn a_straight_path_is_followed_while_layers_are_in_flight() {
        let (robot, (start, _)) = (robot_a(), poses());
        let goal = Pose::from_degrees([0.0, 0.0, 600.0, 0.0, 90.0]).unwrap();
        let path = [Segment::Straight { length: 600.0 }];
        let legs = [Leg { goal, segment_count: 1 }];
        let disturbance = Disturbance { growth_noise: 0.1, ..Disturbance::default() };
        let exact = SensorNoise { odometry: 0.0, direction: 0.0 };
        let sensors = SimulatedSensors { noise: exact, odometry_scale: 0.0, direction: DirectionSensor::Gravity };
        for under_way in [0, 2] {
            for seed in 0..5 {
                let mut tracker = Tracker::new(&robot, &start, &path, &legs, exact);
                let (mut truth, mut index, mut farthest) = (start.frame(), 0, 0.0_f64);
                let mut queue: VecDeque<Layer> = tracker.remaining_layers().take(under_way).collect();
                tracker.replan(queue.make_contiguous());
                loop {
                    queue.extend(tracker.next_layer());
                    let Some(layer) = queue.pop_front() else { break };
                    let laid = disturbance.lay(seed, index, &layer);
                    truth *= laid.step();
                    farthest = farthest.max(truth.translation.vector.xy().norm());
                    tracker.record_layer(&layer, &sensors.measure(seed, index, &layer, &laid, &truth));
                    tracker.replan(queue.make_contiguous());
                    index += 1;
                }
                assert!(farthest < 0.1, "{under_way} under way, seed {seed}: {farthest} mm from the line");
            }
        }
    }

    #[test]
    fn forecast_deviations_match_later_estimates() {
        let (robot, (start, goal)) = (robot_a(), poses());
        let path = plan(&robot, &start, &goal, 100.0, Planner::Shortest).unwrap().path;
        let legs = [Leg { goal, segment_count: path.len() }];
        let disturbance = Disturbance { growth_noise: 0.1, ..Disturbance::default() };
        for direction in [DirectionSensor::Tip, DirectionSensor::Gravity] {
            let sensors = SimulatedSensors { noise: NOISE, odometry_scale: 0.0, direction };
            let mut tracker = Tracker::new(&robot, &start, &path, &legs, NOISE);
            let (mut truth, mut index, mut predicted) = (start.frame(), 0, Vec::new());
            while let Some(layer) = tracker.next_layer() {
                if index == 100 {
                    let tip = direction == DirectionSensor::Tip;
                    let seen = MeasuredQuantities { growth: true, direction: tip, up: !tip };
                    predicted = tracker.forecast(tracker.remaining_layers(), seen).collect();
                }
                let laid = disturbance.lay(5, index, &layer);
                truth *= laid.step();
                tracker.record_layer(&layer, &sensors.measure(5, index, &layer, &laid, &truth));
                tracker.replan(&[]);
                index += 1;
            }
            let (predicted, known) = (*predicted.last().unwrap(), tracker.estimate().position_sd);
            assert!((predicted / known - 1.0).abs() < 0.1, "{predicted} {known}");
        }
    }

    #[test]
    fn a_replaced_path_is_followed_from_the_current_tip() {
        let (robot, (start, goal)) = (robot_a(), poses());
        let path = plan(&robot, &start, &goal, 100.0, Planner::Shortest).unwrap().path;
        let legs = [Leg { goal, segment_count: path.len() }];
        let sensors = SimulatedSensors { noise: NOISE, odometry_scale: 0.0, direction: DirectionSensor::Tip };
        let disturbance = Disturbance { growth_noise: 0.1, twist_bias: 1e-4, ..Disturbance::default() };
        let mut tracker = Tracker::new(&robot, &start, &path, &legs, NOISE);
        assert_eq!(tracker.remaining_goals().collect::<Vec<_>>(), [goal]);
        let (mut truth, mut index) = (start.frame(), 0);
        let other = Pose::from_degrees([100.0, 350.0, 500.0, 60.0, 0.0]).unwrap();
        let (mut from, mut longer, mut new_legs) = (start, Vec::new(), Vec::new());
        for _ in 0..2 {
            while let Some(layer) = tracker.next_layer() {
                let laid = disturbance.lay(5, index, &layer);
                truth *= laid.step();
                tracker.record_layer(&layer, &sensors.measure(5, index, &layer, &laid, &truth));
                tracker.replan(&[]);
                index += 1;
                if index == 200 {
                    from = Pose::from_frame(tracker.reference_start());
                    longer = plan(&robot, &from, &other, 100.0, Planner::Shortest).unwrap().path.to_vec();
                    new_legs = std::vec![Leg { goal: other, segment_count: longer.len() }];
                    break;
                }
            }
            if index == 200 {
                tracker.switch_path(&from, longer.leak(), new_legs.leak());
                (longer, new_legs) = (Vec::new(), Vec::new());
                assert_eq!(tracker.remaining_goals().collect::<Vec<_>>(), [other]);
            }
        }
        let missed = goal_error(&truth, &other);
        assert!(missed.distance < 2.0 && missed.angle < 0.02, "{missed:?}");
    }

    #[test]
    fn no_measurement_makes_a_layer_exceed_a_limit() {
        let (robot, (start, goal)) = (robot_a(), poses());
        let path = plan(&robot, &start, &goal, 100.0, Planner::Shortest).unwrap().path;
        let legs = [Leg { goal, segment_count: path.len() }];
        for seed in 0..20 {
            let mut random = Rng::new(&[seed]);
            let mut tracker = Tracker::new(&robot, &start, &path, &legs, NOISE);
            for _ in 0..300 {
                let Some(layer) = tracker.next_layer() else { break };
                robot.check_layer(&layer, LIMIT_SLACK).unwrap();
                let growth = Some(random.uniform_between(-5.0, 5.0));
                let (direction, up) = (Some(random.normal_vector()), Some(random.normal_vector()));
                tracker.record_layer(&layer, &Measurement { growth, direction, up });
                tracker.replan(&[]);
            }
        }
    }

    #[test]
    fn a_path_of_several_legs_passes_each_pose() {
        let (robot, start) = (robot_a(), Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap());
        let goals: Vec<Pose> = (1..=12)
            .map(|n| {
                let n = f64::from(n);
                Pose::from_degrees([150.0 * n, 120.0 * libm::sin(n), 300.0, 15.0 * n, -40.0 + 6.0 * n]).unwrap()
            })
            .collect();
        let (mut path, mut legs, mut from) = (Vec::new(), Vec::new(), start);
        let mut base_from_tip = start.frame();
        for goal in goals {
            let own = plan(&robot, &from, &goal, 100.0, Planner::Shortest).unwrap().path;
            let matrix = (from.frame().rotation.inverse() * base_from_tip.rotation).into_inner();
            let roll = libm::atan2(matrix[(1, 0)], matrix[(0, 0)]);
            let own: Vec<Segment> = own.iter().map(|segment| segment.rolled(roll)).collect();
            base_from_tip = end(&own, &base_from_tip);
            legs.push(Leg { goal, segment_count: own.len() });
            path.extend(own);
            from = goal;
        }
        assert!(path.len() > 20);
        let whole = [Leg { goal: from, segment_count: path.len() }];
        let disturbance = Disturbance { growth_noise: 0.1, twist_bias: 1e-4, ..Disturbance::default() };
        let sensors = SimulatedSensors { noise: NOISE, odometry_scale: 0.0, direction: DirectionSensor::Tip };
        // The legs are given or not.
        for legs in [&legs[..], &whole] {
            let tracker = Tracker::new(&robot, &start, &path, legs, NOISE);
            let missed = goal_error(&grow(&start.frame(), tracker.remaining_layers()), &from);
            assert!(missed.distance < 1.0 && missed.angle < 0.01, "{missed:?}");
            let task = GrowthTask { robot: &robot, start, path: &path, legs };
            let mut nearest = std::vec![f64::INFINITY; legs.len()];
            let grown = grow_closed_loop(&task, &disturbance, &sensors, 1, |layer, _, base_from_tip| {
                robot.check_layer(layer, LIMIT_SLACK).unwrap();
                for (nearest, leg) in nearest.iter_mut().zip(legs) {
                    *nearest = nearest.min((base_from_tip.translation.vector - leg.goal.position()).norm());
                }
                *base_from_tip
            });
            assert!((grown.length / crate::path::length(&path) - 1.0).abs() < 0.02, "{} mm", grown.length);
            assert!(nearest.iter().all(|distance| *distance < 2.5), "{nearest:?}");
        }
    }
}
