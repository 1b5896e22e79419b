//! Beginning of a growth: with a new job, or by resuming the job that the board stores.

use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::message::{BeginJob, BoardInfo, PassiveRequest, Resume, State, Status};
use growbot_core::robot::Robot;
use growbot_plan::feedback::EncoderReference;
use growbot_plan::job::{Job, JobEvent};

use super::{CommandQueue, GrowthError, GrowthOptions, JobRunner, OnInterrupted, is_crash, report_crash};
use crate::client::{Client, ClientError};

impl<'a> JobRunner<'a> {
    /// Begins a new job on the board and sends as many layers as the board can store.
    pub(super) fn begin(
        client: &'a mut Client,
        job: &Job<'a>,
        manner: GrowthOptions<'a>,
        orders: &CommandQueue,
        on_event: &mut dyn FnMut(&JobEvent),
    ) -> Result<Self, GrowthError> {
        let hello = open_session(client, job.robot, on_event)?;
        let Status { plan_id, layers_laid: laid, layer_count: layers, .. } = hello.status;
        if is_unfinished(&hello.status) {
            return Err(GrowthError::Unfinished { plan_id, laid, layers });
        }
        let mut growth = Self::new(client, job, manner, orders, &hello);
        growth.hand_over_all(on_event).map_err(GrowthError::NotStarted)?;
        growth.count_from_here(on_event).map_err(GrowthError::NotStarted)?;
        Ok(growth)
    }

    fn hand_over_all(&mut self, on_event: &mut dyn FnMut(&JobEvent)) -> Result<(), ClientError> {
        let begin = BeginJob {
            plan_id: self.job.plan_id,
            layers: self.job.layers.len() as u32,
            robot_hash: self.job.robot.hash(),
        };
        self.request_accepted("the request to begin a job", &PassiveRequest::BeginJob(begin))?;
        self.hand_over(on_event)
    }

    /// Resumes the job that the board stores. `known` are the layers as built that this host already has.
    pub(super) fn resume(
        client: &'a mut Client,
        job: &Job<'a>,
        known: Vec<Option<LayerBytes>>,
        manner: GrowthOptions<'a>,
        orders: &CommandQueue,
        on_event: &mut dyn FnMut(&JobEvent),
    ) -> Result<Self, GrowthError> {
        let hello = open_session(client, job.robot, on_event)?;
        let interrupted = manner.interrupted;
        let mut growth = Self::new(client, job, manner, orders, &hello);
        if hello.status.plan_id != growth.job.plan_id {
            return Err(GrowthError::nothing_to_resume(growth.job.plan_id, &hello.status));
        }
        growth.built.as_built = known;
        growth.attach(&hello.status, interrupted, on_event).map_err(GrowthError::NotStarted)?;
        Ok(growth)
    }

    /// Reads the filament's encoder and gives the reading to the feedback, unless the feedback already has a reading
    /// since this start of the board.
    fn count_from_here(&mut self, on_event: &mut dyn FnMut(&JobEvent)) -> Result<(), ClientError> {
        let Some(feedback) = self.feedback.as_mut().filter(|feedback| !feedback.counts_since_boot(self.board.boot_id))
        else {
            return Ok(());
        };
        let filament_pulses = self.client.sensors()?.filament_pulses;
        let count = EncoderReference { boot_id: self.board.boot_id, laid: self.built.laid, filament_pulses };
        feedback.set_encoder_reference(&count);
        on_event(&JobEvent::EncoderReference(count));
        Ok(())
    }

    pub(super) fn attach(
        &mut self,
        status: &Status,
        interrupted: OnInterrupted,
        on_event: &mut dyn FnMut(&JobEvent),
    ) -> Result<(), ClientError> {
        let skip = status.interrupted.is_some() && interrupted == OnInterrupted::Skip;
        self.built.laid = status.layers_laid;
        // Layers are reported again from the first unknown one on.
        let known = self.built.as_built.len().min(status.layers_laid as usize);
        self.built.as_built.truncate(known);
        let from = status.layers_laid.saturating_add(u32::from(skip));
        let resume = Resume { plan_id: self.job.plan_id, start_layer: from, reported_layers: known as u32 };
        self.request_accepted("the request to resume", &PassiveRequest::Resume(resume))?;
        self.built.laid = from;
        self.count_from_here(on_event)?;
        // At rest, any remaining layer can be replaced.
        self.sent.amend_at = 0;
        self.amend(self.built.laid, on_event)?;
        self.hand_over(on_event)
    }
}

/// Reports whether a board has an unfinished body, in place of which it begins no other one. A person gives a body up
/// by a stop.
fn is_unfinished(status: &Status) -> bool {
    let Status { plan_id, layers_laid: laid, layer_count: layers, state, interrupted, .. } = *status;
    plan_id != 0 && (laid > 0 || interrupted.is_some()) && laid < layers && state != State::Stopped
}

/// Reports whether a board in this state begins a new body.
pub(crate) fn begins_body(status: &Status) -> bool {
    matches!(status.state, State::Idle | State::Done | State::Stopped) && !is_unfinished(status)
}

/// Opens a session with the board of a robot, and reports its identity and any crash as events.
fn open_session(
    client: &mut Client,
    robot: &Robot,
    on_event: &mut dyn FnMut(&JobEvent),
) -> Result<BoardInfo, GrowthError> {
    let hello = client.open_session_for(robot).map_err(GrowthError::NotStarted)?;
    on_event(&JobEvent::Board(hello.clone()));
    if is_crash(hello.reset_cause) {
        report_crash(client, on_event);
    }
    Ok(hello)
}
