//! The emergency stop of a robot by the service that owns its port. It is sent beside the stop at the port itself.

use std::sync::mpsc::{self, Receiver};
use std::thread::Builder;
use std::time::Duration;

use crate::client::{RESPONSE_TIMEOUT, ServiceClient};
use growbot_client::robot_command::RobotCommand;

/// An emergency stop that has been sent to the service. A service that hangs must not delay the stop, but it may
/// confirm later, while the port does not respond to this program, for example because another program uses it.
pub struct ServiceStop {
    /// True if the board has confirmed the stop to the service, false if not. Nothing comes from a service that does
    /// not own the port.
    answers: Receiver<bool>,
    answer: Option<bool>,
}

impl ServiceStop {
    /// Sends the stop of the robot at this port to the service, if there is one. Does not wait.
    #[must_use]
    pub fn begin(service: Option<ServiceClient>, port: &str) -> Self {
        let (sender, answers) = mpsc::channel();
        let port = port.to_owned();
        let request = move || {
            let robot = service?.robot_at(&port, RESPONSE_TIMEOUT).ok().flatten()?;
            sender.send(robot.send_command(RobotCommand::EmergencyStop).is_ok()).ok()
        };
        // A thread that cannot be created must not prevent the stop at the port.
        let _ = Builder::new().spawn(request);
        Self { answers, answer: None }
    }

    /// Waits for the service's answer, for at most `limit`. Returns true if it has confirmed the stop.
    pub fn wait(&mut self, limit: Duration) -> bool {
        if self.answer.is_none() {
            self.answer = self.answers.recv_timeout(limit).ok();
        }
        self.answer == Some(true)
    }

    /// Returns true if the service owns the port, but has not confirmed the stop.
    #[must_use]
    pub fn has_failed(&self) -> bool {
        self.answer == Some(false)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_service_may_confirm_late_and_no_service_is_not_waited_for() {
        let (sender, answers) = mpsc::channel();
        let mut stop = ServiceStop { answers, answer: None };
        assert!(!stop.wait(Duration::ZERO) && !stop.has_failed());
        sender.send(true).unwrap();
        assert!(stop.wait(Duration::ZERO) && stop.wait(Duration::ZERO));
        assert!(!ServiceStop::begin(None, "/dev/ttyACM0").wait(Duration::MAX));
    }
}
