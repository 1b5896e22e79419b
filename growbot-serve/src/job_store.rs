//! List of all jobs of the service, in an SQLite database. The list can be rebuilt from the run logs, which are the
//! authoritative record.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::Sender;
use std::time::Duration;

use growbot_plan::run_log::{RecordedRun, utc_now};
use growbot_remote::api::{Job, JobState, end_reason};
use rusqlite::{Connection, OpenFlags, OptionalExtension, Row, named_params};

use super::job_updates::KeptUpdates;
use super::paths::ServicePaths;
use crate::job_updates::JobUpdate;

/// Time for which a change waits for other users of the database.
pub(super) const BUSY_TIMEOUT: Duration = Duration::from_secs(2);
/// Maximum number of changes that are kept until they can be written. If there are more, the oldest changes are
/// dropped.
const MAX_KEPT: usize = 1000;
/// Version of the tables, which the database stores as `PRAGMA user_version`. It rises with each change of [`TABLES`].
const VERSION: i64 = 5;

/// SQL statements that create the tables: the jobs, the queued notices, and the conditions of each robot that were
/// reported last.
const TABLES: &str = "
    CREATE TABLE job (
        id TEXT PRIMARY KEY,
        robot TEXT NOT NULL,
        name TEXT NOT NULL,
        state TEXT NOT NULL,
        plan_id TEXT NOT NULL,
        layers INTEGER NOT NULL,
        laid INTEGER NOT NULL DEFAULT 0,
        length_mm REAL NOT NULL,
        simulated INTEGER NOT NULL,
        ignore_scene INTEGER NOT NULL,
        created_utc TEXT NOT NULL,
        ended_utc TEXT,
        why TEXT,
        idempotency_key TEXT UNIQUE,
        request_hash TEXT
    ) STRICT;
    CREATE TABLE notice (
        id INTEGER PRIMARY KEY AUTOINCREMENT,
        channel TEXT NOT NULL,
        notice TEXT NOT NULL,
        created_ms INTEGER NOT NULL,
        due_ms INTEGER NOT NULL,
        attempts INTEGER NOT NULL DEFAULT 0
    ) STRICT;
    CREATE INDEX notice_by_time ON notice (channel, due_ms);
    CREATE TABLE alert (
        robot TEXT NOT NULL,
        name TEXT NOT NULL,
        value TEXT NOT NULL,
        PRIMARY KEY (robot, name)
    ) STRICT;
";

/// Errors of the list of jobs.
#[derive(Debug, thiserror::Error)]
pub enum JobStoreError {
    /// A file or directory cannot be used.
    #[error("cannot use {path}: {error}; the service needs a writable directory of its own", path = .path.display())]
    File {
        /// Path of the file.
        path: PathBuf,
        /// Error of the operating system.
        error: io::Error,
    },
    /// Another release has written the database.
    #[error(
        "{path} was written by {} release of growbot (tables {found}, this release uses {VERSION}): use that release, \
         or move the file away, and the service rebuilds the list from the run logs next to it",
        if *found > VERSION { "a later" } else { "an earlier" },
        path = .path.display()
    )]
    OtherVersion {
        /// Path of the database.
        path: PathBuf,
        /// Version of the tables in the database.
        found: i64,
    },
    /// SQLite has failed.
    #[error(
        "cannot read or write the list of jobs: {0}; if the disk is full, free space; otherwise stop the service, move \
         jobs.sqlite away, and start the service again, which then rebuilds the list from the run logs"
    )]
    Database(#[from] rusqlite::Error),
}

impl JobStoreError {
    /// Converts an error of the operating system about a file.
    pub fn from_io(path: &Path, error: io::Error) -> Self {
        Self::File { path: path.to_path_buf(), error }
    }
}

/// List of all jobs: a connection to the database, and the changes that could not be written yet.
pub struct JobStore {
    pub(super) database: Connection,
    logs: PathBuf,
    pub(super) kept: KeptUpdates,
    /// Senders of messages that wake the threads that send notices.
    pub(super) wakers: Vec<Sender<()>>,
}

pub(super) const COLUMNS: &str =
    "id, robot, name, state, plan_id, layers, laid, length_mm, simulated, ignore_scene, created_utc, ended_utc, why";

