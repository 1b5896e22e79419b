//! Console that reads line by line: on a terminal, with history and completion, or in a pipe.

use std::io::{self, IsTerminal};
use std::sync::Arc;
use std::sync::mpsc::RecvTimeoutError;
use std::time::Duration;

use growbot_client::client::Client;
use growbot_client::growth::{CommandQueue, GrowthBoard, GrowthRequest, OnParked};
use growbot_client::maintenance::MaterialPresets;
use growbot_core::layer_bytes::decode;
use growbot_core::link::message::{HostSilencePolicy, Message, State};
use growbot_core::plan::Planner;
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_host::output::print;
use growbot_pictures::growth_table;
use growbot_plan::growth_report::Outcome;
use growbot_plan::job::JobEvent;
use growbot_plan::plan::{Goal, Plan, PlanOptions};
use growbot_plan::run_log::RunLog;
use growbot_sim::simulated_tip::{SimulatedTip, ground_truth};
use rustyline::completion::Completer;
use rustyline::error::ReadlineError;
use rustyline::highlight::Highlighter;
use rustyline::hint::{Hint, Hinter};
use rustyline::history::FileHistory;
use rustyline::validate::Validator;
use rustyline::{CompletionType, Config, Context, Editor, Helper};

use super::board_requests::{refusal_text, send};
use super::commands::{BoardRequest, ConsoleCommand, complete, help, hint, parse};
use super::history;
use super::script::{SkippedCommands, StdinLines, is_active, lines_of_stdin, still_active_text};
use crate::cli::board_report::BoardReport;
use crate::cli::failure::Failure;
use crate::cli::port_arg::SelectedPort;
use crate::cli::stop_on_interrupt::stop_on_interrupt;
use crate::cli::{growth_monitor, remedies};

/// Interval of the checks for Ctrl-C while the console waits for a line.
const LOOK: Duration = Duration::from_millis(100);

/// A session on a terminal or a pipe.
pub struct ConsoleSession {
    client: Client,
    /// The simulated tip, with the body as it is really laid. `None` if the tip is not simulated.
    simulation: Option<Box<dyn SimulatedTip>>,
    robot: Robot,
    presets: MaterialPresets,
    port: SelectedPort,
    /// Stop requests of the user (Ctrl-C).
    orders: Arc<CommandQueue>,
}

/// Error that ends a script before its last line.
struct ScriptError {
    failure: Failure,
    /// Number of the last line whose command was started, from 1. It is 0 if no command was started.
    line: usize,
    /// True if the command of the last line that was started has failed.
    failed: bool,
}

/// Action of the console after a command: read the next line, or end.
enum LineOutcome {
    Continue,
    Quit,
}

impl ConsoleSession {
    /// Creates a session with a board. Ctrl-C requests a stop from then on.
    pub fn new(
        mut client: Client,
        simulation: Option<Box<dyn SimulatedTip>>,
        robot: Robot,
        presets: MaterialPresets,
        port: SelectedPort,
    ) -> Self {
        let orders = stop_on_interrupt(&mut client, &port);
        Self { client, simulation, robot, presets, port, orders }
    }

    /// Reads and runs commands until the input ends or the user quits. In a pipe, the first failure also ends the
    /// run.
    pub fn run(&mut self) -> Result<(), Failure> {
        if io::stdin().is_terminal() { self.interact() } else { self.read_pipe() }
    }

    fn interact(&mut self) -> Result<(), Failure> {
        self.greet()?;
        let config = Config::builder().completion_type(CompletionType::List).build();
        let mut editor: Editor<Help, FileHistory> = Editor::with_config(config).map_err(Failure::bad_input)?;
        editor.set_helper(Some(Help));
        let history = history::file();
        // A history that cannot be read or written is not an error.
        let _ = history.as_ref().map(|file| editor.load_history(file));
        loop {
            match editor.readline("growbot> ") {
                Ok(line) => {
                    if editor.add_history_entry(&line).unwrap_or(false) {
                        let _ = history.as_ref().map(|file| editor.append_history(file));
                    }
                    match self.stop_if_interrupted().and_then(|()| self.command(&line)) {
                        Ok(LineOutcome::Continue) => {}
                        Ok(LineOutcome::Quit) => return self.leave(),
                        Err(failure) => failure.print(),
                    }
                }
                Err(ReadlineError::Eof) => return self.leave(),
                Err(ReadlineError::Interrupted) => return self.stop_if_it_works(),
                Err(error) => {
                    self.leave()?;
                    return Err(Failure::bad_input(error));
                }
            }
        }
    }

