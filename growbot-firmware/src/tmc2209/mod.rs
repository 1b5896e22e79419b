//! TMC2209 stepper drivers on a one-wire serial line: configured before a motor is energised, then watched.
//!
//! Source: TMC2209 data sheet, rev. 1.09. Registers and datagrams are those of the crate `tmc2209`.
//!
//! - Both drivers are configured when the board starts: 12 registers each. A driver counts the writes that it takes
//!   (IFCNT), and only if it took all of them it counts as configured. Otherwise all is written again.
//! - Then each is looked at in turn, some 30 times a second: reset, charge pump, temperature, shorts, open wires, and
//!   the load, where a threshold is set.
//! - StallGuard4 measures the load in StealthChop only, and from about one turn of the motor a second on. In
//!   SpreadCycle, and of slower motors, a stall is not found.
//! - A driver that started anew has lost its current and its microsteps. While its motor is in use that is a problem,
//!   as the motor has lost its place. At rest the driver is configured again.
//! - One that does not answer is asked again and again, and is configured once it does: the motors' supply may come
//!   later than the board's.
//!
//! Nothing waits: [`Tmc2209::poll`] goes on as far as it can and returns. Each exchange has a time by which it ends.

mod bus;
#[cfg(test)]
mod model;
mod settings;
#[cfg(test)]
mod tests;
mod watch;

use growbot_core::link::message::{DriverProblem, DriverTrouble, Motor};
use tmc2209::reg::{Address, DRV_STATUS, GSTAT, SG_RESULT, TSTEP};

pub use self::bus::{BAUD, Wire};
pub use self::settings::Settings;

use self::bus::{Bus, Outcome};
use self::settings::REGISTERS;
use self::watch::{Look, Watch};
use crate::hal::Drivers;

/// Time between two looks at both drivers, us.
const PERIOD_US: u64 = 30_000;
/// How often a driver may leave writes uncounted before that is a problem.
const MAX_UNCOUNTED: u8 = 3;

/// One driver.
struct Node {
    motor: Motor,
    settings: Settings,
    configured: bool,
    /// How often in a row it did not count what was written to it.
    uncounted: u8,
    watch: Watch,
    problem: Option<DriverProblem>,
}

impl Node {
    fn new(motor: Motor, settings: Settings) -> Self {
        Self { motor, settings, configured: false, uncounted: 0, watch: Watch::default(), problem: None }
    }

    /// Notes the end of a configuration: how many writes the driver has counted.
    fn note_counted(&mut self, counted: u8) {
        self.configured = usize::from(counted) == REGISTERS;
        self.uncounted = if self.configured { 0 } else { self.uncounted.saturating_add(1) };
        self.watch = Watch::default();
        self.problem = (self.uncounted >= MAX_UNCOUNTED).then_some(DriverProblem::NotConfigured);
    }

    /// Notes the end of a look.
    fn note_look(&mut self, look: &Look, in_use: bool) {
        self.problem = self.watch.look(look, self.settings.watched_threshold());
        if self.problem == Some(DriverProblem::ShutDown) && !in_use {
            // What remains of a problem that has gone is cleared with all else.
            self.configured = false;
        }
    }
}

/// What is done with the driver whose turn it is.
#[derive(Debug, Clone, Copy)]
enum Step {
    /// Nothing until this time.
    Rest(u64),
    /// Its count of writes is read, before it is configured.
    CountBefore,
    /// A register is written.
    Write { index: usize, before: u8 },
    /// The count is read again.
    CountAfter { before: u8 },
    /// A look is taken, and this register is read.
    Look(Address, Look),
}

/// Two drivers, and the line to them.
pub struct Tmc2209<W> {
    bus: Bus<W>,
    nodes: [Node; 2],
    /// The driver whose turn it is.
    turn: Motor,
    step: Step,
    /// When the first driver's turn began, us.
    begun: u64,
}

impl<W: Wire> Tmc2209<W> {
    /// The drivers of head and feed, not configured yet.
    pub fn new(wire: W, [head, feed]: [Settings; 2]) -> Self {
        Self {
            bus: Bus::new(wire),
            nodes: [Node::new(Motor::Head, head), Node::new(Motor::Feed, feed)],
            turn: Motor::Head,
            step: Step::Rest(0),
            begun: 0,
        }
    }

    fn node(&mut self) -> &mut Node {
        let [head, feed] = &mut self.nodes;
        match self.turn {
            Motor::Head => head,
            Motor::Feed => feed,
        }
    }

    fn read(&mut self, register: Address, now: u64) {
        let address = self.node().settings.address;
        self.bus.read(address, register, now);
    }

    /// Begins the turn of a driver.
    fn begin(&mut self, now: u64) {
        if self.turn == Motor::Head {
            self.begun = now;
        }
        let first = if self.node().configured {
            self.step = Step::Look(Address::GSTAT, Look::default());
            Address::GSTAT
        } else {
            self.step = Step::CountBefore;
            Address::IFCNT
        };
        self.read(first, now);
    }

    /// Ends the turn of a driver.
    fn end(&mut self, now: u64) {
        if self.turn == Motor::Head {
            self.turn = Motor::Feed;
            self.begin(now);
        } else {
            self.turn = Motor::Head;
            self.step = Step::Rest(self.begun.saturating_add(PERIOD_US));
        }
    }

    /// Writes a register, or reads how many were taken.
    fn write(&mut self, index: usize, before: u8, now: u64) {
        let settings = self.node().settings;
        if let Some(register) = settings.registers().get(index) {
            self.step = Step::Write { index, before };
            self.bus.write(settings.address, *register, now);
        } else {
            self.step = Step::CountAfter { before };
            self.read(Address::IFCNT, now);
        }
    }

    /// Takes the next step after an exchange.
    fn proceed(&mut self, outcome: Outcome, now: u64, in_use: bool) {
        match (self.step, outcome) {
            (Step::CountBefore, Outcome::Read(count)) => self.write(0, count as u8, now),
            (Step::Write { index, before }, Outcome::Written) => self.write(index + 1, before, now),
            (Step::CountAfter { before }, Outcome::Read(count)) => {
                self.node().note_counted((count as u8).wrapping_sub(before));
                self.end(now);
            }
            (Step::Look(register, look), Outcome::Read(value)) => self.look(register, look, value, now, in_use),
            _ => {
                self.node().problem = Some(DriverProblem::Silent);
                self.end(now);
            }
        }
    }

    /// Notes a register of a look, and reads the next one.
    fn look(&mut self, register: Address, mut look: Look, value: u32, now: u64, in_use: bool) {
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
            self.step = Step::Look(next, look);
            self.read(next, now);
        } else {
            self.node().note_look(&look, in_use);
            self.end(now);
        }
    }
}

impl<W: Wire> Drivers for Tmc2209<W> {
    fn poll(&mut self, now: u64, in_use: bool) {
        let outcome = self.bus.poll(now);
        match (self.step, outcome) {
            (Step::Rest(until), _) if now >= until => self.begin(now),
            (_, Some(outcome)) => self.proceed(outcome, now, in_use),
            _ => {}
        }
    }

    fn are_configured(&self) -> bool {
        self.nodes.iter().all(|node| node.configured)
    }

    fn trouble(&self) -> Option<DriverTrouble> {
        self.nodes.iter().find_map(|node| Some(DriverTrouble { motor: node.motor, problem: node.problem? }))
    }
}
