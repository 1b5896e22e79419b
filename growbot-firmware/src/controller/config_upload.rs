//! The robot description that is being received from the host, part by part.

use growbot_core::link::message::{Configure, Configured, DescriptionError, Message, Refusal};
use growbot_core::robot::{MAX_VERSIONED_LEN, Robot};
use heapless::Vec;

/// Robot description that is being received from the host, part by part.
#[derive(Default)]
pub(super) struct ConfigUpload {
    /// Hash of the robot description that is being received, as the host states it.
    pub robot: u64,
    /// Length of the complete description, as the host states it, bytes.
    length: u16,
    pub bytes: Vec<u8, MAX_VERSIONED_LEN>,
    /// Time at which the board restarts with the new description, us. `None` until the description is stored.
    pub restart_at: Option<u64>,
}

impl ConfigUpload {
    pub fn answer(&self) -> Message {
        let stored = self.is_restart_pending();
        let received = if stored { self.length } else { self.bytes.len() as u16 };
        Message::Configured(Configured { robot: self.robot, received, stored })
    }

    /// Returns whether a restart is pending. Until then the board refuses all other requests.
    pub fn is_restart_pending(&self) -> bool {
        self.restart_at.is_some()
    }

    /// Adds a part of the robot description. Returns `true` if the description is now complete.
    pub fn add(&mut self, part: &Configure) -> Result<bool, Refusal> {
        if usize::from(part.length) > MAX_VERSIONED_LEN {
            return Err(Refusal::InvalidDescription { error: DescriptionError::TooLong });
        }
        if (part.robot, part.length) != (self.robot, self.length) || part.offset == 0 {
            *self = Self { robot: part.robot, length: part.length, ..Self::default() };
        }
        let received = self.bytes.len();
        let (offset, end) = (usize::from(part.offset), usize::from(part.offset) + part.bytes.len());
        if offset > received {
            return Err(Refusal::OutOfOrder { expected: received as u32 });
        }
        if end > usize::from(part.length) || part.bytes.is_empty() {
            return Err(Refusal::UnknownRequest);
        }
        // The bytes that are already stored came with a request whose response was lost.
        let news = part.bytes.get(received - offset..).unwrap_or_default();
        self.bytes.extend_from_slice(news).map_err(|_| Refusal::UnknownRequest)?;
        Ok(self.bytes.len() == usize::from(self.length))
    }

    /// Decodes the robot from the complete description. Fails if its hash is not the hash that the host stated.
    pub fn robot(&self) -> Result<Robot, DescriptionError> {
        let robot = Robot::decode_for_board(&self.bytes)?;
        if robot.hash() == self.robot { Ok(robot) } else { Err(DescriptionError::HashMismatch { found: robot.hash() }) }
    }
}
