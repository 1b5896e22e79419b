//! Runs a job on its robot's board: a new job, or the rest of an unfinished job.

use std::sync::Arc;

use growbot_client::growth::{
    Beginning, CommandQueue, GrowthBoard, GrowthError, GrowthRequest, LogTarget, OnInterrupted, OnParked,
};
use growbot_client::port::time_since_boot;
use growbot_client::robot_command::CommandOutcome;
use growbot_client::status::RobotStatus;
use growbot_client::stop_signal::Permit;
use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::message::{HostSilencePolicy, State, Status};
use growbot_core::robot::Robot;
use growbot_plan::forecast::Forecast;
use growbot_plan::growth_report::Outcome;
use growbot_plan::job::{Command, Job as BoardJob, JobEvent};
use growbot_plan::plan::Plan;
use growbot_plan::run_log::{GrowthResult, OutcomeKind, RecordedRun, RunLog};
use growbot_remote::api::{Job, JobState, end_reason};
use growbot_scene::scene_file::LoadedScene;
use growbot_sim::simulated_tip::ground_truth;
use time::OffsetDateTime;

use super::connector::BoardConnection;
use super::notification::NotificationEvent;
use super::robot_error::{ConnectionError, RobotRequestError};
use super::robot_request::{NewJob, Reply};
use super::robot_worker::{LinkState, RobotWorker, is_loss};
use crate::watch::live_growth::LiveGrowth;

impl RobotWorker {
    /// Starts a new job, and follows it until it ends or the connection is lost.
    pub(super) fn start_job(&self, connection: &mut BoardConnection, new: NewJob, reply: Reply) -> LinkState {
        let NewJob { job, body, permit } = new;
        if !permit.is_valid() {
            return refuse(&reply, RobotRequestError::Voided);
        }
        let commands = self.announce_growth(&job, permit);
        let request = body.request(self.is_simulated().into());
        let board_job = request.job();
        let path = self.shared.jobs().log_path(&job.id);
        let log = match request.open_log(&LogTarget::File(path), &board_job, &self.entry.port) {
            Ok(log) => log,
            Err(error) => return self.refuse_growth(&reply, error),
        };
        if commands.stop_requested() {
            log.discard();
            return self.refuse_growth(&reply, RobotRequestError::Voided);
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
            return refuse(&reply, RobotRequestError::Voided);
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
            state => Err(RobotRequestError::BoardState(state)),
        })
    }

    fn continue_job(
        &self,
        connection: &mut BoardConnection,
        job: &Job,
        permit: Permit,
        reply: Option<Reply>,
        may: impl FnOnce(State) -> Result<(), RobotRequestError>,
    ) -> LinkState {
        let commands = self.announce_growth(job, permit);
        let hello = match connection.client.identify() {
            Ok(hello) => hello,
            Err(error) => return LinkState::lost(error),
        };
        let path = self.shared.jobs().log_path(&job.id);
        // The board reports again the layers that are missing in the log of the job.
        self.write_kept();
        self.drop_kept_log(&job.id);
        let opened = || -> Result<(RecordedRun, Robot, Plan, Option<LoadedScene>), RobotRequestError> {
            let mut record = RecordedRun::open(&path)?;
            let robot = record.own_robot()?;
            let plan = record.plan(&robot)?;
            record.sync_to_board(hello.status.plan_id);
            if hello.status.plan_id != record.plan_id {
                return Err(GrowthError::nothing_to_resume(record.plan_id, &hello.status).into());
            }
            may(hello.status.state)?;
            let scene = match (record.scene(&plan, &robot, None), record.feedback.is_some()) {
                (Err(error), true) => return Err(error.into()),
                // Without feedback, the scene serves only to compare the finished body with it.
                (scene, _) => scene.ok().flatten(),
            };
            Ok((record, robot, plan, scene))
        };
        let (record, robot, plan, scene) = match opened() {
            Ok(opened) => opened,
            Err(error) => return self.refuse_rest(job, &hello.status, reply, error),
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
            Err(error) => return self.refuse_rest(job, &hello.status, reply, error.into()),
        };
        self.set_job_state(job, JobState::Active, None);
        let mut growing = RunningJob::new(self, job, &board_job, &record.known_layers(), log, &commands);
        growing.reply = reply;
        growing.run(&request, &board_job, connection)
    }

    /// Refuses to grow the rest of a job. A job that a client wants to resume keeps its state. Another job becomes
    /// interrupted.
    fn refuse_rest(&self, job: &Job, status: &Status, reply: Option<Reply>, error: RobotRequestError) -> LinkState {
        match reply {
            Some(reply) => self.refuse_growth(&reply, error),
            None => self.leave_job(job, status, &error.to_string()),
        }
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

    fn refuse_growth(&self, reply: &Reply, error: impl Into<RobotRequestError>) -> LinkState {
        self.forget_growth();
        refuse(reply, error.into())
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

fn refuse(reply: &Reply, error: RobotRequestError) -> LinkState {
    // The client may no longer wait for the response.
    let _ = reply.send(Err(error));
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
        let robot = RobotStatus { pace: keeper.pace(), ..RobotStatus::default() };
        let live_growth = LiveGrowth::new(board_job, known, robot);
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
                // After a reconnection the board reports earlier layers, too.
                let mut is_latest = true;
                self.keeper.update_state(|known| {
                    known.reported = Some(time_since_boot());
                    if let Some(status) = &mut known.status {
                        is_latest = status.layers_laid <= self.laid;
                        status.layers_laid = status.layers_laid.max(self.laid);
                    }
                });
                self.save_progress();
                if is_latest {
                    self.keeper.shared.cameras.on_laid(&self.keeper.name, &self.job.id, *index);
                }
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
            let _ = reply.send(Ok(CommandOutcome::Started));
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
        let result = request.result(&grown);
        match grown {
            Ok(report) if report.outcome == Outcome::Lost => self.detach(ConnectionError::Silent),
            Ok(report) => {
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
            Err(GrowthError::Interrupted(error)) => self.detach(error.into()),
            // The board may go on with the job.
            Err(GrowthError::NotStarted(error)) if is_loss(&error) && self.reply.is_none() => self.detach(error.into()),
            Err(error) => {
                let reply = self.reply.take();
                let why = error.to_string();
                if self.laid == 0 {
                    std::mem::take(&mut self.log).discard();
                    self.keeper.set_job_state(self.job, JobState::Failed, Some(&why));
                } else {
                    let interrupted = GrowthResult { error: None, outcome: OutcomeKind::Interrupted, ..result };
                    if reply.is_none() {
                        self.keeper.notify_job(self.job, NotificationEvent::Interrupted, Some(&why));
                    }
                    self.close(interrupted, &why);
                }
                let (left, error) = match error {
                    GrowthError::NotStarted(error) => LinkState::after(error),
                    error => (LinkState::Ready, error.into()),
                };
                if let Some(reply) = reply {
                    let _ = reply.send(Err(error));
                }
                left
            }
        }
    }

    /// Stops following a job that continues or waits on the board without its host. `reason` is that of the lost
    /// connection. After the reconnection, the robot's thread delivers an unconfirmed stop, or else follows the job
    /// again.
    fn detach(&mut self, reason: ConnectionError) -> LinkState {
        self.live_growth.supersede();
        // A stop that was withdrawn meanwhile may have ordered a pause, too.
        self.keeper.update_state(|known| known.pauses_on_reconnect |= self.commands.pause_waits());
        self.confirm_start();
        LinkState::lost(reason)
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
