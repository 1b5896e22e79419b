//! Ports to robots: in this process (`sim`), in an emulator (`emulator`, `rp2040`), over TCP or over a serial line.

pub mod debugger;
mod emulated_tip;
pub mod emulator;
mod open_error;
pub mod paced;
pub mod qemu;
pub mod rp2040;
pub mod sim;
mod tip_settings;

use std::cell::RefCell;
use std::path::PathBuf;
use std::rc::Rc;
use std::str::FromStr;
use std::time::Duration;

use growbot_client::port::Port;
use growbot_client::port::faulty::{FaultSpec, FaultyPort};
use growbot_client::port::stream::Stream;
use growbot_core::robot::Robot;
use growbot_plan::robot_kind::RobotKind;
pub use open_error::OpenError;
use paced::PacedSim;
pub use tip_settings::TipSettings;

use crate::sim_daemon::{DaemonPort, RemoteTip, StateDir};
use crate::simulated_tip::SimulatedTip;
use crate::tip::Variation;

/// Name of a port, as given to `--port`.
#[derive(Debug, Clone, PartialEq)]
pub enum PortName {
    /// `sim`: a simulated robot in this process, on a virtual clock.
    Sim,
    /// `sim:NAME`: the simulated robot of this name, which runs in a background process.
    SimDaemon(String),
    /// `emulator` or `emulator:ELF`: the firmware in QEMU. The field is the path of the firmware image. `None` stands
    /// for the image in cargo's target directory.
    Emulator(Option<PathBuf>),
    /// `rp2040`: the firmware of a Raspberry Pi Pico in the emulator `rp2040js`. The fields are the path of the
    /// firmware image (`None` stands for the image in cargo's target directory) and the board's link to the host.
    Rp2040(Option<PathBuf>, rp2040::HostLink),
    /// `tcp:HOST:PORT`: a robot that is reached over TCP. The field is `HOST:PORT`.
    Tcp(String),
    /// A robot at a serial device. The field is the name of the device, such as `/dev/ttyACM0`.
    Serial(String),
    /// Any other kind of port, with injected faults of the connection.
    Faulty(Box<Self>, FaultSpec),
}

impl PortName {
    /// Returns true if the port's time passes only while the host waits for the board.
    pub fn is_virtual(&self) -> bool {
        match self {
            Self::Sim | Self::Rp2040(..) => true,
            Self::Emulator(_) => qemu::Time::of_environment() == qemu::Time::Virtual,
            Self::Faulty(name, _) => name.is_virtual(),
            Self::SimDaemon(_) | Self::Tcp(_) | Self::Serial(_) => false,
        }
    }

    /// Returns the name of the simulated robot in a background process (`sim:NAME`) behind this port. Returns `None`
    /// for all other kinds of ports.
    pub fn resident(&self) -> Option<&str> {
        match self {
            Self::SimDaemon(name) => Some(name),
            Self::Faulty(name, _) => name.resident(),
            Self::Sim | Self::Emulator(_) | Self::Rp2040(..) | Self::Tcp(_) | Self::Serial(_) => None,
        }
    }

    /// Returns the pace of the robot's time, in multiples of real time. `None` if it is not known.
    pub fn pace(&self) -> Option<f64> {
        match self.resident() {
            Some(name) => StateDir::of(name).ok()?.pace(),
            None if self.is_virtual() => None,
            None => Some(1.0),
        }
    }

    /// Returns the kind of the robot at the port.
    pub fn kind(&self) -> RobotKind {
        self.is_simulated().into()
    }

    /// Returns true if the tip at the port is simulated.
    pub fn is_simulated(&self) -> bool {
        match self {
            Self::Sim | Self::SimDaemon(_) | Self::Emulator(_) | Self::Rp2040(..) => true,
            Self::Faulty(name, _) => name.is_simulated(),
            Self::Tcp(_) | Self::Serial(_) => false,
        }
    }
}

impl FromStr for PortName {
    type Err = OpenError;

    fn from_str(text: &str) -> Result<Self, OpenError> {
        match text.split_once(':') {
            None if text == "sim" => Ok(Self::Sim),
            Some(("sim", name)) if !name.is_empty() => Ok(Self::SimDaemon(name.to_string())),
            None if text == "emulator" => Ok(Self::Emulator(None)),
            Some(("emulator", path)) if !path.is_empty() => Ok(Self::Emulator(Some(path.into()))),
            None if text == "rp2040" => Ok(Self::Rp2040(None, rp2040::HostLink::Uart)),
            None if text == "rp2040,usb" => Ok(Self::Rp2040(None, rp2040::HostLink::Usb)),
            Some(("rp2040", path)) if !path.is_empty() => {
                let over_usb = path.strip_suffix(",usb").filter(|path| !path.is_empty());
                let line = if over_usb.is_some() { rp2040::HostLink::Usb } else { rp2040::HostLink::Uart };
                Ok(Self::Rp2040(Some(over_usb.unwrap_or(path).into()), line))
            }
            Some(("tcp", address)) if address.contains(':') => Ok(Self::Tcp(address.to_string())),
            None if text.starts_with('/') || text.starts_with("COM") => Ok(Self::Serial(text.to_string())),
            _ => Err(OpenError::Unknown(text.to_string())),
        }
    }
}

/// An open port.
pub struct OpenPort {
    /// Connection to the robot.
    pub port: Box<dyn Port>,
    /// Simulated tip behind the port. `None` for a real robot.
    pub simulated_tip: Option<Box<dyn SimulatedTip>>,
}

