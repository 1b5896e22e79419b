//! The emergency stop: eight bytes, repeated until the board confirms it or the time is over.

use std::thread::sleep;
use std::time::Duration;

use growbot_core::link::frame::LinkFrame;
use growbot_core::link::message::{Message, State};

use super::exchange::record_command;
use super::{Client, ClientError};
use crate::port::PortError;

/// Time limit of an emergency stop.
pub const EMERGENCY_LIMIT: Duration = Duration::from_secs(3);
/// Interval at which the bytes of an emergency stop are sent, whatever the board sends.
pub const EMERGENCY_PAUSE: Duration = Duration::from_millis(150);
/// Maximum number of attempts if the line breaks on each use and its virtual clock does not advance by itself.
const MAX_BREAKS: u32 = 20;

impl Client {
    /// Commands the board to switch everything off at once, whatever it is doing and whichever host owns it. Waits up
    /// to [`EMERGENCY_LIMIT`] on the port's clock for its confirmation, whatever noise arrives. It also retries on a
    /// line that breaks, because the line may come back.
    ///
    /// # Errors
    /// [`ClientError::StopNotAcknowledged`] if the board did not confirm it. The power must then be cut.
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
        Err(ClientError::StopNotAcknowledged { port: self.name.clone() })
    }

    /// Like [`Client::emergency_stop`], but with this time limit and without retries on a broken line. Returns true if
    /// the board has confirmed. Adds the number of stops sent to `sent`.
    ///
    /// # Errors
    /// If the line is broken.
    pub fn emergency_stop_within(&mut self, limit: Duration, sent: &mut u32) -> Result<bool, PortError> {
        let began = self.port.now();
        loop {
            // If one cannot be sent, the next may be.
            record_command();
            let _ = self.port.send_emergency_stop();
            *sent += 1;
            let sent_at = self.port.now();
            loop {
                let waited = self.port.now().saturating_sub(sent_at);
                if waited >= EMERGENCY_PAUSE {
                    break;
                }
                // Nothing else is sent in that time, because a line that accepts nothing must not delay the next stop.
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

/// Reports whether a board confirms in this frame, to any host, that it has stopped at once. If another program reads
/// the same line, this program may receive only the event that confirms the stop to the other one.
fn says_stopped(frame: &LinkFrame) -> bool {
    let state = match Message::decode(frame.header.kind, &frame.body) {
        Ok(Message::EmergencyStopAck(_)) => return true,
        Ok(Message::StateChanged(change)) => change.state,
        Ok(Message::Status(status)) => status.state,
        Ok(Message::BoardInfo(hello)) => hello.status.state,
        _ => return false,
    };
    state == State::EmergencyStop
}
