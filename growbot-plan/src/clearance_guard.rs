//! Checks that a growth with feedback stays clear of the obstacles of a scene.
//!
//! With feedback, the remaining layers are planned again after each layer, so each correction must be checked before it
//! is sent to a board. [`ClearanceGuard::check`] proves that the centreline of the remaining body keeps a distance from
//! all obstacles: half the tube's diameter plus 3 standard deviations of the expected position of the tip there. If
//! measured directions differ more than expected from the computed ones, the deviations are scaled up accordingly. The
//! margin of the scene is not required here, because the deviations of the growth may use it up.
//!
//! If a correction is too near to an obstacle, another path (detour) is planned through the scene
//! ([`ClearanceGuard::ensure_clear`]). It starts at the forecast pose of the tip after the layers in progress. If no
//! detour is found, the growth has to pause, and [`ClearanceViolation`] contains the position and the reason.
//!
//! The standard deviation is that of the tracker's estimator, propagated over the remaining layers and their
//! measurements (`Tracker::forecast`). It is the root of the sum of the variances along the axes, which is an upper
//! bound for each direction. It is scaled by the root of the mean ratio of the squared innovations of directions to
//! their expectation, because the estimator only assumes how much the layers of a robot tilt at random.

use std::cell::OnceCell;

use growbot_core::angle::wrap_positive;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::path::{self, Leg, Segment};
use growbot_core::plan::Planner;
use growbot_core::pose::{Frame, Pose};
use growbot_core::robot::Robot;
use growbot_core::tracking::{MeasuredQuantities, SystematicErrors, Tracker};
use growbot_scene::centreline::{Curve, arc_segments};
use growbot_scene::clearance::{DistanceQueries, RequiredClearance, is_clear};
use growbot_scene::scene_file::LoadedScene;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

pub use crate::margin::CLEARANCE_SIGMAS;
use crate::plan::{ExistingBody, Goal, Plan, PlanOptions, segments};
use crate::scene_planning::{self, MAX_LENGTH_MM, SceneOptions, ScenePlanError, describe_clearance};

/// Maximum number of detours of one growth. The number is limited because each detour bends the body more.
pub const MAX_DETOURS: usize = 12;
/// Number of layers after which the deviations along the remaining body are computed again.
const FORECAST_LAYERS: usize = 16;
/// Number of laid layers after an unsuccessful search for a detour before the next search.
const SEARCH_AGAIN: usize = 64;
/// Effort of one search for a detour, in units of `--effort`: about 0.2 s.
const EFFORT: u64 = 2;
/// Margins with which detours are planned, one after the other, as multiples of the largest 3 standard deviations along
/// the remaining body. Most of a detour needs less than the largest deviation, so smaller multiples are tried too.
const CLEARANCES: [f64; 4] = [1.5, 1.1, 0.8, 0.5];
/// Tolerance of the required clearance, mm. A layer whose clearance exceeds it by less may be rejected.
const SLACK: f64 = 1e-3;
/// Distance from obstacles, mm, in excess of the required clearance, above which the exact distance is not computed.
const FAR: f64 = 100.0;

/// Position at which the remaining body would be too near to an obstacle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct ClearanceViolation {
    /// Index of the layer that would be too near.
    pub layer: u32,
    /// Point of the layer's centreline, mm.
    pub point_mm: [f64; 3],
    /// Name of the nearest obstacle.
    pub obstacle: String,
    /// Distance of the tube's outside from the obstacle, mm. Negative inside.
    pub clearance_mm: f64,
    /// 3 standard deviations of the position at `point_mm`, mm.
    pub deviation_mm: f64,
    /// Reason why no detour was found. Null if none was searched for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub no_detour: Option<String>,
}

impl std::fmt::Display for ClearanceViolation {
    fn fmt(&self, f: &mut std::fmt::Formatter) -> std::fmt::Result {
        let Self { layer, point_mm: [x, y, z], obstacle, clearance_mm, deviation_mm, no_detour } = self;
        write!(
            f,
            "layer {layer}, at {x:.1}, {y:.1}, {z:.1} mm, would {} {obstacle}, but the body must keep a distance of \
             {deviation_mm:.2} mm there, 3 standard deviations of its position",
            describe_clearance(*clearance_mm)
        )?;
        if let Some(why) = no_detour {
            write!(f, "; no detour was found: planning the rest of the body failed ({why})")?;
        }
        Ok(())
    }
}

