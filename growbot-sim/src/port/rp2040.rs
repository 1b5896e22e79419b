//! The firmware of a Pico in the emulator `rp2040js`, against the simulated tip: they meet at the pins.
//!
//! Node runs the image (`tests/rp2040/bench.js`, which describes the messages). The tip gets the edges of the steps and
//! of the enable signals, and the shares of each millisecond in which heater and fan were on. The board gets what the
//! tip's sensors show, as levels of pins and as voltages at its converter.
//!
//! Time is virtual. It passes only while the host waits, and every run of the same job is the same. Both sides go in
//! lock-step: the emulator stops at the first step after which a sensor could show something else, and after a
//! millisecond at the latest.

mod bench;

use std::cell::{RefCell, RefMut};
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Duration;

use growbot_client::port::{Port, PortError};
use growbot_core::robot::{Board, BoardKind, DigitalInput, PinOverrides, Robot};

use super::OpenError;
use bench::{Answer, Bench, Edge, Output, Run, State};
pub use bench::{BenchError, Crash};

use crate::tip::pins::SharedTip;
use crate::tip::{Motor, Tip, TipFault, Variation};
use crate::truth::Simulation;

/// Where the firmware image lies, from cargo's target directory.
pub const FIRMWARE: &str = "thumbv6m-none-eabi/firmware/pico";
/// The longest time without an exchange, ns.
const EXCHANGE_NS: u64 = 1_000_000;
/// Where the head stands at first, in head steps from the tip's x axis: anywhere, so that homing has something to do.
const HEAD_AT_FIRST: i64 = -137;

/// The line between host and board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Line {
    /// The UART.
    #[default]
    Uart,
    /// The serial port over USB.
    Usb,
}

impl Line {
    /// As the script has it.
    fn name(self) -> &'static str {
        match self {
            Self::Uart => "uart",
            Self::Usb => "usb",
        }
    }
}

/// A Pico in an emulator.
pub struct Rp2040 {
    bench: Bench,
    tip: SharedTip,
    levels: Levels,
    tick_hz: u64,
    /// Time since the power came on, ns.
    now_ns: u64,
    powered: Powered,
    to_board: Vec<u8>,
    from_board: VecDeque<u8>,
    instructions: u64,
    resets: u32,
    flash_changed: u32,
    lost_power: bool,
}

/// Which levels of the pins mean what.
#[derive(Debug, Clone, Copy)]
struct Levels {
    index_low_on_mark: bool,
    presence_low: bool,
    driver_fault_low: bool,
    emergency_stop_low: bool,
    enable_low: bool,
    head_high_is_positive: bool,
    feed_high_is_forward: bool,
}

impl Levels {
    fn of(robot: &Robot) -> Self {
        let description = robot.description();
        let active_low = |input: Option<DigitalInput>| input.is_some_and(|input| input.active_low);
        Self {
            index_low_on_mark: description.head.index_low_on_mark,
            presence_low: active_low(description.sensors.filament_presence),
            driver_fault_low: active_low(description.sensors.driver_fault),
            emergency_stop_low: active_low(description.sensors.emergency_stop),
            enable_low: description.motion.enable_low,
            head_high_is_positive: description.head.direction_high_is_positive,
            feed_high_is_forward: description.feed.direction_high_is_forward,
        }
    }

    /// What the tip's sensors put to the pins, in the order of the messages.
    fn of_sensors(&self, tip: &Tip) -> [bool; 5] {
        [
            tip.on_index() != self.index_low_on_mark,
            tip.encoder(),
            tip.has_filament() != self.presence_low,
            tip.driver_fault() != self.driver_fault_low,
            tip.emergency_stop() != self.emergency_stop_low,
        ]
    }
}

/// For how long heater and fan were on, ns, of a time.
#[derive(Debug, Clone, Copy, Default)]
struct Powered {
    time: f64,
    on: [f64; 2],
}

impl Powered {
    fn add(&mut self, time: f64, heater: f64, fan: f64) {
        self.time += time;
        self.on = [self.on[0] + heater, self.on[1] + fan];
    }

    /// Their shares of a time that is longer than a period of their PWM; then the next one begins.
    fn shares(&mut self) -> Option<[f64; 2]> {
        if self.time < EXCHANGE_NS as f64 {
            return None;
        }
        let Self { time, on } = std::mem::take(self);
        Some(on.map(|on| (on / time).min(1.0)))
    }
}

/// The robot's board: a Pico with its own pins, unless the description says otherwise.
fn board_of(robot: &Robot) -> Board {
    robot.description().board.unwrap_or(Board { kind: BoardKind::Pico, pins: PinOverrides::default() })
}

