//! The messages of the link, and the table of their kinds.
//!
//! A message is its kind (in the frame's header) and its body in postcard form. Both sides compare [`SCHEMA_HASH`], taken over
//! every kind and every type below, before anything else: a board and a host that would misread each other say so. The bodies of
//! `Hello`, `Status` and `Refused` stay as they are for as long as [`super::frame::VERSION`] does, so that a board can always be asked
//! who it is.

use heapless::{String, Vec};
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::frame::LONGEST_BODY;
pub use super::state::{Fault, ResetCause, State};
use crate::layer_bytes::LayerBytes;
use crate::plan::Planner;
use crate::pose::{Pose, PoseError};

/// The most layers in one `Layers` or `HeldLayers`.
pub const MOST_LAYERS: usize = 16;
/// Layers in a batch.
pub type LayerBatch = Vec<LayerBytes, MOST_LAYERS>;

/// Why a request was refused. The board did nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum Refusal {
    /// The message is of no known kind or does not decode.
    NotUnderstood,
    /// The host's messages differ from the board's.
    OtherSchema {
        /// The board's [`SCHEMA_HASH`].
        board: u64,
    },
    /// The host has not said `Hello` in this session.
    NoSession,
    /// The job is for another robot.
    OtherRobot {
        /// Hash of the board's robot.
        board: u64,
    },
    /// The board holds another plan.
    OtherPlan {
        /// The plan that it holds, 0 for none.
        board: u64,
    },
    /// The layers do not follow on those held.
    OutOfOrder {
        /// The index expected.
        expected: u32,
    },
    /// No room for more layers now.
    Full,
    /// A layer breaks a limit of the robot, or lies beyond the job's end.
    BadLayer {
        /// Its index.
        index: u32,
    },
    /// Not in this state.
    WrongState {
        /// The state that the board is in.
        state: State,
    },
    /// The cause of the fault is still there.
    FaultRemains {
        /// The fault.
        fault: Fault,
    },
    /// There is no plan for these poses and this radius: not finite, out of range, or below the least radius.
    NoPlan,
    /// The plan has more layers than the board holds.
    PlanTooLong {
        /// Layers of the plan.
        layers: u32,
        /// Layers that the board holds.
        capacity: u32,
    },
    /// A temperature outside of what the robot's description allows.
    Temperature {
        /// The least, hundredths of a degree Celsius.
        least: i32,
        /// The greatest.
        greatest: i32,
    },
    /// The emergency stop is still pressed.
    EmergencyStop,
}

/// A pose on the link: mm and radians.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct PoseFields {
    /// x, y, z, mm.
    pub position: [f64; 3],
    /// Radians.
    pub heading: f64,
    /// Radians.
    pub pitch: f64,
}

impl From<&Pose> for PoseFields {
    fn from(pose: &Pose) -> Self {
        Self { position: pose.position().into(), heading: pose.heading(), pitch: pose.pitch() }
    }
}

impl TryFrom<PoseFields> for Pose {
    type Error = PoseError;

    fn try_from(fields: PoseFields) -> Result<Self, PoseError> {
        Self::new(fields.position.into(), fields.heading, fields.pitch)
    }
}

/// Opens a session.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct HostHello {
    /// The host's [`SCHEMA_HASH`].
    pub schema: u64,
}

/// Begins a job: the board forgets the plan that it held. Repeating it changes nothing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Begin {
    /// Hash of the plan's layers ([`crate::job::JobSummary`]).
    pub plan_id: u64,
    /// How many layers the plan has.
    pub layers: u32,
    /// Hash of the robot that the plan is for.
    pub robot: u64,
}

/// Hands over layers. Those that the board already has are passed over.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Layers {
    /// The job.
    pub plan_id: u64,
    /// Index of the first of them, from 0.
    pub first: u32,
    /// The layers.
    pub layers: LayerBatch,
}

/// Heats, homes and grows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Start {
    /// The job.
    pub plan_id: u64,
}

/// Has the board plan by itself and hold the layers as its job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct PlanRequest {
    /// From here.
    pub start: PoseFields,
    /// To there.
    pub goal: PoseFields,
    /// With this radius, mm.
    pub radius: f64,
    /// By this planner.
    pub planner: Planner,
}

/// Asks for layers that the board holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct ReadLayers {
    /// Index of the first wanted.
    pub first: u32,
}

