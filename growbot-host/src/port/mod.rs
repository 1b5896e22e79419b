//! Where a robot is: in this process (`sim`), in an emulator, behind a TCP connection or on a serial line.

pub mod emulator;
pub mod faulty;
pub mod paced;
pub mod qemu;
pub mod sim;
pub mod stream;

use std::cell::RefCell;
use std::path::PathBuf;
use std::rc::Rc;
use std::str::FromStr;
use std::time::Duration;

use growbot_core::layer::Layer;
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;

use faulty::{FaultSpec, Faulty};
use paced::Paced;

use crate::tip::{Imperfection, Tip};

/// The line to a robot: bytes both ways.
pub trait Port {
    /// Sends bytes.
    ///
    /// # Errors
    /// If the line is gone.
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError>;

    /// Waits, on the robot's own clock where it has one, until bytes arrive or the time is over, which gives 0.
    ///
    /// # Errors
    /// If the line is gone.
    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError>;

    /// What the tip behind this port has really done, where it is a simulated one.
    ///
    /// # Errors
    /// If the tip can no longer be read.
    fn tip(&mut self) -> Result<Option<TipRecord>, PortError> {
        Ok(None)
    }

    /// The layers of that tip's body which no longer change, from this index on; none where there is no simulated tip.
    ///
    /// # Errors
    /// If the tip can no longer be read.
    fn settled(&mut self, _from: usize) -> Result<Vec<Layer>, PortError> {
        Ok(Vec::new())
    }
}

/// A port that somebody else holds too: who breaks things on a simulated tip while a host talks to its board.
impl<P: Port> Port for Rc<RefCell<P>> {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.borrow_mut().send(bytes)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        self.borrow_mut().receive(buffer, timeout)
    }

    fn tip(&mut self) -> Result<Option<TipRecord>, PortError> {
        self.borrow_mut().tip()
    }

    fn settled(&mut self, from: usize) -> Result<Vec<Layer>, PortError> {
        self.borrow_mut().settled(from)
    }
}

impl Port for Box<dyn Port> {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.as_mut().send(bytes)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        self.as_mut().receive(buffer, timeout)
    }

    fn tip(&mut self) -> Result<Option<TipRecord>, PortError> {
        self.as_mut().tip()
    }

    fn settled(&mut self, from: usize) -> Result<Vec<Layer>, PortError> {
        self.as_mut().settled(from)
    }
}

/// What a simulated tip has done, from its steps.
#[derive(Debug, Clone, PartialEq)]
pub struct TipRecord {
    /// The body, layer by layer.
    pub body: Vec<Layer>,
    /// Steps of the feed.
    pub feed_steps: u64,
    /// Temperature of the nozzle, degrees Celsius.
    pub temperature_c: f64,
}

/// Why a port could not be opened, or was lost.
#[derive(Debug, thiserror::Error)]
pub enum PortError {
    /// The port's name means nothing.
    #[error(
        "port `{0}` is none that I know: use sim, emulator, emulator:ELF, tcp:HOST:PORT or a serial device such as /dev/ttyACM0"
    )]
    Unknown(String),
    /// The device is not there.
    #[error("port {0} is not there: check the cable and the name{1}")]
    Missing(String, String),
    /// Another program has it.
    #[error("port {0} is busy: {1} holds it; close that first")]
    Busy(String, String),
    /// This user may not use it.
    #[error("port {0} may not be used by this user: join its group (often `dialout`) and log in again")]
    Forbidden(String),
    /// Nobody listens there.
    #[error("nobody answers at {0} ({1}): check the address and that the robot is on")]
    Unreachable(String, String),
    /// It worked and then it did not.
    #[error("the line to {0} broke ({1}): check the cable; what the robot has laid stays laid")]
    Lost(String, String),
    /// The emulator.
    #[error(transparent)]
    Emulator(#[from] qemu::QemuError),
}

