//! Errors of layers and measurements in a simulation, with their distributions: JSON, text, columns.

use growbot_core::simulation::{ErrorModel, SimulatedSensors};
use growbot_core::tracking::SensorNoise;
use growbot_plan::run_log::{Distribution, DisturbancesJson, Unit};
use serde::Serialize;

use super::Simulation;

/// Errors of layers and measurements, each with its distribution.
#[derive(Serialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct DisturbanceReport {
    /// Errors of layers and measurements.
    #[serde(flatten)]
    pub errors: DisturbancesJson,
    /// Error of the odometry's scale, in closed loop only.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub odometry_scale: Option<Distribution>,
}

impl DisturbanceReport {
    /// Returns the disturbances of a simulation with this seed.
    pub fn of(simulation: &Simulation, seed: u64) -> Self {
        let sensors = simulation.sensors.as_ref();
        let noise = sensors.map_or(SensorNoise { odometry: 0.0, direction: 0.0 }, |sensors| sensors.noise);
        let errors = DisturbancesJson::from(&ErrorModel { disturbance: simulation.disturbance, noise, seed });
        let scale = |sensors: &SimulatedSensors| Distribution::Constant {
            value: 100.0 * sensors.odometry_scale,
            unit: Unit::Percent,
        };
        Self { errors, odometry_scale: sensors.map(scale) }
    }

    /// Returns all errors: their names in files and in text, and their distributions.
    fn all(&self) -> Vec<([&'static str; 2], &Distribution)> {
        let errors = &self.errors;
        let all = [
            (["growth_noise", "growth of each layer"], &errors.growth_noise),
            (["growth_bias", "growth of each layer"], &errors.growth_bias),
            (["tilt_noise", "tilt, about either axis"], &errors.tilt_noise),
            (["tilt_bias", "tilt"], &errors.tilt_bias),
            (["alpha_noise", "deposition angle"], &errors.alpha_noise),
            (["alpha_bias", "deposition angle"], &errors.alpha_bias),
            (["twist_noise", "twist of each layer"], &errors.twist_noise),
            (["twist_bias", "twist of each layer"], &errors.twist_bias),
            (["odometry_noise", "odometry of each layer"], &errors.odometry_noise),
            (["direction_noise", "measured direction, about either axis"], &errors.direction_noise),
        ];
        all.into_iter()
            .chain(self.odometry_scale.as_ref().map(|scale| (["odometry_scale", "odometry"], scale)))
            .collect()
    }

    /// Returns a line for each error that is not 0.
    pub fn describe(&self) -> String {
        let line = |[_, what]: [&str; 2], distribution: &Distribution| {
            let (label, words) = match distribution {
                Distribution::Uniform { max, unit, .. } => {
                    ("noise", format!("uniform, half-width {max} {}", short(*unit)))
                }
                Distribution::Normal { standard_deviation, unit, .. } => {
                    ("noise", format!("normal, SD {standard_deviation} {}", short(*unit)))
                }
                Distribution::Constant { value, unit } => ("bias", format!("{value} {}", short(*unit))),
            };
            format!("{label:<10}{what}: {words}\n")
        };
        let off = self.all().into_iter().filter(|(_, distribution)| value(distribution) != 0.0);
        off.map(|(what, distribution)| line(what, distribution)).collect()
    }

    /// Returns the columns of a table: name with distribution and unit, and value.
    pub fn columns(&self) -> Vec<(String, f64)> {
        let column = |[name, _]: [&str; 2], distribution: &Distribution| {
            let (kind, unit) = match distribution {
                Distribution::Uniform { unit, .. } => ("_uniform_half_width", unit),
                Distribution::Normal { unit, .. } => ("_normal_sd", unit),
                Distribution::Constant { unit, .. } => ("", unit),
            };
            let unit = if *unit == Unit::Percent { "percent" } else { "deg" };
            (format!("{name}{kind}_{unit}"), value(distribution))
        };
        self.all().into_iter().map(|(name, distribution)| column(name, distribution)).collect()
    }
}

/// Returns the number that defines a distribution with mean 0: the half-width or the standard deviation. For a
/// constant, it is the value.
fn value(distribution: &Distribution) -> f64 {
    match distribution {
        Distribution::Uniform { max, .. } => *max,
        Distribution::Normal { standard_deviation, .. } => *standard_deviation,
        Distribution::Constant { value, .. } => *value,
    }
}

fn short(unit: Unit) -> &'static str {
    if unit == Unit::Percent { "%" } else { "deg" }
}
