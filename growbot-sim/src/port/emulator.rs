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
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use growbot_client::port::stream::Stream;
use growbot_client::port::{Port, PortError, time_since_boot};
use growbot_core::layer::Layer;
use growbot_core::robot::{MAX_ENCODED_LEN, Robot};
use growbot_firmware::emulated_tip as table;

use super::debugger::Debugger;
use super::open_error::OpenError;
use super::qemu::{EmulatedBoard, QemuError, SharedMemoryFile, Time, doing};
use crate::ground_truth::{LaidBody, SimulatedTip};
use crate::image_seal;
use crate::tip::manual_action::ManualAction;
use crate::tip::{IndexMark, Motor, TipFault, TipModel, Variation, encoder_pitch};

/// Interval at which the simulated tip polls the shared memory while the board runs in real time.
const TIP_POLL_INTERVAL: Duration = Duration::from_millis(1);
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
        read.map_err(doing("read the journal's flash"))?;
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
            Some(output) => QemuError::ExitedWhileRunning(output).into(),
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

/// Returns the simulated tip in its initial state. Its head is at position 0, because the emulated board counts the
/// head's steps from power-on and computes the level of the index sensor from this count.
fn tip_of(robot: &Robot) -> TipModel {
    TipModel::new(robot.clone(), 0, Variation::default())
}

/// Returns a number that differs from run to run, as the emulated board's source of entropy.
fn entropy() -> u32 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    now.subsec_nanos() ^ std::process::id().rotate_left(16)
}

/// The memory that the emulated board and the tip share, read and written as words.
struct TipRegisters(File);

impl TipRegisters {
    fn read(&self, offset: usize) -> io::Result<u32> {
        let mut bytes = [0; 4];
        self.0.read_exact_at(&mut bytes, offset as u64)?;
        Ok(u32::from_le_bytes(bytes))
    }

    /// Reads a counter that the board may be changing. The counter is read until two readings agree.
    fn read_counter(&self, offset: usize) -> io::Result<u32> {
        let mut value = self.read(offset)?;
        loop {
            let again = self.read(offset)?;
            if again == value {
                return Ok(value);
            }
            value = again;
        }
    }

    fn read_pair(&self, low: usize, high: usize) -> io::Result<u64> {
        loop {
            let before = self.read_counter(high)?;
            let value = u64::from(self.read_counter(low)?);
            if self.read_counter(high)? == before {
                return Ok(u64::from(before) << 32 | value);
            }
        }
    }

    fn write(&self, offset: usize, value: u32) -> io::Result<()> {
        self.0.write_all_at(&value.to_le_bytes(), offset as u64)
    }

    /// Writes the readings of the tip's sensors to the shared memory.
    fn show(&self, tip: &mut TipModel) -> io::Result<()> {
        self.show_converted(table::THERMISTOR_RAW, table::THERMISTOR_LIVE, tip.sample_thermistor())?;
        self.show_converted(table::SUPPLY_RAW, table::SUPPLY_LIVE, tip.sample_supply())?;
        self.write(table::FILAMENT_PRESENT, tip.has_filament().into())?;
        self.write(table::DRIVER_FAULT, tip.driver_fault().into())?;
        self.write(table::EMERGENCY_STOP, tip.is_emergency_stop_pressed().into())?;
        self.show_index(tip)?;
        let encoder = match (tip.filament_moves_with_feed(), tip.encoder()) {
            (true, _) => table::ENCODER_OK,
            (false, false) => table::ENCODER_STUCK_LOW,
            (false, true) => table::ENCODER_STUCK_HIGH,
        };
        self.write(table::ENCODER_STATE, encoder)?;
        self.show_encoder_mapping(tip)?;
        let gravity = tip.gravity();
        if let Some(gravity) = gravity {
            for (offset, part) in [table::GRAVITY_X, table::GRAVITY_Y, table::GRAVITY_Z].into_iter().zip(gravity) {
                self.write(offset, i32::from(part).cast_unsigned())?;
            }
        }
        self.write(table::GRAVITY_LIVE, gravity.is_some().into())
    }

