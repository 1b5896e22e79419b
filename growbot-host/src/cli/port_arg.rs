//! `--port` of commands, and the port that it selects.

use std::path::Path;

use clap::Args;
use growbot_client::client::Client;
use growbot_client::port::faulty::FaultSpec;
use growbot_core::robot::Robot;
use growbot_plan::input::display_name;
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::run_log::RecordedRun;
use growbot_serve::settings::{InvalidFiles, Key, Setting, SettingOrigin};
use growbot_sim::port::{self, OpenPort, PortName, TipSettings};
use growbot_sim::simulated_tip::SimulatedTip;

use super::failure::Failure;
use super::known_robots::{no_port, only_robot, only_service_robot};
use super::{service_lookup, settings};

/// `--port` of commands that communicate with a robot. The default is the configured port, or else a simulated robot.
#[derive(Args)]
pub struct PortArg {
    /// Port of the robot: a serial device, tcp:HOST:PORT, sim, sim:NAME (a simulated robot that stays on, see growbot
    /// power), emulator, emulator:ELF, rp2040 or rp2040:ELF (rp2040,usb and rp2040:ELF,usb for its USB link) [default:
    /// GROWBOT_PORT, then growbot.toml, then the only robot of the service if it is simulated, then sim]
    #[arg(long, value_name = "PORT")]
    port: Option<String>,
    #[command(flatten)]
    link: LinkArgs,
}

/// `--port` of commands for a robot that exists already. They would be meaningless for a robot that is simulated from
/// now on, so a port must be given or configured, or be that of the only robot.
#[derive(Args)]
pub struct RequiredPortArg {
    /// Port of the robot: a serial device, tcp:HOST:PORT or sim:NAME, or the name of a robot in growbot.toml or of the
    /// service [default: GROWBOT_PORT, then growbot.toml; then some commands take the only robot]
    #[arg(long, value_name = "PORT")]
    port: Option<String>,
    #[command(flatten)]
    link: LinkArgs,
}

/// Faults of the link, and conflicts with another host.
#[derive(Args, Clone, Copy, Default)]
pub struct LinkArgs {
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
    /// Returns the given port, or the configured one, or that of the only robot of the user's service, or else `sim`.
    /// Returns an error if the only robot of the service is real.
    pub fn resolve(&self) -> Result<SelectedPort, Failure> {
        let text = match &self.port {
            Some(text) => text.clone(),
            None => {
                let setting = Setting::load(Key::Port)?;
                let only = if setting.origin == SettingOrigin::BuiltIn { only_service_robot()? } else { None };
                only.unwrap_or_else(|| settings::log_setting(Key::Port, setting))
            }
        };
        self.link.at(text)
    }

    /// Like [`PortArg::resolve`], but the port in a run log comes before the files of settings.
    pub fn resolve_for_log(&self, log: Option<(&Path, &RecordedRun)>) -> Result<SelectedPort, Failure> {
        if let (None, Some((file, record))) = (&self.port, log) {
            let is_set = matches!(Setting::load(Key::Port)?.origin, SettingOrigin::Environment(_));
            if !is_set && !record.port.is_empty() {
                growbot_host::note!("port {}, from: {}", record.port, display_name(file));
                return self.link.at(record.port.clone());
            }
        }
        self.resolve()
    }
}

impl RequiredPortArg {
    /// Returns true if a port is given on the command line.
    pub fn is_given(&self) -> bool {
        self.port.is_some()
    }

    /// Returns the port that `text` names directly, or the port of the robot that it names, with the options of this
    /// command for the link.
    pub fn at(&self, text: String) -> Result<SelectedPort, Failure> {
        self.link.at(text)
    }

    /// Returns the given port, or the configured one. Returns an error if neither is set.
    pub fn resolve(&self) -> Result<SelectedPort, Failure> {
        self.resolve_configured(InvalidFiles::Refuse)
    }

    /// Returns the given port, or the configured one, or else that of the only robot.
    pub fn resolve_or_only(&self) -> Result<SelectedPort, Failure> {
        self.resolve_or_only_from_files(InvalidFiles::Refuse)
    }

