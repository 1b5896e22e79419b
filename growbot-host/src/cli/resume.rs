//! `growbot resume`: continues an unfinished body.

use std::fs;
use std::io::{self, IsTerminal, Write};
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use growbot_client::client::Client;
use growbot_client::growth::{Beginning, GrowthBoard, GrowthError, GrowthRequest, LogTarget, OnInterrupted};
use growbot_core::link::message::{BoardInfo, State};
use growbot_plan::input::display_name;
use growbot_plan::job::Job;
use growbot_plan::run_log::{InterruptedLayerJson, RecordedRun};
use growbot_sim::port::TipSettings;

use super::failure::Failure;
use super::growth_monitor::{GrowthMonitor, OnHostSilence, ResultFormat};
use super::growth_table::made;
use super::interrupt::stop_on_interrupt;
use super::opened::Opened;
use super::port_arg::{PortArg, SelectedPort};
use super::remedies;
use super::service_robot::{ServiceGrowthOptions, find_service_robot};
use super::terminal_commands::TerminalCommands;
use super::typed_answer::read_answer;
use super::watch_options::WatchArgs;

/// Resume an unfinished body: after a stop, a fault, a reset, a loss of power or of the host
///
/// The command shows the state of the body and waits for your confirmation. It then heats, finds the head's index,
/// primes the nozzle and continues at the first layer that is not laid. It takes the plan, or better the log of the
/// growth (`grow --log`), which it then continues. A growth with feedback is resumed with feedback, and only from its
/// log. In a scene its corrections also stay clear of the obstacles.
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
    let port = args.port.resolve()?;
    let owned = find_service_robot(&port)?;
    let opened = match &args.file {
        Some(file) => Some((file, args.opened(file)?)),
        None => None,
    };
    if let Some(owned) = owned {
        args.reject_options_unsupported_by_service()?;
        let page = args.watching.of_service()?;
        let options = ServiceGrowthOptions {
            feedback: false,
            force: false,
            ignore_scene: false,
            print: ResultFormat::of(args.json),
            log: None,
            page,
        };
        let plan_id = opened.map(|(_, Opened { robot, plan, .. })| Job::of_plan(&robot, &plan).plan_id);
        return owned.resume(plan_id, &options);
    }
    let Some((file, mut opened)) = opened else {
        return Err(Failure::bad_input(
            "no service owns this robot, so its latest job is unknown: give the run log of the growth, or its plan",
        ));
    };
    let mut record = opened.run.take().map(|(record, _)| record);
    let with_feedback = record.as_ref().filter(|record| record.feedback.is_some());
    if let (Some(record), None) = (with_feedback, &opened.scene) {
        // Corrections are proven to be clear of the plan's scene, so nothing is resumed without it.
        let named = opened.plan.scene.as_ref().map(|scene| scene.file.clone()).unwrap_or_default();
        let scene = record.scene(&opened.plan, &opened.robot, args.scene.as_deref())?;
        opened.scene = scene.map(|loaded| (named, loaded));
    }
    let Opened { robot, plan, .. } = &opened;
    let pace = args.watching.pace(port.name())?;
    let mut client = port.connect(robot, &TipSettings { pace, ..TipSettings::default() })?.client;
    let board = client.identify()?;
    Client::check_robot(&board, robot)?;
    if let Some(record) = &mut record {
        record.sync_to_board(board.status.plan_id);
    }
    let interrupted = match args.interrupted_layer {
        InterruptedLayerChoice::Redo => OnInterrupted::Redo,
        InterruptedLayerChoice::Keep => OnInterrupted::Skip,
    };
    let request = GrowthRequest {
        beginning: Beginning::Resume { record: record.as_ref(), interrupted },
        scene: opened.scene(),
        simulated: port.is_simulated(),
        ..GrowthRequest::new(robot, plan)
    };
    let job = request.job();
    show(&board, job.plan_id, &port)?;
    if !args.yes {
        ask(&board)?;
    }
    let target = if record.is_some() { LogTarget::File(file.clone()) } else { LogTarget::Disabled };
    let log = request.open_log(&target, &job, port.text())?;
    let orders = stop_on_interrupt(&mut client, &port);
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let name = format!("{name}{}", port.simulated_suffix());
    let known = record.as_ref().map_or_else(Vec::new, RecordedRun::known_layers);
    let watch = args.watching.begin(&opened.subject(&name), &job, &known, &orders)?;
    if record.as_ref().is_some_and(|record| record.feedback.is_some()) {
        growbot_host::note!("with feedback, as it was started");
    }
    let following = GrowthMonitor {
        request,
        log,
        watch,
        print: ResultFormat::of(args.json),
        laid: board.status.layers_laid as usize,
        pace: port.pace(pace),
        keyboard: TerminalCommands::of_terminal(&orders),
        page_controls: args.watching.can_control(),
    };
    let board = GrowthBoard {
        client: &mut client,
        truth: None,
        commands: &orders,
        silence: args.on_host_silence.into(),
        parked: following.when_parked(),
    };
    following.follow(&job, board)
}

