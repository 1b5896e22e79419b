//! All jobs of the service, in SQLite. The run logs are the record: the list can be made anew from them.

use std::fs;
use std::path::{Path, PathBuf};

use growbot_client::run_log::{ResultOutcome, RunRecord, utc_now};
use rusqlite::{Connection, OptionalExtension, Row, named_params};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Places;

/// Version of the tables: `PRAGMA user_version`.
const VERSION: i64 = 1;

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
        created_utc TEXT NOT NULL,
        ended_utc TEXT,
        why TEXT,
        idempotency_key TEXT UNIQUE
    ) STRICT;
    CREATE INDEX job_by_time ON job (created_utc);
    PRAGMA user_version = 1;
";

/// Why the list of jobs cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum JobsError {
    /// A file or directory.
    #[error("cannot use {path}: {reason}; the service needs a directory of its own that it can write to", path = .path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        reason: String,
    },
    /// The database is of a later release.
    #[error(
        "{path} was written by a later release of growbot (tables {found}, known {VERSION}): use that release, or move \
         the file away: the list is made anew from the run logs beside it",
        path = .path.display()
    )]
    Later {
        /// The database.
        path: PathBuf,
        /// Its version.
        found: i64,
    },
    /// The database.
    #[error("the list of jobs: {0}; it is made anew from the run logs when jobs.sqlite is moved away")]
    Database(#[from] rusqlite::Error),
}

impl JobsError {
    /// The system's reason about a file.
    pub fn of(path: &Path, error: &std::io::Error) -> Self {
        Self::File { path: path.to_path_buf(), reason: error.to_string() }
    }
}

/// How a job stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum JobState {
    /// The board has it, or is getting it: it heats, homes, grows or pauses.
    Active,
    /// It was left unfinished, and can be resumed.
    Interrupted,
    /// Every layer is laid.
    Done,
    /// It ended otherwise, and cannot be resumed here.
    Ended,
}

impl JobState {
    fn name(self) -> &'static str {
        match self {
            Self::Active => "active",
            Self::Interrupted => "interrupted",
            Self::Done => "done",
            Self::Ended => "ended",
        }
    }

    fn of(name: &str) -> Self {
        [Self::Active, Self::Interrupted, Self::Done]
            .into_iter()
            .find(|state| state.name() == name)
            .unwrap_or(Self::Ended)
    }

    /// What a growth's outcome makes of a job.
    pub fn after(outcome: ResultOutcome) -> Self {
        match outcome {
            ResultOutcome::Done => Self::Done,
            ResultOutcome::Refused => Self::Ended,
            _ => Self::Interrupted,
        }
    }
}

/// A job.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Job {
    /// Its name in addresses: the time of its creation, and a number.
    pub id: String,
    /// The robot, as the service calls it.
    pub robot: String,
    /// What people call it.
    pub name: String,
    /// How it stands.
    pub state: JobState,
    /// Hash of its layers when it was created, 16 hexadecimal digits.
    pub plan_id: String,
    /// Its layers.
    pub layers: u32,
    /// Layers laid.
    pub laid: u32,
    /// Length of its path, mm.
    pub length_mm: f64,
    /// Whether the robot is a simulated one.
    pub simulated: bool,
    /// When it was created, RFC 3339.
    pub created_utc: String,
    /// When it ended, RFC 3339; null while it has not.
    pub ended_utc: Option<String>,
    /// How it ended, or why it was left: the outcome, or a message.
    pub why: Option<String>,
}

/// The list of jobs.
pub struct Jobs {
    database: Connection,
    logs: PathBuf,
}

const COLUMNS: &str =
    "id, robot, name, state, plan_id, layers, laid, length_mm, simulated, created_utc, ended_utc, why";

impl Jobs {
    /// Opens the list, and makes it anew from the run logs where there is none, or where it is damaged.
    pub fn open(places: &Places) -> Result<Self, JobsError> {
        places.create().map_err(|error| JobsError::of(places.state(), &error))?;
        let path = places.database();
        let is_new = !path.exists();
        let mut jobs = Self { database: Connection::open(&path)?, logs: places.logs() };
        if !is_new && !jobs.is_sound() {
            let aside = path.with_extension("damaged");
            fs::rename(&path, &aside).map_err(|error| JobsError::of(&path, &error))?;
            crate::warning!(
                "the list of jobs is damaged: it is made anew from the run logs, and kept as {}",
                aside.display()
            );
            jobs.database = Connection::open(&path)?;
        }
        jobs.database
            .execute_batch("PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; PRAGMA busy_timeout = 2000;")?;
        match jobs.database.query_row("PRAGMA user_version", [], |row| row.get(0))? {
            0 => {
                jobs.database.execute_batch(TABLES)?;
                jobs.rebuild()?;
            }
            VERSION => {}
            found => return Err(JobsError::Later { path, found }),
        }
        Ok(jobs)
    }

    fn is_sound(&self) -> bool {
        let checked: Result<String, _> = self.database.query_row("PRAGMA integrity_check", [], |row| row.get(0));
        checked.is_ok_and(|said| said == "ok")
    }

