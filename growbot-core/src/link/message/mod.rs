//! The messages of the link, and the table of their kinds.
//!
//! A message is its kind (in the frame's header) and its body in postcard form. Both sides compare [`SCHEMA_HASH`],
//! taken over every kind and every type below, before anything else: a board and a host that would misread each other
//! say so. The bodies of `Hello`, `Status` and `Refused` stay as they are for as long as [`super::frame::VERSION`]
//! does, so that a board can always be asked who it is.

mod answers;
mod requests;

use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

pub use self::answers::*;
pub use self::requests::*;
use super::frame::LONGEST_BODY;
pub use super::state::{Fault, ResetCause, State};
use crate::layer_bytes::LayerBytes;

/// Max layers in one `Layers` or `HeldLayers`.
pub const MOST_LAYERS: usize = 16;
/// Layers in a batch.
pub type LayerBatch = Vec<LayerBytes, MOST_LAYERS>;

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

        /// Hash of the kinds and of the types of all bodies. Hosts and boards with different hashes don't understand
        /// each other.
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
    /// Acknowledges events; not answered.
    0x0E Heard(Empty),
    /// Answered by `Accepted` or `Refused`.
    0x0F Resume(Resume),
    /// Answered by `Accepted` or `Refused`.
    0x10 Amend(Amend),
    /// Answered by `Accepted` or `Refused`.
    0x11 Cancel(Cancel),
    /// Answered by `BoardHello`, in any session; opens none.
    0x12 AskBoard(Empty),
    /// Closes the session: another host need not wait. Not answered.
    0x13 Goodbye(Empty),
    /// Answered by `BootReport`, in any session.
    0x14 AskBoot(Empty),

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
    /// Answers `AskBoot`.
    0x49 BootReport(BootReport),
    /// An event.
    0x50 Laid(Laid),
    /// An event.
    0x51 StateChanged(StateChanged),
    /// An event.
    0x52 Tuned(Tuned),
    /// Emergency stops by the link were obeyed: sent in session 0, for every session that asks.
    0x53 StoppedAtOnce(Empty),
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
            cut: Some(Cut { least: u8::MAX, most: u8::MAX }),
            waits: Waits::ForHost,
            journal: true,
            uptime_ms: u64::MAX,
        };
        let longest = [
            Message::Layers(Layers { plan_id: u64::MAX, first: u32::MAX, layers: layers.clone() }),
            Message::HeldLayers(HeldLayers { first: u32::MAX, layers: layers.clone() }),
            Message::BoardHello(BoardHello {
                schema: u64::MAX,
                boot_id: u32::MAX,
                reset_cause: ResetCause::External,
                firmware: [255; 3],
                robot_name: name,
                robot: u64::MAX,
                capacity: u32::MAX,
                status,
                holder: Some([b'x'; 32].into()),
            }),
            Message::Amend(Amend {
                plan_id: u64::MAX,
                amended: u64::MAX,
                from: u32::MAX,
                layers: u32::MAX,
                first_layers: layers.clone(),
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
