//! The messages of the link, and the table of their kinds.
//!
//! A message consists of its kind (in the frame's header) and its body in postcard form. Both sides first compare
//! [`SCHEMA_HASH`], which covers every kind and every type of a body. So a board and a host with different messages
//! refuse each other. The bodies of `Hello`, `Status` and `Refused` do not change while [`super::frame::FRAME_VERSION`]
//! stays the same, so that every host can request the identity of a board.

mod effect;
mod layer_batch;
mod requests;
mod responses;

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

pub use self::effect::{Effect, EnergizingRequest, PassiveRequest};
pub use self::layer_batch::{LayerBatch, MAX_LAYERS_PER_MESSAGE};
pub use self::requests::*;
pub use self::responses::*;
pub use super::driver_report::{DriverProblem, DriverReport, Motor};
pub use super::fault::Fault;
use super::frame::MAX_BODY_LEN;
pub use super::reset_cause::ResetCause;
pub use super::state::State;

/// Body of a message that carries no data.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Empty {}

/// Error of the encoding or decoding of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum MessageError {
    /// No message has this kind.
    #[error(
        "received a message of the unknown kind {kind:#04x}: install the same release of growbot on the host and on \
         the board"
    )]
    UnknownKind {
        /// The kind in the frame's header.
        kind: u8,
    },
    /// The body does not match its kind, or is too long.
    #[error(
        "the content of a message of kind {kind:#04x} cannot be decoded: install the same release of growbot on the \
         host and on the board"
    )]
    Body {
        /// The kind in the frame's header.
        kind: u8,
    },
}

/// Lowest kind of the messages that a board sends. The kinds of the messages that a host sends are lower.
const FIRST_BOARD_KIND: u8 = 0x40;

