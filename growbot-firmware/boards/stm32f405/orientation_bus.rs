//! The bus to the tip's orientation sensor: I2C on PB10 and PB11, with the module `soft_i2c` of the library.

use embedded_hal::delay::DelayNs;
use growbot_firmware::bmi160_sensor::Bmi160Sensor;
use growbot_firmware::soft_i2c::SoftI2c;

use crate::pins::{OrientationClock, OrientationData};

/// The orientation sensor on this board's I2C bus.
pub type BoardOrientation = Bmi160Sensor<SoftI2c<OrientationClock, OrientationData, LoopDelay>>;

/// Delay by a loop that counts the processor's cycles.
pub struct LoopDelay {
    /// Number of rounds of the waiting loop that take at least 1 us.
    rounds_per_us: u32,
}

impl DelayNs for LoopDelay {
    fn delay_ns(&mut self, ns: u32) {
        cortex_m::asm::delay(ns.saturating_mul(self.rounds_per_us) / 1000);
    }
}

/// Creates the orientation sensor on these pins. Nothing is sent to it yet.
pub fn orientation(clock: OrientationClock, data: OrientationData, processor_hz: u32) -> BoardOrientation {
    // A round is a subtraction and a taken branch: 2 to 4 cycles (Cortex-M4 reference manual, 3.3.1).
    let rounds_per_us = processor_hz.div_ceil(2_000_000);
    Bmi160Sensor::new(SoftI2c::new(clock, data, LoopDelay { rounds_per_us }))
}
