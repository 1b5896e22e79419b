//! The traits of a board, beyond those of embedded-hal.
//!
//! Levels are logical: a board that wires a pin the other way round wraps it in [`crate::polarity::Polarized`]. A robot
//! need not have every sensor; pins of those that its description does not name are never asked.

use core::ops::DerefMut;

use embedded_hal::digital::{InputPin, OutputPin};
use embedded_hal::pwm::SetDutyCycle;
use embedded_storage::nor_flash::MultiwriteNorFlash;
use growbot_core::link::message::DriverTrouble;
use growbot_core::robot::BoardKind;

use crate::descriptions::Descriptions;
use crate::journal::Journal;
use crate::layer_store::LayerStore;
use crate::safety::retained::{COPY_BYTES, RETAINED_BYTES};

/// A channel of a 12-bit ADC.
pub trait Adc {
    /// A reading (0 to 4095) taken since the last call, none if there is no new one. Never blocks.
    fn sample(&mut self) -> Option<u16>;
}

/// The tip's orientation sensor.
pub trait Orientation {
    /// Gravity in the tip's frame, thousandths of the earth's, upwards as a resting accelerometer shows it; none where
    /// the sensor does not answer. Takes a millisecond at most.
    fn gravity(&mut self) -> Option<[i16; 3]>;
}

/// A watchdog that resets the board unless it is fed.
pub trait Watchdog {
    /// Proof of life.
    fn feed(&mut self);
}

/// The processor's debugging.
pub trait DebugPort {
    /// Whether a debug probe has switched it on. The processor may then halt at any time; it stays on when the probe is
    /// unplugged, until the power goes.
    fn is_on(&self) -> bool;
}

/// A board that cannot be halted.
pub struct NoDebugPort;

impl DebugPort for NoDebugPort {
    fn is_on(&self) -> bool {
        false
    }
}

/// The stepper drivers, as far as a serial line reaches them.
pub trait Drivers {
    /// Does what is due at a time, us since the board started. Never waits. The motors are `in_use` while they are
    /// energised or may soon be.
    fn poll(&mut self, now: u64, in_use: bool);
    /// Whether each of them is configured. Until then no motor may be energised.
    fn are_configured(&self) -> bool;
    /// What is wrong with one of them.
    fn trouble(&self) -> Option<DriverTrouble>;
}

/// Drivers without a serial line: current and microsteps are set on them.
pub struct NoDrivers;

impl Drivers for NoDrivers {
    fn poll(&mut self, _now: u64, _in_use: bool) {}

    fn are_configured(&self) -> bool {
        true
    }

    fn trouble(&self) -> Option<DriverTrouble> {
        None
    }
}

/// A board that has the line, for a robot that need not use it.
impl<D: Drivers> Drivers for Option<D> {
    fn poll(&mut self, now: u64, in_use: bool) {
        if let Some(drivers) = self {
            drivers.poll(now, in_use);
        }
    }

    fn are_configured(&self) -> bool {
        self.as_ref().is_none_or(Drivers::are_configured)
    }

    fn trouble(&self) -> Option<DriverTrouble> {
        self.as_ref()?.trouble()
    }
}

/// All outputs of the tip at once, for an interrupt that must not wait for their owners in the main loop.
pub trait Outputs {
    /// Heater, fan and both drivers off, now, from any context. It cannot fail and never waits.
    fn make_safe(&mut self);
}

/// Memory that survives a reset, though not a loss of power.
pub trait RetainedMemory {
    /// Reads its content: [`COPIES`](crate::safety::retained::COPIES) copies, one after the other.
    fn read(&mut self) -> [u8; RETAINED_BYTES];
    /// Writes one of the copies, from its first byte to its last. The other copy is not touched. Everything that
    /// follows comes after the last byte is in the memory.
    fn write(&mut self, copy: usize, bytes: &[u8; COPY_BYTES]);
}

/// The parts of a board that the controller drives. Steppers, index sensor, filament encoder and emergency stop belong
/// to the [`crate::stepping::Engine`].
pub trait Board {
    /// The kinds of board that it can be, as robot files name them; none for one that takes any robot.
    const KINDS: &'static [BoardKind] = &[];
    /// Power of the heater.
    type HeaterPower: SetDutyCycle;
    /// The second switch in series with it: high lets it heat.
    type HeaterEnable: OutputPin;
    /// The fan that cools what is printed.
    type Fan: SetDutyCycle;
    /// The thermistor's divider.
    type Thermistor: Adc;
    /// The supply's divider.
    type Supply: Adc;
    /// High while there is filament.
    type FilamentPresence: InputPin;
    /// High while a stepper driver reports a fault.
    type DriverFault: InputPin;
    /// The stepper drivers' serial line.
    type Drivers: Drivers;
    /// The tip's orientation.
    type Orientation: Orientation;
    /// The watchdog.
    type Watchdog: Watchdog;
    /// The processor's debugging.
    type DebugPort: DebugPort;
    /// The memory that survives a reset.
    type Retained: RetainedMemory;
    /// The flash of the journal, and that of the robot's description: each has two sectors or more, whose programmed
    /// words can be programmed again: to the same, and to zero.
    type Flash: MultiwriteNorFlash;
    /// The store of layers: some 48 KiB, so a reference or a box.
    type Store: DerefMut<Target = LayerStore>;
}

/// The parts themselves.
pub struct Parts<B: Board> {
    /// Power of the heater.
    pub heater_power: B::HeaterPower,
    /// The second switch in series with it.
    pub heater_enable: B::HeaterEnable,
    /// The fan.
    pub fan: B::Fan,
    /// Temperature of the nozzle.
    pub thermistor: B::Thermistor,
    /// Voltage of the supply.
    pub supply: B::Supply,
    /// Whether there is filament.
    pub filament_presence: B::FilamentPresence,
    /// Whether a driver is well.
    pub driver_fault: B::DriverFault,
    /// The drivers themselves, over their serial line.
    pub drivers: B::Drivers,
    /// The tip's orientation.
    pub orientation: B::Orientation,
    /// The watchdog.
    pub watchdog: B::Watchdog,
    /// The processor's debugging.
    pub debug_port: B::DebugPort,
    /// The memory that survives a reset.
    pub retained: B::Retained,
    /// The journal, opened.
    pub journal: Journal<B::Flash>,
    /// The robot's description, opened.
    pub descriptions: Descriptions<B::Flash>,
    /// The store of layers.
    pub store: B::Store,
}
