//! `growbot workspace`: shows the goals within reach of a body of a given length.

use std::path::PathBuf;

use clap::Args;
use growbot_core::compact_number::CompactNumber;
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_host::output::{is_standard_output, print, write_to};
use growbot_host::progress::{Progress, ResultTiming};
use growbot_pictures::workspace::svg;
use growbot_plan::atomic_file::refuse_inputs;
use growbot_plan::pose_text::{parse_pose, pose_of_numbers};
use growbot_plan::sanitize::json_line;
use growbot_plan::workspace::{DIRECTIONS, Workspace, WorkspaceJson, WorkspaceQuery, ball, workspace};

use super::failure::Failure;
use super::growth_monitor::ResultFormat;
use super::output_format::OutputFormat;
use super::robot_arg::RobotArg;
use super::scene_options::margin_mm;
use super::search::{PlannerName, START};
use super::units::{deg, mm};
use super::workspace_in_scene::{self, SceneSearch};

/// Show which goals are within reach of a body
///
/// The command computes the positions to which a body of this length can bring its tip. It also computes the number of
/// final directions that the tip can have there. It prints a table, or one line of JSON with --json. -o draws a section
/// through the start: SVG, PNG or PDF, coloured by length of the body.
///
/// Without a final direction (the tip may point anywhere) the result is the same all round the start's direction. The
/// shortest body to a position is then an arc and a line, or two arcs. It is computed exactly, on a grid of 1/120 of
/// the length. The volume is summed over rings of 1/500. The share of final directions is counted over 48 directions,
/// spread evenly. They are planned at each position of a coarser grid: 1/30 of the length, or more if much of it is
/// near the start.
///
/// With --heading and --pitch everything is planned. The volume is estimated from 1000 positions, and the furthest
/// reach from 200 along each axis. For -o the plane of the start's direction and its x axis is planned on a grid of
/// 1/60 of the length or coarser. This takes longest if much of it is near the start.
///
/// Without --scene only length and radius count: the command does not check whether a body would run into itself.
///
/// With --scene the command searches for a path to each of 1000 goals, spread evenly in the ball of that radius. The
/// path must be clear of everything and of itself. Each goal has one of three answers: a path, no path with the reason,
/// or no path found with this effort, which proves nothing. -o then writes the goals with their answers, as CSV.
#[derive(Args)]
#[command(after_help = AFTER_HELP)]
pub struct WorkspaceArgs {
    /// Length of the body, mm [default: the length that the robot's spool gives]
    #[arg(long, value_name = "MM", allow_hyphen_values = true, value_parser = mm)]
    length: Option<f64>,
    /// Start pose of the tip: X,Y,Z,HEADING,PITCH in mm and degrees
    #[arg(long, value_name = "POSE", default_value = START, allow_hyphen_values = true, value_parser = parse_pose)]
    from: Pose,
    /// Heading of the tip at the end, degrees [default: any direction]
    #[arg(long, value_name = "DEG", requires = "pitch", allow_hyphen_values = true, value_parser = deg)]
    heading: Option<f64>,
    /// Pitch of the tip at the end, degrees [default: any direction]
    #[arg(long, value_name = "DEG", requires = "heading", allow_hyphen_values = true, value_parser = deg)]
    pitch: Option<f64>,
    /// Planner of the paths
    #[arg(long, value_enum, default_value_t = PlannerName::Shortest)]
    planner: PlannerName,
    /// Radius of the bends, mm [default: the robot's planning radius]
    #[arg(long, value_name = "MM", allow_hyphen_values = true, value_parser = mm)]
    radius: Option<f64>,
    #[command(flatten)]
    robot: RobotArg,
    /// Print one line of JSON
    #[arg(long)]
    json: bool,
    /// Plan to each goal through this scene: a scene file (TOML), a mesh (.stl, .obj, .ply, .glb) or a point cloud
    /// (.ply, .pcd)
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    /// Effort of the search for each goal: some 0.1 s for each unit, with the same result on every machine [default: 1]
    #[arg(long, value_name = "N", requires = "scene", value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    effort: Option<u64>,
    /// Keep at least this distance between the outside of the tube and the scene, mm [default: margin_mm of the scene
    /// file, or else the deviation that is expected of the robot, 3 standard deviations]
    #[arg(long, value_name = "MM", requires = "scene", allow_hyphen_values = true, value_parser = margin_mm)]
    margin: Option<f64>,
    /// Draw a section to this file, in the format of its extension: .svg, .png or .pdf. With --scene, write the goals:
    /// .csv
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
}

const AFTER_HELP: &str = "\
Examples:
  growbot workspace --length 1000 -o reach.svg
  growbot workspace --length 1000 -o reach.png
  growbot workspace --length 800 --heading 0 --pitch -90
  growbot workspace --robot growbot-b --length 20000 --json
  growbot workspace --length 800 --scene room.toml -o goals.csv";

/// Width of a PNG, pixels.
const WIDTH: u32 = 1760;

