//! The errors of a robot description that is not valid.

use super::description::ENCODING_VERSION;
use super::pins::PinError;
use crate::compact_number::CompactNumber;

/// Reason why the settings of a stepper driver are not valid, with the field, its value, and the remedy.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum DriverError {
    /// Settings are given for a driver of a board that has no configurable drivers.
    #[error(
        "{field} is set, but only skr-pico has configurable drivers: set board.kind to skr-pico, or remove {field}"
    )]
    NotSupported {
        /// Name of the table in a robot file.
        field: &'static str,
    },
    /// The board has drivers that need settings, but none are given.
    #[error(
        "the table [{field}] is missing, but the drivers of skr-pico need it: add it with the motor's current, for \
         example `current_a = 0.6`"
    )]
    Missing {
        /// Name of the table in a robot file.
        field: &'static str,
    },
    /// The driver does not support this number of microsteps.
    #[error("{field} is {value}, but a TMC2209 divides a full step by 1, 2, 4, 8, 16, 32, 64, 128 or 256")]
    Microsteps {
        /// Name of the field in a robot file.
        field: &'static str,
        /// Value of the field.
        value: u16,
    },
    /// A stall threshold is given for a mode in which the driver cannot detect stalls.
    #[error(
        "{field} is set, but a TMC2209 detects stalls only in StealthChop: remove {field}, or set mode = \
         \"stealthchop\""
    )]
    StallMode {
        /// Name of the field in a robot file.
        field: &'static str,
    },
}

/// Reason why a robot description is not valid, with the field, its value, the limit, and the remedy.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum RobotError {
    /// A number is NaN or infinite.
    #[error("{field} is {}: give a finite number", CompactNumber(.value))]
    NotFinite {
        /// Name of the field in a robot file.
        field: &'static str,
        /// Value of the field.
        value: f64,
    },
    /// A number is too small.
    #[error("{field} is {}, below {}: {advice}", CompactNumber(.value), CompactNumber(.limit))]
    TooSmall {
        /// Name of the field in a robot file.
        field: &'static str,
        /// Value of the field.
        value: f64,
        /// Min value that is accepted.
        limit: f64,
        /// Reason for the limit, and the remedy.
        advice: &'static str,
    },
    /// A number is too large.
    #[error("{field} is {}, above {}: {advice}", CompactNumber(.value), CompactNumber(.limit))]
    TooLarge {
        /// Name of the field in a robot file.
        field: &'static str,
        /// Value of the field.
        value: f64,
        /// Max value that is accepted.
        limit: f64,
        /// Reason for the limit, and the remedy.
        advice: &'static str,
    },
    /// The robot's name is empty, or has a character that is not safe in a file name or a command.
    #[error("name may contain only lower-case letters, digits and hyphens, and must not be empty: rename the robot")]
    Name,
    /// The description gives no equation for the thermistor, or two equations.
    #[error(
        "[thermistor] needs either r25_ohm and beta_k, or steinhart_hart, and not both: set the values that the \
         thermistor's data sheet gives"
    )]
    ThermistorEquation,
    /// The board's pins are not valid.
    #[error(transparent)]
    Pins(PinError),
    /// The stepper drivers' settings are not valid.
    #[error(transparent)]
    Drivers(DriverError),
    /// The description is too long to encode.
    #[error("the robot description does not fit into its 768 bytes: shorten the robot's name")]
    TooLong,
    /// The description is encoded in another version than the one that this release reads.
    #[error(
        "the robot description has encoding version {version}, but this release reads version {ENCODING_VERSION}: use \
         the firmware and the growbot program of the same release"
    )]
    VersionMismatch {
        /// Version of the encoding of the description.
        version: u8,
    },
    /// The bytes are not a robot description in this version of the encoding.
    #[error(
        "the bytes are not a robot description of this version: use the firmware and the growbot program of the same \
         release"
    )]
    Unreadable,
}
