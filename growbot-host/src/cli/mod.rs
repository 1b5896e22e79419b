//! The command line: one file a command, each with its arguments and a `run`.
//!
//! Results go to standard output, everything else to standard error. Exit codes: 0, done; 1, a valid request was
//! answered no; 2, something was wrong before the job.

mod cancel;
mod completions;
mod config;
mod configure;
mod console;
mod directory;
mod disturbance;
mod doctor;
#[cfg(test)]
mod documents;
mod drive;
mod estop;
mod export;
mod flash;
mod following;
mod global;
mod goal;
mod grow;
mod growth_table;
mod interrupt;
mod keyboard;
mod layers;
mod maintain;
mod man;
mod new_robot;
mod plan;
mod plan_table;
mod power;
mod replay;
mod reproduce;
mod resume;
mod rmin;
mod robots;
mod scene;
mod scene_example;
mod schema;
mod search;
mod serve;
mod service;
mod simulate;
mod status;
mod stop;
mod subject;
mod tune;
mod units;
mod usage;
mod view;
mod watching;
mod workspace;
mod workspace_in_scene;

use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use growbot_client::client::{Client, ClientError};
use growbot_client::files::FileError;
use growbot_client::input::{InputError, name_of};
use growbot_client::maintenance::Presets;
use growbot_client::plan_file::PlanFileError;
use growbot_client::port::PortError;
use growbot_client::port::faulty::FaultSpec;
use growbot_client::robot_file::{self, RobotFileError};
use growbot_client::run_log::RunRecord;
use growbot_core::robot::Robot;
use growbot_host::batch::BatchError;
use growbot_host::messages::{self, Kind};
use growbot_host::output::OutputError;
use growbot_host::settings::{FILE, Key, Origin, Setting, SettingsError};
use growbot_host::switch::SwitchError;
use growbot_sim::port::{self, OpenError, Opened, PortName, TipSettings};
use growbot_sim::resident::{Place, ResidentError};
use growbot_sim::truth::Simulation;

/// Plan, slice and grow: the control stack of robots that grow by printing their
/// own body.
#[derive(Parser)]
#[command(name = "growbot", version, max_term_width = 80, after_help = AFTER_HELP)]
struct Cli {
    #[command(flatten)]
    global: global::GlobalArgs,
    #[command(subcommand)]
    command: Option<Command>,
}

const AFTER_HELP: &str = "\
Lengths are in mm, angles in degrees, unless they say m, mm, deg or rad (0.6m).
A pose is X,Y,Z,HEADING,PITCH: pitch 90 is straight up, heading 0 is along x.
Results go to standard output, messages to standard error.

Examples:
  growbot                                   a simulated robot grows 1 m
  growbot plan --to 200,100,600,0,45 -o plan.json
  growbot grow plan.json --port /dev/ttyACM0

Commands that are given no --robot or --port take what GROWBOT_ROBOT and
GROWBOT_PORT say, or else growbot.toml: growbot config shows them.

Exit codes: 0, done; 1, the request failed; 2, something was wrong before.";

#[derive(Subcommand)]
enum Command {
    Robots(robots::RobotsArgs),
    Schema(schema::SchemaArgs),
    NewRobot(new_robot::NewRobotArgs),
    Rmin(rmin::RminArgs),
    Plan(Box<plan::PlanArgs>),
    Scene(scene_example::SceneArgs),
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
    Doctor(doctor::DoctorArgs),
    Tune(tune::TuneArgs),
    Maintain(maintain::MaintainArgs),
    Console(console::ConsoleArgs),
    Power(power::PowerArgs),
    Serve(serve::ServeArgs),
    Attach(service::AttachArgs),
    Pause(service::PauseArgs),
    Continue(service::ContinueArgs),
    Flash(flash::FlashArgs),
    Configure(configure::ConfigureArgs),
    Config(config::ConfigArgs),
    Completions(completions::CompletionsArgs),
    Man(man::ManArgs),
}

