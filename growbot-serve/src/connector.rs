//! Opens connections of the service to a robot's board.

use std::time::Duration;

use growbot_client::client::{Client, EMERGENCY_LIMIT};
use growbot_client::port::Port;
use growbot_core::link::message::BoardInfo;
use growbot_core::robot::Robot;
use growbot_sim::port::{self, OpenError, OpenPort, TipSettings};
use growbot_sim::simulated_tip::SimulatedTip;

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