    /// Runs lines until the last one, or until the first that fails. The lines after a failure are not run, because
    /// they assume that it succeeded.
    fn read_pipe(&mut self) -> Result<(), Failure> {
        let lines = lines_of_stdin();
        match self.carry_out(&lines) {
            Ok(()) => self.leave(),
            Err(ended) => self.abort_script(ended, &lines),
        }
    }

    fn carry_out(&mut self, lines: &StdinLines) -> Result<(), ScriptError> {
        self.greet().map_err(|failure| ScriptError { failure, line: 0, failed: false })?;
        for line in 1.. {
            let between = |failure| ScriptError { failure, line: line - 1, failed: false };
            let bytes = loop {
                self.stop_if_interrupted().map_err(between)?;
                match lines.recv_timeout(LOOK) {
                    Ok(bytes) => break bytes.map_err(|error| between(Failure::bad_input(error)))?,
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => return Ok(()),
                }
            };
            let done = match String::from_utf8(bytes) {
                Ok(text) => self.command(&text),
                Err(error) => Err(Failure::request_failed(format!(
                    "the input line {:?} is not UTF-8 text (at byte {}) and was not executed: send UTF-8 text",
                    String::from_utf8_lossy(error.as_bytes()),
                    error.utf8_error().valid_up_to()
                ))),
            };
            match done.map_err(|failure| ScriptError { failure, line, failed: true })? {
                LineOutcome::Continue => {}
                LineOutcome::Quit => break,
            }
        }
        Ok(())
    }

    /// Prints the board's status before the first command.
    fn greet(&mut self) -> Result<(), Failure> {
        Ok(print(&BoardReport::read(&mut self.client, &self.port)?.text())?)
    }

    /// Reports why a script ended early, which commands are not run, and what the robot is doing.
    fn abort_script(&mut self, ended: ScriptError, lines: &StdinLines) -> Result<(), Failure> {
        let ScriptError { failure, line, failed } = ended;
        // The failure is printed first, because the board may take long to respond.
        if !failure.is_stdout_closed() {
            let message = failure.message();
            if failed {
                growbot_host::error!("{message}; line {line} failed, and the lines after it are not executed");
            } else {
                growbot_host::error!("{message}; no command after line {line} is executed");
            }
        }
        let left_out = SkippedCommands::after(line, lines);
        let stopped = self.stop_if_interrupted();
        let status = self.client.status();
        // The user may have pressed Ctrl-C during the status request.
        let stopped = stopped.and_then(|()| self.stop_if_interrupted());
        let state = match (stopped, status) {
            (Err(stopped), _) => stopped.message().to_owned(),
            (Ok(()), Ok(status)) if is_active(status.state) => still_active_text(status.state, &self.robot, &self.port),
            (Ok(()), Ok(_)) if failure.is_stdout_closed() && left_out.is_nothing() => return Err(failure),
            (Ok(()), Ok(status)) => format!(
                "heater and steppers of the {}robot are off (it is in state {})",
                self.port.kind().prefix(),
                status.state.name()
            ),
            (Ok(()), Err(error)) => format!(
                "the state of the {}robot is unknown ({}): run `growbot status`, and if that fails cut the robot's \
                 power",
                self.port.kind().prefix(),
                remedies::message(&error)
            ),
        };
        let left_out = left_out.text();
        let message = match (failure.is_stdout_closed(), line) {
            (false, _) => format!("{left_out}; {state}"),
            (true, 0) => format!("standard output was closed by the program that reads it: {left_out}; {state}"),
            (true, line) => {
                format!(
                    "standard output was closed by the program that reads it, during the command in line {line}: \
                     {left_out}; {state}"
                )
            }
        };
        // No command was run if not even the first line could be read.
        let rest = if line == 0 && failure.is_bad_input() {
            Failure::bad_input(message)
        } else {
            Failure::request_failed(message)
        };
        Err(if failure.is_stdout_closed() { rest } else { rest.into_warning() })
    }

