//! Contents of the screen, without its layout: everything known of the robot, from the board's messages.

use std::collections::VecDeque;

use growbot_core::layer_bytes::decode;
use growbot_core::link::message::{Fault, LayerLaid, Message, SensorReadings, State, Status};
use growbot_core::robot::Robot;
use growbot_plan::tracked_body::TrackedBody;

use super::prompt::Prompt;
use super::temperature_history::TemperatureHistory;
use crate::cli::remedies;

/// Maximum number of lines in the log.
const LOG: usize = 200;

/// Everything that the screen shows.
pub struct ConsoleModel {
    /// The robot.
    pub robot: Robot,
    /// The port's name.
    pub port: String,
    /// Speed at which the virtual clock of a simulated board runs, in multiples of real time. `None` if the board
    /// runs by its own clock.
    pub speed: Option<f64>,
    /// Latest status of the board. `None` until the first one is received.
    pub status: Option<Status>,
    /// Latest readings of the sensors. `None` until the first ones are received.
    pub sensors: Option<SensorReadings>,
    /// Reason why the board does not respond. `None` if it responds.
    pub link_error: Option<String>,
    /// Measured and target temperatures of the nozzle so far.
    pub readings: TemperatureHistory,
    /// Body of the present job, as planned and as built so far.
    pub body: TrackedBody,
    /// Events so far, the latest last.
    pub log: VecDeque<LogEntry>,
    /// A response of many lines, shown until the next key. `None` if there is none.
    pub popup: Option<String>,
    /// The command being typed. `None` if no command is being typed.
    pub prompt: Option<Prompt>,
    clock_s: f64,
}

/// A line of the log.
#[derive(Debug, Clone, PartialEq)]
pub struct LogEntry {
    /// Time on the board's clock, s.
    pub at_s: f64,
    /// Text of the line.
    pub text: String,
    /// True if something went wrong.
    pub is_error: bool,
}

impl ConsoleModel {
    /// Creates the model of a robot whose state is not known yet.
    pub fn new(robot: Robot, port: &str, speed: Option<f64>) -> Self {
        Self {
            robot,
            port: port.to_owned(),
            speed,
            status: None,
            sensors: None,
            link_error: None,
            readings: TemperatureHistory::default(),
            body: TrackedBody::new(0, Vec::new()),
            log: VecDeque::new(),
            popup: None,
            prompt: None,
            clock_s: 0.0,
        }
    }

    /// Updates the model with a status of the board.
    pub fn apply_status(&mut self, status: Status) {
        if self.link_error.take().is_some() {
            self.log("the board responds again");
        }
        self.clock_s = status.uptime_ms as f64 / 1000.0;
        self.readings.add(self.clock_s, status.temperature_centi_c, status.target_centi_c);
        if status.plan_id != self.body.plan_id() {
            self.body = TrackedBody::new(status.plan_id, Vec::new());
        } else if status.layers_laid < self.body.next() {
            // The same job starts again from the beginning.
            self.body.begin_again();
        }
        let (state, fault) = (status.state, status.fault);
        let before = self.status.replace(status).map(|before| (before.state, before.fault));
        // The event was lost, or it came before the console was connected.
        if before.is_none_or(|before| before != (state, fault)) {
            self.say_state(state, fault);
        }
    }

    /// Updates the model with an event that the board sent.
    pub fn apply_event(&mut self, event: &Message) {
        match event {
            Message::StateChanged(change) => {
                if let Some(status) = &mut self.status
                    && (status.state, status.fault) != (change.state, change.fault)
                {
                    (status.state, status.fault) = (change.state, change.fault);
                    self.say_state(change.state, change.fault);
                }
            }
            Message::LayerLaid(LayerLaid { plan_id, index, as_built, .. }) => {
                if *plan_id != self.body.plan_id() {
                    self.body = TrackedBody::new(*plan_id, Vec::new());
                }
                let Some(as_built) = as_built else { return };
                self.body.add_layer(*index, decode(as_built), self.robot.description().layer.height_mm);
            }
            _ => {}
        }
    }

