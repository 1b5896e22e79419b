//! Boards in QEMU: starts the emulator and returns its connections.
//!
//! Each connection is a TCP connection that QEMU makes to a port that this side has opened before. So no port has to be
//! guessed, only the connection has to be awaited, and no byte of the board's first message is lost. The emulator is
//! killed when its [`Qemu`] is dropped.

use std::ffi::{OsStr, OsString};
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

use growbot_client::port::PortError;

use super::debugger::Debugger;

/// Name of QEMU's program.
const PROGRAM: &str = "qemu-system-arm";
/// Oldest major version of QEMU that is known to run growbot's firmware images for the mps2-an386 and the STM32F405. In
/// older versions the image for the STM32F405 does not boot.
pub const OLDEST: u32 = 10;
/// Timeout for QEMU to open its connections.
const START: Duration = Duration::from_secs(60);
/// Greatest number of bytes of QEMU's own messages that are stored.
const MESSAGES: usize = 8192;

/// Value of QEMU's option `-icount` for virtual time: an instruction takes 2^5 = 32 ns, the power of two nearest to the
/// 40 ns of the emulated board's 25 MHz, and idle time takes no real time.
const INSTRUCTIONS: &str = "shift=5,sleep=off";

/// Mode of the emulated robot's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Time {
    /// The time passes with the instructions that the board executes, and only while the host waits for the board.
    Virtual,
    /// The time of the emulated robot is the real time of this machine.
    Real,
}

impl Time {
    /// Returns `Real` if the environment has `GROWBOT_EMULATOR_TIME=real`.
    pub fn of_environment() -> Self {
        if std::env::var_os("GROWBOT_EMULATOR_TIME").is_some_and(|time| time == "real") {
            Self::Real
        } else {
            Self::Virtual
        }
    }
}

/// Error of starting or running an emulated board.
#[derive(Debug, thiserror::Error)]
pub enum QemuError {
    /// `qemu-system-arm` is not on the path.
    #[error("{PROGRAM} is not installed: install QEMU {OLDEST} or newer (package qemu-system-arm)")]
    Missing,
    /// QEMU is older than [`OLDEST`]. The field is its version.
    #[error(
        "{PROGRAM} is version {0}, but version {OLDEST} or newer is needed: install a newer QEMU (package \
         qemu-system-arm)"
    )]
    TooOld(String),
    /// The output of `qemu-system-arm --version` is not valid. The field is the output.
    #[error("cannot determine the version of {PROGRAM}; it printed: {0}")]
    UnknownVersion(String),
    /// The firmware does not exist. The field is its path.
    #[error("no firmware at {}: build it with `cargo build-an386` or `cargo build-stm32f405`", .0.display())]
    NoFirmware(PathBuf),
    /// QEMU ended before the board had started. The field is its output.
    #[error("{PROGRAM} ended while starting the board: {output}", output = or_nothing(.0))]
    ExitedAtStart(String),
    /// QEMU did not connect in time. The fields are the connection and QEMU's output.
    #[error(
        "{PROGRAM} did not connect its {0} within {limit} s: {output}", limit = START.as_secs(), output = or_nothing(.1)
    )]
    NotConnected(&'static str, String),
    /// QEMU rejected a command. The fields are the command and the response.
    #[error("{PROGRAM} refused `{0}`: {1}")]
    Refused(String, String),
    /// A file or a connection failed. The first field is the failed action.
    #[error("cannot {0}: {1}")]
    Io(&'static str, #[source] io::Error),
}

fn or_nothing(output: &str) -> &str {
    if output.trim().is_empty() { "the program printed nothing" } else { output.trim() }
}

/// Returns the error of a board whose QEMU has ended with this output, which may contain a dump of registers.
pub fn ended_while_running(output: &str) -> PortError {
    let first_line = or_nothing(output).lines().next().unwrap_or_default().trim().to_owned();
    let remedy = "check that the image is growbot's firmware for the emulated board (`cargo build-an386`)";
    PortError::EmulatorEnded(PROGRAM, first_line, remedy)
}

/// Returns a function that adds the failed action to an [`io::Error`].
pub fn doing(what: &'static str) -> impl Fn(io::Error) -> QemuError {
    move |error| QemuError::Io(what, error)
}

/// A listening TCP port for a connection that QEMU has not opened yet.
pub struct QemuSocket {
    listener: TcpListener,
    name: &'static str,
}

impl QemuSocket {
    /// Opens a listening TCP port that only this machine can reach. `name` is the connection's name in error messages.
    pub fn open(name: &'static str) -> Result<Self, QemuError> {
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).map_err(doing("open a port for the emulator"))?;
        listener.set_nonblocking(true).map_err(doing("set up a port for the emulator"))?;
        Ok(QemuSocket { listener, name })
    }

    /// Returns the value of `-serial`, `-qmp` or `-qtest` for this connection.
    pub fn argument(&self) -> Result<String, QemuError> {
        let address = self.listener.local_addr().map_err(doing("read the port's number"))?;
        // Without nodelay short messages wait for one another, and an exchange takes four times as long.
        Ok(format!("tcp:127.0.0.1:{},server=off,nodelay=on", address.port()))
    }

    /// Returns the value of `-chardev` for this connection.
    fn character_device(&self, id: &str) -> Result<String, QemuError> {
        let address = self.listener.local_addr().map_err(doing("read the port's number"))?;
        Ok(format!("socket,id={id},host=127.0.0.1,port={},server=off,nodelay=on", address.port()))
    }
}