    /// Warns about a real robot that still works when the console is left.
    fn leave(&mut self) -> Result<(), Failure> {
        if self.port.kind().is_simulated() {
            return Ok(());
        }
        match self.client.status() {
            Ok(status) if is_active(status.state) => {
                growbot_host::warning!("{}", still_active_text(status.state, &self.robot, &self.port));
                Ok(())
            }
            Ok(_) => Ok(()),
            Err(error) => Err(Failure::request_failed(format!(
                "{}; the robot may still be hot or moving: run `growbot status`, and if that fails cut the robot's \
                 power",
                remedies::message(&error)
            ))),
        }
    }

    /// Handles Ctrl-C at the prompt, where it arrives as a key and not as a signal. Stops the robot if it is hot or
    /// moves, or if its status cannot be read.
    fn stop_if_it_works(&mut self) -> Result<(), Failure> {
        match self.client.status() {
            Ok(status) if !is_active(status.state) => Ok(()),
            _ => Err(self.stop()),
        }
    }

    /// Stops the robot and returns an error, if Ctrl-C was pressed.
    fn stop_if_interrupted(&mut self) -> Result<(), Failure> {
        if self.orders.clear() { Err(self.stop()) } else { Ok(()) }
    }

    /// Stops the robot, and returns the result as a failure.
    fn stop(&mut self) -> Failure {
        match self.send(&BoardRequest::Stop) {
            Ok(stopped) => Failure::request_failed(stopped.trim_end()),
            Err(failure) => failure,
        }
    }

    fn send(&mut self, what: &BoardRequest) -> Result<String, Failure> {
        let permit = self.orders.permit_now();
        send(&mut self.client, &self.robot, &self.port, &self.presets, what, &permit)
    }

    fn command(&mut self, line: &str) -> Result<LineOutcome, Failure> {
        match parse(line).map_err(Failure::request_failed)? {
            ConsoleCommand::Nothing => {}
            ConsoleCommand::Board(what) => print(&self.send(&what)?)?,
            ConsoleCommand::Grow(goal) => self.grow(&goal)?,
            ConsoleCommand::Wait(seconds) => self.wait(seconds)?,
            ConsoleCommand::Help => print(&help())?,
            ConsoleCommand::Quit => return Ok(LineOutcome::Quit),
        }
        Ok(LineOutcome::Continue)
    }

    fn grow(&mut self, goal: &Goal) -> Result<(), Failure> {
        let radius = self.robot.description().planning_radius_mm;
        let search = PlanOptions { radius, planner: Planner::Shortest, avoid_self_collision: true, existing: None };
        let plan = Plan::through_waypoints(&self.robot, &Pose::UPRIGHT, &[], goal, &search)?;
        let kind = self.port.kind();
        let request = GrowthRequest { kind, ..GrowthRequest::new(&self.robot, &plan) };
        for warning in &plan.warnings {
            growbot_host::warning!("{}: {}", warning.code, remedies::warning_message(warning));
        }
        request.check().map_err(|refusal| Failure::request_failed(refusal_text(&refusal)))?;
        let mut emergency = false;
        let mut show = |event: &JobEvent| {
            if let JobEvent::Status(status) = event {
                emergency |= status.state == State::EmergencyStop;
            }
            if let JobEvent::State(state) = event {
                // A closed standard output is reported when the table is printed.
                let _ = print(&format!("{}\n", state.name()));
            }
        };
        let board = GrowthBoard {
            client: &mut self.client,
            truth: ground_truth(&mut self.simulation),
            commands: &self.orders,
            silence: HostSilencePolicy::Pause,
            parked: OnParked::End,
        };
        let grown = request.run(&request.job(), board, &mut show);
        let (result, _) = request.end(&grown, &mut RunLog::disabled());
        let grown = grown.map_err(|error| growth_monitor::growth_failure(error, kind))?;
        self.orders.clear();
        for warning in &result.warnings {
            growbot_host::warning!("{}: {}", warning.code, remedies::warning_message(warning));
        }
        print(&growth_table::table(&plan, &self.robot, &grown, &result))?;
        if emergency && grown.outcome == Outcome::Stopped {
            return Err(growth_monitor::emergency_stop_failure(kind));
        }
        growth_monitor::outcome_result(grown.outcome, kind)
    }

