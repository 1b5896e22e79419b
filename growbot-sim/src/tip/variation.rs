//! How one copy of a robot differs from its description.

use super::cartridge::Parts;

/// What may vary from one copy of a robot to the next, and from one day to the next.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Variation {
    /// The heater's power, as a multiple of the description's.
    pub power: f64,
    /// The nozzle's heat capacity, as a multiple of the description's.
    pub heat_capacity: f64,
    /// The nozzle's loss, as a multiple of the description's.
    pub loss: f64,
    /// The nozzle as its parts, with the thermistor 104GT-2; none for one lump of heat with a thermistor that follows its equation.
    pub parts: Option<Parts>,
    /// Temperature of the surroundings, degrees Celsius.
    pub ambient_c: f64,
    /// Voltage of the supply, V; none for the description's nominal one.
    pub supply_v: Option<f64>,
    /// Time constant with which the thermistor follows the nozzle, s.
    pub sensor_lag_s: f64,
    /// Noise of the ADC, counts (root mean square).
    pub noise_counts: f64,
    /// Where the noise comes from: the same seed gives the same noise.
    pub seed: u64,
}

impl Default for Variation {
    /// The robot as described, in a room of 22 degrees Celsius.
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
