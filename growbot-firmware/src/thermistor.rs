//! Conversion of an ADC's readings of the thermistor to temperatures.
//!
//! The thermistor (NTC) is connected between the input and ground, a pull-up resistor between the input and the ADC's
//! reference: `raw / 4095 = R / (R + R_pull_up)`. Its resistance follows either the Beta equation, `1/T = 1/298.15 K +
//! ln(R / R_25) / Beta`, or that of Steinhart and Hart (Deep-Sea Res. 15, 1968), `1/T = A + B ln R + C (ln R)^3`.

use growbot_core::robot::Thermistor;

/// Max reading of the 12-bit ADC.
pub const FULL_SCALE: u16 = 4095;
/// Min reading that means an open wire of the thermistor. Robot A's thermistor has this reading at -33 degrees Celsius,
/// by its Beta equation. The derivation of this value is not recorded. `both_ends_of_the_adc_scale_are_sensor_faults`
/// and `cargo fault-campaign` (open wire) bound it.
const OPEN_MIN_RAW: f64 = FULL_SCALE as f64 - 8.0;
/// Max reading that means touching wires of the thermistor. Robot A's thermistor has this reading at 436 degrees
/// Celsius, by its Beta equation, far above any nozzle.
const SHORT_MAX_RAW: f64 = 40.0;
/// Temperature of 0 degrees Celsius, K.
const ZERO_C: f64 = 273.15;
/// Temperature of 25 degrees Celsius, at which `r25_ohm` is defined, K.
const T25_K: f64 = 298.15;

/// The reason why a reading of the thermistor is not a temperature.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ThermistorError {
    /// A wire of the thermistor is open.
    Open,
    /// The wires of the thermistor touch.
    Short,
}

/// Returns the coefficients A, B and C of the equation of Steinhart and Hart. With C = 0 it is the Beta equation.
fn coefficients(thermistor: &Thermistor) -> [f64; 3] {
    match (thermistor.steinhart_hart, thermistor.r25_ohm, thermistor.beta_k) {
        (Some(coefficients), _, _) => coefficients,
        (None, Some(r25_ohm), Some(beta_k)) => [1.0 / T25_K - libm::log(r25_ohm) / beta_k, 1.0 / beta_k, 0.0],
        // No checked description reaches this branch. With these coefficients any reading counts as a broken sensor.
        _ => [0.0; 3],
    }
}

/// Returns whether a conversion is at either end of the scale, which only a broken sensor reaches.
pub fn is_out_of_range(raw: u16) -> bool {
    f64::from(raw) >= OPEN_MIN_RAW || f64::from(raw) <= SHORT_MAX_RAW
}

/// Converts a reading of the ADC (0 to 4095, not necessarily whole, if it is a mean) to degrees Celsius.
///
/// # Errors
/// Returns the defect if the reading is at either end of the scale, which only a broken sensor reaches.
pub fn celsius_from_raw(raw: f64, thermistor: &Thermistor) -> Result<f64, ThermistorError> {
    if raw >= OPEN_MIN_RAW {
        return Err(ThermistorError::Open);
    }
    if raw <= SHORT_MAX_RAW {
        return Err(ThermistorError::Short);
    }
    let log = libm::log(raw / (f64::from(FULL_SCALE) - raw) * thermistor.pull_up_ohm);
    let [a, b, c] = coefficients(thermistor);
    let inverse = a + (b + c * log * log) * log;
    // The value is outside the range of the equation. It would be a temperature below absolute zero, and make the
    // heater heat.
    if inverse <= 0.0 {
        return Err(ThermistorError::Short);
    }
    Ok(1.0 / inverse - ZERO_C)
}

