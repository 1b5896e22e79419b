//! The robot's firmware in QEMU, connected to the simulated tip through shared memory.
//!
//! The simulated tip reads the motor steps from a ring buffer in the shared memory, heats its nozzle with the energy
//! that the board has counted, and writes the readings of its sensors into the memory.
//!
//! Time is virtual: it passes with the board's instructions, and only while the host waits. The board runs from one
//! poll of the tip to the next, so a slow machine does not change the result. With `GROWBOT_EMULATOR_TIME=real` the
//! board runs in real time, and a thread simulates the tip. The load of the machine then changes the timing of the
//! steps, but not the steps themselves.

use std::cell::RefCell;
use std::collections::VecDeque;
use std::fs::File;
use std::io::{self, ErrorKind, Read, Write};
use std::net::TcpStream;
use std::os::fd::AsRawFd;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::sync::{Arc, Mutex};
use std::thread;
use std::time::Duration;

use growbot_client::port::stream::Stream;
use growbot_client::port::{Port, PortError, time_since_boot};
use growbot_core::robot::{MAX_ENCODED_LEN, Robot};
use growbot_firmware::emulated_tip as table;

use super::debugger::Debugger;
use super::emulated_tip::{SharedFollowed, TipFollower, TipRegisters, TipThread, locked, tip_of};
use super::open_error::OpenError;
use super::qemu::{self, EmulatedBoard, QemuError, SharedMemoryFile, Time, doing};
use crate::image_seal;
use crate::simulated_tip::SimulatedTip;
use crate::tip::{IndexMark, TipFault, TipModel, encoder_pitch};

/// Interval of virtual time at which the simulated tip polls the shared memory. Each poll costs QEMU about 0.1 ms of
/// real time.
const VIRTUAL_LOOK: Duration = Duration::from_millis(5);
/// Smallest number of ticks between two stops of the emulated board, and number of ticks between two bytes that are
/// sent to the board. After a tick at which QEMU has stopped the board, the interrupt of the next tick follows
/// immediately. So a stop at every tick would leave the main loop no time.
const FEWEST_TICKS: u32 = 2;
/// Real time without a tick after which the board counts as stopped. The time that [`Emulator`] reports as the board's
/// clock then advances by this time.
const STANDING: Duration = Duration::from_secs(10);
/// Timeout for the exit of QEMU after its connection has broken.
const END: Duration = Duration::from_secs(1);
/// Name of the board in error messages.
const NAME: &str = "the emulated board";
/// Path of the firmware image for the emulated board (mps2-an386), relative to cargo's target directory.
pub const FIRMWARE_PATH: &str = "thumbv7em-none-eabihf/firmware/an386";

/// The robot's firmware in QEMU.
pub struct Emulator {
    // Fields are dropped in this order: first the readers of the memory, then the board and its memory.
    followed: Arc<Mutex<TipFollower>>,
    line: BoardLine,
    board: EmulatedBoard,
    /// Sealed copy of the firmware image. QEMU reads this file some time after QEMU's start, so the file is kept open.
    _image: Option<File>,
}

/// Connection to the board, in real time or in virtual time.
enum BoardLine {
    Real { stream: Stream, _player: TipThread },
    Virtual(Rc<RefCell<SteppedBoard>>),
}

impl Emulator {
    /// Starts QEMU with a firmware image and the description of `robot`. If `firmware` is `None`, the image in cargo's
    /// target directory is used.
    ///
    /// # Errors
    /// QEMU or the image is missing, or the board does not start.
    pub fn start(robot: &Robot, firmware: Option<&Path>) -> Result<Self, OpenError> {
        Self::start_with_flash(robot, firmware, &[])
    }

