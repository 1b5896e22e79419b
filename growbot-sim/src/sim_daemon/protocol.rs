//! Messages between a program and the process of a simulated robot: lines of JSON.

use std::time::Duration;

use growbot_core::layer::Layer;
use growbot_core::pose::Pose;
use growbot_core::simulation::{Disturbance, ErrorModel};
use growbot_core::tracking::SensorNoise;
use serde::{Deserialize, Serialize};

use crate::ground_truth::LaidBody;
use crate::port::TipSettings;
use crate::tip::manual_action::ManualAction;

/// Version of these messages, to be changed with them.
pub const PROTOCOL_VERSION: u32 = 2;

/// Request to the process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Request {
    /// Opens the line, exclusively unless it is for the emergency stop. This is the first request.
    Open { release: u32, exclusive: bool },
    /// Sets the start and the disturbances of the tip.
    Tip(TipSettingsJson),
    /// Sends bytes to the board.
    Send(Vec<u8>),
    /// Receives bytes from the board, with a timeout in its time.
    Receive { timeout_us: u64, max: usize },
    /// Requests the layers that the tip has laid.
    Laid,
    /// Requests the layers that no longer change.
    Settled { from: usize },
    /// Performs an action on the tip by hand.
    Hand(ManualAction),
    /// Resets the board.
    Reset,
    /// Ends the process immediately.
    PowerOff,
}

/// Response of the process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Response {
    /// The request is executed. Contains the board's time.
    Done { now_us: u64 },
    /// Bytes from the board, empty after the timeout. Contains the board's time.
    Bytes { bytes: Vec<u8>, now_us: u64 },
    /// Alpha, height and tilt of layers, and the total steps of the feed.
    Laid { layers: Vec<[f64; 3]>, feed_steps: u64 },
    /// Another program uses the line.
    Busy,
    /// The process has another release.
    OtherRelease,
}

impl Response {
    pub fn of_layers(layers: &[Layer], feed_steps: u64) -> Self {
        Self::Laid { layers: layers.iter().map(|layer| [layer.alpha, layer.height, layer.tilt]).collect(), feed_steps }
    }
}

/// Converts a response to the layers that a tip has laid.
pub fn laid(layers: &[[f64; 3]], feed_steps: u64) -> LaidBody {
    let body = layers.iter().map(|&[alpha, height, tilt]| Layer { alpha, height, tilt }).collect();
    LaidBody { body, feed_steps }
}

/// [`TipSettings`] as numbers, without the pace.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TipSettingsJson {
    /// Pose: x, y, z in mm, heading and pitch in degrees.
    start: Option<[f64; 5]>,
    disturbance: [f64; 8],
    noise: [f64; 2],
    seed: u64,
}

impl From<&TipSettings> for TipSettingsJson {
    fn from(settings: &TipSettings) -> Self {
        let ErrorModel { disturbance: of, noise, seed } = settings.imperfection;
        Self {
            start: settings.start.map(|pose| pose.to_degrees()),
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
        Self {
            start: words.start.and_then(|degrees| Pose::from_degrees(degrees).ok()),
            imperfection: ErrorModel { disturbance, noise, seed: words.seed },
            pace: None,
        }
    }
}

/// Converts a time to microseconds.
pub fn micros(time: Duration) -> u64 {
    u64::try_from(time.as_micros()).unwrap_or(u64::MAX)
}
