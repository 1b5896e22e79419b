//! `growbot doctor`: guides the user through the commissioning of a new robot, and records findings and answers.
//!
//! - `session` has the board, the person and the report, `answers` the person's input, and `summary` the
//!   text of the findings.
//! - `link`, `inputs`, `motors` and `heating` have the steps, in their order.

mod answers;
mod heating;
mod inputs;
mod link;
mod motors;
mod session;
mod summary;
#[cfg(test)]
mod tests;

use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};

use clap::Args;
use growbot_client::commissioning_report::{CommissioningReport, Finding, StepOutcome};
use growbot_host::note;
use growbot_host::output::print;
use growbot_plan::sanitize::json_line;
use growbot_sim::port::TipSettings;

use self::answers::OperatorInput;
use self::session::DoctorSession;
use self::summary::{Summary, line};
use super::failure::Failure;
use super::find_robot::robot_at;
use super::port_arg::{Connection, RequiredPortArg, SelectedPort};
use super::robot_arg::RobotArg;
use super::stop_on_interrupt::stop_on_interrupt;

/// Commission a new robot step by step: link, sensors, motors, heater
///
/// The command guides you from one action to the next, and checks the board's readings. It checks the sensors at rest,
/// then the motors in a dry run. The heater comes last: first with nothing connected, then with a lamp, then with the
/// nozzle.
///
/// Enter confirms that an action is done, `skip` skips a step, and `quit` leaves. Ctrl-C switches everything off.
/// Answers may come from a pipe, one per line.
///
/// The report records each answer with its time. If the report exists, steps that have passed are not repeated. If the
/// robot file has changed since, the steps on which later steps rely are repeated.
#[derive(Args)]
#[command(after_help = EXAMPLES)]
pub struct DoctorArgs {
    #[command(flatten)]
    port: RequiredPortArg,
    #[command(flatten)]
    robot: RobotArg,
    /// File of the report. It is written after each step, and continued if it exists
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Repeat the steps that have passed according to the report
    #[arg(long)]
    again: bool,
    /// Print the report as one line of JSON
    #[arg(long)]
    json: bool,
}

const EXAMPLES: &str = "\
Examples:
  growbot doctor --port /dev/ttyACM0 --robot mine.toml -o doctor.json
  yes skip | growbot doctor --port /dev/ttyACM0     # the steps that need no hands

Exit codes: 0, every step passed, was left out by choice, or is for a part that
the robot does not have; 1, one failed or was not reached; 2, invalid arguments
or input.";

/// A step of the commissioning: its name in the report, and its function.
struct CommissioningStep {
    name: &'static str,
    /// True if the step needs the user. The other steps are repeated each time the command runs.
    asks: bool,
    /// True if a failure ends the command, because the steps after it would be unsafe or useless.
    gates: bool,
    run: fn(&mut DoctorSession) -> Result<Finding, Failure>,
}

/// The steps of the commissioning, in their order.
const STEPS: [CommissioningStep; 13] = [
    CommissioningStep { name: "link", asks: false, gates: true, run: link::check_link },
    CommissioningStep { name: "description", asks: false, gates: true, run: link::check_description },
    CommissioningStep { name: "temperature", asks: false, gates: true, run: inputs::temperature },
    CommissioningStep { name: "supply", asks: false, gates: false, run: inputs::supply },
    CommissioningStep { name: "index", asks: true, gates: false, run: inputs::index },
    CommissioningStep { name: "filament", asks: true, gates: false, run: inputs::filament },
    CommissioningStep { name: "emergency-stop", asks: true, gates: true, run: inputs::emergency_stop },
    CommissioningStep { name: "orientation", asks: true, gates: false, run: inputs::orientation },
    CommissioningStep { name: "head", asks: true, gates: false, run: motors::head },
    CommissioningStep { name: "feed", asks: true, gates: false, run: motors::feed },
    CommissioningStep { name: "no-heater", asks: true, gates: true, run: heating::without_heater },
    CommissioningStep { name: "lamp", asks: true, gates: true, run: heating::lamp },
    CommissioningStep { name: "nozzle", asks: true, gates: true, run: heating::nozzle },
];

/// Options of a run of the command.
#[derive(Clone, Copy)]
struct RunOptions<'a> {
    /// File of the report. `None` if none is written.
    file: Option<&'a Path>,
    /// True to repeat steps that have passed according to the report.
    again: bool,
    /// True to print each step as it ends.
    prints: bool,
}