    /// Starts a board as after a loss of power: the flash of its journal has the content `flash`, which
    /// [`Emulator::cut_power`] has returned, and everything else is in its initial state.
    ///
    /// # Errors
    /// Those of [`Emulator::start`].
    pub fn start_with_flash(robot: &Robot, firmware: Option<&Path>, flash: &[u8]) -> Result<Self, OpenError> {
        robot.check_for_board().map_err(|error| OpenError::UnsupportedRobot(robot.name().to_owned(), error))?;
        let firmware = firmware.map_or_else(latest_firmware, Path::to_path_buf);
        let memory = SharedMemoryFile::create(table::SIZE as u64)?;
        prepare(&memory, robot)?;
        let flash = flash.get(..table::FLASH_AREA_BYTES).unwrap_or(flash);
        memory.file().write_all_at(flash, table::JOURNAL_FLASH as u64).map_err(doing("write the journal's flash"))?;
        let words = TipRegisters(memory.file().try_clone().map_err(doing("share the tip's memory"))?);
        // The image of the board is sealed in the same way as by `growbot flash`.
        let sealed = with_seal(&firmware)?;
        let image = sealed.as_ref().map_or(firmware, path_of);
        let mut board = EmulatedBoard::start(&image, memory, Time::of_environment())?;
        let line = board.serial().try_clone().map_err(doing("share the emulator's line"))?;
        let followed = Arc::new(Mutex::new(TipFollower::new(words, robot)));
        let line = match board.debugger() {
            Some(debugger) => {
                line.set_nonblocking(true).map_err(doing("set up the emulator's line"))?;
                let tick_hz = robot.description().motion.tick_hz;
                BoardLine::Virtual(Rc::new(RefCell::new(SteppedBoard::new(&followed, debugger, line, tick_hz))))
            }
            None => {
                let stream = Stream::over(NAME.to_string(), line).map_err(doing("set up the emulator's line"))?;
                BoardLine::Real { stream, _player: TipThread::start(&followed) }
            }
        };
        Ok(Self { followed, line, board, _image: sealed })
    }

    /// Injects a fault into the tip. The fault replaces an active fault of the same kind. The board's inputs show the
    /// fault after some milliseconds, at the next poll of the tip.
    pub fn inject(&mut self, fault: TipFault) {
        locked(&self.followed).tip.inject(fault);
    }

    /// Removes the active fault of the same kind as `fault`.
    pub fn clear_fault(&mut self, fault: TipFault) {
        locked(&self.followed).tip.clear_fault(fault);
    }

    /// Calls `what` with the simulated tip in its current state.
    pub fn simulated_tip(&mut self, what: impl FnOnce(&mut TipModel)) {
        what(&mut locked(&self.followed).tip);
    }

    /// Returns a handle of the simulated tip, from which a caller reads the layers that were really laid, to compare
    /// them with the board's report.
    pub fn tip_handle(&self) -> Box<dyn SimulatedTip> {
        Box::new(SharedFollowed(Arc::clone(&self.followed)))
    }

    /// Cuts the board's power, by killing QEMU. Returns the content of the flash of the board's journal, which survives
    /// the loss of power. The tip's state does not change.
    ///
    /// # Errors
    /// The flash cannot be read.
    pub fn cut_power(&mut self) -> Result<Vec<u8>, PortError> {
        self.board.qemu().kill();
        let mut flash = vec![0; table::FLASH_AREA_BYTES];
        let read = self.board.tip().file().read_exact_at(&mut flash, table::JOURNAL_FLASH as u64);
        read.map_err(|error| PortError::EmulatorFile("read the journal's flash", error))?;
        Ok(flash)
    }

    /// Returns the board's clock, with which a test lets time pass without using the connection.
    pub fn clock(&self) -> EmulatedClock {
        EmulatedClock(match &self.line {
            BoardLine::Real { .. } => None,
            BoardLine::Virtual(stepped) => Some(Rc::clone(stepped)),
        })
    }

    /// Returns the emulated board: its QEMU process, and the memory that the board shares with the simulated tip.
    pub fn board(&mut self) -> &mut EmulatedBoard {
        &mut self.board
    }
}

impl Emulator {
    /// Returns the error of a broken connection: an error with QEMU's output if QEMU has ended, and otherwise the error
    /// `broken`.
    fn explain_disconnect(&mut self, broken: PortError) -> PortError {
        match self.board.qemu().wait_for_exit(END) {
            Some(output) => qemu::ended_while_running(&output),
            None => broken,
        }
    }
}

