//! Lines of a run log, which [`RunLog`](super::RunLog) writes and [`Events`](super::Events) reads.
//!
//! Fields that are added later are optional, and readers skip events that they do not know. A log can therefore be read
//! by a version that is older or newer than the one that has written it.

use growbot_core::angle::degrees;
use growbot_core::kinematics::advance;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_core::link::crash::CrashRecord;
use growbot_core::link::message::{BoardInfo, Fault, LayerReadings, Status, celsius};
use growbot_core::pose::{Frame, Pose};
use serde::{Deserialize, Serialize};

use super::header::{ResumeRecord, RunHeader};
use super::lenient::lenient;
use super::result::{GrowthResult, InterruptedLayerJson};
use crate::clearance_guard::{ClearanceViolation, Detour};
use crate::crash::CrashJson;
use crate::degrees::degrees_below_turn;
use crate::feedback::EncoderReference;
use crate::job::{Amendment, Command, JobEvent};
use crate::plan_file::TipPoseJson;

/// A line of a run log: an event, and the date and time at which it was written.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct RunLine {
    /// The event.
    #[serde(flatten)]
    pub event: RunEvent,
    /// Date and time at which the line was written, RFC 3339 with milliseconds.
    #[serde(default, deserialize_with = "lenient")]
    #[cfg_attr(feature = "schema", schemars(with = "String"))]
    pub utc: Option<String>,
}

/// An event of a run log.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(tag = "event", rename_all = "kebab-case")]
pub enum RunEvent {
    /// The first line: versions, command, robot, plan and the layers that were sent.
    Header(Box<RunHeader>),
    /// The board reported its identity.
    Board(BoardRecord),
    /// The board has restarted because its firmware crashed.
    Crash(Box<CrashJson>),
    /// The board changed its state.
    State {
        /// Name of the state.
        state: String,
    },
    /// The board's status.
    Status(BoardStatus),
    /// A layer was laid.
    Laid(LaidLayer),
    /// A layer of a simulated tip with its errors, as the plastic lies.
    Simulated(SimulatedLayer),
    /// With feedback: growth is measured from this reading of the filament's encoder on.
    EncoderReference(EncoderReference),
    /// With feedback: an amendment is about to be sent. It takes effect unless `amendment-rejected` follows.
    Amendment(Amendment),
    /// The board has refused the latest amendment.
    AmendmentRejected {
        /// Reason of the refusal. Null if the amendment only came too late.
        reason: Option<String>,
    },
    /// With feedback in a scene: the remaining layers follow another path, because the previous path would be too near
    /// to an obstacle.
    Detour(Detour),
    /// With feedback in a scene: the remaining layers would be too near to an obstacle and no other path was found, so
    /// the robot pauses.
    ClearanceViolation(ClearanceViolation),
    /// With feedback: more layers of the job are sent.
    LayersSent {
        /// Index of the first layer.
        from: u32,
        /// The layers, 24 hexadecimal digits each.
        #[serde(with = "crate::hexadecimal::layers")]
        #[cfg_attr(feature = "schema", schemars(with = "String", extend("pattern" = r"^([0-9a-f]{24})*$")))]
        layers: Vec<LayerBytes>,
    },
    /// A command was given and is executed.
    Command {
        /// The command.
        command: Command,
    },
    /// The latest command failed.
    CommandFailed {
        /// Reason of the failure.
        reason: String,
    },
    /// The board does not respond.
    NoResponse,
    /// The board responds again.
    Reconnected,
    /// The growth was resumed here by another program.
    Resumed(ResumeRecord),
    /// The growth has ended.
    End {
        /// Result, as `growbot grow --json` prints it.
        result: Box<GrowthResult>,
    },
}

