//! `growbot console`: commands line by line, on a terminal or in a pipe, or the whole screen.

mod ask;
pub use self::ask::maintain;
mod commands;
mod history;
mod leaving;
mod line;
mod tui;

use clap::Args;
use growbot_client::input::note_standard_input;
use growbot_core::pose::Pose;
use growbot_sim::port::TipSettings;

use super::service::borrow_line;
use super::{Connection, Failure, PortArg, RobotArg};

/// Type commands, see the robot; works in a pipe
///
/// `help` lists the commands. In a pipe each line of standard input is a command; the first one that fails, or whose
/// result nobody reads any more, ends it, with exit code 1. The lines after it are not carried out: what they were, and
/// what the robot is doing, is printed.
#[derive(Args)]
#[command(after_help = "Examples:\n  growbot console --port /dev/ttyACM0\n  growbot console --tui\n  printf 'plan \
                  0,0,60,0,90\\nstart\\nwait 60\\nstatus\\n' | growbot console")]
pub struct ConsoleArgs {
    #[command(flatten)]
    port: PortArg,
    #[command(flatten)]
    robot: RobotArg,
    /// Use the whole screen: charts of temperature and layers, the body as it
    /// grows, a key for each command
    ///
    /// Needs a terminal, from 80x24 on. Leaving it leaves the robot as it is. On
    /// sim, time passes 60 times as fast as real time; + and - change that.
    #[arg(long)]
    tui: bool,
}

/// Runs the command.
pub fn run(args: &ConsoleArgs) -> Result<(), Failure> {
    if args.tui {
        tui::check_terminal()?;
    }
    note_standard_input()?;
    let port = args.port.choose()?;
    let robot = args.robot.load()?;
    let presets = args.robot.presets()?;
    let _lent = borrow_line(&port, "growbot console")?;
    let Connection { mut client, simulation } = port.connect(&robot, &TipSettings::default())?;
    let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).map_err(Failure::bad_input)?;
    if args.tui {
        return tui::run(client, robot, presets, start, &port);
    }
    client.hello()?;
    line::Session::new(client, simulation, robot, presets, start, port).run()
}
