//! The console line by line: on a terminal, with history and completion, or in a pipe.

use std::io::{self, BufRead, BufReader, IsTerminal};
use std::sync::Arc;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::thread;
use std::time::Duration;

use growbot_core::layer_bytes::decode;
use growbot_core::link::message::{Message, Silence, State};
use growbot_core::plan::Planner;
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_host::client::Client;
use growbot_host::growth::{Job, News, Orders, Outcome, grow_job};
use growbot_host::input::BoundedLines;
use growbot_host::output::print;
use growbot_host::plan::{Plan, Search};
use rustyline::completion::Completer;
use rustyline::error::ReadlineError;
use rustyline::highlight::Highlighter;
use rustyline::hint::{Hint, Hinter};
use rustyline::history::FileHistory;
use rustyline::validate::Validator;
use rustyline::{CompletionType, Config, Context, Editor, Helper};

use super::ask::ask;
use super::commands::{Ask, Command, complete, help, hint, parse};
use super::history;
use crate::cli::interrupt::stop_on_interrupt;
use crate::cli::{ChosenPort, Failure, following, growth_table};

/// So often Ctrl-C is looked for while a line is waited for.
const LOOK: Duration = Duration::from_millis(100);

/// A session on a terminal or a pipe.
pub struct Session {
    client: Client,
    robot: Robot,
    simulated: bool,
    start: Pose,
    /// What Ctrl-C orders: to stop.
    orders: Arc<Orders>,
}

/// What to do after a command.
enum Next {
    GoOn,
    Quit,
}

impl Session {
    /// A session with a board.
    pub fn new(mut client: Client, robot: Robot, start: Pose, port: &ChosenPort) -> Self {
        let orders = stop_on_interrupt(&mut client, port);
        Self { client, robot, simulated: port.is_simulated(), start, orders }
    }

    /// Carries commands out until the last one.
    pub fn run(&mut self) -> Result<(), Failure> {
        if io::stdin().is_terminal() { self.interact() } else { self.read_pipe() }
    }

    fn interact(&mut self) -> Result<(), Failure> {
        let config = Config::builder().completion_type(CompletionType::List).build();
        let mut editor: Editor<Help, FileHistory> = Editor::with_config(config).map_err(Failure::bad_input)?;
        editor.set_helper(Some(Help));
        let history = history::file();
        // A history that cannot be read or kept is no reason to stop.
        let _ = history.as_ref().map(|file| editor.load_history(file));
        loop {
            match editor.readline("growbot> ") {
                Ok(line) => {
                    if editor.add_history_entry(&line).unwrap_or(false) {
                        let _ = history.as_ref().map(|file| editor.append_history(file));
                    }
                    match self.stop_if_interrupted().and_then(|()| self.command(&line)) {
                        Ok(Next::GoOn) => {}
                        Ok(Next::Quit) => return Ok(()),
                        Err(failure) => failure.say(),
                    }
                }
                Err(ReadlineError::Eof | ReadlineError::Interrupted) => return Ok(()),
                Err(error) => return Err(Failure::bad_input(error)),
            }
        }
    }

    /// Carries lines out until the last one, or the first that fails: what follows a failure was written for a robot that had done as asked.
    fn read_pipe(&mut self) -> Result<(), Failure> {
        let (read, lines) = mpsc::sync_channel(0);
        // Reading may wait for long, and Ctrl-C must not. The thread ends with the input or with the program.
        thread::spawn(move || {
            for line in BufReader::new(BoundedLines::of(io::stdin().lock())).split(b'\n') {
                let failed = line.is_err();
                if read.send(line).is_err() || failed {
                    break;
                }
            }
        });
        for number in 1.. {
            let line = loop {
                self.stop_if_interrupted()?;
                match lines.recv_timeout(LOOK) {
                    Ok(line) => break line.map_err(Failure::bad_input)?,
                    Err(RecvTimeoutError::Timeout) => {}
                    Err(RecvTimeoutError::Disconnected) => return Ok(()),
                }
            };
            let done = match String::from_utf8(line) {
                Ok(line) => self.command(&line),
                Err(error) => Err(Failure::answered_no(format!(
                    "the line {:?} is no UTF-8 text (at byte {}): it is not carried out; send UTF-8",
                    String::from_utf8_lossy(error.as_bytes()),
                    error.utf8_error().valid_up_to()
                ))),
            };
            match done {
                Ok(Next::GoOn) => {}
                Ok(Next::Quit) => break,
                Err(failure) if failure.is_reader_gone() => return Err(failure),
                Err(failure) => {
                    return Err(Failure::answered_no(format!(
                        "{}; line {number} failed, and those after it are not carried out",
                        failure.message()
                    )));
                }
            }
        }
        Ok(())
    }

