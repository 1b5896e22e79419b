//! Session with a board that is commissioned, and with the person beside it.

use std::sync::Arc;
use std::time::Duration;

use growbot_client::client::{Client, ClientError};
use growbot_client::commissioning_report::RecordedAnswer;
use growbot_client::growth::CommandQueue;
use growbot_core::link::message::{Fault, MaintenanceTask, SensorReadings, State, Status};
use growbot_core::robot::Robot;
use growbot_host::messages::print_prompt as ask_line;
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::text_wrap::{TERMINAL_WIDTH, wrap};
use growbot_sim::simulated_tip::SimulatedTip;
use growbot_sim::tip::manual_action::ManualAction;

use super::answers::{AnswerKind, AnswerReadError, OperatorAnswer, OperatorInput};
use crate::cli::failure::Failure;
use crate::cli::remedies;

/// Interval of the checks for an answer, and of sensor requests.
pub const LOOK: Duration = Duration::from_millis(100);
/// Time limit for an action of the user that the board's sensors must show.
pub const WATCH: Duration = Duration::from_secs(60);
/// Number of checks for an answer between two status requests to the board.
const GREET: u32 = 10;

/// Session with a board and the person beside it, with the person's answers in the present step.
pub struct DoctorSession {
    pub client: Client,
    pub robot: Robot,
    /// Simulation that does the requested actions. `None` if the robot is not simulated.
    pub simulated_operator: Option<Box<dyn SimulatedTip>>,
    pub orders: Arc<CommandQueue>,
    pub answers: OperatorInput,
    pub recorded_answers: Vec<RecordedAnswer>,
    pub kind: RobotKind,
    pub port: String,
}

/// Status and sensors of the board at one moment.
pub struct BoardSample {
    pub status: Status,
    pub sensors: SensorReadings,
}

impl DoctorSession {
    /// Prints a question and waits for the answer. `None` if the step is skipped.
    pub fn ask(&mut self, question: &str, wanted: AnswerKind) -> Result<Option<OperatorAnswer>, Failure> {
        loop {
            for line in wrap(question, TERMINAL_WIDTH, "", "").lines() {
                ask_line(format_args!("{line}"));
            }
            ask_line(format_args!("  [{}]:", wanted.choices()));
            let line = self.line()?;
            let answer = match wanted.read(&line) {
                Ok(answer) => answer,
                Err(why) if self.answers.by_hand => {
                    Failure::bad_input(why).print();
                    continue;
                }
                Err(why) => return Err(Failure::bad_input(why)),
            };
            self.recorded_answers.push(RecordedAnswer::new(question, line.trim()));
            return match answer {
                OperatorAnswer::Skip => Ok(None),
                OperatorAnswer::Quit => {
                    Err(Failure::request_failed("stopped at your request: run `growbot doctor` again"))
                }
                answer => Ok(Some(answer)),
            };
        }
    }

    /// Waits for the confirmation that something is done. Returns false if the step is skipped.
    pub fn confirm(&mut self, question: &str) -> Result<bool, Failure> {
        Ok(self.ask(question, AnswerKind::Ready)?.is_some())
    }

    /// Waits for a line. Meanwhile it sends status requests, so that the board does not lose its host.
    fn line(&mut self) -> Result<String, Failure> {
        for look in 1_u32.. {
            self.stop_if_interrupted()?;
            match self.answers.within(LOOK) {
                Ok(line) => return Ok(line),
                Err(AnswerReadError::EndOfInput) => break,
                Err(AnswerReadError::Unreadable(why)) => return Err(Failure::bad_input(why)),
                Err(AnswerReadError::Timeout) if look.is_multiple_of(GREET) => {
                    self.client.status().map_err(lost)?;
                }
                Err(AnswerReadError::Timeout) => {}
            }
        }
        Err(Failure::request_failed(
            "standard input ended before the last step: give a line for each question on standard input, or use a \
             terminal",
        ))
    }

