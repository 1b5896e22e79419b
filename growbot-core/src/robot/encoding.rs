//! The form in which boards receive and store a robot's description: a byte with its version, then the description in
//! postcard form.

use super::{ENCODING_VERSION, MAX_ENCODED_LEN, Robot, RobotError};

/// Max size of an encoded description, including the byte with its version, bytes.
pub const MAX_VERSIONED_LEN: usize = 1 + MAX_ENCODED_LEN;

impl Robot {
    /// Decodes a byte with the version and the description after it. Checks the description as [`Robot::new`] does, and
    /// that a board can drive the robot.
    ///
    /// # Errors
    /// Returns [`RobotError::VersionMismatch`] or [`RobotError::Unreadable`] if the bytes are not a description of this
    /// version. Otherwise returns the errors of [`Robot::new`] and [`Robot::check_for_board`].
    pub fn decode_for_board(bytes: &[u8]) -> Result<Self, RobotError> {
        match bytes.split_first() {
            Some((&ENCODING_VERSION, description)) => {
                let robot = Self::decode(description)?;
                robot.check_for_board()?;
                Ok(robot)
            }
            Some((&version, _)) => Err(RobotError::VersionMismatch { version }),
            None => Err(RobotError::Unreadable),
        }
    }

    /// Encodes the description, with a byte before it that holds the version of the encoding. Robots with equal
    /// [`Robot::hash`] give equal bytes.
    ///
    /// # Errors
    /// Returns [`RobotError::TooLong`] if `buffer` is too short. Up to [`MAX_VERSIONED_LEN`] bytes are needed.
    pub fn encode_for_board<'a>(&self, buffer: &'a mut [u8]) -> Result<&'a [u8], RobotError> {
        let (version, description) = buffer.split_first_mut().ok_or(RobotError::TooLong)?;
        *version = ENCODING_VERSION;
        let length = 1 + self.encode(description)?.len();
        buffer.get(..length).ok_or(RobotError::TooLong)
    }
}
