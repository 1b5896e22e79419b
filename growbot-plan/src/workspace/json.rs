//! A workspace as JSON for scripts.

use growbot_core::angle::degrees;
use growbot_core::plan::Planner;
use serde::Serialize;

use super::{DIRECTIONS, GoalCounts, POSITIONS, Reachability, SceneWorkspace, Workspace, WorkspaceQuery};
use crate::hexadecimal::format_hash;
use crate::plan_file::PoseJson;
use crate::scene_planning::SceneOptions;

/// Parameters of a workspace.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
struct QueryJson {
    /// Name of the robot.
    robot: String,
    planner: Planner,
    /// Length of the body, mm.
    length_mm: f64,
    /// Radius of the bends, mm.
    radius_mm: f64,
    /// Start pose of the body.
    start: PoseJson,
    /// Heading of the tip at the end, degrees, -180 to 180. Null for any direction.
    heading_deg: Option<f64>,
    /// Pitch of the tip at the end, degrees. Null for any direction.
    pitch_deg: Option<f64>,
}

impl From<&WorkspaceQuery<'_>> for QueryJson {
    fn from(query: &WorkspaceQuery) -> Self {
        Self {
            robot: query.robot.name().to_owned(),
            planner: query.planner,
            length_mm: query.length,
            radius_mm: query.radius,
            start: PoseJson::from(&query.start),
            heading_deg: query.direction.map(|(heading, _)| degrees(heading)),
            pitch_deg: query.direction.map(|(_, pitch)| degrees(pitch)),
        }
    }
}

/// Positions in a shell around the start.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
struct BandJson {
    /// Outer radius of the shell, mm.
    to_mm: f64,
    /// Share of all final directions at all positions of the shell that are within reach, 0 to 1.
    share: f64,
}

/// A workspace without obstacles.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct WorkspaceJson {
    #[serde(flatten)]
    query: QueryJson,
    /// Volume of the positions within reach, mm^3.
    volume_mm3: f64,
    /// Standard error of the volume, mm^3. 0 if the volume is integrated.
    volume_error_mm3: f64,
    /// Number of positions from which the volume is estimated. Null if it is integrated.
    volume_positions: Option<usize>,
    /// Distance to the furthest position ahead, mm. Null if not even the nearest position that was tried is within
    /// reach.
    ahead_mm: Option<f64>,
    /// Distance to the side, along the start's x axis, mm.
    aside_towards_x_mm: Option<f64>,
    /// Distance to the side, against the start's x axis, mm.
    aside_against_x_mm: Option<f64>,
    /// Distance to the furthest position behind, mm.
    behind_mm: Option<f64>,
    /// Number of final directions that were tried for each position.
    directions: usize,
    /// Share of final directions within reach, for each shell around the start.
    shares: Vec<BandJson>,
    /// Distance between neighbours in the section, mm. Null without a section.
    section_spacing_mm: Option<f64>,
    /// Distance between neighbours in the section of the shares, mm. Null without that section.
    share_spacing_mm: Option<f64>,
}

impl WorkspaceJson {
    /// Returns the JSON of the answer to a query.
    pub fn new(query: &WorkspaceQuery, answer: &Workspace) -> Self {
        let [ahead_mm, aside_towards_x_mm, aside_against_x_mm, behind_mm] = answer.reach;
        let (volume_mm3, volume_error_mm3) = answer.volume;
        Self {
            query: query.into(),
            volume_mm3,
            volume_error_mm3,
            volume_positions: query.direction.map(|_| POSITIONS),
            ahead_mm,
            aside_towards_x_mm,
            aside_against_x_mm,
            behind_mm,
            directions: query.direction.map_or(2 * DIRECTIONS, |_| 1),
            shares: answer.shares.iter().map(|band| BandJson { to_mm: band.to, share: band.share }).collect(),
            section_spacing_mm: answer.section.as_ref().map(|section| section.spacing),
            share_spacing_mm: answer.share_section.as_ref().map(|section| section.spacing),
        }
    }
}

/// The scene of a workspace.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
struct SceneJson {
    /// Path of the scene file.
    file: String,
    /// Hash of the scene file and of all files that it names, 16 hexadecimal digits.
    hash: String,
    /// Margin between body and obstacles, mm.
    margin_mm: f64,
}

/// Number of goals with each kind of result.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
struct CountsJson {
    /// Goals with a path, which is proven to be clear.
    path: usize,
    /// Goals without a path, which is proven.
    none: usize,
    /// Goals for which the search ended without a result.
    not_found: usize,
}

impl From<GoalCounts> for CountsJson {
    fn from(GoalCounts { reachable: path, none, not_found }: GoalCounts) -> Self {
        Self { path, none, not_found }
    }
}

/// Goals in a shell around the start.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
struct SceneBandJson {
    /// Outer radius of the shell, mm.
    to_mm: f64,
    #[serde(flatten)]
    counts: CountsJson,
}

/// Number of goals without a path, by reason.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
struct ReasonsJson {
    /// Farther away than the body's length, even without obstacles.
    too_far: usize,
    /// Inside an obstacle, or too near to an obstacle.
    too_near: usize,
    /// Every passage to the goal is too narrow.
    separated: usize,
    /// No path of arcs and lines of the length `resolution_mm`.
    at_resolution: usize,
    /// The path of the planner two-plane is not clear.
    not_clear: usize,
}

/// A workspace in a scene.
#[derive(Debug, Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SceneWorkspaceJson {
    #[serde(flatten)]
    query: QueryJson,
    scene: SceneJson,
    /// Effort of the search for each goal.
    effort: u64,
    /// Number of goals.
    goals: usize,
    #[serde(flatten)]
    counts: CountsJson,
    none_because: ReasonsJson,
    /// Coarsest length of arcs and lines with which a goal has no path, mm. Null without such a goal.
    resolution_mm: Option<f64>,
    /// Estimated volume of the positions within reach, mm^3.
    volume_mm3: f64,
    /// Standard error of the volume, mm^3.
    volume_error_mm3: f64,
    /// Estimated volume of the positions for which the search ended without a result, mm^3.
    volume_not_found_mm3: f64,
    /// Counts of the goals, for each shell around the start.
    bands: Vec<SceneBandJson>,
}

impl SceneWorkspaceJson {
    /// Returns the JSON of the answer to a query in a scene.
    pub fn new(query: &WorkspaceQuery, through: &SceneOptions, answer: &SceneWorkspace) -> Self {
        let counts = answer.counts();
        let (volume_mm3, volume_error_mm3) = answer.volume(counts.reachable);
        let is = |reason: Reachability| answer.because(|known| *known == reason);
        Self {
            query: query.into(),
            scene: SceneJson {
                file: through.file.to_owned(),
                hash: format_hash(through.loaded.hash),
                margin_mm: through.margin,
            },
            effort: through.effort,
            goals: answer.goals.len(),
            none_because: ReasonsJson {
                too_far: is(Reachability::TooFar),
                too_near: is(Reachability::TooNear),
                separated: is(Reachability::Separated),
                at_resolution: answer.because(|known| matches!(known, Reachability::NoPathAtResolution(_))),
                not_clear: is(Reachability::NotClear),
            },
            resolution_mm: answer.resolution(),
            volume_mm3,
            volume_error_mm3,
            volume_not_found_mm3: answer.volume(counts.not_found).0,
            bands: answer
                .bands()
                .into_iter()
                .map(|(to_mm, counts)| SceneBandJson { to_mm, counts: counts.into() })
                .collect(),
            counts: counts.into(),
        }
    }
}
