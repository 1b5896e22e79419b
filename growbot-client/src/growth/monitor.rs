//! A growth in progress: processes the board's events until the growth ends, executes commands of users, and reconnects
//! to a board that does not respond.

use std::time::Duration;

use growbot_core::layer::{Layer, grow};
use growbot_core::layer_bytes::decode;
use growbot_core::link::message::{
    Empty, Fault, LayerLaid, Message, PassiveRequest, PauseCause, Refusal, State, Status,
};
use growbot_plan::arrival::Arrival;
use growbot_plan::feedback::Feedback;
use growbot_plan::growth_report::{GrowthReport, MeasuredBy, Outcome, as_built_or_commanded};
use growbot_plan::job::{Command, JobEvent};

use super::amendment::IN_ENGINE;
use super::commands::{QueuedCommand, uncertain_message};
use super::{CommandQueue, GrowthError, JobRunner, OnInterrupted, OnParked, is_crash, report_crash};
use crate::client::ClientError;
use crate::stop_signal::StopLevel;

/// Maximum time to wait for an event of the board before the command queue is polled.
const EVENT_POLL_INTERVAL: Duration = Duration::from_millis(20);
/// Number of successive polls without an event of the board after which the status is requested (2 s).
const QUIET_LOOKS: u32 = 100;
/// Maximum number of status requests after the end of the job, while the reports of some laid layers are still missing.
const MAX_QUESTIONS_AFTER_END: u32 = 40;
/// Like [`MAX_QUESTIONS_AFTER_END`], after a stop. The caller waits for its confirmation, and takes a late one for a
/// robot that is still on. A resumption reads the missing reports.
const MAX_QUESTIONS_AFTER_STOP: u32 = 3;
/// Maximum number of attempts to reconnect to a board that does not respond, before the board counts as lost.
const CALLS: u32 = 12;

/// Schedule of the requests for the board's status.
struct StatusPoll {
    /// True if the status is to be requested now.
    ask: bool,
    /// Number of successive polls without an event.
    quiet_looks: u32,
    /// Number of status requests since the end of the job, which wait for layers that are not reported yet.
    after_end: u32,
}

impl Default for StatusPoll {
    /// Requests the status at once, because a job without layers is done before any event.
    fn default() -> Self {
        Self { ask: true, quiet_looks: 0, after_end: 0 }
    }
}

impl StatusPoll {
    /// Counts a poll for an event of the board. `found` is true if the poll returned an event.
    fn count_look(&mut self, found: bool) {
        self.quiet_looks = if found { 0 } else { self.quiet_looks + 1 };
        if self.quiet_looks >= QUIET_LOOKS {
            (self.quiet_looks, self.ask) = (0, true);
        }
    }
}

