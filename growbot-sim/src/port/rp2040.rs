//! The firmware of a Pico in the emulator `rp2040js`, connected to the simulated tip at the pins.
//!
//! Node runs the image (`tests/rp2040/emulator-server.js`, which describes the messages). The simulated tip receives
//! the edges of the step, direction and enable pins, and the fraction of each millisecond for which the heater and the
//! fan were on. The board receives the readings of the tip's sensors, as levels of pins and as voltages at its ADC.
//!
//! Time is virtual. It passes only while the host waits, and all runs of a job are equal. Emulator and simulated tip
//! run in lock-step: the emulator stops at the first step after which a sensor reading could change, and after a
//! millisecond at the latest.

pub(super) mod node_process;

use std::cell::{RefCell, RefMut};
use std::collections::VecDeque;
use std::io;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use std::time::Duration;

use growbot_client::port::{Port, PortError};
use growbot_core::link::message::Motor;
use growbot_core::robot::{BoardDescription, BoardKind, DigitalInput, PinOverrides, Robot};
use growbot_firmware::stepping::MotorDirection;
use node_process::{Edge, NodeProcess, PinState, ProcessOutput, Run, RunResponse};

use super::open_error::OpenError;
use crate::simulated_tip::{InProcessTip, SimulatedTip};
use crate::tip::pins::SharedTip;
use crate::tip::{TipFault, TipModel, Variation};
pub use node_process::{CrashMode, HostLink, Rp2040Error};

/// Path of the firmware image for the Raspberry Pi Pico, relative to cargo's target directory.
pub const FIRMWARE: &str = "thumbv6m-none-eabi/firmware/pico";
/// Longest virtual time between two exchanges of the board with the simulated tip, ns.
const EXCHANGE_NS: u64 = 1_000_000;
/// Initial position of the head, in head steps from the tip's x axis. The value is arbitrary but not 0, so that homing
/// has to move the head.
const HEAD_AT_FIRST: i64 = -137;

/// A Raspberry Pi Pico in the emulator `rp2040js`, connected to a simulated tip.
pub struct Rp2040Emulator {
    bench: NodeProcess,
    tip: SharedTip,
    levels: PinPolarity,
    tick_hz: u64,
    /// Time since power-on, ns.
    now_ns: u64,
    powered: DutyAccumulator,
    to_board: Vec<u8>,
    from_board: VecDeque<u8>,
    instructions: u64,
    resets: u32,
    flash_changed: u32,
    lost_power: bool,
}

/// Polarities of the pins of a robot's board.
#[derive(Debug, Clone, Copy)]
struct PinPolarity {
    index_low_on_mark: bool,
    presence_low: bool,
    driver_fault_low: bool,
    emergency_stop_low: bool,
    enable_low: bool,
    head_high_is_positive: bool,
    feed_high_is_forward: bool,
}

impl PinPolarity {
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

    /// Returns the levels of the pins that correspond to the readings of the tip's sensors, in the order of the
    /// messages to the emulator.
    fn of_sensors(&self, tip: &TipModel) -> [bool; 5] {
        [
            tip.on_index() != self.index_low_on_mark,
            tip.encoder(),
            tip.has_filament() != self.presence_low,
            tip.driver_fault() != self.driver_fault_low,
            tip.is_emergency_stop_pressed() != self.emergency_stop_low,
        ]
    }
}

/// Times for which the heater and the fan were on within the time span `time`, ns.
#[derive(Debug, Clone, Copy, Default)]
struct DutyAccumulator {
    time: f64,
    on: [f64; 2],
}

impl DutyAccumulator {
    fn add(&mut self, time: f64, heater: f64, fan: f64) {
        self.time += time;
        self.on = [self.on[0] + heater, self.on[1] + fan];
    }

    /// Returns the fractions of the time span for which the heater and the fan were on, and starts a new span. Returns
    /// `None` while the span is shorter than [`EXCHANGE_NS`].
    fn shares(&mut self) -> Option<[f64; 2]> {
        if self.time < EXCHANGE_NS as f64 {
            return None;
        }
        let Self { time, on } = std::mem::take(self);
        Some(on.map(|on| (on / time).min(1.0)))
    }
}

/// Returns the description of the robot's board. The default is a Pico with the default pins.
fn board_of(robot: &Robot) -> BoardDescription {
    robot.description().board.unwrap_or(BoardDescription { kind: BoardKind::Pico, pins: PinOverrides::default() })
}

