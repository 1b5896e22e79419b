//! `growbot cancel`: discards the body that the board stores.

use clap::Args;
use growbot_core::link::message::{Cancel, PassiveRequest};
use growbot_host::output::print;

use super::failure::Failure;
use super::port_arg::RequiredPortArg;
use super::robot_arg::RobotArg;
use super::service_robot::find_service_robot;

/// Discard the body under way: heater and steppers go off, and the board forgets it
///
/// After a stop, a fault or a reset the board stores its data of an unfinished body, so that `growbot resume` can
/// continue it.
#[derive(Args)]
#[command(after_help = "Example:\n  growbot cancel --port /dev/ttyACM0")]
pub struct CancelArgs {
    #[command(flatten)]
    port: RequiredPortArg,
    #[command(flatten)]
    robot: RobotArg,
}

/// Runs the command.
pub fn run(args: &CancelArgs) -> Result<(), Failure> {
    let port = args.port.resolve()?;
    if let Some(owned) = find_service_robot(&port)? {
        return owned.cancel();
    }
    port.require_running_robot("the cancellation")?;
    let robot = args.robot.load()?;
    let mut client = port.client(&robot)?;
    let hello = client.open_session()?;
    let plan_id = hello.status.plan_id;
    if plan_id == 0 {
        return Ok(print(&format!("the {}board has no stored job: there is nothing to cancel\n", port.kind()))?);
    }
    client.request("the request to discard the body", &PassiveRequest::Cancel(Cancel { plan_id }))?;
    Ok(print(&format!(
        "plan {plan_id:016x} discarded by the {}board after {} layers\n",
        port.kind(),
        hello.status.layers_laid
    ))?)
}
