//! The robot's firmware in QEMU, with the simulated tip behind the memory that both share.
//!
//! The tip takes the steps out of the ring, warms the nozzle by the energy that the board has counted, and writes what
//! the sensors show.
//!
//! Time is virtual: it passes by the board's instructions, and only while the host waits. The board runs from one look
//! of the tip to the next, so that a slow machine changes nothing. With `GROWBOT_EMULATOR_TIME=real` the board runs in
//! real time, and a thread plays the tip: then the machine's load stretches time and changes no step.

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
use growbot_client::port::{Port, PortError, real_time};
use growbot_core::layer::Layer;
use growbot_core::robot::{MAX_ENCODED_LEN, Robot};
use growbot_firmware::emulated_tip as table;

use super::OpenError;
use super::debugger::Debugger;
use super::qemu::{EmulatedRobot, QemuError, Time, TipMemory, doing};
use crate::image_seal;
use crate::tip::hand::Hand;
use crate::tip::{IndexMark, Motor, Tip, TipFault, Variation, encoder_pitch};
use crate::truth::{Laid, Simulation};

/// How often the tip looks at its memory in real time.
const LOOK: Duration = Duration::from_millis(1);
/// How often it does in virtual time, where each look costs QEMU some 0.1 ms.
const VIRTUAL_LOOK: Duration = Duration::from_millis(5);
/// The fewest ticks from stop to stop, and the ticks from one byte to the board to the next. The interrupt of a tick at
/// which QEMU has stopped the board is followed at once by the next one, so a stop at every tick would leave the main
/// loop no time.
const FEWEST_TICKS: u32 = 2;
/// The clock of a board that reaches no tick for so long in real time stands: real time passes instead.
const STANDING: Duration = Duration::from_secs(10);
/// How long QEMU may take to end once its line has broken.
const END: Duration = Duration::from_secs(1);
/// How errors name the board.
const NAME: &str = "the emulated board";
/// Where the firmware image lies, from cargo's target directory.
pub const FIRMWARE: &str = "thumbv7em-none-eabihf/firmware/an386";

/// The robot's firmware in QEMU.
pub struct Emulator {
    // The order is the one they are dropped in: first what reads the memory, then the board and its memory.
    followed: Arc<Mutex<Followed>>,
    line: BoardLine,
    board: EmulatedRobot,
    /// The sealed copy of the image: QEMU reads it some time after its start.
    _image: Option<File>,
}

/// The line to the board, and how its time passes.
enum BoardLine {
    Real { stream: Stream, _player: Player },
    Virtual(Rc<RefCell<Stepped>>),
}

impl Emulator {
    /// Starts QEMU with a firmware image (the one that was built last where none is given) and a robot's description.
    ///
    /// # Errors
    /// QEMU or the image are missing, or the board does not start.
    pub fn start(robot: &Robot, firmware: Option<&Path>) -> Result<Self, OpenError> {
        Self::start_with_flash(robot, firmware, &[])
    }

    /// Starts a board whose power has been gone: with the flash of its journal, from [`Emulator::cut_power`]. All else
    /// is as at first.
    ///
    /// # Errors
    /// As [`Emulator::start`].
    pub fn start_with_flash(robot: &Robot, firmware: Option<&Path>, flash: &[u8]) -> Result<Self, OpenError> {
        robot.check_for_board().map_err(|error| OpenError::NoBoard(robot.name().to_owned(), error))?;
        let firmware = firmware.map_or_else(built_last, Path::to_path_buf);
        let memory = TipMemory::create(table::SIZE as u64)?;
        prepare(&memory, robot)?;
        let flash = flash.get(..table::JOURNAL_CAPACITY).unwrap_or(flash);
        memory.file().write_all_at(flash, table::JOURNAL as u64).map_err(doing("write the journal's flash"))?;
        let words = Words(memory.file().try_clone().map_err(doing("share the tip's memory"))?);
        // The board gets its image sealed, as `growbot flash` does it.
        let sealed = with_seal(&firmware)?;
        let image = sealed.as_ref().map_or(firmware, path_of);
        let mut board = EmulatedRobot::start(&image, memory, Time::of_environment())?;
        let line = board.line().try_clone().map_err(doing("share the emulator's line"))?;
        let followed = Arc::new(Mutex::new(Followed::new(words, robot)));
        let line = match board.debugger() {
            Some(debugger) => {
                line.set_nonblocking(true).map_err(doing("set up the emulator's line"))?;
                let tick_hz = robot.description().motion.tick_hz;
                BoardLine::Virtual(Rc::new(RefCell::new(Stepped::new(&followed, debugger, line, tick_hz))))
            }
            None => {
                let stream = Stream::over(NAME.to_string(), line).map_err(doing("set up the emulator's line"))?;
                BoardLine::Real { stream, _player: Player::start(&followed) }
            }
        };
        Ok(Self { followed, line, board, _image: sealed })
    }

