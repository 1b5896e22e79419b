//! Messages between a program and the process of a simulated robot: lines of JSON.

use std::time::Duration;

use growbot_client::ground_truth::LaidBody;
use growbot_core::layer::Layer;
use growbot_core::simulation::{Disturbance, ErrorModel};
use growbot_core::tracking::SensorNoise;
use serde::{Deserialize, Serialize};

use crate::port::TipSettings;
use crate::tip::manual_action::ManualAction;

/// Version of the messages, which must be incremented when they change.
pub const PROTOCOL_VERSION: u32 = 4;

/// Request to the process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Request {
    /// Opens the connection, as the first request. `release` is the program's [`PROTOCOL_VERSION`]. `exclusive` is
    /// false for an emergency stop or the power switch.
    Open { release: u32, exclusive: bool },
    /// Sets the start pose and the errors of the simulated tip.
    Tip(TipSettingsJson),
    /// Places the tip at the start of a new body: x, y, z in mm, heading and pitch in degrees, and the roll in radians.
    StartAt([f64; 5], f64),
    /// Sends bytes to the board.
    Send(Vec<u8>),
    /// Receives at most `max` bytes from the board, with a timeout in us of the board's time.
    Receive { timeout_us: u64, max: usize },
    /// Requests the layers that the tip has laid.
    Laid,
    /// Requests the layers from index `from` on whose plastic no longer changes.
    Settled { from: usize },
    /// Performs a manual action on the tip, such as turning its head.
    Hand(ManualAction),
    /// Resets the board.
    Reset,
    /// Switches the robot off: its process ends immediately.
    PowerOff,
}

/// Response of the process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum DaemonResponse {
    /// The request was executed. `now_us` is the board's time, us.
    Done { now_us: u64 },
    /// Bytes from the board. They are empty if the timeout has expired. `now_us` is the board's time, us.
    Bytes { bytes: Vec<u8>, now_us: u64 },
    /// Alpha (rad), height (mm) and tilt (rad) of each layer, and the net number of feed steps.
    Laid { layers: Vec<[f64; 3]>, feed_steps: u64 },
    /// Another program has an exclusive connection to the robot.
    Busy,
    /// The process and the program use different versions of the messages.
    OtherRelease,
}

impl DaemonResponse {
    pub fn of_layers(layers: &[Layer], feed_steps: u64) -> Self {
        Self::Laid { layers: layers.iter().map(|layer| [layer.alpha, layer.height, layer.tilt]).collect(), feed_steps }
    }
}

/// Converts the values of a [`Response::Laid`] to the body that a tip has laid.
pub fn laid(layers: &[[f64; 3]], feed_steps: u64) -> LaidBody {
    let body = layers.iter().map(|&[alpha, height, tilt]| Layer { alpha, height, tilt }).collect();
    LaidBody { body, feed_steps }
}

/// [`TipSettings`] as numbers, without the pace.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TipSettingsJson {
    disturbance: [f64; 8],
    noise: [f64; 2],
    seed: u64,
}

impl From<&TipSettings> for TipSettingsJson {
    fn from(settings: &TipSettings) -> Self {
        let ErrorModel { disturbance: of, noise, seed } = settings.imperfection;
        Self {
            disturbance: [
                of.growth_noise,
                of.growth_bias,
                of.tilt_noise,
                of.tilt_bias,
                of.alpha_noise,
                of.alpha_bias,
                of.twist_noise,
                of.twist_bias,
            ],
            noise: [noise.odometry, noise.direction],
            seed,
        }
    }
}

impl From<TipSettingsJson> for TipSettings {
    fn from(words: TipSettingsJson) -> Self {
        let [growth_noise, growth_bias, tilt_noise, tilt_bias, alpha_noise, alpha_bias, twist_noise, twist_bias] =
            words.disturbance;
        let disturbance = Disturbance {
            growth_noise,
            growth_bias,
            tilt_noise,
            tilt_bias,
            alpha_noise,
            alpha_bias,
            twist_noise,
            twist_bias,
        };
        let [odometry, direction] = words.noise;
        let noise = SensorNoise { odometry, direction };
        Self { imperfection: ErrorModel { disturbance, noise, seed: words.seed }, pace: None }
    }
}

/// Converts a time to microseconds.
pub fn micros(time: Duration) -> u64 {
    u64::try_from(time.as_micros()).unwrap_or(u64::MAX)
}
