//! Runs a job on its robot's board: a new job, or the rest of an unfinished job.

use std::sync::Arc;

use growbot_client::client::ClientError;
use growbot_client::growth::{
    Beginning, CommandQueue, GrowthBoard, GrowthError, GrowthRequest, LogTarget, OnInterrupted, OnParked, Override,
};
use growbot_client::port::time_since_boot;
use growbot_client::stop_signal::Permit;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::message::{HostSilencePolicy, State, Status};
use growbot_core::robot::Robot;
use growbot_plan::feedback::assumed_noise;
use growbot_plan::forecast::Forecast;
use growbot_plan::growth_report::Outcome;
use growbot_plan::job::{Command, Job as BoardJob, JobEvent};
use growbot_plan::plan::Plan;
use growbot_plan::run_log::{GrowthResult, OutcomeKind, RecordedRun, RunLog};
use growbot_scene::scene_file::LoadedScene;
use growbot_sim::simulated_tip::ground_truth;
use time::OffsetDateTime;

use super::connector::BoardConnection;
use super::job::{Job, JobState, end_reason};
use super::notification::NotificationEvent;
use super::robot_request::NewJob;
use super::robot_worker::{LinkState, RobotWorker};
use super::stopper::Reply;
use crate::watch::LiveGrowth;

/// Message for a job that was not started because a later stop has voided its request.
const VOIDED: &str = "the job was not started, because the robot was stopped, had a fault or discarded its body before \
                      the order reached it: check the robot, and order the job again";

impl RobotWorker {
    /// Starts a new job, and follows it until it ends or the connection is lost.
    pub(super) fn start_job(&self, connection: &mut BoardConnection, new: NewJob, reply: Reply) -> LinkState {
        let NewJob { job, plan, robot, scene, feedback, permit } = new;
        if !permit.is_valid() {
            return refuse(&reply, VOIDED);
        }
        let commands = self.announce_growth(&job, permit);
        let request = GrowthRequest {
            scene: scene.as_ref(),
            overrides: if job.ignore_scene { &[Override::Scene] } else { &[] },
            feedback: feedback.then(|| assumed_noise(self.is_simulated().into())),
            kind: self.is_simulated().into(),
            ..GrowthRequest::new(&robot, &plan)
        };
        let board_job = request.job();
        let path = self.shared.jobs().log_path(&job.id);
        let log = match request.open_log(&LogTarget::File(path), &board_job, &self.entry.port) {
            Ok(log) => log,
            Err(error) => return self.refuse_growth(&reply, &error.to_string()),
        };
        if commands.stop_requested() {
            log.discard();
            return self.refuse_growth(&reply, VOIDED);
        }
        self.set_job_state(&job, JobState::Active, None);
        let mut growing = RunningJob::new(self, &job, &board_job, &[], log, &commands);
        growing.reply = Some(reply);
        growing.run(&request, &board_job, connection)
    }

    /// Resumes an unfinished job at a client's request, and follows it until it ends or the connection is lost.
    pub(super) fn resume(
        &self,
        connection: &mut BoardConnection,
        job: &Job,
        permit: Permit,
        reply: Reply,
    ) -> LinkState {
        if !permit.is_valid() {
            return refuse(&reply, VOIDED);
        }
        self.continue_job(connection, job, permit, Some(reply), |_| Ok(()))
    }

    /// Follows again the job that was active when the service ended or the connection was lost, if the board heats,
    /// homes, grows, pauses, is parked or is done. Only a board that waits for its host is started again. A requested
    /// pause, a filament runout and a parked board wait for a person. After a loss of power or a stop the job becomes
    /// interrupted.
    pub(super) fn reattach_job(&self, connection: &mut BoardConnection, job: &Job) -> LinkState {
        let permit = self.signal().continuation();
        self.continue_job(connection, job, permit, None, |state| match state {
            State::Heating | State::Homing | State::Growing | State::Paused | State::Parked | State::Done => Ok(()),
            state => Err(format!(
                "the board is in state {}: clear the fault or the emergency stop, if there is one, then resume or \
                 cancel the job",
                state.name()
            )),
        })
    }