/// The name of a port, as given to `--port`.
#[derive(Debug, Clone, PartialEq)]
pub enum PortName {
    /// The controller in this process, on a virtual clock.
    Sim,
    /// The firmware in QEMU: the image given, or the one that was built last.
    Emulator(Option<PathBuf>),
    /// `tcp:HOST:PORT`.
    Tcp(String),
    /// A serial device.
    Serial(String),
    /// Any of them, behind a wire with faults.
    Faulty(Box<Self>, FaultSpec),
}

impl PortName {
    /// Whether time passes there only while somebody waits for it.
    #[must_use]
    pub fn is_virtual(&self) -> bool {
        match self {
            Self::Sim => true,
            Self::Faulty(name, _) => name.is_virtual(),
            Self::Emulator(_) | Self::Tcp(_) | Self::Serial(_) => false,
        }
    }

    /// Whether the tip there is a simulated one.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        match self {
            Self::Sim | Self::Emulator(_) => true,
            Self::Faulty(name, _) => name.is_simulated(),
            Self::Tcp(_) | Self::Serial(_) => false,
        }
    }
}

impl FromStr for PortName {
    type Err = PortError;

    fn from_str(text: &str) -> Result<Self, PortError> {
        match text.split_once(':') {
            None if text == "sim" => Ok(Self::Sim),
            None if text == "emulator" => Ok(Self::Emulator(None)),
            Some(("emulator", path)) if !path.is_empty() => Ok(Self::Emulator(Some(path.into()))),
            Some(("tcp", address)) if address.contains(':') => Ok(Self::Tcp(address.to_string())),
            None if text.starts_with('/') || text.starts_with("COM") => Ok(Self::Serial(text.to_string())),
            _ => Err(PortError::Unknown(text.to_string())),
        }
    }
}

/// What a simulated tip is like, and where.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TipSettings {
    /// Where growth begins, for its orientation sensor; none for the origin and upwards.
    pub start: Option<Pose>,
    /// What is off about it.
    pub imperfection: Imperfection,
    /// How many times as fast as real time its time passes, above 0; none for as fast as it is computed. On `sim` alone.
    pub pace: Option<f64>,
}

impl TipSettings {
    fn apply(&self, tip: &mut Tip) {
        if let Some(start) = &self.start {
            tip.start_at(start);
        }
        tip.disturb(&self.imperfection);
    }
}

/// Opens a port. `robot` is the one that is simulated or emulated there, with a tip of these settings; on other ports the board says
/// what it is.
///
/// # Errors
/// A port that is not there, is busy or does not start.
pub fn open(name: &PortName, robot: &Robot, settings: &TipSettings) -> Result<Box<dyn Port>, PortError> {
    Ok(match name {
        PortName::Sim => {
            let mut sim = sim::Sim::new(robot.clone());
            settings.apply(&mut sim.simulated_tip());
            match settings.pace {
                Some(times) => Box::new(Paced::new(sim, times)),
                None => Box::new(sim),
            }
        }
        PortName::Emulator(firmware) => {
            let mut emulator = emulator::Emulator::start(robot, firmware.as_deref())?;
            emulator.simulated_tip(|tip| settings.apply(tip));
            Box::new(emulator)
        }
        PortName::Tcp(address) => Box::new(stream::Stream::tcp(address)?),
        PortName::Serial(device) => Box::new(stream::Stream::serial(device)?),
        PortName::Faulty(name, spec) => Box::new(Faulty::new(open(name, robot, settings)?, *spec)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn port_names_are_read() {
        assert_eq!("sim".parse::<PortName>().unwrap(), PortName::Sim);
        assert_eq!("emulator".parse::<PortName>().unwrap(), PortName::Emulator(None));
        assert_eq!("emulator:a.elf".parse::<PortName>().unwrap(), PortName::Emulator(Some("a.elf".into())));
        assert_eq!("tcp:robot:4000".parse::<PortName>().unwrap(), PortName::Tcp("robot:4000".into()));
        assert_eq!("/dev/ttyACM0".parse::<PortName>().unwrap(), PortName::Serial("/dev/ttyACM0".into()));
        for wrong in ["", "tcp", "tcp:", "tcp:robot", "emulator:", "simulator"] {
            assert!(matches!(wrong.parse::<PortName>(), Err(PortError::Unknown(_))), "{wrong}");
        }
    }
}
