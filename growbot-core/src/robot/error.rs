//! The error of a robot description that is refused.

use super::ENCODING_VERSION;
use super::drivers::DriverError;
use super::pins::PinError;
use crate::number::Short;

/// Why a robot description was refused: the field, its value, the limit, and what to do.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RobotError {
    /// A number is NaN or infinite.
    #[error("{field} is {}: give a finite number", Short(.value))]
    NotFinite {
        /// The field, as written in a robot file.
        field: &'static str,
        /// The field's value.
        value: f64,
    },
    /// A number is too small.
    #[error("{field} is {}, below {}: {advice}", Short(.value), Short(.limit))]
    TooSmall {
        /// The field, as written in a robot file.
        field: &'static str,
        /// The field's value.
        value: f64,
        /// Min value that is accepted.
        limit: f64,
        /// Where the limit comes from and what to do.
        advice: &'static str,
    },
    /// A number is too large.
    #[error("{field} is {}, above {}: {advice}", Short(.value), Short(.limit))]
    TooLarge {
        /// The field, as written in a robot file.
        field: &'static str,
        /// The field's value.
        value: f64,
        /// Max value that is accepted.
        limit: f64,
        /// Where the limit comes from and what to do.
        advice: &'static str,
    },
    /// The name has a character that would not survive in a file name or a command.
    #[error("name may have lower-case letters, digits and hyphens only, and not be empty: rename the robot")]
    Name,
    /// The thermistor has no equation, or two.
    #[error(
        "thermistor needs r25_ohm and beta_k, or steinhart_hart, and not both: its data sheet gives one or the other"
    )]
    ThermistorEquation,
    /// The board's pins.
    #[error(transparent)]
    Pins(PinError),
    /// The stepper drivers' settings.
    #[error(transparent)]
    Drivers(DriverError),
    /// The description is too long to encode.
    #[error("the description does not fit its 768 bytes: shorten the name")]
    TooLong,
    /// The description is encoded in another version than this one.
    #[error(
        "the description has version {version} of its encoding, this release reads {ENCODING_VERSION}: use firmware \
         and desktop of the same release"
    )]
    OtherVersion {
        /// Its version.
        version: u8,
    },
    /// The bytes are no description of this version.
    #[error(
        "the bytes are no robot description of this version: build the firmware and the desktop from the same source"
    )]
    Unreadable,
}