/// Maximum length of a body, mm.
const LONGEST: f64 = 1e6;

/// Runs the command.
pub fn run(args: &WorkspaceArgs) -> Result<(), Failure> {
    let robot = args.robot.load()?;
    let length = args.length.unwrap_or_else(|| robot.description().filament.spool_mm / robot.filament_per_length());
    if !(1.0..=LONGEST).contains(&length) {
        return Err(Failure::bad_input(format!(
            "the length of the body is {} mm: give 1 to {LONGEST} mm with --length",
            CompactNumber(&length)
        )));
    }
    let direction = match (args.heading, args.pitch) {
        (Some(heading), Some(pitch)) => {
            let pose = pose_of_numbers([0.0, 0.0, 0.0, heading, pitch]).map_err(Failure::bad_input)?;
            Some((pose.heading(), pose.pitch()))
        }
        _ => None,
    };
    if let Some(output) = args.output.as_deref() {
        if args.json && is_standard_output(output) {
            return Err(Failure::bad_input("-o - and --json both go to standard output: remove one of them"));
        }
        let formats: &[OutputFormat] =
            if args.scene.is_some() { &[OutputFormat::Csv] } else { &OutputFormat::DRAWINGS };
        OutputFormat::of(output, formats)?;
        refuse_inputs(output)?;
    }
    let question = WorkspaceQuery {
        robot: &robot,
        start: args.from,
        length,
        radius: args.radius.unwrap_or(robot.description().planning_radius_mm),
        planner: args.planner.into(),
        direction,
        section: args.output.is_some(),
    };
    if let Some(scene) = &args.scene {
        let room = SceneSearch { scene, margin: args.margin, effort: args.effort.unwrap_or(1) };
        return workspace_in_scene::run(&question, &room, args.output.as_deref(), ResultFormat::of(args.json));
    }
    draw(args, &question)
}

/// Computes the workspace without obstacles, prints it and draws it.
fn draw(args: &WorkspaceArgs, question: &WorkspaceQuery) -> Result<(), Failure> {
    let mut progress: Option<Progress> = None;
    let answer = workspace(question, |done, of| {
        let progress = progress.get_or_insert_with(|| Progress::start(Some(of), ResultTiming::AtEnd));
        progress.update(done, || format!("{done} of {of} positions"));
    });
    if let Some(progress) = progress {
        progress.finish();
    }
    let answer = answer?;
    if let Some(path) = &args.output {
        let svg = svg(question, &answer);
        let format = OutputFormat::of(path, &OutputFormat::DRAWINGS)?.unwrap_or(OutputFormat::Svg);
        let bytes = format.drawn(svg, WIDTH)?;
        if !write_to(path, &bytes)? {
            return Ok(());
        }
        growbot_host::note!("section drawn to {}", path.display());
    }
    let text = if args.json { json_line(&WorkspaceJson::new(question, &answer)) } else { table(question, &answer) };
    Ok(print(&text)?)
}

fn table(question: &WorkspaceQuery, answer: &Workspace) -> String {
    let robot: &Robot = question.robot;
    let length = round(question.length);
    let mut text =
        format!("{}: within reach of a body of {length} mm, bends of radius {} mm\n\n", robot.name(), question.radius);
    let (volume, error) = answer.volume;
    let ball = ball(question.length);
    // Only digits that are significant are shown.
    let digits = if volume >= 1e8 {
        0
    } else if volume >= 1e6 {
        1
    } else {
        3
    };
    let litres = |volume: f64| format!("{:.digits$}", volume / 1e6);
    let give_or_take = if error > 0.0 { format!(" +- {}", litres(error)) } else { String::new() };
    let percent = 100.0 * volume / ball;
    text += &format!("  volume      {}{give_or_take} l, {percent:.1} % of the ball of that radius\n", litres(volume));
    let reach = |distance: Option<f64>| distance.map_or("nothing".to_owned(), |mm| format!("{} mm", round(mm)));
    let [ahead, towards, against, behind] = answer.reach.map(reach);
    let aside = if question.direction.is_none() {
        towards
    } else {
        format!("{towards} in the direction of the start's x axis, {against} opposite to it")
    };
    text += &format!("  ahead       {ahead}\n  aside       {aside}\n  behind      {behind}\n");
    if !answer.shares.is_empty() {
        text += &format!("\ndistance, mm  final directions within reach (of {})\n", 2 * DIRECTIONS);
        let mut from = 0.0;
        for band in &answer.shares {
            let percent = 100.0 * band.share;
            let bar = "#".repeat((percent / 2.5).round() as usize);
            let line = format!("{:>5} - {:>5} {percent:>6.1} %  {bar}", round_to_mm(from), round_to_mm(band.to));
            text += line.trim_end();
            text.push('\n');
            from = band.to;
        }
    }
    text
}

fn round(mm: f64) -> f64 {
    (mm * 10.0).round() / 10.0
}

fn round_to_mm(mm: f64) -> f64 {
    mm.round()
}
