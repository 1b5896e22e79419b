//! What a board must have beyond the traits of embedded-hal.

use core::ops::DerefMut;

use embedded_hal::digital::OutputPin;
use embedded_hal::pwm::SetDutyCycle;

use crate::layer_store::LayerStore;

/// The converter that reads the thermistor's divider.
pub trait Thermistor {
    /// A reading (0 to 4095) taken since the last call, none if there is no new one. Never blocks.
    fn sample(&mut self) -> Option<u16>;
}

/// A watchdog that resets the board unless it is fed.
pub trait Watchdog {
    /// Proof of life.
    fn feed(&mut self);
}

/// The parts of a board that the controller drives. The steppers belong to the [`crate::stepping::Engine`].
pub trait Board {
    /// Power of the heater.
    type HeaterPower: SetDutyCycle;
    /// The second switch in series with it: high lets it heat.
    type HeaterEnable: OutputPin;
    /// Temperature of the nozzle.
    type Thermistor: Thermistor;
    /// The watchdog.
    type Watchdog: Watchdog;
    /// Where the layers are kept: some 48 KiB, so a reference or a box.
    type Store: DerefMut<Target = LayerStore>;
}

/// The parts themselves.
pub struct Parts<B: Board> {
    /// Power of the heater.
    pub heater_power: B::HeaterPower,
    /// The second switch in series with it.
    pub heater_enable: B::HeaterEnable,
    /// Temperature of the nozzle.
    pub thermistor: B::Thermistor,
    /// The watchdog.
    pub watchdog: B::Watchdog,
    /// Where the layers are kept.
    pub store: B::Store,
}
