//! `growbot configure`: sends another robot description to a board.

use std::path::PathBuf;
use std::thread::sleep;
use std::time::{Duration, Instant};

use clap::Args;
use growbot_client::client::ClientError;
use growbot_client::command_report::ConfigurationReport;
use growbot_client::port::PortError;
use growbot_core::link::message::BoardInfo;
use growbot_core::robot::Robot;
use growbot_host::output::print;
use growbot_host::{note, warning};
use growbot_plan::robot_file;
use growbot_plan::sanitize::json_line;

use super::board_report::is_configured;
use super::failure::Failure;
use super::find_robot::robot_at;
use super::port_arg::{RequiredPortArg, SelectedPort};
use super::robot_arg::{ROBOT, RobotArg};

/// Maximum time that a board takes to restart after it has stored a description.
const RESTART: Duration = Duration::from_secs(10);
/// Interval between attempts to reconnect.
const LOOK: Duration = Duration::from_millis(250);

/// Send a robot's description to its board, which checks it, stores it and restarts with it
///
/// The board keeps the description over resets and losses of power, and over new firmware that can still read it. The
/// board accepts a new description only while nothing heats or moves, with the nozzle cold and without an unfinished
/// body. It refuses an invalid description, and keeps its present one. From then on the board enforces every limit of
/// the robot.
#[derive(Args)]
#[command(after_help = "Example:\n  growbot configure my-robot.toml --port /dev/ttyACM0")]
pub struct ConfigureArgs {
    /// The robot: a TOML file or a built-in name
    #[arg(value_name = ROBOT)]
    robot: PathBuf,
    #[command(flatten)]
    port: RequiredPortArg,
    /// Print one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
pub fn run(args: &ConfigureArgs) -> Result<(), Failure> {
    let robot = robot_file::load(&args.robot)?;
    robot.check_for_board().map_err(ClientError::Description)?;
    let port = args.port.resolve()?;
    let _lent = robot_at(&port, &RobotArg::default())?.lease("growbot configure")?;
    // A simulated robot that starts with this command has a board with a description, like a board that was flashed.
    let mut client = port.client(&robot_file::load(robot_file::DEFAULT.as_ref())?)?;
    let before = client.open_session()?;
    let now = match client.configure(&robot) {
        Err(ClientError::Port(PortError::Lost(..))) => {
            drop(client);
            after_restart(&port, &robot)?
        }
        done => done?,
    };
    if port.is_in_process() {
        warning!(
            "the robot at {} and its board exist only while this command runs: for a persistent robot use sim:NAME \
             (`growbot power on --port sim:NAME`)",
            port.text()
        );
    } else if before.robot_hash != now.robot_hash {
        note!("give this robot in other commands, too, with --robot {} or in growbot.toml", args.robot.display());
    }
    let had = is_configured(&before).then(|| format!("{} ({:016x})", before.robot_name, before.robot_hash));
    print(&if args.json {
        json_line(&ConfigurationReport {
            robot: now.robot_name.to_string(),
            robot_hash: format!("{:016x}", now.robot_hash),
            robot_before: is_configured(&before).then(|| before.robot_name.to_string()),
            robot_hash_before: is_configured(&before).then(|| format!("{:016x}", before.robot_hash)),
            simulated: port.kind().is_simulated(),
        })
    } else {
        format!(
            "the {}board is now configured as {} ({:016x}); it was {}\n",
            port.kind().prefix(),
            now.robot_name,
            now.robot_hash,
            had.unwrap_or_else(|| "not configured".to_string())
        )
    })?;
    Ok(())
}

/// Reconnects to the board after its restart, and waits at most `RESTART` until the board reports the new
/// description. A serial port over USB disappears while its board restarts.
fn after_restart(port: &SelectedPort, robot: &Robot) -> Result<BoardInfo, Failure> {
    let began = Instant::now();
    while began.elapsed() < RESTART {
        sleep(LOOK);
        let hello = port.client(robot).ok().and_then(|mut client| client.open_session().ok());
        if let Some(hello) = hello.filter(|hello| hello.robot_hash == robot.hash()) {
            return Ok(hello);
        }
    }
    Err(ClientError::NotRestarted { port: port.text().to_owned() }.into())
}