impl JobStore {
    /// Opens the list of jobs. A missing or damaged list is rebuilt from the run logs.
    pub fn open(places: &ServicePaths) -> Result<Self, JobStoreError> {
        places.create().map_err(|error| JobStoreError::from_io(places.state_dir(), error))?;
        let path = places.database();
        let is_new = !path.exists();
        let mut jobs = Self::new(Connection::open(&path)?, places);
        if !is_new && !jobs.is_sound() {
            let aside = path.with_extension("damaged");
            fs::rename(&path, &aside).map_err(|error| JobStoreError::from_io(&path, error))?;
            log::warn!(
                "the list of jobs is damaged: it was rebuilt from the run logs, and the old file is kept as {}",
                aside.display()
            );
            jobs.database = Connection::open(&path)?;
        }
        jobs.database.execute_batch("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL;")?;
        jobs.database.busy_timeout(BUSY_TIMEOUT)?;
        let found: i64 = jobs.database.query_row("PRAGMA user_version", [], |row| row.get(0))?;
        match found {
            0 => jobs.create_tables()?,
            VERSION => {}
            _ => return Err(JobStoreError::OtherVersion { path, found }),
        }
        jobs.fail_unstarted()?;
        Ok(jobs)
    }

    fn new(database: Connection, places: &ServicePaths) -> Self {
        Self { database, logs: places.logs(), kept: KeptUpdates::default(), wakers: Vec::new() }
    }

    /// Marks as failed the jobs in the list that no robot had started when the service ended. Such jobs have no run
    /// log.
    fn fail_unstarted(&mut self) -> Result<(), JobStoreError> {
        let mut statement = self.database.prepare("SELECT id FROM job WHERE state = 'active'")?;
        let active: Vec<String> = statement.query_map([], |row| row.get(0))?.collect::<Result<_, _>>()?;
        drop(statement);
        for id in active.iter().filter(|id| !self.log_path(id).exists()).collect::<Vec<_>>() {
            self.set_state(id, JobState::Failed, Some("the service ended before the job started"));
        }
        Ok(())
    }

    /// Creates the tables, and inserts a job for each run log, in one transaction.
    fn create_tables(&self) -> Result<(), JobStoreError> {
        let transaction = self.database.unchecked_transaction()?;
        self.database.execute_batch(TABLES)?;
        self.rebuild()?;
        self.database.pragma_update(None, "user_version", VERSION)?;
        Ok(transaction.commit()?)
    }

    /// Opens a second, read-only connection to the list. [`JobStore::open`] must have created the list before.
    pub fn open_to_read(places: &ServicePaths) -> Result<Self, JobStoreError> {
        let database = Connection::open_with_flags(places.database(), OpenFlags::SQLITE_OPEN_READ_ONLY)?;
        database.busy_timeout(BUSY_TIMEOUT)?;
        Ok(Self::new(database, places))
    }

    fn is_sound(&self) -> bool {
        let checked: Result<String, _> = self.database.query_row("PRAGMA integrity_check", [], |row| row.get(0));
        checked.is_ok_and(|result| result == "ok")
    }

    /// Inserts a job into the list for each run log that can be read.
    fn rebuild(&self) -> Result<(), JobStoreError> {
        let entries = fs::read_dir(&self.logs).map_err(|error| JobStoreError::from_io(&self.logs, error))?;
        // Jobs are listed in the order in which they are entered.
        let mut paths: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
        paths.sort();
        for path in paths {
            let Some(id) = path.file_stem().and_then(|id| id.to_str()) else { continue };
            let Some((_, robot)) = id.split_once('_') else { continue };
            let record = match RecordedRun::open(&path) {
                Ok(record) => record,
                Err(error) => {
                    log::warn!("a job is missing from the list, because its run log cannot be read: {error}");
                    continue;
                }
            };
            let created = id.split('_').next().unwrap_or_default();
            let outcome = record.result.as_ref().map(|result| result.outcome);
            let job = Job {
                id: id.to_owned(),
                robot: robot.to_owned(),
                name: id.to_owned(),
                state: outcome.map_or(JobState::Active, JobState::from_outcome),
                plan_id: format!("{:016x}", record.plan_id),
                layers: record.total,
                laid: u32::try_from(record.as_built.len()).unwrap_or(u32::MAX),
                length_mm: record.plan.length_mm,
                simulated: record.is_simulated(),
                ignore_scene: record.ignore_scene,
                created_utc: written_time(created),
                ended_utc: None,
                reason: record.result.as_ref().map(|result| end_reason(result, record.board_state.as_deref())),
            };
            self.insert(&job, None)?;
        }
        Ok(())
    }