/// Reads the command line and runs the command.
pub fn run() -> ExitCode {
    let cli = match global::parse() {
        Ok(cli) => cli,
        Err(help) if !help.use_stderr() => {
            show(&help);
            return ExitCode::SUCCESS;
        }
        Err(error) => return estop::usage_error(&error),
    };
    let done = match cli.command {
        Some(Command::Robots(args)) => robots::run(&args),
        Some(Command::Schema(args)) => schema::run(&args),
        Some(Command::NewRobot(args)) => new_robot::run(&args),
        Some(Command::Rmin(args)) => rmin::run(&args),
        Some(Command::Plan(args)) => plan::run(&args),
        Some(Command::Scene(args)) => scene_example::run(&args),
        Some(Command::Layers(args)) => layers::run(&args),
        Some(Command::View(args)) => view::run(&args),
        Some(Command::Workspace(args)) => workspace::run(&args),
        Some(Command::Simulate(args)) => simulate::run(&args),
        Some(Command::Reproduce(args)) => reproduce::run(&args),
        Some(Command::Grow(args)) => grow::run(&args),
        Some(Command::Resume(args)) => resume::run(&args),
        Some(Command::Replay(args)) => replay::run(&args),
        Some(Command::Export(args)) => export::run(&args),
        Some(Command::Status(args)) => status::run(&args),
        Some(Command::Stop(args)) => stop::run(&args),
        Some(Command::Cancel(args)) => cancel::run(&args),
        Some(Command::Estop(args)) => estop::run(&args),
        Some(Command::Doctor(args)) => doctor::run(&args),
        Some(Command::Tune(args)) => tune::run(&args),
        Some(Command::Maintain(args)) => maintain::run(&args),
        Some(Command::Console(args)) => console::run(&args),
        Some(Command::Power(args)) => power::run(&args),
        Some(Command::Serve(args)) => serve::run(&args),
        Some(Command::Attach(args)) => service::run_attach(&args),
        Some(Command::Pause(args)) => service::run_pause(&args),
        Some(Command::Continue(args)) => service::run_continue(&args),
        Some(Command::Flash(args)) => flash::run(&args),
        Some(Command::Configure(args)) => configure::run(&args),
        Some(Command::Config(args)) => config::run(&args),
        Some(Command::Completions(args)) => completions::run(&args),
        Some(Command::Man(args)) => man::run(&args),
        None => grow::run_main_job(),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(),
    }
}

/// Shows help or version.
fn show(help: &clap::Error) {
    // Where it cannot be printed, nothing can.
    let _ = help.print();
}

/// Why a command did not do what it was asked: the exit code, and what to say.
pub struct Failure {
    code: u8,
    kind: Kind,
    message: Option<String>,
}

impl Failure {
    /// Something was wrong before the job started.
    pub fn bad_input(message: impl Display) -> Self {
        Self { code: 2, kind: Kind::Error, message: Some(message.to_string()) }
    }

    /// A valid request was answered no.
    pub fn answered_no(message: impl Display) -> Self {
        Self { code: 1, kind: Kind::Error, message: Some(message.to_string()) }
    }

    /// The reader of the results has closed them: nothing failed.
    fn reader_gone() -> Self {
        Self { code: 0, kind: Kind::Error, message: None }
    }

    /// The same as a warning: the error is said already.
    pub fn into_warning(self) -> Self {
        Self { kind: Kind::Warning, ..self }
    }

    /// Whether the reader of the results has gone.
    pub fn is_reader_gone(&self) -> bool {
        self.code == 0
    }

    /// Whether something was wrong before the job started.
    pub fn is_bad_input(&self) -> bool {
        self.code == 2
    }

    /// What to say; nothing where nothing failed.
    pub fn message(&self) -> &str {
        self.message.as_deref().unwrap_or_default()
    }

    /// Says it, and gives the exit code.
    fn report(self) -> ExitCode {
        self.say();
        ExitCode::from(self.code)
    }

