//! The emergency stop of a robot by the service that owns its port, and by the port itself.

use std::sync::mpsc::{self, Receiver};
use std::thread;
use std::time::Duration;

use crate::api::RobotCommand;
use crate::client::{RESPONSE_TIMEOUT, ServiceClient};

/// Stops the robot at this port by the service, if it owns the port, and by `stop_at_port` if the service has not
/// confirmed the stop within `limit`. A service that hangs must not delay the stop. It may still confirm while the port
/// does not respond to this program, for example because the port serves one program at a time.
///
/// `stop_at_port` gets false if the service has refused the stop, and `None` if it has not answered or does not own the
/// port.
///
/// # Errors
/// That of `stop_at_port`, if the service has not confirmed the stop either.
pub fn stop_by_either<E>(
    service: Option<ServiceClient>,
    port: &str,
    limit: Duration,
    stop_at_port: impl FnOnce(Option<bool>) -> Result<(), E>,
) -> Result<(), E> {
    let (sender, by_service) = mpsc::channel();
    if let Some(service) = service {
        let port = port.to_owned();
        thread::spawn(move || {
            let robot = service.robot_at(&port, RESPONSE_TIMEOUT).ok().flatten()?;
            sender.send(robot.send_command(RobotCommand::EmergencyStop).is_ok()).ok()
        });
    } else {
        drop(sender);
    }
    confirmed_by_either(&by_service, limit, stop_at_port)
}

fn confirmed_by_either<E>(
    by_service: &Receiver<bool>,
    limit: Duration,
    stop_at_port: impl FnOnce(Option<bool>) -> Result<(), E>,
) -> Result<(), E> {
    match by_service.recv_timeout(limit).ok() {
        Some(true) => Ok(()),
        answer => {
            stop_at_port(answer).or_else(|error| if by_service.try_recv() == Ok(true) { Ok(()) } else { Err(error) })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_service_may_confirm_while_the_port_does_not_respond() {
        for (answer, expected) in [(true, Ok(())), (false, Err("silent"))] {
            let (sender, by_service) = mpsc::channel();
            let stopped = confirmed_by_either(&by_service, Duration::ZERO, |_| {
                sender.send(answer).unwrap();
                Err("silent")
            });
            assert_eq!(stopped, expected);
        }
    }

    #[test]
    fn a_port_without_a_service_is_tried_at_once() {
        assert_eq!(stop_by_either(None, "/dev/ttyACM0", Duration::MAX, |answer| answer.map_or(Ok(()), Err)), Ok(()));
    }
}
