//! Transfer of robot descriptions to a board.

use std::time::Duration;

use growbot_core::link::message::{
    BoardInfo, Configure, Configured, MAX_DESCRIPTION_PART, Message, PassiveRequest, Refusal,
};
use growbot_core::robot::{MAX_VERSIONED_LEN, Robot};

use super::error::SEND_DESCRIPTION;
use super::{Client, ClientError};

/// Maximum number of polls for the restart of a board, which occurs about 0.5 s after the description is stored.
const LOOKS_AT_RESTART: u32 = 40;
/// Time between two polls for the restart of a board.
const LOOK_AT_RESTART: Duration = Duration::from_millis(250);

impl Client {
    /// Sends a robot description to the board and waits until the board has restarted with it. The session must be
    /// open, and a new session is open afterwards.
    ///
    /// # Errors
    /// [`ClientError::Description`], [`ClientError::NotRestarted`], or like [`Client::request`].
    pub fn configure(&mut self, robot: &Robot) -> Result<BoardInfo, ClientError> {
        let before = self.identify()?.boot_id;
        let mut buffer = [0; MAX_VERSIONED_LEN];
        robot.check_for_board().map_err(ClientError::Description)?;
        let description = robot.encode_for_board(&mut buffer).map_err(ClientError::Description)?;
        let mut stored = false;
        let last = description.len().div_ceil(MAX_DESCRIPTION_PART).saturating_sub(1);
        for (index, bytes) in description.chunks(MAX_DESCRIPTION_PART).enumerate() {
            let part = Configure {
                robot: robot.hash(),
                length: description.len() as u16,
                offset: (index * MAX_DESCRIPTION_PART) as u16,
                bytes: bytes.iter().copied().collect(),
            };
            stored = match self.request(SEND_DESCRIPTION, &PassiveRequest::Configure(part)) {
                Ok(Message::Configured(Configured { stored, .. })) => stored,
                Ok(other) => return Err(ClientError::Unexpected { request: SEND_DESCRIPTION, kind: other.kind() }),
                // After the last part, the board may have restarted already, and its response may be lost. Before the
                // last part, this refusal means that another host has taken the board.
                Err(ClientError::Refused { refusal: Refusal::NoSession, .. }) if index == last => true,
                Err(error) => return Err(error),
            };
        }
        if stored { self.await_restart(robot, before) } else { Err(self.not_restarted()) }
    }

    /// Waits until the board has restarted with the description of this robot, and opens a session. `before` is the
    /// boot number before the restart.
    fn await_restart(&mut self, robot: &Robot, before: u32) -> Result<BoardInfo, ClientError> {
        for _ in 0..LOOKS_AT_RESTART {
            self.wait(LOOK_AT_RESTART)?;
            let now = self.identify()?;
            if now.boot_id != before && now.robot_hash == robot.hash() {
                return self.open_session();
            }
        }
        Err(self.not_restarted())
    }

    fn not_restarted(&self) -> ClientError {
        ClientError::NotRestarted { port: self.name.clone() }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use growbot_core::link::frame::{self, FrameDecoder, FrameHeader, LinkFrame};
    use growbot_core::link::message::{PauseCause, RefusalResponse, ResetCause, SCHEMA_HASH, State, Status};
    use growbot_plan::robot_file;

    use super::*;
    use crate::port::{Port, PortError};

    /// A board that another host takes after `part` parts of a description.
    struct TakenAt {
        part: u16,
        receiver: FrameDecoder,
        answers: VecDeque<u8>,
    }

    impl TakenAt {
        fn answer(&self, frame: &LinkFrame) -> Message {
            match Message::decode(frame.header.kind, &frame.body).unwrap() {
                Message::GetBoardInfo(_) => Message::BoardInfo(board()),
                Message::Configure(part)
                    if usize::from(part.offset) < usize::from(self.part) * MAX_DESCRIPTION_PART =>
                {
                    let received = part.offset + part.bytes.len() as u16;
                    Message::Configured(Configured { robot: part.robot, received, stored: false })
                }
                other => Message::Refused(RefusalResponse { kind: other.kind(), refusal: Refusal::NoSession }),
            }
        }
    }

    impl Port for TakenAt {
        fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
            for byte in bytes {
                let Some(frame) = self.receiver.push(*byte) else { continue };
                let frame = frame.unwrap();
                let answer = self.answer(&frame);
                let mut buffer = [0; frame::MAX_BODY_LEN];
                let header = FrameHeader { kind: answer.kind(), seq: 0, ack: frame.header.seq, ..frame.header };
                self.answers.extend(frame::encode(&header, answer.encode(&mut buffer).unwrap()).unwrap());
            }
            Ok(())
        }

        fn receive(&mut self, buffer: &mut [u8], _timeout: Duration) -> Result<usize, PortError> {
            let count = buffer.len().min(self.answers.len());
            buffer.iter_mut().zip(self.answers.drain(..count)).for_each(|(slot, byte)| *slot = byte);
            Ok(count)
        }
    }

    fn board() -> BoardInfo {
        let status = Status {
            state: State::Idle,
            fault: None,
            temperature_centi_c: None,
            target_centi_c: None,
            duty: 0,
            plan_id: 0,
            layer_count: 0,
            next_layer: 0,
            layers_laid: 0,
            interrupted: None,
            pause_cause: PauseCause::default(),
            is_resumable: false,
            uptime_ms: 0,
        };
        BoardInfo {
            schema_hash: SCHEMA_HASH,
            boot_id: 1,
            reset_cause: ResetCause::PowerOn,
            firmware: [0; 3],
            robot_name: Default::default(),
            robot_hash: 0,
            layer_capacity: 0,
            status,
            owner: None,
        }
    }

    #[test]
    fn only_the_last_response_may_be_lost_in_the_restart() {
        let robot = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap();
        let mut buffer = [0; MAX_VERSIONED_LEN];
        let parts = robot.encode_for_board(&mut buffer).unwrap().len().div_ceil(MAX_DESCRIPTION_PART) as u16;
        assert!(parts > 2, "{parts}");
        for part in 0..parts {
            let port = TakenAt { part, receiver: FrameDecoder::default(), answers: VecDeque::new() };
            let error = Client::new(Box::new(port), "taken").configure(&robot).unwrap_err();
            let is_refused = matches!(error, ClientError::Refused { refusal: Refusal::NoSession, .. });
            let may_have_restarted = matches!(error, ClientError::NotRestarted { .. });
            assert_eq!((is_refused, may_have_restarted), (part + 1 < parts, part + 1 == parts), "{part}: {error}");
        }
    }
}