macro_rules! messages {
    ($($(#[$doc:meta])* $kind:literal $name:ident($body:ident),)*) => {
        /// A message of the link.
        #[derive(Debug, Clone, PartialEq)]
        pub enum Message {
            $($(#[$doc])* $name($body),)*
        }

        impl Message {
            /// Returns the kind of the message in the frame's header.
            pub fn kind(&self) -> u8 {
                match self { $(Self::$name(_) => $kind,)* }
            }

            /// Encodes the body of the message in postcard form.
            ///
            /// # Errors
            /// Returns an error if the body does not fit in a frame. Every message of this protocol fits.
            pub fn encode<'a>(&self, buffer: &'a mut [u8; MAX_BODY_LEN]) -> Result<&'a [u8], MessageError> {
                self.encode_from::<0>(buffer)
            }

            /// Encodes the body of a response or event. A board uses this function, so that its image contains no code
            /// for requests.
            ///
            /// # Errors
            /// Returns the errors of [`Message::encode`], or an error if the message is a request.
            pub fn encode_response<'a>(&self, buffer: &'a mut [u8; MAX_BODY_LEN]) -> Result<&'a [u8], MessageError> {
                self.encode_from::<FIRST_BOARD_KIND>(buffer)
            }

            fn encode_from<'a, const FIRST: u8>(
                &self,
                buffer: &'a mut [u8; MAX_BODY_LEN],
            ) -> Result<&'a [u8], MessageError> {
                let encoded = match self {
                    $(Self::$name(body) if $kind >= FIRST => postcard::to_slice(body, buffer),)*
                    _ => return Err(MessageError::UnknownKind { kind: self.kind() }),
                };
                encoded.map(|bytes| &*bytes).map_err(|_| MessageError::Body { kind: self.kind() })
            }

            /// Decodes the body of a message of this kind. The message must use all bytes of the body.
            ///
            /// # Errors
            /// Returns an error if the kind is unknown or the body does not match it.
            pub fn decode(kind: u8, body: &[u8]) -> Result<Self, MessageError> {
                Self::decode_below::<{ u8::MAX }>(kind, body)
            }

            /// Decodes the body of a request. A board uses this function, so that its image contains no code for
            /// responses.
            ///
            /// # Errors
            /// Returns the errors of [`Message::decode`]. The kinds of responses and events are unknown here.
            pub fn decode_request(kind: u8, body: &[u8]) -> Result<Self, MessageError> {
                Self::decode_below::<FIRST_BOARD_KIND>(kind, body)
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

            /// The kinds of all messages, with the names of the messages, in ascending order.
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

/// Continues an FNV-1a hash. postcard-schema uses this hash for single types, and here it combines them.
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
    /// Opens a session. The response is `BoardInfo`, or `Refused` with the board's schema hash.
    0x01 Hello(Hello),
    /// Requests the board's status. The response is `Status`. The request is accepted in any session.
    0x02 GetStatus(Empty),
    /// Begins a job. The response is `Accepted` or `Refused`.
    0x03 BeginJob(BeginJob),
    /// Sends the next layers of the job. The response is `Accepted` or `Refused`.
    0x04 AppendLayers(AppendLayers),
    /// Starts or continues the job. The response is `Accepted` or `Refused`.
    0x05 Start(Start),
    /// Stops heater and motors immediately, in any state. The response is `Accepted`.
    0x06 Stop(Empty),
    /// Leaves `Fault` or `EmergencyStop` if the cause is gone. The response is `Accepted` or `Refused`.
    0x07 ClearFault(Empty),
    /// Requests that the board plans a path and stores its layers as a job. The response is `Planned` or `Refused`.
    0x08 Plan(PlanRequest),
    /// Requests layers that the board stores. The response is `StoredLayers`.
    0x09 ReadLayers(ReadLayers),
    /// Pauses the job after the present layer, until `Start` continues it. The response is `Accepted` or `Refused`.
    0x0A Pause(Empty),
    /// Heats the nozzle to find the gains of the heater's controller. The response is `Accepted` or `Refused`, and the
    /// event `Tuned` ends the tuning.
    0x0B Tune(Tune),
    /// Requests the record of the latest fault. The response is `LatestFault`. The request is accepted in any session.
    0x0C GetLatestFault(Empty),
    /// Requests the readings of the sensors. The response is `SensorReadings`. The request is accepted in any session.
    0x0D GetSensorReadings(Empty),
    /// Acknowledges all events up to the number `ack` in the frame's header. The board does not respond.
    0x0E Ack(Empty),
    /// Resumes the job that the board stores. The response is `Accepted` or `Refused`.
    0x0F Resume(Resume),
    /// Replaces the layers of the job from an index on. The response is `Accepted` or `Refused`.
    0x10 Amend(Amend),
    /// Cancels the job. The response is `Accepted` or `Refused`.
    0x11 Cancel(Cancel),
    /// Requests the board's identity without opening a session. The response is `BoardInfo`. The request is accepted in
    /// any session.
    0x12 GetBoardInfo(Empty),
    /// Closes the session, so that another host can open one immediately. The board does not respond.
    0x13 Goodbye(Empty),
    /// Requests a report of the board's start. The response is `BootReport`. The request is accepted in any session.
    0x14 GetBootReport(Empty),
    /// Maintenance: heats, feeds or turns without a job. The response is `Accepted` or `Refused`.
    0x15 Maintain(Maintain),
    /// Sends a part of a robot description. The response is `Configured` or `Refused`.
    0x16 Configure(Configure),

    // Board to host.
    /// Responds to `Hello` and `GetBoardInfo`.
    0x41 BoardInfo(BoardInfo),
    /// Responds to `GetStatus`.
    0x42 Status(Status),
    /// Responds to a request that was carried out.
    0x43 Accepted(Accepted),
    /// Responds to a request that was refused.
    0x44 Refused(RefusalResponse),
    /// Responds to `Plan`.
    0x45 Planned(Planned),
    /// Responds to `ReadLayers`.
    0x46 StoredLayers(StoredLayers),
    /// Responds to `GetLatestFault`.
    0x47 LatestFault(LatestFault),
    /// Responds to `GetSensorReadings`.
    0x48 SensorReadings(SensorReadings),
    /// Responds to `GetBootReport`.
    0x49 BootReport(BootReport),
    /// Responds to `Configure`.
    0x4A Configured(Configured),
    /// Event: the board has laid a layer.
    0x50 LayerLaid(LayerLaid),
    /// Event: the state of the board has changed.
    0x51 StateChanged(StateChanged),
    /// Event: the gains of the heater's controller have been found.
    0x52 Tuned(Tuned),
    /// Acknowledges an emergency stop that came over the link. The board sends this message in session 0, without a
    /// sequence number.
    0x53 EmergencyStopAck(Empty),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_messages_fit_a_frame() {
        let layers: LayerBatch = (0..MAX_LAYERS_PER_MESSAGE).map(|_| [0xff; 12]).collect();
        let name = core::iter::repeat_n('x', 32).collect();
        let status = Status {
            state: State::Fault,
            fault: Some(Fault::Hardware),
            temperature_centi_c: Some(i32::MIN),
            target_centi_c: Some(i32::MIN),
            duty: u16::MAX,
            plan_id: u64::MAX,
            layer_count: u32::MAX,
            next_layer: u32::MAX,
            layers_laid: u32::MAX,
            interrupted: Some(InterruptedLayer { min: u8::MAX, max: u8::MAX }),
            pause_cause: PauseCause::HostSilent,
            is_resumable: true,
            uptime_ms: u64::MAX,
        };
        let longest = [
            Message::AppendLayers(AppendLayers { plan_id: u64::MAX, first: u32::MAX, layers: layers.clone() }),
            Message::StoredLayers(StoredLayers { first: u32::MAX, layers: layers.clone() }),
            Message::BoardInfo(BoardInfo {
                schema_hash: u64::MAX,
                boot_id: u32::MAX,
                reset_cause: ResetCause::External,
                firmware: [255; 3],
                robot_name: name,
                robot_hash: u64::MAX,
                layer_capacity: u32::MAX,
                status,
                owner: Some([b'x'; 32].into()),
            }),
            Message::Amend(Amend {
                plan_id: u64::MAX,
                new_plan_id: u64::MAX,
                first_replaced: u32::MAX,
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
            let mut buffer = [0; MAX_BODY_LEN];
            let body = message.encode(&mut buffer).unwrap();
            assert_eq!(Message::decode(message.kind(), body).unwrap(), message);
        }
    }

    #[test]
    fn message_kinds_are_unique_and_decode_as_themselves() {
        for (i, (kind, _)) in Message::KINDS.iter().enumerate() {
            assert!(Message::KINDS[..i].iter().all(|(other, _)| other < kind));
        }
        assert_eq!(Message::decode(0x00, &[]), Err(MessageError::UnknownKind { kind: 0 }));
        assert_eq!(Message::decode(0x02, &[1]), Err(MessageError::Body { kind: 2 }));
        assert_eq!(Message::decode(0x05, &[]), Err(MessageError::Body { kind: 5 }));
    }
}