/// Who the board is and what it knows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct BoardHello {
    /// The board's [`SCHEMA_HASH`].
    pub schema: u64,
    /// Another number at each start of the board.
    pub boot_id: u32,
    /// Why it started.
    pub reset_cause: ResetCause,
    /// Version of the firmware: major, minor, patch.
    pub firmware: [u8; 3],
    /// Name of the robot whose description the board carries.
    pub robot_name: String<32>,
    /// Hash of that description.
    pub robot: u64,
    /// Layers that the board can hold.
    pub capacity: u32,
    /// What it is doing.
    pub status: Status,
}

/// What the board is doing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Status {
    /// The state.
    pub state: State,
    /// The fault that is latched.
    pub fault: Option<Fault>,
    /// Temperature of the nozzle, hundredths of a degree Celsius; none without a reading.
    pub temperature_centi_c: Option<i32>,
    /// What it is regulated to; none with the heater off.
    pub target_centi_c: Option<i32>,
    /// Duty of the heater, 0 to 65,535.
    pub duty: u16,
    /// The job, 0 for none.
    pub plan_id: u64,
    /// Layers of the job.
    pub layers: u32,
    /// Index of the next layer that the board expects.
    pub next: u32,
    /// Layers laid.
    pub laid: u32,
    /// Time since the board started, ms.
    pub uptime_ms: u64,
}

/// A request was carried out.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Accepted {
    /// The job, 0 for none.
    pub plan_id: u64,
    /// Index of the next layer expected.
    pub next: u32,
    /// Room for so many more.
    pub room: u32,
}

/// A request was refused.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Refused {
    /// Kind of the request.
    pub kind: u8,
    /// Why.
    pub refusal: Refusal,
}

/// The board's own plan.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Planned {
    /// Hash of the layers' bytes: the job's name.
    pub plan_id: u64,
    /// Hash of the layers in full precision.
    pub exact_hash: u64,
    /// Layers.
    pub layers: u32,
    /// Arc length, mm.
    pub length: f64,
}

/// Layers that the board holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct HeldLayers {
    /// Index of the first.
    pub first: u32,
    /// The layers; fewer than [`MOST_LAYERS`] at the end.
    pub layers: LayerBatch,
}

/// A layer is laid. The board sends this unasked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Laid {
    /// The job.
    pub plan_id: u64,
    /// Index of the layer.
    pub index: u32,
    /// The layer as built, from the steps that were made.
    pub as_built: LayerBytes,
    /// Steps of the head.
    pub head_steps: u32,
    /// Steps of the feed.
    pub feed_steps: u32,
}

/// The state changed. The board sends this unasked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct StateChanged {
    /// The new state.
    pub state: State,
    /// The fault that is latched.
    pub fault: Option<Fault>,
}

/// Finds the gains of the heater's regulation at a temperature, by driving the nozzle round it. The gains are told, not
/// taken: a robot's description is the only place that they come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Tune {
    /// The temperature, hundredths of a degree Celsius.
    pub target_centi_c: i32,
}

/// Gains that were found.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct Gains {
    /// Duty (0 to 1) per degree.
    pub kp: f64,
    /// Duty per degree and second.
    pub ki: f64,
    /// Duty per degree a second.
    pub kd: f64,
}

/// The nozzle was driven round its temperature. The board sends this unasked.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Tuned {
    /// What suits it.
    pub gains: Gains,
    /// Period of its swings, s.
    pub period_s: f64,
    /// How far it swung to either side, degrees.
    pub amplitude_c: f64,
}

/// What the board's sensors say. None where a robot does not have the sensor, or where it gives nothing.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize, Schema)]
pub struct SensorReadings {
    /// The supply's voltage, mV.
    pub supply_mv: Option<u32>,
    /// Whether the head is on its index mark.
    pub on_index: bool,
    /// Whether there is filament.
    pub filament_present: Option<bool>,
    /// Pulses of the filament's encoder since the board started.
    pub filament_pulses: Option<u32>,
    /// Whether a stepper driver reports a fault.
    pub driver_fault: Option<bool>,
    /// Whether the emergency stop is pressed.
    pub emergency_stop: Option<bool>,
    /// Gravity in the tip's frame, thousandths of the earth's; upwards, as a resting accelerometer shows it.
    pub gravity_milli_g: Option<[i16; 3]>,
}