/// Solves `1/T = a + b ln R + c (ln R)^3`, in 1/K, for `ln R`; `b` is positive and `c` is not negative.
///
/// Newton's method starts at the solution without the term of `c`. That value lies beyond the root, and the curve is
/// bent such that each step gets nearer to the root and never passes it. If `c` is 0, the first value is the root.
fn log_resistance(inverse: f64, [a, b, c]: [f64; 3]) -> f64 {
    let mut log = (inverse - a) / b;
    for _ in 0..60 {
        let square = log * log;
        let step = (a + (b + c * square) * log - inverse) / (b + 3.0 * c * square);
        log -= step;
        if step.abs() <= 1e-14 * log.abs() {
            break;
        }
    }
    log
}

/// Converts degrees Celsius to the reading of the ADC with this thermistor, 0 to 4095, not rounded. The simulated tip
/// uses it.
pub fn raw_from_celsius(temperature_c: f64, thermistor: &Thermistor) -> f64 {
    let inverse = 1.0 / (temperature_c + ZERO_C).max(1.0);
    // No thermistor has less than 1e-9 ohm or more than 1e17.
    let resistance = libm::exp(log_resistance(inverse, coefficients(thermistor)).clamp(-20.0, 40.0));
    resistance / (resistance + thermistor.pull_up_ohm) * f64::from(FULL_SCALE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::robot_a;

    #[test]
    fn temperatures_round_trip() {
        let thermistor = robot_a().description().thermistor;
        for celsius in [-20.0, 0.0, 25.0, 100.0, 180.0, 200.0, 240.0, 300.0] {
            let again = celsius_from_raw(raw_from_celsius(celsius, &thermistor), &thermistor).unwrap();
            assert!((again - celsius).abs() < 1e-6, "{celsius} came back as {again}");
        }
    }

    #[test]
    fn no_reading_of_any_thermistor_is_colder_than_absolute_zero() {
        for beta_k in [500.0, 3950.0, 10_000.0] {
            for pull_up_ohm in [10.0, 4700.0, 1e7] {
                let thermistor =
                    Thermistor { r25_ohm: Some(100_000.0), beta_k: Some(beta_k), steinhart_hart: None, pull_up_ohm };
                for raw in (0..=FULL_SCALE).map(f64::from) {
                    assert!(
                        celsius_from_raw(raw, &thermistor).is_err()
                            || celsius_from_raw(raw, &thermistor).unwrap() > -ZERO_C
                    );
                }
            }
        }
    }

    #[test]
    fn both_ends_of_the_adc_scale_are_sensor_faults() {
        let thermistor = robot_a().description().thermistor;
        assert_eq!(celsius_from_raw(f64::from(FULL_SCALE), &thermistor), Err(ThermistorError::Open));
        assert_eq!(celsius_from_raw(0.0, &thermistor), Err(ThermistorError::Short));
    }

    #[test]
    fn steinhart_hart_without_third_term_equals_beta() {
        let beta = robot_a().description().thermistor;
        let [a, b, _] = coefficients(&beta);
        let same = Thermistor { r25_ohm: None, beta_k: None, steinhart_hart: Some([a, b, 0.0]), ..beta };
        for raw in (41..4087).map(f64::from) {
            assert_eq!(celsius_from_raw(raw, &same), celsius_from_raw(raw, &beta));
        }
    }

    #[test]
    fn the_third_term_scales_with_the_cubed_logarithm() {
        let [a, b, c] = [0.7e-3, 2.1e-4, 0.9e-7];
        let thermistor =
            Thermistor { r25_ohm: None, beta_k: None, steinhart_hart: Some([a, b, c]), pull_up_ohm: 4700.0 };
        for ohm in [100.0_f64, 1e3, 1e4, 1e5] {
            let raw = ohm / (ohm + 4700.0) * f64::from(FULL_SCALE);
            let log = libm::log(ohm);
            let celsius = 1.0 / (a + b * log + c * log * log * log) - ZERO_C;
            assert!((celsius_from_raw(raw, &thermistor).unwrap() - celsius).abs() < 1e-9);
            assert!((raw_from_celsius(celsius, &thermistor) - raw).abs() < 1e-6);
        }
    }
}
