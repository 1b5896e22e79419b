//! Channels of a recording: topics, JSON Schemas, and messages.
//!
//! Poses and scenes have the message types that Foxglove draws (<https://docs.foxglove.dev/docs/sdk/schemas>): metres,
//! in the frame `base`, z up. growbot's own fields are in mm and degrees, as their names state. Unknown values are left
//! out.

use growbot_core::pose::Frame;
use growbot_plan::run_log::BoardStatus;
use nalgebra::{Point3, UnitQuaternion};
use serde::Serialize;
use serde_json::{Map, Value, json};
use strum::{IntoStaticStr, VariantArray};

/// Name of the frame of all poses: the robot's base.
pub const FRAME: &str = "base";

/// A channel of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "kebab-case", prefix = "/")]
pub enum Topic {
    /// Pose at the start of the body.
    Start,
    /// Pose of the goal.
    Goal,
    /// Pose of the tip: according to the steps, or on a simulated tip as its plastic lies.
    Tip,
    /// Pose that a simulated tip would have if its plastic lay as commanded.
    Commanded,
    /// The planned centreline.
    Plan,
    /// The growing wall, a disc for each layer.
    Body,
    /// Values of each layer that was laid.
    Layers,
    /// State and temperatures of the board.
    Status,
    /// Each fault, when it occurs.
    Faults,
    /// All other events, as text.
    Events,
}

impl Topic {
    /// All channels.
    pub const ALL: [Self; 10] = *Self::VARIANTS.as_array().unwrap();

    /// Returns the channel's name.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Returns name and JSON Schema of the channel's messages.
    pub fn schema(self) -> (&'static str, Value) {
        match self {
            Self::Start | Self::Goal | Self::Tip | Self::Commanded => ("foxglove.PoseInFrame", pose_in_frame_schema()),
            Self::Plan | Self::Body => ("foxglove.SceneUpdate", scene_schema()),
            Self::Layers => ("growbot.Layer", layer_schema()),
            Self::Status => ("growbot.Status", status_schema()),
            Self::Faults => {
                let text = json!({ "type": "string" });
                (
                    "growbot.Fault",
                    object(&[("timestamp", time_schema()), ("code", text.clone()), ("explanation", text)]),
                )
            }
            Self::Events => ("foxglove.Log", log_schema()),
        }
    }
}

/// Importance of an event. The values are those of `foxglove.Log`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LogLevel {
    /// A normal event.
    Info = 2,
    /// An event that needs attention.
    Warning = 3,
    /// A failure.
    Error = 4,
}

/// Returns the field of a message for a time, ms since the beginning of the recording.
pub fn time(ms: u64) -> Value {
    json!({ "sec": ms / 1000, "nsec": ms % 1000 * 1_000_000 })
}

/// Returns a `foxglove.PoseInFrame` message with the pose of the tip at a time, ms.
pub fn pose_in_frame(ms: u64, base_from_tip: &Frame) -> Value {
    json!({ "timestamp": time(ms), "frame_id": FRAME, "pose": pose(base_from_tip) })
}

/// Returns a `growbot.Status` message with the known values of the board's status at a time, ms.
pub fn status(ms: u64, status: &BoardStatus) -> Value {
    let BoardStatus { state, fault, pause_cause, temperature_c, target_c, laid, uptime_ms, finish_utc } = status;
    let mut message = json!({ "timestamp": time(ms) });
    add_known(&mut message, "state", state.as_deref());
    add_known(&mut message, "fault", fault.as_deref());
    add_known(&mut message, "pause_cause", pause_cause.as_deref());
    add_known(&mut message, "temperature_c", *temperature_c);
    add_known(&mut message, "target_c", *target_c);
    add_known(&mut message, "laid", *laid);
    add_known(&mut message, "uptime_ms", *uptime_ms);
    add_known(&mut message, "finish_utc", finish_utc.as_deref());
    message
}

/// Adds a field to a message, unless its value is `None`.
pub fn add_known(message: &mut Value, field: &str, value: Option<impl Serialize>) {
    if let Some(value) = value {
        message[field] = json!(value);
    }
}

/// Returns a `foxglove.Log` message about an event at a time, ms.
pub fn log(ms: u64, level: LogLevel, message: &str) -> Value {
    json!({ "timestamp": time(ms), "level": level as u8, "message": message, "name": "growbot", "file": "", "line": 0 })
}

/// Returns a `foxglove.SceneUpdate` message with a disc for a layer. `base_from_middle` is the frame of the disc's
/// centre, `diameter` and `height` are in mm, and `color` is RGB from 0 to 1.
pub fn disc(ms: u64, id: &str, base_from_middle: &Frame, diameter: f64, height: f64, color: [f64; 3]) -> Value {
    let size = json!({ "x": diameter / 1000.0, "y": diameter / 1000.0, "z": height / 1000.0 });
    let cylinder = json!({
        "pose": pose(base_from_middle), "size": size, "bottom_scale": 1.0, "top_scale": 1.0, "color": rgba(color),
    });
    scene(ms, id, "cylinders", &cylinder)
}

/// Returns a `foxglove.SceneUpdate` message with a line through points (mm). `color` is RGB from 0 to 1.
pub fn line(ms: u64, id: &str, points: impl Iterator<Item = Point3<f64>>, color: [f64; 3]) -> Value {
    let points: Vec<Value> = points.map(|point| metres(&point)).collect();
    let line = json!({
        "type": 0, "pose": pose(&Frame::identity()), "thickness": 2.0, "scale_invariant": true,
        "points": points, "color": rgba(color), "colors": [], "indices": [],
    });
    scene(ms, id, "lines", &line)
}

