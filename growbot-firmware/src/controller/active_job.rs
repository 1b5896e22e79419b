//! The current job: its plan and its progress.

use growbot_core::link::message::{HostSilencePolicy, InterruptedLayer, LayerReadings};
use heapless::Deque;

use crate::journal;
use crate::stepping::TurnPlanner;

/// Max number of layers that the step engine has received and not yet laid.
const MAX_LAYERS_IN_FLIGHT: usize = 3;
/// Max number of layers whose sensor readings are kept. These are the latest layers.
const MAX_MEASURED: usize = 16;

/// The current job: its plan and its progress.
#[derive(Debug, Clone, Default)]
pub(super) struct ActiveJob {
    /// Identifier of the job's plan; 0 without a job.
    pub plan_id: u64,
    /// Number of layers of the job's plan.
    pub layer_count: u32,
    /// Number of layers of the job that are laid.
    pub layers_laid: u32,
    /// Number of layers of the job that the step engine has received.
    pub layers_begun: u32,
    /// Number of layers of the job that have been reported to the host as laid.
    pub layers_reported: u32,
    /// Progress of the interrupted layer. `None` if no layer was interrupted.
    pub interrupted: Option<InterruptedLayer>,
    /// Reaction to a host that no longer sends messages: pause, or continue the growth.
    pub silence: HostSilencePolicy,
    /// True if the journal has failed, so that the job cannot be resumed.
    pub journal_failed: bool,
    /// Total height and remaining lean after the laid layers, from which the next layer is planned.
    pub carry: journal::RoundingCarry,
    /// Planner of the next turns. It holds the rounding errors of the layers that the step engine has received, and the
    /// motor speeds at the end of these layers.
    pub material: TurnPlanner,
    /// Journal records of the layers that the step engine has received and not yet laid, oldest first. The layer as
    /// built is added to a record once the layer is laid.
    pub carries: Deque<journal::LayerRecord, MAX_LAYERS_IN_FLIGHT>,
    /// Sensor readings after each of the latest laid layers, oldest first.
    pub measured: Deque<MeasuredLayer, MAX_MEASURED>,
}

/// Sensor readings that were taken after a layer was laid.
#[derive(Debug, Clone)]
pub(super) struct MeasuredLayer {
    index: u32,
    measured: LayerReadings,
}

impl ActiveJob {
    /// Forgets the layers that the step engine has received and not laid, so that the next layer follows the laid
    /// layers.
    pub fn forget_given(&mut self) {
        self.layers_begun = self.layers_laid;
        self.carries.clear();
        self.material = TurnPlanner::from(self.carry);
    }

    /// Stores the sensor readings that were taken after a layer. Drops the oldest readings if the queue is full.
    pub fn store_measured(&mut self, index: u32, measured: LayerReadings) {
        if self.measured.is_full() {
            self.measured.pop_front();
        }
        // The queue is not full: its oldest element was removed above.
        let _ = self.measured.push_back(MeasuredLayer { index, measured });
    }

    /// Returns the sensor readings that were taken after a layer. `None` if they are no longer stored.
    pub fn measured(&self, index: u32) -> Option<LayerReadings> {
        self.measured.iter().find(|layer| layer.index == index).map(|layer| layer.measured)
    }
}
