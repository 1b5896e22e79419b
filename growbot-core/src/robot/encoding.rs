//! The form in which boards get and keep a robot's description: a byte of its version, then the description in postcard
//! form.

use super::{LONGEST_ENCODED, Robot, RobotError};

/// Version of the encoding. It changes whenever a field of [`super::RobotDescription`] is added, removed, moved or given
/// another meaning.
pub const ENCODING_VERSION: u8 = 2;

/// Max size of a description with its version, bytes.
pub const LONGEST_VERSIONED: usize = 1 + LONGEST_ENCODED;

impl Robot {
    /// Decodes a description with its version, and checks it as a robot file is checked, and that a board can drive the
    /// robot.
    ///
    /// # Errors
    /// [`RobotError::OtherVersion`] or [`RobotError::Unreadable`] where the bytes are no description of this version;
    /// else as [`Robot::new`] and [`Robot::check_for_board`].
    pub fn decode_for_board(bytes: &[u8]) -> Result<Self, RobotError> {
        match bytes.split_first() {
            Some((&ENCODING_VERSION, description)) => {
                let robot = Self::decode(description)?;
                robot.check_for_board()?;
                Ok(robot)
            }
            Some((&version, _)) => Err(RobotError::OtherVersion { version }),
            None => Err(RobotError::Unreadable),
        }
    }

    /// Encodes the description with its version. Equal hashes mean equal bytes.
    ///
    /// # Errors
    /// [`RobotError::TooLong`] where `buffer` (up to [`LONGEST_VERSIONED`] bytes are needed) is too short.
    pub fn encode_for_board<'a>(&self, buffer: &'a mut [u8]) -> Result<&'a [u8], RobotError> {
        let (version, description) = buffer.split_first_mut().ok_or(RobotError::TooLong)?;
        *version = ENCODING_VERSION;
        let length = 1 + self.encode(description)?.len();
        buffer.get(..length).ok_or(RobotError::TooLong)
    }
}
