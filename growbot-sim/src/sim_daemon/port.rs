//! The port to a simulated robot that runs in the background.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::io::{self, BufRead, BufReader, Write};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use std::rc::Rc;
use std::time::Duration;

use growbot_client::ground_truth::{GroundTruth, LaidBody};
use growbot_client::port::{Port, PortError};
use growbot_core::layer::Layer;
use growbot_core::link::emergency_stop::EMERGENCY_STOP;
use growbot_core::pose::Pose;

use super::protocol::{DaemonResponse, PROTOCOL_VERSION, Request, laid, micros};
use super::{SimDaemonError, StateDir};
use crate::port::TipSettings;
use crate::simulated_tip::SimulatedTip;
use crate::tip::manual_action::ManualAction;

/// Timeout for requests that the robot's process answers immediately, unless the machine is busy. If the process ends,
/// the request fails at once.
const AT_ONCE: Duration = Duration::from_secs(30);
/// Slowest speed of a simulated robot's time, as a multiple of real time.
const SLOWEST_PACE: f64 = 0.1;

/// Port to a simulated robot that runs in a background process. The clock of the port is the robot's clock, which also
/// advances while no program uses the port.
pub struct DaemonPort {
    name: String,
    place: StateDir,
    reader: BufReader<UnixStream>,
    now: Duration,
    /// Bytes that the board has sent and the caller of `receive` has not taken yet.
    arrived: VecDeque<u8>,
}

impl DaemonPort {
    /// Opens a connection to the robot for exclusive use.
    ///
    /// # Errors
    /// [`SimDaemonError`]: the robot is off, or another program has an exclusive connection to it.
    pub fn open(place: &StateDir) -> Result<Self, SimDaemonError> {
        Self::open_as(place, true)
    }

    /// Opens a connection to the robot in addition to those of other programs, to send an emergency stop or to switch
    /// the robot off.
    ///
    /// # Errors
    /// [`SimDaemonError::NotRunning`], [`SimDaemonError::Unresponsive`].
    pub fn open_shared(place: &StateDir) -> Result<Self, SimDaemonError> {
        Self::open_as(place, false)
    }

    fn open_as(place: &StateDir, alone: bool) -> Result<Self, SimDaemonError> {
        let off = || SimDaemonError::NotRunning(place.name().to_owned());
        let stream = UnixStream::connect(place.socket_path()?).map_err(|_| off())?;
        let name = format!("sim:{}", place.name());
        let reader = BufReader::new(stream);
        let mut line = Self { name, place: place.clone(), reader, now: Duration::ZERO, arrived: VecDeque::new() };
        match line.request(&Request::Open { release: PROTOCOL_VERSION, exclusive: alone }, AT_ONCE) {
            Ok(DaemonResponse::Busy) => Err(SimDaemonError::Busy(place.name().to_owned())),
            Ok(DaemonResponse::Done { .. }) => Ok(line),
            Ok(_) => Err(SimDaemonError::OtherRelease(place.name().to_owned())),
            Err(PortError::Lost(_, error)) if error.kind() == io::ErrorKind::TimedOut => {
                Err(SimDaemonError::Unresponsive(place.name().to_owned()))
            }
            Err(_) => Err(off()),
        }
    }

    /// Sets the errors of the simulated tip.
    ///
    /// # Errors
    /// If the robot was switched off.
    pub fn set_tip(&mut self, settings: &TipSettings) -> Result<(), PortError> {
        self.request(&Request::Tip(settings.into()), AT_ONCE).map(|_| ())
    }

    /// Resets the board.
    ///
    /// # Errors
    /// If the robot was switched off.
    pub fn reset(&mut self) -> Result<(), PortError> {
        self.request(&Request::Reset, AT_ONCE).map(|_| ())
    }

    /// Puts a full spool in place of the present one.
    ///
    /// # Errors
    /// If the robot was switched off.
    pub fn change_spool(&mut self) -> Result<(), PortError> {
        self.request(&Request::Hand(ManualAction::ChangeSpool), AT_ONCE).map(|_| ())
    }

    /// Switches the robot off immediately, and waits until it is off.
    ///
    /// # Errors
    /// If the process does not respond.
    pub fn power_off(&mut self) -> Result<(), PortError> {
        self.request(&Request::PowerOff, AT_ONCE)?;
        // The process ends after its response, and the line closes with it.
        let mut rest = String::new();
        let _ = self.reader.read_line(&mut rest);
        Ok(())
    }

