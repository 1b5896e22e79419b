//! Growth on the command line: progress, log, result and exit code.

use clap::ValueEnum;
use growbot_client::growth::{GrowthBoard, GrowthError, GrowthRequest, OnParked};
use growbot_core::link::message::{HostSilencePolicy, State};
use growbot_core::pose::Pose;
use growbot_host::output::print;
use growbot_pictures::growth_table;
use growbot_plan::clock_drift::ClockDrift;
use growbot_plan::forecast::Forecast;
use growbot_plan::growth_report::{GrowthReport, Outcome};
use growbot_plan::job::{Job, JobEvent};
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::run_log::{GrowthResult, RunEvent, RunLog, RunLogError, to_run_events, utc_text};
use growbot_plan::sanitize::json_line;
use growbot_serve::watch::WatchPage;
use time::OffsetDateTime;

use super::failure::Failure;
use super::growth_progress::GrowthProgress;
use super::remedies;
use super::terminal_commands::TerminalCommands;

/// Behaviour of the board when it loses contact with its host.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum OnHostSilence {
    /// Finish the layer and pause, with the heater off after some minutes
    Pause,
    /// Continue to the last layer that the board stores
    Continue,
}

impl From<OnHostSilence> for HostSilencePolicy {
    fn from(what: OnHostSilence) -> Self {
        match what {
            OnHostSilence::Pause => Self::Pause,
            OnHostSilence::Continue => Self::Continue,
        }
    }
}

/// Format of the printed result.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ResultFormat {
    /// A table.
    Table,
    /// A line of JSON.
    Json,
    /// Nothing, because the run log goes to standard output and ends with the result.
    Nothing,
}

impl ResultFormat {
    /// Returns JSON for `--json`, or else the table.
    pub fn of(json: bool) -> Self {
        if json { Self::Json } else { Self::Table }
    }
}

/// A growth under way, with everything that shows it.
pub struct GrowthMonitor<'a> {
    /// The growth that is requested.
    pub request: GrowthRequest<'a>,
    /// Log of the growth.
    pub log: RunLog,
    /// Page that follows the growth.
    pub watch: Option<WatchPage>,
    /// Format of the printed result.
    pub print: ResultFormat,
    /// Number of layers that were laid before this command started.
    pub laid: usize,
    /// Speed of the robot's clock, in multiples of real time. `None` if it is not known.
    pub pace: Option<f64>,
    /// Keyboard for commands of the user.
    pub keyboard: TerminalCommands,
    /// True if the page may send commands.
    pub page_controls: bool,
}

impl GrowthMonitor<'_> {
    /// Returns the reaction to a board that parks after a long pause: the growth waits if the user has a way to
    /// continue it, or else the command ends.
    pub fn when_parked(&self) -> OnParked {
        if self.keyboard.is_there() || self.page_controls { OnParked::Wait } else { OnParked::End }
    }

    /// Runs the growth of `job` on a board, shows it, and prints its result.
    pub fn follow(mut self, job: &Job, board: GrowthBoard) -> Result<(), Failure> {
        let period_s = self.request.robot.description().layer.period_s;
        let forecast = self.pace.map(|pace| Forecast { period_s, pace });
        self.log.set_forecast(forecast);
        let layers = self.request.plan.requirements.layers;
        let mut show = GrowthProgress::new(layers as u32, self.laid as u64, OUT_OF_FILAMENT);
        let mut logging = LogHealth::default();
        let grown = self.request.run(job, board, &mut |event| {
            show_job_event(&mut show, event, forecast);
            if let JobEvent::State(state) = event {
                self.keyboard.set_state(*state);
                if let Some(words) = waiting_hint(*state, self.keyboard.is_there(), self.page_controls) {
                    show.warn(&words);
                }
            }
            if let Some(watch) = &self.watch {
                watch.growth().ingest(event);
            }
            let written = self.log.record(event);
            logging.update(written, self.log.missing_lines(), self.watch.as_ref(), |words| show.warn(words));
        });
        show.end();
        let (result, logged) = self.request.end(&grown, &mut self.log);
        if let Some(watch) = self.watch.take() {
            watch.end(result.clone());
        }
        let missing = result.log_lines_missing.unwrap_or(0);
        let logged = match (logged, missing) {
            (Ok(()), 0) => Ok(()),
            (logged, _) => Err(Failure::request_failed(format_args!(
                "the run log is incomplete, {missing} lines are missing{}",
                logged.map_or_else(|error| format!(": {}", error.reason()), |()| String::new())
            ))),
        };
        self.report(grown, show.emergency, &result, logged)
    }

    /// Prints the result of the growth. Returns the failure that counts: of the growth, or after a complete growth that
    /// of the log or of the output.
    fn report(
        &self,
        grown: Result<GrowthReport, GrowthError>,
        emergency: bool,
        result: &GrowthResult,
        logged: Result<(), Failure>,
    ) -> Result<(), Failure> {
        let robot = self.request.kind;
        for warning in &result.warnings {
            growbot_host::warning!("{}: {}", warning.code, remedies::warning_message(warning));
        }
        let is_json = self.print == ResultFormat::Json;
        let printed = match &grown {
            Err(GrowthError::Interrupted(_)) | Ok(_) if is_json => print(&json_line(result)),
            Err(error) if is_json && error.is_refusal() => print(&json_line(result)),
            Ok(grown) if self.print == ResultFormat::Table => {
                print(&growth_table::table(self.request.plan, self.request.robot, grown, result))
            }
            _ => Ok(()),
        };
        if matches!(&grown, Ok(grown) if grown.outcome == Outcome::Done) {
            return logged.and_then(|()| Ok(printed?));
        }
        for failure in [logged.err(), printed.err().map(Failure::from)].into_iter().flatten() {
            failure.print();
        }
        match grown {
            Ok(grown) if emergency && grown.outcome == Outcome::Stopped => Err(emergency_stop_failure(robot)),
            Ok(grown) => outcome_result(grown.outcome, robot),
            Err(GrowthError::NotStarted(error)) => Err(error.into()),
            Err(error) => Err(growth_failure(error, robot)),
        }
    }
}

