//! The board's end of the link: frames in, frames out, and the session.

use growbot_core::link::frame::{self, Frame, FrameError, Header, LONGEST_BODY, LONGEST_FRAME, Receiver};
use growbot_core::link::message::Message;
use heapless::Deque;

/// Bytes that wait to be sent: some frames.
const OUTBOX: usize = 1024;
/// Room that events leave free, so that a request can always be answered.
const KEPT_FOR_ANSWERS: usize = LONGEST_FRAME;

/// The board's end of the link.
#[derive(Debug, Default)]
pub struct Link {
    receiver: Receiver,
    outbox: Deque<u8, OUTBOX>,
    /// The session that a host opened last.
    session: Option<u32>,
    seq: u16,
}

impl Link {
    /// Takes a byte that arrived. Where it ends a frame, that frame; what is no frame is passed over, since its sender will
    /// repeat it.
    pub fn receive(&mut self, byte: u8) -> Option<Result<Frame, FrameError>> {
        self.receiver.push(byte)
    }

    /// The next byte to send.
    pub fn transmit(&mut self) -> Option<u8> {
        self.outbox.pop_front()
    }

    /// Opens a session; one that was open is over.
    pub fn open(&mut self, session: u32) {
        self.session = Some(session);
    }

    /// Whether this is the session that is open.
    #[must_use]
    pub fn is_open(&self, session: u32) -> bool {
        self.session == Some(session)
    }

    /// Whether an event can be sent now: a host listens, and there is room.
    #[must_use]
    pub fn takes_events(&self) -> bool {
        self.session.is_some() && self.outbox.len() + LONGEST_FRAME + KEPT_FOR_ANSWERS <= OUTBOX
    }

    /// Answers a request. Without room the answer is dropped: the host will ask again.
    pub fn answer(&mut self, request: &Header, message: &Message) {
        self.send(request.session, request.seq, message);
    }

    /// Sends an event in the session that is open.
    pub fn event(&mut self, message: &Message) {
        if let Some(session) = self.session {
            self.send(session, 0, message);
        }
    }

    fn send(&mut self, session: u32, ack: u16, message: &Message) {
        let mut buffer = [0; LONGEST_BODY];
        let Ok(body) = message.encode_answer(&mut buffer) else { return };
        self.seq = self.seq.wrapping_add(1);
        let header = Header { kind: message.kind(), session, seq: self.seq, ack };
        let Ok(bytes) = frame::encode(&header, body) else { return };
        if self.outbox.len() + bytes.len() <= OUTBOX {
            for byte in bytes {
                // There is room.
                let _ = self.outbox.push_back(byte);
            }
        }
    }
}