    /// Breaks something on the tip; a fault of the same kind is replaced. The board sees it within some milliseconds.
    pub fn inject(&mut self, fault: TipFault) {
        locked(&self.followed).tip.inject(fault);
    }

    /// Mends the fault of this one's kind.
    pub fn mend(&mut self, fault: TipFault) {
        locked(&self.followed).tip.mend(fault);
    }

    /// Does something with the tip at this moment.
    pub fn simulated_tip(&mut self, what: impl FnOnce(&mut Tip)) {
        what(&mut locked(&self.followed).tip);
    }

    /// The tip, for comparing a growth with what it has really laid.
    #[must_use]
    pub fn simulation(&self) -> Box<dyn Simulation> {
        Box::new(SharedFollowed(Arc::clone(&self.followed)))
    }

    /// Cuts the board's power at this moment. What is left is the flash of its journal; the tip stays as it is.
    ///
    /// # Errors
    /// The flash cannot be read.
    pub fn cut_power(&mut self) -> Result<Vec<u8>, PortError> {
        self.board.qemu().kill();
        let mut flash = vec![0; table::JOURNAL_CAPACITY];
        let read = self.board.tip().file().read_exact_at(&mut flash, table::JOURNAL as u64);
        read.map_err(doing("read the journal's flash"))?;
        Ok(flash)
    }

    /// The clock of this board, for a test that waits for it without its line.
    #[must_use]
    pub fn clock(&self) -> BoardClock {
        BoardClock(match &self.line {
            BoardLine::Real { .. } => None,
            BoardLine::Virtual(stepped) => Some(Rc::clone(stepped)),
        })
    }

    /// The emulator and the memory of its tip.
    pub fn board(&mut self) -> &mut EmulatedRobot {
        &mut self.board
    }
}

