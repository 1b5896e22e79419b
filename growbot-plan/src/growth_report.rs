//! Result of a growth: the body, the pose of its tip with the errors from the goal, and the source of this pose.

use growbot_core::hash::Hasher;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::message::{Fault, InterruptedLayer};
use growbot_core::pose::Pose;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use strum::IntoStaticStr;

use crate::arrival::Arrival;
use crate::clock_drift::ClockDrift;
use crate::feedback::FeedbackReport;
use crate::plan_deviation::centreline;

/// Outcome of a growth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Every layer of the job is laid.
    Done,
    /// The growth was stopped by a command, or by the emergency stop.
    Stopped,
    /// The board detected a fault and switched heater and steppers off.
    Fault(Fault),
    /// The board was stopped, because its clock is wrong and heating, speeds and time limits depend on that clock.
    ClockDrift(ClockDrift),
    /// A long pause has switched the heater off. The body can be resumed.
    Parked,
    /// The board has restarted, or another host has opened a session with it. The body can be resumed.
    Interrupted,
    /// The board does not respond. It may still be growing.
    Lost,
}

/// Result of a growth.
#[derive(Debug, Clone, PartialEq)]
pub struct GrowthReport {
    /// Outcome of the growth.
    pub outcome: Outcome,
    /// Plan id of the job.
    pub plan_id: u64,
    /// Layers of the body, as built.
    pub body: Vec<Layer>,
    /// Pose of the tip and its errors from the goal.
    pub arrival: Arrival,
    /// Time from the first layer to the last on the board's clock, s.
    pub duration_s: f64,
    /// Length of filament that was fed for the body, mm.
    pub filament_mm: f64,
    /// Layers as built, from the first layer on. `None` for a layer of which nothing is known, such as an interrupted
    /// layer that was not laid again. `body` contains this layer as planned.
    pub as_built: Vec<Option<LayerBytes>>,
    /// Number of laid layers, as the board counts them. It is larger than the length of `as_built` if the board's
    /// reports of the last layers are missing.
    pub laid: u32,
    /// The layer that was in progress when the growth ended, with bounds of its completed part. `None` if there was
    /// none.
    pub interrupted: Option<InterruptedLayer>,
    /// Source of the pose in `arrival`.
    pub measured_by: MeasuredBy,
    /// Result of the feedback. `None` without feedback.
    pub feedback: Option<FeedbackReport>,
}

/// Source of the final pose of a growth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, IntoStaticStr)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum MeasuredBy {
    /// The true pose of the simulated tip.
    Tip,
    /// The estimate of the feedback, from the sensors.
    Estimate,
    /// The steps that the board has made, on the assumption that each layer came out as commanded.
    Steps,
}

impl MeasuredBy {
    /// Returns the name of the source in files.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

impl GrowthReport {
    /// Returns the length of the body, mm.
    pub fn length_mm(&self) -> f64 {
        self.body.iter().fold(0.0, |length, layer| length + layer.height)
    }

    /// Returns the position of the start and the positions of the tip after each layer, mm: as the feedback estimated
    /// them if `measured_by` is the estimate, and otherwise from the layers in `body`.
    pub fn centreline(&self, start: &Pose) -> Vec<Vector3<f64>> {
        match (&self.feedback, self.measured_by) {
            (Some(feedback), MeasuredBy::Estimate) => feedback.path.clone(),
            _ => centreline(&start.frame(), self.body.iter().copied()),
        }
    }

    /// Returns the number of layers of which nothing is known.
    pub fn unknown_layers(&self) -> usize {
        self.as_built.iter().filter(|layer| layer.is_none()).count()
    }
}

/// Returns the layers of a body as built. A layer that is `None` in `as_built` is returned as commanded.
pub fn as_built_or_commanded(
    as_built: &[Option<LayerBytes>],
    commanded: &[LayerBytes],
) -> impl Iterator<Item = LayerBytes> {
    as_built.iter().enumerate().map_while(|(index, layer)| layer.or_else(|| commanded.get(index).copied()))
}

/// Returns the CRC-64/XZ of the layers as built, in order, each in its 12 bytes. A layer that is `None` counts as 12
/// zeros.
pub fn as_built_hash(layers: &[Option<LayerBytes>]) -> u64 {
    let mut hasher = Hasher::default();
    for layer in layers {
        hasher.write_bytes(&layer.unwrap_or_default());
    }
    hasher.finish()
}
