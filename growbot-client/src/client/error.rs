//! Errors of requests to a board, and their messages.

use growbot_core::link::frame::FrameError;
use growbot_core::link::message::{DescriptionError, Fault, Refusal};
use growbot_core::robot::{ENCODING_VERSION, RobotError};

use super::timeouts::SILENCE_TIMEOUT;
use crate::port::PortError;

/// Error of a request.
#[derive(Debug, thiserror::Error)]
pub enum ClientError {
    /// No byte was received.
    #[error(
        "the board at {port} does not answer (for {} s): check power, cable and baud rate, and that growbot's \
         firmware is on it", SILENCE_TIMEOUT.as_secs()
    )]
    NoResponse {
        /// The port.
        port: String,
    },
    /// Bytes were received, but no frame.
    #[error(
        "what the board at {port} sends is no growbot frame: check the port, the baud rate (115200) and that \
         growbot's firmware is on it"
    )]
    Garbage {
        /// The port.
        port: String,
    },
    /// The frames have another version.
    #[error("the board at {port} speaks another version of the link: {source}")]
    Version {
        /// The port.
        port: String,
        /// Versions of the board and of this program.
        source: FrameError,
    },
    /// The messages have another schema.
    #[error(
        "the board's messages (schema {board:016x}) differ from mine ({host:016x}): flash the firmware of this \
         release (`cargo run-stm32f405`), or use the growbot that belongs to the board's"
    )]
    Schema {
        /// Schema hash of the board.
        board: u64,
        /// Schema hash of this program.
        host: u64,
    },
    /// The board belongs to another robot.
    #[error(
        "the board is {board_name} ({board:016x}), and not {host_name} ({host:016x}): choose the board's robot with \
         --robot, or send the board the description of this one (`growbot configure`)"
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
        "the board at {port} is not configured: it has no robot description, and only communicates: send it one with \
         `growbot configure`"
    )]
    NotConfigured {
        /// The port.
        port: String,
    },
    /// The robot description is not valid for a board.
    #[error("this robot can be simulated, but no board can drive it: {0}")]
    Description(RobotError),
    /// The board accepted a description but did not restart with it.
    #[error(
        "the board at {port} has taken the description, but has not restarted with it within 10 s: reset it, and see \
         what `growbot status` says"
    )]
    NotRestarted {
        /// The port.
        port: String,
    },
    /// Another host owns the board.
    #[error(
        "the board at {port} is owned by {host}, last received {silent_s:.1} s ago: end that program, wait until it has been \
         silent for 10 s, or take the board over (--take-over)"
    )]
    Owned {
        /// The port.
        port: String,
        /// Name of the host that owns the board.
        host: String,
        /// Time since that host was last received, s.
        silent_s: f64,
    },
    /// The board did not confirm the emergency stop.
    #[error("NOBODY HAS ACKNOWLEDGED THE EMERGENCY STOP at {port}: cut the power of the robot now")]
    StopNotAcknowledged {
        /// The port.
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
    /// The board sent an unexpected response.
    #[error("the board answered {request} with something else (kind {kind:#04x}): flash the firmware of this release")]
    Unexpected {
        /// Name of the request.
        request: &'static str,
        /// Kind of the response.
        kind: u8,
    },
    /// The line is broken.
    #[error(transparent)]
    Port(#[from] PortError),
}

/// Name of a request that moves filament.
pub const MOVE_FILAMENT: &str = "to move filament";

/// Name of a request that sends part of a robot description.
pub const SEND_DESCRIPTION: &str = "the robot description";

/// Returns a message for a rejected description.
fn explain_description(why: DescriptionError) -> String {
    match why {
        DescriptionError::VersionMismatch { board } => format!(
            "it reads descriptions of version {board}, and this one has version {ENCODING_VERSION}: flash the firmware \
             of this release"
        ),
        DescriptionError::Unreadable => {
            "what arrived is no description: flash the firmware of this release".to_string()
        }
        DescriptionError::HashMismatch { found } => {
            format!("what arrived is another description ({found:016x}): try again")
        }
        DescriptionError::TooLong => "the description is too long: shorten the name".to_string(),
        DescriptionError::Number => "a number is out of its range: flash the firmware of this release".to_string(),
        DescriptionError::Name => "the name is not one that a robot may have: rename the robot".to_string(),
        DescriptionError::Pins => "its pins do not suit: flash the firmware of this release".to_string(),
        DescriptionError::Drivers => {
            "its drivers' settings do not suit: flash the firmware of this release".to_string()
        }
        DescriptionError::BoardMismatch { asked, board } => format!(
            "the description is for {asked}, and the firmware is for {board}: set board.kind, or flash the firmware \
             for {asked}"
        ),
        DescriptionError::Thermistor => "the thermistor has no equation, or two: give one".to_string(),
    }
}

/// Returns a message for a refusal.
fn explain(request: &str, refusal: &Refusal) -> String {
    match *refusal {
        Refusal::UnknownRequest => "it does not understand the request".to_string(),
        Refusal::SchemaMismatch { board } => format!("its messages have schema {board:016x}"),
        Refusal::NoSession => "another host has taken over, or the board has restarted".to_string(),
        Refusal::RobotMismatch { board } => format!("it is another robot ({board:016x})"),
        Refusal::PlanMismatch { board: 0 } => "it stores no plan: hand one over first".to_string(),
        Refusal::PlanMismatch { board } => format!("it stores another plan ({board:016x})"),
        Refusal::OutOfOrder { expected } if request == SEND_DESCRIPTION => {
            format!("it expects byte {expected} of the description next: try again")
        }
        Refusal::OutOfOrder { expected } => format!("it expects layer {expected} next"),
        Refusal::LayerStoreFull => "it has no room for more layers now".to_string(),
        Refusal::LayerOutOfLimits { index } => format!("layer {index} is beyond the robot's limits or the plan's end"),
        Refusal::WrongState { state } => format!("not while it is in state {}", state.name()),
        Refusal::FaultRemains { fault } => format!("{} is still there: {}", fault.code(), fault.explanation()),
        Refusal::PlanningFailed => "there is no plan for these poses and this radius".to_string(),
        Refusal::PlanTooLong { layers, capacity } => {
            format!("the plan has {layers} layers, it can take {capacity}")
        }
        Refusal::TemperatureOutOfRange { min, max } => format!(
            "the temperature must lie between {} and {} C, the limits of its description",
            f64::from(min) / 100.0,
            f64::from(max) / 100.0
        ),
        Refusal::EmergencyStop => "the emergency stop is pressed: release it first".to_string(),
        Refusal::OwnedByOtherHost { silent_ms } => format!("another host owns it, last received {silent_ms} ms ago"),
        Refusal::LayerAlreadyBegun { first } => {
            format!("those layers have been begun; the first that can be replaced is {first}")
        }
        Refusal::NozzleTooHot { below } if request == SEND_DESCRIPTION => format!(
            "it writes to its flash only with the nozzle below {} C, or after 20 minutes at rest: wait until it has \
             cooled",
            f64::from(below) / 100.0
        ),
        Refusal::NozzleTooHot { below } => format!(
            "it must make room in its journal, which it does only with the nozzle below {} C: wait until it has cooled",
            f64::from(below) / 100.0
        ),
        Refusal::JournalNotWritable => {
            "its journal cannot be written, and it must not begin what it could not resume".to_string()
        }
        Refusal::NozzleTooCold { now, min } => format!(
            "the nozzle is at {:.1} C and must have {} C before anything moves: preheat, and wait until it is hot",
            f64::from(now) / 100.0,
            f64::from(min) / 100.0
        ),
        Refusal::MoveTooLong { max } if request == MOVE_FILAMENT => {
            format!("it moves {} mm of filament at a time at most: ask for less, and again", f64::from(max) / 1000.0)
        }
        Refusal::MoveTooLong { max } => {
            format!(
                "it turns the head by {} degrees at a time at most: ask for less, and again",
                f64::from(max) / 100.0
            )
        }
        Refusal::StillMoving => "head or feed still move: ask again once they stand".to_string(),
        Refusal::NoFilament => {
            "there is no filament at its switch, or too much of it was pulled back: push it in up to the feed, `load` \
             and `purge`"
                .to_string()
        }
        Refusal::NotConfigured => "it is not configured: it has no robot description, and only communicates: send it \
                                   one with `growbot configure`"
            .to_string(),
        Refusal::JobNotDone { plan_id } => format!(
            "it has a body that is not done (plan {plan_id:016x}), which would be lost: grow it to its end, or give \
             it up with `growbot cancel`"
        ),
        Refusal::InvalidDescription { error: why } => {
            format!("{}; it keeps the one that it has", explain_description(why))
        }
        Refusal::DescriptionNotStored => {
            "its flash does not take the description; it keeps the one that it has: try again, and if it fails again \
             replace the board"
                .to_string()
        }
        Refusal::DebugProbe => format!("it does not heat: {}", Fault::DebugProbe.explanation()),
    }
}
