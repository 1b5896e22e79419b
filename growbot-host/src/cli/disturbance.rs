//! Errors of simulated robots: the layers' errors, the sensors' noise, and the seed of both.

use clap::Args;
use growbot_core::angle::radians;
use growbot_core::simulation::{Disturbance, MAX_ERROR};
use growbot_core::tracking::SensorNoise;
use growbot_plan::pose_text::{parse_angle, parse_number};

/// Errors of simulated layers and sensors.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Disturbances of a simulated tip")]
pub struct DisturbanceArgs {
    /// Half-width of the uniform noise of each layer's growth, with its tilt kept
    #[arg(long, value_name = "PERCENT", default_value = "0", allow_hyphen_values = true, value_parser = percent)]
    noise: f64,
    /// Over-deposition, or under-deposition if negative, the same in every layer
    #[arg(long, value_name = "PERCENT", default_value = "0", allow_hyphen_values = true, value_parser = signed_percent)]
    bias: f64,
    /// Half-width of the uniform noise of each layer's tilt, a lean about either axis
    #[arg(long, value_name = "DEG", default_value = "0", allow_hyphen_values = true, value_parser = deg)]
    tilt_noise: f64,
    /// Excess of tilt, the same in every layer
    #[arg(long, value_name = "PERCENT", default_value = "0", allow_hyphen_values = true, value_parser = signed_percent)]
    tilt_bias: f64,
    /// Half-width of the uniform noise of each layer's deposition angle
    #[arg(long, value_name = "DEG", default_value = "0", allow_hyphen_values = true, value_parser = deg)]
    alpha_noise: f64,
    /// Offset of the deposition angle, the same in every layer
    #[arg(long, value_name = "DEG", default_value = "0", allow_hyphen_values = true, value_parser = signed_deg)]
    alpha_bias: f64,
    /// Half-width of the uniform noise of the twist about the tip's axis in each layer
    #[arg(long, value_name = "DEG", default_value = "0", allow_hyphen_values = true, value_parser = deg)]
    twist_noise: f64,
    /// Twist about the tip's axis, the same in every layer, counter-clockwise
    #[arg(long, value_name = "DEG", default_value = "0", allow_hyphen_values = true, value_parser = signed_deg)]
    twist_bias: f64,
    /// Standard deviation of the normal noise of the odometry in each layer, of its growth
    #[arg(long, value_name = "PERCENT", allow_hyphen_values = true, value_parser = percent)]
    odometry_noise: Option<f64>,
    /// Standard deviation of the normal noise of the measured direction about either axis
    #[arg(long, value_name = "DEG", allow_hyphen_values = true, value_parser = deg)]
    direction_noise: Option<f64>,
    /// Seed of all noise: the same seed gives the same run
    #[arg(long, value_name = "N", default_value = "1", allow_negative_numbers = true)]
    pub seed: u64,
}

impl DisturbanceArgs {
    /// Returns the errors of the layers.
    pub fn disturbance(&self) -> Disturbance {
        Disturbance {
            growth_noise: self.noise / 100.0,
            growth_bias: self.bias / 100.0,
            tilt_noise: radians(self.tilt_noise),
            tilt_bias: self.tilt_bias / 100.0,
            alpha_noise: radians(self.alpha_noise),
            alpha_bias: radians(self.alpha_bias),
            twist_noise: radians(self.twist_noise),
            twist_bias: radians(self.twist_bias),
        }
    }

    /// Returns the sensors' noise. A noise that the options do not give is 0.
    pub fn sensor_noise(&self) -> SensorNoise {
        self.sensor_noise_or(SensorNoise { odometry: 0.0, direction: 0.0 })
    }

    /// Returns the sensors' noise. A noise that the options do not give is taken from `assumed`.
    pub fn sensor_noise_or(&self, assumed: SensorNoise) -> SensorNoise {
        SensorNoise {
            odometry: self.odometry_noise.map_or(assumed.odometry, |percent| percent / 100.0),
            direction: self.direction_noise.map_or(assumed.direction, radians),
        }
    }
}

