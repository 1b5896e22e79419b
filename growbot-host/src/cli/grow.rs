//! `growbot grow`: grows a body. `growbot` without a command also runs it, with built-in arguments.

use std::path::PathBuf;

use clap::{Args, Parser};
use growbot_client::growth::{Beginning, GrowthRefusal, GrowthRequest, LogTarget, Override};
use growbot_core::robot::Robot;
use growbot_core::simulation::ErrorModel;
use growbot_host::output::{is_standard_output, print};
use growbot_plan::feedback::DEFAULT_SENSOR_NOISE;
use growbot_plan::robot_file;
use growbot_plan::run_log::RunLog;
use growbot_plan::sanitize::json_line;

use super::body_input::BodyInput;
use super::disturbance::DisturbanceArgs;
use super::failure::Failure;
use super::find_robot::robot_at;
use super::growth_monitor::{OnHostSilence, ResultFormat};
use super::plan_source::PlanSourceArgs;
use super::port_arg::{PortArg, SelectedPort};
use super::remedies;
use super::robot_arg::RobotArg;
use super::robot_handle::NewGrowth;
use super::watch_options::WatchArgs;

/// Grow a body: from a plan, or directly to a pose
///
/// The command sends the layers to the robot's board, which heats, homes its head and lays them one by one. It shows
/// the progress. At the end it shows the final pose of the tip: by the steps that were made, or with --feedback by the
/// sensors. Ctrl-C stops the robot. A second Ctrl-C gives the emergency stop and leaves.
///
/// Through a scene, of the plan or of --scene, a body is grown only if its plan is clear of the scene. With --feedback
/// each correction is checked before the board gets it. It must be clear of all obstacles by 3 standard deviations of
/// the tip's position. If it is not, the body takes another path through the scene. If none is left, the robot pauses.
///
/// Without a robot (--port sim, the default unless another port is set or a service owns a robot) the same controller
/// runs in this program against a simulated tip, on a virtual clock. The final pose is then that of the body that was really
/// laid.
#[derive(Args)]
#[command(after_help = AFTER_HELP)]
pub struct GrowArgs {
    #[command(flatten)]
    goal: PlanSourceArgs,
    #[command(flatten)]
    port: PortArg,
    /// Write the events to this file, which ends in .jsonl (- for standard output). Without a name, a new file is
    /// written: growth-2026-11-23T014500.jsonl
    ///
    /// The file has one JSON object per line. The date is that of the start, UTC. An existing log is replaced only with
    /// --overwrite, once a layer of the new body is laid.
    #[arg(long, value_name = "FILE", num_args = 0..=1)]
    log: Option<Option<PathBuf>>,
    /// Behaviour of the board when it loses contact with this program
    #[arg(long, value_name = "WHAT", default_value = "pause")]
    on_host_silence: OnHostSilence,
    /// Measure each layer and replan the rest from the measured pose of the tip
    ///
    /// The filament's encoder measures the growth. The orientation sensor measures the tip's direction by gravity, and
    /// so no heading. --odometry-noise and --direction-noise set the accuracy of the sensors. On a robot the defaults
    /// are 1 percent and 0.5 degrees.
    #[arg(long)]
    feedback: bool,
    /// Grow in spite of the warnings self-collision, filament-short and layer-limit
    #[arg(long)]
    force: bool,
    /// Grow although the plan is not clear of the scene, and do not keep corrections clear of it
    #[arg(long)]
    ignore_scene: bool,
    /// Replace an existing run log
    #[arg(long)]
    overwrite: bool,
    /// End with one line of JSON instead of a table
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    watching: WatchArgs,
    #[command(flatten)]
    disturbance: DisturbanceArgs,
}

const AFTER_HELP: &str = "\
Examples:
  growbot grow --to 200,100,600,0,45
  growbot grow plan.json --port /dev/ttyACM0 --log run.jsonl
  growbot grow plan.json --log
  growbot grow --robot growbot-a2 --to 0,60,120,90,30 --port emulator
  growbot grow --to 200,100,600,0,45 --noise 10 --feedback
  growbot grow --to 200,100,600,0,45 --watch --control
  growbot grow --to 0,0,800 --scene room.toml --noise 10 --feedback

Exit codes: 0, the body is grown; 1, stopped, refused or a fault; 2, invalid
arguments or input.";

/// Arguments of the growth that `growbot` without a command runs: 1 m of robot A, to a pose that needs bends in two
/// planes.
const MAIN_JOB: [&str; 7] =
    ["growbot grow", "--to", "550,345,610,120,-25", "--port", "sim", "--robot", robot_file::DEFAULT];

/// The arguments of `grow` without a subcommand, for [`MAIN_JOB`].
#[derive(Parser)]
struct MainJobArgs {
    #[command(flatten)]
    grow: GrowArgs,
}

/// Runs the growth of `growbot` without a command.
pub fn run_main_job() -> Result<(), Failure> {
    let MainJobArgs { grow } = MainJobArgs::try_parse_from(MAIN_JOB).map_err(Failure::bad_input)?;
    growbot_host::note!("no command given, so the simulated robot A grows {} {}", MAIN_JOB[1], MAIN_JOB[2]);
    growbot_host::note!("`growbot --help` lists the other commands");
    run(&grow)
}