    /// Says it.
    pub fn say(&self) {
        if let Some(message) = &self.message {
            messages::say(self.kind, format_args!("{message}"));
        }
    }
}

impl From<OutputError> for Failure {
    fn from(error: OutputError) -> Self {
        match error {
            OutputError::Closed => Self::reader_gone(),
            error => Self::bad_input(error),
        }
    }
}

/// Errors that all mean: something was wrong before the job started.
macro_rules! bad_input {
    ($($error:ty),*) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::bad_input(error)
            }
        })*
    };
}

bad_input!(
    BatchError,
    FileError,
    InputError,
    OpenError,
    PlanFileError,
    PortError,
    ResidentError,
    RobotFileError,
    SettingsError,
    SwitchError
);

impl From<ClientError> for Failure {
    fn from(error: ClientError) -> Self {
        match error {
            ClientError::Refused { .. } | ClientError::NotStopped { .. } => Self::answered_no(error),
            error => Self::bad_input(error),
        }
    }
}

/// `--port`, where a robot is talked to: without it the configured one, or else a simulated robot.
#[derive(Args)]
pub struct PortArg {
    /// Where the robot is: sim, sim:NAME (growbot power), emulator,
    /// emulator:ELF, rp2040, rp2040:ELF (rp2040,usb and rp2040:ELF,usb for its other line), tcp:HOST:PORT or a serial device [default: what GROWBOT_PORT or growbot.toml says, or else sim]
    #[arg(long, value_name = "PORT")]
    port: Option<String>,
    #[command(flatten)]
    line: LineArg,
}

/// `--port` of commands that are about a robot that is there already, and would be meaningless for one that is
/// simulated from now on: they are told a port, or have one configured.
#[derive(Args)]
pub struct RobotPortArg {
    /// Where the robot is: sim:NAME, tcp:HOST:PORT or a serial device; sim and
    /// emulator start a simulated one [default: what GROWBOT_PORT or growbot.toml
    /// says; one of them must be given]
    #[arg(long, value_name = "PORT")]
    port: Option<String>,
    #[command(flatten)]
    line: LineArg,
}

/// How good the line is, and what becomes of another host.
#[derive(Args, Clone, Copy)]
struct LineArg {
    /// Try a bad line: lose and spoil what it carries, say drop=1%,flip=1e-4
    ///
    /// Chances are for each frame, both ways: drop, dup, reorder, truncate,
    /// stall=2s@0.1% (nothing passes for so long), reset (cut for a second); flip
    /// is for each byte. The same seed=N gives the same faults.
    #[arg(long, value_name = "SPEC")]
    fault: Option<FaultSpec>,
    /// Take the board over from another host that owns it
    #[arg(long)]
    take_over: bool,
}

/// A port, chosen and understood.
#[derive(Clone)]
pub struct ChosenPort {
    text: String,
    name: PortName,
    take_over: bool,
}

impl PortArg {
    /// The port.
    fn choose(&self) -> Result<ChosenPort, Failure> {
        let text = match &self.port {
            Some(text) => text.clone(),
            None => config::told(Key::Port, Setting::of(Key::Port)?),
        };
        self.line.at(text)
    }
}

impl RobotPortArg {
    /// The port.
    fn choose(&self) -> Result<ChosenPort, Failure> {
        let text = match &self.port {
            Some(text) => text.clone(),
            None => match Setting::of(Key::Port)? {
                Setting { origin: Origin::BuiltIn, .. } => {
                    return Err(Failure::bad_input(format!(
                        "no port is given, so it is not known which robot is meant: say --port PORT, or set one \
                         (export {}=PORT, or port in {FILE})",
                        Key::Port.variable()
                    )));
                }
                setting => config::told(Key::Port, setting),
            },
        };
        self.line.at(text)
    }
}

impl LineArg {
    fn at(self, text: String) -> Result<ChosenPort, Failure> {
        let name = text.parse()?;
        let name = match self.fault {
            None => name,
            Some(spec) => PortName::Faulty(Box::new(name), spec),
        };
        Ok(ChosenPort { text, name, take_over: self.take_over })
    }
}

