//! Exchange of frames with the board: requests, their responses, and events.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use growbot_core::link::frame::{self, FrameError, FrameHeader, LinkFrame, MAX_BODY_LEN, next_seq};
use growbot_core::link::message::{Empty, EnergizingRequest, Message, MessageError, PassiveRequest, RefusalResponse};

use super::timeouts::{FIRST_RETRY_DELAY, MAX_ATTEMPTS, MAX_RETRY_DELAY, PLAN_RETRY_DELAY, PLAN_TIMEOUT, ResponseWait};
use super::{Client, ClientError};
use crate::stop_signal::Permit;

/// True once this process has sent a request that changes the state of a board.
static COMMANDED: AtomicBool = AtomicBool::new(false);

/// Reports whether this process has sent a request that changes the state of a board, even if no response arrived.
/// Requests for information do not count.
pub fn has_commanded_board() -> bool {
    COMMANDED.load(Ordering::Relaxed)
}

/// Records that this process sends a request that changes the state of a board.
pub(super) fn record_command() {
    COMMANDED.store(true, Ordering::Relaxed);
}

fn changes_board(message: &Message) -> bool {
    !matches!(
        message,
        Message::Hello(_)
            | Message::GetStatus(_)
            | Message::GetLatestFault(_)
            | Message::GetSensorReadings(_)
            | Message::GetBoardInfo(_)
            | Message::GetBootReport(_)
            | Message::ReadLayers(_)
            | Message::Plan(_)
            | Message::Ack(_)
            | Message::Goodbye(_)
    )
}

/// Interval at which `Ack` messages are sent in long waits. A board pauses if its host sends nothing for 10 s.
const KEEP_ALIVE_INTERVAL: Duration = Duration::from_secs(3);

impl Client {
    /// Sends a request and waits for the response. Sends the request again if no response arrives. `what` is the name
    /// of the request in error messages.
    ///
    /// # Errors
    /// If no response arrives, or the board refuses.
    pub fn request(&mut self, what: &'static str, request: &PassiveRequest) -> Result<Message, ClientError> {
        self.transact(what, &request.clone().into(), || Ok(()))
    }

    /// Sends a request after which the board may heat or move, and waits for the response. No other function sends such
    /// requests. The permit is checked before each transmission, so nothing is sent after a stop except a frame whose
    /// transmission has begun.
    ///
    /// # Errors
    /// [`ClientError::Voided`] if the permit is void: a stop was raised since it was given, or, for a permit to
    /// continue, a pause was commanded. Otherwise like [`Client::request`].
    pub fn energize(
        &mut self,
        what: &'static str,
        request: &EnergizingRequest,
        permit: &Permit,
    ) -> Result<Message, ClientError> {
        let check = || if permit.is_valid() { Ok(()) } else { Err(ClientError::Voided { request: what }) };
        self.transact(what, &request.clone().into(), check)
    }

    /// Sends a request and waits for the response. Calls `check` before each transmission, and returns its error.
    fn transact(
        &mut self,
        what: &'static str,
        request: &Message,
        check: impl Fn() -> Result<(), ClientError>,
    ) -> Result<Message, ClientError> {
        let plans = matches!(request, Message::Plan(_));
        let mut repeat = if plans { PLAN_RETRY_DELAY } else { FIRST_RETRY_DELAY };
        self.seq = next_seq(self.seq);
        let seq = self.seq;
        let mut wait = ResponseWait { in_session: self.open, ..ResponseWait::default() };
        for attempt in 0..MAX_ATTEMPTS {
            check()?;
            self.repeated += u64::from(attempt > 0);
            self.post(seq, request)?;
            if let Some(frame) = self.wait_for_response(|ack| ack == seq, repeat, &mut wait)? {
                return decode_response(what, &frame);
            }
            if wait.has_timed_out(if plans { PLAN_TIMEOUT } else { Duration::ZERO }) {
                break;
            }
            repeat = (repeat * 5 / 4).min(MAX_RETRY_DELAY.max(repeat));
        }
        Err(self.timeout_error(&wait))
    }

