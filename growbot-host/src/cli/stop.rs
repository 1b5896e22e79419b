//! `growbot stop`: switches heater and steppers off.

use clap::Args;
use growbot_client::client::ClientError;
use growbot_core::link::message::{Empty, PassiveRequest};
use growbot_host::output::print;
use growbot_host::settings::InvalidFiles;

use super::failure::Failure;
use super::port_arg::RequiredPortArg;
use super::remedies;
use super::robot_arg::RobotArg;
use super::service_robot::find_service_robot;

/// Stop the robot: heater and steppers off at once
///
/// A layer under way is interrupted. The board stores its data of the body. `growbot resume` resumes the body, and
/// `growbot cancel` discards it.
#[derive(Args)]
#[command(after_help = "Example:\n  growbot stop --port /dev/ttyACM0")]
pub struct StopArgs {
    #[command(flatten)]
    port: RequiredPortArg,
    #[command(flatten)]
    robot: RobotArg,
}

/// Runs the command. It opens no session with the board, because a board of another firmware release or of another
/// robot must also stop.
pub fn run(args: &StopArgs) -> Result<(), Failure> {
    let mut skipped = Vec::new();
    let port = args.port.resolve_from_files(InvalidFiles::Skip(&mut skipped));
    let robot = args.robot.load_from_files(InvalidFiles::Skip(&mut skipped));
    for error in &skipped {
        growbot_host::warning!(
            "the settings cannot be read and are not used for this stop: {}",
            remedies::message(error)
        );
    }
    let port = port?;
    if let Some(owned) = find_service_robot(&port)? {
        return owned.stop();
    }
    port.require_running_robot("the stop")?;
    let mut client = port.client(&robot?)?;
    client.request("the request to stop", &PassiveRequest::Stop(Empty {})).map_err(|error| match error {
        ClientError::Refused { .. } => error.into(),
        error => Failure::bad_input(format!(
            "{}; the robot may still be hot or moving: send the emergency stop (`growbot estop --port {}`), or cut its \
             power",
            remedies::message(&error),
            port.text()
        )),
    })?;
    Ok(print(&format!("stopped: heater and steppers of the {}robot are off\n", port.kind()))?)
}
