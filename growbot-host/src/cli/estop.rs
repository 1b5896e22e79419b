//! `growbot estop`: the emergency stop.

use clap::Args;
use growbot_host::output::print;

use super::{Failure, PortArg, RobotArg};

/// Emergency stop: heater and steppers off before the board does anything else
///
/// Whoever holds the board and whatever is queued: eight bytes that the board recognises as they arrive, repeated until it says that it
/// has obeyed. It stays off until the stop is cleared (`clear` in `growbot console`).
#[derive(Args)]
#[command(
    after_help = "Example:\n  growbot estop --port /dev/ttyACM0\n\nExit codes: 0, the board has said that everything is off; 1, it has not: cut its power."
)]
pub struct EstopArgs {
    #[command(flatten)]
    port: PortArg,
    #[command(flatten)]
    robot: RobotArg,
}

/// Runs the command.
pub fn run(args: &EstopArgs) -> Result<(), Failure> {
    let robot = args.robot.load()?;
    let mut client = args.port.client(&robot)?;
    client.emergency_stop().map_err(Failure::answered_no)?;
    Ok(print("emergency stop: heater and steppers are off\n")?)
}
