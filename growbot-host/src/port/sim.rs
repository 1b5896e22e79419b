//! A robot in this process: the real controller and step engine against the simulated tip, on a virtual clock.
//!
//! Time passes only while the host waits for bytes, and then as fast as the machine computes it, so that a growth of
//! hours takes seconds and every run of the same job is the same.

use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::rc::Rc;
use std::time::Duration;

use embedded_hal::digital::{ErrorType, InputPin, OutputPin};
use embedded_hal::pwm::{self, SetDutyCycle};
use growbot_core::link::message::ResetCause;
use growbot_core::robot::{Robot, Thermistor as ThermistorDescription};
use growbot_firmware::controller::{Controller, Identity};
use growbot_firmware::hal::{Board, Parts, Thermistor, Watchdog};
use growbot_firmware::layer_store::LayerStore;
use growbot_firmware::stepping::{Axis, Engine, EngineSettings, Handover, Inputs};
use growbot_firmware::thermistor;

use super::{Port, PortError, TipRecord};
use crate::tip::{Motor, Tip};

/// How often the controller is polled, us of virtual time.
const POLL_US: u64 = 10_000;
/// Where the head stands at first, in head steps from the tip's x axis: anywhere, so that homing has something to do.
const HEAD_AT_FIRST: i64 = -137;

type SimEngine =
    Engine<StepPin, DirectionPin, EnablePin, StepPin, DirectionPin, EnablePin, IndexPin, QuietPin, QuietPin>;

/// A robot in this process.
pub struct Sim {
    wires: Rc<Wires>,
    engine: SimEngine,
    handover: Handover,
    controller: Controller<SimBoard>,
    tick_hz: u64,
    /// Ticks since the start.
    tick: u64,
    next_poll: u64,
    heated_until: u64,
    from_board: VecDeque<u8>,
}

impl Sim {
    /// A robot that has just been switched on, its nozzle cold and its head anywhere.
    #[must_use]
    pub fn new(robot: Robot) -> Self {
        let wires = Rc::new(Wires {
            tip: RefCell::new(Tip::new(robot.clone(), HEAD_AT_FIRST)),
            tick: Cell::new(0),
            heater: RefCell::default(),
            thermistor: robot.description().thermistor,
        });
        let axis = |motor| Axis {
            step: StepPin { motor, wires: Rc::clone(&wires) },
            direction: DirectionPin { motor, wires: Rc::clone(&wires) },
            enable: EnablePin { motor, wires: Rc::clone(&wires) },
        };
        let inputs = Inputs { index: IndexPin(Rc::clone(&wires)), filament_motion: QuietPin, emergency_stop: QuietPin };
        let engine = Engine::new(axis(Motor::Head), axis(Motor::Feed), inputs, EngineSettings::of(&robot));
        let handover = Handover::new();
        let tick_hz = u64::from(robot.description().motion.tick_hz);
        let parts = Parts {
            heater_power: HeaterPower(Rc::clone(&wires)),
            heater_enable: HeaterEnable(Rc::clone(&wires)),
            thermistor: SimThermistor(Rc::clone(&wires)),
            watchdog: NoWatchdog,
            store: Box::new(LayerStore::new()),
        };
        let identity = Identity { boot_id: 1, reset_cause: ResetCause::PowerOn };
        let controller = Controller::new(robot, identity, parts, &handover);
        let mut sim = Self {
            wires,
            engine,
            handover,
            controller,
            tick_hz,
            tick: 0,
            next_poll: 0,
            heated_until: 0,
            from_board: VecDeque::new(),
        };
        sim.poll();
        sim
    }

    /// Lets time pass up to the next moment at which something happens, or until `deadline` (ticks).
    fn advance(&mut self, deadline: u64) {
        let until = self.next_poll.min(deadline).saturating_sub(self.tick).max(1);
        let until = u32::try_from(until).unwrap_or(u32::MAX);
        let ticks = self.engine.ticks_to_event(&self.handover).min(until);
        self.engine.skip(ticks - 1);
        self.tick += u64::from(ticks);
        self.wires.tick.set(self.tick);
        self.engine.tick(&self.handover);
        if self.tick >= self.next_poll || self.handover.report_waits() {
            self.poll();
        }
    }

    fn poll(&mut self) {
        let seconds = (self.tick - self.heated_until) as f64 / self.tick_hz as f64;
        self.heated_until = self.tick;
        let duty = self.wires.heater.borrow().duty();
        self.wires.tip.borrow_mut().nozzle_mut().heat(duty, seconds);
        self.controller.poll(self.tick * 1_000_000 / self.tick_hz, &self.handover);
        self.next_poll = self.tick + (POLL_US * self.tick_hz / 1_000_000).max(1);
        while let Some(byte) = self.controller.transmit() {
            self.from_board.push_back(byte);
        }
    }
}

