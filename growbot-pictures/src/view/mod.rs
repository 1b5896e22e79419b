//! Views of a body, or of two side by side.
//!
//! - [`Subject`]: a plan or a run log that is viewed
//! - [`page`]: an HTML page that opens without a network, with the tube in three dimensions and the numbers next to it
//! - `page_data`: the page's data, as JSON
//! - `info_panel`: the page's numbers, as text
//! - `side_by_side`: the numbers of two bodies
//! - [`picture`]: an SVG for papers
//! - [`plot`]: layers, error and temperature along a body
//! - `centreline`: points along a body
//! - `self_clearance`: the clearance of the wall from itself
//! - `scene_view`: the scene around a body
//! - growbot-pictures/viewer/: the page itself and its script, which is bundled there at development time
//!
//! A log contains positions of the plastic only if the tip is simulated or feedback was on. So the body according to
//! the steps and the laid or estimated body are both shown, with their source. With feedback, the log's measurements
//! are processed again as `growbot resume` does, and the estimated path of the tip is drawn. For example, if every
//! layer is a tenth too high, the estimated path leads to the goal, but the body according to the steps does not.
//!
//! On the page, the tube is one mesh of 32 faces around, with a ring for each layer. Beyond 5,000 layers it has a ring
//! for every second layer, every third, and so on. Growing changes only how much of the index is drawn. The fragment
//! shader draws lines between layers that are larger than a few pixels. Two bodies share one slider in mm, the scale of
//! colours, the scale and the squares of the floor. Each turns about its own middle. A body can be replaced by a longer
//! one while the view stays.

mod centreline;
pub(crate) mod heights;
mod info_panel;
pub mod page;
mod page_data;
pub mod picture;
pub mod plot;
mod scene_view;
mod self_clearance;
mod side_by_side;
pub mod thumbnail;

use std::ffi::OsStr;
use std::iter::once;
use std::path::Path;

use centreline::polyline;
pub use centreline::thinned;
use growbot_core::job::job_layers;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, LayerEncoder, decode};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_plan::job::Job;
use growbot_plan::plan::Plan;
use growbot_plan::plan_file::pose_from_json;
use growbot_plan::run_log::{BodyKind, RecordedRun};
use growbot_scene::scene::Scene;
use nalgebra::Vector3;
pub use scene_view::SceneView;

/// Greatest number of layers of a body that a view shows: some 150 m. Browsers fail with longer bodies.
pub const MAX_LAYERS: usize = 200_000;

/// Reason why a view cannot be made.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// The body has more layers than a browser can show.
    #[error("{name} has {found} layers, but a view shows at most {MAX_LAYERS}: split the plan")]
    TooManyLayers {
        /// Name of the body.
        name: String,
        /// Number of its layers.
        found: usize,
    },
    /// A plan lacks a quantity that only a growth has.
    #[error("{name} is not the log of a growth and has no {what}: give a run log")]
    NotMeasured {
        /// Name of the plan.
        name: String,
        /// Name of the quantity.
        what: &'static str,
    },
    /// A run log contains no temperatures.
    #[error("{name} has no temperature")]
    NoTemperatures {
        /// Name of the log.
        name: String,
    },
}

/// A body that was simulated without a board.
#[derive(Debug, Clone, Copy)]
pub struct SimulatedBody<'a> {
    /// Layers as they lie, each beginning where the previous one ends.
    pub layers: &'a [Layer],
    /// Pose of the tip at the end of the body.
    pub tip: Pose,
}

/// A scene and the name of its file.
#[derive(Debug, Clone, Copy)]
pub struct NamedScene<'a> {
    /// Name of the file.
    pub file: &'a str,
    /// The scene with its obstacles.
    pub scene: &'a Scene,
}

/// A plan or a run that is viewed.
#[derive(Debug)]
pub struct Subject<'a> {
    /// Name of the plan or run, for example the name of its file.
    pub name: &'a str,
    /// Robot of the plan or run.
    pub robot: &'a Robot,
    /// The plan, which a run has too.
    pub plan: &'a Plan,
    /// Log of the growth. `None` for a body without a log.
    pub run: Option<&'a RecordedRun>,
    /// Body of a growth that was simulated without a board, and so has no log. `None` for other bodies.
    pub laid: Option<SimulatedBody<'a>>,
    /// Scene in which the body is shown. `None` without a scene.
    pub scene: Option<NamedScene<'a>>,
}

