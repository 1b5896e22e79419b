//! The board's end of the link: frames in, frames out, the session, and events until a host has them.
//!
//! Both directions are reliable. A host repeats a request until it is answered; one that comes again is answered as the
//! first time and not carried out again. Events wait until the host acknowledges them, and are sent again until then.

use growbot_core::link::frame::{
    self, Frame, FrameError, Header, LONGEST_BODY, LONGEST_FRAME, Receiver, is_after, next,
};
use growbot_core::link::message::{HostName, Laid, Message, StateChanged, Tuned};
use heapless::Deque;

/// Bytes that wait to be sent: some frames.
const OUTBOX: usize = 1024;
/// Room that events leave free, so that a request can always be answered.
const RESERVED_FOR_ANSWERS: usize = LONGEST_FRAME;
/// Events that wait to be acknowledged.
const EVENTS: usize = 16;
/// The kind of a frame that only acknowledges events.
const HEARD: u8 = 0x0E;
/// Layers wait outside, where they are kept anyway: of these events there are never more, which leaves room for the
/// others.
const MAX_LAID: usize = EVENTS - 4;
/// Sessions that are over and whose delayed frames must not open them again.
const CLOSED: usize = 4;
/// A host that has not been heard for so long is silent, us.
pub const SILENCE_US: u64 = 10_000_000;
/// Events are sent again after so long without an acknowledgement, us; twice that after each time,
const RESEND_US: u64 = 400_000;
/// up to this.
const SLOWEST_RESEND_US: u64 = 3_200_000;

/// What a host must hear.
#[derive(Debug, Clone, PartialEq)]
pub enum Event {
    /// A layer is laid.
    Laid(Laid),
    /// The state is another one.
    State(StateChanged),
    /// The heater's gains are found.
    Tuned(Tuned),
}

impl Event {
    fn message(self) -> Message {
        match self {
            Self::Laid(laid) => Message::Laid(laid),
            Self::State(change) => Message::StateChanged(change),
            Self::Tuned(tuned) => Message::Tuned(tuned),
        }
    }
}

/// The session that is open.
#[derive(Debug)]
struct Session {
    id: u32,
    host: HostName,
    /// When its host was last heard, us.
    heard: u64,
    /// Number of the latest request.
    request: u16,
    /// What that request was answered.
    answer: Option<Message>,
    /// Number of the first event that waits.
    first_event: u16,
    /// How many of the events that wait have been sent since the latest repetition.
    sent: usize,
    /// When the events are sent again unless one is acknowledged, us, and how long that takes.
    resend: (u64, u64),
}

/// What is to be done with a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arrival {
    /// A request of the session that is open, for the first time.
    New,
    /// A request that belongs to no session that is open.
    Outside,
    /// Nothing: it was answered again, or is too old to matter.
    Settled,
}

/// The board's end of the link.
#[derive(Debug, Default)]
pub struct Link {
    receiver: Receiver,
    outbox: Deque<u8, OUTBOX>,
    session: Option<Session>,
    closed: Deque<u32, CLOSED>,
    events: Deque<Event, EVENTS>,
}

impl Link {
    /// Takes a byte that arrived. Where it ends a frame, that frame; what is no frame is passed over, since its sender
    /// will repeat it.
    pub fn receive(&mut self, byte: u8) -> Option<Result<Frame, FrameError>> {
        self.receiver.push(byte)
    }

    /// The next byte to send.
    pub fn transmit(&mut self) -> Option<u8> {
        self.outbox.pop_front()
    }

    /// Opens a session with the request that asks for it; one that was open is over.
    pub fn open(&mut self, header: &Header, host: HostName, now: u64) {
        self.close();
        self.session = Some(Session {
            id: header.session,
            host,
            heard: now,
            request: header.seq,
            answer: None,
            first_event: 1,
            sent: 0,
            resend: (now, RESEND_US),
        });
    }

    /// Closes the session: its host says goodbye, or is given up.
    pub fn close(&mut self) {
        if let Some(session) = self.session.take() {
            if self.closed.is_full() {
                self.closed.pop_front();
            }
            // There is room now.
            let _ = self.closed.push_back(session.id);
        }
        // What happened before is told by the status.
        self.events.clear();
    }

