//! `growbot resume`: continues an unfinished body.

use std::fs;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use growbot_client::growth::OnInterrupted;
use growbot_plan::input::display_name;

use super::body_input::BodyInput;
use super::failure::Failure;
use super::find_robot::robot_at;
use super::growth_monitor::{OnHostSilence, ResultFormat};
use super::port_arg::PortArg;
use super::robot_arg::RobotArg;
use super::robot_handle::ResumedGrowth;
use super::watch_options::WatchArgs;

/// Resume an unfinished body: after a stop, a fault, a reset, a loss of power or of the host
///
/// The command shows the state of the body and waits for your confirmation. It then heats, finds the head's index,
/// primes the nozzle and continues at the first layer that is not laid. It takes the plan, or better the log of the
/// growth (`grow --log`), which it then continues. A growth with feedback is resumed with feedback, and only from its
/// log. In a scene its corrections also stay clear of the obstacles.
///
/// Without --port and GROWBOT_PORT the robot is the one at the port that the log names.
///
/// The command prints how much of an interrupted layer was made. By default that layer is laid again.
#[derive(Args)]
#[command(after_help = AFTER_HELP)]
pub struct ResumeArgs {
    /// The run log of the growth, or its plan [default: the robot's latest job, if a service owns it]
    #[arg(value_name = "RUN|PLAN")]
    file: Option<PathBuf>,
    /// The robot: a built-in name or a TOML file [default: the plan's]
    #[arg(long, value_name = "FILE|NAME")]
    robot: Option<PathBuf>,
    /// The scene of the growth, if its file has moved [default: the plan's]
    #[arg(long, value_name = "FILE")]
    scene: Option<PathBuf>,
    #[command(flatten)]
    port: PortArg,
    /// Treatment of an interrupted layer
    #[arg(long, value_name = "WHAT", default_value = "redo")]
    interrupted_layer: InterruptedLayerChoice,
    /// Behaviour of the board when it loses contact with this program
    #[arg(long, value_name = "WHAT", default_value = "pause")]
    on_host_silence: OnHostSilence,
    #[command(flatten)]
    watching: WatchArgs,
    /// Continue without confirmation. If a service owns the robot, no confirmation is needed
    #[arg(long)]
    yes: bool,
    /// End with one line of JSON instead of a table
    #[arg(long)]
    json: bool,
}

const AFTER_HELP: &str = "\
Examples:
  growbot resume run.jsonl                # at the port that the log names
  growbot resume run.jsonl --port /dev/ttyACM0
  growbot resume --port /dev/ttyACM0      # its latest job, where a service owns it
  growbot resume plan.json --port /dev/ttyACM0 --interrupted-layer keep --yes

Exit codes: 0, the body is grown; 1, nothing to resume, stopped, refused or a
fault; 2, invalid arguments or input.";

/// Treatment of an interrupted layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum InterruptedLayerChoice {
    /// Lay the whole layer again, on top of the part that is finished
    Redo,
    /// Keep the interrupted layer as it is
    Keep,
}

/// Runs the command.
pub fn run(args: &ResumeArgs) -> Result<(), Failure> {
    let opened = args.file.as_ref().map(|file| Ok::<_, Failure>((file, args.opened(file)?))).transpose()?;
    let log = opened.as_ref().and_then(|(file, opened)| Some((file.as_path(), opened.record()?)));
    let port = args.port.resolve_for_log(log)?;
    let robot_arg = RobotArg::default();
    let robot = robot_at(&port, &robot_arg)?;
    robot.resume(ResumedGrowth {
        opened,
        scene: args.scene.as_ref(),
        interrupted: args.interrupted_layer.into(),
        silence: args.on_host_silence.into(),
        is_confirmed: args.yes,
        watching: &args.watching,
        print: ResultFormat::of(args.json),
    })
}

impl From<InterruptedLayerChoice> for OnInterrupted {
    fn from(choice: InterruptedLayerChoice) -> Self {
        match choice {
            InterruptedLayerChoice::Redo => Self::Redo,
            InterruptedLayerChoice::Keep => Self::Skip,
        }
    }
}

impl ResumeArgs {
    /// Reads the run log or plan of the growth, with the scene of the plan. Returns an error if a scene is given but
    /// the plan has none.
    fn opened(&self, file: &Path) -> Result<BodyInput, Failure> {
        let opened = BodyInput::open(file, self.robot.as_deref(), self.scene.as_deref())?;
        if let (None, Some(scene)) = (&opened.plan.scene, &self.scene) {
            return Err(Failure::bad_input(format_args!(
                "the plan of {} was made without a scene, so the growth cannot be checked against {}: remove --scene",
                display_name(file),
                scene.display()
            )));
        }
        if opened.run.is_some() && !fs::metadata(file).is_ok_and(|file| file.is_file()) {
            return Err(Failure::bad_input(format_args!(
                "{} is not a file, but a run log is continued in its own file: give the file of the run log",
                display_name(file)
            )));
        }
        Ok(opened)
    }
}