impl ChosenPort {
    /// The port's name, understood.
    fn name(&self) -> &PortName {
        &self.name
    }

    /// Whether the robot there is a simulated one.
    fn is_simulated(&self) -> bool {
        self.name.is_simulated()
    }

    /// How fast the robot's clock runs, in multiples of real time; `asked` is what a simulated one was asked for.
    fn pace(&self, asked: Option<f64>) -> Option<f64> {
        match self.name.resident() {
            Some(name) => Place::of(name).ok()?.pace(),
            None if self.name.is_virtual() => asked,
            None => Some(1.0),
        }
    }

    /// Whether the robot there ends with this program.
    fn ends_with_program(&self) -> bool {
        self.is_simulated() && self.name.resident().is_none()
    }

    /// What messages say before "robot" or "board": that it is a simulated one.
    fn kind(&self) -> &'static str {
        kind(self.is_simulated())
    }

    /// What is said behind a name that belongs to a simulated robot.
    fn remark(&self) -> &'static str {
        if self.is_simulated() { ", simulated" } else { "" }
    }

    /// A client at the port of this robot.
    fn client(&self, robot: &Robot) -> Result<Client, Failure> {
        Ok(self.connect(robot, &TipSettings::default())?.client)
    }

    /// Opens the port of this robot, whose tip, where that is a simulated one, is like this.
    fn connect(&self, robot: &Robot, settings: &TipSettings) -> Result<Connection, Failure> {
        let Opened { port, simulation } = port::open(&self.name, robot, settings)?;
        let name = if self.is_simulated() { format!("{} (simulated)", self.text()) } else { self.text().to_owned() };
        Ok(Connection { client: Client::new(port, &name).taking_over(self.take_over), simulation })
    }

    /// The port's name as it was given.
    fn text(&self) -> &str {
        &self.text
    }
}

/// A robot at the end of an open port.
pub struct Connection {
    /// Talks to its board.
    client: Client,
    /// What its tip has really laid, where that is a simulated one.
    simulation: Option<Box<dyn Simulation>>,
}

/// What messages say before "robot" or "board" of a simulated one.
fn kind(is_simulated: bool) -> &'static str {
    if is_simulated { "simulated " } else { "" }
}

/// The robot of a run: the one that is named here or, if none is, the one that its log describes or names. A log leads
/// to no other file.
fn robot_of(record: &RunRecord, robot: Option<&Path>) -> Result<Robot, Failure> {
    match robot {
        Some(robot) => Ok(robot_file::load(robot)?),
        None => Ok(record.own_robot()?),
    }
}

/// Says what of a run log could not be read.
fn say_damage(record: &RunRecord, file: &Path) {
    if let Some(words) = record.damage.in_words(&name_of(file)) {
        growbot_host::warning!("{words}");
    }
}

/// What an argument that names a robot is called in the help: [`completions`] knows them by it.
const ROBOT: &str = "FILE|NAME";

/// `--robot`, where a robot must be known.
#[derive(Args)]
pub struct RobotArg {
    /// The robot: a built-in name (growbot-a, -a1 to -a8, -b, -c) or a TOML file
    /// [default: what GROWBOT_ROBOT or growbot.toml says, or else growbot-a]
    #[arg(long, value_name = ROBOT)]
    robot: Option<PathBuf>,
}

impl RobotArg {
    /// Reads and checks the description.
    fn load(&self) -> Result<Robot, Failure> {
        Ok(robot_file::load(&self.name()?)?)
    }

    /// The name or the file.
    fn name(&self) -> Result<PathBuf, Failure> {
        match &self.robot {
            Some(robot) => Ok(robot.clone()),
            None => Ok(config::told(Key::Robot, Setting::of(Key::Robot)?).into()),
        }
    }

    /// Reads the presets of materials.
    fn presets(&self) -> Result<Presets, Failure> {
        Ok(Presets::load(&self.name()?)?)
    }
}