impl JobRunner<'_> {
    /// Processes the growth until it ends, and returns its result with the measured body.
    pub(super) fn finish(
        mut self,
        orders: &CommandQueue,
        on_event: &mut dyn FnMut(&JobEvent),
    ) -> Result<GrowthReport, GrowthError> {
        let mut outcome = self.follow(orders, on_event);
        for _ in 0..CALLS {
            match outcome {
                Err(
                    ClientError::NoResponse { .. }
                    | ClientError::Garbage { .. }
                    | ClientError::StopNotAcknowledged { .. },
                ) => {
                    if let Err(error @ ClientError::StopNotAcknowledged { .. }) = &outcome {
                        // The stop is retried, but the user should not wait for that.
                        on_event(&JobEvent::CommandFailed(error.to_string()));
                        if matches!(self.client.event(Duration::ZERO), Err(ClientError::Port(_))) {
                            // Only a new connection can carry the stop.
                            break;
                        }
                    }
                    on_event(&JobEvent::NoResponse);
                    outcome = self.reconnect(orders, on_event);
                }
                // The board no longer knows this session, because it has restarted or another host has taken it.
                Err(ClientError::Refused { refusal: Refusal::NoSession, .. }) => {
                    outcome = self.reconnect(orders, on_event);
                }
                _ => break,
            }
        }
        let outcome = match outcome {
            Ok(outcome) => outcome,
            Err(
                ClientError::NoResponse { .. }
                | ClientError::Garbage { .. }
                | ClientError::StopNotAcknowledged { .. }
                | ClientError::Port(_),
            ) if orders.stop_requested() && self.client.emergency_stop().is_ok() => {
                // The board did not respond to the request to stop, but confirmed the emergency stop.
                on_event(&JobEvent::State(State::EmergencyStop));
                Outcome::Stopped
            }
            Err(ClientError::NoResponse { .. } | ClientError::Garbage { .. }) => Outcome::Lost,
            Err(ClientError::Owned { .. } | ClientError::Refused { refusal: Refusal::NoSession, .. }) => {
                Outcome::Interrupted
            }
            Err(error) => return Err(GrowthError::Interrupted(error)),
        };
        Ok(self.measure(outcome))
    }

    /// Creates the result of the growth from the layers as built. With feedback, the pose of the tip is the estimate
    /// from the sensors.
    fn measure(self, outcome: Outcome) -> GrowthReport {
        let layers = as_built_or_commanded(&self.built.as_built, &self.job.layers);
        let body: Vec<Layer> = layers.map(|layer| decode(&layer)).collect();
        let length = body.iter().fold(0.0, |sum, layer| sum + layer.height);
        let feed_steps = length * self.job.robot.feed_steps_per_length();
        let fed_back = self.feedback.as_ref().map(Feedback::result);
        let (measured_by, end) = match &fed_back {
            Some(fed_back) => (MeasuredBy::Estimate, fed_back.estimate.base_from_tip),
            None => (MeasuredBy::Steps, grow(&self.job.start.frame(), body.iter().copied())),
        };
        GrowthReport {
            outcome,
            plan_id: self.job.plan_id,
            arrival: Arrival::of(&end, self.job.goal, self.job.length),
            body,
            duration_s: self.board.duration_s(),
            filament_mm: feed_steps / self.job.robot.description().feed.steps_per_mm,
            laid: self.built.laid,
            as_built: self.built.as_built,
            interrupted: self.built.interrupted,
            measured_by,
            feedback: fed_back,
        }
    }

    /// Opens a new session and continues to process the growth, if the board still stores its job.
    fn reconnect(
        &mut self,
        orders: &CommandQueue,
        on_event: &mut dyn FnMut(&JobEvent),
    ) -> Result<Outcome, ClientError> {
        // A stop needs no session. A line on which no bytes arrive may still carry an emergency stop.
        match orders.requested_stop() {
            Some(StopLevel::EmergencyStop) => self.client.emergency_stop()?,
            Some(StopLevel::Stop) => drop(self.client.request("the request to stop", &PassiveRequest::Stop(Empty {}))?),
            None => {}
        }
        let hello = self.client.open_session_for(self.job.robot)?;
        on_event(&JobEvent::Reconnected);
        if hello.boot_id != self.board.boot_id {
            on_event(&JobEvent::Board(hello.clone()));
            if is_crash(hello.reset_cause) {
                report_crash(self.client, on_event);
            }
        }
        if self.sent.pending.as_ref().is_some_and(|amendment| amendment.plan_id == hello.status.plan_id) {
            self.apply_amendment();
        } else if self.sent.pending.take().is_some() {
            on_event(&JobEvent::AmendmentRejected(None));
        }
        if hello.boot_id != self.board.boot_id || hello.status.plan_id != self.job.plan_id {
            if hello.status.plan_id == self.job.plan_id {
                (self.built.laid, self.built.interrupted) = (hello.status.layers_laid, hello.status.interrupted);
            }
            self.board.ended_ms = hello.status.uptime_ms;
            return Ok(match outcome(hello.status.state, hello.status.fault) {
                // A board forgets a job that is done. If all layers of the job are reported, all are laid.
                _ if self.built.as_built.len() >= self.job.layers.len() => Outcome::Done,
                Some(fault @ Outcome::Fault(_)) if hello.status.plan_id == self.job.plan_id => fault,
                _ => Outcome::Interrupted,
            });
        }
        if self.outcome(&hello.status).is_none() || hello.status.state == State::Done {
            self.attach(&hello.status, OnInterrupted::Redo, on_event)?;
        }
        self.follow(orders, on_event)
    }

    fn follow(&mut self, orders: &CommandQueue, on_event: &mut dyn FnMut(&JobEvent)) -> Result<Outcome, ClientError> {
        let mut stopped_by = None;
        let mut questions = StatusPoll::default();
        loop {
            if let Some(order) = orders.pop().filter(|order| stopped_by != Some(order.command)) {
                let command = order.command;
                // A command that did not reach the board is kept for the next session.
                self.execute(&order, on_event).inspect_err(|_| match command.may_be_repeated() {
                    true => orders.requeue(order),
                    false => on_event(&JobEvent::CommandFailed(uncertain_message(command))),
                })?;
                stopped_by = Some(command).filter(|command| *command >= Command::Stop);
                questions.ask = true;
            }
            if let Some(drift) = self.client.stop_if_clock_drifts()? {
                let status = self.client.status()?;
                self.apply_status(&status, on_event)?;
                on_event(&JobEvent::State(status.state));
                on_event(&JobEvent::Status(status));
                return Ok(Outcome::ClockDrift(drift));
            }
            if (std::mem::take(&mut questions.ask) || self.client.clock_sample_due())
                && let Some(outcome) = self.ask_status(&mut questions, on_event)?
            {
                return Ok(outcome);
            }
            let event = self.client.event(EVENT_POLL_INTERVAL)?;
            questions.count_look(event.is_some());
            match event {
                // A layer beyond the job is invalid.
                Some(Message::LayerLaid(laid))
                    if self.sent.is_named(laid.plan_id) && (laid.index as usize) < self.max_layers() =>
                {
                    self.layer_laid(&laid, on_event)?;
                    // This was the last of the layers that were missing at the end.
                    questions.ask = questions.after_end > 0 && self.built.is_reported();
                }
                Some(Message::StateChanged(change)) => {
                    if std::mem::replace(&mut self.state, change.state) != change.state {
                        on_event(&JobEvent::State(change.state));
                    }
                    // The event may belong to the previous job. Only the status shows the state of this one.
                    questions.ask = true;
                }
                // Another host may have stopped the board. The status shows what remains of the body.
                Some(Message::EmergencyStopAck(_)) => questions.ask = true,
                Some(_) | None => {}
            }
        }
    }

    /// Requests the status. Returns the outcome once the job has ended and all laid layers are reported, or after too
    /// many requests without these reports. `None` before.
    fn ask_status(
        &mut self,
        questions: &mut StatusPoll,
        on_event: &mut dyn FnMut(&JobEvent),
    ) -> Result<Option<Outcome>, ClientError> {
        let status = self.client.status()?;
        let has_ended = status.state == State::Idle || status.plan_id != self.job.plan_id;
        let misses_layers = status.layers_laid as usize > self.built.as_built.len() && !self.client.has_events();
        if self.is_started && (has_ended || misses_layers) {
            // The board serves the status without a session, but reports layers in the session only.
            self.client.check_session()?;
        }
        let outcome = self.apply_status(&status, on_event)?;
        on_event(&JobEvent::Status(status));
        if let Some(Outcome::Fault(Fault::WatchdogReset | Fault::ProcessorFault | Fault::StackOverflow)) = outcome
            && questions.after_end == 0
        {
            report_crash(self.client, on_event);
        }
        let Some(outcome) = outcome else { return Ok(None) };
        let limit = if outcome == Outcome::Stopped { MAX_QUESTIONS_AFTER_STOP } else { MAX_QUESTIONS_AFTER_END };
        if self.built.is_reported() || questions.after_end >= limit {
            return Ok(Some(outcome));
        }
        questions.after_end += 1;
        Ok(None)
    }

    /// Processes the report of a laid layer: records the layer, amends the job and sends more layers.
    fn layer_laid(&mut self, laid: &LayerLaid, on_event: &mut dyn FnMut(&JobEvent)) -> Result<(), ClientError> {
        let LayerLaid { index, as_built, readings: measured, .. } = *laid;
        if index as usize == self.built.as_built.len() {
            self.ingest_layer(laid);
            on_event(&JobEvent::Laid { index, as_built, measured });
        }
        self.built.laid = self.built.laid.max(index.saturating_add(1));
        self.sent.make_room(self.built.laid);
        self.amend(self.built.laid.saturating_add(IN_ENGINE), on_event)?;
        self.refill(on_event)
    }

    /// Returns the outcome of this growth if the board has this status. `None` if the growth has not ended.
    fn outcome(&self, status: &Status) -> Option<Outcome> {
        match status.state {
            State::Parked if self.parked == OnParked::Wait => None,
            // Only another host or a reset takes the board from a growth to the idle state.
            State::Idle if self.is_started => Some(Outcome::Interrupted),
            state => outcome(state, status.fault),
        }
    }

    /// Returns the number of layers of the job, or of the pending amendment if that has more layers.
    fn max_layers(&self) -> usize {
        self.job.layers.len().max(self.sent.pending.as_ref().map_or(0, |amendment| amendment.layers.len()))
    }

    /// Executes a command of a user. A command that does not suit the board's state is refused, and the growth
    /// continues.
    fn execute(&mut self, order: &QueuedCommand, on_event: &mut dyn FnMut(&JobEvent)) -> Result<(), ClientError> {
        let QueuedCommand { command, permit } = order;
        on_event(&JobEvent::Command(*command));
        let done = match command {
            Command::Preheat | Command::Unload | Command::Load | Command::Purge => match command.task(self.job.robot) {
                Some(task) => self.client.maintain(task, permit).map(drop),
                None => Ok(()),
            },
            Command::Continue => {
                self.sent.pausing = false;
                self.permit = permit.clone();
                self.start()
            }
            Command::Pause => self.client.request("the request to pause", &PassiveRequest::Pause(Empty {})).map(drop),
            Command::Stop => self.client.request("the request to stop", &PassiveRequest::Stop(Empty {})).map(drop),
            Command::EmergencyStop => self.client.emergency_stop(),
        };
        match done {
            Err(error) if is_temporary(&error) => {
                on_event(&JobEvent::CommandFailed(error.to_string()));
                Ok(())
            }
            done => done,
        }
    }

    /// Records a laid layer, which must be the next one after the recorded layers, and passes it to the feedback.
    fn ingest_layer(&mut self, laid: &LayerLaid) {
        let commanded = self.job.layers.get(self.built.as_built.len());
        if let (Some(feedback), Some(layer)) = (&mut self.feedback, laid.as_built.as_ref().or(commanded)) {
            feedback.record_layer(layer, laid.readings.as_ref());
        }
        self.built.as_built.push(laid.as_built);
    }

    /// Updates the progress from the board's status, and sends more layers if the board has space. Returns the outcome
    /// if the job has ended.
    fn apply_status(
        &mut self,
        status: &Status,
        on_event: &mut dyn FnMut(&JobEvent),
    ) -> Result<Option<Outcome>, ClientError> {
        if status.state == State::Growing && self.board.began_ms.is_none() {
            self.board.began_ms = Some(status.uptime_ms);
        }
        // A board that has restarted, or that another host has taken, does not have this job.
        let lost = (status.plan_id != self.job.plan_id).then_some(Outcome::Interrupted);
        if let Some(outcome) = self.outcome(status).or(lost) {
            self.board.ended_ms = status.uptime_ms;
            if status.plan_id == self.job.plan_id {
                (self.built.laid, self.built.interrupted) = (status.layers_laid, status.interrupted);
            }
            return Ok(Some(outcome));
        }
        self.sent.accepted.next = status.next_layer;
        self.built.laid = status.layers_laid;
        self.sent.make_room(status.layers_laid);
        self.refill(on_event)?;
        // The board paused because it received nothing from this host for too long.
        if status.state == State::Paused && status.pause_cause == PauseCause::HostSilent {
            match self.start() {
                Err(error) if is_temporary(&error) => {}
                done => done?,
            }
        }
        Ok(None)
    }
}

/// Reports whether the growth continues after a request has failed with this error. It does so after a request whose
/// permit a stop has voided, because it executes the stop next.
fn is_temporary(error: &ClientError) -> bool {
    match error {
        ClientError::Voided { .. } => true,
        ClientError::Refused { refusal, .. } => matches!(
            refusal,
            Refusal::WrongState { .. }
                | Refusal::NozzleTooCold { .. }
                | Refusal::StillMoving
                | Refusal::NoFilament
                | Refusal::TemperatureOutOfRange { .. }
                | Refusal::MoveTooLong { .. }
        ),
        _ => false,
    }
}

/// Returns the outcome of a growth whose board is in this state. `None` if the growth has not ended.
fn outcome(state: State, fault: Option<Fault>) -> Option<Outcome> {
    match state {
        State::Done => Some(Outcome::Done),
        State::Stopped | State::EmergencyStop => Some(Outcome::Stopped),
        State::Fault => Some(Outcome::Fault(fault.unwrap_or(Fault::Hardware))),
        State::Parked => Some(Outcome::Parked),
        State::SelfTest
        | State::Idle
        | State::Heating
        | State::Homing
        | State::Growing
        | State::Paused
        | State::Tuning
        | State::Maintenance => None,
    }
}