/// A fault as it was when it came, kept until the next one, through resets.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct FaultRecord {
    /// What went wrong; none for the emergency stop.
    pub fault: Option<Fault>,
    /// Whether it has been cleared since.
    pub cleared: bool,
    /// What the board was doing.
    pub state: State,
    /// Time since the start of the board in which it came, ms.
    pub uptime_ms: u64,
    /// Temperature of the nozzle, hundredths of a degree Celsius.
    pub temperature_centi_c: Option<i32>,
    /// What it was regulated to.
    pub target_centi_c: Option<i32>,
    /// Duty of the heater, 0 to 65,535.
    pub duty: u16,
    /// What the other sensors said.
    pub sensors: SensorReadings,
    /// The job, 0 for none.
    pub plan_id: u64,
    /// Layers laid.
    pub laid: u32,
    /// Layers begun: one more than those laid where one was cut.
    pub begun: u32,
}

/// The latest fault.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct LatestFault {
    /// None where the board knows of none.
    pub record: Option<FaultRecord>,
}

/// A message without a body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Empty {}

/// Why a message could not be encoded or decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum MessageError {
    /// No message has this kind.
    #[error("unknown kind of message {kind:#04x}")]
    UnknownKind {
        /// The kind.
        kind: u8,
    },
    /// The body is not what its kind says, or too long.
    #[error("the body of a message of kind {kind:#04x} does not decode")]
    Body {
        /// The kind.
        kind: u8,
    },
}

/// The first kind of what boards say; hosts' kinds are below.
const ANSWERS_FROM: u8 = 0x40;

macro_rules! messages {
    ($($(#[$doc:meta])* $kind:literal $name:ident($body:ident),)*) => {
        /// Every message, by kind.
        #[derive(Debug, Clone, PartialEq)]
        pub enum Message {
            $($(#[$doc])* $name($body),)*
        }

        impl Message {
            /// Its kind in the frame's header.
            #[must_use]
            pub fn kind(&self) -> u8 {
                match self { $(Self::$name(_) => $kind,)* }
            }

            /// Encodes the body.
            ///
            /// # Errors
            /// If it does not fit a frame; with the messages above it does.
            pub fn encode<'a>(&self, buffer: &'a mut [u8; LONGEST_BODY]) -> Result<&'a [u8], MessageError> {
                self.encode_from::<0>(buffer)
            }

            /// Encodes the body of an answer or event: what a board needs, without the code for requests.
            ///
            /// # Errors
            /// As [`Message::encode`], or for a request.
            pub fn encode_answer<'a>(&self, buffer: &'a mut [u8; LONGEST_BODY]) -> Result<&'a [u8], MessageError> {
                self.encode_from::<ANSWERS_FROM>(buffer)
            }

            fn encode_from<'a, const FIRST: u8>(
                &self,
                buffer: &'a mut [u8; LONGEST_BODY],
            ) -> Result<&'a [u8], MessageError> {
                let encoded = match self {
                    $(Self::$name(body) if $kind >= FIRST => postcard::to_slice(body, buffer),)*
                    _ => return Err(MessageError::UnknownKind { kind: self.kind() }),
                };
                encoded.map(|bytes| &*bytes).map_err(|_| MessageError::Body { kind: self.kind() })
            }

            /// Decodes a body. It must be used up to its last byte.
            ///
            /// # Errors
            /// An unknown kind, or a body that is not of its kind.
            pub fn decode(kind: u8, body: &[u8]) -> Result<Self, MessageError> {
                Self::decode_below::<{ u8::MAX }>(kind, body)
            }

            /// Decodes the body of a request: what a board needs, without the code for answers.
            ///
            /// # Errors
            /// As [`Message::decode`]; answers are unknown.
            pub fn decode_request(kind: u8, body: &[u8]) -> Result<Self, MessageError> {
                Self::decode_below::<ANSWERS_FROM>(kind, body)
            }

            fn decode_below<const END: u8>(kind: u8, body: &[u8]) -> Result<Self, MessageError> {
                match kind {
                    $($kind if $kind < END => match postcard::take_from_bytes(body) {
                        Ok((body, [])) => Ok(Self::$name(body)),
                        _ => Err(MessageError::Body { kind }),
                    },)*
                    kind => Err(MessageError::UnknownKind { kind }),
                }
            }

            /// Every kind with its name, in the order of the table.
            pub const KINDS: &[(u8, &str)] = &[$(($kind, stringify!($name)),)*];
        }

        /// Hash of the kinds and of the types of all bodies. Hosts and boards with different hashes don't understand each other.
        pub const SCHEMA_HASH: u64 = {
            let mut hash: u64 = 0xcbf2_9ce4_8422_2325;
            $(
                hash = fnv1a(hash, &[$kind]);
                hash = fnv1a(hash, &postcard_schema::key::Key::for_path::<$body>(stringify!($name)).to_bytes());
            )*
            hash
        };
    };
}