    fn request(&mut self, ask: &Request, limit: Duration) -> Result<DaemonResponse, PortError> {
        let answer = self.round_trip(ask, limit).map_err(|error| PortError::Lost(self.name.clone(), error))?;
        if let DaemonResponse::Done { now_us } | DaemonResponse::Bytes { now_us, .. } = &answer {
            self.now = Duration::from_micros(*now_us);
        }
        Ok(answer)
    }

    fn round_trip(&mut self, ask: &Request, limit: Duration) -> io::Result<DaemonResponse> {
        let switched_off = || io::Error::new(io::ErrorKind::ConnectionReset, "the simulated board was switched off");
        let mut line = serde_json::to_vec(ask)?;
        line.push(b'\n');
        let stream = self.reader.get_mut();
        let sent = stream.set_read_timeout(Some(limit)).and_then(|()| stream.write_all(&line));
        sent.map_err(|_| switched_off())?;
        let mut answer = String::new();
        match self.reader.read_line(&mut answer) {
            Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut) => {
                // A late response would be taken for that to the next request.
                let _ = self.reader.get_mut().shutdown(Shutdown::Both);
                let detail = format!("no response of the simulated board within {} s", limit.as_secs());
                Err(io::Error::new(io::ErrorKind::TimedOut, detail))
            }
            Ok(0) | Err(_) => Err(switched_off()),
            Ok(_) => Ok(serde_json::from_str(&answer)?),
        }
    }
}

impl Port for DaemonPort {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.request(&Request::Send(bytes.to_vec()), AT_ONCE).map(|_| ())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        if self.arrived.is_empty() {
            let ask = Request::Receive { timeout_us: micros(timeout), max: buffer.len() };
            let limit = AT_ONCE.saturating_add(timeout.div_f64(SLOWEST_PACE));
            if let DaemonResponse::Bytes { bytes, .. } = self.request(&ask, limit)? {
                self.arrived.extend(bytes);
            }
        }
        let count = buffer.len().min(self.arrived.len());
        for (slot, byte) in buffer.iter_mut().zip(self.arrived.drain(..count)) {
            *slot = byte;
        }
        Ok(count)
    }

    fn now(&self) -> Duration {
        self.now
    }

    fn emergency_port(&mut self) -> Option<Box<dyn Port + Send>> {
        Self::open_shared(&self.place).ok().map(|line| Box::new(line) as Box<dyn Port + Send>)
    }

    fn send_emergency_stop(&mut self) -> Result<(), PortError> {
        self.send(&EMERGENCY_STOP)
    }
}

/// The simulated tip of a robot in a background process, accessed through the port to this robot.
pub struct RemoteTip(Rc<RefCell<DaemonPort>>);

impl RemoteTip {
    /// Creates the access to the simulated tip behind a port, which a client may use at the same time.
    pub fn behind(line: &Rc<RefCell<DaemonPort>>) -> Self {
        Self(Rc::clone(line))
    }
}

impl GroundTruth for RemoteTip {
    fn laid(&mut self) -> Result<LaidBody, PortError> {
        match self.0.borrow_mut().request(&Request::Laid, AT_ONCE)? {
            DaemonResponse::Laid { layers, feed_steps } => Ok(laid(&layers, feed_steps)),
            _ => Ok(LaidBody::default()),
        }
    }

    fn settled(&mut self, from: usize) -> Vec<Layer> {
        match self.0.borrow_mut().request(&Request::Settled { from }, AT_ONCE) {
            Ok(DaemonResponse::Laid { layers, .. }) => laid(&layers, 0).body,
            _ => Vec::new(),
        }
    }

    fn start_at(&mut self, pose: &Pose) {
        // If the robot was switched off, its board does not respond either.
        let _ = self.0.borrow_mut().request(&Request::StartAt(pose.to_degrees(), pose.roll()), AT_ONCE);
    }
}

impl SimulatedTip for RemoteTip {
    fn apply_action(&mut self, hand: ManualAction) -> bool {
        self.0.borrow_mut().request(&Request::Hand(hand), AT_ONCE).is_ok()
    }
}
