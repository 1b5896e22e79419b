//! Ground truth of a growth on a simulated tip: the layers that the tip has really laid.
//!
//! A program that opens a port to a simulated robot also gets a [`GroundTruth`]. [`grow_with_ground_truth`] reads the
//! laid layers from it during a growth. In the growth's report, it replaces the body that was estimated from steps or
//! sensors by the body that the tip has laid.

use growbot_core::layer::{Layer, grow};
use growbot_core::pose::Pose;
use growbot_plan::arrival::Arrival;
use growbot_plan::growth_report::{GrowthReport, MeasuredBy, Outcome};
use growbot_plan::job::{Job, JobEvent};

use crate::client::ClientError;
use crate::growth::GrowthError;
use crate::growth::start::begins_body;
use crate::port::PortError;

/// Read access to the body of a simulated tip, while a port communicates with its board.
pub trait GroundTruth {
    /// Returns the layers that the tip has laid so far, and its net number of feed steps.
    ///
    /// # Errors
    /// If the tip can no longer be read.
    fn laid(&mut self) -> Result<LaidBody, PortError>;

    /// Returns the layers of the tip's body from index `from` on whose plastic no longer changes.
    fn settled(&mut self, from: usize) -> Vec<Layer>;

    /// Places the tip at the start of a new body, which may be the base or the tip of the last body. The sensors of the
    /// tip then measure the new body.
    fn start_at(&mut self, pose: &Pose);
}

/// Body that a simulated tip has laid, computed from the motor steps that the tip received.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct LaidBody {
    /// Layers of the body.
    pub body: Vec<Layer>,
    /// Net number of feed steps: the steps forwards minus the steps backwards.
    pub feed_steps: u64,
}

/// Grows `job` with the function `grow`. If `truth` is given, its tip is placed at the start of the body once the board
/// can begin it. `on_event` then also receives the layers that the tip has laid (`JobEvent::Simulated`), and the
/// returned report contains these layers as the body, unless the board stopped responding.
///
/// # Errors
/// The errors of `grow`, or an error if the tip cannot be read.
pub fn grow_with_ground_truth(
    truth: Option<&mut dyn GroundTruth>,
    job: &Job,
    on_event: &mut dyn FnMut(&JobEvent),
    grow: impl FnOnce(&mut dyn FnMut(&JobEvent)) -> Result<GrowthReport, GrowthError>,
) -> Result<GrowthReport, GrowthError> {
    let Some(truth) = truth else { return grow(on_event) };
    let mut recorder =
        TruthRecorder::from_here(truth).map_err(|error| GrowthError::NotStarted(ClientError::Port(error)))?;
    let mut is_connected = false;
    let mut grown = grow(&mut |event| {
        if let JobEvent::Board(board) = event
            && !std::mem::replace(&mut is_connected, true)
            && begins_body(&board.status)
        {
            recorder.truth.start_at(job.start);
        }
        on_event(event);
        if let JobEvent::Laid { .. } = event {
            recorder.report_settled(on_event);
        }
    })?;
    if grown.outcome != Outcome::Lost {
        recorder
            .measure(&mut grown, job, on_event)
            .map_err(|error| GrowthError::Interrupted(ClientError::Port(error)))?;
    }
    Ok(grown)
}

/// Recorder of the layers that a simulated tip lays during one growth.
struct TruthRecorder<'a> {
    truth: &'a mut dyn GroundTruth,
    /// Number of layers that the tip had laid before the growth.
    layers_before: usize,
    feed_steps_before: u64,
    /// Number of layers of the growth that were reported in events.
    reported: usize,
}

impl<'a> TruthRecorder<'a> {
    fn from_here(truth: &'a mut dyn GroundTruth) -> Result<Self, PortError> {
        let LaidBody { body, feed_steps } = truth.laid()?;
        Ok(Self { truth, layers_before: body.len(), feed_steps_before: feed_steps, reported: 0 })
    }

    fn report_settled(&mut self, on_event: &mut dyn FnMut(&JobEvent)) {
        let settled = self.truth.settled(self.layers_before.saturating_add(self.reported));
        self.report(&settled, on_event);
    }

    fn measure(
        &mut self,
        grown: &mut GrowthReport,
        job: &Job,
        on_event: &mut dyn FnMut(&JobEvent),
    ) -> Result<(), PortError> {
        let LaidBody { mut body, feed_steps } = self.truth.laid()?;
        let body = body.split_off(self.layers_before.min(body.len()));
        self.report(body.get(self.reported..).unwrap_or_default(), on_event);
        let end = grow(&job.start.frame(), body.iter().copied());
        let fed = feed_steps.saturating_sub(self.feed_steps_before) as f64;
        grown.measured_by = MeasuredBy::Tip;
        grown.arrival = Arrival::of(&end, job.goal, job.length);
        grown.filament_mm = fed / job.robot.description().feed.steps_per_mm;
        grown.body = body;
        Ok(())
    }

    fn report(&mut self, layers: &[Layer], on_event: &mut dyn FnMut(&JobEvent)) {
        if !layers.is_empty() {
            on_event(&JobEvent::Simulated {
                from: u32::try_from(self.reported).unwrap_or(u32::MAX),
                layers: layers.to_vec(),
            });
            self.reported += layers.len();
        }
    }
}
