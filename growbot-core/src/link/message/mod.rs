//! The messages of the link, and the table of their kinds.
//!
//! A message is its kind (in the frame's header) and its body in postcard form. Both sides compare [`SCHEMA_HASH`],
//! taken over every kind and every type below, before anything else, so that a board and a host with different messages
//! refuse each other. The bodies of `Hello`, `Status` and `Refused` stay as they are for as long as
//! [`super::frame::VERSION`] does, so that every host can ask a board for its identity.

mod answers;
mod requests;

use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

pub use self::answers::*;
pub use self::requests::*;
pub use super::drivers::{DriverProblem, DriverTrouble, Motor};
use super::frame::LONGEST_BODY;
pub use super::state::{Fault, ResetCause, State};
use crate::layer_bytes::LayerBytes;

/// Max number of layers in one `Layers`, `Amend` or `StoredLayers`.
pub const MAX_LAYERS: usize = 16;
/// The layers of one message.
pub type LayerBatch = Vec<LayerBytes, MAX_LAYERS>;

/// Max number of bytes of a robot description in one `Configure`.
pub const MAX_DESCRIPTION_PART: usize = 192;

/// A message without a body.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Empty {}

/// Why a message could not be encoded or decoded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum MessageError {
    /// No message has the kind.
    #[error("unknown kind of message {kind:#04x}")]
    UnknownKind {
        /// The kind in the frame's header.
        kind: u8,
    },
    /// The body is not what its kind says, or too long.
    #[error("the body of a message of kind {kind:#04x} does not decode")]
    Body {
        /// The kind in the frame's header.
        kind: u8,
    },
}

/// The first kind of the board's messages. The host's kinds are below.
const ANSWERS_FROM: u8 = 0x40;

