//! `growbot replay`: the body that a run log tells of.

use std::path::{Path, PathBuf};

use clap::Args;
use growbot_client::arrival::Arrival;
use growbot_client::client::ClockDrift;
use growbot_client::degrees::degrees_below_turn;
use growbot_client::feedback::FedBack;
use growbot_client::growth::{Job, MeasuredBy, as_built_hash};
use growbot_client::plan::Plan;
use growbot_client::plan_file::written_hash;
use growbot_client::printable::json_line;
use growbot_client::run_log::RunRecord;
use growbot_core::angle::degrees;
use growbot_core::layer::{Layer, grow};
use growbot_core::layer_bytes::decode;
use growbot_host::output::print;
use serde_json::json;

use super::growth_json::{believed, json_of_arrival, json_of_feedback, merge};
use super::{Failure, robot_of, say_damage};

/// Rebuild the body from the log of its growth, bit for bit as the board has built it
///
/// The log may be cut off anywhere: the body is told up to there. Lines that cannot be read are skipped, and that is said. Of a growth with
/// feedback, so is where that took the tip to be.
///
/// On a robot the body is what the board's steps have built. On a simulated tip it is where the plastic lies, laid (simulated), which
/// disturbances take elsewhere; the commanded body, that of the steps, is told beside it.
#[derive(Args)]
#[command(after_help = "Examples:\n  growbot replay run.jsonl\n  growbot replay run.jsonl --layers > as-built.csv")]
pub struct ReplayArgs {
    /// The run log, as `growbot grow --log` writes it
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// The robot, where it had feedback: a built-in name or a TOML file [default: the built-in
    /// one that the run names]
    #[arg(long, value_name = "FILE|NAME")]
    robot: Option<PathBuf>,
    /// Print the layers as built, as CSV
    #[arg(long, conflicts_with = "json")]
    layers: bool,
    /// Print one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &ReplayArgs) -> Result<(), Failure> {
    let record = RunRecord::open(&args.run).map_err(Failure::bad_input)?;
    say_damage(&record, &args.run);
    let unknown = record.as_built.iter().filter(|layer| layer.is_none()).count();
    let commanded: Vec<Layer> = record.commanded().map(|layer| decode(&layer)).collect();
    // Of a simulated tip the log has where its plastic is.
    let laid = record.simulated();
    let body = laid.as_ref().unwrap_or(&commanded);
    if args.layers {
        return Ok(print(&layers_table(body, laid.is_some().then_some(&commanded[..])))?);
    }
    let (start, goal) = record.start_and_goal()?;
    let arrived_at =
        |body: &[Layer]| Arrival::of(&grow(&start.frame(), body.iter().copied()), &goal, record.plan.length_mm);
    let arrival = arrived_at(body);
    let beside = laid.is_some().then(|| arrived_at(&commanded));
    let length = body.iter().fold(0.0, |length, layer| length + layer.height);
    let outcome = record.outcome.as_deref().unwrap_or("unfinished");
    let hash = written_hash(as_built_hash(&record.as_built));
    let fed_back = fed_back(&record, args.robot.as_deref())?;
    if args.json {
        let mut result = json_of_arrival(&arrival);
        merge(
            &mut result,
            json!({
                "outcome": outcome,
                "simulated": record.is_simulated(),
                "clock_drift": record.clock_drift().map(|drift| drift.json()),
                "plan_id": written_hash(record.plan_id),
                "layers": body.len(),
                "length_mm": length,
                "as_built_hash": hash,
                "unknown_layers": unknown,
                "measured_by": if laid.is_some() { MeasuredBy::Tip } else { MeasuredBy::Steps }.name(),
                "commanded": beside.as_ref().map(json_of_arrival),
                "skipped_lines": record.damage.lines,
                "feedback": fed_back.as_ref().map(|(fed_back, plan)| json_of_feedback(fed_back, plan, None)),
            }),
        );
        return Ok(print(&json_line(&result))?);
    }
    let remark = if record.is_simulated() { ", simulated" } else { "" };
    let plan_id = written_hash(record.plan_id);
    let mut text = format!("run       {outcome}, plan {plan_id}, robot {}{remark}\n", record.robot.0);
    if let Some(drift) = record.clock_drift() {
        text += &format!("clock     {drift}; {}\n", ClockDrift::REMEDY);
    }
    text += &format!("body      {} layers of {}, {length:.1} mm, as built {hash}\n", body.len(), record.total);
    match &beside {
        Some(commanded) => {
            text += &arrived("reached", &arrival, ", laid (simulated)");
            text += &arrived("commanded", commanded, ", as the steps say");
        }
        None if record.is_simulated() => text += &arrived("reached", &arrival, ", commanded (simulated)"),
        None if fed_back.is_some() => text += &arrived("reached", &arrival, ", as the steps say"),
        None => text += &arrived("reached", &arrival, ""),
    }
    if let Some((fed_back, plan)) = &fed_back {
        text += &arrived("believed", &believed(fed_back, plan), ", as feedback took it to be");
    }
    let lost = record.lost.len();
    if unknown > lost {
        text += &format!("caution   {} layers were cut and let be: they are counted as planned\n", unknown - lost);
    }
    if lost > 0 {
        text += &format!("caution   the lines of {lost} layers are missing in the log: they are counted as planned\n");
    }
    match record.not_simulated() {
        0 => {}
        layers => {
            text +=
                &format!("caution   the log does not say where {layers} layers lie: they are counted as commanded\n");
        }
    }
    Ok(print(&text)?)
}