    /// Returns a new identifier for a job of this robot.
    pub fn new_id(&self, robot: &str) -> String {
        let now = utc_now();
        let time: String = now.chars().filter(|letter| letter.is_ascii_digit() || *letter == 'T').collect();
        (0_u32..)
            .map(|more| match more {
                0 => format!("{time}_{robot}"),
                more => format!("{time}{more:02}_{robot}"),
            })
            .find(|id| !self.log_path(id).exists())
            .unwrap_or_default()
    }

    /// Returns the path of a job's run log.
    pub fn log_path(&self, id: &str) -> PathBuf {
        self.logs.join(format!("{id}.jsonl"))
    }

    /// Inserts a job into the list. `request` is the idempotency key of the client's request for the job, and the hash
    /// of that request.
    pub fn insert(&self, job: &Job, request: Option<(&str, &str)>) -> Result<(), JobStoreError> {
        let insert = format!(
            "INSERT INTO job ({COLUMNS}, idempotency_key, request_hash) VALUES (:id, :robot, :name, :state, :plan_id, \
             :layers, :laid, :length_mm, :simulated, :ignore_scene, :created_utc, :ended_utc, :why, :key, :hash)"
        );
        self.database.execute(
            &insert,
            named_params! {
                ":id": job.id, ":robot": job.robot, ":name": job.name, ":state": job.state.name(),
                ":plan_id": job.plan_id, ":layers": job.layers, ":laid": job.laid, ":length_mm": job.length_mm,
                ":simulated": job.simulated, ":ignore_scene": job.ignore_scene, ":created_utc": job.created_utc, ":ended_utc": job.ended_utc,
                ":why": job.reason, ":key": request.map(|(key, _)| key), ":hash": request.map(|(_, hash)| hash),
            },
        )?;
        Ok(())
    }

    /// Returns the job that was created with this idempotency key, and the hash of the client's request for it. `None`
    /// without such a job.
    pub fn find_by_key(&self, key: &str) -> Result<Option<(Job, String)>, JobStoreError> {
        let query = format!("SELECT {COLUMNS}, request_hash FROM job WHERE idempotency_key = ?1");
        Ok(self.database.query_row(&query, [key], |row| Ok((of_row(row)?, row.get(13)?))).optional()?)
    }

    /// Returns the job with this identifier. `None` if it is not in the list.
    pub fn get(&self, id: &str) -> Result<Option<Job>, JobStoreError> {
        let query = format!("SELECT {COLUMNS} FROM job WHERE id = ?1");
        Ok(self.database.query_row(&query, [id], of_row).optional()?)
    }

    /// Returns the latest jobs, newest first. They are sorted by insertion and not by time, because the clock may be
    /// set back.
    pub fn latest(&self, max: u32) -> Result<Vec<Job>, JobStoreError> {
        let query = format!("SELECT {COLUMNS} FROM job ORDER BY rowid DESC LIMIT ?1");
        let mut statement = self.database.prepare(&query)?;
        let rows = statement.query_map([max], of_row)?;
        Ok(rows.collect::<Result<_, _>>()?)
    }

    /// Returns the latest job of a robot that has laid a layer. `None` if there is none.
    pub fn latest_body(&self, robot: &str) -> Result<Option<Job>, JobStoreError> {
        let query = format!("SELECT {COLUMNS} FROM job WHERE robot = ?1 AND laid > 0 ORDER BY rowid DESC LIMIT 1");
        Ok(self.database.query_row(&query, [robot], of_row).optional()?)
    }
}

impl JobStore {
    /// Records the number of laid layers of a job, and the number of all its layers.
    pub(super) fn set_laid(&mut self, id: &str, laid: u32, layers: u32) {
        self.write(JobUpdate::Progress { id: id.to_owned(), laid, layers });
    }

    /// Changes the state of a job.
    pub(super) fn set_state(&mut self, id: &str, state: JobState, reason: Option<&str>) {
        let ended_utc = (state != JobState::Active).then(utc_now);
        self.write(JobUpdate::State { id: id.to_owned(), state, reason: reason.map(str::to_owned), ended_utc });
    }

