//! TMC2209 stepper drivers on a one-wire serial line. They are configured before a motor is energised, then monitored.
//!
//! Source: TMC2209 data sheet, rev. 1.09. Registers and datagrams are those of the crate `tmc2209`.
//!
//! - Both drivers are configured when the board starts, with 12 registers each. A driver counts the writes that it
//!   accepts (IFCNT). It counts as configured only if it accepted all of them. Otherwise all registers are written
//!   again.
//! - Then the drivers are polled one after the other, each some 30 times a second, for resets, undervoltage of the
//!   charge pump, temperature, shorts, open wires, and the load, if a threshold is set.
//! - StallGuard4 measures the load in StealthChop only, and only from about one turn of the motor a second on. In
//!   SpreadCycle, and with slower motors, a stall is not detected.
//! - A driver that restarted has lost its settings of current and microsteps. While its motor is in use the restart is
//!   reported as a problem, because the motor has lost its position. At rest the driver is configured again.
//! - A driver that does not respond is polled again and again, and is configured once it responds, because the motors'
//!   supply may be switched on later than the board's.
//!
//! [`Tmc2209::poll`] never waits: it does as much as it can and returns. Each exchange has a time limit.

mod bus;
#[cfg(test)]
mod fake_bus;
mod health;
mod settings;
#[cfg(test)]
mod tests;

use growbot_core::link::message::{DriverProblem, DriverReport, Motor};
use tmc2209::reg::{Address, DRV_STATUS, GSTAT, SG_RESULT, TSTEP};

pub use self::bus::{BAUD, SingleWireUart};
pub use self::settings::DriverConfig;

use self::bus::{Bus, TransactionResult};
use self::health::{HealthMonitor, HealthSample};
use self::settings::REGISTERS;
use crate::hal::StepperDrivers;

/// Time from the beginning of a poll of both drivers to the beginning of the next poll, us.
const PERIOD_US: u64 = 30_000;
/// Number of consecutive failed configurations of a driver after which a problem is reported.
const MAX_UNCOUNTED: u8 = 3;

/// State of one stepper driver.
struct DriverState {
    motor: Motor,
    settings: DriverConfig,
    configured: bool,
    /// Number of consecutive configurations in which the driver did not count all writes.
    uncounted: u8,
    watch: HealthMonitor,
    problem: Option<DriverProblem>,
}

impl DriverState {
    fn new(motor: Motor, settings: DriverConfig) -> Self {
        Self { motor, settings, configured: false, uncounted: 0, watch: HealthMonitor::default(), problem: None }
    }

    /// Records that all registers were written. `counted` is the number of writes that the driver has counted.
    fn note_counted(&mut self, counted: u8) {
        self.configured = usize::from(counted) == REGISTERS;
        self.uncounted = if self.configured { 0 } else { self.uncounted.saturating_add(1) };
        self.watch = HealthMonitor::default();
        self.problem = (self.uncounted >= MAX_UNCOUNTED).then_some(DriverProblem::NotConfigured);
    }

    /// Evaluates a complete sample of the driver's registers.
    fn note_look(&mut self, look: &HealthSample, in_use: bool) {
        self.problem = self.watch.look(look, self.settings.watched_threshold());
        if self.problem == Some(DriverProblem::ShutDown) && !in_use {
            // The driver is configured again, which clears the flags of the past problem.
            self.configured = false;
        }
    }
}

/// The action in progress for the driver that is configured or polled now.
#[derive(Debug, Clone, Copy)]
enum PollState {
    /// No driver is configured or polled until this time, us.
    Rest(u64),
    /// The driver's count of accepted writes is read, before its registers are written.
    CountBefore,
    /// The register with the index `index` is written. `before` is the driver's count before the first write.
    Write { index: usize, before: u8 },
    /// The driver's count of accepted writes is read again, after its registers were written.
    CountAfter { before: u8 },
    /// This register is read, as a part of the sample of the driver's health.
    Look(Address, HealthSample),
}

/// The stepper drivers of head and feed, and the serial line to them.
pub struct Tmc2209<W> {
    bus: Bus<W>,
    nodes: [DriverState; 2],
    /// Motor whose driver is configured or polled now.
    active_motor: Motor,
    step: PollState,
    /// Time at which the current poll of both drivers began, us.
    begun: u64,
}

