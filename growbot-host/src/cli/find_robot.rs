//! Finds the robot of a command.

use growbot_remote::client::RESPONSE_TIMEOUT;
use growbot_remote::remote_robot::RemoteRobot;

use super::failure::Failure;
use super::local_robot::LocalRobot;
use super::port_arg::SelectedPort;
use super::robot_arg::RobotArg;
use super::robot_handle::RobotHandle;

/// Returns the robot at this port: that of the service, if a service of this user owns it, or else the board at the
/// port. `robot` is the robot that a simulated port simulates.
pub fn robot_at<'a>(port: &'a SelectedPort, robot: &'a RobotArg) -> Result<Box<dyn RobotHandle + 'a>, Failure> {
    Ok(match RemoteRobot::find(port.text(), RESPONSE_TIMEOUT)? {
        Some(owned) => Box::new(owned),
        None => Box::new(LocalRobot { port, robot }),
    })
}
