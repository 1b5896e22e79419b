//! The board's end of the link: received and sent frames, the session, and the events that a host has not acknowledged.
//!
//! Both directions are reliable. A host repeats a request until it gets a response. A repeated request gets the same
//! response as the first time and is not carried out again. The board repeats an event until the host acknowledges it.

use growbot_core::link::frame::{
    self, FrameDecoder, FrameError, FrameHeader, LinkFrame, MAX_BODY_LEN, MAX_FRAME_LEN, is_seq_after, next_seq,
};
use growbot_core::link::message::{HostName, LayerLaid, Message, StateChanged, Tuned};
use heapless::Deque;

/// Capacity of the send queue, bytes. It holds a few frames.
const OUTBOX: usize = 1024;
/// Number of bytes of the send queue ([`OUTBOX`]) that events never fill, so that a response always fits.
const RESERVED_FOR_ANSWERS: usize = MAX_FRAME_LEN;
/// Max number of events that wait for the host's acknowledgement.
const EVENTS: usize = 16;
/// Message kind of a frame that only acknowledges events.
const ACK: u8 = 0x0E;
/// Max number of events about laid layers in the queue of unacknowledged events ([`EVENTS`]), so that other events
/// still fit. The journal stores the reports of further layers.
const MAX_LAID: usize = EVENTS - 4;
/// Number of closed sessions that the board remembers, so that a delayed frame does not open its closed session again.
const CLOSED: usize = 4;
/// Time without a received frame after which a host counts as silent, us.
pub const HOST_TIMEOUT_US: u64 = 10_000_000;
/// Time without an acknowledgement after which unacknowledged events are sent again, us. The time doubles with each
/// repetition.
const RESEND_US: u64 = 400_000;
/// Max time between two repetitions of an unacknowledged event, us.
const MAX_RESEND_US: u64 = 3_200_000;

/// An event that the board reports to the host, and repeats until the host acknowledges it.
#[derive(Debug, Clone, PartialEq)]
pub enum HostEvent {
    /// A layer has been laid.
    Laid(LayerLaid),
    /// The robot's state has changed.
    State(StateChanged),
    /// The tuning of the heater has found the PID gains.
    Tuned(Tuned),
}

impl HostEvent {
    fn message(self) -> Message {
        match self {
            Self::Laid(laid) => Message::LayerLaid(laid),
            Self::State(change) => Message::StateChanged(change),
            Self::Tuned(tuned) => Message::Tuned(tuned),
        }
    }
}

/// Schedule for the repetition of events that are not acknowledged.
#[derive(Debug, Clone, Copy)]
struct Retransmit {
    /// Time at which unacknowledged events are sent again, us.
    due: u64,
    /// Time between two repetitions, us. It doubles with each repetition.
    pause: u64,
}

impl Retransmit {
    fn after(pause: u64, now: u64) -> Self {
        Self { due: now.saturating_add(pause), pause }
    }
}

/// The open session with a host.
#[derive(Debug)]
struct Session {
    id: u32,
    host: HostName,
    /// Time at which a frame of this session was last received, us.
    received: u64,
    /// Sequence number of the latest request in this session.
    request: u16,
    /// Response to the latest request. `None` until the response is sent.
    answer: Option<Message>,
    /// Sequence number of the oldest event that is not acknowledged.
    first_event: u16,
    /// Number of unacknowledged events that have been sent since the latest repetition began.
    sent: usize,
    resend: Retransmit,
}

/// The way in which a received frame is to be handled.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameAction {
    /// The frame is a request of the open session, received for the first time. It is to be carried out.
    Handle,
    /// The frame does not belong to the open session.
    NoSession,
    /// The frame needs no further handling: its response was sent again, or it is too old to matter.
    Ignore,
}

/// The board's end of the link to the host.
#[derive(Debug, Default)]
pub struct Link {
    receiver: FrameDecoder,
    outbox: Deque<u8, OUTBOX>,
    session: Option<Session>,
    closed: Deque<u32, CLOSED>,
    events: Deque<HostEvent, EVENTS>,
}

impl Link {
    /// Processes a received byte. Returns the frame that this byte completes, or `None` within a frame. An error means
    /// that the bytes were not a valid frame. The caller ignores the error, because the sender repeats the frame.
    pub fn receive(&mut self, byte: u8) -> Option<Result<LinkFrame, FrameError>> {
        self.receiver.push(byte)
    }

    /// Removes and returns the next byte to send. `None` if there is nothing to send.
    pub fn next_tx_byte(&mut self) -> Option<u8> {
        self.outbox.pop_front()
    }

    /// Opens a session for a host. `header` is the header of the request that opens the session. A session that is
    /// still open is closed first.
    pub fn open(&mut self, header: &FrameHeader, host: HostName, now: u64) {
        self.close();
        self.session = Some(Session {
            id: header.session,
            host,
            received: now,
            request: header.seq,
            answer: None,
            first_event: 1,
            sent: 0,
            resend: Retransmit { due: now, pause: RESEND_US },
        });
    }