impl<W: SingleWireUart> Tmc2209<W> {
    /// Creates the drivers of head and feed, not configured yet.
    pub fn new(wire: W, [head, feed]: [DriverConfig; 2]) -> Self {
        Self {
            bus: Bus::new(wire),
            nodes: [DriverState::new(Motor::Head, head), DriverState::new(Motor::Feed, feed)],
            active_motor: Motor::Head,
            step: PollState::Rest(0),
            begun: 0,
        }
    }

    fn node(&mut self) -> &mut DriverState {
        let [head, feed] = &mut self.nodes;
        match self.active_motor {
            Motor::Head => head,
            Motor::Feed => feed,
        }
    }

    fn read(&mut self, register: Address, now: u64) {
        let address = self.node().settings.address;
        self.bus.read(address, register, now);
    }

    /// Begins to configure or to poll the active motor's driver.
    fn begin(&mut self, now: u64) {
        if self.active_motor == Motor::Head {
            self.begun = now;
        }
        let first = if self.node().configured {
            self.step = PollState::Look(Address::GSTAT, HealthSample::default());
            Address::GSTAT
        } else {
            self.step = PollState::CountBefore;
            Address::IFCNT
        };
        self.read(first, now);
    }

    /// Ends the work with the active motor's driver. Begins with the other driver, or waits for the next period if both
    /// are done.
    fn end(&mut self, now: u64) {
        if self.active_motor == Motor::Head {
            self.active_motor = Motor::Feed;
            self.begin(now);
        } else {
            self.active_motor = Motor::Head;
            self.step = PollState::Rest(self.begun.saturating_add(PERIOD_US));
        }
    }

    /// Writes the register with this index. If all registers are written, reads the driver's count of accepted writes.
    fn write(&mut self, index: usize, before: u8, now: u64) {
        let settings = self.node().settings;
        if let Some(register) = settings.registers().get(index) {
            self.step = PollState::Write { index, before };
            self.bus.write(settings.address, *register, now);
        } else {
            self.step = PollState::CountAfter { before };
            self.read(Address::IFCNT, now);
        }
    }

    /// Continues with the active motor's driver after an exchange on the serial line has ended.
    fn proceed(&mut self, outcome: TransactionResult, now: u64, in_use: bool) {
        match (self.step, outcome) {
            (PollState::CountBefore, TransactionResult::Read(count)) => self.write(0, count as u8, now),
            (PollState::Write { index, before }, TransactionResult::Written) => self.write(index + 1, before, now),
            (PollState::CountAfter { before }, TransactionResult::Read(count)) => {
                self.node().note_counted((count as u8).wrapping_sub(before));
                self.end(now);
            }
            (PollState::Look(register, look), TransactionResult::Read(value)) => {
                self.look(register, look, value, now, in_use);
            }
            _ => {
                self.node().problem = Some(DriverProblem::Silent);
                self.end(now);
            }
        }
    }

    /// Stores the value of one register of a sample and begins to read the next one. Evaluates the sample once it is
    /// complete.
    fn look(&mut self, register: Address, mut look: HealthSample, value: u32, now: u64, in_use: bool) {
        let next = match register {
            Address::GSTAT => {
                look.global = GSTAT::from(value);
                if look.global.reset() {
                    let node = self.node();
                    node.configured = in_use;
                    node.problem = in_use.then_some(DriverProblem::Reset);
                    self.end(now);
                    return;
                }
                Some(Address::DRV_STATUS)
            }
            Address::DRV_STATUS => {
                look.status = DRV_STATUS::from(value);
                self.node().settings.watched_threshold().map(|_| Address::TSTEP)
            }
            Address::TSTEP => {
                look.step_time = TSTEP::from(value);
                Some(Address::SG_RESULT)
            }
            _ => {
                look.load = SG_RESULT::from(value);
                None
            }
        };
        if let Some(next) = next {
            self.step = PollState::Look(next, look);
            self.read(next, now);
        } else {
            self.node().note_look(&look, in_use);
            self.end(now);
        }
    }
}

impl<W: SingleWireUart> StepperDrivers for Tmc2209<W> {
    fn poll(&mut self, now: u64, in_use: bool) {
        let outcome = self.bus.poll(now);
        match (self.step, outcome) {
            (PollState::Rest(until), _) if now >= until => self.begin(now),
            (_, Some(outcome)) => self.proceed(outcome, now, in_use),
            _ => {}
        }
    }

    fn are_configured(&self) -> bool {
        self.nodes.iter().all(|node| node.configured)
    }

    fn problem(&self) -> Option<DriverReport> {
        self.nodes.iter().find_map(|node| Some(DriverReport { motor: node.motor, problem: node.problem? }))
    }
}
