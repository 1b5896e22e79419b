//! The host's end of the link: requests with answers, and the events in between.
//!
//! - `session`: who the board is and who owns it; `requests`: what is asked of it; `hand_over`: layers on their way;
//! - `configure`: robot descriptions;
//! - `exchange`: frames out and in; `patience`: how long they are waited for;
//! - `clock`: the board's clock beside the host's; `emergency`: the emergency stop.

mod clock;
mod configure;
mod emergency;
mod error;
mod exchange;
mod hand_over;
mod patience;
mod requests;
mod session;

use std::collections::VecDeque;

use growbot_core::link::frame::{Receiver, next};
use growbot_core::link::message::{Empty, Message};

pub use self::clock::ClockDrift;
use self::clock::ClockWatch;
pub use self::emergency::{EMERGENCY_LIMIT, EMERGENCY_PAUSE};
pub use self::error::{ClientError, FEEDING};
pub use self::requests::Stopped;
use self::session::new_session;
use crate::port::Port;

/// The host's end of the link to one board.
///
/// Dropped, it says goodbye, so that the board knows that it is alone.
pub struct Client {
    port: Box<dyn Port>,
    name: String,
    receiver: Receiver,
    arrived: VecDeque<u8>,
    session: u32,
    /// Whether the board knows the session.
    open: bool,
    /// Number of the latest request.
    seq: u16,
    /// Number of the latest event.
    received: u16,
    /// Whether the board was sent the number of the latest event.
    acknowledged: bool,
    events: VecDeque<Message>,
    /// Requests that had to be sent again.
    repeated: u64,
    /// Another host that holds the board loses it.
    takes_over: bool,
    clocks: ClockWatch,
}

impl Client {
    /// A client on an open port. `name` is what errors call it.
    #[must_use]
    pub fn new(port: Box<dyn Port>, name: &str) -> Self {
        Self {
            port,
            name: name.to_string(),
            receiver: Receiver::default(),
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

    /// Takes the board from another host that holds it, when it opens its session.
    #[must_use]
    pub fn taking_over(mut self, takes_over: bool) -> Self {
        self.takes_over = takes_over;
        self
    }

    /// The port.
    pub fn port(&mut self) -> &mut dyn Port {
        self.port.as_mut()
    }

    /// Requests that had to be sent again, because they or their answers were lost.
    #[must_use]
    pub fn repeated(&self) -> u64 {
        self.repeated
    }

    /// Is gone without a goodbye, as a program that is killed.
    pub fn vanish(mut self) {
        self.open = false;
    }

    /// The same line for the emergency stop of another thread; none where the robot ends with this program. From its
    /// first use on, this client waits for the end of the program.
    pub fn emergency_line(&mut self) -> Option<Box<dyn Port + Send>> {
        self.port.emergency_line()
    }
}

impl Drop for Client {
    fn drop(&mut self) {
        if self.open {
            self.seq = next(self.seq);
            // Where it is lost, the board finds out after some seconds.
            let _ = self.post(self.seq, &Message::Goodbye(Empty {}));
        }
    }
}
