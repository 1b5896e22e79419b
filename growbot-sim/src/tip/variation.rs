//! Differences of one copy of a robot from its description.

use super::cartridge::CartridgeParameters;

/// Parameters that vary between copies of a robot, and from day to day.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Variation {
    /// Factor of the heater's power relative to the description.
    pub power: f64,
    /// Factor of the nozzle's heat capacity relative to the description.
    pub heat_capacity: f64,
    /// Factor of the nozzle's heat loss relative to the description.
    pub loss: f64,
    /// Parameters of a nozzle whose cartridge and block are simulated separately, with the thermistor 104GT-2. `None`
    /// for a nozzle with one temperature, whose thermistor follows the equation of the description.
    pub parts: Option<CartridgeParameters>,
    /// Temperature of the surroundings, degrees Celsius.
    pub ambient_c: f64,
    /// Voltage of the supply, V. `None` for the description's nominal voltage.
    pub supply_v: Option<f64>,
    /// Time constant with which the thermistor follows the nozzle, s.
    pub sensor_lag_s: f64,
    /// Noise of the ADC, counts (root mean square).
    pub noise_counts: f64,
    /// Seed of the noise. The same seed gives the same noise.
    pub seed: u64,
}

impl Default for Variation {
    /// Returns the parameters of a robot that matches its description, in a room at 22 degrees Celsius.
    fn default() -> Self {
        Self {
            power: 1.0,
            heat_capacity: 1.0,
            loss: 1.0,
            parts: None,
            ambient_c: 22.0,
            supply_v: None,
            sensor_lag_s: 2.0,
            noise_counts: 1.0,
            seed: 1,
        }
    }
}
