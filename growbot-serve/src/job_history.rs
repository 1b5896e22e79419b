//! Corrects the list of jobs by the run logs and by the job that the board stores.

use std::sync::{MutexGuard, PoisonError};

use growbot_core::link::message::{State, Status};
use growbot_plan::run_log::{RecordedRun, RunLog, utc_now};
use growbot_remote::api::{Job, JobState, end_reason};
use rusqlite::named_params;

use super::job_store::{COLUMNS, JobStore, JobStoreError, of_row};
use super::job_updates::JobUpdate;
use super::robot_worker::RobotWorker;

/// Reason of a job that failed because the board no longer stores it. If a board that stores the job is connected
/// later, the job can be resumed.
const NOT_ON_BOARD: &str = "discarded: the board does not have its body";

impl JobStore {
    /// Returns the jobs of a robot that are active or interrupted, and the jobs with this plan that failed because the
    /// board did not store them. The newest job comes first.
    fn unsettled(&self, robot: &str, plan_id: u64) -> Result<Vec<Job>, JobStoreError> {
        let query = format!(
            "SELECT {COLUMNS} FROM job WHERE robot = :robot AND (state IN ('active', 'interrupted') OR \
             id IN (SELECT value FROM json_each(:kept)) OR \
             state = 'failed' AND why = :why AND plan_id = :plan) ORDER BY rowid DESC"
        );
        let plan = format!("{plan_id:016x}");
        let kept = serde_json::json!(self.kept_active()).to_string();
        let mut statement = self.database.prepare(&query)?;
        let parameters = named_params! { ":robot": robot, ":why": NOT_ON_BOARD, ":plan": plan, ":kept": kept };
        let mut jobs: Vec<Job> = statement.query_map(parameters, of_row)?.collect::<Result<_, _>>()?;
        for job in &mut jobs {
            job.state = self.kept_state(&job.id).unwrap_or(job.state);
        }
        jobs.retain(|job| job.state != JobState::Done);
        Ok(jobs)
    }

    /// Returns the active job of a robot. A job that the robot has not yet started has no run log and does not count.
    pub(super) fn active(&self, robot: &str) -> Result<Option<Job>, JobStoreError> {
        let jobs = self.unsettled(robot, 0)?.into_iter();
        Ok({ jobs }.find(|job| job.state == JobState::Active && self.log_path(&job.id).exists()))
    }

    /// Changes the state and the reason of a job that has ended. Keeps the time of its end, or sets it to now if it is
    /// not known.
    fn settle(&mut self, job: &Job, state: JobState, reason: &str) {
        self.write(JobUpdate::State {
            id: job.id.clone(),
            state,
            reason: Some(reason.to_owned()),
            ended_utc: job.ended_utc.clone().or_else(|| Some(utc_now())),
        });
    }
}

impl RobotWorker {
    /// Corrects the states of the robot's jobs, except the `current` one, by their run logs and by the board's status.
    /// Afterwards only the job that the board stores can be resumed.
    pub(super) fn reconcile_jobs(&self, status: &Status, current: Option<&str>) {
        // A board that tests itself has not read its journal yet.
        if status.state != State::SelfTest {
            let body = current.is_none().then_some(status);
            self.settle_jobs(body, current, status.plan_id, NOT_ON_BOARD);
        }
    }

    /// Marks the robot's unfinished jobs, except the `current` one, as failed for this reason, because the board no
    /// longer stores them.
    pub(super) fn give_up_others(&self, current: Option<&str>, reason: &str) {
        self.settle_jobs(None, current, 0, reason);
    }

    /// Corrects the states of the robot's unfinished jobs, except the `current` one. `body` is the status of the board
    /// if the board may store one of these jobs. Jobs that the board does not store become failed for this `reason`.
    fn settle_jobs(&self, mut body: Option<&Status>, current: Option<&str>, plan_id: u64, reason: &str) {
        let mut store = self.shared.jobs();
        let jobs = match store.unsettled(&self.name, plan_id) {
            Ok(jobs) => jobs,
            Err(error) => return log::warn!("{error}"),
        };
        for mut job in jobs.into_iter().filter(|job| Some(job.id.as_str()) != current) {
            // Without a readable log it is unknown which body the job has.
            let Ok(mut record) = RecordedRun::open(&store.log_path(&job.id)) else { continue };
            if let Some(result) = record.result.as_ref().filter(|_| job.state == JobState::Active) {
                let laid = u32::try_from(record.as_built.len()).unwrap_or(u32::MAX);
                store.set_laid(&job.id, laid, record.total);
                job.state = JobState::from_outcome(result.outcome);
                store.settle(&job, job.state, &end_reason(result, record.board_state.as_deref()));
                if job.state != JobState::Interrupted {
                    continue;
                }
            }
            if let Some(status) = body {
                record.sync_to_board(status.plan_id);
            }
            match body.filter(|status| status.plan_id == record.plan_id) {
                Some(status) => {
                    body = None;
                    store.set_laid(&job.id, status.layers_laid, record.total);
                    if job.state != JobState::Interrupted {
                        store.settle(&job, JobState::Interrupted, "interrupted: the board has its body");
                    }
                }
                None if job.state == JobState::Failed => {}
                None => store.settle(&job, JobState::Failed, reason),
            }
        }
        drop(store);
        self.shared.signal_change();
    }

    /// Keeps the run log of a job that has ended, because some lines of the log could not be written.
    pub(super) fn keep_log(&self, job: &str, log: RunLog) {
        self.lock_kept_logs().push((job.to_owned(), log));
    }

    /// Drops the run log that [`Self::keep_log`] kept for this job, with the lines that could not be written.
    pub(super) fn drop_kept_log(&self, job: &str) {
        self.lock_kept_logs().retain(|(of, _)| of != job);
    }

    /// Tries again to write the changes of the list of jobs, and the lines of run logs, that could not be written
    /// before. Does not wait for other threads.
    pub(super) fn write_kept(&self) {
        if let Ok(mut store) = self.shared.job_writer.try_lock()
            && store.has_kept()
            && store.try_write_kept().is_ok()
        {
            self.shared.signal_change();
        }
        self.lock_kept_logs().retain_mut(|(_, log)| log.write_waiting().is_err());
    }

    /// Reports whether changes of the list of jobs or lines of run logs have still to be written.
    pub(super) fn has_kept(&self) -> bool {
        self.shared.job_writer.try_lock().is_ok_and(|store| store.has_kept()) || !self.lock_kept_logs().is_empty()
    }

    fn lock_kept_logs(&self) -> MutexGuard<'_, Vec<(String, RunLog)>> {
        self.kept_logs.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