    /// Like [`RequiredPortArg::resolve_or_only`], but invalid settings files only cause warnings, because they must not
    /// prevent a stop.
    pub fn resolve_for_stop(&self) -> Result<SelectedPort, Failure> {
        settings::skip_invalid(|invalid| self.resolve_or_only_from_files(invalid))
    }

    fn resolve_or_only_from_files(&self, mut invalid: InvalidFiles) -> Result<SelectedPort, Failure> {
        let text = match self.given_or_configured(invalid.reborrow())? {
            Some(text) => text,
            None => only_robot(invalid.reborrow())?,
        };
        self.link.at_from_files(text, invalid)
    }

    /// Returns the given port, or the configured one. Returns an error if neither is set. Invalid settings files are
    /// treated as `invalid` requires.
    pub fn resolve_configured(&self, mut invalid: InvalidFiles) -> Result<SelectedPort, Failure> {
        let text = self.given_or_configured(invalid.reborrow())?.ok_or_else(no_port)?;
        self.link.at_from_files(text, invalid)
    }

    fn given_or_configured(&self, invalid: InvalidFiles) -> Result<Option<String>, Failure> {
        if self.port.is_some() {
            return Ok(self.port.clone());
        }
        Ok(match Setting::load_from_files(Key::Port, invalid)? {
            Setting { origin: SettingOrigin::BuiltIn, .. } => None,
            setting => Some(settings::log_setting(Key::Port, setting)),
        })
    }
}

impl LinkArgs {
    /// Returns the port with this name: a port, or a robot of the settings or of the user's service.
    pub fn at(self, text: String) -> Result<SelectedPort, Failure> {
        self.at_from_files(text, InvalidFiles::Refuse)
    }

    /// Like [`LinkArgs::at`], but invalid settings files are treated as `invalid` requires.
    pub fn at_from_files(self, text: String, invalid: InvalidFiles) -> Result<SelectedPort, Failure> {
        let (text, name) = match text.parse::<PortName>() {
            Ok(name) => (text, name),
            Err(unknown) => {
                let port = service_lookup::port_of_robot(&text, invalid)?.ok_or(unknown)?;
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
    pub fn name(&self) -> &PortName {
        &self.name
    }

    /// Returns the speed of the robot's clock, in multiples of real time. `requested` is the requested speed of a
    /// simulated robot. `None` if it is not known.
    pub fn pace(&self, requested: Option<f64>) -> Option<f64> {
        self.name.pace().or(requested.filter(|_| self.name.is_virtual()))
    }

    /// Returns true if the robot ends with this program.
    pub fn is_in_process(&self) -> bool {
        self.kind().is_simulated() && self.name.resident().is_none()
    }

    /// Returns an error if the port would start a new simulated robot in this program, because that has nothing to
    /// stop or discard.
    pub fn require_running_robot(&self, command: &str) -> Result<(), Failure> {
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

    /// Returns the kind of the robot.
    pub fn kind(&self) -> RobotKind {
        self.name.kind()
    }

    /// Opens the port and returns a client of the board. `robot` is the robot that `sim` and the emulators simulate.
    pub fn client(&self, robot: &Robot) -> Result<Client, Failure> {
        Ok(self.connect(robot, &TipSettings::default())?.client)
    }

    /// Opens the port. `robot` is the robot that `sim` and the emulators simulate, and `settings` apply to a
    /// simulated tip.
    pub fn connect(&self, robot: &Robot, settings: &TipSettings) -> Result<Connection, Failure> {
        let OpenPort { port, simulated_tip: simulation } = port::open(&self.name, robot, settings)?;
        let name =
            if self.kind().is_simulated() { format!("{} (simulated)", self.text()) } else { self.text().to_owned() };
        let client = Client::new(port, &name);
        Ok(Connection { client: if self.take_over { client.with_take_over() } else { client }, simulation })
    }

    /// Returns the port's name as it was given.
    pub fn text(&self) -> &str {
        &self.text
    }
}

/// An open connection to a robot.
pub struct Connection {
    /// Client of the robot's board.
    pub client: Client,
    /// The simulated tip, with the body as it is really laid. `None` if the tip is not simulated.
    pub simulation: Option<Box<dyn SimulatedTip>>,
}