    /// Sends a message in a frame, which also acknowledges the latest event.
    pub(super) fn post(&mut self, seq: u16, message: &Message) -> Result<(), ClientError> {
        let mut buffer = [0; MAX_BODY_LEN];
        let too_long = ClientError::Unexpected { request: "a message", kind: message.kind() };
        let Ok(body) = message.encode(&mut buffer) else { return Err(too_long) };
        let header = FrameHeader { kind: message.kind(), session: self.session, seq, ack: self.received };
        let Ok(bytes) = frame::encode(&header, body) else { return Err(too_long) };
        self.acknowledged = true;
        if changes_board(message) {
            record_command();
        }
        Ok(self.port.send(&bytes)?)
    }

    /// Waits up to `patience` for a response to a request for whose sequence number `is_asked` returns true. Stores the
    /// events that arrive meanwhile. `None` if no response arrives.
    pub(super) fn wait_for_response(
        &mut self,
        is_asked: impl Fn(u16) -> bool,
        patience: Duration,
        wait: &mut ResponseWait,
    ) -> Result<Option<LinkFrame>, ClientError> {
        let step = patience.min(Duration::from_millis(100));
        let mut waited = Duration::ZERO;
        // Each frame counts as a short time too, so that a board that sends without end does not block this loop for
        // ever.
        let passing = Duration::from_millis(2);
        while waited < patience {
            match self.next_frame(step)? {
                None => {
                    waited += step;
                    wait.quiet += step;
                }
                Some(Ok(frame)) => {
                    (wait.quiet, wait.pieces) = (Duration::ZERO, 0);
                    waited += passing;
                    let header = frame.header;
                    if header.session == self.session && header.ack != 0 {
                        if is_asked(header.ack) {
                            return Ok(Some(frame));
                        }
                    } else {
                        self.ingest_event(&frame);
                    }
                }
                Some(Err(error)) => {
                    waited += passing;
                    wait.quiet += passing;
                    wait.pieces += 1;
                    wait.unreadable = Some(error);
                }
            }
        }
        Ok(None)
    }

    /// Returns the error for a wait without a response, which depends on the bytes that were received.
    pub(super) fn timeout_error(&self, wait: &ResponseWait) -> ClientError {
        let port = self.name.clone();
        match wait.unreadable {
            None => ClientError::NoResponse { port },
            Some(source @ FrameError::Version { .. }) => ClientError::Version { port, source },
            Some(_) => ClientError::Garbage { port },
        }
    }

    /// Waits for an event of the board. `None` if no event arrives within the timeout.
    ///
    /// # Errors
    /// If the connection is broken.
    pub fn event(&mut self, timeout: Duration) -> Result<Option<Message>, ClientError> {
        if self.events.is_empty()
            && let Some(Ok(frame)) = self.next_frame(timeout)?
        {
            self.ingest_event(&frame);
        }
        Ok(self.events.pop_front())
    }

    /// Waits for a time on the port's clock. Stores the events that arrive meanwhile.
    ///
    /// # Errors
    /// If the connection is broken.
    pub fn wait(&mut self, time: Duration) -> Result<(), ClientError> {
        let step = Duration::from_millis(50);
        for _ in 0..time.as_millis().div_ceil(step.as_millis()) {
            if let Some(Ok(frame)) = self.next_frame(step)? {
                self.ingest_event(&frame);
            }
        }
        Ok(())
    }

    /// Stores the event in a frame if it is the next one in order. A later event is dropped, because the board repeats
    /// all unacknowledged events.
    pub(super) fn ingest_event(&mut self, frame: &LinkFrame) {
        let FrameHeader { session, seq, ack, .. } = frame.header;
        // An emergency stop of this host or another was acknowledged.
        if let (0, 0, 0, Ok(stopped @ Message::EmergencyStopAck(_))) =
            (session, seq, ack, Message::decode(frame.header.kind, &frame.body))
        {
            if !self.events.contains(&stopped) {
                self.events.push_back(stopped);
            }
            return;
        }
        // Ignore a late response and a frame of another session.
        if session != self.session || ack != 0 || seq == 0 {
            return;
        }
        self.acknowledged = false;
        if seq == next_seq(self.received)
            && let Ok(message) = Message::decode(frame.header.kind, &frame.body)
        {
            self.received = seq;
            self.events.push_back(message);
        }
    }

