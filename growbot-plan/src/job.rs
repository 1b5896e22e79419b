//! A job of a board, the amendments and commands that change it, and its events.

use growbot_core::job::{job_layers, plan_id};
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::crash::CrashWords;
use growbot_core::link::message::{BoardInfo, LayerReadings, MaintenanceTask, State, Status};
use growbot_core::path::{Segment, length};
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr, VariantArray};

use crate::clearance_guard::{ClearanceViolation, Detour};
use crate::feedback::EncoderReference;
use crate::plan::Plan;
use crate::robot_file::MaterialPreset;

/// A job: the layers of a path, which a robot's board has to lay.
#[derive(Debug, Clone, PartialEq)]
pub struct Job<'a> {
    /// Robot that lays the layers.
    pub robot: &'a Robot,
    /// Pose at which the body begins.
    pub start: &'a Pose,
    /// Pose that the tip should have after the last layer.
    pub goal: &'a Pose,
    /// Length of the path from start to goal, mm.
    pub length: f64,
    /// Plan id: the hash of the robot's description and the layers.
    pub plan_id: u64,
    /// Layers in order, each in the 12 bytes of the link.
    pub layers: Vec<LayerBytes>,
}

impl<'a> Job<'a> {
    /// Creates the job of a plan. `robot` must be the robot for which the plan was made.
    pub fn of_plan(robot: &'a Robot, plan: &'a Plan) -> Self {
        Self::new(robot, &plan.start, &plan.goal, &plan.path)
    }

    /// Creates the job of a path from `start` to `goal`, whose layers are computed for this robot.
    pub fn new(robot: &'a Robot, start: &'a Pose, goal: &'a Pose, path: &[Segment]) -> Self {
        let layers: Vec<LayerBytes> = job_layers(path, robot).collect();
        Self { robot, start, goal, length: length(path), plan_id: plan_id(robot, &layers), layers }
    }
}

/// An event of a job.
#[derive(Debug, Clone, PartialEq)]
pub enum JobEvent {
    /// The board reported that it changed to this state.
    State(State),
    /// The board reported its identity and state, when a session was opened.
    Board(BoardInfo),
    /// The board has restarted because its firmware crashed. Contains the recorded crash.
    Crash(CrashWords),
    /// The board reported its status, which the host requests when no events arrive.
    Status(Status),
    /// The board has laid a layer.
    Laid {
        /// Index of the layer, from 0.
        index: u32,
        /// The layer as built. `None` if it is unknown.
        as_built: Option<LayerBytes>,
        /// Sensor readings of the board after the layer. `None` without readings.
        measured: Option<LayerReadings>,
    },
    /// Simulated layers with their errors, as the plastic of a simulated tip lies. A layer is reported once it no
    /// longer changes; the last layers are reported at the end.
    Simulated {
        /// Index of the first layer.
        from: u32,
        /// The layers with their errors.
        layers: Vec<Layer>,
    },
    /// The feedback measures growth from this reading of the filament's encoder on.
    EncoderReference(EncoderReference),
    /// An amendment is about to be sent to the board. It takes effect unless `AmendmentRejected` follows.
    Amendment(Amendment),
    /// The board has not accepted the latest amendment. Contains the reason, or `None` if the amendment only arrived
    /// too late.
    AmendmentRejected(Option<String>),
    /// With feedback in a scene: the remaining layers follow another path, because the previous path would be too near
    /// to an obstacle.
    Detour(Detour),
    /// With feedback in a scene: the remaining layers would be too near to an obstacle and no other path was found, so
    /// the board is commanded to pause.
    ClearanceViolation(ClearanceViolation),
    /// With feedback: further layers of the job, after those in its latest amendment, are sent to the board.
    LayersSent {
        /// Index of the first layer.
        from: u32,
        /// The sent layers, each in the 12 bytes of the link.
        layers: Vec<LayerBytes>,
    },
    /// A command of a user is about to be executed.
    Command(Command),
    /// The latest command of a user failed. Contains the reason.
    CommandFailed(String),
    /// The board does not respond. The host tries to reconnect.
    NoResponse,
    /// The board responds again.
    Reconnected,
}

/// Amendment of a job: a replacement of its layers from an index on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
pub struct Amendment {
    /// New plan id of the job.
    #[serde(with = "crate::hexadecimal::hash")]
    #[cfg_attr(feature = "schema", schemars(with = "String", extend("pattern" = r"^[0-9a-f]{16}$")))]
    pub plan_id: u64,
    /// Index of the first replaced layer.
    pub from: u32,
    /// Total number of layers of the job after the amendment.
    pub total: u32,
    /// The first replacement layers, at most 64. The other ones are sent later.
    #[serde(with = "crate::hexadecimal::layers")]
    #[cfg_attr(feature = "schema", schemars(with = "String", extend("pattern" = r"^([0-9a-f]{24})*$")))]
    pub layers: Vec<LayerBytes>,
}

/// A command of a user during a growth.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, EnumString, IntoStaticStr, VariantArray,
)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
#[repr(u8)]
pub enum Command {
    /// Continue after a pause.
    Continue = 1,
    /// Pause after the layer in progress.
    Pause,
    /// In a pause: heat the nozzle, to change filament.
    Preheat,
    /// In a pause: pull filament out.
    Unload,
    /// In a pause: push filament in.
    Load,
    /// In a pause: push filament through the nozzle.
    Purge,
    /// Switch heater and steppers off. The body can be resumed.
    Stop,
    /// Switch heater and steppers off before anything else. The board stays off until the stop is cleared.
    EmergencyStop,
}

impl Command {
    /// All commands.
    pub const ALL: [Self; 8] = *Self::VARIANTS.as_array().unwrap();

    /// Returns the name of the command in URLs and run logs.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Returns the board's maintenance task for this command, with the lengths of the default material preset. `None`
    /// for a command that is not a maintenance task.
    pub fn task(self, robot: &Robot) -> Option<MaintenanceTask> {
        let MaterialPreset { load_mm, unload_mm, purge_mm, .. } = MaterialPreset::default();
        let feed = |mm: f64| MaintenanceTask::Feed { um: (mm * 1000.0).round() as i32 };
        match self {
            Self::Preheat => {
                let target_centi_c = (robot.description().heater.target_c * 100.0).round() as i32;
                Some(MaintenanceTask::Preheat { target_centi_c })
            }
            Self::Unload => Some(feed(-unload_mm)),
            Self::Load => Some(feed(load_mm)),
            Self::Purge => Some(feed(purge_mm)),
            Self::Continue | Self::Pause | Self::Stop | Self::EmergencyStop => None,
        }
    }

    /// Reports whether the command may be sent again if the connection was lost before its response. Moves of filament
    /// may not, because they might be executed twice.
    pub fn may_be_repeated(self) -> bool {
        !matches!(self, Self::Unload | Self::Load | Self::Purge)
    }
}