/// Runs the command.
pub fn run(args: &DoctorArgs) -> Result<(), Failure> {
    let port = args.port.resolve()?;
    let robot = args.robot.load()?;
    let mut report = match &args.output {
        Some(file) => CommissioningReport::open(file)?,
        None => CommissioningReport::default(),
    };
    report.begin(&robot, port.text(), port.kind())?;
    let _lent = robot_at(&port, &args.robot)?.lease("growbot doctor")?;
    let Connection { mut client, simulation } = port.connect(&robot, &TipSettings::default())?;
    client.open_session()?;
    // From here on Ctrl-C stops the board. Nothing heats or moves before this line.
    let orders = stop_on_interrupt(&mut client, &port);
    let mut session = DoctorSession {
        client,
        robot,
        simulated_operator: simulation,
        orders,
        answers: OperatorInput::of_standard_input(),
        recorded_answers: Vec::new(),
        kind: port.kind(),
        port: port.text().to_owned(),
    };
    if session.kind.is_simulated() {
        note!("the robot is simulated: the simulation does by itself what each step requests, whatever you answer");
    } else if !io::stdin().is_terminal() {
        note!("answers are read from standard input, one per line: yes, no, skip, quit or a number");
    }
    let manner = RunOptions { file: args.output.as_deref(), again: args.again, prints: !args.json };
    let remark = if session.kind.is_simulated() { ", simulated: the results do not apply to a real robot" } else { "" };
    manner.print(&format!("{} at {}{remark}\n\n", session.robot.name(), session.port))?;
    let done = commission(&mut session, &mut report, manner);
    // In every case, heater and motors are off at the end.
    let off = session.switch_off();
    manner.save(&report)?;
    if args.json {
        print(&json_line(&report))?;
    }
    done?;
    off?;
    conclude(&report, manner, &port)
}

/// Does the steps. The report includes a step that was interrupted.
fn commission(
    session: &mut DoctorSession,
    report: &mut CommissioningReport,
    manner: RunOptions,
) -> Result<(), Failure> {
    let gates: Vec<&str> = STEPS.iter().filter(|step| step.gates).map(|step| step.name).collect();
    for outdated in report.outdate(&gates) {
        note!("{outdated}: this step is repeated");
    }
    for step in &STEPS {
        if step.asks
            && !manner.again
            && let Some(time) = report.passed_at(step.name)
        {
            manner.print(&line(&Finding::passed(format!("before, {time}")), step.name))?;
            continue;
        }
        session.recorded_answers.clear();
        let done = (step.run)(session);
        let (finding, broken_off) = match done {
            Ok(finding) => (finding, None),
            Err(failure) => (Finding::not_done(failure.message()), Some(failure)),
        };
        manner.print(&line(&finding, step.name))?;
        let ends = step.gates && finding.outcome == StepOutcome::Failed;
        report.add(step.name, finding, std::mem::take(&mut session.recorded_answers));
        manner.save(report)?;
        if let Some(failure) = broken_off {
            return Err(failure);
        }
        if ends {
            return Ok(());
        }
    }
    Ok(())
}

impl RunOptions<'_> {
    fn print(self, text: &str) -> Result<(), Failure> {
        if self.prints {
            print(text)?;
        }
        Ok(())
    }

    fn save(self, report: &CommissioningReport) -> Result<(), Failure> {
        Ok(self.file.map_or(Ok(()), |file| report.write(file))?)
    }
}

/// Prints the summary and the next command. Returns an error if a step failed or was not done.
fn conclude(report: &CommissioningReport, manner: RunOptions, port: &SelectedPort) -> Result<(), Failure> {
    let summary = Summary::new(report, &STEPS.map(|step| step.name));
    manner.print(&format!("\n{summary}"))?;
    if let Some(file) = manner.file {
        note!("report written to {}", file.display());
    }
    if !summary.is_good() {
        return Err(Failure::request_failed(summary.describe()));
    }
    manner.print(&if report.passed_at("nozzle").is_some() {
        format!("next     growbot tune --port {}, then the first layer\n", port.text())
    } else {
        format!("next     growbot doctor --port {}, for the steps that were left out\n", port.text())
    })
}
