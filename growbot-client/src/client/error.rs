//! Errors of requests to a board, and their messages.

use growbot_core::link::frame::FrameError;
use growbot_core::link::message::{DescriptionError, Fault, Refusal, State};
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
        "the board's firmware is of another release (the board's messages have schema {board:016x}, those of this \
         program {host:016x}): finish or cancel a body that the board stores with the growbot of that release, then \
         flash this release"
    )]
    Schema {
        /// Schema hash of the board.
        board: u64,
        /// Schema hash of this program.
        host: u64,
    },
    /// The board stores the description of another robot.
    #[error(
        "the board's robot is {board_name} ({board:016x}), not {host_name} ({host:016x}): choose the board's robot"
    )]
    OtherRobot {
        /// Name of the board's robot.
        board_name: String,
        /// Hash of the description of the board's robot.
        board: u64,
        /// Name of the robot that the host expects, for example that of the job or of `--robot`.
        host_name: String,
        /// Hash of the description of the robot that the host expects.
        host: u64,
    },
    /// The board has no robot description.
    #[error("the board at {port} is not configured: it has no robot description and moves nothing; send a description")]
    NotConfigured {
        /// Name of the port.
        port: String,
    },
    /// The robot's description can be simulated, but is not valid for a board.
    #[error("this robot can be simulated, but no board can drive it: {0}")]
    Description(RobotError),
    /// The board stored a new description but did not restart with it.
    #[error("the board at {port} did not restart with the new description within 10 s: reset the board")]
    NotRestarted {
        /// Name of the port.
        port: String,
    },
    /// Another host owns the board.
    #[error(
        "the board at {port} is owned by {host}, whose last message arrived {silent_s:.1} s ago: end that program, \
         wait until 10 s after its last message, or take over the board"
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
    #[error(
        "{request} was given up, because a stop or pause was ordered later: order it again once the stop or pause is \
         confirmed"
    )]
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
    #[error("{0}")]
    Port(#[from] PortError),
}

/// Name of the request that moves filament, for error messages.
pub const MOVE_FILAMENT: &str = "the request to move filament";

/// Name of the request that turns the head, for error messages.
pub const TURN_HEAD: &str = "the request to turn the head";

/// Name of the request that sends part of a robot description, for error messages.
pub const SEND_DESCRIPTION: &str = "the robot description";

/// Returns the reason why the board rejected a robot description, for an error message.
fn explain_description(why: DescriptionError) -> String {
    match why {
        DescriptionError::VersionMismatch { board } => format!(
            "the board reads robot descriptions of version {board}, but this description has version \
             {ENCODING_VERSION}: flash the firmware of this release"
        ),
        DescriptionError::Unreadable => {
            "the board received an invalid robot description: flash the firmware of this release".to_string()
        }
        DescriptionError::HashMismatch { found } => {
            format!(
                "the robot description that the board received has another hash ({found:016x}) than the one that was \
                 sent: send it again"
            )
        }
        DescriptionError::TooLong => "the robot description is too long for the board: shorten the robot's \
                                      name"
            .to_string(),
        DescriptionError::Number => "a number of the robot description is out of range: flash the firmware of this \
                                     release"
            .to_string(),
        DescriptionError::Name => "the name in the robot description is not a valid robot name: rename the \
                                   robot"
            .to_string(),
        DescriptionError::Pins => "the pins in the robot description are invalid: flash the firmware of this \
                                   release"
            .to_string(),
        DescriptionError::Drivers => "the driver settings in the robot description are invalid: flash the firmware of \
                                      this release"
            .to_string(),
        DescriptionError::BoardMismatch { asked, board } => format!(
            "the robot description is for board {asked}, but the firmware is for board {board}: set board.kind, or \
             flash the firmware for {asked}"
        ),
        DescriptionError::Thermistor => "the thermistor in the robot description has no equation, or two: give either \
                                         r25_ohm and beta_k, or steinhart_hart"
            .to_string(),
    }
}

