//! Access of programs to a simulated tip: the body that it has laid, and manual actions.

use growbot_client::ground_truth::{GroundTruth, LaidBody};
use growbot_client::port::PortError;
use growbot_core::layer::Layer;
use growbot_core::pose::Pose;

use crate::tip::manual_action::ManualAction;
use crate::tip::pins::SharedTip;

/// A simulated tip, while a port communicates with its board.
pub trait SimulatedTip: GroundTruth {
    /// Performs a manual action on the tip. Returns false if the tip does not support manual actions.
    fn apply_action(&mut self, action: ManualAction) -> bool;
}

/// Handle of a tip that is simulated in this process.
pub struct InProcessTip(pub SharedTip);

impl GroundTruth for InProcessTip {
    fn laid(&mut self) -> Result<LaidBody, PortError> {
        let tip = self.0.borrow();
        Ok(LaidBody { body: tip.body(), feed_steps: tip.feed_steps() })
    }

    fn settled(&mut self, from: usize) -> Vec<Layer> {
        self.0.borrow_mut().settled(from).to_vec()
    }

    fn start_at(&mut self, pose: &Pose) {
        self.0.borrow_mut().start_at(pose);
    }
}

impl SimulatedTip for InProcessTip {
    fn apply_action(&mut self, action: ManualAction) -> bool {
        self.0.borrow_mut().apply_action(action);
        true
    }
}

/// Returns the body of a simulated tip, if there is one, for a growth that is compared with it.
pub fn ground_truth(tip: &mut Option<Box<dyn SimulatedTip>>) -> Option<&mut dyn GroundTruth> {
    tip.as_deref_mut().map(|tip| tip as &mut dyn GroundTruth)
}
