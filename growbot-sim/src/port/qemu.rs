//! Boards in QEMU: starts the emulator and gives the ends of its lines.
//!
//! Each line is a TCP connection that QEMU makes to a port this side has opened before: there is no port to guess,
//! nothing to wait for but the connection, and no byte of the board's first message is lost. The emulator is killed
//! when its [`Qemu`] is dropped.

use std::ffi::{OsStr, OsString};
use std::fmt;
use std::fs::{File, OpenOptions};
use std::io::{self, Read};
use std::net::{Ipv4Addr, TcpListener, TcpStream};
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::debugger::Debugger;

/// The emulator's program.
const PROGRAM: &str = "qemu-system-arm";
/// The oldest release known to run both boards; before it the robot's own image does not boot.
pub const OLDEST: u32 = 10;
/// How long QEMU may take to make its connections.
const START: Duration = Duration::from_secs(60);
/// Max bytes of QEMU's own messages that are stored.
const MESSAGES: usize = 8192;

/// In virtual time an instruction takes 2^5 ns, as on the board's 25 MHz, and idle time takes none of this machine's.
const INSTRUCTIONS: &str = "shift=5,sleep=off";

/// How the time of the emulated robot passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Time {
    /// By the instructions that the board executes, and only while the host waits for the board.
    Virtual,
    /// As this machine's.
    Real,
}

impl Time {
    /// Real where the environment has `GROWBOT_EMULATOR_TIME=real`.
    #[must_use]
    pub fn of_environment() -> Self {
        if std::env::var_os("GROWBOT_EMULATOR_TIME").is_some_and(|time| time == "real") {
            Self::Real
        } else {
            Self::Virtual
        }
    }
}

/// Why an emulated board could not be started.
#[derive(Debug)]
pub enum QemuError {
    /// There is no `qemu-system-arm` on the path.
    Missing,
    /// QEMU is older than [`OLDEST`]; holds its version.
    TooOld(String),
    /// `qemu-system-arm --version` said something unexpected; holds it.
    UnknownVersion(String),
    /// The firmware is not there; holds its path.
    NoFirmware(PathBuf),
    /// QEMU ended before the board was up; holds what it said.
    Ended(String),
    /// QEMU ended after the board was up; holds what it said.
    Died(String),
    /// QEMU did not connect in time; holds the line and what QEMU said.
    NotConnected(&'static str, String),
    /// QEMU refused a command; holds the command and the answer.
    Refused(String, String),
    /// A file or a connection failed; holds what was being done.
    Io(&'static str, io::Error),
}

impl fmt::Display for QemuError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing => {
                write!(f, "{PROGRAM} is not installed: install QEMU {OLDEST} or newer (package qemu-system-arm)")
            }
            Self::TooOld(version) => write!(f, "{PROGRAM} is version {version}: version {OLDEST} or newer is needed"),
            Self::UnknownVersion(said) => write!(f, "cannot tell the version of {PROGRAM}; it says: {said}"),
            Self::NoFirmware(path) => {
                write!(
                    f,
                    "there is no firmware at {}: build it with `cargo build-an386` or `cargo build-robot`",
                    path.display()
                )
            }
            Self::Ended(said) => write!(f, "{PROGRAM} ended while starting the board: {}", or_nothing(said)),
            Self::Died(said) => write!(
                f,
                "{PROGRAM} ended under the board: {}; check that the image is growbot's firmware for the emulated board (`cargo build-an386`)",
                first_line(said)
            ),
            Self::NotConnected(line, said) => {
                write!(f, "{PROGRAM} did not connect its {line} within {} s: {}", START.as_secs(), or_nothing(said))
            }
            Self::Refused(command, answer) => write!(f, "{PROGRAM} refused `{command}`: {answer}"),
            Self::Io(what, error) => write!(f, "cannot {what}: {error}"),
        }
    }
}

