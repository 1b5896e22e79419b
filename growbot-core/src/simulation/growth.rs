//! Simulation of a growth, in open and in closed loop.

use super::disturbance::{Disturbance, DisturbedLayer};
use super::sensors::SimulatedSensors;
use crate::kinematics::advance;
use crate::layer::Layer;
use crate::path::{Leg, Segment};
use crate::plan::requirements;
use crate::pose::{Frame, Pose};
use crate::robot::Robot;
use crate::tracking::{Estimate, Tracker};

/// A growth to simulate: a path from a start through the goals of its legs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GrowthTask<'a> {
    /// Robot that grows.
    pub robot: &'a Robot,
    /// Pose of the tip at the start of the body.
    pub start: Pose,
    /// Path along which the robot grows.
    pub path: &'a [Segment],
    /// Legs of the path, at least one.
    pub legs: &'a [Leg],
}

impl GrowthTask<'_> {
    /// Returns the goal of the last leg.
    pub fn goal(&self) -> Pose {
        self.legs.last().map_or(self.start, |leg| leg.goal)
    }
}

/// Result of a simulated growth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GrownBody {
    /// True frame of the tip at the end of the growth.
    pub base_from_tip: Frame,
    /// Number of layers laid.
    pub layers: u64,
    /// Length of the body, mm.
    pub length: f64,
    /// Estimate of the tip by the controller of the closed loop. `None` in open loop.
    pub estimate: Option<Estimate>,
}

/// Max number of layers of a closed loop, as a multiple of the number of layers of its plan, before [`MIN_PATIENCE`] is
/// added. A closed loop in which almost nothing grows would not end without a limit.
const MAX_LAYERS_FACTOR: u64 = 20;
/// Number of layers that a closed loop may lay in addition to [`MAX_LAYERS_FACTOR`] times the layers of its plan.
const MIN_PATIENCE: u64 = 100;

/// Simulates a growth in open loop, which lays the layers as given. Calls `each` with every layer as laid.
pub fn grow_open_loop(
    start: &Pose,
    layers: impl IntoIterator<Item = Layer>,
    disturbance: &Disturbance,
    seed: u64,
    mut each: impl FnMut(&DisturbedLayer),
) -> GrownBody {
    let mut grown = GrownBody { base_from_tip: start.frame(), layers: 0, length: 0.0, estimate: None };
    for layer in layers {
        let laid = disturbance.lay(seed, grown.layers, &layer);
        grown.base_from_tip = advance(&grown.base_from_tip, &laid.step());
        grown.layers += 1;
        grown.length += laid.layer.height;
        each(&laid);
    }
    grown
}

/// Simulates a growth in closed loop, which measures each layer and then plans the remaining path again. Calls `tip`
/// with each layer as commanded and as laid, and with the frame of the tip without sag. `tip` returns the true frame of
/// the tip, which is different if the body sags.
pub fn grow_closed_loop(
    task: &GrowthTask,
    disturbance: &Disturbance,
    sensors: &SimulatedSensors,
    seed: u64,
    tip: impl FnMut(&Layer, &DisturbedLayer, &Frame) -> Frame,
) -> GrownBody {
    grow_closed_loop_while(task, disturbance, sensors, seed, tip, |_, _| true)
}

/// Like [`grow_closed_loop`], but stops when `goes_on` returns false. `goes_on` is called before the first layer and
/// after each correction, with the tracker and the layer that was commanded last. It may replace the tracker's path.
pub fn grow_closed_loop_while<'a>(
    task: &GrowthTask<'a>,
    disturbance: &Disturbance,
    sensors: &SimulatedSensors,
    seed: u64,
    mut tip: impl FnMut(&Layer, &DisturbedLayer, &Frame) -> Frame,
    mut goes_on: impl FnMut(&mut Tracker<'a>, Option<&Layer>) -> bool,
) -> GrownBody {
    let GrowthTask { robot, start, path, legs } = *task;
    let mut tracker = Tracker::new(robot, &start, path, legs, sensors.noise);
    let mut grown = GrownBody { base_from_tip: start.frame(), layers: 0, length: 0.0, estimate: None };
    let max_layers = MAX_LAYERS_FACTOR * requirements(path, robot).layers as u64 + MIN_PATIENCE;
    let mut by_growth = start.frame();
    let mut goes = goes_on(&mut tracker, None);
    while let Some(layer) = tracker.next_layer().filter(|_| goes && grown.layers < max_layers) {
        let laid = disturbance.lay(seed, grown.layers, &layer);
        by_growth = advance(&by_growth, &laid.step());
        grown.base_from_tip = tip(&layer, &laid, &by_growth);
        let measured = sensors.measure(seed, grown.layers, &layer, &laid, &grown.base_from_tip);
        grown.layers += 1;
        grown.length += laid.layer.height;
        tracker.record_layer(&layer, &measured);
        tracker.replan(&[]);
        goes = goes_on(&mut tracker, Some(&layer));
    }
    grown.estimate = Some(tracker.estimate());
    grown
}