impl Rp2040Emulator {
    /// Starts Node with a firmware image, connected to a simulated tip of `robot`. If `firmware` is `None`, the image
    /// in cargo's target directory is used. The image must have been built for this robot. Otherwise the board reports
    /// another robot in its first response.
    ///
    /// # Errors
    /// Node, the emulator or the image is missing, or the board does not start.
    pub fn start(robot: &Robot, firmware: Option<&Path>) -> Result<Self, OpenError> {
        Self::start_with(robot, firmware, Variation::default())
    }

    /// Like [`Rp2040Emulator::start`], with a tip that deviates from the robot's description by `variation`.
    ///
    /// # Errors
    /// Those of [`Rp2040Emulator::start`].
    pub fn start_with(robot: &Robot, firmware: Option<&Path>, variation: Variation) -> Result<Self, OpenError> {
        Self::start_on_link(HostLink::Uart, robot, firmware, variation)
    }

    /// Like [`Rp2040Emulator::start_with`], but the host is connected to the given link of the board.
    ///
    /// # Errors
    /// Those of [`Rp2040Emulator::start`].
    pub fn start_on_link(
        line: HostLink,
        robot: &Robot,
        firmware: Option<&Path>,
        variation: Variation,
    ) -> Result<Self, OpenError> {
        robot.check_for_board().map_err(|error| OpenError::UnsupportedRobot(robot.name().to_owned(), error))?;
        let firmware = firmware.map_or_else(built_last, Path::to_path_buf);
        let bench = NodeProcess::start(&firmware, &board_of(robot), line, None)?;
        Ok(Self::with(bench, robot, variation))
    }

    /// Like [`Rp2040Emulator::start`], but also writes measurements to the file `figures` every few seconds: the
    /// processor cycles of the step interrupt and the depth of the stack (`tests/rp2040/figures.js`).
    ///
    /// # Errors
    /// Those of [`Rp2040Emulator::start`].
    pub fn start_measured(robot: &Robot, firmware: &Path, figures: &Path) -> Result<Self, OpenError> {
        let bench = NodeProcess::start(firmware, &board_of(robot), HostLink::Uart, Some(figures))?;
        Ok(Self::with(bench, robot, Variation::default()))
    }

    fn with(bench: NodeProcess, robot: &Robot, variation: Variation) -> Self {
        Self {
            bench,
            tip: Rc::new(RefCell::new(TipModel::new(robot.clone(), HEAD_AT_FIRST, variation))),
            levels: PinPolarity::of(robot),
            tick_hz: u64::from(robot.description().motion.tick_hz),
            now_ns: 0,
            powered: DutyAccumulator::default(),
            to_board: Vec::new(),
            from_board: VecDeque::new(),
            instructions: 0,
            resets: 0,
            flash_changed: 0,
            lost_power: false,
        }
    }