macro_rules! messages {
    ($($(#[$doc:meta])* $kind:literal $name:ident($body:ident),)*) => {
        /// Every message, by kind.
        #[derive(Debug, Clone, PartialEq)]
        pub enum Message {
            $($(#[$doc])* $name($body),)*
        }

        impl Message {
            /// The message's kind in the frame's header.
            #[must_use]
            pub fn kind(&self) -> u8 {
                match self { $(Self::$name(_) => $kind,)* }
            }

            /// Encodes the body.
            ///
            /// # Errors
            /// If the body does not fit a frame. Every message of the table fits.
            pub fn encode<'a>(&self, buffer: &'a mut [u8; LONGEST_BODY]) -> Result<&'a [u8], MessageError> {
                self.encode_from::<0>(buffer)
            }

            /// Encodes the body of an answer or event. A board uses this, so that its image has no code for requests.
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

            /// Decodes a body, up to its last byte.
            ///
            /// # Errors
            /// An unknown kind, or a body that is not of its kind.
            pub fn decode(kind: u8, body: &[u8]) -> Result<Self, MessageError> {
                Self::decode_below::<{ u8::MAX }>(kind, body)
            }

            /// Decodes the body of a request. A board uses this, so that its image has no code for answers.
            ///
            /// # Errors
            /// As [`Message::decode`]. The kinds of answers and events are unknown here.
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

            /// Every kind with its message's name, in the order of the table.
            pub const KINDS: &[(u8, &str)] = &[$(($kind, stringify!($name)),)*];
        }

        /// Hash of the kinds and of the types of all bodies. Hosts and boards with different hashes refuse each other.
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
    /// Opens a session. Answered by `BoardHello`, or by `Refused` with the board's schema hash.
    0x01 Hello(HostHello),
    /// Asks for the board's status. Answered by `Status`, in any session.
    0x02 AskStatus(Empty),
    /// Begins a job. Answered by `Accepted` or `Refused`.
    0x03 Begin(Begin),
    /// Hands over layers of the job. Answered by `Accepted` or `Refused`.
    0x04 Layers(Layers),
    /// Starts or continues the job. Answered by `Accepted` or `Refused`.
    0x05 Start(Start),
    /// Stops at once, in any state. Answered by `Accepted`.
    0x06 Stop(Empty),
    /// Leaves `Fault` or `EmergencyStop` if the cause is gone. Answered by `Accepted` or `Refused`.
    0x07 ClearFault(Empty),
    /// Asks the board to plan. Answered by `Planned` or `Refused`.
    0x08 Plan(PlanRequest),
    /// Asks for layers that the board stores. Answered by `StoredLayers`.
    0x09 ReadLayers(ReadLayers),
    /// Pauses after the layer under way; `Start` continues. Answered by `Accepted` or `Refused`.
    0x0A Pause(Empty),
    /// Finds the heater's gains. Answered by `Accepted` or `Refused`; the event `Tuned` ends it.
    0x0B Tune(Tune),
    /// Asks for the latest fault. Answered by `LatestFault`, in any session.
    0x0C AskFault(Empty),
    /// Asks for the sensors' readings. Answered by `SensorReadings`, in any session.
    0x0D AskSensors(Empty),
    /// Acknowledges events. Not answered.
    0x0E Ack(Empty),
    /// Resumes the job that the board knows. Answered by `Accepted` or `Refused`.
    0x0F Resume(Resume),
    /// Replaces layers of the job. Answered by `Accepted` or `Refused`.
    0x10 Amend(Amend),
    /// Cancels the job. Answered by `Accepted` or `Refused`.
    0x11 Cancel(Cancel),
    /// Asks for the board's identity. Answered by `BoardHello`, in any session; opens none.
    0x12 AskBoard(Empty),
    /// Closes the session, so that another host need not wait. Not answered.
    0x13 Goodbye(Empty),
    /// Asks how the board started. Answered by `BootReport`, in any session.
    0x14 AskBoot(Empty),
    /// Maintenance: heats, feeds or turns without a job. Answered by `Accepted` or `Refused`.
    0x15 Maintain(Maintain),
    /// Hands over a robot description. Answered by `Configured` or `Refused`.
    0x16 Configure(Configure),

    // Board to host.
    /// Answers `Hello` and `AskBoard`.
    0x41 BoardHello(BoardHello),
    /// Answers `AskStatus`.
    0x42 Status(Status),
    /// Answers a request that was carried out.
    0x43 Accepted(Accepted),
    /// Answers a request that was refused.
    0x44 Refused(Refused),
    /// Answers `Plan`.
    0x45 Planned(Planned),
    /// Answers `ReadLayers`.
    0x46 StoredLayers(StoredLayers),
    /// Answers `AskFault`.
    0x47 LatestFault(LatestFault),
    /// Answers `AskSensors`.
    0x48 SensorReadings(SensorReadings),
    /// Answers `AskBoot`.
    0x49 BootReport(BootReport),
    /// Answers `Configure`.
    0x4A Configured(Configured),
    /// Event: a layer is laid.
    0x50 Laid(Laid),
    /// Event: the state changed.
    0x51 StateChanged(StateChanged),
    /// Event: the heater's gains are found.
    0x52 Tuned(Tuned),
    /// Emergency stops by the link were obeyed. Sent in session 0; not an event.
    0x53 StoppedAtOnce(Empty),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_messages_fit_a_frame() {
        let layers: LayerBatch = (0..MAX_LAYERS).map(|_| [0xff; 12]).collect();
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
            interrupted: Some(InterruptedLayer { min: u8::MAX, max: u8::MAX }),
            pause_cause: PauseCause::HostSilent,
            journal: true,
            uptime_ms: u64::MAX,
        };
        let longest = [
            Message::Layers(Layers { plan_id: u64::MAX, first: u32::MAX, layers: layers.clone() }),
            Message::StoredLayers(StoredLayers { first: u32::MAX, layers: layers.clone() }),
            Message::BoardHello(BoardHello {
                schema: u64::MAX,
                boot_id: u32::MAX,
                reset_cause: ResetCause::External,
                firmware: [255; 3],
                robot_name: name,
                robot: u64::MAX,
                capacity: u32::MAX,
                status,
                owner: Some([b'x'; 32].into()),
            }),
            Message::Amend(Amend {
                plan_id: u64::MAX,
                amended: u64::MAX,
                from: u32::MAX,
                layers: u32::MAX,
                first_layers: layers.clone(),
            }),
            Message::Configure(Configure {
                robot: u64::MAX,
                length: u16::MAX,
                offset: u16::MAX,
                bytes: [0xff; MAX_DESCRIPTION_PART].into(),
            }),
        ];
        let crash = [u32::MAX; crate::link::crash::CRASH_WORDS];
        let image = ImageCheck::Corrupt { sealed: u32::MAX, found: u32::MAX };
        let boot = Message::BootReport(BootReport { image, crash: Some(crash) });
        for message in longest.into_iter().chain([boot]) {
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
