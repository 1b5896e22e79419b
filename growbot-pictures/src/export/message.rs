//! A message of a recording, before it is JSON or CDR.

use growbot_client::run_log::BoardStatus;
use growbot_core::pose::Frame;
use nalgebra::Point3;
use serde_json::{Value, json};

use super::messages::{self, Level};

/// What is told on a channel.
pub enum Message<'a> {
    /// Where something is, mm.
    Pose(Frame),
    /// A line through the origins of frames, mm.
    Line {
        /// What it is called.
        id: &'a str,
        /// Its frames.
        frames: Vec<Frame>,
        /// Its colour.
        color: [f64; 3],
    },
    /// A layer as a disc, mm.
    Disc {
        /// Which layer.
        index: usize,
        /// Its middle.
        base_from_middle: Frame,
        /// Its diameter.
        diameter: f64,
        /// Its height.
        height: f64,
        /// Its colour.
        color: [f64; 3],
    },
    /// The numbers of a layer.
    Layer(Value),
    /// What the board says.
    Status(&'a BoardStatus),
    /// A fault that is latched.
    Fault {
        /// Its code.
        code: &'a str,
        /// What it means.
        explanation: &'a str,
    },
    /// Another event, in words.
    Event(Level, &'a str),
}

impl Message<'_> {
    /// As JSON.
    pub fn json(&self, ms: u64) -> Value {
        match self {
            Self::Pose(frame) => messages::pose_in_frame(ms, frame),
            Self::Line { id, frames, color } => {
                let points = frames.iter().map(|frame| Point3::from(frame.translation.vector));
                messages::line(ms, id, points, *color)
            }
            Self::Disc { index, base_from_middle, diameter, height, color } => {
                messages::disc(ms, &format!("layer {index}"), base_from_middle, *diameter, *height, *color)
            }
            Self::Layer(numbers) => {
                let mut message = numbers.clone();
                message["timestamp"] = messages::time(ms);
                message
            }
            Self::Status(status) => messages::status(ms, status),
            Self::Fault { code, explanation } => {
                json!({ "timestamp": messages::time(ms), "code": code, "explanation": explanation })
            }
            Self::Event(level, words) => messages::log(ms, *level, words),
        }
    }
}