impl std::error::Error for ClearanceViolation {}

/// Reason why no detour was found.
#[derive(Debug, Clone, thiserror::Error)]
enum NoDetourError {
    /// The body has already taken all detours that a growth may take.
    #[error("the body has already taken {MAX_DETOURS} detours, the maximum")]
    TooMany,
    /// No path was found.
    #[error("{0}")]
    Plan(#[from] ScenePlanError),
    /// The detour would be too near to an obstacle.
    #[error("on the detour found, too, {0}")]
    TooNear(#[from] ClearanceViolation),
}

/// A new path of the remaining layers, because the previous path would be too near to an obstacle.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Detour {
    /// Index of the first layer on the new path.
    pub from: u32,
    /// Length of the new path, mm.
    pub length_mm: f64,
    /// Proven minimum clearance between the outside of the tube and the obstacles, mm.
    pub clearance_mm: f64,
    /// Position at which the previous path would have been too near to an obstacle.
    pub instead_of: ClearanceViolation,
}

/// The scene of a growth, and the detours planned during it.
#[derive(Debug)]
pub struct SceneContext<'a> {
    robot: &'a Robot,
    loaded: &'a LoadedScene,
    /// Radius of the arcs of detours, mm.
    radius: f64,
    /// Segments of the body at whose tip the growth begins.
    existing: Vec<Segment>,
    detours: [OnceCell<DetourPlan>; MAX_DETOURS],
}

/// A planned detour: its start, its path and its legs.
#[derive(Debug, Clone)]
struct DetourPlan {
    start: Pose,
    path: Vec<Segment>,
    legs: Vec<Leg>,
}

impl<'a> SceneContext<'a> {
    /// Creates the context of one growth. `radius` is the radius of the arcs of detours, mm.
    pub fn new(robot: &'a Robot, loaded: &'a LoadedScene, radius: f64) -> Self {
        Self { robot, loaded, radius, existing: Vec::new(), detours: Default::default() }
    }

    /// Returns this context for a growth that begins at the tip of a body with these layers.
    #[must_use]
    pub fn after_layers(self, layers: &[LayerBytes]) -> Self {
        Self { existing: segments(layers), ..self }
    }
}

/// Check of one growth with feedback that its remaining body stays clear of all obstacles.
#[derive(Debug, Clone)]
pub struct ClearanceGuard<'a> {
    scene: &'a SceneContext<'a>,
    /// Segments of the laid body, a segment for each layer, with the estimated systematic errors.
    body: Vec<Segment>,
    /// Quantities that the robot's sensors measure after each layer.
    seen: MeasuredQuantities,
    /// 3 standard deviations of the position in each remaining layer, mm. The first element belongs to the layer of
    /// index `forecast_at`.
    deviations: Vec<f64>,
    forecast_at: usize,
    /// Factor by which `deviations` are multiplied, because measured directions differ more than expected.
    larger: f64,
    /// Number of laid layers at the latest search that found no detour, and the reason. `None` without such a search.
    no_detour: Option<(usize, NoDetourError)>,
}

impl<'a> ClearanceGuard<'a> {
    /// Creates the guard before the first layer. `seen` are the quantities that the robot's sensors measure after each
    /// layer.
    pub fn new(around: &'a SceneContext<'a>, seen: MeasuredQuantities) -> Self {
        Self {
            scene: around,
            body: Vec::new(),
            seen,
            deviations: Vec::new(),
            forecast_at: 0,
            larger: 1.0,
            no_detour: None,
        }
    }

    /// Records a laid layer. `layer` is the layer as commanded, and `systematic` are the estimated systematic errors
    /// with which the robot laid it.
    pub fn record_layer(&mut self, layer: &Layer, systematic: &SystematicErrors) {
        self.body.push(segment(layer, systematic));
    }

    /// Returns the number of laid layers that were recorded.
    pub fn layers(&self) -> usize {
        self.body.len()
    }

    /// Returns the length of the laid body, mm.
    pub fn length(&self) -> f64 {
        path::length(&self.body)
    }

