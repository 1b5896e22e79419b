//! Transfer of layers to the board. Without feedback, all layers of the job are sent. With feedback, only the layers of
//! the next minutes are sent, and replaced by amendments as the tip is measured.
//!
//! With feedback, the plan id of a job is the hash of all its layers, where laid layers count as they were commanded.
//! Events that the board sent before an amendment contain an earlier plan id. An amendment consists of an `Amend`
//! message with 16 layers and three `AppendLayers` messages with 48 layers, which take 0.08 s on a serial line. An
//! amendment that would change nothing is not sent. The log contains the event `amendment` before the request is sent,
//! and `amendment-rejected` if the board refuses it. If the end of the log does not show whether the board accepted the
//! latest amendment, the plan id of the board's job decides. The encoder also counts the filament of an interrupted
//! layer, unless the board lost power.

use growbot_core::link::message::{Accepted, Amend, Empty, MAX_LAYERS_PER_MESSAGE, Message, PassiveRequest, Refusal};
use growbot_plan::clearance_guard::ClearanceViolation;
use growbot_plan::feedback::Correction;
use growbot_plan::job::{Amendment, Job, JobEvent};

use super::{JobRunner, PendingAmendment, UploadState};
use crate::client::ClientError;

/// Maximum number of layers after the laid ones that are sent to the board with feedback.
const HORIZON: u32 = 64;
/// Number of layers that the board's step engine holds at a time. These layers can no longer be amended.
pub(super) const IN_ENGINE: u32 = 2;
/// Minimum time between two amendments, s. At this rate, amendments of 64 layers use a fifth of the capacity of a
/// serial line.
const AMEND_EVERY_S: f64 = 0.5;
/// Maximum number of amendments of a job, from which an eighth of the number of its layers is subtracted. A board's
/// journal has space for some 2,000 records besides the layers that a job begins with, and amendments may add layers.
const MAX_AMENDMENTS: usize = 1792;
/// Maximum number of attempts to send an amendment. The board refuses it if it began a replaced layer meanwhile.
const AMEND_TRIES: u32 = 4;

impl UploadState {
    /// Creates the state before anything is sent. `capacity` is the number of layers that the board can store.
    pub(super) fn new(job: &Job, capacity: u32) -> Self {
        Self {
            names: vec![job.plan_id],
            pending: None,
            amend_at: 0,
            pausing: false,
            handed_over: job.layers.len() as u32,
            accepted: Accepted { plan_id: 0, next: 0, free_layers: 0 },
            capacity,
        }
    }

    /// Computes the board's free space for layers again after `laid` layers of the job are laid.
    pub(super) fn make_room(&mut self, laid: u32) {
        self.accepted.free_layers = self.capacity.saturating_sub(self.accepted.next.saturating_sub(laid));
    }

    /// Reports whether this plan id is one that this job has or had before an amendment.
    pub(super) fn is_named(&self, plan_id: u64) -> bool {
        self.names.contains(&plan_id)
    }
}

