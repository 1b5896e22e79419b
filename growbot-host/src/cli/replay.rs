//! `growbot replay`: rebuilds the body of a run log.

use std::path::{Path, PathBuf};

use clap::Args;
use growbot_core::angle::degrees;
use growbot_core::layer::{Layer, grow};
use growbot_core::layer_bytes::decode;
use growbot_host::output::print;
use growbot_plan::arrival::Arrival;
use growbot_plan::clock_drift::ClockDrift;
use growbot_plan::degrees::degrees_below_turn;
use growbot_plan::feedback::FeedbackReport;
use growbot_plan::figures::{direction_text, fixed};
use growbot_plan::growth_report::{MeasuredBy, as_built_hash};
use growbot_plan::job::Job;
use growbot_plan::plan::Plan;
use growbot_plan::plan_file::format_hash;
use growbot_plan::run_log::{ArrivalJson, FeedbackResult, GrowthResult, RecordedRun};
use growbot_plan::sanitize::json_line;
use growbot_plan::table::{NumberFormat, Table};

use super::failure::Failure;
use super::growth_table::deviates;
use super::opened::{robot_of, warn_of_damage};

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
        replayed.text(&arrivals, fed_back.as_ref())
    })?)
}

/// Returns a text of a few lines about the body of a log.
pub fn text_of(record: &RecordedRun) -> Result<String, Failure> {
    let replayed = ReplayedBody::of(record);
    Ok(replayed.text(&replayed.arrivals()?, None))
}

/// The body that is rebuilt from a run log.
struct ReplayedBody<'a> {
    record: &'a RecordedRun,
    /// Layers that follow from the steps of the board's motors.
    commanded: Vec<Layer>,
    /// Layers of the plastic of a simulated tip. `None` if the log does not contain them.
    simulated: Option<Vec<Layer>>,
}

/// Final poses of the body.
struct Arrivals {
    /// Final pose of the body: as laid on a simulated tip, or else as commanded.
    body: Arrival,
    /// Final pose of the commanded body. `None` if the log does not contain the layers as laid on a simulated tip.
    commanded: Option<Arrival>,
}

/// Result of feedback, and the plan that it followed.
struct ReplayedFeedback {
    fed_back: FeedbackReport,
    plan: Plan,
}

impl<'a> ReplayedBody<'a> {
    fn of(record: &'a RecordedRun) -> Self {
        let commanded = record.commanded().map(|layer| decode(&layer)).collect();
        Self { record, commanded, simulated: record.simulated() }
    }

    fn body(&self) -> &[Layer] {
        self.simulated.as_ref().unwrap_or(&self.commanded)
    }

    fn length_mm(&self) -> f64 {
        self.body().iter().fold(0.0, |length, layer| length + layer.height)
    }

    fn arrivals(&self) -> Result<Arrivals, Failure> {
        let (start, goal) = self.record.start_and_goal()?;
        let path_length = self.record.plan.length_mm;
        let end_of = |body: &[Layer]| Arrival::of(&grow(&start.frame(), body.iter().copied()), &goal, path_length);
        let commanded = self.simulated.is_some().then(|| end_of(&self.commanded));
        Ok(Arrivals { body: end_of(self.body()), commanded })
    }

    /// Returns the result of the growth. Pose, layers and length are those of the rebuilt body, and the rest is from
    /// the result in the log.
    fn result(&self, arrivals: &Arrivals, feedback: Option<&ReplayedFeedback>) -> GrowthResult {
        let record = self.record;
        let logged = record.result.as_ref();
        GrowthResult {
            outcome: record.outcome(),
            simulated: record.is_simulated(),
            error: logged.and_then(|logged| logged.error.clone()),
            fault: logged.and_then(|logged| logged.fault.clone()),
            clock_drift: record.clock_drift(),
            arrival: Some((&arrivals.body).into()),
            layers: self.body().len(),
            length_mm: self.length_mm(),
            seed: logged.and_then(|logged| logged.seed),
            measured_by: Some(if self.simulated.is_some() { MeasuredBy::Tip } else { MeasuredBy::Steps }),
            feedback: feedback.map(|feedback| FeedbackResult::new(&feedback.fed_back, &feedback.plan, None)),
            plan_deviation: logged.and_then(|logged| logged.plan_deviation),
            scene: logged.and_then(|logged| logged.scene.clone()),
            warnings: logged.map_or_else(Vec::new, |logged| logged.warnings.clone()),
            duration_s: logged.and_then(|logged| logged.duration_s),
            filament_mm: logged.and_then(|logged| logged.filament_mm),
            plan_id: Some(record.plan_id),
            as_built_hash: Some(as_built_hash(&record.as_built)),
            unknown_layers: record.unknown_layers(),
            interrupted: logged.and_then(|logged| logged.interrupted),
            commanded: arrivals.commanded.as_ref().map(ArrivalJson::from),
            skipped_lines: Some(record.damage.lines),
            log_lines_missing: logged.and_then(|logged| logged.log_lines_missing),
        }
    }

    /// Returns the result as a few lines of text.
    fn text(&self, arrivals: &Arrivals, feedback: Option<&ReplayedFeedback>) -> String {
        let record = self.record;
        let remark = if record.is_simulated() { ", simulated" } else { "" };
        let plan_id = format_hash(record.plan_id);
        let mut text = format!("run       {}, plan {plan_id}, robot {}{remark}\n", record.outcome(), record.robot.name);
        if let Some(drift) = record.clock_drift() {
            text += &format!("clock     {drift}; {}\n", ClockDrift::REMEDY);
        }
        text += &format!(
            "body      {} layers of {}, {:.1} mm, as built {}\n",
            self.body().len(),
            record.total,
            self.length_mm(),
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
        text +=
            &record.result.as_ref().and_then(|logged| logged.plan_deviation.as_ref()).map(deviates).unwrap_or_default();
        text + &self.cautions()
    }

    /// Returns warnings about the unknown parts of the body.
    fn cautions(&self) -> String {
        let record = self.record;
        let mut text = String::new();
        let (unknown, lost) = (record.unknown_layers(), record.lost.len());
        if unknown > lost {
            let kept = unknown - lost;
            text += &format!(
                "caution   {kept} layers were interrupted and kept as they are; this result counts them as planned\n"
            );
        }
        if lost > 0 {
            text += &format!(
                "caution   the run log lacks the lines of {lost} layers; this result counts them as planned\n"
            );
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

    /// Returns the layers as CSV. On a simulated tip, the commanded layers are beside them.
    fn layers_table(&self) -> String {
        let values = |layer: &Layer| [degrees_below_turn(layer.alpha), layer.height, degrees(layer.tilt)];
        let mut table = Table::new(NumberFormat::Plain)
            .column("layer", |(index, _): &(usize, &Layer)| *index)
            .columns(["alpha_deg", "height_mm", "tilt_deg"], move |(_, layer)| values(layer));
        if self.simulated.is_some() {
            let names = ["commanded_alpha_deg", "commanded_height_mm", "commanded_tilt_deg"];
            // The layer under way was not finished, so it has no commanded values.
            table = table.columns(names, move |(index, _)| {
                let values = self.commanded.get(*index).map(values);
                [0, 1, 2].map(|column| values.map(|values| values[column]))
            });
        }
        table.csv(self.body().iter().enumerate())
    }
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