    /// Ends a job that the robot has rejected. Its idempotency key can be used again.
    pub(super) fn mark_rejected(&mut self, id: &str, reason: &str) {
        self.set_state(id, JobState::Failed, Some(reason));
        self.write(JobUpdate::ReleasedKey { id: id.to_owned() });
    }

    /// Writes all changes that are kept in memory, then this change. Keeps this change in memory if the database cannot
    /// be written.
    pub(super) fn write(&mut self, update: JobUpdate) {
        let fails_already = self.has_kept();
        self.kept.retain(|earlier| !update.replaces(earlier));
        self.kept.push_back(update);
        if self.kept.len() > MAX_KEPT {
            self.kept.pop_front();
        }
        if let Err(error) = self.write_kept()
            && !fails_already
        {
            log::warn!(
                "cannot write the list of jobs ({error}): its changes are kept in memory, and written once that is \
                 possible; if the disk is full, free space"
            );
        }
    }

    /// Writes all changes that are kept in memory, the oldest first.
    pub(super) fn write_kept(&mut self) -> rusqlite::Result<()> {
        while let Some(update) = self.kept.front() {
            update.apply(&self.database)?;
            if matches!(update, JobUpdate::Notice { .. } | JobUpdate::Alert(_)) {
                // The thread of a channel runs as long as the service.
                self.wakers.iter().for_each(|waker| _ = waker.send(()));
            }
            self.kept.pop_front();
        }
        Ok(())
    }

    /// Like [`Self::write_kept`], but does not wait for other users of the database.
    pub(super) fn try_write_kept(&mut self) -> rusqlite::Result<()> {
        self.database.busy_timeout(Duration::ZERO)?;
        let written = self.write_kept();
        self.database.busy_timeout(BUSY_TIMEOUT)?;
        written
    }

    /// Returns true if changes are kept in memory because they could not be written yet.
    pub(super) fn has_kept(&self) -> bool {
        !self.kept.is_empty()
    }

    /// Returns the state that a change in memory gives this job. `None` without such a change.
    pub(super) fn kept_state(&self, id: &str) -> Option<JobState> {
        self.kept.iter().find_map(|update| match update {
            JobUpdate::State { id: of, state, .. } if of == id => Some(*state),
            _ => None,
        })
    }

    /// Returns the identifiers of the jobs that a change in memory makes active.
    pub(super) fn kept_active(&self) -> Vec<&str> {
        let active = self.kept.iter().filter_map(|update| match update {
            JobUpdate::State { id, state: JobState::Active, .. } => Some(id.as_str()),
            _ => None,
        });
        active.collect()
    }
}

pub(super) fn of_row(row: &Row) -> rusqlite::Result<Job> {
    Ok(Job {
        id: row.get(0)?,
        robot: row.get(1)?,
        name: row.get(2)?,
        state: row.get::<_, String>(3)?.parse().unwrap_or(JobState::Failed),
        plan_id: row.get(4)?,
        layers: row.get(5)?,
        laid: row.get(6)?,
        length_mm: row.get(7)?,
        simulated: row.get(8)?,
        ignore_scene: row.get(9)?,
        created_utc: row.get(10)?,
        ended_utc: row.get(11)?,
        reason: row.get(12)?,
    })
}

/// Converts the time in a job's identifier, such as `20261123T014500123`, to RFC 3339.
fn written_time(compact: &str) -> String {
    let part = |from: usize, to: usize| compact.get(from..to).unwrap_or("00");
    format!(
        "{}-{}-{}T{}:{}:{}.{}Z",
        part(0, 4),
        part(4, 6),
        part(6, 8),
        part(9, 11),
        part(11, 13),
        part(13, 15),
        part(15, 18)
    )
}

#[cfg(test)]
mod tests {
    use super::super::notification::NotificationChannel;
    use super::*;
    use growbot_client::robot_command::RobotCommand as C;

