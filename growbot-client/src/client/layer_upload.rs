//! Transfer of layers to the board. Several messages are sent before their responses arrive.

use std::collections::VecDeque;
use std::time::Duration;

use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::frame::next_seq;
use growbot_core::link::message::{Accepted, AppendLayers, LayerBatch, MAX_LAYERS_PER_MESSAGE, Message, Refusal};

use super::exchange::decode_response;
use super::timeouts::{MAX_ATTEMPTS, MAX_RETRY_DELAY, ResponseWait};
use super::{Client, ClientError};

/// Maximum number of messages with layers that are sent without a response. Boards can buffer more.
const WINDOW: usize = 8;

impl Client {
    /// Sends layers until all are sent or the board has no free space. `layers` are all layers of the job, and sending
    /// begins at the layer that the board expects according to `accepted`, its latest response. Returns the new latest
    /// response. Messages get shorter if many are lost.
    ///
    /// # Errors
    /// Like [`Client::request`].
    pub fn upload_layers(
        &mut self,
        plan_id: u64,
        layers: &[LayerBytes],
        accepted: Accepted,
    ) -> Result<Accepted, ClientError> {
        let what = "the request to store layers";
        let mut handover = LayerUpload::new(plan_id, layers, accepted);
        let mut wait = ResponseWait { in_session: self.open, ..ResponseWait::default() };
        loop {
            while let Some(layers) = handover.next_message() {
                self.seq = next_seq(self.seq);
                handover.in_flight.push_back(self.seq);
                self.post(self.seq, &Message::AppendLayers(layers))?;
            }
            if handover.in_flight.is_empty() {
                return Ok(handover.accepted);
            }
            let answered =
                self.wait_for_response(|ack| handover.in_flight.contains(&ack), MAX_RETRY_DELAY, &mut wait)?;
            let Some(frame) = answered else {
                if wait.has_timed_out(Duration::ZERO) || handover.fruitless >= MAX_ATTEMPTS {
                    return Err(self.timeout_error(&wait));
                }
                self.repeated += handover.resend_all();
                continue;
            };
            handover.settle(frame.header.ack);
            match decode_response(what, &frame) {
                Ok(Message::Accepted(accepted)) => {
                    handover.accept(accepted);
                    if handover.fruitless > MAX_ATTEMPTS {
                        return Err(ClientError::Unexpected { request: what, kind: frame.header.kind });
                    }
                }
                // An earlier message was lost.
                Err(ClientError::Refused { refusal: Refusal::OutOfOrder { expected }, .. }) => {
                    self.repeated += handover.resend_from(expected);
                }
                // The board has less free space than it reported earlier.
                Err(ClientError::Refused { refusal: Refusal::LayerStoreFull, .. }) => return Ok(handover.accepted),
                Err(error) => return Err(error),
                Ok(other) => return Err(ClientError::Unexpected { request: what, kind: other.kind() }),
            }
        }
    }
}

/// State of a transfer of layers.
struct LayerUpload<'a> {
    plan_id: u64,
    layers: &'a [LayerBytes],
    accepted: Accepted,
    /// Sequence numbers of the messages without a response, oldest first.
    in_flight: VecDeque<u16>,
    /// Index of the next layer to be sent.
    sent: u32,
    /// Maximum number of layers per message.
    batch: usize,
    /// Number of successive attempts after which the board had not accepted more layers.
    fruitless: u32,
    /// Highest index of a next layer that the board has reported. Progress is measured by it, because layers that are
    /// accepted again are not progress.
    furthest: u32,
}

impl<'a> LayerUpload<'a> {
    fn new(plan_id: u64, layers: &'a [LayerBytes], accepted: Accepted) -> Self {
        let next = accepted.next;
        Self {
            plan_id,
            layers,
            accepted,
            in_flight: VecDeque::new(),
            sent: next,
            batch: MAX_LAYERS_PER_MESSAGE,
            fruitless: 0,
            furthest: next,
        }
    }

    /// Returns the next message to send. `None` while enough messages wait for a response, if the board has no free
    /// space, or if all layers are sent.
    fn next_message(&mut self) -> Option<AppendLayers> {
        let end = (self.layers.len() as u32).min(self.accepted.next.saturating_add(self.accepted.free_layers));
        if self.in_flight.len() >= WINDOW || self.sent >= end {
            return None;
        }
        let rest = self.layers.get(self.sent as usize..end as usize).unwrap_or_default();
        let layers: LayerBatch = rest.iter().take(self.batch).copied().collect();
        let first = self.sent;
        self.sent += layers.len() as u32;
        Some(AppendLayers { plan_id: self.plan_id, first, layers })
    }

    /// Prepares to send all unaccepted layers again in shorter messages, because no response arrived. Returns the
    /// number of messages without a response.
    fn resend_all(&mut self) -> u64 {
        (self.fruitless, self.batch) = (self.fruitless + 1, (self.batch / 2).max(1));
        self.sent = self.accepted.next;
        self.forget_flying()
    }

    /// Removes all messages up to this sequence number from `in_flight`. The board processes requests in the order of
    /// their numbers, so it has processed the earlier messages, or they are lost.
    fn settle(&mut self, seq: u16) {
        while self.in_flight.pop_front().is_some_and(|flying| flying != seq) {}
    }

    /// Updates the state from a response in which the board accepts layers.
    fn accept(&mut self, accepted: Accepted) {
        if accepted.next > self.furthest {
            (self.fruitless, self.furthest) = (0, accepted.next);
        } else if self.in_flight.is_empty() {
            self.fruitless += 1;
        }
        self.accepted = accepted;
        self.sent = self.sent.max(self.accepted.next);
        if self.in_flight.is_empty() {
            self.sent = self.accepted.next;
        }
    }

    /// Prepares to send all layers again from the layer that the board expects, in shorter messages. Returns the number
    /// of messages that are sent again.
    fn resend_from(&mut self, expected: u32) -> u64 {
        (self.fruitless, self.batch) = (self.fruitless + 1, (self.batch * 3 / 4).max(1));
        self.accepted.next = expected;
        self.sent = expected;
        self.forget_flying() + 1
    }

    fn forget_flying(&mut self) -> u64 {
        let forgotten = self.in_flight.len() as u64;
        self.in_flight.clear();
        forgotten
    }
}
