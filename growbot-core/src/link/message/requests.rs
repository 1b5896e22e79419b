//! The requests of a host.

use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::{LayerBatch, MAX_DESCRIPTION_PART};
use crate::plan::Planner;
use crate::pose::{Pose, PoseError};

/// The name of a host: program, process, machine. It is UTF-8, which the board does not check.
pub type HostName = Vec<u8, 32>;

/// Opens a session. A board that another host owns is refused, unless that host has been silent or `take_over` is set.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct HostHello {
    /// The host's [`SCHEMA_HASH`](super::SCHEMA_HASH).
    pub schema: u64,
    /// The host's name. The board tells it to another host that wants the board.
    pub host: HostName,
    /// Whether to take the board over from a host that owns it.
    pub take_over: bool,
}

/// Begins a job. The board forgets the job before. Repeating the request changes nothing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Begin {
    /// The job's id: the hash of the plan's layers ([`crate::job::JobSummary`]).
    pub plan_id: u64,
    /// Number of layers of the plan.
    pub layers: u32,
    /// Hash of the robot that the plan is for.
    pub robot: u64,
}

/// Resumes the job that the board knows. After a loss of the line or of the host, the host follows the job again. After
/// a stop, a fault or a reset, the host hands over again the layers that the board no longer stores, and then starts.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Resume {
    /// The job's id.
    pub plan_id: u64,
    /// The layer to resume at: the first that is not laid or, to let an interrupted layer be, the one after it. The
    /// board ignores this while the job is under way.
    pub from: u32,
    /// The host knows the layers below this index as built. The board sends events for the others.
    pub known: u32,
}

/// Hands over layers. The board ignores those that it already has.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Layers {
    /// The job's id.
    pub plan_id: u64,
    /// Index of the first of them, counted from 0.
    pub first: u32,
    /// The layers.
    pub layers: LayerBatch,
}

/// Replaces the layers from an index on, all at once. The board drops the layers that it stored from there on, and the
/// job gets another id. More layers follow with [`Layers`], under the new id.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Amend {
    /// The job's id so far.
    pub plan_id: u64,
    /// The job's id from now on.
    pub amended: u64,
    /// Index of the first layer that is replaced. It must not have been begun.
    pub from: u32,
    /// Number of layers of the amended plan.
    pub layers: u32,
    /// The first of the new layers.
    pub first_layers: LayerBatch,
}

/// What a board does when its host falls silent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
pub enum Silence {
    /// Pauses after the layer under way.
    #[default]
    Pause,
    /// Continues to the last layer that it has.
    Continue,
}

/// Starts the job that the board stores, or continues it after a pause.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Start {
    /// The job's id.
    pub plan_id: u64,
    /// What the board does when the host falls silent.
    pub silence: Silence,
}

/// Cancels a job: the board switches heater and steppers off and forgets the job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Cancel {
    /// The job's id.
    pub plan_id: u64,
}

/// A pose on the link.
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

/// Asks the board to plan by itself and to store the layers as its job.
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

/// Asks for maintenance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Maintain {
    /// What to do.
    pub task: Task,
}

/// A task of maintenance. The board limits the time of each, and chooses the speed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum Task {
    /// Heats the nozzle; in a pause back to the temperature of growth.
    Preheat {
        /// The temperature, hundredths of a degree Celsius.
        target_centi_c: i32,
    },
    /// Switches heater and motors off.
    CoolDown,
    /// Finds the index mark.
    Home,
    /// Turns the head.
    Rotate {
        /// By this angle, hundredths of a degree; up to a turn to either side.
        centi_deg: i32,
    },
    /// Moves filament: forwards to load or purge, backwards to unload.
    Feed {
        /// By this length, um.
        um: i32,
    },
    /// Lets head and feed move with the heater off, the nozzle hot or not, until `CoolDown` or `Preheat`: for a robot
    /// that is commissioned, with nothing in its nozzle that could hold the head.
    DryRun,
}

/// Hands over a part of a robot's description, which replaces the board's. The parts come in their order. After the last
/// one the board checks the description as a robot file is checked, keeps it in flash, answers, and restarts with it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Configure {
    /// Hash of the description ([`crate::robot::Robot::hash`]).
    pub robot: u64,
    /// Number of bytes of the whole description, with the version of its encoding
    /// ([`crate::robot::Robot::encode_for_board`]).
    pub length: u16,
    /// The first of these bytes, counted from 0.
    pub offset: u16,
    /// The bytes.
    pub bytes: Vec<u8, MAX_DESCRIPTION_PART>,
}

/// Asks for layers that the board stores.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct ReadLayers {
    /// Index of the first layer asked for.
    pub first: u32,
}

/// Finds the gains of the heater's regulation at a temperature, by driving the nozzle round it. The board only reports
/// the gains, by the event `Tuned`: it regulates with those of the robot's description.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Tune {
    /// The temperature to tune at, hundredths of a degree Celsius.
    pub target_centi_c: i32,
}