impl Port for Emulator {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        let sent = match &mut self.line {
            BoardLine::Real { stream, .. } => stream.send(bytes),
            BoardLine::Virtual(stepped) => {
                stepped.borrow_mut().to_board.extend(bytes);
                Ok(())
            }
        };
        sent.map_err(|error| self.explain_disconnect(error))
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        let received = match &mut self.line {
            BoardLine::Real { stream, .. } => stream.receive(buffer, timeout),
            BoardLine::Virtual(stepped) => {
                let received = stepped.borrow_mut().receive(buffer, timeout);
                received.map_err(|error| PortError::Lost(NAME.to_string(), error))
            }
        };
        received.map_err(|error| self.explain_disconnect(error))
    }

    fn now(&self) -> Duration {
        match &self.line {
            BoardLine::Real { .. } => time_since_boot(),
            BoardLine::Virtual(stepped) => stepped.borrow().now(),
        }
    }

    /// Returns true if the board's clock can be compared with the host's clock. In real time it cannot: on a busy
    /// machine the emulated board misses interrupts of its timer, so its clock falls behind.
    fn has_comparable_clock(&self) -> bool {
        matches!(self.line, BoardLine::Virtual(_))
    }
}

/// Handle with which a caller lets time pass on the clock of an emulated board.
#[derive(Clone)]
pub struct EmulatedClock(Option<Rc<RefCell<SteppedBoard>>>);

impl EmulatedClock {
    /// Lets `time` pass on the board's clock. Bytes that the board sends are buffered until they are received.
    ///
    /// # Errors
    /// QEMU has ended.
    pub fn pass(&self, time: Duration) -> io::Result<()> {
        let Some(stepped) = &self.0 else {
            thread::sleep(time);
            return Ok(());
        };
        let mut stepped = stepped.borrow_mut();
        let deadline = stepped.now() + time;
        while stepped.now() < deadline {
            stepped.step(deadline)?;
        }
        Ok(())
    }
}

/// A board in virtual time, which runs from one poll of its tip to the next.
struct SteppedBoard {
    followed: Arc<Mutex<TipFollower>>,
    debugger: Debugger,
    line: TcpStream,
    to_board: VecDeque<u8>,
    from_board: VecDeque<u8>,
    /// Frequency of the board's clock, ticks per second.
    tick_hz: u32,
    /// Number of ticks since the emulator started, over all boots of the board.
    passed: u64,
    /// Time that was added to the board's clock while the emulated board was stopped.
    stood: Duration,
}

impl SteppedBoard {
    fn new(followed: &Arc<Mutex<TipFollower>>, debugger: Debugger, line: TcpStream, tick_hz: u32) -> Self {
        Self {
            followed: Arc::clone(followed),
            debugger,
            line,
            to_board: VecDeque::new(),
            from_board: VecDeque::new(),
            tick_hz,
            passed: 0,
            stood: Duration::ZERO,
        }
    }