    /// Waits for the next frame. Returns a [`FrameError`] for bytes that are not a valid frame, and `None` if nothing
    /// arrives within the timeout.
    pub(super) fn next_frame(
        &mut self,
        timeout: Duration,
    ) -> Result<Option<Result<LinkFrame, FrameError>>, ClientError> {
        let mut taken = 0;
        // Bytes that keep arriving without forming a frame must not block this loop for ever.
        while taken < 2 * frame::MAX_FRAME_LEN {
            if self.arrived.is_empty() {
                if !self.acknowledged {
                    self.post(0, &Message::Ack(Empty {}))?;
                }
                self.receive(timeout)?;
            }
            let Some(byte) = self.arrived.pop_front() else {
                return Ok((taken > 0).then_some(Err(FrameError::Garbled)));
            };
            taken += 1;
            if let Some(frame) = self.receiver.push(byte) {
                return Ok(Some(frame));
            }
        }
        Ok(Some(Err(FrameError::TooLong)))
    }

    /// Waits for bytes and stores them. In a long wait, sends `Ack` messages so that the board does not pause.
    fn receive(&mut self, timeout: Duration) -> Result<(), ClientError> {
        let mut left = timeout;
        loop {
            let slice = if self.open { left.min(KEEP_ALIVE_INTERVAL) } else { left };
            let mut buffer = [0; 256];
            let count = self.port.receive(&mut buffer, slice)?;
            self.arrived.extend(&buffer[..count]);
            left = left.saturating_sub(slice);
            if count > 0 || left.is_zero() {
                return Ok(());
            }
            self.post(0, &Message::Ack(Empty {}))?;
        }
    }
}

/// Decodes the response in a frame. A refusal is returned as an error. `request` is the name of the request in error
/// messages.
pub(super) fn decode_response(request: &'static str, frame: &LinkFrame) -> Result<Message, ClientError> {
    match Message::decode(frame.header.kind, &frame.body) {
        Ok(Message::Refused(RefusalResponse { refusal, .. })) => Err(ClientError::Refused { request, refusal }),
        Ok(message) => Ok(message),
        Err(MessageError::UnknownKind { kind } | MessageError::Body { kind }) => {
            Err(ClientError::Unexpected { request, kind })
        }
    }
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;
    use std::rc::Rc;
    use std::sync::Arc;

    use growbot_core::link::frame::FrameDecoder;
    use growbot_core::link::message::{HostSilencePolicy, Start};

    use super::*;
    use crate::port::{Port, PortError};
    use crate::stop_signal::{StopLevel, StopSignal};

    /// A port without a board. It raises a stop once `starts` messages `Start` were sent.
    struct StoppedAfter {
        starts: u32,
        signal: Arc<StopSignal>,
        receiver: FrameDecoder,
        sent: u32,
    }

    impl StoppedAfter {
        fn new(starts: u32) -> Self {
            Self { starts, signal: Arc::default(), receiver: FrameDecoder::default(), sent: 0 }
        }

        fn raise_stop_if_due(&self) {
            if self.sent >= self.starts {
                self.signal.raise(StopLevel::Stop);
            }
        }
    }

    impl Port for StoppedAfter {
        fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
            for frame in bytes.iter().filter_map(|byte| self.receiver.push(*byte)) {
                let frame = frame.unwrap();
                let message = Message::decode(frame.header.kind, &frame.body).unwrap();
                self.sent += u32::from(matches!(message, Message::Start(_)));
            }
            self.raise_stop_if_due();
            Ok(())
        }

        fn receive(&mut self, _buffer: &mut [u8], _timeout: Duration) -> Result<usize, PortError> {
            Ok(0)
        }
    }

    #[test]
    fn no_start_is_sent_after_a_stop_that_voids_its_permit() {
        let start = EnergizingRequest::Start(Start {
            plan_id: 1,
            on_host_silence: HostSilencePolicy::Pause,
            is_continuation: false,
        });
        let energize = |starts: u32| {
            let line = Rc::new(RefCell::new(StoppedAfter::new(starts)));
            let permit = line.borrow().signal.permit();
            line.borrow().raise_stop_if_due();
            let error = Client::new(Box::new(Rc::clone(&line)), "stopped").energize("to start", &start, &permit);
            let sent = line.borrow().sent;
            (sent, error.unwrap_err())
        };
        for starts in 0..3 {
            let (sent, error) = energize(starts);
            assert!(matches!(error, ClientError::Voided { request: "to start" }), "{starts}: {error}");
            assert_eq!(sent, starts, "{error}");
        }
        // Without a stop, the request is sent more often.
        let (sent, error) = energize(u32::MAX);
        assert!(sent > 3 && matches!(error, ClientError::NoResponse { .. }), "{sent}: {error}");
    }
}