    /// Writes the mapping from feed steps to the encoder's level, if the mapping has changed. The emulated board
    /// computes the level from its own feed steps.
    fn show_encoder_mapping(&self, tip: &mut TipModel) -> io::Result<()> {
        let (turned, seen_per_step) = tip.encoder_mapping();
        let slip = libm::rint((seen_per_step - 1.0) * 65_536.0) as i32;
        if slip.cast_unsigned() == self.read(table::ENCODER_SLIP)? {
            return Ok(());
        }
        let pitch = f64::from(encoder_pitch(tip.robot()).max(1));
        let phase = libm::rint((turned * 256.0).rem_euclid(pitch)) as u32;
        let sequence = self.read(table::ENCODER_SEQUENCE)?;
        self.write(table::ENCODER_SEQUENCE, sequence.wrapping_add(1))?;
        self.write(table::ENCODER_ORIGIN, tip.feed_position() as u32)?;
        self.write(table::ENCODER_PHASE, phase)?;
        self.write(table::ENCODER_SLIP, slip.cast_unsigned())?;
        self.write(table::ENCODER_SEQUENCE, sequence.wrapping_add(2))
    }

    fn show_converted(&self, raw: usize, live: usize, sample: Option<u16>) -> io::Result<()> {
        if let Some(sample) = sample {
            self.write(raw, sample.into())?;
        }
        self.write(live, sample.is_some().into())
    }

    /// Writes the index mark's position. The emulated board computes the level of its index sensor from the head's
    /// commanded steps, so the written position is corrected by the steps that the head has slipped. If a fault makes
    /// the level independent of the steps, the constant level is written as a fault of the sensor.
    fn show_index(&self, tip: &TipModel) -> io::Result<()> {
        let mark = IndexMark::of(tip.robot());
        let position = (i64::from(mark.position) - tip.head_slip()).rem_euclid(i64::from(mark.steps_per_turn));
        self.write(table::INDEX_POSITION, position as u32)?;
        let fault = match (tip.index_follows(), tip.on_index()) {
            (true, _) => table::INDEX_FAULT_NONE,
            // The emulated sensor pulls its output low on the mark.
            (false, true) => table::INDEX_FAULT_STUCK_LOW,
            (false, false) => table::INDEX_FAULT_STUCK_HIGH,
        };
        self.write(table::INDEX_FAULT, fault)
    }
}

/// The simulated tip, and the state of the shared memory at the latest poll.
struct TipFollower {
    words: TipRegisters,
    tip: TipModel,
    boots: u32,
    /// Clock of the tip at the board's latest start, ticks.
    boot_tick: u64,
    steps_read: u32,
    /// Tick of the latest step, counted from the board's latest start.
    step_tick: u64,
    /// Clock of the board at the latest poll, ticks since the board's latest start.
    ticks: u64,
    energy: u64,
    lost_steps: u32,
}

impl TipFollower {
    fn new(words: TipRegisters, robot: &Robot) -> Self {
        Self {
            words,
            tip: tip_of(robot),
            boots: 0,
            boot_tick: 0,
            steps_read: 0,
            step_tick: 0,
            ticks: 0,
            energy: 0,
            lost_steps: 0,
        }
    }

    /// Returns the board's clock: ticks since its start.
    fn clock(&self) -> io::Result<u64> {
        self.words.read_pair(table::TICKS_LO, table::TICKS_HI)
    }

    /// Applies the motor steps and the heating of the board since the latest poll to the tip, and writes the tip's
    /// sensor readings to the shared memory.
    fn sync(&mut self) -> io::Result<()> {
        if self.words.read(table::MAGIC)? != table::MAGIC_VALUE {
            return Ok(()); // not booted yet
        }
        let boots = self.words.read_counter(table::BOOTS)?;
        if boots != self.boots {
            // The board has restarted, and its clock too.
            self.step(self.words.read_counter(table::BOOT_WRITE_INDEX)?)?;
            (self.boots, self.boot_tick) = (boots, self.tip.now());
            (self.step_tick, self.ticks, self.energy) = (0, 0, 0);
        }
        self.step(self.words.read_counter(table::STEP_WRITE_INDEX)?)?;
        self.warm()?;
        self.words.show(&mut self.tip)
    }

