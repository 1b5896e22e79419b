//! Errors of requests to a board, and their messages.

use growbot_core::link::frame::FrameError;
use growbot_core::link::message::{DescriptionError, Fault, Refusal};
use growbot_core::robot::{ENCODING_VERSION, RobotError};

use super::timeouts::SILENCE_TIMEOUT;
use crate::port::PortError;

/// Error of a request to a board.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// The board has not responded, and no bytes were received.
    #[error(
        "the board at {port} has not responded for {} s: check power, cable and baud rate, and that it runs growbot \
         firmware", SILENCE_TIMEOUT.as_secs()
    )]
    NoResponse {
        /// Name of the port.
        port: String,
    },
    /// Bytes were received, but no valid frame.
    #[error(
        "received data from {port} but no valid frame: check the port, the baud rate (115200) and that the board runs \
         growbot firmware"
    )]
    Garbage {
        /// Name of the port.
        port: String,
    },
    /// The board's frames have another version of the link protocol.
    #[error("the board at {port} uses another version of the link protocol: {source}")]
    Version {
        /// Name of the port.
        port: String,
        /// Versions of the board and of this program.
        source: FrameError,
    },
    /// The board's messages have another schema than those of this program.
    #[error(
        "the board's firmware is of another release (its messages have schema {board:016x}, those of this program \
         {host:016x}): finish or cancel a body that it stores with the growbot of that release, then flash this \
         release (`growbot flash`); stop and estop work with any release"
    )]
    Schema {
        /// Schema hash of the board.
        board: u64,
        /// Schema hash of this program.
        host: u64,
    },
    /// The board stores the description of another robot.
    #[error(
        "the board's robot is {board_name} ({board:016x}), not {host_name} ({host:016x}): choose the board's robot \
         with --robot, or send the board this robot's description (`growbot configure`)"
    )]
    OtherRobot {
        /// Name of the board's robot.
        board_name: String,
        /// Hash of the description of the board's robot.
        board: u64,
        /// Name of the job's robot.
        host_name: String,
        /// Hash of the description of the job's robot.
        host: u64,
    },
    /// The board has no robot description.
    #[error(
        "the board at {port} is not configured: it has no robot description and only communicates; send it one with \
         `growbot configure`"
    )]
    NotConfigured {
        /// Name of the port.
        port: String,
    },
    /// The robot's description can be simulated, but is not valid for a board.
    #[error("this robot can be simulated, but no board can drive it: {0}")]
    Description(RobotError),
    /// The board stored a new description but did not restart with it.
    #[error(
        "the board at {port} stored the description, but did not restart with it within 10 s: reset the board, and run \
         `growbot status`"
    )]
    NotRestarted {
        /// Name of the port.
        port: String,
    },
    /// Another host owns the board.
    #[error(
        "the board at {port} is owned by {host}, last received {silent_s:.1} s ago: end that program, wait until it \
         has been silent for 10 s, or take over the board (--take-over)"
    )]
    Owned {
        /// Name of the port.
        port: String,
        /// Name of the host that owns the board.
        host: String,
        /// Time since that host was last received, s.
        silent_s: f64,
    },
    /// The board did not confirm the emergency stop.
    #[error("THE BOARD DID NOT CONFIRM THE EMERGENCY STOP at {port}: cut the robot's power now")]
    StopNotAcknowledged {
        /// Name of the port.
        port: String,
    },
    /// The board refused the request.
    #[error("the board refused {request}: {}", explain(.request, .refusal))]
    Refused {
        /// Name of the request.
        request: &'static str,
        /// Reason of the refusal.
        refusal: Refusal,
    },
    /// The request was not sent, or not sent again, because a later stop has voided its permit, or a later pause the
    /// permit to continue a growth.
    #[error("{request}: given up, because a later stop or pause has voided it: order it again, once that is confirmed")]
    Voided {
        /// Name of the request.
        request: &'static str,
    },
    /// The response of the board has a wrong kind.
    #[error(
        "the board sent an unexpected response to {request} (kind {kind:#04x}): flash the firmware of this release"
    )]
    Unexpected {
        /// Name of the request.
        request: &'static str,
        /// Message kind of the response.
        kind: u8,
    },
    /// The connection to the board is broken.
    #[error(transparent)]
    Port(#[from] PortError),
}

/// Name of the request that moves filament, for error messages.
pub const MOVE_FILAMENT: &str = "to move filament";

/// Name of the request that sends part of a robot description, for error messages.
pub const SEND_DESCRIPTION: &str = "the robot description";

