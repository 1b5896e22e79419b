//! The command line: one file per command, each with its arguments and a `run` function.
//!
//! Results go to standard output, everything else to standard error. Exit code 0 means success. Exit code 1 means that
//! a valid request failed. Exit code 2 means that something was wrong before the job started.

mod cancel;
mod completions;
mod configure;
mod console;
mod disturbance;
mod doctor;
#[cfg(test)]
mod documents;
mod estop;
mod export;
mod flash;
mod global;
mod grow;
mod growth_monitor;
mod growth_table;
mod interrupt;
mod layers;
mod maintain;
mod man;
mod new_robot;
mod opened;
mod output_dir;
mod output_format;
mod plan;
mod plan_source;
mod plan_table;
mod power;
mod remedies;
mod replay;
mod reproduce;
mod resume;
mod rmin;
mod robots;
mod scene;
mod scene_options;
mod schema;
mod search;
mod serve;
mod service_robot;
mod settings;
mod simulate;
mod status;
mod stop;
mod terminal_commands;
mod tune;
mod typed_answer;
mod uf2_drive;
mod units;
mod usage;
mod view;
mod watch_options;
mod workspace;
mod workspace_in_scene;

use std::error::Error;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::{Args, Parser, Subcommand};
use growbot_client::client::{Client, ClientError, has_commanded_board};
use growbot_client::maintenance::MaterialPresets;
use growbot_client::port::PortError;
use growbot_client::port::faulty::FaultSpec;
use growbot_core::robot::Robot;
use growbot_host::crash::ImageError;
use growbot_host::messages::{self, Severity};
use growbot_host::output::OutputError;
use growbot_host::settings::{FILE_NAME, InvalidFiles, Key, Setting, SettingOrigin, SettingsError};
use growbot_pictures::drawing::png::PngError;
use growbot_pictures::export::mesh::MeshError;
use growbot_pictures::view::ViewError;
use growbot_plan::atomic_file::FileError;
use growbot_plan::batch::BatchError;
use growbot_plan::input::{InputError, display_name};
use growbot_plan::plan_file::PlanFileError;
use growbot_plan::robot_file::{self, RobotFileError};
use growbot_plan::run_log::{ReadRunLogError, RecordedRun, RunLogError};
use growbot_plan::scene_planning::SceneCheckError;
use growbot_scene::scene_file::SceneError;
use growbot_serve::watch::WatchError;
use growbot_sim::port::{self, OpenError, OpenPort, PortName, TipSettings};
use growbot_sim::sim_daemon::process::SimProcessError;
use growbot_sim::sim_daemon::{SimDaemonError, StateDir};
use growbot_sim::simulated_tip::SimulatedTip;

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
Lengths are in mm, angles in degrees. A number may have a unit: 0.6m, 1.57rad.
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
    Doctor(doctor::DoctorArgs),
    Tune(tune::TuneArgs),
    Maintain(maintain::MaintainArgs),
    Console(console::ConsoleArgs),
    Power(power::PowerArgs),
    Serve(serve::ServeArgs),
    Attach(service_robot::AttachArgs),
    Pause(service_robot::PauseArgs),
    Continue(service_robot::ContinueArgs),
    Flash(flash::FlashArgs),
    Configure(configure::ConfigureArgs),
    Settings(settings::ConfigArgs),
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
    if let Err(error) = growbot_host::settings::check_environment() {
        // A variable that growbot does not read must not prevent a robot from stopping.
        if !matches!(cli.command, Some(CliCommand::Estop(_) | CliCommand::Stop(_))) {
            return Failure::from(error).report();
        }
        growbot_host::warning!("{error}");
    }
    let done = match cli.command {
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
        Some(CliCommand::Doctor(args)) => doctor::run(&args),
        Some(CliCommand::Tune(args)) => tune::run(&args),
        Some(CliCommand::Maintain(args)) => maintain::run(&args),
        Some(CliCommand::Console(args)) => console::run(&args),
        Some(CliCommand::Power(args)) => power::run(&args),
        Some(CliCommand::Serve(args)) => serve::run(&args),
        Some(CliCommand::Attach(args)) => service_robot::run_attach(&args),
        Some(CliCommand::Pause(args)) => service_robot::run_pause(&args),
        Some(CliCommand::Continue(args)) => service_robot::run_continue(&args),
        Some(CliCommand::Flash(args)) => flash::run(&args),
        Some(CliCommand::Configure(args)) => configure::run(&args),
        Some(CliCommand::Settings(args)) => settings::run(&args),
        Some(CliCommand::Completions(args)) => completions::run(&args),
        Some(CliCommand::Man(args)) => man::run(&args),
        None => grow::run_main_job(),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(failure) => failure.report(),
    }
}

