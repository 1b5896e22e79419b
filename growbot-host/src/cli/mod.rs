//! The command line: one file per command, each with its arguments and a `run` function.
//!
//! Results go to standard output, everything else to standard error. Exit code 0 means success. Exit code 1 means that
//! a valid request failed. Exit code 2 means that something was wrong before the job started.

mod board_report;
mod body_input;
mod cancel;
mod clear;
mod completions;
mod configure;
mod console;
mod disturbance;
mod doctor;
mod estop;
mod export;
mod failure;
mod find_robot;
mod flash;
mod global;
mod grow;
mod growth_monitor;
mod growth_progress;
mod help;
mod json_arg;
mod known_robots;
mod layers;
mod local_robot;
mod maintain;
mod man;
mod new_robot;
mod output_dir;
mod output_format;
mod plan;
mod plan_source;
mod port_arg;
mod ports;
mod power;
mod recover;
mod remedies;
mod replay;
mod reproduce;
mod resume;
mod rmin;
mod robot_arg;
mod robot_handle;
mod robots;
mod scene;
mod scene_options;
mod schema;
mod search;
mod serve;
mod service_commands;
mod service_lookup;
mod service_robot;
mod settings;
mod simulate;
mod status;
mod status_text;
mod stop;
mod stop_on_interrupt;
mod terminal_commands;
#[cfg(test)]
mod tests;
mod tune;
mod typed_answer;
mod uf2_drive;
mod units;
mod usage;
mod view;
mod watch_options;
mod workspace;
mod workspace_in_scene;

use std::process::ExitCode;

use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
use growbot_host::display;
use growbot_host::interrupt::exit_on_interrupt;
use growbot_host::messages::is_quiet;
use growbot_host::output::OutputError;

use self::failure::Failure;

/// Plan, slice and grow: the control stack of robots that grow by printing their
/// own body.
#[derive(Parser)]
#[command(name = "growbot", version, max_term_width = 80, after_help = AFTER_HELP)]
struct Cli {
    #[command(flatten)]
    global: global::GlobalArgs,
    #[command(subcommand)]
    command: Option<CliCommand>,
}

const AFTER_HELP: &str = "\
Lengths are in mm, angles in degrees. A number may have a unit: 60cm, 1.5rad.
A pose is X,Y,Z,HEADING,PITCH: pitch 90 is straight up, heading 0 is along x.
Results go to standard output, messages to standard error.

Examples:
  growbot                                   a simulated robot grows 1 m
  growbot plan --to 200,100,600,0,45 -o plan.json
  growbot grow plan.json --port /dev/ttyACM0

Commands without --robot or --port use GROWBOT_ROBOT and GROWBOT_PORT, or else
growbot.toml: growbot settings shows them.

Exit codes: 0, success; 1, the request failed; 2, invalid arguments or input.";

#[derive(Subcommand)]
enum CliCommand {
    Ports(ports::PortsArgs),
    Robots(robots::RobotsArgs),
    Schema(schema::SchemaArgs),
    NewRobot(new_robot::NewRobotArgs),
    Rmin(rmin::RminArgs),
    Plan(Box<plan::PlanArgs>),
    Scene(scene::SceneInfoArgs),
    Layers(layers::LayersArgs),
    View(view::ViewArgs),
    Workspace(workspace::WorkspaceArgs),
    Simulate(Box<simulate::SimulateArgs>),
    Reproduce(reproduce::ReproduceArgs),
    Grow(Box<grow::GrowArgs>),
    Resume(resume::ResumeArgs),
    Replay(replay::ReplayArgs),
    Export(export::ExportArgs),
    Status(status::StatusArgs),
    Stop(stop::StopArgs),
    Cancel(cancel::CancelArgs),
    Estop(estop::EstopArgs),
    Clear(clear::ClearArgs),
    Recover(recover::RecoverArgs),
    Doctor(doctor::DoctorArgs),
    Tune(tune::TuneArgs),
    Maintain(maintain::MaintainArgs),
    Console(console::ConsoleArgs),
    Power(power::PowerArgs),
    Serve(serve::ServeArgs),
    Attach(service_commands::AttachArgs),
    Pause(service_commands::PauseArgs),
    Continue(service_commands::ContinueArgs),
    Flash(flash::FlashArgs),
    Configure(configure::ConfigureArgs),
    Settings(settings::ConfigArgs),
    Completions(completions::CompletionsArgs),
    Man(man::ManArgs),
}

