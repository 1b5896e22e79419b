//! `growbot console`: controls a robot by commands, line by line from a terminal or a pipe, or on the whole screen
//! (`--tui`).

mod board_requests;
mod commands;
mod history;
mod script;
mod session;
mod tui;

use clap::Args;
use growbot_plan::input::note_standard_input;
use growbot_sim::port::TipSettings;

use super::failure::Failure;
use super::find_robot::robot_at;
use super::port_arg::{Connection, PortArg};
use super::robot_arg::RobotArg;

/// Control a robot with typed commands, on a terminal or in a pipe
///
/// `help` lists the commands. In a pipe each line of standard input is a command. The console ends with exit code 1 at
/// the first command that fails, or whose result cannot be printed because the reader is gone. The lines after it are
/// not run. The console prints which commands were not run, and what the robot is doing.
#[derive(Args)]
#[command(after_help = "Examples:\n  growbot console --port /dev/ttyACM0\n  growbot console --tui\n  printf 'plan \
                  0,0,60,0,90\\nstart\\nwait 60\\nstatus\\n' | growbot console")]
pub struct ConsoleArgs {
    #[command(flatten)]
    port: PortArg,
    #[command(flatten)]
    robot: RobotArg,
    /// Use the whole screen: charts of temperature and layers, the body as it grows, a key for each command
    ///
    /// Needs a terminal of at least 80x24. Leaving the screen does not stop the robot. On sim, time passes 60 times as
    /// fast as real time, and + and - change the speed.
    #[arg(long)]
    tui: bool,
}

/// Runs the command.
pub fn run(args: &ConsoleArgs) -> Result<(), Failure> {
    if args.tui {
        tui::check_terminal()?;
    }
    note_standard_input()?;
    let port = args.port.resolve()?;
    let robot = args.robot.load()?;
    let presets = args.robot.presets()?;
    let _lent = robot_at(&port, &args.robot)?.lease("growbot console")?;
    let Connection { mut client, simulation } = port.connect(&robot, &TipSettings::default())?;
    if args.tui {
        return tui::run(client, robot, presets, &port);
    }
    client.open_session()?;
    session::ConsoleSession::new(client, simulation, robot, presets, port).run()
}