/// Prints help or version.
fn show(help: &clap::Error) {
    // If the help cannot be printed, nothing can.
    let _ = help.print();
}

/// Failure of a command: its exit code and its message.
pub struct Failure {
    code: u8,
    kind: Severity,
    message: Option<String>,
}

impl Failure {
    /// Returns the failure for something that was wrong before the job started.
    pub fn bad_input(message: impl Display) -> Self {
        Self { code: 2, kind: Severity::Error, message: Some(message.to_string()) }
    }

    /// Returns the failure of a valid request.
    pub fn request_failed(message: impl Display) -> Self {
        Self { code: 1, kind: Severity::Error, message: Some(message.to_string()) }
    }

    /// Returns the failure for an error that occurred before the job started.
    pub fn before_start(error: &(dyn Error + 'static)) -> Self {
        Self::bad_input(remedies::message(error))
    }

    /// Returns the failure for an error of a valid request.
    pub fn during_request(error: &(dyn Error + 'static)) -> Self {
        Self::request_failed(remedies::message(error))
    }

    /// Returns the result of a command whose standard output was closed by its reader, for example `head`. Its exit
    /// code is 0.
    fn stdout_closed() -> Self {
        Self { code: 0, kind: Severity::Error, message: None }
    }

    /// Returns the failure as a warning, because its error was printed before.
    pub fn into_warning(self) -> Self {
        Self { kind: Severity::Warning, ..self }
    }

    /// Returns true if the command ended because the reader of its standard output closed it.
    pub fn is_stdout_closed(&self) -> bool {
        self.code == 0
    }

    /// Returns true if something was wrong before the job started.
    pub fn is_bad_input(&self) -> bool {
        self.code == 2
    }

    /// Returns the message. It is empty if nothing failed.
    pub fn message(&self) -> &str {
        self.message.as_deref().unwrap_or_default()
    }

    /// Prints the message, and returns the exit code.
    fn report(mut self) -> ExitCode {
        // Exit status 2 means that no board was given anything to do.
        if self.code == 2 && has_commanded_board() {
            self.code = 1;
        }
        self.print();
        ExitCode::from(self.code)
    }

    /// Prints the message, if any.
    pub fn print(&self) {
        if let Some(message) = &self.message {
            messages::print(self.kind, format_args!("{message}"));
        }
    }
}

impl From<OutputError> for Failure {
    fn from(error: OutputError) -> Self {
        match error {
            OutputError::Closed => Self::stdout_closed(),
            error => Self::before_start(&error),
        }
    }
}

/// Implements `From` for errors that occur before the job starts.
macro_rules! bad_input {
    ($($error:ty),*) => {
        $(impl From<$error> for Failure {
            fn from(error: $error) -> Self {
                Self::before_start(&error)
            }
        })*
    };
}

bad_input!(
    BatchError,
    FileError,
    ImageError,
    InputError,
    MeshError,
    OpenError,
    PlanFileError,
    PngError,
    PortError,
    ReadRunLogError,
    RunLogError,
    SceneCheckError,
    SceneError,
    SimDaemonError,
    RobotFileError,
    SettingsError,
    SimProcessError,
    ViewError,
    WatchError
);

impl From<ClientError> for Failure {
    fn from(error: ClientError) -> Self {
        match error {
            ClientError::Refused { .. } | ClientError::StopNotAcknowledged { .. } => Self::during_request(&error),
            error => Self::before_start(&error),
        }
    }
}

/// `--port` of commands that communicate with a robot. The default is the configured port, or else a simulated robot.
#[derive(Args)]
pub struct PortArg {
    /// Port of the robot: a serial device, tcp:HOST:PORT, sim, sim:NAME (a simulated robot that stays on, see growbot
    /// power), emulator, emulator:ELF, rp2040 or rp2040:ELF (rp2040,usb and rp2040:ELF,usb for its USB link) [default:
    /// GROWBOT_PORT, then growbot.toml, then sim]
    #[arg(long, value_name = "PORT")]
    port: Option<String>,
    #[command(flatten)]
    link: LinkArgs,
}

/// `--port` of commands for a robot that exists already. They would be meaningless for a robot that is simulated from
/// now on, so a port must be given or configured.
#[derive(Args)]
pub struct RequiredPortArg {
    /// Port of the robot: a serial device, tcp:HOST:PORT or sim:NAME, or the name of a robot in growbot.toml or of the
    /// service [default: GROWBOT_PORT, then growbot.toml, and one of them must be set]
    #[arg(long, value_name = "PORT")]
    port: Option<String>,
    #[command(flatten)]
    link: LinkArgs,
}

/// Faults of the link, and conflicts with another host.
#[derive(Args, Clone, Copy)]
struct LinkArgs {
    /// Inject link faults, for example drop=1%,flip=1e-4
    ///
    /// Probabilities are per frame, in both directions: drop, dup, reorder, truncate, stall, reset (cut for a second).
    /// stall=2s@0.1% means that at 0.1 % of the frames nothing passes for 2 s. The probability of flip is per byte. The
    /// same seed=N gives the same faults.
    #[arg(long, value_name = "SPEC")]
    link_fault: Option<FaultSpec>,
    /// Take the board over from another host that owns it
    #[arg(long)]
    take_over: bool,
}

/// A selected port, with its parsed name.
#[derive(Clone)]
pub struct SelectedPort {
    text: String,
    name: PortName,
    take_over: bool,
}

impl PortArg {
    /// Returns the given port, or the configured one, or else `sim`.
    fn resolve(&self) -> Result<SelectedPort, Failure> {
        let text = match &self.port {
            Some(text) => text.clone(),
            None => settings::log_setting(Key::Port, Setting::load(Key::Port)?),
        };
        self.link.at(text)
    }
}

impl RequiredPortArg {
    /// Returns true if a port is given on the command line.
    fn is_given(&self) -> bool {
        self.port.is_some()
    }

    /// Returns the port that `text` names directly, or the port of the robot that it names, with the options of this
    /// command for the link.
    fn at(&self, text: String) -> Result<SelectedPort, Failure> {
        self.link.at(text)
    }

    /// Returns the given port, or the configured one. Returns an error if neither is set.
    fn resolve(&self) -> Result<SelectedPort, Failure> {
        self.resolve_from_files(InvalidFiles::Refuse)
    }

    /// Like [`RequiredPortArg::resolve`], but invalid settings files are treated as `invalid` requires.
    fn resolve_from_files(&self, mut invalid: InvalidFiles) -> Result<SelectedPort, Failure> {
        let text = match &self.port {
            Some(text) => text.clone(),
            None => match Setting::load_from_files(Key::Port, invalid.reborrow())? {
                Setting { origin: SettingOrigin::BuiltIn, .. } => {
                    return Err(Failure::bad_input(format!(
                        "no port given: pass --port PORT, set {}, or set `port` in {FILE_NAME}",
                        Key::Port.variable()
                    )));
                }
                setting => settings::log_setting(Key::Port, setting),
            },
        };
        self.link.at_from_files(text, invalid)
    }
}

impl LinkArgs {
    /// Returns the port with this name: a port, or a robot of the settings or of the user's service.
    fn at(self, text: String) -> Result<SelectedPort, Failure> {
        self.at_from_files(text, InvalidFiles::Refuse)
    }

    /// Like [`LinkArgs::at`], but invalid settings files are treated as `invalid` requires.
    fn at_from_files(self, text: String, invalid: InvalidFiles) -> Result<SelectedPort, Failure> {
        let (text, name) = match text.parse::<PortName>() {
            Ok(name) => (text, name),
            Err(unknown) => {
                let port = service_robot::port_of_robot(&text, invalid)?.ok_or(unknown)?;
                let name = port.parse()?;
                (port, name)
            }
        };
        let name = match self.link_fault {
            None => name,
            Some(spec) => PortName::Faulty(Box::new(name), spec),
        };
        Ok(SelectedPort { text, name, take_over: self.take_over })
    }
}

impl SelectedPort {
    /// Returns the parsed name of the port.
    fn name(&self) -> &PortName {
        &self.name
    }

    /// Returns true if the robot is simulated.
    fn is_simulated(&self) -> bool {
        self.name.is_simulated()
    }

    /// Returns the speed of the robot's clock, in multiples of real time. `requested` is the requested speed of a
    /// simulated robot. `None` if it is not known.
    fn pace(&self, requested: Option<f64>) -> Option<f64> {
        match self.name.resident() {
            Some(name) => StateDir::of(name).ok()?.pace(),
            None if self.name.is_virtual() => requested,
            None => Some(1.0),
        }
    }

    /// Returns true if the robot ends with this program.
    fn is_in_process(&self) -> bool {
        self.is_simulated() && self.name.resident().is_none()
    }

    /// Returns an error if the port would start a new simulated robot in this program, because that has nothing to
    /// stop or discard.
    fn require_running_robot(&self, command: &str) -> Result<(), Failure> {
        if !self.is_in_process() {
            return Ok(());
        }
        Err(Failure::request_failed(format!(
            "{command} was not sent: no robot runs at {} that this command can reach. A simulated robot at this port \
             belongs to the program that runs the robot: stop that program (Ctrl-C in its terminal), or use a port \
             sim:NAME, which all commands can reach",
            self.text
        )))
    }

    /// Returns the word that precedes "robot" or "board" in messages if the robot is simulated.
    fn kind(&self) -> &'static str {
        simulated_prefix(self.is_simulated())
    }

    /// Returns the remark after the name of a simulated robot. It is empty for a real robot.
    fn simulated_suffix(&self) -> &'static str {
        if self.is_simulated() { ", simulated" } else { "" }
    }

