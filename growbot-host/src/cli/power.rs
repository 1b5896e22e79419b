//! `growbot power`: switches persistent simulated robots.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use growbot_core::robot::Robot;
use growbot_sim::port::PortName;
use growbot_sim::sim_daemon::process::{switch_on, wait_until_off};
use growbot_sim::sim_daemon::{DaemonPort, StateDir, serve};

use super::failure::Failure;
use super::json_arg::JsonArg;
use super::port_arg::RequiredPortArg;
use super::robot_arg::{ROBOT, RobotArg};
use super::watch_options::parse_pace;

/// Switch a simulated robot on or off, reset its board, or change its spool
///
/// The simulated robot sim:NAME stays on after the command that grew with it, like a real robot. Another command can
/// show, stop or resume its growth. If it is switched off in the middle of a layer, it keeps what a board keeps: its
/// flash. Without filament it pauses until it has a new spool, which `growbot power new-spool` puts in. Its data are in
/// ~/.local/state/growbot/robots/NAME. sim:./NAME keeps them in the directory NAME.
#[derive(Args)]
#[command(after_help = AFTER_HELP)]
pub struct PowerArgs {
    /// Action of the switch
    #[arg(value_name = "on|off|reset|new-spool|status")]
    action: PowerAction,
    #[command(flatten)]
    port: RequiredPortArg,
    /// The robot, if it is switched on for the first time: a built-in name or a TOML file [default: the stored one, or
    /// else the configured one]
    #[arg(long, value_name = ROBOT)]
    robot: Option<PathBuf>,
    /// Pace of the robot's time, in multiples of real time
    #[arg(long, value_name = "TIMES", default_value = "1", value_parser = parse_pace)]
    pace: f64,
    /// Run the robot in this process, until it is switched off
    #[arg(long, conflicts_with = "json")]
    foreground: bool,
    #[command(flatten)]
    json: JsonArg,
}

const AFTER_HELP: &str = "\
Examples:
  growbot power on --port sim:lab --robot growbot-a2 --pace 100
  growbot grow --robot growbot-a2 --to 0,0,50,0,90 --port sim:lab
  growbot power off --port sim:lab";

/// Actions of the switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum PowerAction {
    /// Switch the robot on
    On,
    /// Switch the robot off at once
    Off,
    /// Reset the robot's board
    Reset,
    /// Put a full spool in place of the present one
    NewSpool,
    /// Print whether the robot is on
    Status,
}

/// Runs the command.
pub fn run(args: &PowerArgs) -> Result<(), Failure> {
    let port = args.port.resolve()?;
    let PortName::SimDaemon(name) = port.name() else {
        return Err(Failure::bad_input(format!(
            "growbot cannot switch the power of the robot at port {}: `growbot power` works only with persistent \
             simulated robots, sim:NAME",
            port.text()
        )));
    };
    let place = StateDir::of(name)?;
    let done = match args.action {
        PowerAction::On if args.foreground => return args.run_in_foreground(&place),
        PowerAction::On => {
            args.switch_on(&place)?;
            format!("the simulated robot sim:{name} is on, {} times as fast as real time\n", args.pace)
        }
        PowerAction::Off => {
            DaemonPort::open_shared(&place)?.power_off()?;
            wait_until_off(&place)?;
            format!("the simulated robot sim:{name} is off\n")
        }
        PowerAction::Reset => {
            DaemonPort::open_shared(&place)?.reset()?;
            format!("the board of the simulated robot sim:{name} was reset\n")
        }
        PowerAction::NewSpool => {
            DaemonPort::open_shared(&place)?.change_spool()?;
            format!("the simulated robot sim:{name} has a full spool\n")
        }
        PowerAction::Status => {
            format!("the simulated robot sim:{name} is {}\n", if place.is_on() { "on" } else { "off" })
        }
    };
    args.json.print(&port, &done)
}

impl PowerArgs {
    /// Returns the given robot, or the stored one, or else the configured one.
    fn robot(&self, place: &StateDir) -> Result<Robot, Failure> {
        let stored = place.robot()?.filter(|_| self.robot.is_none());
        stored.map_or_else(|| RobotArg { robot: self.robot.clone() }.load(), Ok)
    }

    fn run_in_foreground(&self, place: &StateDir) -> Result<(), Failure> {
        let robot = self.robot(place)?;
        Ok(serve(place, &robot, self.pace, || growbot_host::note!("the simulated robot sim:{} is on", place.name()))?)
    }

    /// Starts a separate process that runs the robot, and waits until the robot is on.
    fn switch_on(&self, place: &StateDir) -> Result<(), Failure> {
        // Errors are reported by this process, whose messages the user reads.
        place.check(&self.robot(place)?)?;
        place.create()?;
        Ok(switch_on(place, self.robot.as_deref(), self.pace)?)
    }
}
