//! What a program and the process of a simulated robot say to each other: lines of JSON.

use std::time::Duration;

use growbot_core::layer::Layer;
use growbot_core::pose::Pose;
use growbot_core::simulation::{Disturbance, Imperfection};
use growbot_core::tracking::SensorNoise;
use serde::{Deserialize, Serialize};

use crate::port::TipSettings;
use crate::tip::hand::Hand;
use crate::truth::Laid;

/// Changes with what is said here.
pub const RELEASE: u32 = 2;

/// What is asked of the process.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Ask {
    /// First of all: to have the line, alone unless it is for the emergency stop.
    Open { release: u32, alone: bool },
    /// Growth begins here, and the tip is off like this.
    Tip(TipWords),
    /// Bytes for the board.
    Send(Vec<u8>),
    /// Bytes of the board, within so much of its time.
    Receive { timeout_us: u64, max: usize },
    /// What the tip has laid.
    Laid,
    /// The layers that no longer change.
    Settled { from: usize },
    /// Something that is done to the tip by hand.
    Hand(Hand),
    /// A reset of the board.
    Reset,
    /// The end of the process, at once.
    PowerOff,
}

/// What the process answers.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Answer {
    /// It is done; the board's time.
    Done { now_us: u64 },
    /// Bytes, none where there were none in time; the board's time.
    Bytes { bytes: Vec<u8>, now_us: u64 },
    /// Alpha, height and tilt of layers, and all steps of the feed.
    Laid { layers: Vec<[f64; 3]>, feed_steps: u64 },
    /// Another program has the line.
    Busy,
    /// The process is of another release.
    OtherRelease,
}

impl Answer {
    pub fn of_layers(layers: &[Layer], feed_steps: u64) -> Self {
        Self::Laid { layers: layers.iter().map(|layer| [layer.alpha, layer.height, layer.tilt]).collect(), feed_steps }
    }
}

/// What a tip has laid, as it was written.
pub fn laid(layers: &[[f64; 3]], feed_steps: u64) -> Laid {
    let body = layers.iter().map(|&[alpha, height, tilt]| Layer { alpha, height, tilt }).collect();
    Laid { body, feed_steps }
}

/// [`TipSettings`] in numbers, without the pace.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TipWords {
    /// x, y, z in mm, heading and pitch in degrees.
    start: Option<[f64; 5]>,
    disturbance: [f64; 8],
    noise: [f64; 2],
    seed: u64,
}

impl From<&TipSettings> for TipWords {
    fn from(settings: &TipSettings) -> Self {
        let Imperfection { disturbance: of, noise, seed } = settings.imperfection;
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

impl From<TipWords> for TipSettings {
    fn from(words: TipWords) -> Self {
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
            imperfection: Imperfection { disturbance, noise, seed: words.seed },
            pace: None,
        }
    }
}

/// Microseconds of a time.
pub fn micros(time: Duration) -> u64 {
    u64::try_from(time.as_micros()).unwrap_or(u64::MAX)
}