/// A running QEMU process. It is killed when this value is dropped.
pub struct Qemu {
    child: Child,
    messages: Arc<Mutex<String>>,
    /// Thread that stores QEMU's error output in `messages`. It ends with QEMU.
    listener: Option<JoinHandle<()>>,
}

impl Qemu {
    /// Starts QEMU for a machine and a firmware image, with further arguments. Checks first that QEMU and the image are
    /// usable.
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
            // The thread ends with QEMU, because it reads from QEMU's end of the pipe.
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

    /// Waits for QEMU to open the connection `line`.
    pub fn connect(&mut self, line: &QemuSocket) -> Result<TcpStream, QemuError> {
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
            if let Some(output) = self.wait_for_exit(Duration::ZERO) {
                return Err(QemuError::ExitedAtStart(output));
            }
            if Instant::now() >= deadline {
                return Err(QemuError::NotConnected(line.name, self.messages()));
            }
            thread::sleep(Duration::from_millis(2));
        }
    }

    /// Returns true if the emulator still runs.
    pub fn is_running(&mut self) -> bool {
        matches!(self.child.try_wait(), Ok(None))
    }

    /// Returns all of QEMU's own output if QEMU ends within `patience`. The connections to QEMU break some moments
    /// before QEMU ends.
    pub fn wait_for_exit(&mut self, patience: Duration) -> Option<String> {
        let deadline = Instant::now() + patience;
        while self.is_running() {
            if Instant::now() >= deadline {
                return None;
            }
            thread::sleep(Duration::from_millis(2));
        }
        if let Some(listener) = self.listener.take() {
            // The thread cannot have panicked, and its output is stored in any case.
            let _ = listener.join();
        }
        Some(self.messages())
    }

    /// Kills the emulator, and waits for its end.
    pub fn kill(&mut self) {
        // Both fail only if the emulator has ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }

    /// Returns QEMU's own output so far.
    pub fn messages(&self) -> String {
        self.messages.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }
}

impl Drop for Qemu {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Returns the command of QEMU. If util-linux's `setpriv` is installed, the system ends QEMU with this program, however
/// this program ends.
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
    let text = String::from_utf8_lossy(&output.stdout);
    let first = text.lines().next().unwrap_or_default();
    match major_version(first) {
        Some((major, _)) if major >= OLDEST => Ok(()),
        Some((_, version)) => Err(QemuError::TooOld(version.to_string())),
        None => Err(QemuError::UnknownVersion(first.to_string())),
    }
}

/// Returns the major version and the whole version from the first line of `qemu-system-arm --version`.
fn major_version(line: &str) -> Option<(u32, &str)> {
    let version = line.split_whitespace().skip_while(|word| *word != "version").nth(1)?;
    let major = version.split('.').next()?.parse().ok()?;
    Some((major, version))
}

/// The emulated board (QEMU's machine mps2-an386), its serial connection, and the memory that it shares with the
/// simulated tip.
///
/// QEMU is killed and the memory is removed when this value is dropped.
pub struct EmulatedBoard {
    // Fields are dropped in this order. The emulator is dropped before the file that it maps.
    qemu: Qemu,
    line: TcpStream,
    debugger: Option<Debugger>,
    tip: SharedMemoryFile,
}

