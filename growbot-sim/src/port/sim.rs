//! A robot in this process: the real controller and step engine with the simulated tip, on a virtual clock.
//!
//! Time passes only while the host waits for bytes, and then as fast as the machine computes it. So a growth of hours
//! takes seconds, and all runs of a job are equal.

use std::cell::{Cell, RefCell, RefMut};
use std::collections::VecDeque;
use std::rc::Rc;
use std::time::Duration;

use growbot_client::port::{Port, PortError};
use growbot_core::link::emergency_stop::EmergencyStopDetector;
use growbot_core::link::message::{Fault, ImageCheck, Motor, ResetCause, State};
use growbot_core::random::{Rng, splitmix64};
use growbot_core::robot::Robot;
use growbot_firmware::controller::{BootInfo, Controller};
use growbot_firmware::description_store::{DescriptionStore, StoredDescription};
use growbot_firmware::hal::{Board, BoardResources, NoDebugPort, Outputs, RetainedMemory, UnmanagedDrivers, Watchdog};
use growbot_firmware::journal::Journal;
use growbot_firmware::layer_store::LayerStore;
use growbot_firmware::safety::retained::{COPY_BYTES, RETAINED_BYTES};
use growbot_firmware::stepping::{Engine, EngineConfig, EngineInputs, Mailbox, StepperPins};

use crate::simulated_tip::{InProcessTip, SimulatedTip};
use crate::tip::flash::Flash;
use crate::tip::pins::{
    DirectionPin, EnablePin, FanPwm, HeaterEnable, HeaterPower, Input, Orientation, SharedTip, SimulatedAdc,
    SimulatedOutputs, StepPin,
};
use crate::tip::{TipFault, TipModel, Variation};

/// Interval at which the controller is polled, us of virtual time.
const POLL_US: u64 = 10_000;
/// Maximum time between two polls after [`Sim::poll_late`], us of virtual time. The controller must be polled at least
/// this frequently.
const MAX_POLL_US: u64 = 20_000;
/// Initial position of the head, in head steps from the tip's x axis. The value is arbitrary but not 0, so that homing
/// has to move the head.
const HEAD_AT_FIRST: i64 = -137;

/// Timeout of the watchdog, s.
const WATCHDOG_S: u64 = 1;
/// Number of sectors of each of the board's two flash memories.
const FLASH_SECTORS: usize = 2;

type SimEngine =
    Engine<StepPin, DirectionPin, EnablePin, StepPin, DirectionPin, EnablePin, Input, Input, Input, SimulatedOutputs>;

/// A simulated robot in this process: the real controller and step engine, connected to a simulated tip.
pub struct Sim {
    robot: Robot,
    tip: SharedTip,
    engine: SimEngine,
    handover: Mailbox,
    controller: Controller<SimBoard>,
    tick_hz: u64,
    /// Ticks since the simulation began or its robot was replaced. They continue through resets and losses of power.
    tick: u64,
    /// Time of the board's latest start, ticks.
    boot_tick: u64,
    boots: u32,
    next_poll: u64,
    /// Random generator of the time between two polls of the controller. If `None`, this time is constant, and the
    /// controller is also polled immediately after each report of the step engine.
    lateness: Option<Rng>,
    fed: Rc<WatchdogClock>,
    retained: Retained,
    flash: Flash,
    /// Flash that stores the robot's description.
    descriptions: Flash,
    /// True if the board has a built-in description, which it uses if its flash has none.
    built_in: bool,
    /// Time at which `tick` was 0, s.
    epoch_s: f64,
    from_board: VecDeque<u8>,
    /// Detector of emergency stops in the received bytes.
    watch: EmergencyStopDetector,
}

impl Sim {
    /// Returns a robot that was just switched on, with a cold nozzle and the head at an arbitrary position.
    pub fn new(robot: Robot) -> Self {
        Self::with(robot, Variation::default())
    }

    /// Returns a robot that deviates from its description.
    pub fn with(robot: Robot, variation: Variation) -> Self {
        let tip = Rc::new(RefCell::new(TipModel::new(robot.clone(), HEAD_AT_FIRST, variation)));
        let fed = Rc::new(WatchdogClock::default());
        let retained = Retained::of_noise(&tip.borrow(), 0);
        let [flash, descriptions] = [Flash::new(FLASH_SECTORS), Flash::new(FLASH_SECTORS)];
        let handover = Mailbox::new();
        let tick_hz = u64::from(robot.description().motion.tick_hz);
        let kept = BoardMemory { retained: &retained, flash: &flash, descriptions: &descriptions };
        let mut sim = Self {
            engine: engine(&robot, &tip),
            controller: controller(&robot, &tip, &fed, &kept, identity_of(1, ResetCause::PowerOn), &handover),
            robot,
            tip,
            handover,
            tick_hz,
            tick: 0,
            boot_tick: 0,
            boots: 1,
            next_poll: 0,
            lateness: None,
            fed,
            retained,
            flash,
            descriptions,
            built_in: true,
            epoch_s: 0.0,
            from_board: VecDeque::new(),
            watch: EmergencyStopDetector::new(),
        };
        sim.poll();
        sim
    }