    fn wait(&mut self, seconds: f64) -> Result<(), Failure> {
        let clock = |client: &mut Client| client.status().map(|status| status.uptime_ms);
        // The wait uses the board's clock, because on `sim` time passes only during the wait.
        let until = clock(&mut self.client)?.saturating_add((seconds * 1000.0) as u64);
        loop {
            let now = clock(&mut self.client)?;
            if now >= until {
                return Ok(());
            }
            self.stop_if_interrupted()?;
            if let Some(drift) = self.client.stop_if_clock_drifts()? {
                return Err(growth_monitor::clock_drift_failure(&drift, self.port.kind()));
            }
            let left = Duration::from_millis((until - now).min(1000));
            match self.client.event(left)? {
                Some(Message::StateChanged(change)) => {
                    let fault = change.fault.map_or(String::new(), |fault| format!(", {}", fault.code()));
                    print(&format!("{}{fault}\n", change.state.name()))?;
                }
                Some(Message::LayerLaid(laid)) => {
                    print(&match &laid.as_built {
                        Some(bytes) => format!("layer {}: {:.4} mm\n", laid.index, decode(bytes).height),
                        None => format!(
                            "layer {}: height unknown, because the layer was interrupted and skipped, or the journal \
                             could not be written\n",
                            laid.index
                        ),
                    })?;
                }
                _ => {}
            }
        }
    }
}

/// Completion and hints for the line being typed.
struct Help;

impl Completer for Help {
    type Candidate = String;

    fn complete(&self, line: &str, pos: usize, _: &Context<'_>) -> rustyline::Result<(usize, Vec<String>)> {
        Ok(complete(line.get(..pos).unwrap_or(line)))
    }
}

/// Hint after the cursor. It is never inserted into the line.
struct Argument(&'static str);

impl Hint for Argument {
    fn display(&self) -> &str {
        self.0
    }

    fn completion(&self) -> Option<&str> {
        None
    }
}

impl Hinter for Help {
    type Hint = Argument;

    fn hint(&self, line: &str, pos: usize, _: &Context<'_>) -> Option<Argument> {
        if pos == line.len() { hint(line).map(Argument) } else { None }
    }
}

impl Highlighter for Help {}
impl Validator for Help {}
impl Helper for Help {}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::rc::Rc;

    use growbot_core::link::message::State;
    use growbot_plan::robot_file;
    use growbot_sim::port::sim::Sim;

    use super::*;
    use crate::cli::port_arg::LinkArgs;

    #[test]
    fn ctrl_c_at_the_prompt_stops_an_active_robot() {
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let sim = Rc::new(RefCell::new(Sim::new(robot.clone())));
        let mut client = Client::new(Box::new(Rc::clone(&sim)), "sim");
        client.open_session_for(&robot).unwrap();
        let port = LinkArgs::default().at("sim".to_owned()).ok().unwrap();
        let mut session = ConsoleSession {
            client,
            simulation: None,
            robot,
            presets: MaterialPresets::default(),
            port,
            orders: Arc::default(),
        };
        assert!(session.stop_if_it_works().is_ok());
        assert_eq!(sim.borrow().state(), State::Idle);

        for what in [BoardRequest::Plan(Pose::from_degrees([0.0, 0.0, 60.0, 0.0, 90.0]).unwrap()), BoardRequest::Start]
        {
            assert!(session.send(&what).is_ok(), "{what:?}");
        }
        assert_eq!(sim.borrow().state(), State::Heating);
        let Err(failure) = session.stop_if_it_works() else { panic!("it is left heating") };
        assert_eq!(failure.message(), "stopped: heater and steppers of the simulated robot are off");
        assert_eq!(sim.borrow().state(), State::Stopped);
    }
}
