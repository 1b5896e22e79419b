//! A body at whose tip another body begins.

use growbot_core::layer::grow;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::message::Fault;
use growbot_core::path::Segment;
use growbot_core::pose::{Frame, Pose};

use crate::job::Job;
use crate::plan::{ExistingBody, MAX_EXISTING_LAYERS, Plan, segments};
use crate::plan_file::PlanFileError;
use crate::replayed_body::ReplayedBody;
use crate::run_log::{OutcomeKind, RecordedRun};

/// Maximum difference between the frames of a tip and of the start of a plan, mm and radians: the rounding of angles in
/// files.
const AT_THE_TIP: f64 = 1e-6;

/// Faults after which the latest layers may differ from the steps of the motors.
const MOTION_FAULTS: [Fault; 6] = [
    Fault::IndexMissing,
    Fault::IndexStuck,
    Fault::HeadStepsLost,
    Fault::FilamentJam,
    Fault::DriverFault,
    Fault::StepsStalled,
];

/// Reason why no body can begin at the tip of another one.
#[derive(Debug, thiserror::Error)]
pub enum UnknownTipError {
    /// Nothing is laid.
    #[error("no layer of the body is laid: begin a new body")]
    NoLayer,
    /// The latest layer was interrupted.
    #[error("layer {layer} of the body was interrupted, so its tip is not known: resume the body, or begin a new one")]
    Interrupted {
        /// Index of the layer, from 0.
        layer: usize,
    },
    /// Nothing is known of some layers.
    #[error("nothing is known of {count} layers of the body, so its tip is not known: begin a new body")]
    UnknownLayers {
        /// Number of the layers.
        count: usize,
    },
    /// The growth ended with a fault after which the positions of the motors are not known.
    #[error("the growth ended with the fault {fault}, so the tip of the body is not known: begin a new body")]
    MotionFault {
        /// Code of the fault.
        fault: String,
    },
    /// Nothing is known of the end of the growth.
    #[error("the outcome of the growth is {outcome}, so the tip of the body is not known: begin a new body")]
    UnknownEnd {
        /// Outcome of the growth.
        outcome: OutcomeKind,
    },
    /// The body has too many layers.
    #[error("the body has {count} layers, and a plan can begin at a body of {MAX_EXISTING_LAYERS}: begin a new body")]
    TooManyLayers {
        /// Number of the layers, with those of the body at whose tip it began.
        count: usize,
    },
    /// The plan of the body is not valid.
    #[error(transparent)]
    Plan(#[from] PlanFileError),
}

/// A body at whose tip another body begins.
#[derive(Debug, Clone, PartialEq)]
pub struct ContinuedBody {
    /// Layers of the body, and before them those of the body at whose tip it began, as the steps of the motors have
    /// built them.
    pub layers: Vec<LayerBytes>,
    segments: Vec<Segment>,
    base_from_tip: Frame,
}

impl ContinuedBody {
    /// Rebuilds the body of a run log. Its tip is that of the plastic of a simulated robot, except for the twist that a
    /// disturbance adds, or else the one that the feedback has estimated, or else the one that follows from the steps
    /// of the motors.
    ///
    /// # Errors
    /// If the tip of the body is not known.
    pub fn of(record: &RecordedRun) -> Result<Self, UnknownTipError> {
        let body = ReplayedBody::of(record);
        match record.outcome() {
            OutcomeKind::Done
            | OutcomeKind::Stopped
            | OutcomeKind::ClockDrift
            | OutcomeKind::Fault
            | OutcomeKind::Parked => {}
            outcome => return Err(UnknownTipError::UnknownEnd { outcome }),
        }
        let fault = record.result.as_ref().and_then(|result| result.fault.clone());
        if let Some(fault) = fault.filter(|fault| MOTION_FAULTS.iter().any(|known| known.code() == fault)) {
            return Err(UnknownTipError::MotionFault { fault });
        }
        if let Some(interrupted) = record.result.as_ref().and_then(|result| result.interrupted) {
            return Err(UnknownTipError::Interrupted { layer: interrupted.layer });
        }
        match record.unknown_layers() {
            0 if record.as_built.is_empty() => return Err(UnknownTipError::NoLayer),
            0 => {}
            count => return Err(UnknownTipError::UnknownLayers { count }),
        }
        let robot = record.own_robot()?;
        let plan = record.plan(&robot)?;
        let estimated = if body.simulated.is_none() {
            record.estimated(&Job::of_plan(&robot, &plan), &plan).and_then(|frames| frames.last().copied())
        } else {
            None
        };
        let base_from_tip = estimated.unwrap_or_else(|| grow(&plan.start.frame(), body.body().iter().copied()));
        let layers: Vec<LayerBytes> = plan.existing_layers.iter().copied().chain(record.commanded()).collect();
        if layers.len() > MAX_EXISTING_LAYERS {
            return Err(UnknownTipError::TooManyLayers { count: layers.len() });
        }
        Ok(Self { segments: segments(&layers), layers, base_from_tip })
    }

    /// Reports whether a plan begins at the tip of this body.
    pub fn is_continued_by(&self, plan: &Plan) -> bool {
        let off = self.base_from_tip.to_homogeneous() - plan.start.frame().to_homogeneous();
        plan.existing_layers == self.layers && off.amax() <= AT_THE_TIP
    }

    /// Returns the pose of the tip, with its roll.
    pub fn tip(&self) -> Pose {
        Pose::from_frame_with_roll(&self.base_from_tip)
    }

    /// Returns the body as an obstacle for a path that begins at its tip.
    pub fn existing(&self) -> ExistingBody<'_> {
        ExistingBody { segments: &self.segments, base_from_tip: &self.base_from_tip }
    }
}
