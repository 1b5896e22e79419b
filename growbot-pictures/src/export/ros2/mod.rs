//! The content of a run log as messages of ROS 2, in CDR: metres, seconds, the frames `base` and `tip`.

mod cdr;
mod types;

use growbot_core::pose::Frame;
use growbot_plan::run_log::BoardStatus;
use nalgebra::{Point3, UnitQuaternion};
pub use types::definition;

use self::cdr::Cdr;
use super::foxglove::{FRAME, LogLevel};
use super::message::EncodedMessage;

/// Name of the frame that moves with the tip.
const TIP: &str = "tip";
/// Type of a marker in the shape of a cylinder, from the definition of `Marker`. `ADD` is the action that adds a
/// marker.
const CYLINDER: i32 = 3;
const ADD: i32 = 0;

/// Name of the message type of poses.
pub const POSE: &str = "geometry_msgs/msg/PoseStamped";
/// Name of the message type of paths.
pub const PATH: &str = "nav_msgs/msg/Path";
/// Name of the message type of transforms.
pub const TRANSFORMS: &str = "tf2_msgs/msg/TFMessage";
/// Name of the message type of markers.
pub const MARKER: &str = "visualization_msgs/msg/Marker";
/// Name of the message type of diagnostics.
pub const DIAGNOSTICS: &str = "diagnostic_msgs/msg/DiagnosticArray";

/// Returns a message in CDR, in the ROS 2 type of its topic. Returns `None` if ROS 2 has no type for it. `ms` is the
/// time since the beginning of the recording, and `hardware` is the name of the robot.
pub fn encode(ms: u64, message: &EncodedMessage, hardware: &str) -> Option<Vec<u8>> {
    let bytes = match message {
        EncodedMessage::Pose(frame) => {
            let mut cdr = Cdr::new();
            pose_stamped(&mut cdr, ms, frame);
            cdr.finish()
        }
        EncodedMessage::Line { frames, .. } => path(ms, frames.iter().map(|frame| (ms, *frame))),
        EncodedMessage::Disc { index, base_from_middle, diameter, height, color } => {
            marker(ms, *index, base_from_middle, [*diameter, *diameter, *height], *color)
        }
        EncodedMessage::Status(status) => {
            let level = if status.fault.is_some() { LogLevel::Error } else { LogLevel::Info };
            let state = status.state.as_deref().unwrap_or("unknown");
            diagnostic(ms, level, ["growbot: board", state, hardware], &values(status))
        }
        EncodedMessage::Event(level, words) => diagnostic(ms, *level, ["growbot: event", words, hardware], &[]),
        EncodedMessage::Layer(_) | EncodedMessage::Fault { .. } => return None,
    };
    Some(bytes)
}

/// Returns the message of a path through poses, each with its time, ms.
pub fn path(ms: u64, poses: impl ExactSizeIterator<Item = (u64, Frame)>) -> Vec<u8> {
    let mut cdr = Cdr::new();
    header(&mut cdr, ms);
    cdr.u32(poses.len() as u32);
    for (ms, frame) in poses {
        pose_stamped(&mut cdr, ms, &frame);
    }
    cdr.finish()
}

/// Returns the message of the transform from the base to the tip, at a time, ms.
pub fn transform(ms: u64, base_from_tip: &Frame) -> Vec<u8> {
    let mut cdr = Cdr::new();
    cdr.u32(1);
    header(&mut cdr, ms);
    cdr.string(TIP);
    pose(&mut cdr, base_from_tip);
    cdr.finish()
}

fn header(cdr: &mut Cdr, ms: u64) {
    cdr.i32(i32::try_from(ms / 1000).unwrap_or(i32::MAX));
    cdr.u32((ms % 1000 * 1_000_000) as u32);
    cdr.string(FRAME);
}

fn pose_stamped(cdr: &mut Cdr, ms: u64, frame: &Frame) {
    header(cdr, ms);
    pose(cdr, frame);
}

/// Appends a pose or a transform, which consists of the same numbers.
fn pose(cdr: &mut Cdr, frame: &Frame) {
    let Point3 { coords } = Point3::from(frame.translation.vector);
    let turn = UnitQuaternion::from_rotation_matrix(&frame.rotation);
    for number in [coords.x / 1000.0, coords.y / 1000.0, coords.z / 1000.0, turn.i, turn.j, turn.k, turn.w] {
        cdr.f64(number);
    }
}

fn marker(ms: u64, index: usize, middle: &Frame, size: [f64; 3], color: [f64; 3]) -> Vec<u8> {
    let mut cdr = Cdr::new();
    header(&mut cdr, ms);
    cdr.string("layers");
    for number in [index as i32, CYLINDER, ADD] {
        cdr.i32(number);
    }
    pose(&mut cdr, middle);
    size.iter().for_each(|mm| cdr.f64(mm / 1000.0));
    color.iter().chain([&1.0]).for_each(|part| cdr.f32(*part as f32));
    // The marker has no end of life and moves with its frame.
    cdr.i32(0);
    cdr.u32(0);
    cdr.u8(1);
    // The marker has no points, no colours of points and no texture (name, image and coordinates).
    cdr.u32(0);
    cdr.u32(0);
    cdr.string("");
    cdr.i32(0);
    cdr.u32(0);
    cdr.string("");
    cdr.string("");
    cdr.u32(0);
    cdr.u32(0);
    // The marker has no text and no mesh (location, name and bytes).
    cdr.string("");
    cdr.string("");
    cdr.string("");
    cdr.u32(0);
    cdr.u8(0);
    cdr.finish()
}

fn diagnostic(ms: u64, level: LogLevel, [name, message, hardware]: [&str; 3], values: &[(&str, String)]) -> Vec<u8> {
    let mut cdr = Cdr::new();
    header(&mut cdr, ms);
    cdr.u32(1);
    cdr.u8(match level {
        LogLevel::Info => 0,
        LogLevel::Warning => 1,
        LogLevel::Error => 2,
    });
    [name, message, hardware].iter().for_each(|text| cdr.string(text));
    cdr.u32(values.len() as u32);
    for (key, value) in values {
        cdr.string(key);
        cdr.string(value);
    }
    cdr.finish()
}

/// Returns the known values of the board's status.
fn values(status: &BoardStatus) -> Vec<(&'static str, String)> {
    let BoardStatus { fault, pause_cause, temperature_c, target_c, laid, uptime_ms, .. } = status;
    let values = [
        ("fault", fault.clone()),
        ("pause_cause", pause_cause.clone()),
        ("temperature_c", temperature_c.map(|celsius| celsius.to_string())),
        ("target_c", target_c.map(|celsius| celsius.to_string())),
        ("laid", laid.map(|layers| layers.to_string())),
        ("uptime_ms", uptime_ms.map(|ms| ms.to_string())),
    ];
    values.into_iter().filter_map(|(key, value)| Some((key, value?))).collect()
}