    /// Has the robot stop where Ctrl-C was pressed.
    fn stop_if_interrupted(&mut self) -> Result<(), Failure> {
        if !self.orders.clear() {
            return Ok(());
        }
        let stopped = ask(&mut self.client, &self.robot, self.simulated, &self.start, &Ask::Stop)?;
        Err(Failure::answered_no(stopped.trim_end()))
    }

    fn command(&mut self, line: &str) -> Result<Next, Failure> {
        match parse(line).map_err(Failure::answered_no)? {
            Command::Nothing => {}
            Command::Ask(what) => print(&ask(&mut self.client, &self.robot, self.simulated, &self.start, &what)?)?,
            Command::Grow(goal) => self.grow(&goal)?,
            Command::Wait(seconds) => self.wait(seconds)?,
            Command::Help => print(&help())?,
            Command::Quit => return Ok(Next::Quit),
        }
        Ok(Next::GoOn)
    }

    fn grow(&mut self, goal: &Pose) -> Result<(), Failure> {
        let radius = self.robot.description().planning_radius_mm;
        let search = Search { radius, planner: Planner::Shortest, clear_of_self: true };
        let plan = Plan::through(&self.robot, &self.start, &[], goal, &search)?;
        let job = Job::new(&self.robot, &plan.start, &plan.goal, &plan.path);
        let mut emergency = false;
        let grown = grow_job(&mut self.client, &job, Silence::Hold, &self.orders, &mut |news| {
            if let News::Status(status) = news {
                emergency |= status.state == State::EmergencyStop;
            }
            if let News::State(state) = news {
                // A reader that is gone is noticed when the table is printed.
                let _ = print(&format!("{}\n", state.name()));
            }
        })
        .map_err(|error| following::failed(error, self.simulated))?;
        self.orders.clear();
        print(&growth_table::table(&plan, &self.robot, &grown, None, self.simulated))?;
        following::judged(grown.outcome, grown.outcome == Outcome::Stopped && emergency, self.simulated)
    }

    fn wait(&mut self, seconds: f64) -> Result<(), Failure> {
        let clock = |client: &mut Client| client.status().map(|status| status.uptime_ms);
        // By the board's clock: on `sim` time passes only while we wait.
        let until = clock(&mut self.client)?.saturating_add((seconds * 1000.0) as u64);
        loop {
            let now = clock(&mut self.client)?;
            if now >= until {
                return Ok(());
            }
            self.stop_if_interrupted()?;
            if let Some(drift) = self.client.stop_if_clock_drifts()? {
                return Err(following::stopped_for(&drift, self.simulated));
            }
            let left = Duration::from_millis((until - now).min(1000));
            match self.client.event(left)? {
                Some(Message::StateChanged(change)) => {
                    let fault = change.fault.map_or(String::new(), |fault| format!(", {}", fault.code()));
                    print(&format!("{}{fault}\n", change.state.name()))?;
                }
                Some(Message::Laid(laid)) => {
                    print(&match &laid.as_built {
                        Some(bytes) => format!("layer {}: {:.4} mm\n", laid.index, decode(bytes).height),
                        None => format!("layer {}: cut and let be\n", laid.index),
                    })?;
                }
                _ => {}
            }
        }
    }
}

/// Completes and hints at what is typed.
struct Help;

impl Completer for Help {
    type Candidate = String;

    fn complete(&self, line: &str, pos: usize, _: &Context<'_>) -> rustyline::Result<(usize, Vec<String>)> {
        Ok(complete(line.get(..pos).unwrap_or(line)))
    }
}

/// What is shown behind the cursor, and never taken into the line.
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
