//! What a host asks for.

use heapless::Vec;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::LayerBatch;
use crate::plan::Planner;
use crate::pose::{Pose, PoseError};

/// Who a host is, in a few words: program, machine, process. UTF-8, but taken as bytes by the board.
pub type HostName = Vec<u8, 32>;

/// Opens a session. One that another host holds is taken only if asked for, or once that host has been silent.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct HostHello {
    /// The host's [`SCHEMA_HASH`](super::SCHEMA_HASH).
    pub schema: u64,
    /// Who it is: told to another host that wants the board.
    pub host: HostName,
    /// Take the board over from a host that holds it.
    pub take_over: bool,
}

/// Begins a job: the board forgets the one before. Repeating it changes nothing.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Begin {
    /// Hash of the plan's layers ([`crate::job::JobSummary`]).
    pub plan_id: u64,
    /// How many layers the plan has.
    pub layers: u32,
    /// Hash of the robot that the plan is for.
    pub robot: u64,
}

/// Takes up the job that the board knows: after a loss of the line or of the host it is followed on; after a stop, a
/// fault or a reset it goes on, with the layers that the board does not hold any more handed over anew.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Resume {
    /// The job.
    pub plan_id: u64,
    /// The layer to go on at, while the board rests: the first that is not laid, or, where that one was cut, the one
    /// after it, so that the cut one is let be. While the board works, any.
    pub from: u32,
    /// The host has the layers below this as built: events tell the others.
    pub known: u32,
}

/// Hands over layers. Those that the board already has are passed over.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Layers {
    /// The job.
    pub plan_id: u64,
    /// Index of the first of them, from 0.
    pub first: u32,
    /// The layers.
    pub layers: LayerBatch,
}

/// Replaces the layers from an index on, all at once: those that were held from there on are gone, and the plan has
/// another name. More layers follow with [`Layers`], under the new name.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Amend {
    /// The job as it was.
    pub plan_id: u64,
    /// The job from now on.
    pub amended: u64,
    /// Index of the first layer that is another one; it must not have been begun.
    pub from: u32,
    /// How many layers the plan has now.
    pub layers: u32,
    /// The first of the new layers.
    pub first_layers: LayerBatch,
}

/// What a board does when its host falls silent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, Schema)]
pub enum Silence {
    /// Finishes the layer under way and holds, as if asked to.
    #[default]
    Hold,
    /// Goes on to the last layer that it has.
    GoOn,
}

/// Starts the job that is held, or goes on with it after a hold.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Start {
    /// The job.
    pub plan_id: u64,
    /// What to do when the host falls silent.
    pub silence: Silence,
}

/// Gives a job up: heater and steppers off, and the board forgets it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Cancel {
    /// The job.
    pub plan_id: u64,
}

/// A pose on the link: mm and radians.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, Schema)]
pub struct PoseFields {
    /// x, y, z, mm.
    pub position: [f64; 3],
    /// Radians.
    pub heading: f64,
    /// Radians.
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

/// Has the board plan by itself and hold the layers as its job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct PlanRequest {
    /// From here.
    pub start: PoseFields,
    /// To there.
    pub goal: PoseFields,
    /// With this radius, mm.
    pub radius: f64,
    /// By this planner.
    pub planner: Planner,
}

/// Asks for layers that the board holds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct ReadLayers {
    /// Index of the first wanted.
    pub first: u32,
}

/// Finds the gains of the heater's regulation at a temperature, by driving the nozzle round it. The gains are told, not
/// taken: a robot's description is the only place that they come from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, Schema)]
pub struct Tune {
    /// The temperature, hundredths of a degree Celsius.
    pub target_centi_c: i32,
}