    /// Sets the remaining length of filament on the spool, mm.
    pub fn load_filament(&mut self, mm: f64) {
        self.tip.borrow_mut().load_filament(mm);
    }

    /// Makes the polls of the controller irregular, as on a board whose main loop is busy. The time between two polls
    /// is then random (0 to 20 ms, drawn with this seed), and the controller is not polled immediately after a report
    /// of the step engine.
    pub fn poll_late(&mut self, seed: u64) {
        self.lateness = Some(Rng::new(&[seed]));
    }

    /// Injects a fault into the tip. The fault replaces an active fault of the same kind.
    pub fn inject(&mut self, fault: TipFault) {
        self.simulated_tip().inject(fault);
    }

    /// Removes the active fault of the same kind as `fault`.
    pub fn clear_fault(&mut self, fault: TipFault) {
        self.simulated_tip().clear_fault(fault);
    }

    /// Returns a mutable reference to the simulated tip in its current state.
    pub fn simulated_tip(&mut self) -> RefMut<'_, TipModel> {
        self.tip.borrow_mut()
    }

    /// Returns a handle of the simulated tip, from which a caller reads the layers that were really laid.
    pub fn tip_handle(&self) -> Box<dyn SimulatedTip> {
        Box::new(InProcessTip(Rc::clone(&self.tip)))
    }

    /// Returns the virtual time since the simulation began, s. It continues through resets and losses of power.
    pub fn now_s(&self) -> f64 {
        self.epoch_s + self.tick as f64 / self.tick_hz as f64
    }

    /// Returns the board's boot number, which increases by 1 at each start.
    pub fn boots(&self) -> u32 {
        self.boots
    }

    /// Returns the board's controller.
    pub fn controller(&self) -> &Controller<SimBoard> {
        &self.controller
    }

    /// Returns the state of the board.
    pub fn state(&self) -> State {
        self.controller.state()
    }

    /// Returns the fault that the board has latched. Returns `None` without a fault.
    pub fn fault(&self) -> Option<Fault> {
        self.controller.fault()
    }

    /// Lets `time` pass on the virtual clock. Bytes that the board sends are buffered until they are received.
    pub fn run_for(&mut self, time: Duration) {
        let deadline = self.tick + self.ticks(time);
        while self.tick < deadline {
            self.advance(deadline);
        }
    }

    /// Returns the board's RAM that keeps its content during a reset, but not without power.
    pub fn retained(&self) -> Retained {
        self.retained.clone()
    }

    /// Overwrites the retained memory with random bytes, as a loss of power does.
    pub fn lose_retained(&mut self) {
        self.retained = Retained::of_noise(&self.tip.borrow(), self.tick);
    }

    /// Returns the robot. It changes if its board is configured for another robot.
    pub fn robot(&self) -> &Robot {
        &self.robot
    }

    /// Returns the flash that stores the robot's description.
    pub fn descriptions(&self) -> Flash {
        self.descriptions.clone()
    }

    /// Restarts the board without a built-in description. Until the board is configured, it only communicates.
    pub fn restart_without_description(&mut self) {
        self.built_in = false;
        self.reset(ResetCause::PowerOn);
    }

    /// Returns the journal's flash. A loss of power during a write resets the board.
    pub fn flash(&self) -> Flash {
        self.flash.clone()
    }

    /// Resets the board: its outputs go off and its controller restarts. The tip stays as it is. If the cause is a loss
    /// of power, only the flash survives.
    pub fn reset(&mut self, cause: ResetCause) {
        if cause == ResetCause::PowerOn {
            self.lose_retained();
            self.flash.power_up();
            self.descriptions.power_up();
        }
        self.outputs_off();
        self.boots = self.boots.wrapping_add(1);
        self.boot_tick = self.tick;
        self.fed.feed();
        self.handover = Mailbox::new();
        let stored = DescriptionStore::open(self.descriptions.clone()).newest();
        let configured = match stored {
            StoredDescription::Robot(_) => true,
            StoredDescription::Empty => self.built_in,
            StoredDescription::Undecodable => false,
        };
        if let Some(robot) = stored.robot().filter(|robot| robot.hash() != self.robot.hash()) {
            self.replace_robot(robot);
        }
        // An engine releases both motors when it starts.
        self.engine = engine(&self.robot, &self.tip);
        let identity = BootInfo { configured, ..identity_of(self.boots, cause) };
        let kept = BoardMemory { retained: &self.retained, flash: &self.flash, descriptions: &self.descriptions };
        self.controller = controller(&self.robot, &self.tip, &self.fed, &kept, identity, &self.handover);
        self.poll();
    }

    /// Replaces the robot, because the board has been configured for another one. The tip becomes that of the new
    /// robot, cold and with its head at an arbitrary position. The clock of the new tip begins at 0.
    fn replace_robot(&mut self, robot: Robot) {
        let variation = *self.tip.borrow().variation();
        self.epoch_s = self.now_s();
        (self.tick, self.boot_tick, self.next_poll) = (0, 0, 0);
        self.fed.now.set(0);
        self.fed.feed();
        self.tick_hz = u64::from(robot.description().motion.tick_hz);
        *self.tip.borrow_mut() = TipModel::new(robot.clone(), HEAD_AT_FIRST, variation);
        self.robot = robot;
    }

    /// Restarts the board as if it had started `boots` times before.
    pub fn restart(&mut self, boots: u32, cause: ResetCause) {
        self.boots = boots;
        self.reset(cause);
    }

    fn outputs_off(&self) {
        SimulatedOutputs(Rc::clone(&self.tip)).make_safe();
    }

    fn ticks(&self, time: Duration) -> u64 {
        time.as_micros() as u64 * self.tick_hz / 1_000_000
    }

    /// Lets time pass until the controller is polled, until the watchdog resets the board, or until `deadline` (ticks).
    /// Only a poll feeds the watchdog or writes to the flash.
    fn advance(&mut self, deadline: u64) {
        let until = self.next_poll.min(self.watchdog_deadline()).min(deadline).max(self.tick + 1);
        if self.tip.borrow().faults().has(TipFault::StepInterruptStopped) {
            self.tick = until;
            self.tip.borrow_mut().advance(until);
        } else {
            self.run_engine(until);
        }
        self.fed.now.set(self.tick);
        if self.tick >= self.next_poll || self.must_poll_at_once() {
            self.poll();
        }
        if self.tick >= self.watchdog_deadline() {
            self.reset(ResetCause::Watchdog);
        }
        if self.flash.has_lost_power() || self.descriptions.has_lost_power() {
            self.reset(ResetCause::PowerOn);
        } else if self.controller.needs_reset() {
            self.reset(ResetCause::External);
        }
    }

    /// Returns the time at which the watchdog resets the board unless it is fed, ticks.
    fn watchdog_deadline(&self) -> u64 {
        self.fed.fed.get() + WATCHDOG_S * self.tick_hz + 1
    }

    /// Runs the step interrupt up to this tick, or until the step engine has a report for the controller. Ticks in
    /// which no pin changes are skipped.
    fn run_engine(&mut self, until: u64) {
        loop {
            let left = u32::try_from(until - self.tick).unwrap_or(u32::MAX);
            let ticks = self.engine.ticks_to_event(&self.handover).min(left);
            self.tick += u64::from(ticks);
            self.tip.borrow_mut().advance(self.tick);
            self.engine.skip(ticks - 1);
            self.engine.tick(&self.handover);
            if self.tick >= until || self.must_poll_at_once() {
                return;
            }
        }
    }

    fn must_poll_at_once(&self) -> bool {
        self.lateness.is_none() && self.handover.has_report()
    }

    fn poll(&mut self) {
        self.controller.poll((self.tick - self.boot_tick) * 1_000_000 / self.tick_hz, &self.handover);
        let us = self.lateness.as_mut().map_or(POLL_US, |random| random.below(MAX_POLL_US + 1));
        self.next_poll = self.tick + (us * self.tick_hz / 1_000_000).max(1);
        while let Some(byte) = self.controller.next_tx_byte() {
            self.from_board.push_back(byte);
        }
    }
}

