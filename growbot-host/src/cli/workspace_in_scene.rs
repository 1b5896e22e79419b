//! `growbot workspace --scene`: shows the goals that a body reaches through a scene, as text, JSON and CSV.

use std::path::Path;

use growbot_core::compact_number::CompactNumber;
use growbot_host::output::{print, write_to};
use growbot_host::progress::{Progress, ResultTiming};
use growbot_plan::margin::planning_margin_mm;
use growbot_plan::sanitize::json_line;
use growbot_plan::scene_planning::{SceneOptions, ScenePlanError};
use growbot_plan::table::{NumberFormat, Table};
use growbot_plan::workspace::{
    GoalCounts, GoalResult, Reachability, SceneWorkspace, SceneWorkspaceJson, WorkspaceQuery, ball, scene_workspace,
};
use growbot_scene::scene_file;

use super::failure::Failure;
use super::growth_monitor::ResultFormat;

/// The scene, and the effort of the path search for each goal.
pub struct SceneSearch<'a> {
    /// File of the scene.
    pub scene: &'a Path,
    /// Margin between body and obstacles that is given, mm. `None` for the margin of the scene or of the robot.
    pub margin: Option<f64>,
    /// Effort of the search for each goal.
    pub effort: u64,
}

/// Plans to all goals and prints the result. Writes each goal as CSV to `output`, if a file is given.
pub fn run(
    question: &WorkspaceQuery,
    room: &SceneSearch,
    output: Option<&Path>,
    format: ResultFormat,
) -> Result<(), Failure> {
    let mut loaded = scene_file::load(room.scene)?;
    loaded.margin = room.margin.or(loaded.margin);
    let through = SceneOptions {
        file: &room.scene.display().to_string(),
        loaded: &loaded,
        margin: planning_margin_mm(question.robot, &loaded),
        effort: room.effort,
        deadline: None,
        first_only: true,
        max_length: question.length,
    };
    let mut progress: Option<Progress> = None;
    let answer = scene_workspace(question, &through, |done, of| {
        let progress = progress.get_or_insert_with(|| Progress::start(Some(of), ResultTiming::AtEnd));
        progress.update(done, || format!("{done} of {of} goals"));
    });
    if let Some(progress) = progress {
        progress.finish();
    }
    let answer = answer.map_err(|error| match error {
        ScenePlanError::Plan(error) => error.into(),
        ScenePlanError::NoPath(no_path) => Failure::request_failed(no_path),
    })?;
    if let Some(path) = output {
        if !write_to(path, csv(&answer).as_bytes())? {
            return Ok(());
        }
        growbot_host::note!("goals written to {}", path.display());
    }
    let text = match format {
        ResultFormat::Json => json_line(&SceneWorkspaceJson::new(question, &through, &answer)),
        ResultFormat::Table | ResultFormat::Nothing => table(question, &through, &answer),
    };
    Ok(print(&text)?)
}

/// A reason why no path exists: its name in CSV, and the test for it.
type Reason = (&'static str, fn(&Reachability) -> bool);

/// All reasons why no path to a goal exists.
const REASONS: [Reason; 5] = [
    ("too_far", |known| *known == Reachability::TooFar),
    ("too_near", |known| *known == Reachability::TooNear),
    ("separated", |known| *known == Reachability::Separated),
    ("at_resolution", |known| matches!(known, Reachability::NoPathAtResolution(_))),
    ("not_clear", |known| *known == Reachability::NotClear),
];

/// Returns a reason as text.
fn describe(name: &str, answer: &SceneWorkspace) -> String {
    match name {
        "too_far" => "farther away than the body's length, even without obstacles".to_owned(),
        "too_near" => "inside an obstacle, or too near to an obstacle".to_owned(),
        "separated" => "every passage to the goal is too narrow".to_owned(),
        "at_resolution" => {
            let step = answer.resolution().map_or(0.0, |step| (step * 100.0).round() / 100.0);
            format!("no path of arcs and lines of {} mm", CompactNumber(&step))
        }
        _ => "the path of the planner two-plane is not clear".to_owned(),
    }
}

fn table(question: &WorkspaceQuery, through: &SceneOptions, answer: &SceneWorkspace) -> String {
    let GoalCounts { reachable: path, none, not_found } = answer.counts();
    let (length, radius) = ((question.length * 10.0).round() / 10.0, question.radius);
    let name = question.robot.name();
    let mut text = format!("{name}: within reach of a body of {length} mm, bends of radius {radius} mm,\n");
    text += &format!("through {}, with a margin of {} mm\n\n", through.file, CompactNumber(&through.margin));
    let (volume, error) = answer.volume(path);
    let digits = if volume >= 1e8 { 0 } else { 2 };
    let litres = |volume: f64| format!("{:.digits$}", volume / 1e6);
    let percent = 100.0 * volume / ball(question.length);
    text += &format!(
        "  volume      {} +- {} l, {percent:.1} % of the ball of that radius\n",
        litres(volume),
        litres(error)
    );
    text += &format!("\n{} goals, spread evenly in that ball\n", answer.goals.len());
    text += &format!("{path:>7}  a path, proven to be clear\n{none:>7}  none:\n");
    for (name, is_this) in REASONS {
        let count = answer.because(is_this);
        if count > 0 {
            text += &format!("{count:>15}  {}\n", describe(name, answer));
        }
    }
    text += &format!("{not_found:>7}  no path found with --effort {}, but a path may exist\n", through.effort);
    text += "\ndistance, mm      path    none  not found\n";
    let mut from = 0.0;
    for (to, GoalCounts { reachable: path, none, not_found }) in answer.bands() {
        text += &format!("{:>5} - {:>5} {path:>8} {none:>7} {not_found:>10}\n", f64::round(from), to.round());
        from = to;
    }
    text
}

/// Returns the goals as rows of CSV.
fn csv(answer: &SceneWorkspace) -> String {
    let reason = |goal: &GoalResult| REASONS.iter().find(|(_, is_this)| is_this(&goal.reachability));
    let table = Table::new(NumberFormat::Plain)
        .columns(["x_mm", "y_mm", "z_mm"], |goal: &GoalResult| <[f64; 3]>::from(goal.position))
        .column("answer", |goal| match goal.reachability {
            Reachability::Reachable(_) => "path",
            Reachability::NotFound => "not_found",
            _ => "none",
        })
        .column("because", move |goal| reason(goal).map(|(name, _)| *name))
        .column("length_mm", |goal| match goal.reachability {
            Reachability::Reachable(length) => Some(length),
            _ => None,
        });
    table.csv(&answer.goals)
}
