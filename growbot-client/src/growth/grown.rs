//! What a growth came to: the body, how far its tip is from the goal, and what that is measured by.

use growbot_core::hash::Hasher;
use growbot_core::layer::{Layer, grow};
use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_core::link::message::InterruptedLayer;
use serde::{Deserialize, Serialize};

use super::{Growth, Outcome};
use crate::arrival::Arrival;
use crate::feedback::{FedBack, Feedback};

/// What a growth came to.
#[derive(Debug, Clone, PartialEq)]
pub struct Grown {
    /// How it ended.
    pub outcome: Outcome,
    /// The job's name.
    pub plan_id: u64,
    /// The body, layer by layer.
    pub body: Vec<Layer>,
    /// Where the tip is, and how far that is from the goal.
    pub arrival: Arrival,
    /// From the first layer to the last, s, by the board's clock.
    pub duration_s: f64,
    /// Filament that was fed, mm.
    pub filament_mm: f64,
    /// The layers as the board has built them, from the first one. None where nothing is known of one: it was
    /// interrupted and kept, and in the body it stands as planned.
    pub as_built: Vec<Option<LayerBytes>>,
    /// The layer under way when it ended: how much of it was made.
    pub interrupted: Option<InterruptedLayer>,
    /// What the arrival is measured by.
    pub measured_by: MeasuredBy,
    /// What feedback came to; none without it.
    pub fed_back: Option<FedBack>,
}

/// What an arrival is measured by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
pub enum MeasuredBy {
    /// The simulated tip: it is the truth.
    Tip,
    /// What feedback has made of the sensors.
    Estimate,
    /// The steps that the board has made, as if each layer had come out as they say.
    Steps,
}

impl MeasuredBy {
    /// In a word.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Tip => "tip",
            Self::Estimate => "estimate",
            Self::Steps => "steps",
        }
    }
}

impl Grown {
    /// Length of the body, mm.
    #[must_use]
    pub fn length_mm(&self) -> f64 {
        self.body.iter().fold(0.0, |length, layer| length + layer.height)
    }

    /// Layers of which nothing is known.
    #[must_use]
    pub fn unknown(&self) -> usize {
        self.as_built.iter().filter(|layer| layer.is_none()).count()
    }
}

/// The layers of a body as built; one of which nothing is known is as it was commanded.
pub fn as_built_or_commanded(
    as_built: &[Option<LayerBytes>],
    commanded: &[LayerBytes],
) -> impl Iterator<Item = LayerBytes> {
    as_built.iter().enumerate().map_while(|(index, layer)| layer.or_else(|| commanded.get(index).copied()))
}

/// CRC-64/XZ of the layers as built, in order, each in its 12 bytes; one of which nothing is known is 12 zeros.
#[must_use]
pub fn as_built_hash(layers: &[Option<LayerBytes>]) -> u64 {
    let mut hasher = Hasher::default();
    for layer in layers {
        hasher.bytes(&layer.unwrap_or_default());
    }
    hasher.finish()
}

impl Growth<'_> {
    /// The body as the board reports its steps, and its end as the sensors say where there is feedback.
    pub(super) fn measure(self, outcome: Outcome) -> Grown {
        let layers = as_built_or_commanded(&self.built.as_built, &self.job.layers);
        let body: Vec<Layer> = layers.map(|layer| decode(&layer)).collect();
        let length = body.iter().fold(0.0, |sum, layer| sum + layer.height);
        let feed_steps = length * self.job.robot.feed_steps_per_length();
        let fed_back = self.feedback.as_ref().map(Feedback::result);
        let (measured_by, end) = match &fed_back {
            Some(fed_back) => (MeasuredBy::Estimate, fed_back.estimate.base_from_tip),
            None => (MeasuredBy::Steps, grow(&self.job.start.frame(), body.iter().copied())),
        };
        Grown {
            outcome,
            plan_id: self.job.plan_id,
            arrival: Arrival::of(&end, self.job.goal, self.job.length),
            body,
            duration_s: self.board.duration_s(),
            filament_mm: feed_steps / self.job.robot.description().feed.steps_per_mm,
            as_built: self.built.as_built,
            interrupted: self.built.interrupted,
            measured_by,
            fed_back,
        }
    }
}