/// Returns the reason of a refusal, for an error message. `request` is the name of the refused request.
fn explain(request: &str, refusal: &Refusal) -> String {
    match *refusal {
        Refusal::UnknownRequest => "the board does not know this request: flash the firmware of this \
                                    release"
            .to_string(),
        Refusal::SchemaMismatch { board } => format!(
            "the board's messages have schema {board:016x}, not that of this program: flash the firmware of this \
             release"
        ),
        Refusal::NoSession => "another host has taken the board over, or the board has restarted: connect \
                               again"
            .to_string(),
        Refusal::RobotMismatch { board } => {
            format!("the board belongs to another robot ({board:016x}): choose the board's robot")
        }
        Refusal::PlanMismatch { board: 0 } => "the board stores no plan: send a plan first".to_string(),
        Refusal::PlanMismatch { board } => {
            format!("the board stores another plan ({board:016x}): finish or cancel its body first")
        }
        Refusal::OutOfOrder { expected } if request == SEND_DESCRIPTION => {
            format!("the board expects byte {expected} of the robot description next: send the description again")
        }
        Refusal::OutOfOrder { expected } => {
            format!("the board expects layer {expected} next: continue the body from there")
        }
        Refusal::LayerStoreFull => "the board's layer buffer is full: send the next layers when the robot has laid \
                                    some"
            .to_string(),
        Refusal::LayerOutOfLimits { index } => format!(
            "layer {index} is beyond the limits of the robot that the board stores, or beyond the plan's end: plan \
             again, with a larger radius"
        ),
        Refusal::WrongState { state: State::Idle } if [MOVE_FILAMENT, TURN_HEAD].contains(&request) => {
            "motors of an idle board turn only while the nozzle is hot: preheat the nozzle first".to_owned()
        }
        Refusal::WrongState { state } => format!("this is not allowed in state {} of the board", state.name()),
        Refusal::FaultRemains { fault } => {
            format!("the cause of {} is still present: {}", fault.code(), fault.explanation())
        }
        Refusal::PlanningFailed => "the board found no plan for these poses and this radius: choose another goal or \
                                    radius"
            .to_string(),
        Refusal::PlanTooLong { layers, capacity } => {
            format!("the plan has {layers} layers, but the board can store at most {capacity}: choose a nearer goal")
        }
        Refusal::TemperatureOutOfRange { min, max } => format!(
            "the temperature must be between {} and {} C (the board's heater.max_c limits it; in a pause it must be \
             heater.target_c): give such a temperature",
            f64::from(min) / 100.0,
            f64::from(max) / 100.0
        ),
        Refusal::EmergencyStop => "the emergency stop is pressed: release it first".to_string(),
        Refusal::OwnedByOtherHost { silent_ms } => format!(
            "another host owns the board, and its last message arrived {silent_ms} ms ago: end that program, or take \
             over the board"
        ),
        Refusal::LayerAlreadyBegun { first } => {
            format!("the robot has already started some of these layers: replace layers from layer {first} on")
        }
        Refusal::NozzleTooHot { below } if request == SEND_DESCRIPTION => format!(
            "the board writes to its flash only while the nozzle is below {} C, or after 20 minutes at rest: wait \
             until the nozzle has cooled",
            f64::from(below) / 100.0
        ),
        Refusal::NozzleTooHot { below } => format!(
            "the board must free space in its journal, which is possible only while the nozzle is below {} C: wait \
             until the nozzle has cooled",
            f64::from(below) / 100.0
        ),
        Refusal::JournalNotWritable => {
            "the board cannot write its journal, and does not start a job that could not be resumed after a reset: \
             flash the board again, and replace the board if the error returns"
                .to_string()
        }
        Refusal::NozzleTooCold { now, min } => format!(
            "the nozzle is at {:.1} C and must reach {} C before anything moves: preheat, and wait until the \
             temperature is steady",
            f64::from(now) / 100.0,
            f64::from(min) / 100.0
        ),
        Refusal::MoveTooLong { max } if request == MOVE_FILAMENT => {
            format!(
                "the board moves at most {} mm of filament per command: give a shorter length, and repeat the command",
                f64::from(max) / 1000.0
            )
        }
        Refusal::MoveTooLong { max } => {
            format!(
                "the board turns the head by at most {} degrees per command: give a smaller angle, and repeat the \
                 command",
                f64::from(max) / 100.0
            )
        }
        Refusal::StillMoving => "the head or the feed is still moving: try again when both have stopped".to_string(),
        Refusal::NoFilament => {
            "the filament switch detects no filament, or too much filament was pulled back: push filament in up to the \
             feed, then `load` and `purge`"
                .to_string()
        }
        Refusal::NotConfigured => "the board is not configured: it has no robot description and moves nothing; send a \
                                   description"
            .to_string(),
        Refusal::JobNotDone { plan_id } => format!(
            "the board has an unfinished body (plan {plan_id:016x}), which would be lost: finish the body, or discard \
             it"
        ),
        Refusal::InvalidDescription { error: why } => {
            format!("{}; the board keeps its current description", explain_description(why))
        }
        Refusal::DescriptionNotStored => {
            "the board cannot write the robot description to its flash and keeps its current description: try again, \
             and replace the board if the error returns"
                .to_string()
        }
        Refusal::DebugProbe => format!("the board does not heat: {}", Fault::DebugProbe.explanation()),
    }
}
