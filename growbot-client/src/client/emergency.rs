//! The emergency stop: eight bytes, sent again until the board says that it has obeyed, or the time is over.

use std::thread::sleep;
use std::time::Duration;

use growbot_core::link::frame::Frame;
use growbot_core::link::message::{Message, State};

use super::{Client, ClientError};
use crate::port::PortError;

/// For so long an emergency stop is tried,
pub const EMERGENCY_LIMIT: Duration = Duration::from_secs(3);
/// and so long after each other the bytes are sent, whatever comes back.
pub const EMERGENCY_PAUSE: Duration = Duration::from_millis(150);
/// A line that breaks while it is used, and on which time does not pass by itself, is given up after this many tries.
const MAX_BREAKS: u32 = 20;

impl Client {
    /// Has the board switch everything off at once, whatever it is doing and whichever host owns it, and waits until it
    /// says so: for [`EMERGENCY_LIMIT`] on the port's clock, however much noise comes, and also over a line that
    /// breaks, which may come back.
    ///
    /// # Errors
    /// [`ClientError::NotStopped`]: then the power must be cut.
    pub fn emergency_stop(&mut self) -> Result<(), ClientError> {
        let mut sent = 0;
        let began = self.port.now();
        for _ in 0..MAX_BREAKS {
            let left = EMERGENCY_LIMIT.saturating_sub(self.port.now().saturating_sub(began));
            if left.is_zero() {
                break;
            }
            match self.emergency_stop_within(left, &mut sent) {
                Ok(true) => return Ok(()),
                Ok(false) => break,
                Err(_) => sleep(EMERGENCY_PAUSE.min(left)),
            }
        }
        Err(ClientError::NotStopped { port: self.name.clone() })
    }

    /// The same for so long. Whether the board has obeyed; the stops are added to those `sent`.
    ///
    /// # Errors
    /// The line is broken.
    pub fn emergency_stop_within(&mut self, limit: Duration, sent: &mut u32) -> Result<bool, PortError> {
        let began = self.port.now();
        loop {
            // One that does not go out is followed by others.
            let _ = self.port.send_emergency_stop();
            *sent += 1;
            let sent_at = self.port.now();
            loop {
                let waited = self.port.now().saturating_sub(sent_at);
                if waited >= EMERGENCY_PAUSE {
                    break;
                }
                // Nothing else is sent in that time: a line that takes nothing must not hold the next stop up.
                self.acknowledged = true;
                match self.next_frame(EMERGENCY_PAUSE - waited) {
                    Ok(Some(Ok(frame))) if says_stopped(&frame) => {
                        self.ingest_event(&frame);
                        return Ok(true);
                    }
                    Ok(Some(Ok(frame))) => self.ingest_event(&frame),
                    Ok(Some(Err(_))) => {}
                    Ok(None) => break,
                    Err(ClientError::Port(error)) => return Err(error),
                    Err(_) => break,
                }
            }
            if self.port.now().saturating_sub(began) >= limit {
                return Ok(false);
            }
        }
    }
}

/// Whether a board says in this frame, to any host, that it has stopped at once. Where another program reads the same
/// line, the event that was meant for that one may be all that arrives here.
fn says_stopped(frame: &Frame) -> bool {
    let state = match Message::decode(frame.header.kind, &frame.body) {
        Ok(Message::StoppedAtOnce(_)) => return true,
        Ok(Message::StateChanged(change)) => change.state,
        Ok(Message::Status(status)) => status.state,
        Ok(Message::BoardHello(hello)) => hello.status.state,
        _ => return false,
    };
    state == State::EmergencyStop
}