    /// Records that the board does not respond, for the reason `why`.
    pub fn apply_loss(&mut self, why: &str) {
        if self.link_error.replace(why.to_owned()).is_none() {
            self.log_error(why);
        }
    }

    /// Adds a line to the log.
    pub fn log(&mut self, text: &str) {
        self.write(text, false);
    }

    /// Adds a line about something that went wrong to the log.
    pub fn log_error(&mut self, text: &str) {
        self.write(text, true);
    }

    fn say_state(&mut self, state: State, fault: Option<Fault>) {
        match fault {
            Some(fault) => {
                self.log_error(&format!("{}: {}, {}", state.name(), fault.code(), remedies::fault_explanation(fault)));
            }
            None => self.write(state.name(), state == State::EmergencyStop),
        }
    }

    fn write(&mut self, text: &str, bad: bool) {
        for line in text.lines() {
            if self.log.len() >= LOG {
                self.log.pop_front();
            }
            // Text from outside must not move the cursor.
            let text = line.chars().map(|c| if c.is_control() { ' ' } else { c }).collect();
            self.log.push_back(LogEntry { at_s: self.clock_s, text, is_error: bad });
        }
    }
}

/// Returns a text for the user about a state of the board, with the possible actions.
pub fn explanation(state: State) -> &'static str {
    match state {
        State::SelfTest => "just started, reading its sensors",
        State::Idle => "heater and steppers are off",
        State::Heating => "the nozzle is heating, nothing moves yet",
        State::Homing => "the head searches for its index mark",
        State::Growing => "laying layers",
        State::Paused => "hot, waiting between layers; g continues",
        State::Parked => "the heater is off after a long pause; g heats and continues",
        State::Done => "every layer is laid, heater and steppers are off",
        State::Stopped => "stopped on request, heater and steppers are off",
        State::Maintenance => "hot for maintenance; heater off 10 minutes after the latest command",
        State::Tuning => "the nozzle's temperature swings to find the heater's gains",
        State::Fault => "heater and steppers are off; fix the cause, then c clears the fault",
        State::EmergencyStop => "all off; release the button if pressed, then c clears the stop",
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing::{laid, model, status};
    use super::*;

    #[test]
    fn state_changes_are_logged_once() {
        let mut model = model();
        model.apply_status(status(State::Heating, 10.0));
        model.apply_status(status(State::Heating, 11.0));
        model.apply_event(&Message::StateChanged(growbot_core::link::message::StateChanged {
            state: State::Homing,
            fault: None,
        }));
        model.apply_status(status(State::Homing, 12.0));
        let texts: Vec<&str> = model.log.iter().map(|line| line.text.as_str()).collect();
        assert_eq!(texts, ["heating", "homing"]);
    }

    #[test]
    fn connection_loss_and_recovery_are_logged_once() {
        let mut model = model();
        model.apply_status(status(State::Idle, 1.0));
        model.apply_loss("the board does not answer");
        model.apply_loss("the board does not answer");
        model.apply_status(status(State::Idle, 9.0));
        let texts: Vec<&str> = model.log.iter().map(|line| line.text.as_str()).collect();
        assert_eq!(texts, ["idle", "the board does not answer", "the board responds again"]);
        assert!(model.log.iter().map(|line| line.is_error).eq([false, true, false]));
    }

    #[test]
    fn repeating_a_job_starts_a_new_body() {
        let mut model = model();
        for index in 0..3 {
            model.apply_event(&laid(index));
        }
        model.apply_status(Status { layers_laid: 3, ..status(State::Done, 100.0) });
        assert_eq!(model.body.built().len(), 3);
        model.apply_status(Status { layers_laid: 0, ..status(State::Heating, 101.0) });
        assert!(model.body.built().is_empty());
    }

    #[test]
    fn the_log_keeps_the_latest_lines_without_control_characters() {
        let mut model = model();
        for number in 0..300 {
            model.log(&format!("line {number}\u{1b}[2J"));
        }
        assert_eq!(model.log.len(), LOG);
        assert_eq!(model.log.back().map(|line| line.text.as_str()), Some("line 299 [2J"));
    }
}
