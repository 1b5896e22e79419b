//! The scene around a body: what of it is shown, and where the body is nearest to it.

use growbot_client::through_scene;
use growbot_core::kinematics::advance;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_core::path::Segment;
use growbot_scene::closest_approach::{ClosestApproach, closest_approach};
use growbot_scene::obstacle_selection::{ObstacleSelection, SelectionLimits};
use growbot_scene::scene::Scene;
use nalgebra::Vector3;

use super::{Layers, MAX_PLACES, Subject, ViewError};

/// A scene, and how it is called: by its file.
#[derive(Debug, Clone, Copy)]
pub struct SceneFile<'a> {
    /// Its file.
    pub file: &'a str,
    /// The obstacles.
    pub scene: &'a Scene,
}

/// What is shown of the scene around a body.
#[derive(Debug, Clone)]
pub struct Around {
    /// The scene's file.
    pub file: String,
    /// The obstacles.
    pub shown: ObstacleSelection,
    /// The narrowest place, and the proven clearance there between the outside of the tube and the obstacle, mm.
    pub narrowest: Option<(ClosestApproach, f64)>,
}

impl Around {
    /// Around the body that is shown of a subject; none without a scene.
    ///
    /// # Errors
    /// [`ViewError::TooManyLayers`].
    pub fn of_subject(subject: &Subject, limits: &SelectionLimits) -> Result<Option<Self>, ViewError> {
        Ok(Self::of(subject, &subject.layers()?, limits))
    }

    /// The same, of these layers.
    pub(super) fn of(subject: &Subject, layers: &Layers, limits: &SelectionLimits) -> Option<Self> {
        let SceneFile { file, scene } = subject.scene?;
        let start = subject.plan.start.frame();
        let stride = layers.body().len().div_ceil(MAX_PLACES).max(1);
        let mut tip = start;
        let mut places = vec![tip.translation.vector];
        for stretch in layers.body().chunks(stride) {
            for layer in stretch {
                tip = advance(&tip, &decode(layer).step());
            }
            places.push(tip.translation.vector);
        }
        let planned = &subject.plan.path;
        let path = if layers.built.is_none() && !planned.is_empty() {
            through_scene::laid(planned, subject.robot)
        } else {
            path(layers.body())
        };
        let half_tube = 0.5 * subject.robot.outer_diameter();
        // Of a plan what it says itself, which was proven when it was read.
        let said = subject.plan.scene.as_ref().filter(|_| layers.built.is_none()).map(|scene| scene.clearance);
        Some(Self {
            file: file.to_owned(),
            shown: ObstacleSelection::near(scene, &places, limits),
            narrowest: closest_approach(scene, &path, &start)
                .map(|found| (found, said.unwrap_or(found.distance - half_tube))),
        })
    }

    /// The clearance at the narrowest place, in words.
    #[must_use]
    pub fn clearance(&self) -> Option<String> {
        let (_, clearance) = self.narrowest.as_ref()?;
        Some(if *clearance < 0.0 { format!("{:.2} mm inside", -clearance) } else { format!("{clearance:.2} mm") })
    }

    /// Where the narrowest place is, in words.
    #[must_use]
    pub fn place(&self) -> Option<String> {
        let (found, _) = self.narrowest.as_ref()?;
        Some(format!("{:.0} mm along, at {}", found.at, found.obstacle))
    }
}

/// The path of layers as they lie.
fn path(layers: &[LayerBytes]) -> Vec<Segment> {
    let layers = layers.iter().map(decode).filter(|layer| layer.height > 0.0);
    let segment = |Layer { alpha, height: length, tilt: bend }| {
        if bend > 0.0 { Segment::Arc { alpha, bend, length } } else { Segment::Straight { length } }
    };
    layers.map(segment).collect()
}

/// A length in hundredths of a mm, as data have it.
pub(super) fn hundredths(point: &Vector3<f64>) -> [f64; 3] {
    // Adding 0 makes 0 of -0.
    point.data.0[0].map(|part| (100.0 * part).round() / 100.0 + 0.0)
}