impl std::error::Error for QemuError {
    fn source(&self) -> Option<&(dyn std::error::Error + 'static)> {
        match self {
            Self::Io(_, error) => Some(error),
            _ => None,
        }
    }
}

fn or_nothing(said: &str) -> &str {
    if said.trim().is_empty() { "it said nothing" } else { said.trim() }
}

/// What QEMU says first; registers may follow.
fn first_line(said: &str) -> &str {
    or_nothing(said).lines().next().unwrap_or_default().trim()
}

/// Makes an [`io::Error`] say what was being done.
pub fn doing(what: &'static str) -> impl Fn(io::Error) -> QemuError {
    move |error| QemuError::Io(what, error)
}

/// A line that QEMU is yet to connect.
pub struct Line {
    listener: TcpListener,
    name: &'static str,
}

impl Line {
    /// Opens a port for a line, on this machine only. The name is for error messages.
    pub fn open(name: &'static str) -> Result<Self, QemuError> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).map_err(doing("open a port for the emulator"))?;
        listener.set_nonblocking(true).map_err(doing("set up a port for the emulator"))?;
        Ok(Line { listener, name })
    }

    /// What QEMU wants after `-serial`, `-qmp` or `-qtest`.
    pub fn argument(&self) -> Result<String, QemuError> {
        let address = self.listener.local_addr().map_err(doing("read the port's number"))?;
        // Without nodelay short messages wait for one another, and an exchange takes four times as long.
        Ok(format!("tcp:127.0.0.1:{},server=off,nodelay=on", address.port()))
    }

    /// The same as a value of `-chardev`.
    fn character_device(&self, id: &str) -> Result<String, QemuError> {
        let address = self.listener.local_addr().map_err(doing("read the port's number"))?;
        Ok(format!("socket,id={id},host=127.0.0.1,port={},server=off,nodelay=on", address.port()))
    }
}

/// A running emulator; killed when dropped.
pub struct Qemu {
    child: Child,
    messages: Arc<Mutex<String>>,
    /// Keeps the messages; ends with QEMU.
    listener: Option<JoinHandle<()>>,
}

impl Qemu {
    /// Starts QEMU for a machine and a firmware image, with further arguments. Checks first that both are fit.
    pub fn start<A: AsRef<OsStr>>(
        machine: &str,
        firmware: &Path,
        arguments: impl IntoIterator<Item = A>,
    ) -> Result<Self, QemuError> {
        check_version()?;
        if !firmware.is_file() {
            return Err(QemuError::NoFirmware(firmware.to_path_buf()));
        }
        let mut child = command()
            // Ctrl-C is for this program, which stops the robot first.
            .process_group(0)
            .args(["-M", machine, "-display", "none", "-monitor", "none", "-kernel"])
            .arg(firmware)
            .args(arguments)
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(spawn_error)?;
        let messages = Arc::new(Mutex::new(String::new()));
        let listener = child.stderr.take().map(|mut stderr| {
            let stored = Arc::clone(&messages);
            // Ends with QEMU, whose end of the pipe it reads.
            thread::spawn(move || {
                let mut buffer = [0; 512];
                while let Ok(count @ 1..) = stderr.read(&mut buffer) {
                    let mut text = stored.lock().unwrap_or_else(PoisonError::into_inner);
                    if text.len() < MESSAGES {
                        text.push_str(&String::from_utf8_lossy(&buffer[..count]));
                    }
                }
            })
        });
        Ok(Qemu { child, messages, listener })
    }

    /// Waits for QEMU to connect a line.
    pub fn connect(&mut self, line: &Line) -> Result<TcpStream, QemuError> {
        let deadline = Instant::now() + START;
        loop {
            match line.listener.accept() {
                Ok((stream, _)) => {
                    stream.set_nonblocking(false).map_err(doing("set up the emulator's line"))?;
                    stream.set_nodelay(true).map_err(doing("set up the emulator's line"))?;
                    return Ok(stream);
                }
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                Err(error) => return Err(QemuError::Io("connect the emulator's line", error)),
            }
            if let Some(said) = self.last_words(Duration::ZERO) {
                return Err(QemuError::Ended(said));
            }
            if Instant::now() >= deadline {
                return Err(QemuError::NotConnected(line.name, self.messages()));
            }
            thread::sleep(Duration::from_millis(2));
        }
    }

