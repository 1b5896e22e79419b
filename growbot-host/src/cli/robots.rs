//! `growbot robots`: lists the built-in robots, or explains a description.

use std::fmt::Write;
use std::path::{Path, PathBuf};

use clap::Args;
use growbot_core::angle::degrees;
use growbot_core::robot::{Robot, Signal};
use growbot_host::output::{is_standard_output, print};
use growbot_plan::annotated_robot::AnnotatedRobot;
use growbot_plan::robot_file::{self, MaterialPreset};
use growbot_plan::robot_json::{RobotDetails, RobotOverview, growth_rate};
use growbot_plan::robot_questions::{NO_LIMIT, UNLIMITED};
use growbot_plan::robot_schema;
use growbot_plan::sanitize::json_line;
use growbot_plan::table::{Cell, NumberFormat, Table};
use growbot_plan::text_wrap::{TERMINAL_WIDTH, wrap};

use super::failure::Failure;
use super::robot_arg::ROBOT;

/// List the built-in robots, or explain one
///
/// With a name or a file, the command prints the whole description, the meaning of each field, and which values are
/// assumed. Measure those on your robot before you rely on them.
#[derive(Args)]
#[command(after_help = "Examples:\n  growbot robots\n  growbot robots growbot-b\n  growbot robots --schema > \
                        growbot-robot.schema.json")]
pub struct RobotsArgs {
    /// The robot to explain: a built-in name or a TOML file
    #[arg(value_name = ROBOT)]
    robot: Option<PathBuf>,
    /// Print JSON: an array of the robots, or one robot with its fields
    #[arg(long)]
    json: bool,
    /// Print the JSON Schema of robot files, for editors
    #[arg(long, conflicts_with_all = ["robot", "json"])]
    schema: bool,
}

/// Runs the command.
pub fn run(args: &RobotsArgs) -> Result<(), Failure> {
    let text = match (&args.robot, args.json) {
        _ if args.schema => format!("{:#}\n", robot_schema::robot_file_schema()),
        (None, true) => {
            let robots: Result<Vec<RobotOverview>, Failure> =
                robot_file::names().map(|name| Ok((&AnnotatedRobot::load(Path::new(name))?).into())).collect();
            json_line(&robots?)
        }
        (None, false) => table()?,
        (Some(robot), true) => json_line(&RobotDetails::from(&AnnotatedRobot::load(robot)?)),
        (Some(robot), false) => describe(&AnnotatedRobot::load(robot)?) + &materials(robot)?,
    };
    Ok(print(&text)?)
}

fn table() -> Result<String, Failure> {
    let mut text = "robot        R_min, mm  plans at, mm  layer, mm  period, s  growth, mm/h\n".to_owned();
    for name in robot_file::names() {
        let explained = AnnotatedRobot::load(Path::new(name))?;
        let robot = &explained.robot;
        let description = robot.description();
        let layer = &description.layer;
        // Writing to a String cannot fail.
        let _ = writeln!(
            text,
            "{name:<12} {:>9.2}  {:>12}  {:>9}  {:>9}  {:>12.1}",
            robot.min_radius(),
            description.planning_radius_mm,
            layer.height_mm,
            layer.period_s,
            growth_rate(robot)
        );
        text += &indented(&explained.what_and_source(), 4);
    }
    text += "\nplans at: the radius of the bends in plans; R_min: the smallest possible radius.\n";
    text += "`growbot robots NAME` explains a robot; --robot takes a name or a file.\n";
    Ok(text)
}

