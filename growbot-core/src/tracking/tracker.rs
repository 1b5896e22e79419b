//! The closed loop: measure a layer, know better where the tip is, plan the rest from there.

use core::f64::consts::PI;

use nalgebra::Vector2;

use super::course::{Course, Miss};
use super::estimator::{Estimator, Habits};
use super::measurement::{Measurement, SensorNoise};
use crate::angle::wrap_positive;
use crate::layer::Layer;
use crate::path::Segment;
use crate::pose::{Frame, Pose};
use crate::robot::Robot;

/// Where the tip is by all that was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Where it is.
    pub base_from_tip: Frame,
    /// Standard deviation of the position, mm: the root of the sum over the axes.
    pub position_deviation: f64,
    /// Standard deviation of the direction, radians: the root of the sum over the two axes across it.
    pub direction_deviation: f64,
    /// What the robot was found to do in every layer.
    pub habits: Habits,
}

/// Follows a growth and plans the rest of it again.
#[derive(Debug, Clone)]
pub struct Tracker<'a> {
    robot: &'a Robot,
    goal: Pose,
    estimator: Estimator,
    /// The path from where the next layer that can be changed begins.
    course: Course,
    /// Layers laid, and layers whose part of the course has been taken off it.
    laid: u64,
    taken: u64,
    miss: Miss,
}

impl<'a> Tracker<'a> {
    /// Before the first layer. The path leads from start to goal.
    #[must_use]
    pub fn new(robot: &'a Robot, start: &Pose, goal: &Pose, path: &[Segment], noise: SensorNoise) -> Self {
        let radius = path.iter().map(Segment::curvature).fold(0.0, f64::max);
        let radius = if radius > 0.0 { 1.0 / radius } else { robot.least_radius() };
        let mut tracker = Self {
            robot,
            goal: *goal,
            estimator: Estimator::new(start.frame(), noise),
            course: Course::along(path, radius),
            laid: 0,
            taken: 0,
            miss: Miss::default(),
        };
        tracker.replan(&[]);
        tracker
    }

    /// A layer has been laid: as it was commanded, and what was measured after it.
    pub fn laid(&mut self, commanded: &Layer, measured: &Measurement) {
        let growth = self.estimator.laid(commanded, measured);
        self.laid += 1;
        if self.taken < self.laid {
            self.taken = self.laid;
            self.course.take(growth);
        }
    }

    /// Plans the rest again, from where the tip will be once the layers under way, which can no longer be changed, are laid.
    pub fn replan(&mut self, under_way: &[Layer]) {
        let habits = *self.estimator.habits();
        let mut base_from_tip = *self.estimator.base_from_tip();
        for (index, layer) in (self.laid..).zip(under_way) {
            base_from_tip = habits.lay(&base_from_tip, layer);
            if self.taken <= index {
                self.taken = index + 1;
                self.course.take(layer.height * (1.0 + habits.growth));
            }
        }
        let greatest = self.greatest_curvature();
        self.miss = self.course.correct(&base_from_tip, &self.goal, greatest, self.robot.description().layer.height_mm);
    }

    /// The layers to come, as they are to be commanded now.
    pub fn rest(&self) -> impl Iterator<Item = Layer> + use<'a> {
        let (robot, habits, greatest) = (self.robot, *self.estimator.habits(), self.greatest_curvature());
        let mut course = self.course.clone();
        core::iter::from_fn(move || {
            let (layer, length) = first_layer(&course, robot, &habits, greatest)?;
            course.take(length);
            Some(layer)
        })
    }

    /// The next layer, as it is to be commanded now; none at the end.
    #[must_use]
    pub fn next_layer(&self) -> Option<Layer> {
        let (layer, _) = first_layer(&self.course, self.robot, self.estimator.habits(), self.greatest_curvature())?;
        Some(layer)
    }

    /// Where the tip is.
    #[must_use]
    pub fn estimate(&self) -> Estimate {
        Estimate {
            base_from_tip: *self.estimator.base_from_tip(),
            position_deviation: self.estimator.position_deviation(),
            direction_deviation: self.estimator.direction_deviation(),
            habits: *self.estimator.habits(),
        }
    }

    /// How far from the goal the rest would end.
    #[must_use]
    pub fn miss(&self) -> Miss {
        self.miss
    }

    /// The greatest curvature that comes out, 1/mm: as tight as the stiff parts pass, and as the layers' limits allow.
    fn greatest_curvature(&self) -> f64 {
        let Habits { growth, tilt, .. } = *self.estimator.habits();
        let laid = (1.0 + tilt) / (self.robot.least_radius_of_layers() * (1.0 + growth));
        laid.min(1.0 / self.robot.least_radius_of_geometry())
    }
}