    /// Closes the session, because its host ends it or no longer acknowledges events. Drops the events that are not
    /// acknowledged.
    pub fn close(&mut self) {
        if let Some(session) = self.session.take() {
            if self.closed.is_full() {
                self.closed.pop_front();
            }
            // The queue is not full: its oldest element was removed above.
            let _ = self.closed.push_back(session.id);
        }
        // The status reports the effects of earlier events.
        self.events.clear();
    }

    /// Returns whether the session with this identifier was closed, so that it must not be opened again.
    pub fn is_closed(&self, session: u32) -> bool {
        self.closed.iter().any(|closed| *closed == session)
    }

    /// Returns whether the session with this identifier is open.
    pub fn is_open(&self, session: u32) -> bool {
        self.session.as_ref().is_some_and(|open| open.id == session)
    }

    /// Returns the host that owns the board, and the time since its last frame was received, us. `None` if no session
    /// is open, or once the host has been silent for [`HOST_TIMEOUT_US`].
    pub fn owner(&self, now: u64) -> Option<(&HostName, u64)> {
        let session = self.session.as_ref()?;
        let silent = now.saturating_sub(session.received);
        (silent < HOST_TIMEOUT_US).then_some((&session.host, silent))
    }

    /// Processes the header of a received frame: records that the host is alive, and removes the events that the frame
    /// acknowledges. Returns how the frame is to be handled.
    pub fn process_header(&mut self, header: &FrameHeader, now: u64) -> FrameAction {
        let Some(session) = self.session.as_mut().filter(|session| session.id == header.session) else {
            return FrameAction::NoSession;
        };
        session.received = now;
        while session.sent > 0 && header.ack != 0 && !is_seq_after(session.first_event, header.ack) {
            self.events.pop_front();
            session.first_event = next_seq(session.first_event);
            session.sent -= 1;
            session.resend = Retransmit::after(RESEND_US, now);
        }
        if header.kind == ACK || header.seq == 0 {
            return FrameAction::Ignore;
        }
        if is_seq_after(header.seq, session.request) {
            session.request = header.seq;
            session.answer = None;
            return FrameAction::Handle;
        }
        if header.seq == session.request
            && let Some(answer) = session.answer.take()
        {
            self.send(header.session, 0, header.seq, &answer);
            self.cache_response(answer);
        }
        FrameAction::Ignore
    }

    /// Sends the response to a request and stores it for a repetition of the request. If the send queue is full the
    /// response is not sent, because the host repeats the request.
    pub fn respond(&mut self, request: &FrameHeader, message: Message) {
        self.send(request.session, 0, request.seq, &message);
        if self.is_open(request.session) {
            self.cache_response(message);
        }
    }

    fn cache_response(&mut self, answer: Message) {
        if let Some(session) = &mut self.session {
            session.answer = Some(answer);
        }
    }

    /// Returns whether a session is open and the queue of unacknowledged events can take another report of a laid
    /// layer.
    pub fn has_room_for_layer(&self) -> bool {
        let waiting = self.events.iter().filter(|event| matches!(event, HostEvent::Laid(_))).count();
        self.session.is_some() && waiting < MAX_LAID && !self.events.is_full()
    }

    /// Queues an event for the host. If the queue is full of events that the host has not acknowledged, its session is
    /// closed. When the host returns, the status reports the effects of the events.
    pub fn push_event(&mut self, event: HostEvent) {
        if self.session.is_some() && self.events.push_back(event).is_err() {
            self.close();
        }
    }

    /// Sends the events that are due, as far as the send queue has room.
    pub fn send_events(&mut self, now: u64) {
        let Some(session) = &mut self.session else { return };
        let Retransmit { due, pause } = session.resend;
        if session.sent > 0 && now >= due {
            session.sent = 0;
            session.resend = Retransmit::after((2 * pause).min(MAX_RESEND_US), now);
        }
        while let Some(session) = &mut self.session
            && self.outbox.len() + MAX_FRAME_LEN + RESERVED_FOR_ANSWERS <= OUTBOX
            && let Some(event) = self.events.iter().nth(session.sent)
        {
            if session.sent == 0 && now >= session.resend.due {
                session.resend = Retransmit::after(session.resend.pause, now);
            }
            let seq = (0..session.sent).fold(session.first_event, |seq, _| next_seq(seq));
            let (id, message) = (session.id, event.clone().message());
            session.sent += 1;
            self.send(id, seq, 0, &message);
        }
    }

    /// Sends a message that belongs to no session.
    pub fn broadcast(&mut self, message: &Message) {
        self.send(0, 0, 0, message);
    }

    fn send(&mut self, session: u32, seq: u16, ack: u16, message: &Message) {
        let mut buffer = [0; MAX_BODY_LEN];
        let Ok(body) = message.encode_response(&mut buffer) else { return };
        let header = FrameHeader { kind: message.kind(), session, seq, ack };
        let Ok(bytes) = frame::encode(&header, body) else { return };
        if self.outbox.len() + bytes.len() <= OUTBOX {
            for byte in bytes {
                // The queue is not full.
                let _ = self.outbox.push_back(byte);
            }
        }
    }
}