/// Layers as CSV; with those that were commanded beside them, where these are others.
fn layers_table(body: &[Layer], commanded: Option<&[Layer]>) -> String {
    let fields =
        |layer: &Layer| format!(",{},{},{}", degrees_below_turn(layer.alpha), layer.height, degrees(layer.tilt));
    let mut text = String::from("layer,alpha_deg,height_mm,tilt_deg");
    if commanded.is_some() {
        text += ",commanded_alpha_deg,commanded_height_mm,commanded_tilt_deg";
    }
    text += "\n";
    for (index, layer) in body.iter().enumerate() {
        text += &format!("{index}{}", fields(layer));
        if let Some(commanded) = commanded {
            // The layer under way was not finished.
            text += &commanded.get(index).map_or_else(|| ",,,".to_owned(), fields);
        }
        text += "\n";
    }
    text
}

/// What feedback came to, if there was some, and its plan. A robot that is not said need be neither found nor the same as then.
fn fed_back(record: &RunRecord, robot: Option<&Path>) -> Result<Option<(FedBack, Plan)>, Failure> {
    if record.feedback.is_none() {
        return Ok(None);
    }
    let load = || -> Result<_, Failure> {
        let found = robot_of(record, robot)?;
        let plan = record.plan(&found)?;
        Ok((found, plan))
    };
    let (found, plan) = match load() {
        Err(failure) if robot.is_none() => {
            let why = failure.message();
            Failure::bad_input(format_args!("where feedback took the tip to be is left out: {why}")).say();
            return Ok(None);
        }
        found => found?,
    };
    let feedback = record.feedback(&Job::new(&found, &plan.start, &plan.goal, &plan.path), &plan);
    let fed_back = feedback.map(|feedback| feedback.result());
    Ok(fed_back.map(|fed_back| (fed_back, plan)))
}

/// A pose in a line, and how far it is from the goal in another.
fn arrived(name: &str, arrival: &Arrival, by: &str) -> String {
    let [x, y, z, heading, pitch] = arrival.reached.to_degrees();
    format!(
        "{name:<10}{x:.3}, {y:.3}, {z:.3} mm, heading {heading:.3}, pitch {pitch:.3} deg{by}\n\
         error     {:.3} mm from the goal, {:.3} deg between the directions\n",
        arrival.position_error_mm, arrival.direction_error_deg
    )
}