    /// Returns a mutable reference to the simulated tip in its current state.
    pub fn simulated_tip(&mut self) -> RefMut<'_, TipModel> {
        self.tip.borrow_mut()
    }

    /// Returns a handle of the simulated tip, from which a caller reads the layers that were really laid, to compare
    /// them with the board's report.
    pub fn tip_handle(&self) -> Box<dyn SimulatedTip> {
        Box::new(InProcessTip(Rc::clone(&self.tip)))
    }

    /// Injects a fault into the tip. The fault replaces an active fault of the same kind.
    pub fn inject(&mut self, fault: TipFault) {
        self.simulated_tip().inject(fault);
    }

    /// Removes the active fault of the same kind as `fault`.
    pub fn clear_fault(&mut self, fault: TipFault) {
        self.simulated_tip().clear_fault(fault);
    }

    /// Returns the number of instructions that the board has executed since power-on, including interrupts.
    pub fn instructions(&self) -> u64 {
        self.instructions
    }

    /// Crashes the firmware in the manner of `how`: it hangs, faults or loses its clock.
    ///
    /// # Errors
    /// The emulator has ended.
    pub fn crash(&mut self, how: CrashMode) -> Result<(), PortError> {
        let answer = self.bench.crash(how)?;
        self.take(&answer);
        Ok(())
    }

    /// Returns the number of resets by the watchdog.
    pub fn resets(&self) -> u32 {
        self.resets
    }

    /// Returns the number of bytes of flash that were programmed or erased so far.
    pub fn flash_changed(&self) -> u32 {
        self.flash_changed
    }

    /// Returns true if the board has lost its power.
    pub fn has_lost_power(&self) -> bool {
        self.lost_power
    }

    /// Cuts the board's power after this many more bytes of flash are programmed or erased.
    ///
    /// # Errors
    /// The emulator has ended.
    pub fn lose_power_after(&mut self, bytes: u32) -> Result<(), PortError> {
        let answer = self.bench.lose_power_after(bytes)?;
        self.take(&answer);
        Ok(())
    }

    /// Restores the board's power immediately. Only the flash and the state of the tip are kept.
    ///
    /// # Errors
    /// The emulator has ended.
    pub fn power_up(&mut self) -> Result<(), PortError> {
        let answer = self.bench.power_up()?;
        self.take(&answer);
        self.from_board.clear();
        Ok(())
    }

    /// Stores a copy of the board's flash for [`Rp2040Emulator::restore_flash`].
    ///
    /// # Errors
    /// The emulator has ended.
    pub fn keep_flash(&mut self) -> Result<(), PortError> {
        let answer = self.bench.keep_flash()?;
        self.take(&answer);
        Ok(())
    }

    /// Cuts and restores the board's power, with the stored copy of the flash.
    ///
    /// # Errors
    /// The emulator has ended.
    pub fn restore_flash(&mut self) -> Result<(), PortError> {
        let answer = self.bench.restore_flash()?;
        self.take(&answer);
        self.from_board.clear();
        Ok(())
    }

    /// Sets the duration of flash operations to `times` the typical values of the data sheet.
    ///
    /// # Errors
    /// The emulator has ended.
    pub fn slow_flash(&mut self, times: f64) -> Result<(), PortError> {
        let answer = self.bench.slow_flash(times)?;
        self.take(&answer);
        Ok(())
    }

    /// Lets `time` pass on the virtual clock. Bytes that the board sends are buffered until they are received.
    ///
    /// # Errors
    /// The emulator has ended.
    pub fn run_for(&mut self, time: Duration) -> Result<(), PortError> {
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

    /// Applies the board's outputs to the tip.
    fn take(&mut self, answer: &RunResponse) {
        let mut tip = self.tip.borrow_mut();
        for Edge { after_ns, output, state } in &answer.edges {
            tip.advance(self.tick(self.now_ns + u64::from(*after_ns)));
            let on_when = |high: bool| *state == if high { PinState::High } else { PinState::Low };
            match output {
                ProcessOutput::Step(motor) => tip.step(*motor),
                ProcessOutput::Direction(motor) => {
                    let is_forward = on_when(match motor {
                        Motor::Head => self.levels.head_high_is_positive,
                        Motor::Feed => self.levels.feed_high_is_forward,
                    });
                    tip.set_direction(
                        *motor,
                        if is_forward { MotorDirection::Forward } else { MotorDirection::Backward },
                    );
                }
                ProcessOutput::Enable(motor) => tip.set_enabled(*motor, on_when(!self.levels.enable_low)),
                ProcessOutput::HeaterEnable => {
                    let duty = tip.heater_duty();
                    tip.set_heater(duty, on_when(true));
                }
            }
        }
        tip.advance(self.tick(answer.now_ns));
        let time = (answer.now_ns - self.now_ns) as f64;
        self.powered.add(time, answer.heater * time, answer.fan * time);
        if let Some([heater, fan]) = self.powered.shares() {
            let closed = tip.heater_is_on();
            tip.set_heater(heater, closed);
            tip.set_fan(fan);
        }
        drop(tip);
        self.now_ns = answer.now_ns;
        self.instructions = answer.instructions;
        (self.resets, self.flash_changed, self.lost_power) = (answer.resets, answer.flash_changed, answer.lost_power);
        self.from_board.extend(&answer.sent);
    }
}

impl Port for Rp2040Emulator {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.to_board.extend(bytes);
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        let deadline = self.now_ns + timeout.as_nanos() as u64;
        while self.from_board.is_empty() && self.now_ns < deadline {
            if self.lost_power {
                let cause = io::Error::new(io::ErrorKind::NotConnected, "the emulated board has no power");
                return Err(PortError::Lost("the emulated board".to_owned(), cause));
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

/// Returns the path of the firmware image in the target directory that contains this program, or otherwise in `target`
/// of the working directory.
fn built_last() -> PathBuf {
    let beside = std::env::current_exe()
        .ok()
        .and_then(|program| program.ancestors().map(|folder| folder.join(FIRMWARE)).find(|image| image.is_file()));
    beside.unwrap_or_else(|| Path::new("target").join(FIRMWARE))
}