fn engine(robot: &Robot, tip: &SharedTip) -> SimEngine {
    let axis = |motor| StepperPins {
        step: StepPin(motor, Rc::clone(tip)),
        direction: DirectionPin(motor, Rc::clone(tip)),
        enable: EnablePin(motor, Rc::clone(tip)),
    };
    let inputs = EngineInputs {
        index: Input::index(tip),
        filament_motion: Input::filament_motion(tip),
        emergency_stop: Input::emergency_stop(tip),
    };
    let outputs = SimulatedOutputs(Rc::clone(tip));
    Engine::new(axis(Motor::Head), axis(Motor::Feed), inputs, outputs, EngineConfig::for_robot(robot))
}

/// Memories of a board that survive a reset.
struct BoardMemory<'a> {
    retained: &'a Retained,
    flash: &'a Flash,
    descriptions: &'a Flash,
}

fn controller(
    robot: &Robot,
    tip: &SharedTip,
    fed: &Rc<WatchdogClock>,
    kept: &BoardMemory,
    identity: BootInfo,
    handover: &Mailbox,
) -> Controller<SimBoard> {
    let parts = BoardResources {
        heater_power: HeaterPower(Rc::clone(tip)),
        heater_enable: HeaterEnable(Rc::clone(tip)),
        fan: FanPwm(Rc::clone(tip)),
        thermistor: SimulatedAdc::thermistor(tip),
        supply: SimulatedAdc::supply(tip),
        filament_presence: Input::filament_presence(tip),
        driver_fault: Input::driver_fault(tip),
        drivers: UnmanagedDrivers,
        orientation: Orientation(Rc::clone(tip)),
        watchdog: SimWatchdog(Rc::clone(fed)),
        debug_port: NoDebugPort,
        retained: kept.retained.clone(),
        journal: Journal::open(kept.flash.clone()),
        descriptions: DescriptionStore::open(kept.descriptions.clone()),
        store: Box::new(LayerStore::new()),
    };
    Controller::new(robot.clone(), identity, parts, handover)
}