    /// Opens the port and returns a client of the board. `robot` is the robot that `sim` and the emulators simulate.
    fn client(&self, robot: &Robot) -> Result<Client, Failure> {
        Ok(self.connect(robot, &TipSettings::default())?.client)
    }

    /// Opens the port. `robot` is the robot that `sim` and the emulators simulate, and `settings` apply to a
    /// simulated tip.
    fn connect(&self, robot: &Robot, settings: &TipSettings) -> Result<Connection, Failure> {
        let OpenPort { port, simulated_tip: simulation } = port::open(&self.name, robot, settings)?;
        let name = if self.is_simulated() { format!("{} (simulated)", self.text()) } else { self.text().to_owned() };
        Ok(Connection { client: Client::new(port, &name).with_take_over(self.take_over), simulation })
    }

    /// Returns the port's name as it was given.
    fn text(&self) -> &str {
        &self.text
    }
}

/// An open connection to a robot.
pub struct Connection {
    /// Client of the robot's board.
    client: Client,
    /// The simulated tip, with the body as it is really laid. `None` if the tip is not simulated.
    simulation: Option<Box<dyn SimulatedTip>>,
}

/// Returns the word that precedes "robot" or "board" in messages if the robot is simulated.
fn simulated_prefix(is_simulated: bool) -> &'static str {
    if is_simulated { "simulated " } else { "" }
}

