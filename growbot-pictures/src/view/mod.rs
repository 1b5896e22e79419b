//! A body to look at, or two side by side.
//!
//! - [`Subject`]: what is looked at, a plan or a run log;
//! - [`page`]: one HTML page that opens without a network: the tube in three dimensions and the numbers beside it;
//!   `data`, what it is given, as JSON, `numbers`, in words, and `side_by_side`, those of two;
//! - [`picture`]: an SVG for papers; [`plot`]: layers, error and temperature along it;
//! - `self_clearance`: how near the wall comes to itself; `around`: the scene around it;
//! - growbot-pictures/viewer/: the page itself and its script, which is bundled there at development time.
//!
//! A log knows where the plastic lies only if the tip is simulated or feedback was on. So the body of the steps and
//! the laid or estimated one are both shown, with their source. With feedback, the log's measurements are processed
//! again as `growbot resume` does, and the estimated way of the tip is drawn. If every layer comes out a tenth too
//! high, that line leads to the goal and the steps do not.
//!
//! On the page, the tube is one mesh of 32 faces around, with a ring for each layer, or for each second, third and so
//! on beyond 5,000. Growing changes only how much of the index is drawn. The fragment shader draws lines between
//! layers that are larger than a few pixels. Two bodies share one slider in mm, the scale of colours, the scale and
//! the squares of the floor; each turns about its own middle. A body can be replaced by a longer one while the view
//! stays.

mod around;
mod data;
pub(crate) mod heights;
mod numbers;
pub mod page;
pub mod picture;
pub mod plot;
mod self_clearance;
mod side_by_side;

use std::ffi::OsStr;
use std::path::Path;

use growbot_client::growth::Job;
use growbot_client::plan::Plan;
use growbot_client::plan_file::pose;
use growbot_client::run_log::{BodyKind, RunRecord};
use growbot_core::job::job_layers;
use growbot_core::kinematics::advance;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, LayerEncoder, decode};
use growbot_core::pose::{Frame, Pose};
use growbot_core::robot::Robot;
use nalgebra::Vector3;

pub use around::{Around, SceneFile};

/// A page shows no more layers, of a body of some 150 m: beyond, browsers give up.
pub const MAX_LAYERS: usize = 200_000;

/// A line beside a body has no more places.
const MAX_PLACES: usize = 500;

/// Why there is no page.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// More layers than a browser can show.
    #[error("{name} has {found} layers; a view shows {MAX_LAYERS} at most: split the plan")]
    TooManyLayers {
        /// What was to be shown.
        name: String,
        /// Layers that it has.
        found: usize,
    },
    /// A plan has not what only a growth has.
    #[error("{name} is a plan and has no {what}; give a run log, as `growbot grow --log` writes it")]
    NotMeasured {
        /// The plan.
        name: String,
        /// What it has not.
        what: &'static str,
    },
    /// A run log without temperatures.
    #[error("{name} tells no temperature: leave it out of --plot")]
    NotTold {
        /// The log.
        name: String,
    },
}

/// What is looked at.
#[derive(Debug)]
pub struct Subject<'a> {
    /// How it is called, say by its file.
    pub name: &'a str,
    /// The robot.
    pub robot: &'a Robot,
    /// The plan.
    pub plan: &'a Plan,
    /// The log of its growth, where there is one.
    pub run: Option<&'a RunRecord>,
    /// The layers of a growth that was simulated without a board, and so has no log.
    pub laid: Option<&'a [Layer]>,
    /// The scene that it is shown in, where there is one.
    pub scene: Option<SceneFile<'a>>,
}

impl Subject<'_> {
    /// Its name without a file's ending.
    fn stem(&self) -> &str {
        Path::new(self.name).file_stem().and_then(OsStr::to_str).unwrap_or(self.name)
    }

    /// The planned layers, and those as built where it is a run; as many as can be shown.
    fn layers(&self) -> Result<Layers, ViewError> {
        let grown = self.run.map_or(0, |run| run.as_built.len()).max(self.laid.map_or(0, <[Layer]>::len));
        let found = self.plan.needs.layers.max(grown);
        if found > MAX_LAYERS {
            return Err(ViewError::TooManyLayers { name: self.name.to_owned(), found });
        }
        let planned = job_layers(&self.plan.path, self.robot).collect();
        let commanded: Option<Vec<LayerBytes>> = self.run.map(|run| run.commanded().collect());
        let mut encoder = LayerEncoder::default();
        let simulated = self.run.and_then(RunRecord::simulated).or_else(|| self.laid.map(<[Layer]>::to_vec));
        let simulated = simulated.map(|layers| layers.iter().map(|layer| encoder.encode(layer)).collect());
        let kind = self.run.map(RunRecord::body_kind).or(self.laid.map(|_| BodyKind::Laid));
        Ok(match simulated {
            Some(simulated) => Layers { planned, built: Some(simulated), kind, commanded },
            None => Layers { planned, built: commanded, kind, commanded: None },
        })
    }

    /// Where the tip would be on its way if all plastic lay as it was commanded, some hundreds of places, mm; none
    /// where that is all that is known.
    fn commanded(&self, layers: &Layers) -> Option<Vec<Vector3<f64>>> {
        let commanded = layers.commanded.as_ref()?;
        let mut tip = self.plan.start.frame();
        let path = commanded.iter().map(|layer| {
            tip = advance(&tip, &decode(layer).step());
            tip.translation.vector
        });
        let path: Vec<Vector3<f64>> = path.collect();
        let stride = path.len().div_ceil(MAX_PLACES).max(1);
        let places = path.chunks(stride).filter_map(<[_]>::last).copied();
        Some([self.plan.start.position()].into_iter().chain(places).collect())
    }

    /// Where feedback took the tip to be on its way, some hundreds of places, mm; none without feedback.
    fn estimated(&self) -> Option<Vec<Vector3<f64>>> {
        let Self { robot, plan, .. } = self;
        let path = self.run?.estimated(&Job::of_plan(robot, plan), plan)?;
        let stride = path.len().div_ceil(MAX_PLACES).max(1);
        let places = path.chunks(stride).filter_map(<[Frame]>::last).map(|frame| frame.translation.vector);
        Some([plan.start.position()].into_iter().chain(places).collect())
    }
}

/// The layers of a subject.
struct Layers {
    planned: Vec<LayerBytes>,
    /// As the plastic of a simulated tip lies; as the steps of a robot have built it.
    built: Option<Vec<LayerBytes>>,
    /// What is known of that; none of a plan.
    kind: Option<BodyKind>,
    /// As the steps say; of a simulated tip only, whose plastic lies otherwise.
    commanded: Option<Vec<LayerBytes>>,
}

impl Layers {
    /// Those of the body that is shown: as built, or as planned where none is.
    fn body(&self) -> &[LayerBytes] {
        self.built.as_deref().unwrap_or(&self.planned)
    }

    /// What is known of the body that is shown: how it is called.
    fn built_name(&self) -> &'static str {
        self.kind.unwrap_or(BodyKind::AsBuilt).title()
    }

    /// Length of that body, mm.
    fn length(&self) -> f64 {
        self.body().iter().map(|layer| decode(layer).height).sum()
    }
}

/// Where the tip arrived and what that was measured by, as the log of a run that ended says.
fn measured_end(run: &RunRecord) -> Option<(Pose, &'static str)> {
    let result = run.result.as_ref()?;
    let (by, arrival) = (result.measured_by?, result.arrival.as_ref()?);
    Some((pose("final", &arrival.final_pose.pose()).ok()?, by.name()))
}