    /// Checks that the remaining body is clear of all obstacles. If it is too near, replaces the path of the tracker by
    /// a detour, and returns the detour. `None` if the remaining body is clear. Must be called after
    /// [`Tracker::replan`] with the same layers in progress.
    ///
    /// # Errors
    /// The position at which the remaining body is too near, and the reason why no detour was found. The growth must
    /// then pause.
    pub fn ensure_clear(
        &mut self,
        tracker: &mut Tracker<'a>,
        under_way: &[Layer],
    ) -> Result<Option<Detour>, ClearanceViolation> {
        let Err(too_near) = self.check(tracker, under_way) else {
            self.no_detour = None;
            return Ok(None);
        };
        let refused = |why: &NoDetourError| ClearanceViolation { no_detour: Some(why.to_string()), ..too_near.clone() };
        if let Some((at, why)) = &self.no_detour
            && self.body.len() < at + SEARCH_AGAIN
        {
            return Err(refused(why));
        }
        match self.detour(tracker, under_way) {
            Ok((followed, length_mm, clearance_mm)) => {
                *tracker = followed;
                self.no_detour = None;
                let from = (self.body.len() + under_way.len()) as u32;
                Ok(Some(Detour { from, length_mm, clearance_mm, instead_of: too_near }))
            }
            Err(why) => {
                let violation = refused(&why);
                self.no_detour = Some((self.body.len(), why));
                Err(violation)
            }
        }
    }

    /// Proves that the layers in progress and all later layers stay clear of all obstacles by 3 standard deviations of
    /// their position.
    ///
    /// # Errors
    /// The first layer that does not stay clear.
    pub fn check(&mut self, tracker: &Tracker, under_way: &[Layer]) -> Result<(), ClearanceViolation> {
        let layers: Vec<Layer> = under_way.iter().copied().chain(tracker.remaining_layers()).collect();
        if self.deviations.is_empty() || self.body.len() >= self.forecast_at + FORECAST_LAYERS {
            self.refresh_deviations(tracker, &layers);
        }
        self.larger = tracker.sigma_scale();
        let estimate = tracker.estimate();
        let half_tube = 0.5 * self.scene.robot.outer_diameter();
        let scene = &self.scene.loaded.scene;
        let most = half_tube + self.max_deviation();
        let mut base_from_tip: Frame = estimate.base_from_tip;
        // Lengths along the remaining body, mm: up to the current layer, and up to the end of the part that is proven
        // to be clear.
        let (mut along, mut proven) = (0.0, 0.0);
        let mut work = DistanceQueries::default();
        for (index, layer) in layers.iter().enumerate() {
            let grown = segment(layer, &estimate.systematic_errors);
            let (from, length) = (base_from_tip, grown.length());
            base_from_tip = estimate.systematic_errors.lay(&base_from_tip, layer);
            along += length;
            if along <= proven {
                continue;
            }
            let stretch = arc_segments(&[grown], &from).and_then(|segments| segments.first().copied());
            let Some(stretch) = stretch else { continue };
            let middle = stretch.point(0.5 * length);
            let spare = scene.distance_within(&middle, most + FAR) - most;
            if spare >= 0.5 * length {
                proven = along - 0.5 * length + spare;
                continue;
            }
            let deviation = self.deviation(index);
            if !is_clear(
                scene,
                &stretch,
                &RequiredClearance { distance: half_tube + deviation, tolerance: SLACK },
                &mut work,
            ) {
                let points = [0.0, 0.5, 1.0].map(|share| stretch.point(share * length));
                let nearer = |a: &Vector3<f64>, b: &Vector3<f64>| scene.distance(a).total_cmp(&scene.distance(b));
                let nearest = points.into_iter().min_by(nearer).unwrap_or(middle);
                return Err(self.too_near(index, &nearest, deviation));
            }
        }
        Ok(())
    }

    /// Computes the standard deviations along the remaining body again. `layers` are the layers in progress and all
    /// later layers.
    fn refresh_deviations(&mut self, tracker: &Tracker, layers: &[Layer]) {
        let now = tracker.estimate().position_sd;
        let then = tracker.forecast(layers.iter().copied(), self.seen);
        // The deviation within a layer is the larger of the deviations at its two ends.
        let mut before = now;
        self.deviations.clear();
        self.deviations.extend(then.map(|after| CLEARANCE_SIGMAS * std::mem::replace(&mut before, after).max(after)));
        self.forecast_at = self.body.len();
    }

