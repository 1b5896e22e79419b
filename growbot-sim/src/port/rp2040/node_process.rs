//! The Node process that runs the emulator of the Pico, and the messages to and from it
//! (`tests/rp2040/emulator-server.js`).

use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use growbot_client::port::PortError;
use growbot_core::robot::{BoardDescription, Signal};
use strum::IntoStaticStr;

use growbot_core::link::message::Motor;

/// Path of the script that Node runs, relative to growbot's source directory.
const SCRIPT: &str = "tests/rp2040/emulator-server.js";
/// Path of the emulator `rp2040js`, relative to the directory of the script.
const EMULATOR: &str = "node_modules/rp2040js";
/// Environment variable with the path of the file to which the script writes its measurements.
const FIGURES: &str = "RP2040_FIGURES";
/// Length of the part of a response before the list of pin edges, bytes.
const HEAD: usize = 48;
/// Length of a pin edge in a response, bytes.
const EDGE: usize = 8;
/// Reading of an ADC channel that is never ready. `NO_GRAVITY` is the reading of an orientation sensor that does not
/// respond.
const SILENT: u16 = u16::MAX;
const NO_GRAVITY: [i16; 3] = [i16::MIN; 3];

/// Connection between host and board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum HostLink {
    /// The UART.
    #[default]
    Uart,
    /// The serial port over USB.
    Usb,
}

/// Reason why the emulated Pico does not run.
#[derive(Debug, thiserror::Error)]
pub enum Rp2040Error {
    /// The firmware image does not exist. The field is its path.
    #[error("no firmware at {}: build it with `cargo build-pico`", .0.display())]
    NoFirmware(PathBuf),
    /// The script that Node runs does not exist. The field is the expected path.
    #[error("{} not found: the port rp2040 works only in growbot's source directory", .0.display())]
    NoScript(PathBuf),
    /// The emulator `rp2040js` is not installed. The field is its expected path.
    #[error("no emulator at {}: install it with `npm ci` in tests/rp2040", .0.display())]
    NoEmulator(PathBuf),
    /// Node cannot be run.
    #[error("cannot run `node` ({0}): install Node 18 or newer (package nodejs)")]
    NoNode(io::Error),
}

/// Returns the error of a board whose Node has ended with this message.
fn ended(message: &str) -> PortError {
    PortError::EmulatorEnded("node", message.to_owned(), "check that the image is growbot's firmware for the Pico")
}

/// Limits of the board's next run, with the sensor readings during it.
#[derive(Debug)]
pub(super) struct Run {
    pub until_ns: u64,
    /// Numbers of steps of the head and of the feed after which the run ends.
    pub steps: [u32; 2],
    pub thermistor: Option<u16>,
    pub supply: Option<u16>,
    /// Levels of the pins: index sensor, filament encoder, filament presence, drivers' fault, emergency stop.
    pub levels: [bool; 5],
    pub gravity: Option<[i16; 3]>,
}

/// Outputs of the board during a run.
#[derive(Debug)]
pub(super) struct RunResponse {
    pub now_ns: u64,
    /// Fraction of the run for which the heater was on, 0 to 1. `fan` is the same fraction for the fan.
    pub heater: f64,
    pub fan: f64,
    pub instructions: u64,
    pub resets: u32,
    pub flash_changed: u32,
    pub lost_power: bool,
    pub edges: Vec<Edge>,
    /// Bytes that the board sent.
    pub sent: Vec<u8>,
}

/// A change of one of the board's outputs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Edge {
    /// Time since the beginning of the run, ns.
    pub after_ns: u32,
    pub output: ProcessOutput,
    pub state: PinState,
}

#[derive(Debug, Clone, Copy)]
pub(super) enum ProcessOutput {
    Step(Motor),
    Direction(Motor),
    Enable(Motor),
    HeaterEnable,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum PinState {
    Low,
    High,
    Floating,
}

/// Ways to crash the firmware of a board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CrashMode {
    /// The main loop hangs.
    Hangs,
    /// The processor faults.
    Faults,
    /// The crystal stops until the next reset, and with it the timer and the watchdog. The processor's clock continues.
    CrystalStops,
}

/// The board's outputs, in the order of their numbers in the messages.
const OUTPUTS: [ProcessOutput; 7] = [
    ProcessOutput::Step(Motor::Head),
    ProcessOutput::Direction(Motor::Head),
    ProcessOutput::Enable(Motor::Head),
    ProcessOutput::Step(Motor::Feed),
    ProcessOutput::Direction(Motor::Feed),
    ProcessOutput::Enable(Motor::Feed),
    ProcessOutput::HeaterEnable,
];

/// Returns the pin numbers of a board by the names of their signals, as JSON for the script.
fn pins(board: &BoardDescription) -> serde_json::Value {
    let number = |signal: Signal| Some((signal.name().to_owned(), board.pin(signal)?.into()));
    serde_json::Value::Object(Signal::ALL.into_iter().filter_map(number).collect())
}

/// The Node process that runs the emulator. It is killed when this value is dropped.
pub(super) struct NodeProcess {
    node: Child,
    to: ChildStdin,
    from: ChildStdout,
}

impl Drop for NodeProcess {
    fn drop(&mut self) {
        let _ = self.node.kill();
        let _ = self.node.wait();
    }
}