/// Returns a `foxglove.SceneUpdate` message with one entity that has one primitive. The lists of the other types of
/// primitives are present but empty, because Foxglove expects them.
fn scene(ms: u64, id: &str, kind: &str, primitive: &Value) -> Value {
    let mut entity = json!({
        "timestamp": time(ms), "frame_id": FRAME, "id": id, "lifetime": { "sec": 0, "nsec": 0 }, "frame_locked": true, "metadata": [],
    });
    for list in PRIMITIVES {
        entity[list] = if list == kind { json!([primitive]) } else { json!([]) };
    }
    json!({ "deletions": [], "entities": [entity] })
}

const PRIMITIVES: [&str; 8] = ["arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models"];

fn pose(base_from_tip: &Frame) -> Value {
    let turn = UnitQuaternion::from_rotation_matrix(&base_from_tip.rotation);
    json!({
        "position": metres(&base_from_tip.translation.vector.into()),
        "orientation": { "x": turn.i, "y": turn.j, "z": turn.k, "w": turn.w },
    })
}

fn metres(point: &Point3<f64>) -> Value {
    json!({ "x": point.x / 1000.0, "y": point.y / 1000.0, "z": point.z / 1000.0 })
}

fn rgba([r, g, b]: [f64; 3]) -> Value {
    json!({ "r": r, "g": g, "b": b, "a": 1.0 })
}

fn object(fields: &[(&str, Value)]) -> Value {
    let fields: Map<String, Value> =
        fields.iter().map(|(name, schema)| ((*name).to_string(), schema.clone())).collect();
    json!({ "type": "object", "properties": fields })
}

fn list(items: &Value) -> Value {
    json!({ "type": "array", "items": items })
}

fn numbers(names: &[&str]) -> Value {
    object(&names.iter().map(|name| (*name, json!({ "type": "number" }))).collect::<Vec<_>>())
}

/// Returns the JSON Schema of a time or duration in seconds and nanoseconds. Foxglove identifies times and durations by
/// their titles.
fn seconds(title: &str) -> Value {
    let mut schema = object(&[("sec", json!({ "type": "integer" })), ("nsec", json!({ "type": "integer" }))]);
    schema["title"] = title.into();
    schema
}

fn time_schema() -> Value {
    seconds("time")
}

fn pose_schema() -> Value {
    object(&[("position", numbers(&["x", "y", "z"])), ("orientation", numbers(&["x", "y", "z", "w"]))])
}

fn pose_in_frame_schema() -> Value {
    object(&[("timestamp", time_schema()), ("frame_id", json!({ "type": "string" })), ("pose", pose_schema())])
}

fn log_schema() -> Value {
    let (text, whole) = (json!({ "type": "string" }), json!({ "type": "integer" }));
    object(&[
        ("timestamp", time_schema()),
        ("level", whole.clone()),
        ("message", text.clone()),
        ("name", text.clone()),
        ("file", text),
        ("line", whole),
    ])
}

fn scene_schema() -> Value {
    let (text, yes_no, number) =
        (json!({ "type": "string" }), json!({ "type": "boolean" }), json!({ "type": "number" }));
    let color = numbers(&["r", "g", "b", "a"]);
    let point = numbers(&["x", "y", "z"]);
    let cylinder = object(&[
        ("pose", pose_schema()),
        ("size", point.clone()),
        ("bottom_scale", number.clone()),
        ("top_scale", number.clone()),
        ("color", color.clone()),
    ]);
    let line = object(&[
        ("type", json!({ "type": "integer" })),
        ("pose", pose_schema()),
        ("thickness", number),
        ("scale_invariant", yes_no.clone()),
        ("points", list(&point)),
        ("color", color.clone()),
        ("colors", list(&color)),
        ("indices", list(&json!({ "type": "integer" }))),
    ]);
    let mut entity = object(&[
        ("timestamp", time_schema()),
        ("frame_id", text.clone()),
        ("id", text.clone()),
        ("lifetime", seconds("duration")),
        ("frame_locked", yes_no),
        ("metadata", list(&object(&[("key", text.clone()), ("value", text.clone())]))),
    ]);
    for kind in PRIMITIVES {
        entity["properties"][kind] = match kind {
            "cylinders" => list(&cylinder),
            "lines" => list(&line),
            _ => list(&object(&[])),
        };
    }
    let deletion = object(&[("timestamp", time_schema()), ("type", json!({ "type": "integer" })), ("id", text)]);
    object(&[("deletions", list(&deletion)), ("entities", list(&entity))])
}

fn layer_schema() -> Value {
    let (number, whole) = (json!({ "type": "number" }), json!({ "type": "integer" }));
    object(&[
        ("timestamp", time_schema()),
        ("layer", whole.clone()),
        ("alpha_deg", number.clone()),
        ("height_mm", number.clone()),
        ("tilt_deg", number.clone()),
        ("source", json!({ "type": "string" })),
        ("planned_alpha_deg", number.clone()),
        ("planned_height_mm", number.clone()),
        ("planned_tilt_deg", number.clone()),
        ("commanded_alpha_deg", number.clone()),
        ("commanded_height_mm", number.clone()),
        ("commanded_tilt_deg", number),
        ("filament_pulses", whole.clone()),
        ("gravity_milli_g", list(&whole)),
    ])
}

fn status_schema() -> Value {
    let (number, whole, text) =
        (json!({ "type": "number" }), json!({ "type": "integer" }), json!({ "type": "string" }));
    object(&[
        ("timestamp", time_schema()),
        ("state", text.clone()),
        ("fault", text.clone()),
        ("pause_cause", text.clone()),
        ("temperature_c", number.clone()),
        ("target_c", number),
        ("laid", whole.clone()),
        ("uptime_ms", whole),
        ("finish_utc", text),
    ])
}