    fn continue_job(
        &self,
        connection: &mut BoardConnection,
        job: &Job,
        permit: Permit,
        reply: Option<Reply>,
        may: impl FnOnce(State) -> Result<(), String>,
    ) -> LinkState {
        let commands = self.announce_growth(job, permit);
        let hello = match connection.client.identify() {
            Ok(hello) => hello,
            Err(error) => return LinkState::Lost(error.to_string()),
        };
        let path = self.shared.jobs().log_path(&job.id);
        // The board reports again the layers that are missing in the log of the job.
        self.write_kept();
        self.drop_kept_log(&job.id);
        let opened = || -> Result<(RecordedRun, Robot, Plan, Option<LoadedScene>), String> {
            let mut record = RecordedRun::open(&path).map_err(|error| error.to_string())?;
            let robot = record.own_robot().map_err(|error| error.to_string())?;
            let plan = record.plan(&robot).map_err(|error| error.to_string())?;
            record.sync_to_board(hello.status.plan_id);
            if hello.status.plan_id != record.plan_id {
                let stored = GrowthError::nothing_to_resume(record.plan_id, &hello.status);
                return Err(stored.to_string());
            }
            may(hello.status.state)?;
            let scene = match (record.scene(&plan, &robot, None), record.feedback.is_some()) {
                (Err(error), true) => return Err(error.to_string()),
                // Without feedback, the scene serves only to compare the finished body with it.
                (scene, _) => scene.ok().flatten(),
            };
            Ok((record, robot, plan, scene))
        };
        let (record, robot, plan, scene) = match opened() {
            Ok(opened) => opened,
            Err(why) => {
                // A job that a client wants to resume keeps its state.
                if let Some(reply) = reply {
                    return self.refuse_growth(&reply, &why);
                }
                return self.leave_job(job, &hello.status, &why);
            }
        };
        let request = GrowthRequest {
            beginning: Beginning::Resume { record: Some(&record), interrupted: OnInterrupted::Redo },
            scene: scene.as_ref(),
            kind: self.is_simulated().into(),
            ..GrowthRequest::new(&robot, &plan)
        };
        let board_job = request.job();
        let log = match request.open_log(&LogTarget::File(path), &board_job, &self.entry.port) {
            Ok(log) => log,
            Err(error) => {
                let why = error.to_string();
                if let Some(reply) = reply {
                    return self.refuse_growth(&reply, &why);
                }
                return self.leave_job(job, &hello.status, &why);
            }
        };
        self.set_job_state(job, JobState::Active, None);
        let mut growing = RunningJob::new(self, job, &board_job, &record.known_layers(), log, &commands);
        growing.reply = reply;
        growing.run(&request, &board_job, connection)
    }

    /// Marks a job as interrupted, because a user ordered a stop while the board was disconnected, and the board
    /// received the stop before anything else after the reconnection.
    pub(super) fn end_stopped_job(&self, job: &Job, status: &Status) -> LinkState {
        let stop = if status.state == State::EmergencyStop { State::EmergencyStop.name() } else { "stopped" };
        self.leave_job(job, status, &format!("{stop}, as requested while the board was disconnected"))
    }

    /// Marks a job as interrupted for the reason `why`: the board does not continue it, or the service cannot follow
    /// it, for example because its run log cannot be read. `status` is that of the board. The states of the robot's
    /// other jobs are corrected by it.
    fn leave_job(&self, job: &Job, status: &Status, why: &str) -> LinkState {
        self.forget_growth();
        self.notify_job(job, NotificationEvent::Interrupted, Some(why));
        self.set_job_state(job, JobState::Interrupted, Some(why));
        self.pause_file.set(false);
        self.reconcile_jobs(status, None);
        LinkState::Ready
    }

    /// Publishes the command queue of a growth before the growth is prepared, so that commands reach it from its first
    /// moment.
    fn announce_growth(&self, job: &Job, permit: Permit) -> Arc<CommandQueue> {
        let is_continuation = permit.is_continuation();
        let commands = Arc::new(CommandQueue::new(permit));
        self.update_state(|known| {
            if std::mem::take(&mut known.pauses_on_reconnect) && is_continuation {
                commands.push(Command::Pause);
            }
            (known.commands, known.command_error) = (Some(Arc::clone(&commands)), None);
            known.job = Some(job.id.clone());
        });
        self.pause_file.set(commands.pause_waits());
        commands
    }

