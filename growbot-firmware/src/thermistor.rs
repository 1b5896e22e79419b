//! From a reading of the converter to a temperature.
//!
//! The thermistor (NTC) lies between the input and ground, a pull-up resistor between the input and the converter's
//! reference: `raw / 4095 = R / (R + R_pull_up)`. Its resistance follows the Beta equation,
//! `1/T = 1/298.15 K + ln(R / R_25) / Beta`.

use growbot_core::robot::Thermistor;

/// The greatest reading of the 12-bit converter.
pub const FULL_SCALE: u16 = 4095;
/// Readings at least this high mean a cut wire: robot A's thermistor reads this at -60 degrees Celsius.
const OPEN_FROM: u16 = FULL_SCALE - 8;
/// Readings at most this high mean touching wires: robot A's thermistor reads this at 450 degrees Celsius.
const SHORT_UP_TO: u16 = 40;
/// 0 degrees Celsius, K.
const ZERO_C: f64 = 273.15;
/// 25 degrees Celsius, K.
const ROOM: f64 = 298.15;

/// Why a reading is no temperature.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Broken {
    /// As if the wire were cut.
    Open,
    /// As if the wires touched.
    Short,
}

/// Temperature of a reading, degrees Celsius.
///
/// # Errors
/// A reading at either end of the scale, where only a broken sensor is.
pub fn temperature(raw: u16, thermistor: &Thermistor) -> Result<f64, Broken> {
    if raw >= OPEN_FROM {
        return Err(Broken::Open);
    }
    if raw <= SHORT_UP_TO {
        return Err(Broken::Short);
    }
    let ratio = f64::from(raw) / f64::from(FULL_SCALE - raw);
    let resistance = ratio * thermistor.pull_up_ohm;
    let inverse = 1.0 / ROOM + libm::log(resistance / thermistor.r25_ohm) / thermistor.beta_k;
    // Beyond what the equation can mean: it would come out as colder than absolute zero, and call for heat.
    if inverse <= 0.0 {
        return Err(Broken::Short);
    }
    Ok(1.0 / inverse - ZERO_C)
}

/// The reading of a temperature: what a simulated tip shows.
#[must_use]
pub fn reading(temperature_c: f64, thermistor: &Thermistor) -> u16 {
    let inverse = 1.0 / (temperature_c + ZERO_C).max(1.0);
    let resistance = thermistor.r25_ohm * libm::exp(thermistor.beta_k * (inverse - 1.0 / ROOM));
    let share = resistance / (resistance + thermistor.pull_up_ohm);
    libm::rint(share * f64::from(FULL_SCALE)) as u16
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::robot_a;

    #[test]
    fn a_temperature_reads_back() {
        let thermistor = robot_a().description().thermistor;
        for celsius in [-20.0, 0.0, 25.0, 100.0, 180.0, 200.0, 240.0, 300.0] {
            let again = temperature(reading(celsius, &thermistor), &thermistor).unwrap();
            // One count of the converter is up to 3 degrees at the cold end and 0.5 at 200.
            assert!(
                (again - celsius).abs() < if celsius < 100.0 { 3.0 } else { 1.0 },
                "{celsius} came back as {again}"
            );
        }
    }

    #[test]
    fn no_reading_of_any_thermistor_is_colder_than_absolute_zero() {
        for beta_k in [500.0, 3950.0, 10_000.0] {
            for pull_up_ohm in [10.0, 4700.0, 1e7] {
                let thermistor = Thermistor { r25_ohm: 100_000.0, beta_k, pull_up_ohm };
                for raw in 0..=u16::MAX {
                    assert!(temperature(raw, &thermistor).is_err() || temperature(raw, &thermistor).unwrap() > -ZERO_C);
                }
            }
        }
    }

    #[test]
    fn both_ends_of_the_scale_are_a_broken_sensor() {
        let thermistor = robot_a().description().thermistor;
        assert_eq!(temperature(FULL_SCALE, &thermistor), Err(Broken::Open));
        assert_eq!(temperature(0, &thermistor), Err(Broken::Short));
    }
}
