//! The nozzle as one lump of heat: `C dT/dt = P duty - k (T - T_room)`.

use growbot_core::robot::Heater;

/// Temperature of the surroundings, degrees Celsius.
pub const ROOM_C: f64 = 22.0;

/// A nozzle that warms and cools.
#[derive(Debug, Clone, PartialEq)]
pub struct Nozzle {
    temperature: f64,
    power: f64,
    heat_capacity: f64,
    loss: f64,
}

impl Nozzle {
    /// A nozzle at room temperature.
    #[must_use]
    pub fn new(heater: &Heater) -> Self {
        Self {
            temperature: ROOM_C,
            power: heater.power_w,
            heat_capacity: heater.heat_capacity_j_per_k,
            loss: heater.loss_w_per_k,
        }
    }

    /// Degrees Celsius.
    #[must_use]
    pub fn temperature(&self) -> f64 {
        self.temperature
    }

    /// Heats at a steady duty (0 to 1) for some seconds. Exact for any time.
    pub fn heat(&mut self, duty: f64, seconds: f64) {
        let settled = ROOM_C + self.power * duty / self.loss;
        let left = libm::exp(-self.loss / self.heat_capacity * seconds);
        self.temperature = settled + (self.temperature - settled) * left;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_short_times_are_one_long_time_and_it_settles_where_losses_balance() {
        let robot = crate::robot_file::load("growbot-a".as_ref()).unwrap();
        let heater = &robot.description().heater;
        let (mut once, mut twice) = (Nozzle::new(heater), Nozzle::new(heater));
        once.heat(0.5, 20.0);
        twice.heat(0.5, 8.0);
        twice.heat(0.5, 12.0);
        assert!((once.temperature() - twice.temperature()).abs() < 1e-9);
        once.heat(0.5, 1e5);
        assert!((once.temperature() - (ROOM_C + 0.5 * heater.power_w / heater.loss_w_per_k)).abs() < 1e-9);
        once.heat(0.0, 1e5);
        assert!((once.temperature() - ROOM_C).abs() < 1e-9);
    }
}
