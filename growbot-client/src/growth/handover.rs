//! Layers on their way to the board: all of them without feedback; with it, those of the next minutes, amended as the tip is measured.

use growbot_core::link::message::{Amend, MAX_LAYERS, Message, Refusal};

use super::{Amendment, Growth, JobEvent, PendingAmendment};
use crate::client::ClientError;

/// With feedback, layers are handed over so far ahead.
const HORIZON: u32 = 64;
/// The step engine has so many layers at a time, which cannot be amended any more.
pub(super) const IN_ENGINE: u32 = 2;
/// A job is amended once in this time at most, s: with all layers up to the horizon that keeps a serial line busy for a fifth of it.
const AMEND_EVERY_S: f64 = 0.5;
/// And so often in all, less an eighth of the job's layers: a board's journal has room for some 2,000 records besides the layers that a
/// job begins with, and a job that is amended may come to have more of them.
const MAX_AMENDMENTS: usize = 1792;
/// A layer may have been begun while a job was amended: then it is tried again, so often.
const AMEND_TRIES: u32 = 4;

impl Growth<'_> {
    /// Layers of the job that the board is to have by now: with feedback, none that will be others before they are laid.
    fn wanted(&self) -> usize {
        let all = self.job.layers.len();
        if self.feedback.is_some() { all.min(self.laid.saturating_add(HORIZON) as usize) } else { all }
    }

    /// Sends as many layers as the board has room for; whole messages, but for the last, while it grows.
    pub(super) fn hand_over(&mut self, on_event: &mut dyn FnMut(&JobEvent)) -> Result<(), ClientError> {
        let wanted = self.wanted();
        if let Some(layers) = self.job.layers.get(self.handed_over as usize..wanted).filter(|layers| !layers.is_empty())
        {
            on_event(&JobEvent::HandingOver { from: self.handed_over, layers: layers.to_vec() });
            self.handed_over = wanted as u32;
        }
        let layers = self.job.layers.get(..wanted).unwrap_or_default();
        match self.client.hand_over(self.job.plan_id, layers, self.accepted.clone()) {
            Ok(accepted) => self.accepted = accepted,
            // It stopped in between; the status will say so.
            Err(ClientError::Refused { refusal: Refusal::WrongState { .. }, .. }) => {}
            Err(error) => return Err(error),
        }
        Ok(())
    }

    /// With feedback, plans the layers from this index on again, or from the first one that can still be another, and has the board lay
    /// these. Where it does not take them it goes on with those that it has.
    pub(super) fn amend(&mut self, mut from: u32, on_event: &mut dyn FnMut(&JobEvent)) -> Result<(), ClientError> {
        let layers = self.job.layers.len();
        let is_early = self.laid < self.amend_at || self.as_built.len() < self.laid as usize;
        if is_early || self.laid as usize >= layers {
            return Ok(());
        }
        let max = MAX_AMENDMENTS.saturating_sub(layers / 8).max(1);
        for _ in 0..AMEND_TRIES {
            let Some(feedback) = &mut self.feedback else { return Ok(()) };
            from = from.min(self.accepted.next);
            let kept = self.job.layers.get(..from as usize).unwrap_or(&self.job.layers);
            let rest = feedback.rest(kept.get(self.as_built.len()..).unwrap_or_default());
            let amended = [kept, &rest].concat();
            let (plan_id, total) = (feedback.plan_id(&amended), amended.len() as u32);
            let in_time = libm::ceil(AMEND_EVERY_S / self.job.robot.description().layer.period_s) as u32;
            self.amend_at = self.laid.saturating_add(in_time.max(layers.div_ceil(max) as u32).max(1));
            // A board takes no job of which nothing is left.
            if plan_id == self.job.plan_id || total <= self.laid || feedback.amendments() as usize >= max {
                return Ok(());
            }
            let horizon = rest.iter().take(HORIZON as usize).copied().collect();
            on_event(&JobEvent::Amending(Amendment { plan_id, from, total, layers: horizon }));
            let first_layers = rest.iter().take(MAX_LAYERS).copied().collect();
            let amend = Amend { plan_id: self.job.plan_id, amended: plan_id, from, layers: total, first_layers };
            let handed_over = total.min(from.saturating_add(HORIZON));
            self.amending = Some(PendingAmendment { plan_id, layers: amended, handed_over });
            match self.client.request("to amend the job", &Message::Amend(amend)) {
                Ok(Message::Accepted(accepted)) => {
                    self.accepted = accepted;
                    self.amended();
                    return Ok(());
                }
                Ok(other) => return Err(ClientError::Unexpected { request: "to amend the job", kind: other.kind() }),
                Err(ClientError::Refused { refusal, request }) if refusal != Refusal::NoSession => {
                    self.amending = None;
                    let why = match refusal {
                        Refusal::Begun { .. } | Refusal::OutOfOrder { .. } | Refusal::WrongState { .. } => None,
                        refusal => Some(ClientError::Refused { request, refusal }.to_string()),
                    };
                    on_event(&JobEvent::NotAmended(why));
                    match refusal {
                        // A layer has been begun meanwhile.
                        Refusal::Begun { first } => from = first,
                        Refusal::OutOfOrder { expected } => self.accepted.next = expected,
                        _ => return Ok(()),
                    }
                }
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// The board has taken the amendment.
    pub(super) fn amended(&mut self) {
        let Some(PendingAmendment { plan_id, layers, handed_over }) = self.amending.take() else { return };
        (self.job.plan_id, self.job.layers, self.handed_over) = (plan_id, layers, handed_over);
        self.names.push(plan_id);
        if let Some(feedback) = &mut self.feedback {
            feedback.amended();
        }
    }

    /// Sends more layers, once there is room for a few messages of them, or for the rest.
    pub(super) fn refill(&mut self, on_event: &mut dyn FnMut(&JobEvent)) -> Result<(), ClientError> {
        let wanted = self.wanted() as u32;
        let left = wanted.saturating_sub(self.accepted.next);
        if left == 0 || self.accepted.room < left.min(HORIZON) {
            return Ok(());
        }
        self.hand_over(on_event)
    }
}