    /// Returns 3 standard deviations of the position in a layer, mm. `index` counts from the first layer that is not
    /// laid.
    fn deviation(&self, index: usize) -> f64 {
        let deviation = self.deviations.get(self.body.len() - self.forecast_at + index).or(self.deviations.last());
        self.larger * deviation.copied().unwrap_or_default()
    }

    /// Returns 3 standard deviations of the position, mm, in the layer of the remaining body where they are largest.
    fn max_deviation(&self) -> f64 {
        self.larger * self.deviations.iter().copied().fold(0.0, f64::max)
    }

    fn too_near(&self, index: usize, point: &Vector3<f64>, deviation_mm: f64) -> ClearanceViolation {
        let scene = &self.scene.loaded.scene;
        ClearanceViolation {
            layer: (self.body.len() + index) as u32,
            point_mm: [point.x, point.y, point.z],
            obstacle: scene.nearest(point).map_or_else(String::new, |obstacle| obstacle.to_string()),
            clearance_mm: scene.distance(point) - 0.5 * self.scene.robot.outer_diameter(),
            deviation_mm,
            no_detour: None,
        }
    }

    /// Plans a detour. Returns a tracker that follows it, its length (mm) and its proven clearance (mm).
    fn detour(&mut self, tracker: &Tracker<'a>, under_way: &[Layer]) -> Result<(Tracker<'a>, f64, f64), NoDetourError> {
        let around = self.scene;
        let mut why = NoDetourError::TooMany;
        let Some(slot) = around.detours.iter().find(|slot| slot.get().is_none()) else { return Err(why) };
        let estimate = tracker.estimate();
        let start = Pose::from_frame(tracker.reference_start());
        let goals: Vec<Goal> = tracker.remaining_goals().map(Goal::from).collect();
        let laid_next = under_way.iter().map(|layer| segment(layer, &estimate.systematic_errors));
        let most = self.max_deviation();
        let laid = around.existing.iter().chain(&self.body).copied();
        let grown: Vec<Segment> = laid.chain(laid_next).collect();
        let existing = Some(ExistingBody { segments: &grown, base_from_tip: tracker.reference_start() });
        let (radius, planner) = (around.radius, Planner::Shortest);
        let search = PlanOptions { radius, planner, avoid_self_collision: true, existing };
        for share in CLEARANCES {
            let through = SceneOptions {
                file: "",
                loaded: around.loaded,
                margin: share * most,
                effort: EFFORT,
                deadline: None,
                first_only: false,
                max_length: MAX_LENGTH_MM,
            };
            let plan = match scene_planning::plan(around.robot, &start, &goals, &search, &through) {
                Ok(plan) => plan,
                Err(error) => {
                    why = error.into();
                    continue;
                }
            };
            match self.take(tracker, under_way, &plan, slot) {
                Ok(followed) => {
                    let clearance = plan.scene.as_ref().map_or(0.0, |scene| scene.clearance);
                    return Ok((followed, plan.requirements.length, clearance));
                }
                Err(too_near) => why = too_near.into(),
            }
        }
        Err(why)
    }

    /// Checks the plan of a detour, and stores it in `slot` if it is clear. Returns a tracker that follows it.
    fn take(
        &mut self,
        tracker: &Tracker<'a>,
        under_way: &[Layer],
        plan: &Plan,
        slot: &'a OnceCell<DetourPlan>,
    ) -> Result<Tracker<'a>, ClearanceViolation> {
        // Check a copy of the tracker first, because a slot can be written only once.
        let mut trial = tracker.clone();
        trial.switch_path(&plan.start, &plan.path, &plan.legs);
        self.deviations.clear();
        self.check(&trial, under_way).inspect_err(|_| self.deviations.clear())?;
        let planned = || DetourPlan { start: plan.start, path: plan.path.clone(), legs: plan.legs.clone() };
        let DetourPlan { start, path, legs } = slot.get_or_init(planned);
        let mut followed = tracker.clone();
        followed.switch_path(start, path, legs);
        Ok(followed)
    }
}

/// Returns the segment that a robot with these systematic errors lays for a commanded layer.
fn segment(layer: &Layer, systematic: &SystematicErrors) -> Segment {
    Segment::from(&Layer {
        alpha: wrap_positive(layer.alpha + systematic.alpha),
        height: layer.height * (1.0 + systematic.growth),
        tilt: layer.tilt * (1.0 + systematic.tilt),
    })
}

#[cfg(test)]
mod tests;
