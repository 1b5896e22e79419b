//! The ports at which robots are, or may be: of the service, of the settings, simulated ones, and serial devices.

use std::fmt::{self, Display, Formatter};

use growbot_client::port::serial::serial_devices;
use growbot_client::status::RobotStatus;
use growbot_sim::port::PortName;
use growbot_sim::sim_daemon::StateDir;
use schemars::JsonSchema;
use serde::Serialize;
use strum::IntoStaticStr;

use crate::settings::{self, InvalidFiles, SettingsError};

/// Place in which a port was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, JsonSchema, IntoStaticStr)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
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

/// A port at which a robot is, or may be.
#[derive(Debug, Serialize, JsonSchema)]
pub struct KnownPort {
    /// Name of the port.
    pub port: String,
    /// Name of the robot in the service or in the settings. `None` if it has no name.
    pub name: Option<String>,
    /// Place in which the port was found.
    pub source: PortSource,
}

/// All ports at which robots are, or may be.
#[derive(Debug, Serialize, JsonSchema)]
pub struct KnownPorts {
    /// The ports.
    pub ports: Vec<KnownPort>,
}

impl Display for KnownPort {
    fn fmt(&self, out: &mut Formatter<'_>) -> fmt::Result {
        match &self.name {
            Some(name) => write!(out, "{name} at {}", self.port),
            None => write!(out, "{}", self.port),
        }
    }
}

impl From<RobotStatus> for KnownPort {
    fn from(robot: RobotStatus) -> Self {
        Self { port: robot.port, name: robot.name, source: PortSource::Service }
    }
}

/// Returns the ports of the robots of the user's service (`owned`), of the settings, and of the simulated robots that
/// are on, each port once.
///
/// # Errors
/// [`SettingsError`] of a settings file.
pub fn known_robots(owned: Vec<RobotStatus>, invalid: InvalidFiles) -> Result<Vec<KnownPort>, SettingsError> {
    let mut known: Vec<KnownPort> = owned.into_iter().map(KnownPort::from).collect();
    for (name, entry) in settings::load_service(invalid)?.robots {
        // A simulated robot without a name for its port runs only in the service.
        let needs_service =
            entry.port.parse::<PortName>().is_ok_and(|port| port.is_simulated() && port.resident().is_none());
        if !needs_service {
            add(&mut known, KnownPort { port: entry.port, name: Some(name), source: PortSource::Settings });
        }
    }
    for name in StateDir::names_of_running() {
        let port = format!("sim:{name}");
        add(&mut known, KnownPort { port, name: None, source: PortSource::SimulatedRobot });
    }
    Ok(known)
}

/// Returns the ports of [`known_robots`] and the serial devices.
///
/// # Errors
/// [`SettingsError`] of a settings file.
pub fn known_ports(owned: Vec<RobotStatus>) -> Result<Vec<KnownPort>, SettingsError> {
    let mut known = known_robots(owned, InvalidFiles::Refuse)?;
    for port in serial_devices() {
        add(&mut known, KnownPort { port, name: None, source: PortSource::SerialDevice });
    }
    Ok(known)
}

/// Adds a port, unless it is known already.
fn add(known: &mut Vec<KnownPort>, port: KnownPort) {
    if known.iter().all(|other| other.port != port.port) {
        known.push(port);
    }
}