    /// Whether the emulator still runs.
    pub fn is_running(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }

    /// All that QEMU itself has said, if it ends within a while: its lines break some moments before.
    pub fn last_words(&mut self, patience: Duration) -> Option<String> {
        let deadline = Instant::now() + patience;
        while self.is_running() {
            if Instant::now() >= deadline {
                return None;
            }
            thread::sleep(Duration::from_millis(2));
        }
        if let Some(listener) = self.listener.take() {
            // It cannot have panicked, and what it stored is there all the same.
            let _ = listener.join();
        }
        Some(self.messages())
    }

    /// Ends the emulator at this moment, and waits until it has ended.
    pub fn kill(&mut self) {
        // Both fail only if it has ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// What QEMU itself has said so far.
    pub fn messages(&self) -> String {
        self.messages.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Drop for Qemu {
    fn drop(&mut self) {
        self.kill();
    }
}

/// QEMU as a child that does not outlive this program, however that ends: where util-linux's `setpriv` is there, it
/// asks the system to see to it.
fn command() -> Command {
    let bound = Command::new("setpriv").arg("--version").stdin(Stdio::null()).stdout(Stdio::null()).status();
    if !bound.is_ok_and(|status| status.success()) {
        return Command::new(PROGRAM);
    }
    let mut command = Command::new("setpriv");
    command.args(["--pdeathsig", "KILL", "--", PROGRAM]);
    command
}

fn spawn_error(error: io::Error) -> QemuError {
    if error.kind() == io::ErrorKind::NotFound {
        QemuError::Missing
    } else {
        QemuError::Io("start qemu-system-arm", error)
    }
}

fn check_version() -> Result<(), QemuError> {
    let output = Command::new(PROGRAM).arg("--version").stdin(Stdio::null()).output().map_err(spawn_error)?;
    let said = String::from_utf8_lossy(&output.stdout);
    let first = said.lines().next().unwrap_or_default();
    match major_version(first) {
        Some((major, _)) if major >= OLDEST => Ok(()),
        Some((_, version)) => Err(QemuError::TooOld(version.to_string())),
        None => Err(QemuError::UnknownVersion(first.to_string())),
    }
}

/// The version in QEMU's first line, and the number it begins with.
fn major_version(line: &str) -> Option<(u32, &str)> {
    let version = line.split_whitespace().skip_while(|word| *word != "version").nth(1)?;
    let major = version.split('.').next()?.parse().ok()?;
    Some((major, version))
}

/// The emulated robot: an mps2-an386, the line to it, and the memory it shares with the simulated tip.
///
/// Dropping it kills the emulator and removes the memory.
pub struct EmulatedRobot {
    // The order is the one they are dropped in: the emulator goes before the file it maps.
    qemu: Qemu,
    line: TcpStream,
    debugger: Option<Debugger>,
    tip: TipMemory,
}

impl EmulatedRobot {
    /// Starts the board with a firmware image on a memory, whose host words the caller has written.
    ///
    /// In virtual time the board stands at its reset until [`EmulatedRobot::debugger`] has it run.
    pub fn start(firmware: &Path, tip: TipMemory, time: Time) -> Result<Self, QemuError> {
        let line = Line::open("serial line")?;
        let mut backend = OsString::from(format!("memory-backend-file,id=tip,share=on,size={},mem-path=", tip.size));
        backend.push(escape_commas(tip.path()));
        let mut arguments = vec!["-object".into(), backend, "-serial".into(), line.argument()?.into()];
        let debugger = match time {
            Time::Real => None,
            Time::Virtual => Some(Line::open("debugger's line")?),
        };
        if let Some(debugger) = &debugger {
            let device = debugger.character_device("debugger")?;
            let further = ["-chardev", &device, "-gdb", "chardev:debugger", "-S", "-icount", INSTRUCTIONS];
            arguments.extend(further.map(OsString::from));
        }
        let mut qemu = Qemu::start("mps2-an386,memory-backend=tip", firmware, arguments)?;
        let line = qemu.connect(&line)?;
        let debugger = debugger.map(|debugger| qemu.connect(&debugger)).transpose()?.map(Debugger::on);
        // QEMU has mapped it and we hold it open: without a name it goes with the two of us, however we end.
        let _ = std::fs::remove_file(tip.path());
        Ok(EmulatedRobot { qemu, line, debugger, tip })
    }

    /// What has the board run, taken once; none in real time.
    pub fn debugger(&mut self) -> Option<Debugger> {
        self.debugger.take()
    }

    /// The board's serial line.
    pub fn line(&self) -> &TcpStream {
        &self.line
    }

    /// The memory shared with the board.
    pub fn tip(&self) -> &TipMemory {
        &self.tip
    }

    /// The emulator.
    pub fn qemu(&mut self) -> &mut Qemu {
        &mut self.qemu
    }
}

/// In QEMU's options a comma ends a value unless doubled.
fn escape_commas(path: &Path) -> OsString {
    match path.to_str() {
        Some(text) => text.replace(',', ",,").into(),
        None => path.as_os_str().to_os_string(),
    }
}

/// The file behind the memory that board and tip share; removed when dropped.
pub struct TipMemory {
    path: PathBuf,
    file: File,
    size: u64,
}

impl TipMemory {
    /// A new file of zeros, in memory where the system has a place for that.
    pub fn create(size: u64) -> Result<Self, QemuError> {
        let shared = Path::new("/dev/shm");
        let directory = if shared.is_dir() { shared.to_path_buf() } else { std::env::temp_dir() };
        Self::create_in(&directory, size)
    }

    /// A new file of zeros in a directory.
    pub fn create_in(directory: &Path, size: u64) -> Result<Self, QemuError> {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        loop {
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            let path = directory.join(format!("growbot-tip-{}-{number}", std::process::id()));
            match OpenOptions::new().read(true).write(true).create_new(true).open(&path) {
                Ok(file) => {
                    let memory = TipMemory { path, file, size };
                    memory.file.set_len(size).map_err(doing("size the tip's memory"))?;
                    return Ok(memory);
                }
                // Left by a process of the same number that was killed.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(QemuError::Io("create the tip's memory", error)),
            }
        }
    }

    /// Where the file is.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The open file, to be mapped, or read and written in place.
    pub fn file(&self) -> &File {
        &self.file
    }
}

impl Drop for TipMemory {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_version_is_read_from_qemus_first_line() {
        let debian = "QEMU emulator version 10.0.2 (Debian 1:10.0.2+ds-2+deb13u1~bpo12+1)";
        assert_eq!(major_version(debian), Some((10, "10.0.2")));
        assert_eq!(major_version("QEMU emulator version 7.2.17"), Some((7, "7.2.17")));
        assert_eq!(major_version("bash: no such thing"), None);
        assert_eq!(major_version("version"), None);
    }

    #[test]
    fn the_tips_memory_goes_with_its_owner() -> Result<(), QemuError> {
        let memory = TipMemory::create(4096)?;
        let path = memory.path().to_path_buf();
        assert_eq!(std::fs::metadata(&path).map(|file| file.len()).ok(), Some(4096));
        drop(memory);
        assert!(!path.exists());
        Ok(())
    }

    #[test]
    fn a_comma_in_a_path_does_not_end_it() {
        assert_eq!(escape_commas(Path::new("/tmp/a,b")), "/tmp/a,,b");
    }
}