    #[test]
    fn names_in_the_database_and_in_urls() {
        use JobState::{Active, Done, Failed, Interrupted};
        for (state, name) in [(Active, "active"), (Interrupted, "interrupted"), (Done, "done"), (Failed, "failed")] {
            assert_eq!((state.name(), name.parse()), (name, Ok(state)));
        }
        assert_eq!(NotificationChannel::Webhook.name(), "webhook");
        assert_eq!(NotificationChannel::Command.name(), "command");
        let commands =
            [C::Pause, C::Continue, C::Stop, C::EmergencyStop, C::ClearFault, C::Cancel, C::WithdrawStop].map(C::name);
        let names = ["pause", "continue", "stop", "emergency-stop", "clear-fault", "cancel", "withdraw-stop"];
        assert_eq!(commands, names);
    }

    /// Creates a database with one job and this version of the tables.
    fn of_version(version: i64) -> (tempfile::TempDir, ServicePaths) {
        let directory = tempfile::tempdir().unwrap();
        let places = ServicePaths::in_dir(directory.path().to_path_buf());
        places.create().unwrap();
        let database = Connection::open(places.database()).unwrap();
        database.execute_batch(TABLES).unwrap();
        database.pragma_update(None, "user_version", version).unwrap();
        let job = "INSERT INTO job VALUES ('20261123T014500123_lab', 'lab', 'a body', 'done', '00000000000000ff', 78, \
                   78, 60.0, 1, 0, '2026-11-23T01:45:00.123Z', '2026-11-23T02:45:00Z', 'done', 'a key', 'a hash')";
        database.execute(job, []).unwrap();
        (directory, places)
    }

    #[test]
    fn a_database_of_this_version_keeps_its_jobs() {
        let (_directory, places) = of_version(VERSION);
        for _ in 0..2 {
            let (job, hash) = JobStore::open(&places).unwrap().find_by_key("a key").unwrap().unwrap();
            assert_eq!(hash, "a hash");
            assert_eq!((job.id.as_str(), job.laid, job.state), ("20261123T014500123_lab", 78, JobState::Done));
        }
    }

    #[test]
    fn jobs_keep_their_order_when_the_clock_is_set_back() {
        let (_directory, places) = of_version(VERSION);
        let jobs = JobStore::open(&places).unwrap();
        let first = jobs.get("20261123T014500123_lab").unwrap().unwrap();
        let later = Job {
            id: "20261122T230000000_lab".to_owned(),
            created_utc: "2026-11-22T23:00:00.000Z".to_owned(),
            state: JobState::Interrupted,
            ..first
        };
        jobs.insert(&later, Some(("another key", "another hash"))).unwrap();
        let listed: Vec<String> = jobs.latest(9).unwrap().into_iter().map(|job| job.id).collect();
        assert_eq!(listed, ["20261122T230000000_lab", "20261123T014500123_lab"]);
    }

    #[test]
    fn a_job_is_active_from_its_run_log_on() {
        let (_directory, places) = of_version(VERSION);
        let mut jobs = JobStore::open(&places).unwrap();
        jobs.set_state("20261123T014500123_lab", JobState::Active, None);
        assert_eq!(jobs.active("lab").unwrap(), None);
        fs::write(jobs.log_path("20261123T014500123_lab"), "{}").unwrap();
        assert_eq!(JobStore::open(&places).unwrap().active("lab").unwrap().unwrap().laid, 78);
        fs::remove_file(jobs.log_path("20261123T014500123_lab")).unwrap();
        let ended = JobStore::open(&places).unwrap().get("20261123T014500123_lab").unwrap().unwrap();
        assert_eq!(
            (ended.state, ended.reason.as_deref()),
            (JobState::Failed, Some("the service ended before the job started"))
        );
    }

    #[test]
    fn a_database_of_another_release_is_refused_unchanged() {
        for (version, which) in [(1, "an earlier"), (VERSION - 1, "an earlier"), (VERSION + 1, "a later")] {
            let (_directory, places) = of_version(version);
            let message = JobStore::open(&places).err().unwrap().to_string();
            let found = format!("{which} release of growbot (tables {version}, this release uses {VERSION})");
            for part in ["jobs.sqlite", &found, "move the file away", "rebuilds the list from the run logs"] {
                assert!(message.contains(part), "{message}");
            }
            let database = Connection::open(places.database()).unwrap();
            let kept: i64 = database.query_row("PRAGMA user_version", [], |row| row.get(0)).unwrap();
            assert_eq!(kept, version);
            assert_eq!(database.query_row("SELECT count(*) FROM job", [], |row| row.get(0)), Ok(1_i64));
        }
    }
}