/// Identity and state of the board when the session was opened, or opened again after a restart of the board.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct BoardRecord {
    /// Version of the firmware: major, minor, patch.
    pub firmware: [u8; 3],
    /// Hash of the schema of the link's messages.
    #[serde(with = "crate::hexadecimal::hash")]
    #[cfg_attr(feature = "schema", schemars(with = "String", extend("pattern" = r"^[0-9a-f]{16}$")))]
    pub schema: u64,
    /// Boot number of this start of the board.
    pub boot_id: u32,
    /// Cause of the start.
    pub reset_cause: String,
    /// Name of the state.
    pub state: String,
    /// Number of laid layers.
    pub laid: u32,
    /// The interrupted layer. Null if none was.
    pub interrupted: Option<InterruptedLayerJson>,
}

impl From<&BoardInfo> for BoardRecord {
    fn from(hello: &BoardInfo) -> Self {
        let status = &hello.status;
        Self {
            firmware: hello.firmware,
            schema: hello.schema_hash,
            boot_id: hello.boot_id,
            reset_cause: hello.reset_cause.name().to_owned(),
            state: status.state.name().to_owned(),
            laid: status.layers_laid,
            interrupted: status.interrupted.map(|layer| InterruptedLayerJson::new(status.layers_laid as usize, layer)),
        }
    }
}

/// The board's status.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct BoardStatus {
    /// Name of the state.
    #[serde(default, deserialize_with = "lenient")]
    pub state: Option<String>,
    /// Code of the fault. Null if there is none.
    #[serde(default, deserialize_with = "lenient")]
    pub fault: Option<String>,
    /// Code of the cause of a pause. Null if the board does not pause.
    #[serde(default, deserialize_with = "lenient")]
    pub pause_cause: Option<String>,
    /// Temperature of the nozzle, C. Null without a reading.
    #[serde(default, deserialize_with = "lenient")]
    pub temperature_c: Option<f64>,
    /// Target temperature, C. Null while the heater is off.
    #[serde(default, deserialize_with = "lenient")]
    pub target_c: Option<f64>,
    /// Number of laid layers.
    #[serde(default, deserialize_with = "lenient")]
    pub laid: Option<u32>,
    /// Time since the board started, ms.
    #[serde(default, deserialize_with = "lenient")]
    pub uptime_ms: Option<u64>,
    /// Expected date and time of the last layer, RFC 3339. Null unless the robot grows at a known pace.
    #[serde(default, deserialize_with = "lenient")]
    pub finish_utc: Option<String>,
}

impl From<&Status> for BoardStatus {
    fn from(status: &Status) -> Self {
        Self {
            state: Some(status.state.name().to_owned()),
            fault: status.fault.map(|fault| Fault::code(fault).to_owned()),
            pause_cause: status.pause().map(|cause| cause.code().to_owned()),
            temperature_c: status.temperature_centi_c.map(celsius),
            target_c: status.target_centi_c.map(celsius),
            laid: Some(status.layers_laid),
            uptime_ms: Some(status.uptime_ms),
            finish_utc: None,
        }
    }
}

/// Dimensions of a layer.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct LayerJson {
    /// Angle in the tip's frame at which most material is laid, degrees. The tube bends away from it.
    pub alpha_deg: f64,
    /// Mean height, mm.
    pub height_mm: f64,
    /// Angle between the lower and the upper side of the layer, degrees.
    pub tilt_deg: f64,
}

/// A layer as the board has built it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct LaidLayer {
    /// Index of the layer, from 0.
    pub layer: u32,
    /// The layer in the bytes of the link, 24 hexadecimal digits. Null if nothing is known of the layer.
    #[serde(default, with = "crate::hexadecimal::layer")]
    #[cfg_attr(feature = "schema", schemars(with = "Option<String>"))]
    pub as_built: Option<LayerBytes>,
    /// Dimensions of the layer.
    #[serde(flatten)]
    pub numbers: Option<LayerJson>,
    /// Sensor readings after the layer, if the line contains them.
    #[serde(flatten)]
    pub measured: Option<MeasuredJson>,
}

