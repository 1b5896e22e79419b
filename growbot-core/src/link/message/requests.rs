//! The requests of a host.

use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::layer_batch::LayerBatch;
use crate::plan::Planner;
use crate::pose::{Pose, PoseError};

/// Name of a host: program, process, machine. It is UTF-8, which the board does not check.
pub type HostName = Vec<u8, 32>;

/// Opens a session. The board refuses the request if another host owns the board, unless this other host has stopped
/// sending or `take_over` is set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Hello {
    /// The host's [`SCHEMA_HASH`](super::SCHEMA_HASH).
    pub schema: u64,
    /// Name of the host. The board reports it to other hosts that request a session.
    pub host: HostName,
    /// True to take the board over from a host that owns it.
    pub take_over: bool,
}

/// Begins a job. The board deletes the previous job. If the same request is repeated, the board changes nothing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct BeginJob {
    /// Identifier of the job: the hash of the plan's layers ([`crate::job::JobSummary`]).
    pub plan_id: u64,
    /// Number of layers of the plan.
    pub layers: u32,
    /// Hash of the robot for which the plan was made.
    pub robot_hash: u64,
}

/// Resumes the job that the board stores. After a loss of the link or of the host, the host receives the events of the
/// job again. After a stop, a fault or a reset, the host first sends the layers that the board no longer stores, and
/// then starts the job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Resume {
    /// Identifier of the job.
    pub plan_id: u64,
    /// Index of the layer at which the job resumes: the first that is not laid or, to skip an interrupted layer, the
    /// one after it. The board ignores this field while the job is in progress.
    pub start_layer: u32,
    /// Number of layers whose as-built data the host has, counted from the first layer. The board sends events for the
    /// other layers.
    pub reported_layers: u32,
}

/// Sends layers of the job. The board ignores layers that it has received before.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct AppendLayers {
    /// Identifier of the job.
    pub plan_id: u64,
    /// Index in the job of the first layer in this message, counted from 0.
    pub first: u32,
    /// The layers of this message.
    pub layers: LayerBatch,
}

/// Replaces all layers from an index on in one operation. The board deletes the stored layers from that index on, and
/// the job gets a new identifier. More layers follow with [`AppendLayers`], under the new identifier.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Amend {
    /// Identifier of the job before the change.
    pub plan_id: u64,
    /// Identifier of the job after the change.
    pub new_plan_id: u64,
    /// Index of the first layer that is replaced. The board must not have begun it.
    pub first_replaced: u32,
    /// Number of layers of the amended plan.
    pub layers: u32,
    /// The first layers that replace the previous ones. More of them follow with `AppendLayers`.
    pub first_layers: LayerBatch,
}

/// Action of a board when its host stops sending.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
pub enum HostSilencePolicy {
    /// Pauses after the present layer.
    #[default]
    Pause,
    /// Continues to lay the layers that the board has received.
    Continue,
}

/// Starts the job that the board stores, or continues it after a pause.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Start {
    /// Identifier of the job.
    pub plan_id: u64,
    /// Action of the board when the host stops sending.
    pub on_host_silence: HostSilencePolicy,
    /// True if no person has ordered this start. The board then refuses it where only a person may continue
    /// ([`PauseCause::allows_continuation`](super::PauseCause::allows_continuation)), so a start that arrives late does
    /// not heat a parked board.
    pub is_continuation: bool,
}

/// Cancels a job. The board switches heater and steppers off and deletes the job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Cancel {
    /// Identifier of the job.
    pub plan_id: u64,
}

/// A pose in a message.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct PoseFields {
    /// Position x, y, z, mm.
    pub position: [f64; 3],
    /// Heading, rad.
    pub heading: f64,
    /// Pitch, rad, -pi/2 to pi/2.
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

/// Requests that the board plans by itself and stores the layers as its job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct PlanRequest {
    /// The start pose.
    pub start: PoseFields,
    /// The goal pose.
    pub goal: PoseFields,
    /// The planning radius, mm.
    pub radius: f64,
    /// The planner to use.
    pub planner: Planner,
}

/// Requests a maintenance task.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Maintain {
    /// Task to perform.
    pub task: MaintenanceTask,
}

/// A maintenance task. The board limits the time of each task, and chooses the speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum MaintenanceTask {
    /// Heats the nozzle. In a pause, it heats the nozzle back to the growing temperature.
    Preheat {
        /// Target temperature, hundredths of a degree Celsius.
        target_centi_c: i32,
    },
    /// Switches heater and motors off.
    CoolDown,
    /// Turns the head until it finds its index mark.
    Home,
    /// Turns the head.
    Rotate {
        /// Angle of the rotation, hundredths of a degree, positive counter-clockwise, up to a turn to either side.
        centi_deg: i32,
    },
    /// Moves filament: forwards to load or purge, backwards to unload.
    Feed {
        /// Length of filament to move, um. Positive is forwards.
        um: i32,
    },
    /// Allows head and feed to move with the heater off and the nozzle at any temperature, until `CoolDown` or
    /// `Preheat`. It serves to commission a robot whose nozzle contains nothing that could hold the head.
    DryRun,
}

/// Max number of bytes of a robot description in one `Configure`.
pub const MAX_DESCRIPTION_PART: usize = 192;

/// Sends a part of a robot description that replaces the description of the board. The parts follow each other in
/// order. After the last part the board checks the description as it checks a robot file, and writes it to flash. Then
/// it responds and restarts with the new description.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Configure {
    /// Hash of the description ([`crate::robot::Robot::hash`]).
    pub robot: u64,
    /// Number of bytes of the whole description, with the version of its encoding
    /// ([`crate::robot::Robot::encode_for_board`]).
    pub length: u16,
    /// Position of this part in the encoded description: the index of its first byte, counted from 0.
    pub offset: u16,
    /// The bytes of this part.
    pub bytes: Vec<u8, MAX_DESCRIPTION_PART>,
}

/// Requests layers that the board stores.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct ReadLayers {
    /// Index of the first requested layer.
    pub first: u32,
}

/// Finds the gains of the heater's controller at a temperature, round which the board makes the nozzle oscillate. The
/// board only reports the gains, with the event `Tuned`. It continues to control the heater with the gains of the
/// robot's description.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Tune {
    /// Temperature round which the nozzle oscillates, hundredths of a degree Celsius.
    pub target_centi_c: i32,
}