impl Emulator {
    /// Why the line broke: because QEMU ended, if it did.
    fn why(&mut self, broken: PortError) -> PortError {
        match self.board.qemu().last_words(END) {
            Some(said) => QemuError::Died(said).into(),
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
        sent.map_err(|error| self.why(error))
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        let received = match &mut self.line {
            BoardLine::Real { stream, .. } => stream.receive(buffer, timeout),
            BoardLine::Virtual(stepped) => {
                let received = stepped.borrow_mut().receive(buffer, timeout);
                received.map_err(|error| PortError::Lost(NAME.to_string(), error.to_string()))
            }
        };
        received.map_err(|error| self.why(error))
    }

    fn now(&self) -> Duration {
        match &self.line {
            BoardLine::Real { .. } => real_time(),
            BoardLine::Virtual(stepped) => stepped.borrow().now(),
        }
    }

    /// In real time the board counts the interrupts of its timer, some of which a busy machine lets pass.
    fn compares_clocks(&self) -> bool {
        matches!(self.line, BoardLine::Virtual(_))
    }
}

/// The clock of an emulated board.
#[derive(Clone)]
pub struct BoardClock(Option<Rc<RefCell<Stepped>>>);

impl BoardClock {
    /// Lets so much of the board's time pass. What the board sends waits to be received.
    ///
    /// # Errors
    /// QEMU is gone.
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

/// A board in virtual time, which runs from look to look of its tip.
struct Stepped {
    followed: Arc<Mutex<Followed>>,
    debugger: Debugger,
    line: TcpStream,
    to_board: VecDeque<u8>,
    from_board: VecDeque<u8>,
    /// Ticks a second.
    tick_hz: u32,
    /// Ticks of all boots that have passed.
    passed: u64,
    /// Real time that has passed while the board's clock stood.
    stood: Duration,
}

impl Stepped {
    fn new(followed: &Arc<Mutex<Followed>>, debugger: Debugger, line: TcpStream, tick_hz: u32) -> Self {
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

    /// Has the board run to the next look of the tip, or until a time.
    fn step(&mut self, deadline: Duration) -> io::Result<()> {
        // QEMU takes in one byte while the board stands.
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
        followed.look()?;
        let after = followed.clock()?;
        drop(followed);
        // After a reset it counts from zero.
        self.passed += after.checked_sub(before).unwrap_or(after);
        self.read()
    }

    /// The ticks of a time, rounded up: at least [`FEWEST_TICKS`].
    fn ticks(&self, time: Duration) -> u32 {
        let ticks = (time.as_nanos() * u128::from(self.tick_hz)).div_ceil(1_000_000_000);
        (ticks as u32).clamp(FEWEST_TICKS, table::ALARM_WORDS - 1)
    }

    /// Takes what the board has sent.
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

/// A copy of an image with its seal, where it has none: one that is sealed is taken as it is, damaged or not.
fn with_seal(firmware: &Path) -> Result<Option<File>, QemuError> {
    // A pipe or a device would be waited for.
    if !firmware.is_file() {
        return Err(QemuError::NoFirmware(firmware.to_path_buf()));
    }
    let image = std::fs::read(firmware).map_err(doing("read the firmware"))?;
    let sealed = match image_seal::seal(&image) {
        Ok(sealed) if !image_seal::is_sealed(&image) => sealed.bytes,
        _ => return Ok(None),
    };
    let copy = TipMemory::create(sealed.len() as u64)?;
    copy.file().write_all_at(&sealed, 0).map_err(doing("write the sealed image"))?;
    // Its name goes with `copy`, so that it is gone however we end.
    copy.file().try_clone().map(Some).map_err(doing("keep the sealed image"))
}

/// A path by which another program finds an open file, with or without a name of its own.
fn path_of(file: &File) -> PathBuf {
    PathBuf::from(format!("/proc/{}/fd/{}", std::process::id(), file.as_raw_fd()))
}

/// The firmware image that was built last: beside this program, or in the working directory's `target`.
fn built_last() -> PathBuf {
    let beside = std::env::current_exe().ok().and_then(|program| {
        // target/release/growbot, or target/debug/deps/some-test
        program.ancestors().map(|folder| folder.join(FIRMWARE)).find(|image| image.is_file())
    });
    beside.unwrap_or_else(|| Path::new("target").join(FIRMWARE))
}

/// Writes the host's words before the board starts.
fn prepare(memory: &TipMemory, robot: &Robot) -> Result<(), QemuError> {
    let words = Words(memory.file().try_clone().map_err(doing("share the tip's memory"))?);
    let mark = IndexMark::of(robot);
    let mut buffer = [0; MAX_ENCODED_LEN];
    let machine = robot.encode(&mut buffer).unwrap_or_default();
    let write = |offset: usize, value: u32| words.write(offset, value).map_err(doing("write the tip's memory"));
    write(table::INDEX_STEPS_PER_TURN, mark.steps_per_turn)?;
    write(table::INDEX_POSITION, mark.position)?;
    write(table::INDEX_WIDTH, mark.width)?;
    write(table::ENTROPY, entropy())?;
    write(table::MACHINE_LENGTH, machine.len() as u32)?;
    words.0.write_all_at(machine, table::MACHINE as u64).map_err(doing("write the tip's memory"))?;
    write(table::ENCODER_PITCH, encoder_pitch(robot))?;
    words.show(&mut tip_of(robot)).map_err(doing("write the tip's memory"))
}

/// The tip at first. The board counts its head from where it stands when it is switched on, and places the index mark
/// there too.
fn tip_of(robot: &Robot) -> Tip {
    Tip::new(robot.clone(), 0, Variation::default())
}

/// A number that differs from run to run.
fn entropy() -> u32 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    now.subsec_nanos() ^ std::process::id().rotate_left(16)
}

/// The words of the tip's memory.
struct Words(File);

impl Words {
    fn read(&self, offset: usize) -> io::Result<u32> {
        let mut bytes = [0; 4];
        self.0.read_exact_at(&mut bytes, offset as u64)?;
        Ok(u32::from_le_bytes(bytes))
    }