impl CliCommand {
    /// Returns true if the command computes for a while before it prints something.
    fn computes(&self) -> bool {
        matches!(
            self,
            Self::Plan(_)
                | Self::Scene(_)
                | Self::Layers(_)
                | Self::View(_)
                | Self::Workspace(_)
                | Self::Simulate(_)
                | Self::Reproduce(_)
                | Self::Grow(_)
                | Self::Resume(_)
                | Self::Replay(_)
                | Self::Export(_)
        )
    }
}

/// Reads the command line and runs the command.
pub fn run() -> ExitCode {
    let cli = match parse() {
        Ok(cli) => cli,
        Err(help) if !help.use_stderr() => {
            return show(&help);
        }
        Err(error) => return estop::usage_error(&error, &Cli::command()),
    };
    if let Err(error) = growbot_serve::settings::check_environment() {
        // A variable that growbot does not read must not prevent a robot from stopping.
        if !matches!(cli.command, Some(CliCommand::Estop(_) | CliCommand::Stop(_))) {
            return Failure::from(error).report();
        }
        growbot_host::warning!("{error}");
    }
    if cli.command.as_ref().is_none_or(CliCommand::computes) {
        exit_on_interrupt();
        if !is_quiet() {
            display::start_spinner();
        }
    }
    let done = match cli.command {
        Some(CliCommand::Ports(args)) => ports::run(&args),
        Some(CliCommand::Robots(args)) => robots::run(&args),
        Some(CliCommand::Schema(args)) => schema::run(&args),
        Some(CliCommand::NewRobot(args)) => new_robot::run(&args),
        Some(CliCommand::Rmin(args)) => rmin::run(&args),
        Some(CliCommand::Plan(args)) => plan::run(&args),
        Some(CliCommand::Scene(args)) => scene::run(&args),
        Some(CliCommand::Layers(args)) => layers::run(&args),
        Some(CliCommand::View(args)) => view::run(&args),
        Some(CliCommand::Workspace(args)) => workspace::run(&args),
        Some(CliCommand::Simulate(args)) => simulate::run(&args),
        Some(CliCommand::Reproduce(args)) => reproduce::run(&args),
        Some(CliCommand::Grow(args)) => grow::run(&args),
        Some(CliCommand::Resume(args)) => resume::run(&args),
        Some(CliCommand::Replay(args)) => replay::run(&args),
        Some(CliCommand::Export(args)) => export::run(&args),
        Some(CliCommand::Status(args)) => status::run(&args),
        Some(CliCommand::Stop(args)) => stop::run(&args),
        Some(CliCommand::Cancel(args)) => cancel::run(&args),
        Some(CliCommand::Estop(args)) => estop::run(&args),
        Some(CliCommand::Clear(args)) => clear::run(&args),
        Some(CliCommand::Recover(args)) => recover::run(&args),
        Some(CliCommand::Doctor(args)) => doctor::run(&args),
        Some(CliCommand::Tune(args)) => tune::run(&args),
        Some(CliCommand::Maintain(args)) => maintain::run(&args),
        Some(CliCommand::Console(args)) => console::run(&args),
        Some(CliCommand::Power(args)) => power::run(&args),
        Some(CliCommand::Serve(args)) => serve::run(&args),
        Some(CliCommand::Attach(args)) => service_commands::run_attach(&args),
        Some(CliCommand::Pause(args)) => service_commands::run_pause(&args),
        Some(CliCommand::Continue(args)) => service_commands::run_continue(&args),
        Some(CliCommand::Flash(args)) => flash::run(&args),
        Some(CliCommand::Configure(args)) => configure::run(&args),
        Some(CliCommand::Settings(args)) => settings::run(&args),
        Some(CliCommand::Completions(args)) => completions::run(&args, Cli::command()),
        Some(CliCommand::Man(args)) => man::run(&args, Cli::command()),
        None => grow::run_main_job(),
    };
    display::clear();
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(),
    }
}

/// Parses the command line, and sets level and colours of messages. The colours also apply if the rest of the command
/// line cannot be parsed.
fn parse() -> Result<Cli, clap::Error> {
    let color = global::color_before_parsing();
    let cli = Cli::from_arg_matches(&help::with_groups(Cli::command()).color(color).try_get_matches()?)?;
    cli.global.apply();
    Ok(cli)
}

/// Prints help or version.
fn show(help: &clap::Error) -> ExitCode {
    match help.print().map_err(OutputError::from) {
        Ok(()) | Err(OutputError::Closed) => ExitCode::SUCCESS,
        Err(error) => Failure::from(error).report(),
    }
}