/// Returns the failure for a robot, simulated or not, that was stopped because its board's clock is wrong.
pub fn clock_drift_failure(drift: &ClockDrift, robot: RobotKind) -> Failure {
    Failure::request_failed(format!("{drift}: the robot was stopped, {}; {}", off_text(robot), ClockDrift::REMEDY))
}

/// Returns the part of a message that names the outputs that are off after a stop.
fn off_text(robot: RobotKind) -> &'static str {
    if robot.is_simulated() {
        "heater and steppers of the simulated robot are off"
    } else {
        "heater and steppers are off"
    }
}

/// Returns the failure for a growth that ended with an error instead of an outcome.
pub fn growth_failure(error: GrowthError, robot: RobotKind) -> Failure {
    match error {
        GrowthError::Interrupted(error) if robot.is_simulated() => {
            Failure::request_failed(format_args!("{}; the robot is simulated", remedies::message(&error)))
        }
        error => Failure::during_request(&error),
    }
}

/// Returns the failure for a growth that an emergency stop has ended.
pub fn emergency_stop_failure(robot: RobotKind) -> Failure {
    let off = off_text(robot);
    Failure::request_failed(format!("emergency stop: {off} until the emergency stop is cleared (`growbot clear`)"))
}

/// Returns success or failure for an outcome.
pub fn outcome_result(outcome: Outcome, robot: RobotKind) -> Result<(), Failure> {
    let (kind, off) = (robot.prefix(), off_text(robot));
    match outcome {
        Outcome::Done => Ok(()),
        Outcome::Stopped => Err(Failure::request_failed(format!("stopped before the last layer: {off}"))),
        Outcome::Fault(fault) => Err(Failure::request_failed(format!(
            "fault {}: {}; {off}",
            fault.code(),
            remedies::fault_explanation(fault)
        ))),
        Outcome::ClockDrift(drift) => Err(clock_drift_failure(&drift, robot)),
        Outcome::Parked => Err(Failure::request_failed(format!(
            "the heater of the {kind}robot was switched off after a long pause: resume the body with `growbot resume`"
        ))),
        Outcome::Interrupted => Err(Failure::request_failed(format!(
            "the {kind}board has restarted, or another host has taken it over: see the board's state with `growbot \
             status`, and resume the body with `growbot resume`",
        ))),
        Outcome::Lost if robot.is_simulated() => {
            Err(Failure::request_failed("lost the connection to the simulated board; the robot is simulated"))
        }
        Outcome::Lost => Err(Failure::request_failed(
            "lost the connection to the board; the robot may still be growing: run `growbot status`, and if that fails \
             cut the robot's power",
        )),
    }
}

/// Returns instructions for a robot that is paused or parked. `None` in other states, and if the user has neither a
/// keyboard nor a page that controls the robot.
fn waiting_hint(state: State, keyboard: bool, page: bool) -> Option<String> {
    let goes_on = match state {
        State::Paused => "continues",
        State::Parked => "heats up, homes and continues",
        _ => return None,
    };
    match (keyboard, page) {
        (true, true) => Some(format!("type `continue` or press Continue on the page: the robot then {goes_on}")),
        (true, false) => Some(format!("type `continue`: the robot then {goes_on}; `stop` stops it")),
        (false, true) => Some(format!("press Continue on the page: the robot then {goes_on}")),
        (false, false) => None,
    }
}

/// Shows an event of a job. The simulated layers are not shown.
fn show_job_event(show: &mut GrowthProgress, event: &JobEvent, forecast: Option<Forecast>) {
    if matches!(event, JobEvent::Simulated { .. }) {
        return;
    }
    for mut shown in to_run_events(event, &mut Pose::UPRIGHT.frame()) {
        if let (RunEvent::Status(written), JobEvent::Status(status)) = (&mut shown, event) {
            let finish = forecast.and_then(|forecast| forecast.finish_of(OffsetDateTime::now_utc(), status));
            written.finish_utc = finish.map(utc_text);
        }
        show.ingest(&shown);
    }
}