impl Subject<'_> {
    /// Returns the name of the subject without a file extension.
    fn stem(&self) -> &str {
        Path::new(self.name).file_stem().and_then(OsStr::to_str).unwrap_or(self.name)
    }

    /// Returns the planned layers and, for a run, the layers as built. Returns an error if they are too many to show.
    fn layers(&self) -> Result<Layers, ViewError> {
        let grown = self.run.map_or(0, |run| run.as_built.len()).max(self.laid.map_or(0, |body| body.layers.len()));
        let found = self.plan.requirements.layers.max(grown);
        if found > MAX_LAYERS {
            return Err(ViewError::TooManyLayers { name: self.name.to_owned(), found });
        }
        let planned = job_layers(&self.plan.path, self.robot).collect();
        let commanded: Option<Vec<LayerBytes>> = self.run.map(|run| run.commanded().collect());
        let mut encoder = LayerEncoder::default();
        let simulated =
            self.run.and_then(RecordedRun::simulated).or_else(|| self.laid.map(|body| body.layers.to_vec()));
        let simulated = simulated.map(|layers| layers.iter().map(|layer| encoder.encode(layer)).collect());
        let kind = self.run.map(RecordedRun::body_kind).or(self.laid.map(|_| BodyKind::Laid));
        Ok(match simulated {
            Some(simulated) => Layers { planned, built: Some(simulated), kind, commanded },
            None => Layers { planned, built: commanded, kind, commanded: None },
        })
    }

    /// Returns points of the path that the tip would have taken without errors, mm. Returns `None` unless the tip is
    /// simulated, so that its plastic is known to lie otherwise.
    fn commanded(&self, layers: &Layers) -> Option<Vec<Vector3<f64>>> {
        let commanded = layers.commanded.as_ref()?;
        Some(polyline(&centreline::points(&self.plan.start.frame(), commanded)))
    }

    /// Returns points of the tip's path as feedback estimated it, mm. Returns `None` without feedback.
    fn estimated(&self) -> Option<Vec<Vector3<f64>>> {
        let Self { robot, plan, .. } = self;
        let path = self.run?.estimated(&Job::of_plan(robot, plan), plan)?;
        let points = path.iter().map(|frame| frame.translation.vector);
        Some(polyline(&once(plan.start.position()).chain(points).collect::<Vec<_>>()))
    }
}

/// The layers of a subject, as planned and as built.
struct Layers {
    planned: Vec<LayerBytes>,
    /// Layers as the plastic of a simulated tip lies, or as the steps of a robot have built them.
    built: Option<Vec<LayerBytes>>,
    /// Source of the built layers. `None` for a plan.
    kind: Option<BodyKind>,
    /// Layers according to the steps. `None` unless the tip is simulated, so that its plastic lies otherwise.
    commanded: Option<Vec<LayerBytes>>,
}

impl Layers {
    /// Returns the layers of the body that is shown: as built if there are any, otherwise as planned.
    fn body(&self) -> &[LayerBytes] {
        self.built.as_deref().unwrap_or(&self.planned)
    }

    /// Returns the title of the body that is shown, by the source of its layers.
    fn built_name(&self) -> &'static str {
        self.kind.unwrap_or(BodyKind::AsBuilt).title()
    }

    /// Returns the length of the body that is shown, mm.
    fn length(&self) -> f64 {
        self.body().iter().map(|layer| decode(layer).height).sum()
    }
}

/// Returns the tip's pose at the end of a run, and the name of its source (such as the steps), according to the log.
fn measured_end(run: &RecordedRun) -> Option<(Pose, &'static str)> {
    let result = run.result.as_ref()?;
    let (by, arrival) = (result.measured_by?, result.arrival.as_ref()?);
    Some((pose_from_json("final", &arrival.final_pose.pose()).ok()?, by.name()))
}