impl EmulatedBoard {
    /// Starts the board with a firmware image. `tip` is the memory that the board shares with the simulated tip. The
    /// caller has written the values that the host supplies to this memory.
    ///
    /// In virtual time the board stops at its reset until [`EmulatedBoard::debugger`] runs it.
    pub fn start(firmware: &Path, tip: SharedMemoryFile, time: Time) -> Result<Self, QemuError> {
        let line = QemuSocket::open("serial line")?;
        let mut backend = OsString::from(format!("memory-backend-file,id=tip,share=on,size={},mem-path=", tip.size));
        backend.push(escape_commas(tip.path()));
        let mut arguments = vec!["-object".into(), backend, "-serial".into(), line.argument()?.into()];
        let debugger = match time {
            Time::Real => None,
            Time::Virtual => Some(QemuSocket::open("debugger's line")?),
        };
        if let Some(debugger) = &debugger {
            let device = debugger.character_device("debugger")?;
            let further = ["-chardev", &device, "-gdb", "chardev:debugger", "-S", "-icount", INSTRUCTIONS];
            arguments.extend(further.map(OsString::from));
        }
        let mut qemu = Qemu::start("mps2-an386,memory-backend=tip", firmware, arguments)?;
        let line = qemu.connect(&line)?;
        let debugger = debugger.map(|debugger| qemu.connect(&debugger)).transpose()?.map(Debugger::on);
        // QEMU has mapped the file, and this program keeps it open. Without a name, the file disappears when both have
        // ended.
        let _ = std::fs::remove_file(tip.path());
        Ok(EmulatedBoard { qemu, line, debugger, tip })
    }

    /// Returns the debugger that runs the board. Returns `None` in real time, or if an earlier call has returned the
    /// debugger.
    pub fn debugger(&mut self) -> Option<Debugger> {
        self.debugger.take()
    }

    /// Returns the board's serial connection.
    pub fn serial(&self) -> &TcpStream {
        &self.line
    }

    /// Returns the memory that the board shares with the simulated tip.
    pub fn tip(&self) -> &SharedMemoryFile {
        &self.tip
    }

    /// Returns the QEMU process.
    pub fn qemu(&mut self) -> &mut Qemu {
        &mut self.qemu
    }
}

/// Returns a path with all commas doubled, because a single comma ends a value in QEMU's options.
fn escape_commas(path: &Path) -> OsString {
    match path.to_str() {
        Some(text) => text.replace(',', ",,").into(),
        None => path.as_os_str().to_os_string(),
    }
}

/// File for the memory that the board and the simulated tip share. The file is removed when this value is dropped.
pub struct SharedMemoryFile {
    path: PathBuf,
    file: File,
    size: u64,
}

impl SharedMemoryFile {
    /// Creates a file of `size` zero bytes in `/dev/shm`, or in the temporary directory if `/dev/shm` does not exist.
    pub fn create(size: u64) -> Result<Self, QemuError> {
        let shared = Path::new("/dev/shm");
        let directory = if shared.is_dir() { shared.to_path_buf() } else { std::env::temp_dir() };
        Self::create_in(&directory, size)
    }

    /// Creates a file of `size` zero bytes in a directory.
    pub fn create_in(directory: &Path, size: u64) -> Result<Self, QemuError> {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        loop {
            let number = NEXT.fetch_add(1, Ordering::Relaxed);
            let path = directory.join(format!("growbot-tip-{}-{number}", std::process::id()));
            match OpenOptions::new().read(true).write(true).create_new(true).open(&path) {
                Ok(file) => {
                    let memory = SharedMemoryFile { path, file, size };
                    memory.file.set_len(size).map_err(doing("size the tip's memory"))?;
                    return Ok(memory);
                }
                // A killed process with the same process id has left the file.
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(QemuError::Io("create the tip's memory", error)),
            }
        }
    }

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the open file, to be mapped, or read and written in place.
    pub fn file(&self) -> &File {
        &self.file
    }
}

impl Drop for SharedMemoryFile {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_version_is_parsed_from_the_first_line_of_qemu() {
        let debian = "QEMU emulator version 10.0.2 (Debian 1:10.0.2+ds-2+deb13u1~bpo12+1)";
        assert_eq!(major_version(debian), Some((10, "10.0.2")));
        assert_eq!(major_version("QEMU emulator version 7.2.17"), Some((7, "7.2.17")));
        assert_eq!(major_version("bash: no such thing"), None);
        assert_eq!(major_version("version"), None);
    }

    #[test]
    fn the_tip_memory_file_is_deleted_with_its_owner() -> Result<(), QemuError> {
        let memory = SharedMemoryFile::create(4096)?;
        let path = memory.path().to_path_buf();
        assert_eq!(std::fs::metadata(&path).map(|file| file.len()).ok(), Some(4096));
        drop(memory);
        assert!(!path.exists());
        Ok(())
    }

    #[test]
    fn commas_in_paths_are_escaped() {
        assert_eq!(escape_commas(Path::new("/tmp/a,b")), "/tmp/a,,b");
    }
}
