//! The first line of a run log, and the line of a growth that is resumed in it.

use growbot_core::angle::degrees;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::simulation::ErrorModel;
use growbot_core::tracking::SensorNoise;
use serde::{Deserialize, Serialize};

use super::lenient::lenient;
use crate::plan_file::PlanFile;

/// Name and version of the format of run logs, which the first line contains.
pub const FORMAT: &str = "growbot-run/4";

/// The first line of a run log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RunHeader {
    /// Name and version of the format.
    pub format: String,
    /// Version of the program that has written it.
    #[serde(default)]
    pub growbot: String,
    /// Date and time at the start of the growth, RFC 3339 with milliseconds.
    #[serde(default)]
    pub started_utc: String,
    /// Command line with which the program was started.
    #[serde(default)]
    pub command_line: Vec<String>,
    /// The port as the user gave it.
    #[serde(default)]
    pub port: String,
    /// Kind of tip that lays the body.
    pub tip: TipKind,
    /// Disturbances of a simulated tip. Null for a robot.
    #[serde(default, deserialize_with = "lenient")]
    pub disturbances: Option<DisturbancesJson>,
    /// True if the body was grown without regard to its scene.
    #[serde(default)]
    pub ignore_scene: bool,
    /// Name of the robot.
    pub robot: String,
    /// Hash of the robot's description, 16 hexadecimal digits.
    #[serde(with = "crate::hexadecimal::hash")]
    #[cfg_attr(feature = "schema", schemars(with = "String", extend("pattern" = r"^[0-9a-f]{16}$")))]
    pub robot_hash: u64,
    /// Plan id: the hash of the layers.
    #[serde(with = "crate::hexadecimal::hash")]
    #[cfg_attr(feature = "schema", schemars(with = "String", extend("pattern" = r"^[0-9a-f]{16}$")))]
    pub plan_id: u64,
    /// The layers that were sent, 24 hexadecimal digits each.
    #[serde(with = "crate::hexadecimal::layers")]
    #[cfg_attr(feature = "schema", schemars(with = "String", extend("pattern" = r"^([0-9a-f]{24})*$")))]
    pub layers: Vec<LayerBytes>,
    /// Assumed noise of the sensors. Null without feedback.
    #[serde(default, deserialize_with = "lenient")]
    pub feedback: Option<SensorNoiseJson>,
    /// The plan.
    pub plan: PlanFile,
}

/// A growth that is resumed by another program.
#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(default)]
pub struct ResumeRecord {
    /// Version of the program.
    pub growbot: String,
    /// Command line with which the program was started.
    pub command_line: Vec<String>,
    /// The port as the user gave it.
    pub port: String,
}

/// Kind of tip that laid a body.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum TipKind {
    /// The tip of a robot. The true position of its plastic was not measured.
    Robot,
    /// A simulated tip.
    Simulated,
}

/// Noise of the sensors, as standard deviations.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SensorNoiseJson {
    /// Noise of the odometry, as a fraction of a layer's growth.
    pub odometry: f64,
    /// Noise of a direction, radians.
    pub direction: f64,
}

impl From<SensorNoise> for SensorNoiseJson {
    fn from(noise: SensorNoise) -> Self {
        Self { odometry: noise.odometry, direction: noise.direction }
    }
}

impl SensorNoiseJson {
    /// Converts to the noise for the feedback. `None` if a number is negative or NaN.
    pub(super) fn checked(self) -> Option<SensorNoise> {
        let Self { odometry, direction } = self;
        (odometry >= 0.0 && direction >= 0.0).then_some(SensorNoise { odometry, direction })
    }
}

/// Disturbances of a simulated tip: the distribution of each error, and the seed of the random numbers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct DisturbancesJson {
    /// Seed of all noise.
    pub seed: u64,
    /// Noise of the height of a layer.
    pub growth_noise: Distribution,
    /// Systematic error of the height.
    pub growth_bias: Distribution,
    /// Noise of the tilt.
    pub tilt_noise: Distribution,
    /// Systematic error of the tilt.
    pub tilt_bias: Distribution,
    /// Noise of the direction of the tilt.
    pub alpha_noise: Distribution,
    /// Systematic error of the direction of the tilt.
    pub alpha_bias: Distribution,
    /// Noise of the twist of a layer about its axis.
    pub twist_noise: Distribution,
    /// Systematic error of the twist.
    pub twist_bias: Distribution,
    /// Noise of the filament's encoder.
    pub odometry_noise: Distribution,
    /// Noise of the orientation sensor.
    pub direction_noise: Distribution,
}

/// Distribution of an error.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(tag = "distribution", rename_all = "kebab-case")]
pub enum Distribution {
    /// A uniform distribution between the mean less `max` and the mean plus `max`.
    Uniform {
        /// Mean value.
        mean: f64,
        /// Maximum deviation from the mean.
        max: f64,
        /// Unit of both values.
        unit: Unit,
    },
    /// A Gaussian distribution.
    Normal {
        /// Mean value.
        mean: f64,
        /// Standard deviation.
        standard_deviation: f64,
        /// Unit of both values.
        unit: Unit,
    },
    /// A constant error.
    Constant {
        /// Value of the error.
        value: f64,
        /// Unit of the value.
        unit: Unit,
    },
}

/// Unit of an error.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum Unit {
    /// Percent of the value.
    Percent,
    /// Degrees.
    Deg,
}

impl From<&ErrorModel> for DisturbancesJson {
    fn from(imperfection: &ErrorModel) -> Self {
        let ErrorModel { disturbance, noise, seed } = imperfection;
        let uniform = |max, unit| Distribution::Uniform { mean: 0.0, max, unit };
        let normal = |standard_deviation, unit| Distribution::Normal { mean: 0.0, standard_deviation, unit };
        let constant = |value, unit| Distribution::Constant { value, unit };
        let percent = |share: f64| as_given(100.0 * share);
        let degrees = |angle: f64| as_given(degrees(angle));
        Self {
            seed: *seed,
            growth_noise: uniform(percent(disturbance.growth_noise), Unit::Percent),
            growth_bias: constant(percent(disturbance.growth_bias), Unit::Percent),
            tilt_noise: uniform(degrees(disturbance.tilt_noise), Unit::Deg),
            tilt_bias: constant(percent(disturbance.tilt_bias), Unit::Percent),
            alpha_noise: uniform(degrees(disturbance.alpha_noise), Unit::Deg),
            alpha_bias: constant(degrees(disturbance.alpha_bias), Unit::Deg),
            twist_noise: uniform(degrees(disturbance.twist_noise), Unit::Deg),
            twist_bias: constant(degrees(disturbance.twist_bias), Unit::Deg),
            odometry_noise: normal(percent(noise.odometry), Unit::Percent),
            direction_noise: normal(degrees(noise.direction), Unit::Deg),
        }
    }
}

/// Rounds a number to 13 significant digits, because conversion to a fraction or to radians, and back, changes its last
/// digits.
fn as_given(number: f64) -> f64 {
    format!("{number:.12e}").parse().unwrap_or(number)
}