    fn now(&self) -> Duration {
        let hz = u64::from(self.tick_hz.max(1));
        let nanoseconds = (self.passed % hz) * 1_000_000_000 / hz;
        Duration::from_secs(self.passed / hz) + Duration::from_nanos(nanoseconds) + self.stood
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> io::Result<usize> {
        let deadline = self.now() + timeout;
        while self.from_board.is_empty() && self.now() < deadline {
            self.step(deadline)?;
        }
        self.from_board.read(buffer)
    }

    /// Runs the board until the next poll of the tip, or until `deadline` if that is earlier.
    fn step(&mut self, deadline: Duration) -> io::Result<()> {
        // QEMU accepts one byte while the board is stopped.
        if let Some(byte) = self.to_board.pop_front() {
            self.line.write_all(&[byte])?;
        }
        let left = deadline.saturating_sub(self.now());
        let ticks = if self.to_board.is_empty() { self.ticks(left.min(VIRTUAL_LOOK)) } else { FEWEST_TICKS };
        let before = locked(&self.followed).clock()?;
        if !self.debugger.run_to((before as u32).wrapping_add(ticks), STANDING)? {
            self.stood += STANDING;
            return self.read();
        }
        let mut followed = locked(&self.followed);
        followed.sync()?;
        let after = followed.clock()?;
        drop(followed);
        // After a reset the clock counts from zero.
        self.passed += after.checked_sub(before).unwrap_or(after);
        self.read()
    }

    /// Converts a time to ticks, rounded up. The result is at least [`FEWEST_TICKS`] and less than the number of alarm
    /// words.
    fn ticks(&self, time: Duration) -> u32 {
        let ticks = (time.as_nanos() * u128::from(self.tick_hz)).div_ceil(1_000_000_000);
        (ticks as u32).clamp(FEWEST_TICKS, table::ALARM_WORDS - 1)
    }

    /// Reads all bytes that the board has sent into `from_board`.
    fn read(&mut self) -> io::Result<()> {
        let mut buffer = [0; 4096];
        loop {
            match self.line.read(&mut buffer) {
                Ok(0) => return Err(ErrorKind::UnexpectedEof.into()),
                Ok(count) => self.from_board.extend(buffer.iter().take(count)),
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(()),
                Err(error) => return Err(error),
            }
        }
    }
}

/// Returns a file with a sealed copy of a firmware image. Returns `None` if the image has a seal already, even a
/// damaged one, or cannot be sealed.
fn with_seal(firmware: &Path) -> Result<Option<File>, QemuError> {
    // Reading a pipe or a device could block.
    if !firmware.is_file() {
        return Err(QemuError::NoFirmware(firmware.to_path_buf()));
    }
    let image = std::fs::read(firmware).map_err(doing("read the firmware"))?;
    let sealed = match image_seal::seal(&image) {
        Ok(sealed) if !image_seal::is_sealed(&image) => sealed.bytes,
        _ => return Ok(None),
    };
    let copy = SharedMemoryFile::create(sealed.len() as u64)?;
    copy.file().write_all_at(&sealed, 0).map_err(doing("write the sealed image"))?;
    // The name of the file is removed with `copy`, so the file disappears however this program ends.
    copy.file().try_clone().map(Some).map_err(doing("keep the sealed image"))
}

/// Returns a path through which another program can open an open file, even if the file has no name any more.
fn path_of(file: &File) -> PathBuf {
    PathBuf::from(format!("/proc/{}/fd/{}", std::process::id(), file.as_raw_fd()))
}

/// Returns the path of the firmware image in the target directory that contains this program, or otherwise in `target`
/// of the working directory.
fn latest_firmware() -> PathBuf {
    let beside = std::env::current_exe().ok().and_then(|program| {
        // target/release/growbot, or target/debug/deps/some-test
        program.ancestors().map(|folder| folder.join(FIRMWARE_PATH)).find(|image| image.is_file())
    });
    beside.unwrap_or_else(|| Path::new("target").join(FIRMWARE_PATH))
}

/// Writes the values that the host supplies (index mark, encoder pitch, robot description, entropy) to the shared
/// memory before the board starts.
fn prepare(memory: &SharedMemoryFile, robot: &Robot) -> Result<(), QemuError> {
    let words = TipRegisters(memory.file().try_clone().map_err(doing("share the tip's memory"))?);
    let mark = IndexMark::of(robot);
    let mut buffer = [0; MAX_ENCODED_LEN];
    let machine = robot.encode(&mut buffer).unwrap_or_default();
    let write = |offset: usize, value: u32| words.write(offset, value).map_err(doing("write the tip's memory"));
    write(table::INDEX_STEPS_PER_TURN, mark.steps_per_turn)?;
    write(table::INDEX_POSITION, mark.position)?;
    write(table::INDEX_WIDTH, mark.width)?;
    write(table::ENTROPY, entropy())?;
    write(table::ROBOT_LENGTH, machine.len() as u32)?;
    words.0.write_all_at(machine, table::ROBOT as u64).map_err(doing("write the tip's memory"))?;
    write(table::ENCODER_PITCH, encoder_pitch(robot))?;
    words.show(&mut tip_of(robot)).map_err(doing("write the tip's memory"))
}

/// Returns a number that differs from run to run, as the emulated board's source of entropy.
fn entropy() -> u32 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    now.subsec_nanos() ^ std::process::id().rotate_left(16)
}
