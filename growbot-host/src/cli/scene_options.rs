//! Options of planning through a scene.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use clap::Args;
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_host::output::print;
use growbot_plan::margin::planning_margin_mm;
use growbot_plan::plan::{Goal, Plan, PlanOptions};
use growbot_plan::sanitize;
use growbot_plan::scene_planning::{self, EFFORT, NoPathError, SceneOptions, ScenePlanError};
use growbot_scene::scene_file::{self, LoadedScene, SceneError};
use serde::Serialize;

use super::failure::Failure;
use super::growth_monitor::ResultFormat;
use super::remedies;
use super::units::{mm, seconds};

/// Greatest margin, mm, as in scene files.
const MAX_MARGIN_MM: f64 = scene_file::MAX_LENGTH;

/// Parses a margin, mm.
pub fn margin_mm(text: &str) -> Result<f64, String> {
    let number = mm(text)?;
    if (0.0..=MAX_MARGIN_MM).contains(&number) {
        return Ok(number);
    }
    Err(format!("the value is {number} mm: give 0 to {MAX_MARGIN_MM} mm"))
}

/// The scene, and the effort of the search.
#[derive(Args)]
pub struct SceneArgs {
    /// Stay clear of everything in this scene: a scene file (TOML), a mesh (.stl, .obj, .ply, .glb) or a point cloud
    /// (.ply, .pcd)
    #[arg(long, value_name = "FILE")]
    pub scene: Option<PathBuf>,
    /// Keep at least this distance between the outside of the tube and the scene, mm [default: margin_mm of the scene
    /// file, or else the deviation that is expected of the robot, 3 standard deviations]
    #[arg(long, value_name = "MM", requires = "scene", allow_hyphen_values = true, value_parser = margin_mm)]
    margin: Option<f64>,
    /// Effort of the search for a short path through the scene: some 0.1 s for each unit, with the same result on every
    /// machine [default: 5]
    #[arg(long, value_name = "N", requires = "scene", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    effort: Option<u64>,
    /// Take the best path found within this many seconds
    #[arg(long, value_name = "S", requires = "scene", value_parser = seconds)]
    time_limit: Option<u64>,
}

/// Output of `--json` if no path is found.
#[derive(Serialize)]
struct NoPathJson {
    error: NoPathErrorJson,
}

/// Reason why no path was found, as JSON.
#[derive(Serialize)]
struct NoPathErrorJson {
    code: &'static str,
    message: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    resolution_mm: Option<f64>,
}

impl SceneArgs {
    /// Loads a scene, with the margin of these options if there is one.
    pub fn load(&self, scene: &Path) -> Result<LoadedScene, SceneError> {
        let mut loaded = scene_file::load(scene)?;
        loaded.margin = self.margin.or(loaded.margin);
        Ok(loaded)
    }

    /// Returns true if the options give a margin.
    pub fn has_margin(&self) -> bool {
        self.margin.is_some()
    }

    /// Plans from the start through the goals, clear of everything in a scene that was read from this file.
    pub fn plan(
        &self,
        (scene, loaded): (&Path, &LoadedScene),
        robot: &Robot,
        (start, goals): &(Pose, Vec<Goal>),
        search: &PlanOptions,
        max_length: f64,
    ) -> Result<Plan, ScenePlanError> {
        let begin = Instant::now();
        let effort = self.effort.unwrap_or(if self.time_limit.is_some() { u64::MAX } else { EFFORT });
        let deadline = self.time_limit.and_then(|seconds| begin.checked_add(Duration::from_secs(seconds)));
        let (file, margin) = (scene.display().to_string(), planning_margin_mm(robot, loaded));
        let through = SceneOptions { file: &file, loaded, margin, effort, deadline, first_only: false, max_length };
        scene_planning::plan(robot, start, goals, search, &through)
    }
}

/// Returns the failure of a plan through a scene. With JSON, prints the reason why no path was found as one line.
pub fn plan_failure(error: &ScenePlanError, format: ResultFormat) -> Failure {
    let no_path = match error {
        ScenePlanError::Plan(error) => return (*error).into(),
        ScenePlanError::NoPath(no_path) => no_path,
    };
    if format == ResultFormat::Json {
        let resolution_mm = if let NoPathError::AtResolution { step, .. } = no_path { Some(*step) } else { None };
        let error = NoPathErrorJson { code: no_path.code(), message: remedies::message(no_path), resolution_mm };
        if let Err(error) = print(&sanitize::json_line(&NoPathJson { error })) {
            return error.into();
        }
    }
    Failure::during_request(no_path)
}