    /// Advances the tip to the board's clock, with the mean heating power since the latest poll.
    fn warm(&mut self) -> io::Result<()> {
        let ticks = self.clock()?;
        let energy = self.words.read_pair(table::HEATER_ENERGY_LO, table::HEATER_ENERGY_HI)?;
        let enabled = self.words.read(table::HEATER_ENABLE)? == 1;
        let duty = self.words.read(table::HEATER_DUTY)?;
        // Both are zero while a board restarts.
        let (passed, gained) = (ticks.saturating_sub(self.ticks), energy.saturating_sub(self.energy));
        if passed > 0 {
            // The heat is the energy that the board has counted, however rarely this polls. The duty word is only for a
            // broken switch.
            let mean = if gained > 0 { gained as f64 / passed as f64 } else { f64::from(duty) };
            self.tip.set_heater((mean / f64::from(u16::MAX)).min(1.0), enabled || gained > 0);
            self.tip
                .set_fan(f64::from(self.words.read(table::FAN_DUTY)?.min(u32::from(u16::MAX))) / f64::from(u16::MAX));
            self.tip.set_enabled(Motor::Head, self.words.read(table::HEAD_ENABLE)? == 1);
            self.tip.set_enabled(Motor::Feed, self.words.read(table::FEED_ENABLE)? == 1);
            self.tip.advance(self.boot_tick + ticks);
            (self.ticks, self.energy) = (ticks, energy);
        }
        Ok(())
    }

    /// Applies the recorded motor steps to the tip, from the running index `steps_read` up to but excluding `written`.
    fn step(&mut self, written: u32) -> io::Result<()> {
        while self.steps_read != written {
            // Reads as many records as are contiguous in the ring.
            let at = table::step_record_offset(self.steps_read);
            let to_end = (table::STEP_RING + 4 * table::STEP_RING_RECORDS as usize - at) / 4;
            let count = (written.wrapping_sub(self.steps_read) as usize).min(to_end).min(4096);
            let mut bytes = vec![0; 4 * count];
            self.words.0.read_exact_at(&mut bytes, at as u64)?;
            let (records, _) = bytes.as_chunks::<4>();
            for record in records {
                let record = table::StepRecord::from_word(u32::from_le_bytes(*record));
                let motor = match record.axis {
                    table::RecordedMotor::Head => Motor::Head,
                    table::RecordedMotor::Feed => Motor::Feed,
                };
                self.tip.set_enabled(motor, record.enabled);
                self.tip.set_direction(motor, record.forward);
                self.step_tick = record.tick_after(self.step_tick);
                self.tip.advance(self.boot_tick + self.step_tick);
                self.tip.step(motor);
            }
            self.steps_read = self.steps_read.wrapping_add(count as u32);
            self.words.write(table::STEP_READ_INDEX, self.steps_read)?;
        }
        self.lost_steps = self.words.read(table::STEP_OVERRUN)?;
        Ok(())
    }
}

fn locked(followed: &Mutex<TipFollower>) -> MutexGuard<'_, TipFollower> {
    followed.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The thread that simulates the tip in real time.
struct TipThread {
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl TipThread {
    fn start(followed: &Arc<Mutex<TipFollower>>) -> Self {
        let over = Arc::new(AtomicBool::new(false));
        let thread = thread::spawn({
            let (followed, over) = (Arc::clone(followed), Arc::clone(&over));
            move || {
                while !over.load(Ordering::Relaxed) {
                    // A memory that cannot be read is reported when the record is read.
                    let _ = locked(&followed).sync();
                    thread::sleep(TIP_POLL_INTERVAL);
                }
            }
        });
        Self { over, thread: Some(thread) }
    }
}

/// The simulated tip that follows the emulated board, shared with the thread that updates it. The body that was really
/// laid is read through it, for comparison with the board's report.
struct SharedFollowed(Arc<Mutex<TipFollower>>);

impl SimulatedTip for SharedFollowed {
    fn laid(&mut self) -> Result<LaidBody, PortError> {
        let mut followed = locked(&self.0);
        followed.sync().map_err(|error| QemuError::Io("read the tip's memory", error))?;
        if followed.lost_steps > 0 {
            let what = format!("{} steps were lost before the tip could read them", followed.lost_steps);
            return Err(PortError::Lost("the emulated tip".to_string(), io::Error::other(what)));
        }
        Ok(LaidBody { body: followed.tip.body(), feed_steps: followed.tip.feed_steps() })
    }

    fn settled(&mut self, from: usize) -> Vec<Layer> {
        locked(&self.0).tip.settled(from).to_vec()
    }

    fn apply_action(&mut self, hand: ManualAction) -> bool {
        locked(&self.0).tip.apply_action(hand);
        true
    }
}

impl Drop for TipThread {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
