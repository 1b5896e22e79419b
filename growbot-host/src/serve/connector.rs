//! Opens connections of the service to a robot's board.

use std::path::PathBuf;
use std::time::Duration;

use growbot_client::client::{Client, EMERGENCY_LIMIT};
use growbot_client::port::Port;
use growbot_client::robot_file;
use growbot_core::link::message::BoardInfo;
use growbot_core::robot::Robot;
use growbot_sim::ground_truth::SimulatedTip;
use growbot_sim::port::{self, OpenError, OpenPort, PortName, TipSettings};
use growbot_sim::sim_daemon::StateDir;

use super::robot_worker::RobotWorker;
use crate::sim_process::switch_on;

/// Time after which the service tries again to connect to a robot.
const RECONNECT_INTERVAL: Duration = Duration::from_secs(1);

/// Opens the ports of a robot. Tests implement it with a simulated line.
pub trait Connector: Send + Sync {
    /// Opens the port of this robot. Called on the robot's thread.
    ///
    /// # Errors
    /// If the port cannot be opened.
    fn open(&self, robot: &Robot) -> Result<OpenPort, OpenError>;

    /// Opens a separate connection for the emergency stop, while another thread or program holds the port.
    ///
    /// # Errors
    /// If the port cannot be opened a second time, or not within the limit.
    fn open_for_emergency_stop(&self, limit: Duration) -> Result<Box<dyn Port>, OpenError>;

    /// Returns the time after which the service tries again to connect.
    fn reconnect_interval(&self) -> Duration {
        RECONNECT_INTERVAL
    }

    /// Returns the time for which an unconfirmed emergency stop is sent repeatedly.
    fn emergency_limit(&self) -> Duration {
        EMERGENCY_LIMIT
    }
}

/// Connector of a robot by the name of its port in `growbot.toml`.
pub struct ConfiguredPort(pub String);

impl Connector for ConfiguredPort {
    fn open(&self, robot: &Robot) -> Result<OpenPort, OpenError> {
        port::open(&self.0.parse()?, robot, &TipSettings::default())
    }

    fn open_for_emergency_stop(&self, limit: Duration) -> Result<Box<dyn Port>, OpenError> {
        port::open_for_emergency_stop(&self.0.parse()?, limit)
    }
}

/// An open connection to a board.
pub struct BoardConnection {
    pub client: Client,
    pub simulation: Option<Box<dyn SimulatedTip>>,
    pub robot: Robot,
    pub hello: BoardInfo,
    /// True if an earlier stop that the board had not confirmed was delivered over this connection before anything
    /// else.
    pub is_stopped: bool,
}

impl RobotWorker {
    /// Connects to the board. Delivers an unconfirmed stop before anything else, even to a board of another robot,
    /// owner or release. `switches_on` starts a simulated robot that is switched off.
    pub(super) fn connect(&self, switches_on: bool) -> Result<BoardConnection, String> {
        let name = self.port()?;
        let configured = self.entry.robot.as_ref().map(PathBuf::from);
        let mut robot = match &configured {
            Some(robot) => Some(robot_file::load(robot).map_err(|error| error.to_string())?),
            None => None,
        };
        if let PortName::SimDaemon(name) = &name {
            let place = StateDir::of(name).map_err(|error| error.to_string())?;
            if switches_on && !place.is_on() {
                let pace = self.entry.pace.unwrap_or(1.0);
                switch_on(&place, configured.as_deref(), pace).map_err(|error| error.to_string())?;
            }
            robot = place.robot().map_err(|error| error.to_string())?.or(robot);
        }
        let robot = match robot {
            Some(robot) => Some(robot),
            None if name.is_simulated() => {
                Some(robot_file::load(robot_file::DEFAULT.as_ref()).map_err(|e| e.to_string())?)
            }
            None => None,
        };
        // On a real port the board reports which robot it is.
        let any = robot_file::load(robot_file::DEFAULT.as_ref()).map_err(|error| error.to_string())?;
        let opened = self.connector.open(robot.as_ref().unwrap_or(&any)).map_err(|error| error.to_string())?;
        let OpenPort { port, simulated_tip: simulation } = opened;
        let mut client = Client::new(port, &self.entry.port);
        self.stopper.publish(client.emergency_port());
        let is_stopped = self.deliver_stop(&mut client)?;
        let hello = client.identify().map_err(|error| error.to_string())?;
        let robot = match robot {
            Some(robot) => robot,
            None => robot_file::load(hello.robot_name.as_str().as_ref()).map_err(|_| {
                format!(
                    "the board's robot is {}, which is not built in: set `robot` for this robot in growbot.toml",
                    hello.robot_name
                )
            })?,
        };
        let hello = client.open_session_for(&robot).map_err(|error| error.to_string())?;
        Ok(BoardConnection { client, simulation, robot, hello, is_stopped })
    }
}