/// FNV-1a, as postcard-schema uses for single types; here it joins them.
const fn fnv1a(mut hash: u64, bytes: &[u8]) -> u64 {
    let mut i = 0;
    while i < bytes.len() {
        hash = (hash ^ bytes[i] as u64).wrapping_mul(0x0000_0100_0000_01b3);
        i += 1;
    }
    hash
}

messages! {
    // Host to board.
    /// Opens a session; answered by `BoardHello`, or by `Refused` with both schemas.
    0x01 Hello(HostHello),
    /// Answered by `Status`, in any session.
    0x02 AskStatus(Empty),
    /// Answered by `Accepted` or `Refused`.
    0x03 Begin(Begin),
    /// Answered by `Accepted` or `Refused`.
    0x04 Layers(Layers),
    /// Answered by `Accepted` or `Refused`.
    0x05 Start(Start),
    /// Stops at once, in any state; answered by `Accepted`.
    0x06 Stop(Empty),
    /// Leaves `Fault` if its cause is gone; answered by `Accepted` or `Refused`.
    0x07 ClearFault(Empty),
    /// Answered by `Planned` or `Refused`.
    0x08 Plan(PlanRequest),
    /// Answered by `HeldLayers`.
    0x09 ReadLayers(ReadLayers),
    /// Finishes the layer under way and waits; `Start` goes on. Answered by `Accepted` or `Refused`.
    0x0A Hold(Empty),
    /// Answered by `Accepted` or `Refused`; when it is done, the event `Tuned` comes.
    0x0B Tune(Tune),
    /// Answered by `LatestFault`, in any session.
    0x0C AskFault(Empty),
    /// Answered by `SensorReadings`, in any session.
    0x0D AskSensors(Empty),

    // Board to host.
    /// Answers `Hello`.
    0x41 BoardHello(BoardHello),
    /// Answers `AskStatus`.
    0x42 Status(Status),
    /// Answers what changed something.
    0x43 Accepted(Accepted),
    /// Answers what did not.
    0x44 Refused(Refused),
    /// Answers `Plan`.
    0x45 Planned(Planned),
    /// Answers `ReadLayers`.
    0x46 HeldLayers(HeldLayers),
    /// Answers `AskFault`.
    0x47 LatestFault(LatestFault),
    /// Answers `AskSensors`.
    0x48 SensorReadings(SensorReadings),
    /// An event.
    0x50 Laid(Laid),
    /// An event.
    0x51 StateChanged(StateChanged),
    /// An event.
    0x52 Tuned(Tuned),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_messages_fit_a_frame() {
        let layers: LayerBatch = (0..MOST_LAYERS).map(|_| [0xff; 12]).collect();
        let name = core::iter::repeat_n('x', 32).collect();
        let status = Status {
            state: State::Fault,
            fault: Some(Fault::Hardware),
            temperature_centi_c: Some(i32::MIN),
            target_centi_c: Some(i32::MIN),
            duty: u16::MAX,
            plan_id: u64::MAX,
            layers: u32::MAX,
            next: u32::MAX,
            laid: u32::MAX,
            uptime_ms: u64::MAX,
        };
        let longest = [
            Message::Layers(Layers { plan_id: u64::MAX, first: u32::MAX, layers: layers.clone() }),
            Message::HeldLayers(HeldLayers { first: u32::MAX, layers }),
            Message::BoardHello(BoardHello {
                schema: u64::MAX,
                boot_id: u32::MAX,
                reset_cause: ResetCause::External,
                firmware: [255; 3],
                robot_name: name,
                robot: u64::MAX,
                capacity: u32::MAX,
                status,
            }),
        ];
        for message in longest {
            let mut buffer = [0; LONGEST_BODY];
            let body = message.encode(&mut buffer).unwrap();
            assert_eq!(Message::decode(message.kind(), body).unwrap(), message);
        }
    }

    #[test]
    fn kinds_are_unique_and_decode_only_as_themselves() {
        for (i, (kind, _)) in Message::KINDS.iter().enumerate() {
            assert!(Message::KINDS[..i].iter().all(|(other, _)| other < kind));
        }
        assert_eq!(Message::decode(0x00, &[]), Err(MessageError::UnknownKind { kind: 0 }));
        assert_eq!(Message::decode(0x02, &[1]), Err(MessageError::Body { kind: 2 }));
        assert_eq!(Message::decode(0x05, &[]), Err(MessageError::Body { kind: 5 }));
    }
}