    /// Whether a session with this number is over, and must not be opened again.
    #[must_use]
    pub fn is_over(&self, session: u32) -> bool {
        self.closed.iter().any(|closed| *closed == session)
    }

    /// Whether this is the session that is open.
    #[must_use]
    pub fn is_open(&self, session: u32) -> bool {
        self.session.as_ref().is_some_and(|open| open.id == session)
    }

    /// The host that holds the board, and since when it has not been heard, us. None once it has been silent for too
    /// long.
    #[must_use]
    pub fn holder(&self, now: u64) -> Option<(&HostName, u64)> {
        let session = self.session.as_ref()?;
        let silent = now.saturating_sub(session.heard);
        (silent < SILENCE_US).then_some((&session.host, silent))
    }

    /// Takes note of a frame: that its host lives, and which events it has. Tells what is to be done with it.
    pub fn note(&mut self, header: &Header, now: u64) -> Arrival {
        let Some(session) = self.session.as_mut().filter(|session| session.id == header.session) else {
            return Arrival::Outside;
        };
        session.heard = now;
        while session.sent > 0 && header.ack != 0 && !is_after(session.first_event, header.ack) {
            self.events.pop_front();
            session.first_event = next(session.first_event);
            session.sent -= 1;
            session.resend = (now.saturating_add(RESEND_US), RESEND_US);
        }
        if header.kind == HEARD || header.seq == 0 {
            return Arrival::Settled;
        }
        if is_after(header.seq, session.request) {
            session.request = header.seq;
            session.answer = None;
            return Arrival::New;
        }
        if header.seq == session.request
            && let Some(answer) = session.answer.take()
        {
            self.send(header.session, 0, header.seq, &answer);
            self.remember(answer);
        }
        Arrival::Settled
    }

    /// Answers a request, and will do so again. Without room the answer is dropped: the host will ask again.
    pub fn answer(&mut self, request: &Header, message: Message) {
        self.send(request.session, 0, request.seq, &message);
        if self.is_open(request.session) {
            self.remember(message);
        }
    }

    fn remember(&mut self, answer: Message) {
        if let Some(session) = &mut self.session {
            session.answer = Some(answer);
        }
    }

    /// Whether there is a host to tell of layers, and room for another.
    #[must_use]
    pub fn takes_layers(&self) -> bool {
        let waiting = self.events.iter().filter(|event| matches!(event, Event::Laid(_))).count();
        self.session.is_some() && waiting < MAX_LAID && !self.events.is_full()
    }

    /// Tells an event to the host. One that has not heard so many is given up, and its session closed: when it comes
    /// back, the status tells where they led.
    pub fn tell(&mut self, event: Event) {
        if self.session.is_some() && self.events.push_back(event).is_err() {
            self.close();
        }
    }

    /// Sends the events that are due, as far as there is room.
    pub fn send_events(&mut self, now: u64) {
        let Some(session) = &mut self.session else { return };
        let (due, pause) = session.resend;
        if session.sent > 0 && now >= due {
            let pause = (2 * pause).min(SLOWEST_RESEND_US);
            session.sent = 0;
            session.resend = (now.saturating_add(pause), pause);
        }
        while let Some(session) = &mut self.session
            && self.outbox.len() + LONGEST_FRAME + RESERVED_FOR_ANSWERS <= OUTBOX
            && let Some(event) = self.events.iter().nth(session.sent)
        {
            if session.sent == 0 && now >= session.resend.0 {
                session.resend.0 = now.saturating_add(session.resend.1);
            }
            let seq = (0..session.sent).fold(session.first_event, |seq, _| next(seq));
            let (id, message) = (session.id, event.clone().message());
            session.sent += 1;
            self.send(id, seq, 0, &message);
        }
    }

    /// Sends a message that belongs to no session.
    pub fn call_out(&mut self, message: &Message) {
        self.send(0, 0, 0, message);
    }

    fn send(&mut self, session: u32, seq: u16, ack: u16, message: &Message) {
        let mut buffer = [0; LONGEST_BODY];
        let Ok(body) = message.encode_answer(&mut buffer) else { return };
        let header = Header { kind: message.kind(), session, seq, ack };
        let Ok(bytes) = frame::encode(&header, body) else { return };
        if self.outbox.len() + bytes.len() <= OUTBOX {
            for byte in bytes {
                // There is room.
                let _ = self.outbox.push_back(byte);
            }
        }
    }
}