impl LaidLayer {
    fn new(index: u32, as_built: Option<LayerBytes>, measured: Option<LayerReadings>) -> Self {
        let numbers = |bytes: &LayerBytes| {
            let Layer { alpha, height, tilt } = decode(bytes);
            LayerJson { alpha_deg: degrees(alpha), height_mm: height, tilt_deg: degrees(tilt) }
        };
        Self {
            layer: index,
            as_built,
            numbers: as_built.as_ref().map(numbers),
            measured: measured.map(|LayerReadings { filament_pulses, gravity_milli_g }| MeasuredJson {
                filament_pulses,
                gravity_milli_g,
            }),
        }
    }
}

/// Sensor readings after a layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct MeasuredJson {
    /// Pulses of the filament's encoder since the board started. Null without an encoder.
    #[serde(default, deserialize_with = "lenient")]
    pub filament_pulses: Option<u32>,
    /// Gravity in the tip's frame, thousandths of g. Null without a sensor.
    #[serde(deserialize_with = "lenient")]
    pub gravity_milli_g: Option<[i16; 3]>,
}

impl From<MeasuredJson> for LayerReadings {
    fn from(written: MeasuredJson) -> Self {
        let MeasuredJson { filament_pulses, gravity_milli_g } = written;
        Self { filament_pulses, gravity_milli_g }
    }
}

/// A layer of a simulated tip with its errors, as the plastic lies.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct SimulatedLayer {
    /// Index of the layer, from 0.
    pub layer: u32,
    /// Dimensions of the layer with its errors.
    #[serde(flatten)]
    pub numbers: LayerJson,
    /// Pose of the tip after the layer.
    #[serde(default, deserialize_with = "lenient")]
    pub tip: Option<TipPoseJson>,
}

/// Converts an event of a job to events of a run log. `laid_tip` is the frame of the simulated tip after the layers
/// that were converted so far, and is updated here.
pub fn to_run_events(event: &JobEvent, laid_tip: &mut Frame) -> Vec<RunEvent> {
    let written = match event {
        JobEvent::Board(hello) => RunEvent::Board(hello.into()),
        JobEvent::Crash(words) => RunEvent::Crash(Box::new((&CrashRecord::from(words)).into())),
        JobEvent::State(state) => RunEvent::State { state: state.name().to_owned() },
        JobEvent::Status(status) => RunEvent::Status(status.into()),
        JobEvent::Laid { index, as_built, measured } => RunEvent::Laid(LaidLayer::new(*index, *as_built, *measured)),
        JobEvent::Simulated { from, layers } => {
            return (*from..).zip(layers).map(|(index, layer)| simulated(index, layer, laid_tip)).collect();
        }
        JobEvent::EncoderReference(count) => RunEvent::EncoderReference(*count),
        JobEvent::Amendment(amendment) => RunEvent::Amendment(amendment.clone()),
        JobEvent::AmendmentRejected(why) => RunEvent::AmendmentRejected { reason: why.clone() },
        JobEvent::Detour(detour) => RunEvent::Detour(detour.clone()),
        JobEvent::ClearanceViolation(too_near) => RunEvent::ClearanceViolation(too_near.clone()),
        JobEvent::LayersSent { from, layers } => RunEvent::LayersSent { from: *from, layers: layers.clone() },
        JobEvent::Command(order) => RunEvent::Command { command: *order },
        JobEvent::CommandFailed(why) => RunEvent::CommandFailed { reason: why.clone() },
        JobEvent::NoResponse => RunEvent::NoResponse,
        JobEvent::Reconnected => RunEvent::Reconnected,
    };
    vec![written]
}

fn simulated(index: u32, layer: &Layer, laid_tip: &mut Frame) -> RunEvent {
    *laid_tip = advance(laid_tip, &layer.step());
    RunEvent::Simulated(SimulatedLayer {
        layer: index,
        numbers: LayerJson {
            alpha_deg: degrees_below_turn(layer.alpha),
            height_mm: layer.height,
            tilt_deg: degrees(layer.tilt),
        },
        tip: Some(TipPoseJson::from(&Pose::from_frame(laid_tip))),
    })
}
