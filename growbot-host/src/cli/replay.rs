//! `growbot replay`: the body that a run log tells of.

use std::path::{Path, PathBuf};

use clap::Args;
use growbot_core::layer::grow;
use growbot_core::layer_bytes::decode;
use growbot_host::arrival::Arrival;
use growbot_host::degrees::degrees_below_turn;
use growbot_host::feedback::FedBack;
use growbot_host::growth::{Job, as_built_hash};
use growbot_host::output::print;
use growbot_host::plan::Plan;
use growbot_host::plan_file::written_hash;
use growbot_host::robot_file;
use growbot_host::run_log::RunRecord;
use serde_json::json;

use super::Failure;
use super::following::{believed, json_of_arrival, json_of_feedback, merge};

/// Rebuild the body from the log of its growth, bit for bit as the board has built it
///
/// The log may be cut off anywhere: the body is told up to there. Of a growth with feedback, so is where that took the tip to be.
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
    if record.cut_off > 0 {
        growbot_host::tell!(
            "growbot: the last {} bytes of {} are no whole line: the log was cut off there",
            record.cut_off,
            args.run.display()
        );
    }
    let unknown = record.as_built.iter().filter(|layer| layer.is_none()).count();
    let body: Vec<_> = record
        .as_built
        .iter()
        .zip(&record.layers)
        .map(|(as_built, planned)| decode(as_built.as_ref().unwrap_or(planned)))
        .collect();
    if args.layers {
        let mut text = String::from("layer,alpha_deg,height_mm,tilt_deg\n");
        for (index, layer) in body.iter().enumerate() {
            let tilt = growbot_core::angle::degrees(layer.tilt);
            text += &format!("{index},{},{},{tilt}\n", degrees_below_turn(layer.alpha), layer.height);
        }
        return Ok(print(&text)?);
    }
    let (start, goal) = record.start_and_goal()?;
    let end = grow(&start.frame(), body.iter().copied());
    let arrival = Arrival::of(&end, &goal, record.plan.length_mm);
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
                "plan_id": written_hash(record.plan_id),
                "layers": body.len(),
                "length_mm": length,
                "as_built_hash": hash,
                "unknown_layers": unknown,
                "feedback": fed_back.as_ref().map(|(fed_back, plan)| json_of_feedback(fed_back, plan, None)),
            }),
        );
        return Ok(print(&format!("{result}\n"))?);
    }
    let mut text = format!("run       {outcome}, plan {}, robot {}\n", written_hash(record.plan_id), record.robot.0);
    text += &format!("body      {} layers of {}, {length:.1} mm, as built {hash}\n", body.len(), record.total);
    match &fed_back {
        None => text += &arrived("reached", &arrival, ""),
        Some((fed_back, plan)) => {
            text += &arrived("reached", &arrival, ", as the steps say");
            text += &arrived("believed", &believed(fed_back, plan), ", as feedback took it to be");
        }
    }
    if unknown > 0 {
        text += &format!("caution   {unknown} layers were cut and let be: they are counted as planned\n");
    }
    Ok(print(&text)?)
}

/// What feedback came to, if there was some, and its plan. A robot that is not said need be neither found nor the same as then.
fn fed_back(record: &RunRecord, robot: Option<&Path>) -> Result<Option<(FedBack, Plan)>, Failure> {
    if record.feedback.is_none() {
        return Ok(None);
    }
    let load = || -> Result<_, Failure> {
        let found = robot_file::load(robot.unwrap_or(record.robot.0.as_ref()))?;
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