/// Returns the robot of a run: the given one, or else the one that the log describes or names. A log refers to no other
/// file.
fn robot_of(record: &RecordedRun, robot: Option<&Path>) -> Result<Robot, Failure> {
    match robot {
        Some(robot) => Ok(robot_file::load(robot)?),
        None => Ok(record.own_robot()?),
    }
}

/// Warns about the parts of a run log that could not be read.
fn warn_of_damage(record: &RecordedRun, file: &Path) {
    if let Some(words) = record.damage.message(&display_name(file)) {
        growbot_host::warning!("{words}");
    }
}

/// Name of an argument for a robot in the help. [`completions`] recognises such arguments by this name.
const ROBOT: &str = "FILE|NAME";

/// `--robot` of commands that need a robot.
#[derive(Args)]
pub struct RobotArg {
    /// The robot: a built-in name (growbot-a, -a1 to -a8, -b, -c) or a TOML file [default: GROWBOT_ROBOT, then
    /// growbot.toml, then growbot-a]
    #[arg(long, value_name = ROBOT)]
    robot: Option<PathBuf>,
}

impl RobotArg {
    /// Reads and checks the robot's description.
    fn load(&self) -> Result<Robot, Failure> {
        Ok(robot_file::load(&self.name()?)?)
    }

    /// Like [`RobotArg::load`], but invalid settings files are treated as `invalid` requires.
    fn load_from_files(&self, invalid: InvalidFiles) -> Result<Robot, Failure> {
        Ok(robot_file::load(&self.name_from_files(invalid)?)?)
    }

    /// Returns the name or the file of the robot.
    fn name(&self) -> Result<PathBuf, Failure> {
        self.name_from_files(InvalidFiles::Refuse)
    }

    fn name_from_files(&self, invalid: InvalidFiles) -> Result<PathBuf, Failure> {
        match &self.robot {
            Some(robot) => Ok(robot.clone()),
            None => Ok(settings::log_setting(Key::Robot, Setting::load_from_files(Key::Robot, invalid)?).into()),
        }
    }

    /// Reads the presets of materials.
    fn presets(&self) -> Result<MaterialPresets, Failure> {
        Ok(MaterialPresets::load(&self.name()?)?)
    }
}