    /// Removes the published command queue and the active job, because the growth does not begin.
    fn forget_growth(&self) {
        self.update_state(|known| (known.commands, known.job) = (None, None));
    }

    fn refuse_growth(&self, reply: &Reply, why: &str) -> LinkState {
        self.forget_growth();
        refuse(reply, why)
    }

    /// Records the state of a job in the list of jobs, and whether the robot has an active job.
    fn set_job_state(&self, job: &Job, state: JobState, why: Option<&str>) {
        if state == JobState::Done {
            // The notice is queued before the state is recorded. If the service is killed in between, the notice is
            // sent twice, which is better than never.
            self.notify_job(job, NotificationEvent::Finish, None);
        }
        self.shared.jobs().set_state(&job.id, state, why);
        let is_active = state == JobState::Active;
        self.update_state(|known| known.job = is_active.then(|| job.id.clone()));
    }
}

fn refuse(reply: &Reply, why: &str) -> LinkState {
    // The client may no longer wait for the response.
    let _ = reply.send(Err(why.to_owned()));
    LinkState::Ready
}

/// An active growth, with its run log and the state that it shares with other threads.
struct RunningJob<'a> {
    keeper: &'a RobotWorker,
    job: &'a Job,
    log: RunLog,
    commands: Arc<CommandQueue>,
    live_growth: Arc<LiveGrowth>,
    forecast: Option<Forecast>,
    layers: u32,
    laid: u32,
    /// Channel on which the client is informed that the job has started. `None` once the client is informed, or without
    /// a client.
    reply: Option<Reply>,
}

impl<'a> RunningJob<'a> {
    fn new(
        keeper: &'a RobotWorker,
        job: &'a Job,
        board_job: &BoardJob,
        known: &[Option<LayerBytes>],
        mut log: RunLog,
        commands: &Arc<CommandQueue>,
    ) -> Self {
        let live_growth = LiveGrowth::new(board_job, known, Some(Arc::clone(commands)));
        live_growth.set_pace(keeper.pace());
        let period_s = board_job.robot.description().layer.period_s;
        let forecast = keeper.pace().map(|pace| Forecast { period_s, pace });
        log.set_forecast(forecast);
        keeper.update_state(|known| known.live_growth = Some(Arc::clone(&live_growth)));
        let commands = Arc::clone(commands);
        Self { keeper, job, log, commands, live_growth, forecast, layers: job.layers, laid: job.laid, reply: None }
    }

    fn ingest(&mut self, event: &JobEvent) {
        self.live_growth.ingest(event);
        if let Err(error) = self.log.record(event) {
            self.keeper.update_state(|known| known.command_error = Some(error.to_string()));
        }
        match event {
            JobEvent::Board(board) => self.keeper.record_boot(board),
            JobEvent::Status(status) => {
                let finish = self.forecast.and_then(|of| of.finish_of(OffsetDateTime::now_utc(), status));
                self.keeper.update_state(|known| known.finish = finish);
                self.keeper.void_if_stopped_elsewhere(status.state);
                self.keeper.record_status(status.clone());
                self.keeper.pause_file.set(self.commands.pause_waits());
                self.confirm_start();
            }
            JobEvent::State(state) => {
                self.keeper.void_if_stopped_elsewhere(*state);
                self.keeper.update_state(|known| {
                    known.reported = Some(time_since_boot());
                    if let Some(status) = &mut known.status {
                        status.state = *state;
                    }
                });
            }
            JobEvent::Laid { index, .. } => {
                self.laid = index.saturating_add(1);
                self.keeper.update_state(|known| {
                    known.reported = Some(time_since_boot());
                    if let Some(status) = &mut known.status {
                        status.layers_laid = index.saturating_add(1);
                    }
                });
                self.save_progress();
            }
            JobEvent::Amendment(amendment) => self.layers = amendment.total,
            JobEvent::CommandFailed(why) => self.keeper.update_state(|known| known.command_error = Some(why.clone())),
            JobEvent::Command(_) => self.keeper.update_state(|known| known.command_error = None),
            _ => self.keeper.shared.signal_change(),
        }
    }

