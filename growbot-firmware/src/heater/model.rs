//! Model of the nozzle from the robot's description, with one heat capacity: `C dT/dt = P duty - need`. The *need* is
//! the power that the nozzle loses at its temperature, to its surroundings, fan and filament. The heater must deliver
//! the need to hold the temperature.

use growbot_core::robot::{RobotDescription, Thermistor};

use crate::thermistor;

/// Assumed temperature of the surroundings, degrees Celsius. A difference of ten degrees changes the power that robot A
/// needs to hold a temperature by 1.2 W. The trials cover 15 to 35 C (`heater::tests::plant`).
const SURROUNDINGS_C: f32 = 25.0;
/// Min supply voltage with which the model computes, as a share of the nominal voltage. A lower voltage is a fault of
/// the supply (`supply.min_v`). The limit also prevents a division by zero. No trial bounds this limit.
const MIN_SUPPLY: f64 = 0.5;
/// Max supply voltage with which the model computes, as a share of the nominal voltage. See [`MIN_SUPPLY`].
const MAX_SUPPLY: f64 = 1.5;

/// The load of the nozzle, and the supply voltage of its heater.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Demand {
    /// Flow of plastic through the nozzle, mm^3/s.
    pub flow_mm3_per_s: f64,
    /// Duty of the fan, 0 to 1.
    pub fan: f64,
    /// Measured supply voltage, V. `None` without a sensor.
    pub supply_v: Option<f64>,
}

/// Model of the nozzle under a load. It is in single precision, which the microcontroller's hardware computes. Readings
/// are accurate to five digits.
pub struct NozzleModel<'a> {
    thermistor: &'a Thermistor,
    /// Power that the nozzle needs for each degree above the surroundings, W/K: losses to the surroundings and the fan,
    /// and the heating of filament.
    pub loss_w_per_k: f32,
    /// Power of the heater at full duty and the present supply voltage, W. It is proportional to the square of the
    /// voltage.
    pub available_w: f32,
    /// Power of the heater at full duty and the nominal supply voltage, W.
    pub power_w: f32,
    /// True if the supply voltage is measured.
    pub measured: bool,
    pub heat_capacity_j_per_k: f32,
    pub max_c: f32,
    pub band_c: f32,
    pub kp: f32,
    pub ki: f32,
    pub kd: f32,
}

impl<'a> NozzleModel<'a> {
    pub fn new(demand: &Demand, robot: &'a RobotDescription) -> Self {
        let heater = &robot.heater;
        let fan = robot.fan.loss_w_per_k * demand.fan.clamp(0.0, 1.0);
        let flow = robot.filament.heat_j_per_mm3_k * demand.flow_mm3_per_s.max(0.0);
        let share = demand.supply_v.map_or(1.0, |volts| volts / robot.supply.nominal_v).clamp(MIN_SUPPLY, MAX_SUPPLY);
        Self {
            thermistor: &robot.thermistor,
            loss_w_per_k: (heater.loss_w_per_k + fan + flow) as f32,
            available_w: (heater.power_w * share * share) as f32,
            power_w: heater.power_w as f32,
            measured: demand.supply_v.is_some(),
            heat_capacity_j_per_k: heater.heat_capacity_j_per_k as f32,
            max_c: heater.max_c as f32,
            band_c: heater.band_c as f32,
            kp: heater.kp as f32,
            ki: heater.ki as f32,
            kd: heater.kd as f32,
        }
    }

    /// Returns the holding power of a temperature, W: the power that keeps the nozzle at that temperature.
    pub fn needed_w(&self, celsius: f32) -> f32 {
        self.loss_w_per_k * (celsius - SURROUNDINGS_C)
    }

    /// Returns the change of temperature that corresponds to one count of the ADC at a temperature, degrees.
    pub fn count_c(&self, celsius: f32) -> f32 {
        let raw = thermistor::raw_from_celsius(f64::from(celsius), self.thermistor);
        match (
            thermistor::celsius_from_raw(raw - 0.5, self.thermistor),
            thermistor::celsius_from_raw(raw + 0.5, self.thermistor),
        ) {
            (Ok(above), Ok(below)) => (above - below) as f32,
            _ => 0.0,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::robot_a;

    #[test]
    fn needed_and_available_power_match_the_description() {
        let robot = robot_a();
        let still = NozzleModel::new(&Demand::default(), robot.description());
        assert!((still.needed_w(200.0) - 0.12 * 175.0).abs() < 1e-4);
        assert!((still.available_w - 50.0).abs() < 1e-4 && !still.measured);
        let growing = Demand { flow_mm3_per_s: 10.0, fan: 1.0, supply_v: Some(13.2) };
        let growing = NozzleModel::new(&growing, robot.description());
        assert!((growing.needed_w(200.0) - (0.12 + 0.02 + 0.022) * 175.0).abs() < 1e-4);
        assert!((growing.available_w - 50.0 * 1.21).abs() < 1e-4 && growing.measured);
    }

    #[test]
    fn one_adc_count_is_an_eighth_of_a_degree_at_robot_a_temperature() {
        let count = NozzleModel::new(&Demand::default(), robot_a().description()).count_c(200.0);
        assert!((0.1..0.15).contains(&count), "{count}");
    }
}