impl NodeProcess {
    /// Starts Node with a firmware image on a board with these pins. If `figures` is given, the processor cycles of the
    /// step interrupt and the depth of the stack are written to that file.
    pub fn start(
        firmware: &Path,
        board: &BoardDescription,
        line: HostLink,
        figures: Option<&Path>,
    ) -> Result<Self, Rp2040Error> {
        if !firmware.is_file() {
            return Err(Rp2040Error::NoFirmware(firmware.to_path_buf()));
        }
        let script = script();
        if !script.is_file() {
            return Err(Rp2040Error::NoScript(script));
        }
        let emulator = script.with_file_name(EMULATOR);
        if !emulator.is_dir() {
            return Err(Rp2040Error::NoEmulator(emulator));
        }
        let mut command = Command::new("node");
        command.env("RP2040_PINS", pins(board).to_string());
        command
            .arg(&script)
            .arg(firmware)
            .arg::<&str>(line.into())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        command.envs(figures.map(|file| (FIGURES, file)));
        let mut node = command.spawn().map_err(Rp2040Error::NoNode)?;
        let (Some(to), Some(from)) = (node.stdin.take(), node.stdout.take()) else {
            return Err(Rp2040Error::NoNode(io::ErrorKind::BrokenPipe.into()));
        };
        Ok(Self { node, to, from })
    }

    pub fn run(&mut self, run: &Run, bytes: &[u8]) -> Result<RunResponse, PortError> {
        let mut request = vec![0];
        request.extend((run.until_ns as f64).to_le_bytes());
        request.extend(run.steps.iter().flat_map(|steps| steps.to_le_bytes()));
        for counts in [run.thermistor, run.supply] {
            request.extend(counts.unwrap_or(SILENT).to_le_bytes());
        }
        let levels = run.levels.iter().rev().fold(0, |levels: u8, level| levels << 1 | u8::from(*level));
        request.push(levels);
        request.extend(run.gravity.unwrap_or(NO_GRAVITY).iter().flat_map(|part| part.to_le_bytes()));
        request.extend(bytes);
        self.request(&request)
    }

    pub fn lose_power_after(&mut self, bytes: u32) -> Result<RunResponse, PortError> {
        let [a, b, c, d] = bytes.to_le_bytes();
        self.request(&[1, a, b, c, d])
    }

    pub fn power_up(&mut self) -> Result<RunResponse, PortError> {
        self.request(&[2])
    }

    pub fn slow_flash(&mut self, times: f64) -> Result<RunResponse, PortError> {
        let mut request = vec![3];
        request.extend(times.to_le_bytes());
        self.request(&request)
    }

    pub fn keep_flash(&mut self) -> Result<RunResponse, PortError> {
        self.request(&[5])
    }

    pub fn restore_flash(&mut self) -> Result<RunResponse, PortError> {
        self.request(&[6])
    }

    pub fn crash(&mut self, how: CrashMode) -> Result<RunResponse, PortError> {
        self.request(&[4, how as u8])
    }

    fn request(&mut self, request: &[u8]) -> Result<RunResponse, PortError> {
        let answer = self.exchange(request).map_err(|error| self.last_words(&error))?;
        RunResponse::parse(&answer).ok_or_else(|| ended("the emulator's response cannot be read"))
    }

    fn exchange(&mut self, request: &[u8]) -> io::Result<Vec<u8>> {
        let mut message = (request.len() as u32).to_le_bytes().to_vec();
        message.extend(request);
        self.to.write_all(&message)?;
        let mut length = [0; 4];
        self.from.read_exact(&mut length)?;
        let mut answer = vec![0; u32::from_le_bytes(length) as usize];
        self.from.read_exact(&mut answer)?;
        Ok(answer)
    }

    /// Returns an error with the message that Node printed when it ended.
    fn last_words(&mut self, error: &io::Error) -> PortError {
        let mut output = String::new();
        if let Some(mut errors) = self.node.stderr.take() {
            let _ = errors.read_to_string(&mut output);
        }
        // The line with the error's message is above its stack.
        let message = output.lines().find(|line| line.contains("Error")).map(str::trim);
        ended(message.unwrap_or(&error.to_string()))
    }
}

impl RunResponse {
    fn parse(bytes: &[u8]) -> Option<Self> {
        let (head, rest) = bytes.split_at_checked(HEAD)?;
        let double = |at: usize| Some(f64::from_le_bytes(head.get(at..at + 8)?.try_into().ok()?));
        let word = |at: usize| Some(u32::from_le_bytes(head.get(at..at + 4)?.try_into().ok()?));
        let (edges, sent) = rest.split_at_checked((word(44)? as usize).checked_mul(EDGE)?)?;
        let edges = edges.as_chunks::<EDGE>().0.iter().map(Edge::parse).collect::<Option<Vec<_>>>()?;
        Some(Self {
            now_ns: double(0)? as u64,
            heater: double(8)?,
            fan: double(16)?,
            instructions: double(24)? as u64,
            resets: word(32)?,
            flash_changed: word(36)?,
            lost_power: word(40)? != 0,
            edges,
            sent: sent.to_vec(),
        })
    }
}

impl Edge {
    fn parse(bytes: &[u8; EDGE]) -> Option<Self> {
        let word = u64::from_le_bytes(*bytes);
        let code = (word >> 32) as usize;
        let state = [PinState::Low, PinState::High, PinState::Floating].get(code % 4)?;
        Some(Self { after_ns: word as u32, output: *OUTPUTS.get(code / 4)?, state: *state })
    }
}

/// Returns the path of the script: in a directory above this program, or in the working directory.
fn script() -> PathBuf {
    let above = std::env::current_exe().ok().and_then(|program| {
        // target/release/growbot, or target/debug/deps/some-test
        program.ancestors().map(|folder| folder.join(SCRIPT)).find(|script| script.is_file())
    });
    above.unwrap_or_else(|| PathBuf::from(SCRIPT))
}
