//! The robots that a command without `--port` may mean.

use growbot_client::status::RobotStatus;
use growbot_serve::client::RESPONSE_TIMEOUT;
use growbot_serve::known_ports::{KnownPort, known_robots};
use growbot_serve::settings::{FILE_NAME, InvalidFiles, Key};

use super::failure::Failure;
use super::service_lookup::service_in_emergency;

/// Returns the robots of the user's service. Empty if no service runs.
pub fn service_robots() -> Vec<RobotStatus> {
    service_in_emergency().and_then(|caller| caller.robots(RESPONSE_TIMEOUT).ok()).unwrap_or_default()
}

/// Returns the port of the service's robot, if the service owns exactly one, and prints it as a note.
pub fn only_service_robot() -> Option<String> {
    let robots: Vec<KnownPort> = service_robots().into_iter().map(KnownPort::from).collect();
    let [robot] = &robots[..] else { return None };
    growbot_host::note!("no port given: this is {}, the only robot of the service", described(robot));
    Some(robot.port.clone())
}

/// Returns the port of the only robot that is known, and prints it as a note. Returns an error that lists the robots if
/// there are more, or none.
pub fn only_robot(invalid: InvalidFiles) -> Result<String, Failure> {
    let robots = known_robots(service_robots(), invalid)?;
    match &robots[..] {
        [robot] => {
            growbot_host::note!("no port given: this is {}, the only robot", described(robot));
            Ok(robot.port.clone())
        }
        [] => Err(no_port()),
        _ => {
            let robots: Vec<String> = robots.iter().map(described).collect();
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

/// Returns the name and the port of a robot.
fn described(robot: &KnownPort) -> String {
    match &robot.name {
        Some(name) => format!("{name} at {}", robot.port),
        None => robot.port.clone(),
    }
}
