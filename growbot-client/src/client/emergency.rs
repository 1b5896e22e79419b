//! The emergency stop: eight bytes, which are sent repeatedly until the board confirms the stop or a time limit is
//! over.

use std::thread::sleep;
use std::time::Duration;

use growbot_core::link::frame::LinkFrame;
use growbot_core::link::message::{Message, State};

use super::exchange::record_command;
use super::{Client, ClientError};
use crate::port::PortError;

/// Maximum time for which an emergency stop is sent without confirmation.
pub const EMERGENCY_LIMIT: Duration = Duration::from_secs(3);
/// Interval at which the bytes of an emergency stop are sent again, even if other data arrives.
pub const EMERGENCY_PAUSE: Duration = Duration::from_millis(150);
/// Maximum number of attempts on a broken connection. It limits the attempts on a virtual clock, which does not advance
/// by itself.
const MAX_BREAKS: u32 = 20;

impl Client {
    /// Commands the board to switch heater and steppers off at once, in any state and whichever host owns it. Sends the
    /// stop repeatedly for up to [`EMERGENCY_LIMIT`] on the port's clock, until the board confirms it. It is also
    /// retried on a broken connection, which may recover.
    ///
    /// # Errors
    /// [`ClientError::StopNotAcknowledged`] if the board did not confirm the stop. The robot's power must then be cut.
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

    /// Like [`Client::emergency_stop`], but with this time limit and without retries on a broken connection. Returns
    /// true if the board has confirmed the stop. Adds the number of transmissions to `sent`.
    ///
    /// # Errors
    /// If the connection is broken.
    pub fn emergency_stop_within(&mut self, limit: Duration, sent: &mut u32) -> Result<bool, PortError> {
        let began = self.port.now();
        loop {
            // If this transmission fails, the next may succeed.
            record_command();
            let _ = self.port.send_emergency_stop();
            *sent += 1;
            let sent_at = self.port.now();
            loop {
                let waited = self.port.now().saturating_sub(sent_at);
                if waited >= EMERGENCY_PAUSE {
                    break;
                }
                // No acknowledgement is sent meanwhile, because a line that accepts no bytes must not delay the next
                // stop.
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

/// Reports whether this frame shows that the board has executed an emergency stop, even if the frame is for another
/// host. If another program reads the same line, this program may receive only a frame for that program.
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