impl OpenPort {
    /// Returns a port to a real robot.
    fn robot(port: impl Port + 'static) -> Self {
        Self { port: Box::new(port), simulated_tip: None }
    }
}

/// Opens a port. `robot` is the robot that `sim` and the emulators simulate, and `settings` apply to any simulated tip.
/// A real board reports its own robot.
///
/// # Errors
/// The port does not exist, is busy or does not start.
pub fn open(name: &PortName, robot: &Robot, settings: &TipSettings) -> Result<OpenPort, OpenError> {
    Ok(match name {
        PortName::Sim => {
            let mut sim = sim::Sim::new(robot.clone());
            settings.apply(&mut sim.simulated_tip());
            let simulation = Some(sim.tip_handle());
            let port: Box<dyn Port> = match settings.pace {
                Some(times) => Box::new(PacedSim::new(sim, times)),
                None => Box::new(sim),
            };
            OpenPort { port, simulated_tip: simulation }
        }
        PortName::SimDaemon(name) => {
            let mut line = DaemonPort::open(&StateDir::of(name)?)?;
            line.set_tip(settings)?;
            let line = Rc::new(RefCell::new(line));
            let simulation: Box<dyn SimulatedTip> = Box::new(RemoteTip::behind(&line));
            OpenPort { port: Box::new(line), simulated_tip: Some(simulation) }
        }
        PortName::Emulator(firmware) => {
            let mut emulator = emulator::Emulator::start(robot, firmware.as_deref())?;
            emulator.simulated_tip(|tip| settings.apply(tip));
            let simulation = Some(emulator.tip_handle());
            OpenPort { port: Box::new(emulator), simulated_tip: simulation }
        }
        PortName::Rp2040(firmware, line) => {
            let mut board =
                rp2040::Rp2040Emulator::start_on_link(*line, robot, firmware.as_deref(), Variation::default())?;
            settings.apply(&mut board.simulated_tip());
            let simulation = Some(board.tip_handle());
            OpenPort { port: Box::new(board), simulated_tip: simulation }
        }
        PortName::Tcp(address) => OpenPort::robot(Stream::tcp(address)?),
        PortName::Serial(device) => OpenPort::robot(Stream::serial(device)?),
        PortName::Faulty(name, spec) => {
            let OpenPort { port, simulated_tip: simulation } = open(name, robot, settings)?;
            OpenPort { port: Box::new(FaultyPort::new(port, *spec)), simulated_tip: simulation }
        }
    })
}

/// Opens the connection to a robot for the emergency stop within a time limit, even if another host uses it.
///
/// # Errors
/// The errors of [`open`], and [`OpenError::NoEmergencyPort`] for a robot that is simulated inside the program that
/// uses it.
pub fn open_for_emergency_stop(name: &PortName, limit: Duration) -> Result<Box<dyn Port>, OpenError> {
    Ok(match name {
        PortName::Sim | PortName::Emulator(_) | PortName::Rp2040(..) => return Err(OpenError::NoEmergencyPort),
        PortName::SimDaemon(name) => Box::new(DaemonPort::open_shared(&StateDir::of(name)?)?),
        PortName::Tcp(address) => Box::new(Stream::tcp_within(address, limit)?),
        PortName::Serial(device) => Box::new(Stream::serial_for_emergency_stop(device)?),
        PortName::Faulty(name, spec) => Box::new(FaultyPort::new(open_for_emergency_stop(name, limit)?, *spec)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_robot_beyond_board_limits_is_simulated_but_not_emulated() {
        let robot = growbot_plan::robot_file::load("growbot-c".as_ref()).unwrap();
        let settings = TipSettings::default();
        assert!(open(&PortName::Sim, &robot, &settings).is_ok());
        let Err(refused) = open(&PortName::Emulator(None), &robot, &settings) else { panic!("it is emulated") };
        let message = refused.to_string();
        assert!(
            message.starts_with("no board, real or emulated, can drive robot growbot-c")
                && message.contains("above 100000"),
            "{message}"
        );
    }

    #[test]
    fn port_names_are_parsed() {
        assert_eq!("sim".parse::<PortName>().unwrap(), PortName::Sim);
        assert_eq!("emulator".parse::<PortName>().unwrap(), PortName::Emulator(None));
        assert_eq!("emulator:a.elf".parse::<PortName>().unwrap(), PortName::Emulator(Some("a.elf".into())));
        assert_eq!("rp2040".parse::<PortName>().unwrap(), PortName::Rp2040(None, rp2040::HostLink::Uart));
        assert_eq!("rp2040,usb".parse::<PortName>().unwrap(), PortName::Rp2040(None, rp2040::HostLink::Usb));
        for (name, line) in [("rp2040:a.elf", rp2040::HostLink::Uart), ("rp2040:a.elf,usb", rp2040::HostLink::Usb)] {
            assert_eq!(name.parse::<PortName>().unwrap(), PortName::Rp2040(Some("a.elf".into()), line));
        }
        assert_eq!("tcp:robot:4000".parse::<PortName>().unwrap(), PortName::Tcp("robot:4000".into()));
        assert_eq!("/dev/ttyACM0".parse::<PortName>().unwrap(), PortName::Serial("/dev/ttyACM0".into()));
        assert_eq!("sim:lab".parse::<PortName>().unwrap(), PortName::SimDaemon("lab".into()));
        for wrong in ["", "sim:", "tcp", "tcp:", "tcp:robot", "emulator:", "rp2040:", "simulator"] {
            assert!(matches!(wrong.parse::<PortName>(), Err(OpenError::Unknown(_))), "{wrong}");
        }
    }
}
