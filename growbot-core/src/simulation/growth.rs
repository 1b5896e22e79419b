//! A growth in open and in closed loop.

use super::disturbance::{Disturbance, Laid};
use super::sensors::Sensors;
use crate::kinematics::advance;
use crate::layer::Layer;
use crate::path::{Leg, Segment};
use crate::plan::needs;
use crate::pose::{Frame, Pose};
use crate::robot::Robot;
use crate::tracking::{Estimate, Tracker};

/// A growth to simulate: a path from a start through the goals of its legs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Task<'a> {
    /// The robot.
    pub robot: &'a Robot,
    /// The start pose of the body.
    pub start: Pose,
    /// The path.
    pub path: &'a [Segment],
    /// The path's legs, at least one.
    pub legs: &'a [Leg],
}

impl Task<'_> {
    /// The goal of the last leg.
    #[must_use]
    pub fn goal(&self) -> Pose {
        self.legs.last().map_or(self.start, |leg| leg.goal)
    }
}

/// The result of a simulated growth.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Grown {
    /// The frame of the tip.
    pub base_from_tip: Frame,
    /// Number of layers laid.
    pub layers: u64,
    /// Length of the body, mm.
    pub length: f64,
    /// The loop's estimate of the tip; `None` in open loop.
    pub estimate: Option<Estimate>,
}

/// A closed loop in which almost nothing grows does not end. It is given up after this many times the layers of its
/// plan plus [`MIN_PATIENCE`].
const PATIENCE: u64 = 20;
/// Layers that a closed loop may lay in addition to [`PATIENCE`] times those of its plan.
const MIN_PATIENCE: u64 = 100;

/// Grows in open loop: lays the layers as they are. `each` is called with every layer as laid.
pub fn grow_open(
    start: &Pose,
    layers: impl IntoIterator<Item = Layer>,
    disturbance: &Disturbance,
    seed: u64,
    mut each: impl FnMut(&Laid),
) -> Grown {
    let mut grown = Grown { base_from_tip: start.frame(), layers: 0, length: 0.0, estimate: None };
    for layer in layers {
        let laid = disturbance.lay(seed, grown.layers, &layer);
        grown.base_from_tip = advance(&grown.base_from_tip, &laid.step());
        grown.layers += 1;
        grown.length += laid.layer.height;
        each(&laid);
    }
    grown
}

/// Grows in closed loop: measures each layer and plans the rest again after it. `tip` is called with each layer as
/// commanded and as laid, and with the tip's frame by growth alone; it returns the tip's true frame, which differs
/// where the body sags.
pub fn grow_closed(
    task: &Task,
    disturbance: &Disturbance,
    sensors: &Sensors,
    seed: u64,
    tip: impl FnMut(&Layer, &Laid, &Frame) -> Frame,
) -> Grown {
    grow_closed_while(task, disturbance, sensors, seed, tip, |_, _| true)
}

/// As [`grow_closed`], as long as `goes_on` says so. It is asked with each correction, the first of them before the
/// first layer, and with the layer as commanded that was laid before it. It may steer otherwise.
pub fn grow_closed_while<'a>(
    task: &Task<'a>,
    disturbance: &Disturbance,
    sensors: &Sensors,
    seed: u64,
    mut tip: impl FnMut(&Layer, &Laid, &Frame) -> Frame,
    mut goes_on: impl FnMut(&mut Tracker<'a>, Option<&Layer>) -> bool,
) -> Grown {
    let Task { robot, start, path, legs } = *task;
    let mut tracker = Tracker::new(robot, &start, path, legs, sensors.noise);
    let mut grown = Grown { base_from_tip: start.frame(), layers: 0, length: 0.0, estimate: None };
    let max_layers = PATIENCE * needs(path, robot).layers as u64 + MIN_PATIENCE;
    let mut by_growth = start.frame();
    let mut goes = goes_on(&mut tracker, None);
    while let Some(layer) = tracker.next_layer().filter(|_| goes && grown.layers < max_layers) {
        let laid = disturbance.lay(seed, grown.layers, &layer);
        by_growth = advance(&by_growth, &laid.step());
        grown.base_from_tip = tip(&layer, &laid, &by_growth);
        let measured = sensors.measure(seed, grown.layers, &layer, &laid, &grown.base_from_tip);
        grown.layers += 1;
        grown.length += laid.layer.height;
        tracker.laid(&layer, &measured);
        tracker.replan(&[]);
        goes = goes_on(&mut tracker, Some(&layer));
    }
    grown.estimate = Some(tracker.estimate());
    grown
}
