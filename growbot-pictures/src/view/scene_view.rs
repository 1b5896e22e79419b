//! The scene around a body: the part of the scene that is shown, and the point where the body is nearest to an
//! obstacle.

use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_core::path::Segment;
use growbot_plan::scene_planning::laid;
use growbot_scene::closest_approach::{ClosestApproach, closest_approach};
use growbot_scene::obstacle_selection::{ObstacleSelection, SelectionLimits};
use nalgebra::Vector3;

use super::centreline::{self, polyline};
use super::{Layers, NamedScene, Subject, ViewError};

/// The part of a scene that is shown around a body.
#[derive(Debug, Clone)]
pub struct SceneView {
    /// Name of the scene's file.
    pub file: String,
    /// Obstacles that are shown.
    pub obstacles: ObstacleSelection,
    /// Closest approach of the body to an obstacle, with the proven clearance there between the outside of the tube and
    /// the obstacle, mm. `None` without obstacles.
    pub closest_approach: Option<(ClosestApproach, f64)>,
}

impl SceneView {
    /// Returns the scene around the body of a subject. Returns `None` if the subject has no scene.
    ///
    /// # Errors
    /// [`ViewError::TooManyLayers`].
    pub fn for_subject(subject: &Subject, limits: &SelectionLimits) -> Result<Option<Self>, ViewError> {
        Ok(Self::of(subject, &subject.layers()?, limits))
    }

    /// Like [`Self::for_subject`], for layers that are already known.
    pub(super) fn of(subject: &Subject, layers: &Layers, limits: &SelectionLimits) -> Option<Self> {
        let NamedScene { file, scene } = subject.scene?;
        let start = subject.plan.start.frame();
        let places = polyline(&centreline::points(&start, layers.body()));
        let planned = &subject.plan.path;
        let path = if layers.built.is_none() && !planned.is_empty() {
            laid(planned, subject.robot)
        } else {
            path(layers.body())
        };
        let half_tube = 0.5 * subject.robot.outer_diameter();
        // A plan states its clearance, which was proven when the plan was read.
        let planned = subject.plan.scene.as_ref().filter(|_| layers.built.is_none()).map(|scene| scene.clearance);
        Some(Self {
            file: file.to_owned(),
            obstacles: ObstacleSelection::near(scene, &places, limits),
            closest_approach: closest_approach(scene, &path, &start)
                .map(|found| (found, planned.unwrap_or(found.distance - half_tube))),
        })
    }

    /// Returns the clearance at the closest approach as text. Returns `None` without obstacles.
    pub fn clearance_text(&self) -> Option<String> {
        let (_, clearance) = self.closest_approach.as_ref()?;
        Some(if *clearance < 0.0 { format!("{:.2} mm inside", -clearance) } else { format!("{clearance:.2} mm") })
    }

    /// Returns the clearance at the closest approach and the obstacle as text. Returns `None` without obstacles.
    pub fn narrowest_text(&self) -> Option<String> {
        let ((found, clearance), text) = self.closest_approach.as_ref().zip(self.clearance_text())?;
        let to = if *clearance < 0.0 { "" } else { " to" };
        Some(format!("{text}{to} {}", found.obstacle))
    }

    /// Returns the position of the closest approach and the obstacle as text. Returns `None` without obstacles.
    pub fn closest_approach_text(&self) -> Option<String> {
        let (found, _) = self.closest_approach.as_ref()?;
        Some(format!("{:.0} mm along, at {}", found.at, found.obstacle))
    }
}

/// Returns the path that consists of these layers, each as an arc or a line.
fn path(layers: &[LayerBytes]) -> Vec<Segment> {
    layers.iter().map(decode).filter(|layer| layer.height > 0.0).map(|layer| Segment::from(&layer)).collect()
}

/// Returns a point rounded to hundredths of a mm, as in the page's data.
pub(super) fn hundredths(point: &Vector3<f64>) -> [f64; 3] {
    // Adding 0 turns -0 into 0.
    point.data.0[0].map(|part| (100.0 * part).round() / 100.0 + 0.0)
}
