//! Messages of a recording, before they are encoded as JSON or CDR.

use growbot_core::pose::Frame;
use growbot_plan::run_log::BoardStatus;
use nalgebra::Point3;
use serde_json::{Value, json};

use super::foxglove::{self, LogLevel};

/// Content of a message of a recording.
pub enum EncodedMessage<'a> {
    /// A pose in the base's frame, mm.
    Pose(Frame),
    /// A line through the origins of frames, mm.
    Line {
        /// Name of the line.
        id: &'a str,
        /// Frames in the base's frame, whose origins are on the line.
        frames: Vec<Frame>,
        /// Colour, RGB from 0 to 1.
        color: [f64; 3],
    },
    /// A layer as a disc, mm.
    Disc {
        /// Index of the layer.
        index: usize,
        /// Frame at the centre of the disc, in the base's frame.
        base_from_middle: Frame,
        /// Diameter of the disc, mm.
        diameter: f64,
        /// Height of the disc, mm.
        height: f64,
        /// Colour, RGB from 0 to 1.
        color: [f64; 3],
    },
    /// Values of a layer, as a JSON object.
    Layer(Value),
    /// Status of the board.
    Status(&'a BoardStatus),
    /// A fault that is latched.
    Fault {
        /// Code of the fault.
        code: &'a str,
        /// Explanation of the fault.
        explanation: &'a str,
    },
    /// Another event, as text.
    Event(LogLevel, &'a str),
}

impl EncodedMessage<'_> {
    /// Returns the message as JSON. `ms` is the time since the beginning of the recording.
    pub fn json(&self, ms: u64) -> Value {
        match self {
            Self::Pose(frame) => foxglove::pose_in_frame(ms, frame),
            Self::Line { id, frames, color } => {
                let points = frames.iter().map(|frame| Point3::from(frame.translation.vector));
                foxglove::line(ms, id, points, *color)
            }
            Self::Disc { index, base_from_middle, diameter, height, color } => {
                foxglove::disc(ms, &format!("layer {index}"), base_from_middle, *diameter, *height, *color)
            }
            Self::Layer(numbers) => {
                let mut message = numbers.clone();
                message["timestamp"] = foxglove::time(ms);
                message
            }
            Self::Status(status) => foxglove::status(ms, status),
            Self::Fault { code, explanation } => {
                json!({ "timestamp": foxglove::time(ms), "code": code, "explanation": explanation })
            }
            Self::Event(level, words) => foxglove::log(ms, *level, words),
        }
    }
}
