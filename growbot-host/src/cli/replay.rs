//! `growbot replay`: rebuilds the body of a run log.

use std::path::{Path, PathBuf};

use clap::Args;
use growbot_host::output::print;
use growbot_pictures::growth_table::deviates;
use growbot_plan::arrival::Arrival;
use growbot_plan::clock_drift::ClockDrift;
use growbot_plan::figures::{direction_text, fixed};
use growbot_plan::growth_report::as_built_hash;
use growbot_plan::hexadecimal::format_hash;
use growbot_plan::job::Job;
use growbot_plan::replayed_body::{Arrivals, ReplayedBody, ReplayedFeedback};
use growbot_plan::run_log::RecordedRun;
use growbot_plan::sanitize::json_line;

use super::body_input::{robot_of, warn_of_damage};
use super::failure::Failure;

/// Rebuild the body from the log of its growth, bit for bit as the board has built it
///
/// The log may be cut off anywhere: the body is rebuilt up to there. Lines that cannot be read are skipped, with a
/// warning. For a growth with feedback, the estimate is rebuilt, too.
///
/// On a robot the body is what the board's steps have built. On a simulated tip it is the plastic as it lies, laid
/// (simulated), which disturbances move away from the commanded body. The commanded body, that of the steps, is printed
/// beside it.
#[derive(Args)]
#[command(after_help = "Examples:\n  growbot replay run.jsonl\n  growbot replay run.jsonl --layers > as-built.csv")]
pub struct ReplayArgs {
    /// The run log, as `growbot grow --log` writes it
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// The robot of a growth with feedback: a built-in name or a TOML file [default: the one that the run describes]
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
    let record = RecordedRun::open(&args.run)?;
    warn_of_damage(&record, &args.run);
    let replayed = ReplayedBody::of(&record);
    if args.layers {
        return Ok(print(&replayed.layers_table())?);
    }
    let arrivals = replayed.arrivals()?;
    let fed_back = fed_back(&record, args.robot.as_deref())?;
    Ok(print(&if args.json {
        json_line(&replayed.result(&arrivals, fed_back.as_ref()))
    } else {
        text(&replayed, &arrivals, fed_back.as_ref())
    })?)
}

/// Returns a text of a few lines about the body of a log.
pub fn text_of(record: &RecordedRun) -> Result<String, Failure> {
    let replayed = ReplayedBody::of(record);
    Ok(text(&replayed, &replayed.arrivals()?, None))
}

/// Returns the result as a few lines of text.
fn text(replayed: &ReplayedBody, arrivals: &Arrivals, feedback: Option<&ReplayedFeedback>) -> String {
    let record = replayed.record;
    let remark = if record.is_simulated() { ", simulated" } else { "" };
    let plan_id = format_hash(record.plan_id);
    let mut text = format!("run       {}, plan {plan_id}, robot {}{remark}\n", record.outcome(), record.robot.name);
    if let Some(drift) = record.clock_drift() {
        text += &format!("clock     {drift}; {}\n", ClockDrift::REMEDY);
    }
    text += &format!(
        "body      {} layers of {}, {:.1} mm, as built {}\n",
        replayed.body().len(),
        record.total,
        replayed.length_mm(),
        format_hash(as_built_hash(&record.as_built))
    );
    let by = match &arrivals.commanded {
        Some(_) => ", laid (simulated)",
        None if record.is_simulated() => ", commanded (simulated)",
        None if feedback.is_some() => ", from the steps",
        None => "",
    };
    text += &arrived("final", &arrivals.body, by);
    if let Some(commanded) = &arrivals.commanded {
        text += &arrived("commanded", commanded, ", from the steps");
    }
    if let Some(ReplayedFeedback { fed_back, plan }) = feedback {
        text += &arrived("estimate", &fed_back.arrival(plan), ", from feedback");
    }
    text += &record.result.as_ref().and_then(|logged| logged.plan_deviation.as_ref()).map(deviates).unwrap_or_default();
    text + &cautions(record)
}

/// Returns warnings about the unknown parts of the body.
fn cautions(record: &RecordedRun) -> String {
    let mut text = String::new();
    let (unknown, lost) = (record.unknown_layers(), record.lost.len());
    if unknown > lost {
        let kept = unknown - lost;
        text += &format!(
            "caution   {kept} layers were interrupted and kept as they are; this result counts them as planned\n"
        );
    }
    if lost > 0 {
        text +=
            &format!("caution   the run log lacks the lines of {lost} layers; this result counts them as planned\n");
    }
    match record.missing_simulated_layers() {
        0 => {}
        layers => {
            text += &format!(
                "caution   the run log lacks the positions of {layers} layers; this result counts them as \
                 commanded\n"
            );
        }
    }
    text
}

/// Returns the result of feedback with its plan. `None` if the growth had no feedback. If no robot is given and the
/// robot of the log cannot be used, the estimate is omitted with a warning.
fn fed_back(record: &RecordedRun, robot: Option<&Path>) -> Result<Option<ReplayedFeedback>, Failure> {
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
            growbot_host::warning!("the estimate of feedback is left out: {}", failure.message());
            return Ok(None);
        }
        found => found?,
    };
    let feedback = record.feedback(&Job::of_plan(&found, &plan), &plan, None);
    let fed_back = feedback.map(|feedback| feedback.result());
    Ok(fed_back.map(|fed_back| ReplayedFeedback { fed_back, plan }))
}

/// Returns two lines of text: the final pose, followed by the text `by`, and its distance from the goal.
fn arrived(name: &str, arrival: &Arrival, by: &str) -> String {
    let [x, y, z, ..] = arrival.final_pose.to_degrees().map(|number| fixed(number, 3));
    let direction = direction_text(&arrival.final_pose, 3);
    format!(
        "{name:<10}{x}, {y}, {z} mm, {direction}{by}\n\
         error     {:.3} mm from the goal, {:.3} deg between the directions\n",
        arrival.position_error_mm, arrival.direction_error_deg
    )
}
