//! The nozzle as the robot's description says: a lump of heat, `C dT/dt = P duty - need`.

use growbot_core::robot::RobotDescription;

use super::Demand;
use crate::thermistor;

/// Taken for the temperature of the surroundings, degrees Celsius. Ten degrees more or less are 1.2 W for robot A.
const SURROUNDINGS_C: f64 = 25.0;
/// A supply that is measured is not believed beyond these shares of the nominal voltage.
const SUPPLY: (f64, f64) = (0.5, 1.5);

/// Power to keep the nozzle at a temperature, W: loss, fan and filament.
pub fn needed_w(celsius: f64, demand: &Demand, robot: &RobotDescription) -> f64 {
    let fan = robot.fan.loss_w_per_k * demand.fan.clamp(0.0, 1.0);
    let flow = robot.filament.heat_j_per_mm3_k * demand.flow_mm3_per_s.max(0.0);
    (robot.heater.loss_w_per_k + fan + flow) * (celsius - SURROUNDINGS_C)
}

/// Power at full duty, W: it goes with the square of the supply's voltage.
pub fn available_w(demand: &Demand, robot: &RobotDescription) -> f64 {
    let share = demand.supply_v.map_or(1.0, |volts| volts / robot.supply.nominal_v).clamp(SUPPLY.0, SUPPLY.1);
    robot.heater.power_w * share * share
}

/// Degrees that one count of the converter spans round a temperature.
pub fn count_c(celsius: f64, robot: &RobotDescription) -> f64 {
    let raw = thermistor::reading(celsius, &robot.thermistor);
    match (thermistor::temperature(raw - 0.5, &robot.thermistor), thermistor::temperature(raw + 0.5, &robot.thermistor))
    {
        (Ok(above), Ok(below)) => above - below,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::robot_a;

    #[test]
    fn need_and_supply_are_those_of_the_description() {
        let robot = robot_a();
        let robot = robot.description();
        let still = Demand::default();
        assert!((needed_w(200.0, &still, robot) - 0.12 * 175.0).abs() < 1e-9);
        let growing = Demand { flow_mm3_per_s: 10.0, fan: 1.0, supply_v: Some(13.2) };
        assert!((needed_w(200.0, &growing, robot) - (0.12 + 0.02 + 0.022) * 175.0).abs() < 1e-9);
        assert!((available_w(&growing, robot) - 50.0 * 1.21).abs() < 1e-9);
        assert!((available_w(&still, robot) - 50.0).abs() < 1e-9);
    }

    #[test]
    fn a_count_is_an_eighth_of_a_degree_where_robot_a_prints() {
        let count = count_c(200.0, robot_a().description());
        assert!((0.1..0.15).contains(&count), "{count}");
    }
}