impl Rp2040 {
    /// Starts Node with a firmware image (the one that was built last where none is given) on a tip of this robot. The
    /// image must be that robot's: the board says at the first request if it is another's.
    ///
    /// # Errors
    /// Node, the emulator or the image are missing, or the board does not start.
    pub fn start(robot: &Robot, firmware: Option<&Path>) -> Result<Self, OpenError> {
        Self::start_with(robot, firmware, Variation::default())
    }

    /// The same with a tip that is not exactly as described.
    ///
    /// # Errors
    /// As [`Rp2040::start`].
    pub fn start_with(robot: &Robot, firmware: Option<&Path>, variation: Variation) -> Result<Self, OpenError> {
        Self::start_over(Line::Uart, robot, firmware, variation)
    }

    /// The same over one of the board's lines.
    ///
    /// # Errors
    /// As [`Rp2040::start`].
    pub fn start_over(
        line: Line,
        robot: &Robot,
        firmware: Option<&Path>,
        variation: Variation,
    ) -> Result<Self, OpenError> {
        robot.check_for_board().map_err(|error| OpenError::NoBoard(robot.name().to_owned(), error))?;
        let firmware = firmware.map_or_else(built_last, Path::to_path_buf);
        let bench = Bench::start(&firmware, &board_of(robot), line, None)?;
        Ok(Self::with(bench, robot, variation))
    }

    /// As [`Rp2040::start`]; what the step interrupt and the stack cost is written to a file every few seconds
    /// (`tests/rp2040/figures.js`).
    ///
    /// # Errors
    /// As [`Rp2040::start`].
    pub fn start_measured(robot: &Robot, firmware: &Path, figures: &Path) -> Result<Self, OpenError> {
        let bench = Bench::start(firmware, &board_of(robot), Line::Uart, Some(figures))?;
        Ok(Self::with(bench, robot, Variation::default()))
    }

    fn with(bench: Bench, robot: &Robot, variation: Variation) -> Self {
        Self {
            bench,
            tip: Rc::new(RefCell::new(Tip::new(robot.clone(), HEAD_AT_FIRST, variation))),
            levels: Levels::of(robot),
            tick_hz: u64::from(robot.description().motion.tick_hz),
            now_ns: 0,
            powered: Powered::default(),
            to_board: Vec::new(),
            from_board: VecDeque::new(),
            instructions: 0,
            resets: 0,
            flash_changed: 0,
            lost_power: false,
        }
    }