impl JobRunner<'_> {
    /// Returns the number of layers, from the first of the job, that should be sent to the board by now. Without
    /// feedback, these are all layers. With feedback, later layers are not sent because they will be amended first.
    fn due(&self) -> usize {
        let all = self.job.layers.len();
        if self.feedback.is_some() { all.min(self.built.laid.saturating_add(HORIZON) as usize) } else { all }
    }

    /// Sends the layers that are due, as many as the board has space for.
    pub(super) fn hand_over(&mut self, on_event: &mut dyn FnMut(&JobEvent)) -> Result<(), ClientError> {
        let due = self.due();
        if let Some(layers) =
            self.job.layers.get(self.sent.handed_over as usize..due).filter(|layers| !layers.is_empty())
        {
            on_event(&JobEvent::LayersSent { from: self.sent.handed_over, layers: layers.to_vec() });
            self.sent.handed_over = due as u32;
        }
        let layers = self.job.layers.get(..due).unwrap_or_default();
        match self.client.upload_layers(self.job.plan_id, layers, self.sent.accepted.clone()) {
            Ok(accepted) => self.sent.accepted = accepted,
            // The board stopped meanwhile, as its next status will show.
            Err(ClientError::Refused { refusal: Refusal::WrongState { .. }, .. }) => {}
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// With feedback, plans the layers from index `from` on again and sends them to the board. If the board has already
    /// begun a later layer, the amendment begins after it. If the board does not accept the new layers, it continues
    /// with the layers that it has.
    pub(super) fn amend(&mut self, mut from: u32, on_event: &mut dyn FnMut(&JobEvent)) -> Result<(), ClientError> {
        let layers = self.job.layers.len();
        let is_early = self.built.laid < self.sent.amend_at || !self.built.is_reported();
        if is_early || self.built.laid as usize >= layers {
            return Ok(());
        }
        let max = MAX_AMENDMENTS.saturating_sub(layers / 8).max(1);
        for _ in 0..AMEND_TRIES {
            let Some(feedback) = &mut self.feedback else { return Ok(()) };
            from = from.min(self.sent.accepted.next);
            let before = self.job.layers.get(..from as usize).unwrap_or(&self.job.layers);
            let rest = match feedback.replan_rest(before.get(self.built.as_built.len()..).unwrap_or_default()) {
                Ok(Correction { layers, detour }) => {
                    detour.into_iter().for_each(|detour| on_event(&JobEvent::Detour(detour)));
                    self.sent.pausing = false;
                    layers
                }
                Err(too_near) => return self.pause_for_clearance(too_near, on_event),
            };
            let amended = [before, &rest].concat();
            let (plan_id, total) = (feedback.plan_id(&amended), amended.len() as u32);
            let in_time = libm::ceil(AMEND_EVERY_S / self.job.robot.description().layer.period_s) as u32;
            self.sent.amend_at = self.built.laid.saturating_add(in_time.max(layers.div_ceil(max) as u32).max(1));
            // A board refuses an amendment that leaves no remaining layers.
            if plan_id == self.job.plan_id || total <= self.built.laid || feedback.amendments() as usize >= max {
                return Ok(());
            }
            let horizon = rest.iter().take(HORIZON as usize).copied().collect();
            on_event(&JobEvent::Amendment(Amendment { plan_id, from, total, layers: horizon }));
            let first_layers = rest.iter().take(MAX_LAYERS_PER_MESSAGE).copied().collect();
            let amend = Amend {
                plan_id: self.job.plan_id,
                new_plan_id: plan_id,
                first_replaced: from,
                layers: total,
                first_layers,
            };
            let handed_over = total.min(from.saturating_add(HORIZON));
            self.sent.pending = Some(PendingAmendment { plan_id, layers: amended, handed_over });
            const WHAT: &str = "the request to amend the job";
            match self.client.request(WHAT, &PassiveRequest::Amend(amend)) {
                Ok(Message::Accepted(accepted)) => {
                    self.sent.accepted = accepted;
                    self.apply_amendment();
                    return Ok(());
                }
                Ok(other) => return Err(ClientError::Unexpected { request: WHAT, kind: other.kind() }),
                Err(ClientError::Refused { refusal, request }) if refusal != Refusal::NoSession => {
                    self.sent.pending = None;
                    let why = match refusal {
                        Refusal::LayerAlreadyBegun { .. } | Refusal::OutOfOrder { .. } | Refusal::WrongState { .. } => {
                            None
                        }
                        refusal => Some(ClientError::Refused { request, refusal }.to_string()),
                    };
                    on_event(&JobEvent::AmendmentRejected(why));
                    match refusal {
                        // The board has begun a layer that was to be replaced.
                        Refusal::LayerAlreadyBegun { first } => from = first,
                        Refusal::OutOfOrder { expected } => self.sent.accepted.next = expected,
                        _ => return Ok(()),
                    }
                }
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Pauses the board after the layer in progress, because the rest of the body would be too near to an obstacle. The
    /// layers that the board already has are from a correction that was clear of all obstacles.
    fn pause_for_clearance(
        &mut self,
        too_near: ClearanceViolation,
        on_event: &mut dyn FnMut(&JobEvent),
    ) -> Result<(), ClientError> {
        self.sent.amend_at = self.built.laid.saturating_add(1);
        if self.sent.pausing {
            return Ok(());
        }
        on_event(&JobEvent::ClearanceViolation(too_near));
        match self.client.request("the request to pause", &PassiveRequest::Pause(Empty {})) {
            Ok(_) => self.sent.pausing = true,
            // The board is paused already. The check is repeated after the next layer.
            Err(ClientError::Refused { refusal: Refusal::WrongState { .. }, .. }) => {}
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// Makes the pending amendment the current job, because the board has applied it.
    pub(super) fn apply_amendment(&mut self) {
        let Some(PendingAmendment { plan_id, layers, handed_over }) = self.sent.pending.take() else { return };
        (self.job.plan_id, self.job.layers, self.sent.handed_over) = (plan_id, layers, handed_over);
        self.sent.names.push(plan_id);
        if let Some(feedback) = &mut self.feedback {
            feedback.record_amendment();
        }
    }

    /// Sends more layers if the board has space for 64 layers, or for all layers that are due.
    pub(super) fn refill(&mut self, on_event: &mut dyn FnMut(&JobEvent)) -> Result<(), ClientError> {
        let due = self.due() as u32;
        let left = due.saturating_sub(self.sent.accepted.next);
        if left == 0 || self.sent.accepted.free_layers < left.min(HORIZON) {
            return Ok(());
        }
        self.hand_over(on_event)
    }
}