    /// Stops the board and returns an error, if a stop was requested.
    fn stop_if_interrupted(&mut self) -> Result<(), Failure> {
        if self.orders.stop_requested() {
            return Err(Failure::request_failed(remedies::stop_message(self.client.stop()?, self.kind)));
        }
        Ok(())
    }

    /// Lets the simulation do an action, if the robot is simulated.
    pub fn act(&mut self, hand: ManualAction) {
        if let Some(hands) = &mut self.simulated_operator {
            hands.apply_action(hand);
        }
    }

    /// Waits for [`LOOK`], and returns the status and the sensors of the board.
    pub fn sample(&mut self) -> Result<BoardSample, Failure> {
        self.stop_if_interrupted()?;
        self.client.wait(LOOK).map_err(lost)?;
        Ok(BoardSample { status: self.client.status().map_err(lost)?, sensors: self.client.sensors().map_err(lost)? })
    }

    /// Watches the board until `is_so` returns true, while the simulation does the action `hand`. `None` if that
    /// takes longer than `time`.
    pub fn wait_until(
        &mut self,
        time: Duration,
        hand: Option<ManualAction>,
        mut is_so: impl FnMut(&BoardSample) -> bool,
    ) -> Result<Option<BoardSample>, Failure> {
        for _ in 0..time.as_millis() / LOOK.as_millis() {
            if let Some(hand) = hand {
                self.act(hand);
            }
            let seen = self.sample()?;
            if is_so(&seen) {
                return Ok(Some(seen));
            }
        }
        Ok(None)
    }

    /// Requests a maintenance task from the board. Returns the reason if the board refuses it.
    pub fn maintain(&mut self, task: MaintenanceTask) -> Result<Option<String>, Failure> {
        self.stop_if_interrupted()?;
        match self.client.maintain(task, &self.orders.permit()) {
            Ok(_) => Ok(None),
            Err(error @ ClientError::Refused { .. }) => Ok(Some(remedies::message(&error))),
            Err(error) => Err(lost(error)),
        }
    }

    /// Clears a fault or an emergency stop. Returns the reason if the board refuses it.
    pub fn clear(&mut self) -> Result<Option<String>, Failure> {
        match self.client.clear_fault(&self.orders.permit()) {
            Ok(()) => Ok(None),
            Err(error @ ClientError::Refused { .. }) => Ok(Some(remedies::message(&error))),
            Err(error) => Err(lost(error)),
        }
    }

    /// Switches heater and motors off, if they may be on.
    pub fn switch_off(&mut self) -> Result<(), Failure> {
        let rests = |state| {
            matches!(
                state,
                State::Idle | State::Done | State::Stopped | State::Fault | State::EmergencyStop | State::SelfTest
            )
        };
        match self.client.status() {
            Ok(status) if rests(status.state) => Ok(()),
            Ok(Status { state: State::Maintenance, .. })
                if self.client.maintain(MaintenanceTask::CoolDown, &self.orders.permit()).is_ok() =>
            {
                Ok(())
            }
            _ => {
                self.client.stop()?;
                Ok(())
            }
        }
    }

    /// Returns the present status of the board.
    pub fn status(&mut self) -> Result<Status, Failure> {
        self.client.status().map_err(lost)
    }

    /// Sends the emergency stop over the link.
    pub fn emergency_stop(&mut self) -> Result<(), Failure> {
        Ok(self.client.emergency_stop()?)
    }

    /// Starts a dry run. Returns the reason if the board refuses it.
    pub fn dry_run(&mut self) -> Result<Option<String>, Failure> {
        self.maintain(MaintenanceTask::DryRun)
    }
}

/// Returns the code and the explanation of a fault.
pub fn describe(fault: Fault) -> String {
    format!("{}: {}", fault.code(), remedies::fault_explanation(fault))
}

/// Converts an error during a step. The message warns that the robot may be heating if the board does not respond.
fn lost(error: ClientError) -> Failure {
    match error {
        ClientError::Refused { .. } | ClientError::StopNotAcknowledged { .. } => error.into(),
        error => Failure::request_failed(format!(
            "{}; the robot may be heating: run `growbot status`, and if that fails cut the robot's power",
            remedies::message(&error)
        )),
    }
}
