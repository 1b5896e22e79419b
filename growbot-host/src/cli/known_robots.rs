//! The robots that a command without `--port` may mean.

use growbot_client::port::serial::serial_devices;
use growbot_host::settings::{self, FILE_NAME, InvalidFiles, Key, SettingsError};
use growbot_serve::client::RESPONSE_TIMEOUT;
use growbot_sim::port::PortName;
use growbot_sim::sim_daemon::StateDir;
use serde::Serialize;

use super::failure::Failure;
use super::service_lookup::service_in_emergency;

/// Place in which a port was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum PortSource {
    /// The user's service owns the robot at the port.
    Service,
    /// A settings file has a robot at the port.
    Settings,
    /// A simulated robot that is switched on has the port.
    SimulatedRobot,
    /// The computer has a serial device, which may be a robot.
    SerialDevice,
}

impl PortSource {
    /// Returns the text for users.
    pub fn text(self) -> &'static str {
        match self {
            Self::Service => "service",
            Self::Settings => "settings",
            Self::SimulatedRobot => "simulated robot, on",
            Self::SerialDevice => "serial device",
        }
    }
}

/// A port at which a robot is, or may be.
#[derive(Debug, Serialize)]
pub struct KnownPort {
    pub port: String,
    /// Name of the robot in the service or in the settings. `None` if it has no name.
    pub name: Option<String>,
    pub source: PortSource,
}

/// Returns the port of the robots of the user's service, of the settings, and of the simulated robots that are on, each
/// port once.
pub fn known_robots(invalid: InvalidFiles) -> Result<Vec<KnownPort>, SettingsError> {
    let mut known = service_robots();
    for (name, entry) in settings::load_service(invalid)?.robots {
        let is_known = known.iter().any(|robot| robot.name.as_ref() == Some(&name) || robot.port == entry.port);
        // A simulated robot without a name for its port runs only in the service.
        let needs_service =
            entry.port.parse::<PortName>().is_ok_and(|port| port.is_simulated() && port.resident().is_none());
        if !is_known && !needs_service {
            known.push(KnownPort { port: entry.port, name: Some(name), source: PortSource::Settings });
        }
    }
    for name in StateDir::names_of_running() {
        let port = format!("sim:{name}");
        if known.iter().all(|robot| robot.port != port) {
            known.push(KnownPort { port, name: None, source: PortSource::SimulatedRobot });
        }
    }
    Ok(known)
}

/// Returns the ports of [`known_robots`] and the serial devices.
pub fn known_ports() -> Result<Vec<KnownPort>, SettingsError> {
    let mut known = known_robots(InvalidFiles::Refuse)?;
    for port in serial_devices() {
        if known.iter().all(|robot| robot.port != port) {
            known.push(KnownPort { port, name: None, source: PortSource::SerialDevice });
        }
    }
    Ok(known)
}

/// Returns the robots of the user's service. Empty if no service runs.
fn service_robots() -> Vec<KnownPort> {
    let robots = service_in_emergency().and_then(|caller| caller.robots(RESPONSE_TIMEOUT).ok()).unwrap_or_default();
    let known = |robot: growbot_client::status::RobotStatus| KnownPort {
        port: robot.port,
        name: robot.name,
        source: PortSource::Service,
    };
    robots.into_iter().map(known).collect()
}

/// Returns the port of the service's robot, if the service owns exactly one, and prints it as a note.
pub fn only_service_robot() -> Option<String> {
    let robots = service_robots();
    let [robot] = &robots[..] else { return None };
    growbot_host::note!("no port given: this is {}, the only robot of the service", described(robot));
    Some(robot.port.clone())
}

/// Returns the port of the only robot that is known, and prints it as a note. Returns an error that lists the robots if
/// there are more, or none.
pub fn only_robot(invalid: InvalidFiles) -> Result<String, Failure> {
    let robots = known_robots(invalid)?;
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

/// Returns the failure of a command without a port, if there is no robot that it can mean.
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
