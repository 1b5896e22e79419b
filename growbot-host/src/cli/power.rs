//! `growbot power`: the switch of simulated robots that stay on.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use growbot_client::robot_file;
use growbot_core::robot::Robot;
use growbot_host::output::print;
use growbot_host::switch::{switch_on, wait_until_off};
use growbot_sim::port::PortName;
use growbot_sim::resident::{Line, Place, play};

use super::watching::times;
use super::{Failure, ROBOT, RobotArg, RobotPortArg};

/// Switch a simulated robot on or off, or reset its board
///
/// The simulated robot sim:NAME stays on when the command that grew with it has ended, as a robot does: another command
/// sees, stops or resumes what it does. Switched off in the midst of a layer it keeps what a board keeps: its flash.
/// What it knows is in ~/.local/state/growbot/robots/NAME; sim:./NAME keeps it in the directory NAME.
#[derive(Args)]
#[command(after_help = AFTER_HELP)]
pub struct PowerArgs {
    /// What to do
    #[arg(value_name = "on|off|reset|status")]
    what: What,
    #[command(flatten)]
    port: RobotPortArg,
    /// The robot, when it is switched on for the first time: a built-in name or a
    /// TOML file [default: the one that it is, or else the configured one]
    #[arg(long, value_name = ROBOT)]
    robot: Option<PathBuf>,
    /// How many times as fast as real time its time passes
    #[arg(long, value_name = "TIMES", default_value = "1", value_parser = times)]
    pace: f64,
    /// Play the robot in this process, until it is switched off
    #[arg(long)]
    foreground: bool,
}

const AFTER_HELP: &str = "\
Examples:
  growbot power on --port sim:lab --robot growbot-a2 --pace 100
  growbot grow --robot growbot-a2 --to 0,0,50,0,90 --port sim:lab
  growbot power off --port sim:lab";

/// What can be done with a switch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum What {
    /// Switch it on
    On,
    /// Switch it off, at this moment
    Off,
    /// Reset its board
    Reset,
    /// Say whether it is on
    Status,
}

/// Runs the command.
pub fn run(args: &PowerArgs) -> Result<(), Failure> {
    let port = args.port.choose()?;
    let PortName::Resident(name) = port.name() else {
        return Err(Failure::bad_input(format!(
            "port {} has no switch that growbot knows: it is for simulated robots that stay on, sim:NAME",
            port.text()
        )));
    };
    let place = Place::of(name)?;
    let done = match args.what {
        What::On if args.foreground => return args.play(&place),
        What::On => {
            args.switch_on(&place)?;
            format!("the simulated robot sim:{name} is on, {} times as fast as real time\n", args.pace)
        }
        What::Off => {
            Line::open_beside(&place)?.power_off()?;
            wait_until_off(&place)?;
            format!("the simulated robot sim:{name} is off\n")
        }
        What::Reset => {
            Line::open_beside(&place)?.reset()?;
            format!("the board of the simulated robot sim:{name} was reset\n")
        }
        What::Status => {
            let is = if place.is_on() { "on" } else { "off" };
            format!("the simulated robot sim:{name} is {is}\n")
        }
    };
    Ok(print(&done)?)
}

impl PowerArgs {
    /// The robot that is asked for, or lives there, or is configured.
    fn robot(&self, place: &Place) -> Result<Robot, Failure> {
        match (&self.robot, place.robot()?) {
            (Some(robot), _) => Ok(robot_file::load(robot)?),
            (None, Some(robot)) => Ok(robot),
            (None, None) => RobotArg { robot: None }.load(),
        }
    }

    fn play(&self, place: &Place) -> Result<(), Failure> {
        let robot = self.robot(place)?;
        Ok(play(place, &robot, self.pace, || growbot_host::note!("the simulated robot sim:{} is on", place.name()))?)
    }

    /// Starts a process of its own that plays the robot, and waits until it does.
    fn switch_on(&self, place: &Place) -> Result<(), Failure> {
        // What is wrong is said here, where somebody reads it.
        place.check(&self.robot(place)?)?;
        Ok(switch_on(place, self.robot.as_deref(), self.pace)?)
    }
}