    /// A counter that the board may be changing: read until two readings agree.
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

    /// Writes what the tip's sensors show.
    fn show(&self, tip: &mut Tip) -> io::Result<()> {
        self.show_converted(table::THERMISTOR_RAW, table::THERMISTOR_LIVE, tip.sample_thermistor())?;
        self.show_converted(table::SUPPLY_RAW, table::SUPPLY_LIVE, tip.sample_supply())?;
        self.write(table::FILAMENT_PRESENT, tip.has_filament().into())?;
        self.write(table::DRIVER_FAULT, tip.driver_fault().into())?;
        self.write(table::EMERGENCY_STOP, tip.emergency_stop().into())?;
        self.show_index(tip)?;
        let encoder = match (tip.filament_follows(), tip.encoder()) {
            (true, _) => table::ENCODER_TURNS,
            (false, false) => table::ENCODER_STANDS_LOW,
            (false, true) => table::ENCODER_STANDS_HIGH,
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

    /// Tells the board how its encoder continues from the tip's latest step, whenever that changes: the board computes
    /// the level from its own steps.
    fn show_encoder_mapping(&self, tip: &mut Tip) -> io::Result<()> {
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

    /// The board computes the level of its index sensor from its own steps: this tells it how far those are from the
    /// truth, and the level itself where that no longer depends on them.
    fn show_index(&self, tip: &Tip) -> io::Result<()> {
        let mark = IndexMark::of(tip.robot());
        let position = (i64::from(mark.position) - tip.head_slip()).rem_euclid(i64::from(mark.steps_per_turn));
        self.write(table::INDEX_POSITION, position as u32)?;
        let fault = match (tip.index_follows(), tip.on_index()) {
            (true, _) => table::INDEX_FAULT_NONE,
            // The emulated sensor pulls its line low on the mark.
            (false, true) => table::INDEX_FAULT_STUCK_LOW,
            (false, false) => table::INDEX_FAULT_STUCK_HIGH,
        };
        self.write(table::INDEX_FAULT, fault)
    }
}

/// The tip and how far its memory has been followed.
struct Followed {
    words: Words,
    tip: Tip,
    boots: u32,
    /// The tip's clock when the board last started, ticks.
    boot_tick: u64,
    steps_read: u32,
    /// Tick of the latest step, since that start.
    step_tick: u64,
    /// The board's clock at the latest look.
    ticks: u64,
    energy: u64,
    lost_steps: u32,
}

impl Followed {
    fn new(words: Words, robot: &Robot) -> Self {
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

    /// The board's clock: ticks since it started.
    fn clock(&self) -> io::Result<u64> {
        self.words.read_pair(table::TICKS_LO, table::TICKS_HI)
    }

    /// Takes what the board has done since the last look, and shows it what the sensors see.
    fn look(&mut self) -> io::Result<()> {
        if self.words.read(table::MAGIC)? != table::MAGIC_VALUE {
            return Ok(()); // not booted yet
        }
        let boots = self.words.read_counter(table::BOOTS)?;
        if boots != self.boots {
            // The board has started anew: its clock too.
            self.step(self.words.read_counter(table::BOOT_WRITE_INDEX)?)?;
            (self.boots, self.boot_tick) = (boots, self.tip.now());
            (self.step_tick, self.ticks, self.energy) = (0, 0, 0);
        }
        self.step(self.words.read_counter(table::STEP_WRITE_INDEX)?)?;
        self.warm()?;
        self.words.show(&mut self.tip)
    }

    /// Lets time pass up to the board's present, with the power that it gave in that time.
    fn warm(&mut self) -> io::Result<()> {
        let ticks = self.clock()?;
        let energy = self.words.read_pair(table::HEATER_ENERGY_LO, table::HEATER_ENERGY_HI)?;
        let enabled = self.words.read(table::HEATER_ENABLE)? == 1;
        let duty = self.words.read(table::HEATER_DUTY)?;
        // Both are zero in a board that is just starting anew.
        let (passed, gained) = (ticks.saturating_sub(self.ticks), energy.saturating_sub(self.energy));
        if passed > 0 {
            // What it got is what the board has counted, however rarely this looks; the word is for a switch that is
            // broken.
            let mean = if gained > 0 { gained as f64 / passed as f64 } else { f64::from(duty) };
            self.tip.heat((mean / f64::from(u16::MAX)).min(1.0), enabled || gained > 0);
            self.tip.blow(f64::from(self.words.read(table::FAN_DUTY)?.min(u32::from(u16::MAX))) / f64::from(u16::MAX));
            self.tip.enable(Motor::Head, self.words.read(table::HEAD_ENABLE)? == 1);
            self.tip.enable(Motor::Feed, self.words.read(table::FEED_ENABLE)? == 1);
            self.tip.advance(self.boot_tick + ticks);
            (self.ticks, self.energy) = (ticks, energy);
        }
        Ok(())
    }

    /// Makes the steps up to a running index.
    fn step(&mut self, written: u32) -> io::Result<()> {
        while self.steps_read != written {
            // As many records as lie in one piece of the ring.
            let at = table::step_record_offset(self.steps_read);
            let to_end = (table::STEP_RING + 4 * table::STEP_RING_RECORDS as usize - at) / 4;
            let count = (written.wrapping_sub(self.steps_read) as usize).min(to_end).min(4096);
            let mut bytes = vec![0; 4 * count];
            self.words.0.read_exact_at(&mut bytes, at as u64)?;
            let (records, _) = bytes.as_chunks::<4>();
            for record in records {
                let record = table::StepRecord::from_word(u32::from_le_bytes(*record));
                let motor = match record.axis {
                    table::Axis::Head => Motor::Head,
                    table::Axis::Feed => Motor::Feed,
                };
                self.tip.enable(motor, record.enabled);
                self.tip.direct(motor, record.forward);
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

fn locked(followed: &Mutex<Followed>) -> MutexGuard<'_, Followed> {
    followed.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The thread that plays the tip in real time.
struct Player {
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Player {
    fn start(followed: &Arc<Mutex<Followed>>) -> Self {
        let over = Arc::new(AtomicBool::new(false));
        let thread = thread::spawn({
            let (followed, over) = (Arc::clone(followed), Arc::clone(&over));
            move || {
                while !over.load(Ordering::Relaxed) {
                    // A memory that cannot be read shows when the record is asked for.
                    let _ = locked(&followed).look();
                    thread::sleep(LOOK);
                }
            }
        });
        Self { over, thread: Some(thread) }
    }
}

/// The tip, for who compares a growth with it.
struct SharedFollowed(Arc<Mutex<Followed>>);

impl Simulation for SharedFollowed {
    fn laid(&mut self) -> Result<Laid, PortError> {
        let mut followed = locked(&self.0);
        followed.look().map_err(|error| QemuError::Io("read the tip's memory", error))?;
        if followed.lost_steps > 0 {
            let what = format!("{} steps were lost before the tip could read them", followed.lost_steps);
            return Err(PortError::Lost("the emulated tip".to_string(), what));
        }
        Ok(Laid { body: followed.tip.body(), feed_steps: followed.tip.feed_steps() })
    }

    fn settled(&mut self, from: usize) -> Vec<Layer> {
        locked(&self.0).tip.settled(from).to_vec()
    }

    fn by_hand(&mut self, hand: Hand) -> bool {
        locked(&self.0).tip.by_hand(hand);
        true
    }
}

impl Drop for Player {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}
