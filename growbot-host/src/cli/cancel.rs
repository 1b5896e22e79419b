//! `growbot cancel`: give up the body that the board knows.

use clap::Args;
use growbot_core::link::message::{Cancel, Message};
use growbot_host::client::Client;
use growbot_host::output::print;
use growbot_host::port;

use super::{Failure, PortArg, RobotArg};

/// Give up the body under way: heater and steppers off, and the board forgets it
///
/// After a stop, a fault or a reset the board keeps what it knows of an unfinished body, for `growbot resume`.
#[derive(Args)]
#[command(after_help = "Example:\n  growbot cancel --port /dev/ttyACM0")]
pub struct CancelArgs {
    #[command(flatten)]
    port: PortArg,
    #[command(flatten)]
    robot: RobotArg,
    /// Take the board over from another host that holds it
    #[arg(long)]
    take_over: bool,
}

/// Runs the command.
pub fn run(args: &CancelArgs) -> Result<(), Failure> {
    let robot = args.robot.load()?;
    let mut client = Client::new(port::open(&args.port.name()?, &robot)?, args.port.text());
    let hello = if args.take_over { client.take_over() } else { client.hello() }?;
    let plan_id = hello.status.plan_id;
    if plan_id == 0 {
        return Ok(print("the board holds no body\n")?);
    }
    client.request("to give the body up", &Message::Cancel(Cancel { plan_id }))?;
    Ok(print(&format!("given up: plan {plan_id:016x}, {} layers laid\n", hello.status.laid))?)
}