fn describe(explained: &AnnotatedRobot) -> String {
    let robot = &explained.robot;
    let layer = &robot.description().layer;
    let mut text = format!("{}\n{}\n", robot.name(), indented(&explained.about, 2));
    for line in [
        format!(
            "R_min, the radius of the tightest bend, is {:.2} mm: the packaging limit is {:.2} mm, the limit from the \
             layers {:.2} mm. At the radius of plans, {} mm, a layer tilts by {:.3} degrees.",
            robot.min_radius(),
            robot.min_radius_by_packaging(),
            robot.min_radius_by_layers(),
            robot.description().planning_radius_mm,
            degrees(layer.height_mm / robot.description().planning_radius_mm),
        ),
        format!(
            "The robot grows by {:.1} mm in an hour, by layers of {} mm in {} s each, forms a tube {} mm wide, and \
             takes {:.1} mm of filament for a mm of body.",
            growth_rate(robot),
            layer.height_mm,
            layer.period_s,
            robot.outer_diameter(),
            robot.filament_per_length(),
        ),
    ] {
        text += &indented(&line, 2);
    }
    for section in &explained.sections {
        text.push('\n');
        if !section.name.is_empty() {
            text += &indented(&format!("[{}] {}", section.name, section.description), 0);
        }
        for field in &section.fields {
            let name = field.path.strip_prefix(&format!("{}.", section.name)).unwrap_or(&field.path);
            let value = if field.value == UNLIMITED { NO_LIMIT } else { &field.value };
            let mut line = format!("{name} = {value}");
            if !field.in_file {
                line += "  (not in the file)";
            } else if !field.comment.is_empty() {
                line += &format!("  # {}", field.comment);
            }
            text += &indented(&line, 2);
            text += &indented(&field.description, 6);
        }
    }
    text += &wires(robot);
    let assumed = explained.fields().filter(|field| field.is_assumed()).count();
    text.push('\n');
    text += &indented(
        &format!(
            "{assumed} of {} values are assumed (# assumed): measure them on your robot before relying on them.",
            explained.fields().count()
        ),
        0,
    );
    text
}

/// Returns a text with the pin or terminal of each signal of the robot, on the board that its description names.
/// Empty if the description names no board.
fn wires(robot: &Robot) -> String {
    let Some(board) = robot.description().board else { return String::new() };
    let mut text = format!("\n{}, signal by signal:\n", board.kind);
    for signal in Signal::ALL.into_iter().filter(|signal| signal.is_used(robot.description())) {
        let place = match (board.pins.get(signal), board.kind.pin(signal), board.kind.terminal(signal)) {
            (Some(pin), ..) => format!("pin {pin}"),
            (None, Some(pin), Some(terminal)) => format!("pin {pin}, {terminal}"),
            (.., terminal) => terminal.unwrap_or_default().to_owned(),
        };
        // Writing to a String cannot fail.
        let _ = writeln!(text, "  {:<18}{place}", signal.name());
    }
    text
}

/// Returns a table of the materials of a robot file. Empty for a file without materials.
fn materials(name_or_file: &Path) -> Result<String, Failure> {
    // Standard input has been read already.
    if is_standard_output(name_or_file) {
        return Ok(String::new());
    }
    let (text, file) = robot_file::text_of(name_or_file)?;
    let materials = robot_file::checked_materials(&text, &file)?;
    if materials.is_empty() {
        return Ok(String::new());
    }
    let of_growth = || Cell::from("of growth");
    let table = Table::new(NumberFormat::Shortest)
        .column("material", |(name, _): &(String, MaterialPreset)| name.clone())
        .column("nozzle, C", move |(_, preset)| preset.nozzle_c.map_or_else(of_growth, Cell::from))
        .columns(["load, mm", "unload, mm", "purge, mm"], |(_, preset)| {
            [preset.load_mm, preset.unload_mm, preset.purge_mm]
        });
    let width = materials.keys().map(|name| name.chars().count()).max().unwrap_or(0).max(8);
    Ok(format!("\n{}", table.text(materials, &[width, 9, 8, 10, 9])))
}

/// Wraps a text into lines of at most 80 columns, all with this indentation. Empty for an empty text.
fn indented(text: &str, indent: usize) -> String {
    let indent = " ".repeat(indent);
    if text.is_empty() { String::new() } else { wrap(text, TERMINAL_WIDTH, &indent, &indent) }
}
