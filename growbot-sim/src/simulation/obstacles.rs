//! A simulated growth among the obstacles of a scene: contacts of its true body, detours and pauses.

use growbot_core::layer::Layer;
use growbot_core::path::Segment;
use growbot_core::pose::Frame;
use growbot_core::robot::Robot;
use growbot_core::simulation::DisturbedLayer;
use growbot_core::tracking::Tracker;
use growbot_plan::clearance_guard::{ClearanceGuard, SceneContext};
use growbot_scene::centreline::{Curve, arc_segments};
use growbot_scene::clearance::{DistanceQueries, RequiredClearance, is_clear};
use growbot_scene::scene::{Obstacle, Scene};
use nalgebra::Vector3;

/// Distance of obstacles from the tube, mm, above which the exact distance does not matter.
const FAR: f64 = 1e3;

/// First contact of a body with an obstacle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Index of the layer that touches the obstacle.
    pub layer: u64,
    /// Length of the body before this layer, mm.
    pub at: f64,
    /// Point of the centreline in the middle of this layer, in the base's frame, mm.
    pub point: Vector3<f64>,
    /// Obstacle that is nearest to this point.
    pub obstacle: Option<Obstacle>,
}

/// A pause of a growth, because the remaining path would have come too near to an obstacle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClearancePause {
    /// Number of layers that were laid before the pause.
    pub layers: u64,
    /// Length of the body at the pause, mm.
    pub at: f64,
    /// Distance between the outside of the planned tube and the obstacle, mm.
    pub clearance: f64,
    /// 3 standard deviations of the predicted position at the point that is too near, mm.
    pub deviation: f64,
}

/// Result of a growth among obstacles.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObstacleReport {
    /// First contact of the true body with an obstacle, if there is one.
    pub contact: Option<Contact>,
    /// Minimum clearance between the outside of the true tube and the obstacles, in the middle of its layers, mm.
    pub clearance: f64,
    /// Number of detours.
    pub detours: u32,
    /// Pause that ended the growth before its goal. `None` if the growth did not pause.
    pub paused: Option<ClearancePause>,
}

/// Detector of contacts between the true body of a growth and the obstacles of a scene.
pub(super) struct ContactDetector<'a> {
    scene: &'a Scene,
    half_tube: f64,
    base_from_tip: Frame,
    layers: u64,
    length: f64,
    pub(super) among: ObstacleReport,
}

impl<'a> ContactDetector<'a> {
    pub(super) fn new(scene: &'a Scene, robot: &Robot, base_from_start: Frame) -> Self {
        let among = ObstacleReport { contact: None, clearance: FAR, detours: 0, paused: None };
        let half_tube = 0.5 * robot.outer_diameter();
        Self { scene, half_tube, base_from_tip: base_from_start, layers: 0, length: 0.0, among }
    }

    /// Adds a laid layer to the body, and checks its distance from the obstacles.
    pub(super) fn lay(&mut self, laid: &DisturbedLayer) {
        let Layer { alpha, height: length, tilt: bend } = laid.layer;
        let segment = if bend > 0.0 { Segment::Arc { alpha, bend, length } } else { Segment::Straight { length } };
        let stretch = arc_segments(&[segment], &self.base_from_tip).and_then(|found| found.first().copied());
        if let Some(stretch) = stretch {
            let point = stretch.point(0.5 * length);
            let distance = self.scene.distance_within(&point, self.half_tube + FAR);
            self.among.clearance = self.among.clearance.min(distance - self.half_tube);
            let near = distance - 0.5 * length < self.half_tube;
            let need = RequiredClearance { distance: self.half_tube, tolerance: 0.0 };
            if near
                && self.among.contact.is_none()
                && !is_clear(self.scene, &stretch, &need, &mut DistanceQueries::default())
            {
                let obstacle = self.scene.nearest(&point);
                self.among.contact = Some(Contact { layer: self.layers, at: self.length, point, obstacle });
            }
        }
        self.base_from_tip *= laid.step();
        self.layers += 1;
        self.length += length;
    }
}

/// Guard that keeps a closed-loop growth clear of the obstacles of a scene, by detours and pauses.
pub(super) struct GuardedGrowth<'a> {
    guard: ClearanceGuard<'a>,
    pub(super) detours: u32,
    pub(super) paused: Option<ClearancePause>,
}

impl<'a> GuardedGrowth<'a> {
    pub(super) fn new(around: &'a SceneContext<'a>, seen: growbot_core::tracking::MeasuredQuantities) -> Self {
        Self { guard: ClearanceGuard::new(around, seen), detours: 0, paused: None }
    }

    /// Checks that the corrected path of a growth is clear of the obstacles, and replaces it by a detour if needed.
    /// Returns false if the growth must pause.
    pub(super) fn check_correction(&mut self, tracker: &mut Tracker<'a>, laid: Option<&Layer>) -> bool {
        if let Some(layer) = laid {
            self.guard.record_layer(layer, &tracker.estimate().systematic_errors);
        }
        match self.guard.ensure_clear(tracker, &[]) {
            Ok(detour) => {
                self.detours += u32::from(detour.is_some());
                true
            }
            Err(too_near) => {
                self.paused = Some(ClearancePause {
                    layers: self.guard.layers() as u64,
                    at: self.guard.length(),
                    clearance: too_near.clearance_mm,
                    deviation: too_near.deviation_mm,
                });
                false
            }
        }
    }
}
