//! The robots that a command without `--port` may mean.

use std::time::Duration;

use growbot_client::port::serial::serial_devices;
use growbot_client::status::RobotStatus;
use growbot_remote::client::{ServiceClient, ServiceError};
use growbot_serve::known_ports::{KnownPort, PortSource, known_robots};
use growbot_serve::settings::{FILE_NAME, InvalidFiles, Key};

use super::failure::Failure;

/// Timeout of the list of the service's robots, for which the service sends no request to a board.
const LIST_LIMIT: Duration = Duration::from_secs(2);

/// Returns the robots of the user's service. Empty if no service runs.
pub fn service_robots() -> Result<Vec<RobotStatus>, ServiceError> {
    ServiceClient::find()?.map_or(Ok(Vec::new()), |caller| caller.robots(LIST_LIMIT))
}

/// Returns the port of the service's only robot if it is simulated, and prints it as a note. `None` if the service does
/// not own exactly one robot. Returns an error for a real robot, because it would heat where another command simulates.
pub fn only_service_robot() -> Result<Option<String>, Failure> {
    let robots = service_robots()?;
    let [robot] = &robots[..] else { return Ok(None) };
    let name = robot.name.as_deref().unwrap_or(&robot.port);
    if !robot.simulated {
        return Err(Failure::bad_input(format!(
            "no port given, and the service owns the robot {name}: pass --port {name} to use it, or --port sim to \
             simulate"
        )));
    }
    growbot_host::note!("no port given: this is {name} at {}, the only robot of the service", robot.port);
    Ok(Some(robot.port.clone()))
}

/// Returns the port of the only robot that is known, and prints it as a note. Returns an error that lists the robots if
/// there is not exactly one. A simulated robot does not count as the only one if a serial device may be a real robot.
pub fn only_robot(mut invalid: InvalidFiles) -> Result<String, Failure> {
    let mut robots = known_robots(service_robots()?, invalid.reborrow())?;
    if matches!(&invalid, InvalidFiles::Skip(skipped) if !skipped.is_empty()) {
        // The list may lack the robot that is meant.
        return Err(no_port());
    }
    if robots.iter().all(|robot| robot.source == PortSource::SimulatedRobot) && !robots.is_empty() {
        // These are the serial ports of the computer's board.
        let devices = serial_devices().into_iter().filter(|device| !device.starts_with("/dev/ttyS"));
        robots.extend(devices.map(|port| KnownPort { port, name: None, source: PortSource::SerialDevice }));
    }
    match &robots[..] {
        [robot] => {
            growbot_host::note!("no port given: this is {robot}, the only robot");
            Ok(robot.port.clone())
        }
        [] => Err(no_port()),
        _ => {
            let robots: Vec<String> = robots.iter().map(ToString::to_string).collect();
            Err(Failure::bad_input(format!(
                "no port given, and there are {} robots: pass --port with one of them: {}",
                robots.len(),
                robots.join(", ")
            )))
        }
    }
}

/// Returns the failure of a command without a port if no robot is known.
pub fn no_port() -> Failure {
    Failure::bad_input(format!(
        "no port given: pass --port PORT, set {}, or set `port` in {FILE_NAME}; `growbot ports` lists robots and \
         serial devices",
        Key::Port.variable()
    ))
}