    /// The tip at this moment, with everything that can be known of it.
    pub fn simulated_tip(&mut self) -> RefMut<'_, Tip> {
        self.tip.borrow_mut()
    }

    /// The tip, for comparing a growth with what it has really laid.
    #[must_use]
    pub fn simulation(&self) -> Box<dyn Simulation> {
        Box::new(Rc::clone(&self.tip))
    }

    /// Breaks something; a fault of the same kind is replaced.
    pub fn inject(&mut self, fault: TipFault) {
        self.simulated_tip().inject(fault);
    }

    /// Mends the fault of this one's kind.
    pub fn mend(&mut self, fault: TipFault) {
        self.simulated_tip().mend(fault);
    }

    /// Instructions that the board has executed since the power came on, interrupts included.
    #[must_use]
    pub fn instructions(&self) -> u64 {
        self.instructions
    }

    /// Ends the firmware: it hangs or crashes, or loses its clock.
    ///
    /// # Errors
    /// The emulator is gone.
    pub fn crash(&mut self, how: Crash) -> Result<(), PortError> {
        let answer = self.bench.crash(how)?;
        self.take(&answer);
        Ok(())
    }

    /// How often the watchdog has reset the board.
    #[must_use]
    pub fn resets(&self) -> u32 {
        self.resets
    }

    /// Bytes of flash that were programmed or erased so far.
    #[must_use]
    pub fn flash_changed(&self) -> u32 {
        self.flash_changed
    }

    /// Whether the board's power is lost.
    #[must_use]
    pub fn has_lost_power(&self) -> bool {
        self.lost_power
    }

    /// The board's power is lost after so many more bytes of flash are programmed or erased.
    ///
    /// # Errors
    /// The emulator is gone.
    pub fn lose_power_after(&mut self, bytes: u32) -> Result<(), PortError> {
        let answer = self.bench.lose_power_after(bytes)?;
        self.take(&answer);
        Ok(())
    }

    /// Its power comes on again, after a while: what is left is the flash, and the tip as it is.
    ///
    /// # Errors
    /// The emulator is gone.
    pub fn power_up(&mut self) -> Result<(), PortError> {
        let answer = self.bench.power_up()?;
        self.take(&answer);
        self.from_board.clear();
        Ok(())
    }

    /// Remembers the flash as it is.
    ///
    /// # Errors
    /// The emulator is gone.
    pub fn keep_flash(&mut self) -> Result<(), PortError> {
        let answer = self.bench.keep_flash()?;
        self.take(&answer);
        Ok(())
    }

    /// The board's power goes and comes on again, with the flash that was remembered.
    ///
    /// # Errors
    /// The emulator is gone.
    pub fn restore_flash(&mut self) -> Result<(), PortError> {
        let answer = self.bench.restore_flash()?;
        self.take(&answer);
        self.from_board.clear();
        Ok(())
    }

    /// Work on flash takes so many times as long as its data sheet's typical values.
    ///
    /// # Errors
    /// The emulator is gone.
    pub fn slow_flash(&mut self, times: f64) -> Result<(), PortError> {
        let answer = self.bench.slow_flash(times)?;
        self.take(&answer);
        Ok(())
    }

    /// Lets virtual time pass. What the board sends in that time waits to be received.
    ///
    /// # Errors
    /// The emulator is gone.
    pub fn pass(&mut self, time: Duration) -> Result<(), PortError> {
        let deadline = self.now_ns + time.as_nanos() as u64;
        while self.now_ns < deadline && !self.lost_power {
            self.exchange(deadline)?;
        }
        Ok(())
    }

    fn tick(&self, ns: u64) -> u64 {
        (u128::from(ns) * u128::from(self.tick_hz) / 1_000_000_000) as u64
    }

    /// Runs the board until its next exchange with the tip, or until `deadline`.
    fn exchange(&mut self, deadline: u64) -> Result<(), PortError> {
        let run = {
            let mut tip = self.tip.borrow_mut();
            Run {
                until_ns: deadline.min(self.now_ns + EXCHANGE_NS),
                steps: tip.steps_to_next_edge(),
                thermistor: tip.sample_thermistor(),
                supply: tip.sample_supply(),
                levels: self.levels.of_sensors(&tip),
                gravity: tip.gravity(),
            }
        };
        let answer = self.bench.run(&run, &std::mem::take(&mut self.to_board))?;
        self.take(&answer);
        Ok(())
    }

    /// Has the tip do what the board has done.
    fn take(&mut self, answer: &Answer) {
        let mut tip = self.tip.borrow_mut();
        for Edge { after_ns, output, state } in &answer.edges {
            tip.advance(self.tick(self.now_ns + u64::from(*after_ns)));
            let on_when = |high: bool| *state == if high { State::High } else { State::Low };
            match output {
                Output::Step(motor) => tip.step(*motor),
                Output::Direction(Motor::Head) => tip.direct(Motor::Head, on_when(self.levels.head_high_is_positive)),
                Output::Direction(Motor::Feed) => tip.direct(Motor::Feed, on_when(self.levels.feed_high_is_forward)),
                Output::Enable(motor) => tip.enable(*motor, on_when(!self.levels.enable_low)),
                Output::HeaterEnable => {
                    let duty = tip.heater_duty();
                    tip.heat(duty, on_when(true));
                }
            }
        }
        tip.advance(self.tick(answer.now_ns));
        let time = (answer.now_ns - self.now_ns) as f64;
        self.powered.add(time, answer.heater * time, answer.fan * time);
        if let Some([heater, fan]) = self.powered.shares() {
            let closed = tip.heater_is_on();
            tip.heat(heater, closed);
            tip.blow(fan);
        }
        drop(tip);
        self.now_ns = answer.now_ns;
        self.instructions = answer.instructions;
        (self.resets, self.flash_changed, self.lost_power) = (answer.resets, answer.flash_changed, answer.lost_power);
        self.from_board.extend(&answer.sent);
    }
}

impl Port for Rp2040 {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.to_board.extend(bytes);
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        let deadline = self.now_ns + timeout.as_nanos() as u64;
        while self.from_board.is_empty() && self.now_ns < deadline {
            if self.lost_power {
                return Err(PortError::Lost("the emulated board".to_owned(), "it has no power".to_owned()));
            }
            self.exchange(deadline)?;
        }
        let count = buffer.len().min(self.from_board.len());
        for (slot, byte) in buffer.iter_mut().zip(self.from_board.drain(..count)) {
            *slot = byte;
        }
        Ok(count)
    }

    fn now(&self) -> Duration {
        Duration::from_nanos(self.now_ns)
    }
}

/// The firmware image that was built last: beside this program, or in the working directory's `target`.
fn built_last() -> PathBuf {
    let beside = std::env::current_exe()
        .ok()
        .and_then(|program| program.ancestors().map(|folder| folder.join(FIRMWARE)).find(|image| image.is_file()));
    beside.unwrap_or_else(|| Path::new("target").join(FIRMWARE))
}