    /// Enters all jobs of which there is a run log.
    fn rebuild(&self) -> Result<(), JobsError> {
        let entries = fs::read_dir(&self.logs).map_err(|error| JobsError::of(&self.logs, &error))?;
        for path in entries.flatten().map(|entry| entry.path()) {
            let Some((id, record)) = path.file_stem().and_then(|id| id.to_str()).zip(RunRecord::open(&path).ok())
            else {
                continue;
            };
            let Some((_, robot)) = id.split_once('_') else { continue };
            let created = id.split('_').next().unwrap_or_default();
            let outcome = record.result.as_ref().map(|result| result.outcome);
            let job = Job {
                id: id.to_owned(),
                robot: robot.to_owned(),
                name: id.to_owned(),
                state: outcome.map_or(JobState::Active, JobState::after),
                plan_id: format!("{:016x}", record.plan_id),
                layers: record.total,
                laid: u32::try_from(record.as_built.len()).unwrap_or(u32::MAX),
                length_mm: record.plan.length_mm,
                simulated: record.is_simulated(),
                created_utc: written_time(created),
                ended_utc: None,
                why: outcome.map(|outcome| outcome.name().to_owned()),
            };
            self.enter(&job, None)?;
        }
        Ok(())
    }

    /// A name for a job of this robot that no other has.
    pub fn new_id(&self, robot: &str) -> String {
        let now = utc_now();
        let time: String = now.chars().filter(|letter| letter.is_ascii_digit() || *letter == 'T').collect();
        (0_u32..)
            .map(|more| match more {
                0 => format!("{time}_{robot}"),
                more => format!("{time}{more:02}_{robot}"),
            })
            .find(|id| !self.log(id).exists())
            .unwrap_or_default()
    }

    /// The run log of a job.
    pub fn log(&self, id: &str) -> PathBuf {
        self.logs.join(format!("{id}.jsonl"))
    }

    /// Enters a job.
    pub fn enter(&self, job: &Job, key: Option<&str>) -> Result<(), JobsError> {
        let insert = format!(
            "INSERT OR REPLACE INTO job ({COLUMNS}, idempotency_key) VALUES (:id, :robot, :name, :state, :plan_id, \
             :layers, :laid, :length_mm, :simulated, :created_utc, :ended_utc, :why, :key)"
        );
        self.database.execute(
            &insert,
            named_params! {
                ":id": job.id, ":robot": job.robot, ":name": job.name, ":state": job.state.name(),
                ":plan_id": job.plan_id, ":layers": job.layers, ":laid": job.laid, ":length_mm": job.length_mm,
                ":simulated": job.simulated, ":created_utc": job.created_utc, ":ended_utc": job.ended_utc,
                ":why": job.why, ":key": key,
            },
        )?;
        Ok(())
    }

    /// The job that was created with this key.
    pub fn with_key(&self, key: &str) -> Result<Option<Job>, JobsError> {
        self.one("idempotency_key = ?1", key)
    }

    /// The job of this name.
    pub fn get(&self, id: &str) -> Result<Option<Job>, JobsError> {
        self.one("id = ?1", id)
    }

    /// The job that a robot has under way.
    pub fn active(&self, robot: &str) -> Result<Option<Job>, JobsError> {
        self.one("state = 'active' AND robot = ?1", robot)
    }

    fn one(&self, which: &str, value: &str) -> Result<Option<Job>, JobsError> {
        let query = format!("SELECT {COLUMNS} FROM job WHERE {which} ORDER BY created_utc DESC LIMIT 1");
        Ok(self.database.query_row(&query, [value], of_row).optional()?)
    }

    /// The latest jobs, the newest first.
    pub fn latest(&self, max: u32) -> Result<Vec<Job>, JobsError> {
        let query = format!("SELECT {COLUMNS} FROM job ORDER BY created_utc DESC, id DESC LIMIT ?1");
        let mut statement = self.database.prepare(&query)?;
        let rows = statement.query_map([max], of_row)?;
        Ok(rows.collect::<Result<_, _>>()?)
    }

    /// So many layers of a job are laid.
    pub fn laid(&self, id: &str, laid: u32, layers: u32) -> Result<(), JobsError> {
        self.database.execute("UPDATE job SET laid = ?2, layers = ?3 WHERE id = ?1", (id, laid, layers))?;
        Ok(())
    }

    /// A job stands otherwise.
    pub fn set(&self, id: &str, state: JobState, why: Option<&str>) -> Result<(), JobsError> {
        let ended = (state != JobState::Active).then(utc_now);
        let update = "UPDATE job SET state = ?2, why = ?3, ended_utc = ?4 WHERE id = ?1";
        self.database.execute(update, (id, state.name(), why, ended))?;
        Ok(())
    }
}

fn of_row(row: &Row) -> rusqlite::Result<Job> {
    Ok(Job {
        id: row.get(0)?,
        robot: row.get(1)?,
        name: row.get(2)?,
        state: JobState::of(&row.get::<_, String>(3)?),
        plan_id: row.get(4)?,
        layers: row.get(5)?,
        laid: row.get(6)?,
        length_mm: row.get(7)?,
        simulated: row.get(8)?,
        created_utc: row.get(9)?,
        ended_utc: row.get(10)?,
        why: row.get(11)?,
    })
}

/// `20261123T014500123` as RFC 3339.
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