/// Runs the command.
pub fn run(args: &GrowArgs) -> Result<(), Failure> {
    let (port, print) = (args.port.resolve()?, args.print()?);
    let (opened, unclear) = args.goal.open(ResultFormat::of(args.json))?;
    let BodyInput { robot, plan, .. } = &opened;
    for warning in &plan.warnings {
        growbot_host::warning!("{}: {}", warning.code, remedies::warning_message(warning));
    }
    let disturbance = &args.disturbance;
    let assumed = if port.kind().is_simulated() {
        disturbance.sensor_noise()
    } else {
        disturbance.sensor_noise_or(DEFAULT_SENSOR_NOISE)
    };
    let overrides = Override::given([(args.force, Override::Warnings), (args.ignore_scene, Override::Scene)]);
    let request = GrowthRequest {
        robot,
        plan,
        beginning: Beginning::FirstLayer,
        scene: opened.scene(),
        scene_error: unclear.as_ref(),
        overrides: &overrides,
        feedback: args.feedback.then_some(assumed),
        imperfection: ErrorModel {
            disturbance: disturbance.disturbance(),
            noise: disturbance.sensor_noise(),
            seed: disturbance.seed,
        },
        kind: port.kind(),
    };
    request.check().map_err(|refusal| args.refused(&request, &refusal, &port))?;
    args.note_missing_sensors(robot);
    if request.ignores_scene() {
        growbot_host::warning!(
            "--ignore-scene is given: neither the plan nor its corrections are checked against the scene"
        );
    }
    robot_at(&port, &RobotArg::default())?.grow(NewGrowth {
        request,
        opened: &opened,
        name: args.goal.name("growbot grow"),
        scene_path: args.goal.place_of_scene(plan)?,
        log: args.log_target(),
        silence: args.on_host_silence.into(),
        watching: &args.watching,
        print,
    })
}

impl GrowArgs {
    /// Returns the format in which the result is printed.
    fn print(&self) -> Result<ResultFormat, Failure> {
        match (&self.log, self.json) {
            (Some(Some(log)), true) if is_standard_output(log) => Err(Failure::bad_input(
                "--log - and --json both write to standard output: remove one of them; the run log contains the \
                 result, too",
            )),
            (Some(Some(log)), false) if is_standard_output(log) => Ok(ResultFormat::Nothing),
            (_, json) => Ok(ResultFormat::of(json)),
        }
    }

    /// Returns the file for the run log that `--log` requests.
    fn log_target(&self) -> LogTarget {
        match &self.log {
            None => LogTarget::Disabled,
            Some(Some(path)) if is_standard_output(path) => LogTarget::StandardOutput,
            Some(Some(path)) if self.overwrite => LogTarget::Replaced(path.clone()),
            Some(Some(path)) => LogTarget::File(path.clone()),
            Some(None) => {
                let path = RunLog::free_name();
                growbot_host::note!("run log in {}", path.display());
                LogTarget::File(path)
            }
        }
    }

    /// Returns the failure of a growth that is refused, with the remedy. With `--json` prints the line of JSON, unless
    /// the options contradict the robot.
    fn refused(&self, request: &GrowthRequest, refusal: &GrowthRefusal, port: &SelectedPort) -> Failure {
        let words = match refusal {
            GrowthRefusal::Warnings { .. } => {
                format!("{refusal}: change the plan, or ignore the warnings with --force")
            }
            GrowthRefusal::Scene(error) => {
                format!("{}; or grow without checking the scene (--ignore-scene)", remedies::message(*error))
            }
            GrowthRefusal::Clearance(_) => format!(
                "{refusal}: plan with a larger --margin or another --radius (`growbot plan --scene`), use a better \
                 sensor, or ignore the scene with --ignore-scene"
            ),
            GrowthRefusal::Disturbance => format!(
                "{refusal}: remove the noise and bias options, or use --port sim, emulator or rp2040 instead of {}",
                port.text()
            ),
            GrowthRefusal::SensorNoise => {
                format!("{refusal}: add --feedback, or remove --odometry-noise and --direction-noise")
            }
            GrowthRefusal::NoSensor { .. } => {
                format!("{refusal}: give it sensors.filament_motion or sensors.orientation, or remove --feedback")
            }
        };
        if refusal.is_invalid_request() {
            return Failure::bad_input(words);
        }
        // If the line cannot be printed, the caller still reports why the growth did not start.
        if self.json
            && let Err(error) = print(&json_line(&request.refused(refusal, words.clone())))
        {
            Failure::from(error).print();
        }
        Failure::request_failed(words)
    }

    /// Prints which measurements of the feedback are missing, because the robot has no sensor for them.
    fn note_missing_sensors(&self, robot: &Robot) {
        let sensors = &robot.description().sensors;
        if self.feedback && sensors.filament_motion.is_none() {
            growbot_host::note!(
                "without sensors.filament_motion feedback measures only the tip's direction, not its growth"
            );
        }
        if self.feedback && !sensors.orientation {
            growbot_host::note!("without sensors.orientation feedback measures only growth, not bends");
        }
    }
}

#[cfg(test)]
mod tests {
    use clap::CommandFactory;

    use super::*;

    #[test]
    fn the_main_job_is_a_valid_command() {
        MainJobArgs::command().debug_assert();
        MainJobArgs::try_parse_from(MAIN_JOB).unwrap();
    }
}
