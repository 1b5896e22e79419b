//! Requests with their own answers: status, stop, sensors, the latest fault and crash.

use std::time::Duration;

use growbot_core::link::message::{
    BootReport, Empty, FaultRecord, LatestFault, Maintain, Message, Refusal, SensorReadings, Status, Task,
};

use super::clock::{ClockDrift, ClockWatch, Reading};
use super::{Client, ClientError};
use crate::maintenance::request_name;

/// An emergency stop by the link counts as released within 20 ms; it is looked so often whether it is,
const MAX_LOOKS_AT_RELEASE: u32 = 6;
/// with such pauses.
const LOOK_AT_RELEASE: Duration = Duration::from_millis(50);

/// How a board was stopped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stopped {
    /// By a request: its body can be resumed.
    ByRequest,
    /// The request was not answered, and the emergency stop was.
    AtOnce,
}

impl Stopped {
    /// In words.
    #[must_use]
    pub fn in_words(self, is_simulated: bool) -> String {
        let kind = if is_simulated { "simulated " } else { "" };
        match self {
            Self::ByRequest => format!("stopped: heater and steppers of the {kind}robot are off"),
            Self::AtOnce => format!(
                "emergency stop, as the request to stop was not answered: heater and steppers of the {kind}robot are off, until it is cleared (`clear` in `growbot console`)"
            ),
        }
    }
}

impl Client {
    /// What the board is doing.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn status(&mut self) -> Result<Status, ClientError> {
        let what = "for its status";
        let sent = self.port.now();
        match self.request(what, &Message::AskStatus(Empty {}))? {
            Message::Status(status) => {
                if self.port.compares_clocks() {
                    self.clocks.take(&Reading { board_ms: status.uptime_ms, sent, received: self.port.now() });
                }
                Ok(status)
            }
            other => Err(ClientError::Unexpected { request: what, kind: other.kind() }),
        }
    }

    /// Stops the board: by a request, after which its body can be resumed, or by the emergency stop where that is not
    /// answered.
    ///
    /// # Errors
    /// A refusal; [`ClientError::NotStopped`]: nobody knows whether it has stopped, and the power must be cut.
    pub fn stop(&mut self) -> Result<Stopped, ClientError> {
        match self.request("to stop", &Message::Stop(Empty {})) {
            Ok(_) => Ok(Stopped::ByRequest),
            Err(error @ ClientError::Refused { .. }) => Err(error),
            Err(_) => self.emergency_stop().map(|()| Stopped::AtOnce),
        }
    }

    /// Leaves a fault or an emergency stop. The board refuses that for some milliseconds after a stop by the link, as
    /// while the button is pressed: it is asked again for a while.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn clear_fault(&mut self) -> Result<(), ClientError> {
        let (what, request) = ("to clear the fault", Message::ClearFault(Empty {}));
        for _ in 0..MAX_LOOKS_AT_RELEASE {
            match self.request(what, &request) {
                Err(ClientError::Refused { refusal: Refusal::EmergencyStop, .. }) => self.pass(LOOK_AT_RELEASE)?,
                done => return done.map(drop),
            }
        }
        self.request(what, &request).map(drop)
    }

    /// Stops a board whose clock has gone from the port's, as the answers to [`Client::status`] tell: by a request,
    /// after which its body can be resumed, or else at once. Gives how far it has; none while the clocks agree, or
    /// cannot be compared.
    ///
    /// # Errors
    /// [`ClientError::NotStopped`]: nobody knows whether it has stopped, and the power must be cut.
    pub fn stop_if_clock_drifts(&mut self) -> Result<Option<ClockDrift>, ClientError> {
        let Some(drift) = self.clocks.drift() else { return Ok(None) };
        if self.request("to stop", &Message::Stop(Empty {})).is_err() {
            self.emergency_stop()?;
        }
        // A start in spite of that has it compared again.
        self.clocks = ClockWatch::default();
        Ok(Some(drift))
    }

    /// Whether it is time to ask for the status again for the sake of the clocks.
    #[must_use]
    pub fn wants_clock(&self) -> bool {
        self.port.compares_clocks() && self.clocks.wants(self.port.now())
    }

    /// Has the board do a task of maintenance.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn maintain(&mut self, task: Task) -> Result<(), ClientError> {
        self.request(request_name(task), &Message::Maintain(Maintain { task })).map(drop)
    }

    /// What the board's sensors say.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn sensors(&mut self) -> Result<SensorReadings, ClientError> {
        let what = "for its sensors";
        match self.request(what, &Message::AskSensors(Empty {}))? {
            Message::SensorReadings(readings) => Ok(readings),
            other => Err(ClientError::Unexpected { request: what, kind: other.kind() }),
        }
    }

    /// The board's latest fault as it was when it came, cleared or not; none if it knows of none.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn latest_fault(&mut self) -> Result<Option<FaultRecord>, ClientError> {
        let what = "for its latest fault";
        match self.request(what, &Message::AskFault(Empty {}))? {
            Message::LatestFault(LatestFault { record }) => Ok(record),
            other => Err(ClientError::Unexpected { request: what, kind: other.kind() }),
        }
    }

    /// How the board came up: whether its image is sound, and the latest crash.
    ///
    /// # Errors
    /// As [`Client::request`].
    pub fn boot(&mut self) -> Result<BootReport, ClientError> {
        let what = "how it came up";
        match self.request(what, &Message::AskBoot(Empty {}))? {
            Message::BootReport(report) => Ok(report),
            other => Err(ClientError::Unexpected { request: what, kind: other.kind() }),
        }
    }
}