impl Port for Sim {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        for byte in bytes {
            self.controller.receive(*byte, &self.handover);
        }
        self.poll();
        Ok(())
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        let ticks = timeout.as_micros() as u64 * self.tick_hz / 1_000_000;
        let deadline = self.tick + ticks;
        while self.from_board.is_empty() && self.tick < deadline {
            self.advance(deadline);
        }
        let count = buffer.len().min(self.from_board.len());
        for (slot, byte) in buffer.iter_mut().zip(self.from_board.drain(..count)) {
            *slot = byte;
        }
        Ok(count)
    }

    fn tip(&mut self) -> Result<Option<TipRecord>, PortError> {
        let tip = self.wires.tip.borrow();
        Ok(Some(TipRecord {
            body: tip.body(),
            feed_steps: tip.feed_steps(),
            temperature_c: tip.nozzle().temperature(),
        }))
    }
}

/// What connects the controller with the tip.
struct Wires {
    tip: RefCell<Tip>,
    /// Ticks since the start: the board's clock, which tells the tip when a pulse came.
    tick: Cell<u64>,
    heater: RefCell<HeaterWires>,
    thermistor: ThermistorDescription,
}

#[derive(Default)]
struct HeaterWires {
    power: u16,
    enabled: bool,
}

impl HeaterWires {
    fn duty(&self) -> f64 {
        if self.enabled { f64::from(self.power) / f64::from(u16::MAX) } else { 0.0 }
    }
}

/// The parts of the simulated board.
struct SimBoard;

impl Board for SimBoard {
    type HeaterPower = HeaterPower;
    type HeaterEnable = HeaterEnable;
    type Thermistor = SimThermistor;
    type Watchdog = NoWatchdog;
    type Store = Box<LayerStore>;
}

struct StepPin {
    motor: Motor,
    wires: Rc<Wires>,
}

struct DirectionPin {
    motor: Motor,
    wires: Rc<Wires>,
}

struct EnablePin {
    motor: Motor,
    wires: Rc<Wires>,
}

struct IndexPin(Rc<Wires>);
/// An input that nothing is wired to.
struct QuietPin;
struct HeaterPower(Rc<Wires>);
struct HeaterEnable(Rc<Wires>);
struct SimThermistor(Rc<Wires>);
/// A virtual clock cannot hang.
struct NoWatchdog;

impl ErrorType for StepPin {
    type Error = Infallible;
}

impl OutputPin for StepPin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        Ok(())
    }

    /// The engine raises a pin only after lowering it, so each time is an edge.
    fn set_high(&mut self) -> Result<(), Infallible> {
        self.wires.tip.borrow_mut().step(self.motor, self.wires.tick.get());
        Ok(())
    }
}

impl ErrorType for DirectionPin {
    type Error = Infallible;
}

impl OutputPin for DirectionPin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.wires.tip.borrow_mut().direct(self.motor, false);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.wires.tip.borrow_mut().direct(self.motor, true);
        Ok(())
    }
}

impl ErrorType for EnablePin {
    type Error = Infallible;
}

impl OutputPin for EnablePin {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.wires.tip.borrow_mut().enable(self.motor, false);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.wires.tip.borrow_mut().enable(self.motor, true);
        Ok(())
    }
}

impl ErrorType for IndexPin {
    type Error = Infallible;
}

impl InputPin for IndexPin {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(self.0.tip.borrow().on_index())
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        self.is_high().map(|high| !high)
    }
}

impl ErrorType for QuietPin {
    type Error = Infallible;
}

impl InputPin for QuietPin {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(false)
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(true)
    }
}

impl pwm::ErrorType for HeaterPower {
    type Error = Infallible;
}

impl SetDutyCycle for HeaterPower {
    fn max_duty_cycle(&self) -> u16 {
        u16::MAX
    }

    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        self.0.heater.borrow_mut().power = duty;
        Ok(())
    }
}

impl ErrorType for HeaterEnable {
    type Error = Infallible;
}

impl OutputPin for HeaterEnable {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.0.heater.borrow_mut().enabled = false;
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.0.heater.borrow_mut().enabled = true;
        Ok(())
    }
}

impl Thermistor for SimThermistor {
    fn sample(&mut self) -> Option<u16> {
        Some(libm::rint(thermistor::reading(self.0.tip.borrow().nozzle().temperature(), &self.0.thermistor)) as u16)
    }
}

impl Watchdog for NoWatchdog {
    fn feed(&mut self) {}
}