impl Port for Sim {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        for byte in bytes {
            if self.watch.push(*byte) {
                self.outputs_off();
                self.handover.request_emergency_stop();
            }
            self.controller.receive(*byte, &self.handover);
        }
        self.poll();
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        let deadline = self.tick + self.ticks(timeout);
        while self.from_board.is_empty() && self.tick < deadline {
            self.advance(deadline);
        }
        let count = buffer.len().min(self.from_board.len());
        for (slot, byte) in buffer.iter_mut().zip(self.from_board.drain(..count)) {
            *slot = byte;
        }
        Ok(count)
    }

    fn now(&self) -> Duration {
        Duration::from_secs_f64(self.now_s())
    }
}

/// Marker type that specifies the types of the simulated board's parts for the controller.
pub struct SimBoard;

impl Board for SimBoard {
    type HeaterPower = HeaterPower;
    type HeaterEnable = HeaterEnable;
    type FanPwm = FanPwm;
    type ThermistorAdc = SimulatedAdc;
    type SupplyAdc = SimulatedAdc;
    type FilamentPresence = Input;
    type DriverFault = Input;
    type Drivers = UnmanagedDrivers;
    type Orientation = Orientation;
    type Watchdog = SimWatchdog;
    type DebugPort = NoDebugPort;
    type Retained = Retained;
    type Flash = Flash;
    type Store = Box<LayerStore>;
}

/// Returns the information about one start of the simulated board. The board has no firmware image to check, and does
/// not crash.
fn identity_of(boot_id: u32, reset_cause: ResetCause) -> BootInfo {
    let image = ImageCheck::Unsealed;
    BootInfo { boot_id, reset_cause, image, crash: None, crystal_failed: false, configured: true }
}

/// RAM of the board that keeps its content during a reset.
#[derive(Clone)]
pub struct Retained(Rc<Cell<[u8; RETAINED_BYTES]>>);

impl Retained {
    /// Returns memory with random bytes, as after power-on.
    fn of_noise(tip: &TipModel, tick: u64) -> Self {
        let seed = tip.variation().seed;
        Self(Rc::new(Cell::new(std::array::from_fn(|at| splitmix64(seed ^ tick << 8 ^ at as u64) as u8))))
    }
}

impl Retained {
    /// Overwrites the memory. Bytes beyond its length are ignored.
    pub fn set(&self, bytes: &[u8]) {
        let mut retained = self.0.get();
        for (slot, byte) in retained.iter_mut().zip(bytes) {
            *slot = *byte;
        }
        self.0.set(retained);
    }
}

impl RetainedMemory for Retained {
    fn read(&mut self) -> [u8; RETAINED_BYTES] {
        self.0.get()
    }

    fn write(&mut self, copy: usize, bytes: &[u8; COPY_BYTES]) {
        let mut retained = self.0.get();
        if let Some(into) = retained.as_chunks_mut::<COPY_BYTES>().0.get_mut(copy) {
            *into = *bytes;
        }
        self.0.set(retained);
    }
}

/// Present time, and time at which the watchdog was last fed, ticks.
#[derive(Default)]
pub struct WatchdogClock {
    now: Cell<u64>,
    fed: Cell<u64>,
}

impl WatchdogClock {
    fn feed(&self) {
        self.fed.set(self.now.get());
    }
}

/// A watchdog that resets the board a second after it was last fed.
pub struct SimWatchdog(Rc<WatchdogClock>);

impl Watchdog for SimWatchdog {
    fn feed(&mut self) {
        self.0.feed();
    }
}

#[cfg(test)]
mod tests;
