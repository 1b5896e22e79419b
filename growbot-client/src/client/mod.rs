//! The host's side of the link to a board: sends requests, and receives responses and events.
//!
//! - `session`: identity and owner of the board; `requests`: requests to the board; `layer_upload`: transfer of layers;
//! - `configure`: robot descriptions;
//! - `exchange`: frames sent and received; `timeouts`: timeouts;
//! - `clock`: comparison of the board's clock with the host's; `emergency`: the emergency stop.

mod clock;
mod configure;
mod emergency;
mod error;
mod exchange;
mod layer_upload;
mod requests;
mod session;
mod timeouts;

use std::collections::VecDeque;

use growbot_core::link::frame::{FrameDecoder, next_seq};
use growbot_core::link::message::{Empty, Message};

use self::clock::ClockWatch;
pub use self::emergency::{EMERGENCY_LIMIT, EMERGENCY_PAUSE};
pub use self::error::{ClientError, MOVE_FILAMENT, SEND_DESCRIPTION, TURN_HEAD};
pub use self::exchange::has_commanded_board;
use crate::port::Port;

/// A host's connection to a board, for requests and events. When it is dropped with an open session, it sends
/// `Goodbye`, so that the board can accept another host at once.
pub struct Client {
    port: Box<dyn Port>,
    name: String,
    receiver: FrameDecoder,
    arrived: VecDeque<u8>,
    session: u32,
    /// True if the board has accepted this client's session.
    open: bool,
    /// Sequence number of the latest request.
    seq: u16,
    /// Sequence number of the latest event that was received.
    received: u16,
    /// True if the latest event was acknowledged to the board.
    acknowledged: bool,
    events: VecDeque<Message>,
    /// Number of requests that were sent again.
    repeated: u64,
    /// True if this client may take the board from another host that owns it.
    takes_over: bool,
    clocks: ClockWatch,
}

impl Client {
    /// Creates a client on an open port. `name` is its name in error messages.
    pub fn new(port: Box<dyn Port>, name: &str) -> Self {
        Self {
            port,
            name: name.to_string(),
            receiver: FrameDecoder::default(),
            arrived: VecDeque::new(),
            session: new_session(),
            open: false,
            seq: 0,
            received: 0,
            acknowledged: true,
            events: VecDeque::new(),
            repeated: 0,
            takes_over: false,
            clocks: ClockWatch::default(),
        }
    }

    /// Lets this client, when it opens its session, take the board from another host that owns it.
    #[must_use]
    pub fn with_take_over(mut self) -> Self {
        self.takes_over = true;
        self
    }

    /// Returns the port on which the client communicates.
    pub fn port(&mut self) -> &mut dyn Port {
        self.port.as_mut()
    }

    /// Returns the number of requests that were sent again because they or their responses were lost.
    pub fn repeated(&self) -> u64 {
        self.repeated
    }

    /// Drops the client without sending `Goodbye`, as if the process had been killed.
    pub fn drop_without_goodbye(mut self) {
        self.open = false;
    }

    /// Returns a second port on the same connection with which another thread can send the emergency stop. From its
    /// first use until it is dropped, this client blocks. `None` if the robot is simulated in this program and ends
    /// with it.
    pub fn emergency_port(&mut self) -> Option<Box<dyn Port + Send>> {
        self.port.emergency_port()
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        if self.open {
            self.seq = next_seq(self.seq);
            // If this message is lost, the board detects the missing host after some seconds.
            let _ = self.post(self.seq, &Message::Goodbye(Empty {}));
        }
    }
}

/// Returns a new session number that differs from those of other hosts with high probability.
fn new_session() -> u32 {
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap_or_default();
    // The number is never 0, which stands for the absence of a session.
    (now.as_secs() as u32).rotate_left(12) ^ now.subsec_nanos() ^ std::process::id() | 1
}
