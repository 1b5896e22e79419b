//! The host's end of the link: requests with responses, and the events in between.
//!
//! - `session`: identity and owner of the board; `requests`: requests to it; `hand_over`: transfer of layers;
//! - `configure`: robot descriptions;
//! - `exchange`: frames sent and received; `patience`: timeouts;
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

pub use self::clock::ClockDrift;
use self::clock::ClockWatch;
pub use self::emergency::{EMERGENCY_LIMIT, EMERGENCY_PAUSE};
pub use self::error::{ClientError, MOVE_FILAMENT};
pub use self::exchange::has_commanded_board;
pub use self::requests::StopOutcome;
use self::session::new_session;
use crate::port::Port;

/// The client sends `Goodbye` when it is dropped, so that the board knows that its host is gone.
pub struct Client {
    port: Box<dyn Port>,
    name: String,
    receiver: FrameDecoder,
    arrived: VecDeque<u8>,
    session: u32,
    /// True if the board has accepted the session.
    open: bool,
    /// Number of the latest request.
    seq: u16,
    /// Number of the latest event.
    received: u16,
    /// True if the number of the latest event was sent to the board.
    acknowledged: bool,
    events: VecDeque<Message>,
    /// Number of requests that were sent again.
    repeated: u64,
    /// True if this host takes the board from another host that owns it.
    takes_over: bool,
    clocks: ClockWatch,
}

impl Client {
    /// Creates a client on an open port. `name` is its name in error messages.
    #[must_use]
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

    /// Sets whether this client takes the board from another host that owns it when it opens its session.
    #[must_use]
    pub fn with_take_over(mut self, takes_over: bool) -> Self {
        self.takes_over = takes_over;
        self
    }

    /// Returns the port.
    pub fn port(&mut self) -> &mut dyn Port {
        self.port.as_mut()
    }

    /// Returns the number of requests that were sent again because they or their responses were lost.
    #[must_use]
    pub fn repeated(&self) -> u64 {
        self.repeated
    }

    /// Drops the client without sending `Goodbye`, as if the process had been killed.
    pub fn drop_without_goodbye(mut self) {
        self.open = false;
    }

    /// Returns a port on the same line with which another thread can send the emergency stop. `None` if the robot ends
    /// with this program. From the first use of that port on, this client blocks until that port is dropped.
    pub fn emergency_port(&mut self) -> Option<Box<dyn Port + Send>> {
        self.port.emergency_port()
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        if self.open {
            self.seq = next_seq(self.seq);
            // If this message is lost, the board notices after some seconds.
            let _ = self.post(self.seq, &Message::Goodbye(Empty {}));
        }
    }
}
