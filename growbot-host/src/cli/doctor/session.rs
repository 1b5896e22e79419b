//! A board that is commissioned, and the person beside it.

use std::sync::Arc;
use std::time::Duration;

use growbot_client::client::{Client, ClientError};
use growbot_client::growth::Orders;
use growbot_client::printable::one_line;
use growbot_core::link::message::{Fault, MaintenanceTask, SensorReadings, State, Status};
use growbot_core::robot::Robot;
use growbot_host::messages::ask as ask_line;
use growbot_sim::tip::hand::Hand;
use growbot_sim::truth::Simulation;

use super::answers::{Answer, Answers, NoLine, Wanted};
use super::report::{Answered, now};
use crate::cli::Failure;

/// So often it is looked whether there is an answer, or what a sensor says.
pub const LOOK: Duration = Duration::from_millis(100);
/// How long somebody has for what is watched.
pub const WATCH: Duration = Duration::from_secs(60);
/// The board is asked at least so often while an answer is awaited, in looks.
const GREET: u32 = 10;

/// A board, a person, and what the person has answered in this step.
pub struct Session {
    pub client: Client,
    pub robot: Robot,
    /// Who does what is asked for, where the robot is a simulated one.
    pub hands: Option<Box<dyn Simulation>>,
    pub orders: Arc<Orders>,
    pub answers: Answers,
    pub answered: Vec<Answered>,
    pub simulated: bool,
    pub port: String,
}

/// What the board says of itself at a moment.
pub struct Seen {
    pub status: Status,
    pub sensors: SensorReadings,
}

impl Session {
    /// Asks the person. None where the step is left out.
    pub fn ask(&mut self, question: &str, wanted: Wanted) -> Result<Option<Answer>, Failure> {
        loop {
            for line in wrapped(question) {
                ask_line(format_args!("{line}"));
            }
            ask_line(format_args!("  [{}]:", wanted.choices()));
            let line = self.line()?;
            let answer = match wanted.read(&line) {
                Ok(answer) => answer,
                Err(why) if self.answers.by_hand => {
                    Failure::bad_input(why).say();
                    continue;
                }
                Err(why) => return Err(Failure::bad_input(why)),
            };
            let typed = one_line(line.trim()).into_owned();
            self.answered.push(Answered { question: question.to_owned(), answer: typed, utc: now() });
            return match answer {
                Answer::Skip => Ok(None),
                Answer::Quit => Err(Failure::answered_no("left by choice; run it again to go on")),
                answer => Ok(Some(answer)),
            };
        }
    }

    /// Asks whether something is done. False where the step is left out.
    pub fn is_ready(&mut self, question: &str) -> Result<bool, Failure> {
        Ok(self.ask(question, Wanted::Ready)?.is_some())
    }

    /// Waits for a line. Meanwhile the board hears of its host.
    fn line(&mut self) -> Result<String, Failure> {
        for look in 1_u32.. {
            self.check()?;
            match self.answers.within(LOOK) {
                Ok(line) => return Ok(line),
                Err(NoLine::Ever) => break,
                Err(NoLine::Unreadable(why)) => {
                    return Err(Failure::bad_input(format!("cannot read the answers: {why}")));
                }
                Err(NoLine::Yet) if look.is_multiple_of(GREET) => {
                    self.client.status().map_err(lost)?;
                }
                Err(NoLine::Yet) => {}
            }
        }
        Err(Failure::answered_no(
            "the answers have ended before the steps: give a line for each question on standard input, or use a terminal",
        ))
    }

    /// Ends everything when that was ordered.
    fn check(&mut self) -> Result<(), Failure> {
        if self.orders.stops() {
            return Err(Failure::answered_no(self.client.stop()?.in_words(self.simulated)));
        }
        Ok(())
    }

    /// Lets the simulation do this, where there is one.
    pub fn by_hand(&mut self, hand: Hand) {
        if let Some(hands) = &mut self.hands {
            hands.by_hand(hand);
        }
    }

    /// What the board says now, a little later.
    pub fn look(&mut self) -> Result<Seen, Failure> {
        self.check()?;
        self.client.pass(LOOK).map_err(lost)?;
        Ok(Seen { status: self.client.status().map_err(lost)?, sensors: self.client.sensors().map_err(lost)? })
    }

    /// Looks for so long until this is so, while the simulation does `hand`. None where it was not.
    pub fn watch(
        &mut self,
        time: Duration,
        hand: Option<Hand>,
        mut is_so: impl FnMut(&Seen) -> bool,
    ) -> Result<Option<Seen>, Failure> {
        for _ in 0..time.as_millis() / LOOK.as_millis() {
            if let Some(hand) = hand {
                self.by_hand(hand);
            }
            let seen = self.look()?;
            if is_so(&seen) {
                return Ok(Some(seen));
            }
        }
        Ok(None)
    }

    /// Has the board do a task of maintenance. `Some` is why it has refused.
    pub fn maintain(&mut self, task: MaintenanceTask) -> Result<Option<String>, Failure> {
        self.check()?;
        match self.client.maintain(task) {
            Ok(()) => Ok(None),
            Err(error @ ClientError::Refused { .. }) => Ok(Some(error.to_string())),
            Err(error) => Err(lost(error)),
        }
    }

    /// Leaves a fault or an emergency stop. `Some` is why that is refused.
    pub fn clear(&mut self) -> Result<Option<String>, Failure> {
        match self.client.clear_fault() {
            Ok(()) => Ok(None),
            Err(error @ ClientError::Refused { .. }) => Ok(Some(error.to_string())),
            Err(error) => Err(lost(error)),
        }
    }

    /// Switches heater and motors off, where they may be on.
    pub fn switch_off(&mut self) -> Result<(), Failure> {
        let rests = |state| {
            matches!(
                state,
                State::Idle | State::Done | State::Stopped | State::Fault | State::EmergencyStop | State::SelfTest
            )
        };
        match self.client.status() {
            Ok(status) if rests(status.state) => Ok(()),
            Ok(Status { state: State::Maintenance, .. }) if self.client.maintain(MaintenanceTask::CoolDown).is_ok() => {
                Ok(())
            }
            _ => {
                self.client.stop()?;
                Ok(())
            }
        }
    }

    /// What the board says now.
    pub fn status(&mut self) -> Result<Status, Failure> {
        self.client.status().map_err(lost)
    }

    /// Gives the emergency stop over the line.
    pub fn emergency_stop(&mut self) -> Result<(), Failure> {
        Ok(self.client.emergency_stop()?)
    }

    /// Starts a dry run.
    pub fn dry_run(&mut self) -> Result<Option<String>, Failure> {
        self.maintain(MaintenanceTask::DryRun)
    }
}

/// A fault in words.
pub fn in_words(fault: Fault) -> String {
    format!("{}: {}", fault.code(), fault.explanation())
}

/// A board that does not answer in the midst of this.
fn lost(error: ClientError) -> Failure {
    match error {
        ClientError::Refused { .. } | ClientError::NotStopped { .. } => error.into(),
        error => Failure::answered_no(format!(
            "{error}; the robot may be heating: see `growbot status`, and cut its power if that does not answer"
        )),
    }
}

/// Lines of a question.
fn wrapped(question: &str) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in question.split(' ') {
        match lines.last_mut() {
            Some(line) if line.chars().count() + 1 + word.chars().count() <= 80 => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}