    /// Informs the client, if one waits, that the job has started.
    fn confirm_start(&mut self) {
        if let Some(reply) = self.reply.take() {
            // A board has one body, so it has discarded that of any other job.
            self.keeper.give_up_others(Some(&self.job.id), "discarded: the robot has begun another job");
            let _ = reply.send(Ok(()));
        }
    }

    fn save_progress(&self) {
        self.keeper.shared.jobs().set_laid(&self.job.id, self.laid, self.layers);
    }

    /// Runs the growth on the board until it ends or the connection is lost. Records the outcome in the run log and in
    /// the list of jobs.
    fn run(mut self, request: &GrowthRequest, board_job: &BoardJob, connection: &mut BoardConnection) -> LinkState {
        let commands = Arc::clone(&self.commands);
        let board = GrowthBoard {
            client: &mut connection.client,
            truth: ground_truth(&mut connection.simulation),
            commands: &commands,
            silence: HostSilencePolicy::Pause,
            parked: OnParked::Wait,
        };
        let grown = request.run(board_job, board, &mut |event| self.ingest(event));
        self.keeper.update_state(|known| (known.commands, known.live_growth, known.finish) = (None, None, None));
        match &grown {
            Ok(report) if report.outcome == Outcome::Lost => self.detach("the board has not responded for too long"),
            Ok(report) => {
                let result = request.result(&grown);
                self.laid = report.laid;
                self.save_progress();
                let board_state = self.keeper.lock_state().status.as_ref().map(|status| status.state.name());
                let why = end_reason(&result, board_state);
                if matches!(result.outcome, OutcomeKind::Interrupted | OutcomeKind::ClockDrift) {
                    self.keeper.notify_job(self.job, NotificationEvent::Interrupted, Some(&why));
                }
                self.close(result, &why);
                LinkState::Ready
            }
            Err(GrowthError::Interrupted(error)) => self.detach(&error.to_string()),
            Err(error) => {
                let reply = self.reply.take();
                let why = error.to_string();
                let lost =
                    matches!(error, GrowthError::NotStarted(ClientError::Port(_) | ClientError::NoResponse { .. }));
                if lost && reply.is_none() {
                    // The board may go on with the job.
                    return self.detach(&why);
                }
                if self.laid == 0 {
                    std::mem::take(&mut self.log).discard();
                    self.keeper.set_job_state(self.job, JobState::Failed, Some(&why));
                } else {
                    let nothing = GrowthResult { error: None, ..request.result(&grown) };
                    let interrupted = GrowthResult { outcome: OutcomeKind::Interrupted, ..nothing };
                    if reply.is_none() {
                        self.keeper.notify_job(self.job, NotificationEvent::Interrupted, Some(&why));
                    }
                    self.close(interrupted, &why);
                }
                if let Some(reply) = reply {
                    let _ = reply.send(Err(why.clone()));
                }
                if lost { LinkState::Lost(why) } else { LinkState::Ready }
            }
        }
    }

    /// Stops following a job that continues or waits on the board without its host. `why` is the reason of the lost
    /// connection. After the reconnection, the robot's thread delivers an unconfirmed stop, or else follows the job
    /// again.
    fn detach(&mut self, why: &str) -> LinkState {
        self.live_growth.supersede();
        // A stop that was withdrawn meanwhile may have ordered a pause, too.
        self.keeper.update_state(|known| known.pauses_on_reconnect |= self.commands.pause_waits());
        self.confirm_start();
        LinkState::Lost(why.to_owned())
    }

    /// Ends the run log and the live pages with this result, and records the state of the job.
    fn close(&mut self, mut result: GrowthResult, why: &str) {
        let missing = self.log.missing_lines();
        result.log_lines_missing = (missing > 0).then_some(missing);
        self.live_growth.end(result.clone());
        if let Err(error) = self.log.end(&result) {
            log::warn!("{error}");
            self.keeper.keep_log(&self.job.id, std::mem::take(&mut self.log));
        }
        self.keeper.set_job_state(self.job, JobState::from_outcome(result.outcome), Some(why));
        self.keeper.pause_file.set(false);
        self.confirm_start();
    }
}