/// The first layer of a course, as it is to be commanded, and its length as it will come out, mm. None where what is left is too
/// thin to be laid.
fn first_layer(course: &Course, robot: &Robot, habits: &Habits, greatest: f64) -> Option<(Layer, f64)> {
    let limits = &robot.description().layer;
    let left = course.length();
    if left < 0.5 * limits.height_min_mm {
        return None;
    }
    let (grown, tilted) = (1.0 + habits.growth, 1.0 + habits.tilt);
    let mut length = left.min(limits.height_mm * grown);
    let mut curvature = Vector2::zeros();
    // The curvature over the layer bounds its height, and depends on it.
    for _ in 0..2 {
        curvature = course.curvature_over(length);
        let tightness = curvature.norm().min(greatest);
        let highest = robot.greatest_mean_height(tightness * grown / tilted) * grown;
        let count = -libm::floor(-left / highest + 1e-9);
        length = (left / count.max(1.0)).max(limits.height_min_mm.min(highest * (1.0 - 1e-9)));
    }
    let tightness = curvature.norm().min(greatest);
    let tilt = tightness * length / tilted;
    let alpha = if tilt > 0.0 { libm::atan2(curvature.y, curvature.x) + PI - habits.alpha } else { 0.0 };
    Some((Layer { alpha: wrap_positive(alpha), height: length / grown, tilt }, length))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layer::grow;
    use crate::plan::{Planner, miss, plan};
    use crate::random::Random;
    use crate::simulation::{DirectionSensor, Disturbance, Sensors};
    use crate::slicing::LIMIT_SLACK;
    use crate::testing::robot_a;
    use std::collections::VecDeque;

    const NOISE: SensorNoise = SensorNoise { odometry: 0.01, direction: 0.0087 };

    fn poses() -> (Pose, Pose) {
        let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
        (start, Pose::from_degrees([300.0, 200.0, 450.0, 120.0, -25.0]).unwrap())
    }

    #[test]
    fn the_rest_leads_to_the_goal_in_layers_that_can_be_laid() {
        let (robot, (start, goal)) = (robot_a(), poses());
        let path = plan(&robot, &start, &goal, 100.0, Planner::Shortest).unwrap().path;
        let tracker = Tracker::new(&robot, &start, &goal, &path, NOISE);
        let missed = miss(&grow(&start.frame(), tracker.rest()), &goal);
        assert!(missed.distance < 0.05 && missed.angle < 1e-4, "{missed:?}");
        for layer in tracker.rest() {
            robot.check_layer(&layer, LIMIT_SLACK).unwrap();
        }
    }

    /// Grows with so many layers that cannot be changed any more while one is measured.
    fn grow_behind(under_way: usize, disturbance: &Disturbance, seed: u64) -> f64 {
        let (robot, (start, goal)) = (robot_a(), poses());
        let path = plan(&robot, &start, &goal, 100.0, Planner::Shortest).unwrap().path;
        let sensors = Sensors { noise: NOISE, odometry_scale: 0.0, direction: DirectionSensor::Tip };
        let mut tracker = Tracker::new(&robot, &start, &goal, &path, NOISE);
        let (mut truth, mut index) = (start.frame(), 0);
        let mut queue: VecDeque<Layer> = tracker.rest().take(under_way).collect();
        tracker.replan(queue.make_contiguous());
        loop {
            queue.extend(tracker.next_layer());
            let Some(layer) = queue.pop_front() else { break };
            robot.check_layer(&layer, LIMIT_SLACK).unwrap();
            let laid = disturbance.lay(seed, index, &layer);
            truth *= laid.step();
            tracker.laid(&layer, &sensors.measure(seed, index, &layer, &laid, &truth));
            tracker.replan(queue.make_contiguous());
            index += 1;
        }
        (truth.translation.vector - goal.position()).norm()
    }

    #[test]
    fn layers_under_way_are_reckoned_with() {
        let disturbance = Disturbance { growth_noise: 0.1, growth_bias: 0.05, ..Disturbance::default() };
        for under_way in [0, 1, 3] {
            let mean = (0..10).map(|seed| grow_behind(under_way, &disturbance, seed)).sum::<f64>() / 10.0;
            assert!(mean < 0.7, "{under_way} under way: {mean} mm");
        }
    }

    #[test]
    fn no_layer_breaks_a_limit_whatever_is_measured() {
        let (robot, (start, goal)) = (robot_a(), poses());
        let path = plan(&robot, &start, &goal, 100.0, Planner::Shortest).unwrap().path;
        for seed in 0..20 {
            let mut random = Random::new(&[seed]);
            let mut tracker = Tracker::new(&robot, &start, &goal, &path, NOISE);
            for _ in 0..300 {
                let Some(layer) = tracker.next_layer() else { break };
                robot.check_layer(&layer, LIMIT_SLACK).unwrap();
                let growth = Some(random.between(-5.0, 5.0));
                let (direction, up) = (Some(random.normal_vector()), Some(random.normal_vector()));
                tracker.laid(&layer, &Measurement { growth, direction, up });
                tracker.replan(&[]);
            }
        }
    }
}