/// Instructions for a robot that waits for filament.
const OUT_OF_FILAMENT: &str = "out of filament: push new filament in up to the feed, then `preheat`, `load`, `purge` \
                               (here or on a page with --control), and `continue`; the robot waits for an hour at \
                               standby temperature";

/// Watches whether the run log can be written. A change is reported at once, on the terminal and on the page.
#[derive(Default)]
struct LogHealth {
    fails: bool,
}

impl LogHealth {
    fn update(
        &mut self,
        written: Result<(), RunLogError>,
        missing: usize,
        watch: Option<&WatchPage>,
        say: impl FnOnce(&str),
    ) {
        let was = std::mem::replace(&mut self.fails, written.is_err());
        let words = match (was, written) {
            (false, Err(error)) => Some(error.to_string()),
            (true, Ok(())) if missing == 0 => Some("the run log is writable again: no line is missing".to_owned()),
            (true, Ok(())) => Some(format!("the run log is writable again: {missing} lines are missing")),
            _ => None,
        };
        let Some(words) = words else { return };
        say(&words);
        if let Some(watch) = watch {
            watch.growth().set_warning(self.fails.then_some(words));
        }
    }
}

#[cfg(test)]
mod tests {
    use growbot_client::client::ClientError;
    use growbot_core::link::message::Fault;
    use growbot_core::plan::Planner;
    use growbot_core::pose::Pose;
    use growbot_plan::arrival::Arrival;
    use growbot_plan::growth_report::MeasuredBy;
    use growbot_plan::plan::Plan;

    use super::*;

    const DRIFT: ClockDrift = ClockDrift { board_ms: 28_500, host_ms: [30_000, 30_100] };

    #[test]
    fn clock_drift_has_its_own_outcome_with_drift_and_limit() {
        let robot = growbot_plan::robot_file::load("growbot-a".as_ref()).unwrap();
        let up = |z| Pose::from_degrees([0.0, 0.0, z, 0.0, 90.0]).unwrap();
        let plan = Plan::new(&robot, &up(0.0), &up(2.1), 100.0, Planner::Shortest).unwrap();
        let grown = |outcome| GrowthReport {
            outcome,
            plan_id: 1,
            body: Vec::new(),
            arrival: Arrival::of(&plan.start.frame(), &plan.goal, 2.1),
            duration_s: 0.0,
            filament_mm: 0.0,
            laid: 0,
            as_built: Vec::new(),
            interrupted: None,
            measured_by: MeasuredBy::Steps,
            feedback: None,
        };
        let json = |outcome| {
            serde_json::to_value(GrowthResult::new(&grown(outcome), (&robot, &plan), None, None, RobotKind::Real))
                .unwrap()
        };
        let drifted = json(Outcome::ClockDrift(DRIFT));
        assert_eq!(drifted["outcome"], "clock-drift");
        assert!((drifted["clock_drift"]["percent"].as_f64().unwrap() + 5.0).abs() < 1e-9, "{drifted}");
        assert_eq!(drifted["clock_drift"]["limit_percent"], 2.0);
        assert!(json(Outcome::Stopped)["clock_drift"].is_null());
    }

    #[test]
    fn messages_mark_simulated_robots_and_do_not_ask_to_cut_the_power() {
        let outcomes = [
            None,
            Some(Outcome::Stopped),
            Some(Outcome::Fault(Fault::OverTemperature)),
            Some(Outcome::ClockDrift(DRIFT)),
            Some(Outcome::Parked),
            Some(Outcome::Interrupted),
            Some(Outcome::Lost),
        ];
        for outcome in outcomes {
            let result =
                |kind| outcome.map_or(Err(emergency_stop_failure(kind)), |outcome| outcome_result(outcome, kind));
            let message = |kind| result(kind).expect_err("not complete").message().to_owned();
            assert!(
                message(RobotKind::Simulated).contains("simulated") && !message(RobotKind::Simulated).contains("power"),
                "{}",
                message(RobotKind::Simulated)
            );
            assert!(!message(RobotKind::Real).contains("simulated"), "{}", message(RobotKind::Real));
        }
        let silent =
            || GrowthError::Interrupted(ClientError::StopNotAcknowledged { port: "sim (simulated)".to_owned() });
        assert!(growth_failure(silent(), RobotKind::Simulated).message().ends_with("the robot is simulated"));
        assert!(growth_failure(silent(), RobotKind::Real).message().contains("cut the robot's power"));
    }

    #[test]
    fn a_continue_hint_is_given_only_to_a_waiting_robot() {
        assert!(waiting_hint(State::Parked, true, false).unwrap().contains("heats up"));
        assert!(waiting_hint(State::Paused, false, true).unwrap().contains("page"));
        assert_eq!(waiting_hint(State::Growing, true, true), None);
        assert_eq!(waiting_hint(State::Parked, false, false), None);
    }
}
