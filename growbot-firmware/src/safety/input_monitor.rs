//! Monitor of the inputs that indicate danger. A level must persist over several samples, ten a second, before it
//! counts, because wires pick up noise.

use growbot_core::link::message::Fault;
use growbot_core::robot::{RobotDescription, Supply};

/// Number of consecutive bad samples that raise a fault of the supply or of a driver. The samples take 0.2 s. There are
/// two, so that one disturbed sample raises no fault (`transient_inputs_are_not_faults`). SAFETY.md states the time of
/// detection, and `cargo fault-campaign` measures it.
const FAULT_SAMPLES: u8 = 2;
/// Number of consecutive samples without filament that raise a fault. The samples take 0.5 s, because the switch
/// bounces as the filament's end passes. `cargo fault-campaign` measures the time of detection.
const NO_FILAMENT_SAMPLES: u8 = 5;
/// Number of consecutive samples without a reading of the supply's voltage that raise a fault. The samples take 1 s, as
/// in SAFETY.md. The derivation of this value is not recorded.
const NO_VOLTAGE_SAMPLES: u8 = 10;

/// Sample of the inputs that can indicate danger. A value is `None` if the robot has no such sensor, or if the sensor
/// gives no reading.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct InputSample {
    /// Voltage of the supply, V. `None` without a sensor or a reading.
    pub supply_v: Option<f64>,
    /// True if filament is present. `None` without a sensor.
    pub filament_present: Option<bool>,
    /// True if a stepper driver reports a fault. `None` without a sensor.
    pub driver_fault: Option<bool>,
}

/// Consequence of missing filament.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MissingFilament {
    /// The filament is needed, so that its absence is a fault.
    Fault,
    /// The filament is not needed.
    Ignored,
}

/// Counters of the consecutive samples in which each input was wrong.
#[derive(Debug, Clone, Copy, Default)]
pub struct InputMonitor {
    no_voltage: u8,
    low: u8,
    high: u8,
    driver: u8,
    no_filament: u8,
}

/// Increments the counter if `is_so`, and resets it to 0 otherwise. Returns the counter.
fn count(counter: &mut u8, is_so: bool) -> u8 {
    *counter = if is_so { counter.saturating_add(1) } else { 0 };
    *counter
}

impl InputMonitor {
    /// Processes a sample of the inputs. Returns a fault if a wrong input has persisted for long enough.
    pub fn update(&mut self, look: &InputSample, robot: &RobotDescription, missing: MissingFilament) -> Option<Fault> {
        let low = look.supply_v.is_some_and(|volts| volts < robot.supply.min_v);
        let high = look.supply_v.is_some_and(|volts| volts > robot.supply.max_v);
        let no_filament = missing == MissingFilament::Fault && look.filament_present == Some(false);
        let blind = robot.sensors.supply && look.supply_v.is_none();
        // Every counter is updated, even if another one has found a fault.
        let found = [
            (count(&mut self.driver, look.driver_fault == Some(true)) >= FAULT_SAMPLES, Fault::DriverFault),
            (count(&mut self.low, low) >= FAULT_SAMPLES, Fault::SupplyLow),
            (count(&mut self.high, high) >= FAULT_SAMPLES, Fault::SupplyHigh),
            // If the voltage cannot be read, it may be too low.
            (count(&mut self.no_voltage, blind) >= NO_VOLTAGE_SAMPLES, Fault::SupplyLow),
            (count(&mut self.no_filament, no_filament) >= NO_FILAMENT_SAMPLES, Fault::FilamentOut),
        ];
        found.iter().find(|(is_so, _)| *is_so).map(|(_, fault)| *fault)
    }
}

/// Returns the supply's voltage, V, from a mean of ADC readings (0 to 4095) of the supply's divider.
pub fn volts(raw: f64, supply: &Supply) -> f64 {
    raw / f64::from(crate::thermistor::FULL_SCALE) * supply.full_scale_v
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::robot_a;

    const FINE: InputSample =
        InputSample { supply_v: Some(12.0), filament_present: Some(true), driver_fault: Some(false) };

    /// Returns the number of samples after which this fault is found.
    fn looks_to(fault: Fault, look: InputSample) -> u32 {
        let robot = robot_a();
        let mut inputs = InputMonitor::default();
        for looks in 1..100 {
            if let Some(found) = inputs.update(&look, robot.description(), MissingFilament::Fault) {
                assert_eq!(found, fault);
                return looks;
            }
        }
        panic!("{look:?} was never found");
    }

    #[test]
    fn each_input_causes_its_fault_after_its_number_of_samples() {
        assert_eq!(looks_to(Fault::DriverFault, InputSample { driver_fault: Some(true), ..FINE }), 2);
        assert_eq!(looks_to(Fault::SupplyLow, InputSample { supply_v: Some(10.1), ..FINE }), 2);
        assert_eq!(looks_to(Fault::SupplyHigh, InputSample { supply_v: Some(14.1), ..FINE }), 2);
        assert_eq!(looks_to(Fault::SupplyLow, InputSample { supply_v: None, ..FINE }), 10);
        assert_eq!(looks_to(Fault::FilamentOut, InputSample { filament_present: Some(false), ..FINE }), 5);
    }

    #[test]
    fn a_reading_at_a_limit_is_not_a_fault() {
        let robot = robot_a();
        let supply = &robot.description().supply;
        for volts in [supply.min_v, supply.max_v] {
            let mut inputs = InputMonitor::default();
            let look = InputSample { supply_v: Some(volts), ..FINE };
            assert!(
                (0..20).all(|_| inputs.update(&look, robot.description(), MissingFilament::Fault).is_none()),
                "{volts} V"
            );
        }
    }

    #[test]
    fn adc_full_scale_matches_the_divider() {
        let robot = robot_a();
        let supply = &robot.description().supply;
        for (raw, share) in [(0.0, 0.0), (1023.75, 0.25), (4095.0, 1.0)] {
            assert!((volts(raw, supply) - share * supply.full_scale_v).abs() < 1e-12);
        }
    }

    #[test]
    fn transient_inputs_are_not_faults() {
        let robot = robot_a();
        let mut inputs = InputMonitor::default();
        for round in 0..100 {
            let noisy = InputSample { supply_v: Some(9.0), driver_fault: Some(true), filament_present: Some(false) };
            let look = if round % 2 == 0 { noisy } else { FINE };
            assert_eq!(inputs.update(&look, robot.description(), MissingFilament::Fault), None);
        }
    }

    #[test]
    fn missing_filament_is_a_fault_only_if_it_is_needed() {
        let robot = robot_a();
        let mut inputs = InputMonitor::default();
        for _ in 0..100 {
            let look = InputSample { filament_present: Some(false), ..FINE };
            assert_eq!(inputs.update(&look, robot.description(), MissingFilament::Ignored), None);
        }
    }

    #[test]
    fn a_robot_without_sensors_has_no_sensor_faults() {
        let mut description = robot_a().description().clone();
        description.sensors = growbot_core::robot::Sensors::default();
        let mut inputs = InputMonitor::default();
        for _ in 0..100 {
            assert_eq!(inputs.update(&InputSample::default(), &description, MissingFilament::Fault), None);
        }
    }
}