/// Parses a share that is not negative, percent.
fn percent(text: &str) -> Result<f64, String> {
    within(percentage(text)?, 0.0, MAX_ERROR, "percent")
}

/// Parses a share of either sign, percent.
pub fn signed_percent(text: &str) -> Result<f64, String> {
    within(percentage(text)?, -MAX_ERROR, MAX_ERROR, "percent")
}

/// Parses an angle that is not negative, degrees.
fn deg(text: &str) -> Result<f64, String> {
    within(angle(text)?, 0.0, MAX_ERROR, "degrees")
}

/// Parses an angle of either sign, degrees.
fn signed_deg(text: &str) -> Result<f64, String> {
    within(angle(text)?, -MAX_ERROR, MAX_ERROR, "degrees")
}

fn percentage(text: &str) -> Result<f64, String> {
    let number = parse_number(text.trim().trim_end_matches('%'));
    number.ok_or_else(|| "the value is not a number: give a percentage, such as 0.5 or 0.5%".to_owned())
}

fn angle(text: &str) -> Result<f64, String> {
    parse_angle(text).map(|angle| angle.value).map_err(|_| {
        "the value is not a number: give an angle in degrees, such as 0.5, or in radians, such as 0.01rad".to_owned()
    })
}

fn within(number: f64, min: f64, max: f64, unit: &str) -> Result<f64, String> {
    if (min..=max).contains(&number) {
        Ok(number)
    } else {
        Err(format!("the value is {number} {unit}: give {min} to {max} {unit}"))
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use growbot_core::simulation::ErrorModel;

    use super::*;

    #[derive(Debug, Parser)]
    struct Alone {
        #[command(flatten)]
        disturbance: DisturbanceArgs,
    }

    fn parsed(args: &[&str]) -> Result<DisturbanceArgs, String> {
        let args = std::iter::once(&"alone").chain(args);
        Alone::try_parse_from(args).map(|alone| alone.disturbance).map_err(|error| error.to_string())
    }

    #[test]
    fn disturbances_are_off_by_default() {
        let args = parsed(&[]).unwrap();
        let perfect = ErrorModel::default();
        assert_eq!((args.disturbance(), args.sensor_noise()), (perfect.disturbance, perfect.noise));
        assert_eq!(args.disturbance(), Disturbance::default());
        assert_eq!(args.sensor_noise(), SensorNoise { odometry: 0.0, direction: 0.0 });
        assert_eq!(args.seed, 1);
    }

    #[test]
    fn percent_and_degrees_are_converted_to_fractions_and_radians() {
        let args = parsed(&["--noise", "10", "--bias", "-5", "--twist-bias=-0.9", "--direction-noise", "0.5"]).unwrap();
        let disturbance = args.disturbance();
        assert_eq!((disturbance.growth_noise, disturbance.growth_bias), (0.1, -0.05));
        assert_eq!(disturbance.twist_bias, radians(-0.9));
        assert_eq!(args.sensor_noise().direction, radians(0.5));
        assert!(args.disturbance() != Disturbance::default() && args.sensor_noise() != ErrorModel::default().noise);
        let assumed = SensorNoise { odometry: 0.03, direction: 1.0 };
        assert_eq!(args.sensor_noise_or(assumed), SensorNoise { odometry: 0.03, direction: radians(0.5) });
    }

    #[test]
    fn out_of_range_values_are_refused_with_value_and_limit() {
        for (args, part) in [
            (["--noise", "-1"], "the value is -1 percent: give 0 to 90"),
            (["--noise", "90.5"], "the value is 90.5 percent"),
            (["--bias", "nan"], "the value is NaN percent: give -90 to 90"),
            (["--bias", "-inf"], "the value is -inf percent"),
            (["--alpha-bias", "91"], "the value is 91 degrees: give -90 to 90"),
            (["--twist-noise", "ten"], "the value is not a number: give an angle in degrees, such as 0.5"),
            (["--seed", "-1"], "invalid value '-1' for '--seed <N>'"),
        ] {
            let message = parsed(&args).unwrap_err();
            assert!(message.contains(part), "{args:?}: {message}");
        }
    }
}