/// Returns the reason why the board rejected a robot description, for an error message.
fn explain_description(why: DescriptionError) -> String {
    match why {
        DescriptionError::VersionMismatch { board } => format!(
            "it reads descriptions of version {board}, but this one has version {ENCODING_VERSION}: flash the firmware \
             of this release"
        ),
        DescriptionError::Unreadable => {
            "it received an invalid description: flash the firmware of this release".to_string()
        }
        DescriptionError::HashMismatch { found } => {
            format!("it received another description ({found:016x}): try again")
        }
        DescriptionError::TooLong => "the description is too long: shorten the name".to_string(),
        DescriptionError::Number => "a number is out of range: flash the firmware of this release".to_string(),
        DescriptionError::Name => "the name is not a valid robot name: rename the robot".to_string(),
        DescriptionError::Pins => "its pins are invalid: flash the firmware of this release".to_string(),
        DescriptionError::Drivers => "its driver settings are invalid: flash the firmware of this release".to_string(),
        DescriptionError::BoardMismatch { asked, board } => format!(
            "the description is for {asked}, but the firmware is for {board}: set board.kind, or flash the firmware \
             for {asked}"
        ),
        DescriptionError::Thermistor => "the thermistor has no equation, or two: give exactly one".to_string(),
    }
}

/// Returns the reason of a refusal, for an error message. `request` is the name of the refused request.
fn explain(request: &str, refusal: &Refusal) -> String {
    match *refusal {
        Refusal::UnknownRequest => "it does not understand the request".to_string(),
        Refusal::SchemaMismatch { board } => format!("its messages have schema {board:016x}"),
        Refusal::NoSession => "another host has taken it over, or it has restarted".to_string(),
        Refusal::RobotMismatch { board } => format!("it is another robot ({board:016x})"),
        Refusal::PlanMismatch { board: 0 } => "it stores no plan: send one first".to_string(),
        Refusal::PlanMismatch { board } => format!("it stores another plan ({board:016x})"),
        Refusal::OutOfOrder { expected } if request == SEND_DESCRIPTION => {
            format!("it expects byte {expected} of the description next: try again")
        }
        Refusal::OutOfOrder { expected } => format!("it expects layer {expected} next"),
        Refusal::LayerStoreFull => "its layer buffer is full".to_string(),
        Refusal::LayerOutOfLimits { index } => format!("layer {index} is beyond the robot's limits or the plan's end"),
        Refusal::WrongState { state } => format!("this is not allowed in state {}", state.name()),
        Refusal::FaultRemains { fault } => {
            format!("the cause of {} is still present: {}", fault.code(), fault.explanation())
        }
        Refusal::PlanningFailed => "it found no plan for these poses and this radius".to_string(),
        Refusal::PlanTooLong { layers, capacity } => {
            format!("the plan has {layers} layers, but it can store {capacity}")
        }
        Refusal::TemperatureOutOfRange { min, max } => format!(
            "the temperature must be between {} and {} C, the limits in the description that the board stores",
            f64::from(min) / 100.0,
            f64::from(max) / 100.0
        ),
        Refusal::EmergencyStop => "the emergency stop is pressed: release it first".to_string(),
        Refusal::OwnedByOtherHost { silent_ms } => format!("another host owns it, last received {silent_ms} ms ago"),
        Refusal::LayerAlreadyBegun { first } => {
            format!("those layers have been started; the first that can be replaced is {first}")
        }
        Refusal::NozzleTooHot { below } if request == SEND_DESCRIPTION => format!(
            "it writes to its flash only while the nozzle is below {} C, or after 20 minutes at rest: wait until the \
             nozzle has cooled",
            f64::from(below) / 100.0
        ),
        Refusal::NozzleTooHot { below } => format!(
            "it must free space in its journal, which it does only while the nozzle is below {} C: wait until the \
             nozzle has cooled",
            f64::from(below) / 100.0
        ),
        Refusal::JournalNotWritable => {
            "it cannot write its journal, and it does not start a job that it could not resume".to_string()
        }
        Refusal::NozzleTooCold { now, min } => format!(
            "the nozzle is at {:.1} C and must reach {} C before anything moves: preheat, and wait until it is hot",
            f64::from(now) / 100.0,
            f64::from(min) / 100.0
        ),
        Refusal::MoveTooLong { max } if request == MOVE_FILAMENT => {
            format!("it moves at most {} mm of filament per command: move less, and repeat", f64::from(max) / 1000.0)
        }
        Refusal::MoveTooLong { max } => {
            format!(
                "it turns the head by at most {} degrees per command: turn less, and repeat",
                f64::from(max) / 100.0
            )
        }
        Refusal::StillMoving => "head or feed are still moving: try again when they have stopped".to_string(),
        Refusal::NoFilament => {
            "there is no filament at its switch, or too much of it was pulled back: push it in up to the feed, then \
             `load` and `purge`"
                .to_string()
        }
        Refusal::NotConfigured => "it is not configured: it has no robot description and only communicates; send it \
                                   one with `growbot configure`"
            .to_string(),
        Refusal::JobNotDone { plan_id } => format!(
            "it has an unfinished body (plan {plan_id:016x}), which would be lost: finish the body, or discard it with \
             `growbot cancel`"
        ),
        Refusal::InvalidDescription { error: why } => {
            format!("{}; it keeps its current description", explain_description(why))
        }
        Refusal::DescriptionNotStored => {
            "it cannot write the description to its flash; it keeps its current description: try again, and if it \
             fails again replace the board"
                .to_string()
        }
        Refusal::DebugProbe => format!("it does not heat: {}", Fault::DebugProbe.explanation()),
    }
}