impl ResumeArgs {
    /// Refuses options that a service does not support. A service lays an interrupted layer again, lets the board pause
    /// if the service is silent, and takes the scene from its original place.
    fn reject_options_unsupported_by_service(&self) -> Result<(), Failure> {
        let given = [
            ("--interrupted-layer keep", self.interrupted_layer == InterruptedLayerChoice::Keep),
            ("--on-host-silence continue", self.on_host_silence == OnHostSilence::Continue),
            ("--scene", self.scene.is_some()),
        ];
        match given.into_iter().find(|(_, is_given)| *is_given) {
            None => Ok(()),
            Some((option, _)) => Err(Failure::bad_input(format!(
                "a service owns this robot and does not support {option}: remove this option, or end `growbot serve` \
                 first"
            ))),
        }
    }

    /// Reads the run log or plan of the growth, with the scene of the plan. Returns an error if a scene is given but
    /// the plan has none.
    fn opened(&self, file: &Path) -> Result<Opened, Failure> {
        let opened = Opened::open(file, self.robot.as_deref(), self.scene.as_deref())?;
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

/// Prints the state of the body on the board. Returns an error if the board cannot resume this plan.
fn show(board: &BoardInfo, plan_id: u64, port: &SelectedPort) -> Result<(), Failure> {
    let status = &board.status;
    if status.plan_id != plan_id || status.plan_id == 0 {
        let nothing = GrowthError::nothing_to_resume(plan_id, status);
        let anew = if port.is_in_process() { "; this robot is simulated and restarts with each command" } else { "" };
        return Err(Failure::request_failed(format_args!("{nothing}{anew}")));
    }
    growbot_host::note!(
        "plan {plan_id:016x}: {} of {} layers laid; the {}board is {}, started by {}",
        status.layers_laid,
        status.layer_count,
        port.kind(),
        status.state.name(),
        board.reset_cause.name()
    );
    match status.interrupted {
        Some(layer) => {
            let layer = InterruptedLayerJson::new(status.layers_laid as usize, layer);
            growbot_host::note!("layer {} was interrupted: {}", layer.layer, made(&layer));
        }
        None => growbot_host::note!("no layer was interrupted"),
    }
    if let Some(fault) = status.fault {
        return Err(Failure::request_failed(format!(
            "the board has the fault {}: {}; fix the cause and clear the fault first (`clear` in `growbot console`)",
            fault.code(),
            remedies::fault_explanation(fault)
        )));
    }
    Ok(())
}

/// Waits for a confirmation at the terminal, because the next steps heat and move. Returns an error without a terminal.
fn ask(board: &BoardInfo) -> Result<(), Failure> {
    if matches!(board.status.state, State::Heating | State::Homing | State::Growing | State::Paused) {
        // The robot works already, so the command only follows it.
        return Ok(());
    }
    if !io::stdin().is_terminal() {
        return Err(Failure::bad_input(
            "cannot ask for confirmation, because standard input is not a terminal: pass --yes to heat and resume",
        ));
    }
    eprint!("Heat the nozzle, find the index mark of the head and resume the growth? [y/N] ");
    let _ = io::stderr().flush();
    let answer = read_answer().map_err(Failure::bad_input)?;
    match answer.unwrap_or_default().trim() {
        "y" | "Y" | "yes" => Ok(()),
        _ => Err(Failure::request_failed("not resumed: nothing was heated or moved")),
    }
}
