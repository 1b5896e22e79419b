//! The log of a growth (run log): a file with one JSON object per line, flushed after each line. If a log is cut off or
//! contains damaged lines, all its other lines can still be read.
//!
//! The first line contains the versions, the command, the robot, the plan, the layers that were sent, and the
//! disturbances of a simulated tip. The other lines contain the events, among them the layers as built, in the bytes of
//! the link. The body can therefore be rebuilt from the log bit for bit ([`RecordedRun`]), and a growth that was
//! interrupted is resumed from its log. For a simulated tip, the log also contains the true position of its plastic.
//!
//! - [`RunLog`]: writes a log; [`RecordedRun`]: reads it; [`Events`]: its lines, with a count of unreadable ones;
//! - [`RunEvent`]: the events of a log, with [`RunHeader`] in the first line and [`GrowthResult`] in the last.
//!
//! The position of a simulated layer's plastic is logged once two later layers have begun, because it no longer changes
//! then. Views, exports and `replay` show the body of this plastic, and beside it the commanded body, which is computed
//! from the steps of the motors. For a real robot, only the commanded body is known.

mod event;
mod header;
mod lenient;
mod queue;
mod reader;
mod recorded_run;
mod result;

use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::num::NonZero;
use std::path::{Path, PathBuf};

use growbot_core::pose::Frame;
use growbot_core::simulation::ErrorModel;
use growbot_core::tracking::SensorNoise;
use time::OffsetDateTime;
use time::format_description::well_known::Iso8601;
use time::format_description::well_known::iso8601::{Config, EncodedConfig, TimePrecision};

pub use self::event::{
    BoardRecord, BoardStatus, LaidLayer, LayerJson, MeasuredJson, RunEvent, RunLine, SimulatedLayer, to_run_events,
};
pub use self::header::{
    Distribution, DisturbancesJson, FORMAT, ResumeRecord, RunHeader, SensorNoiseJson, TipKind, Unit,
};
pub(crate) use self::lenient::lenient;
use self::queue::LineQueue;
pub use self::reader::{Damage, Events};
pub use self::recorded_run::{BodyKind, ReadRunLogError, RecordedRun, RobotId};
pub use self::result::{ArrivalJson, FeedbackResult, GrowthResult, InterruptedLayerJson, OutcomeKind};
use crate::atomic_file::{DisplacedFile, FileError, format_from_extension, refuse_inputs};
use crate::forecast::Forecast;
use crate::job::{Job, JobEvent};
use crate::plan::Plan;
use crate::plan_file::PlanFile;
use crate::sanitize::json_line;

/// File extensions of run logs.
const ENDINGS: [&str; 2] = ["jsonl", "json"];

/// Error of writing a log.
#[derive(Debug, thiserror::Error)]
pub enum RunLogError {
    /// The log's file cannot be created, or an existing log cannot be opened to resume it.
    #[error("cannot write the run log {file}: {error}; make it writable")]
    Begin {
        /// Name of the log's file.
        file: String,
        /// Error of the operating system.
        error: io::Error,
    },
    /// A line cannot be written and waits in memory.
    #[error(
        "cannot write the run log {file}: {error}; the growth continues, and the missing lines are kept in memory \
         until they can be written: free disk space there, or make the file writable"
    )]
    Write {
        /// Name of the log's file.
        file: String,
        /// Error of the operating system.
        error: io::Error,
    },
    /// The file exists already.
    #[error("the run log {file} already exists and may be the only record of a body: choose another name")]
    Exists {
        /// Name of the log's file.
        file: String,
    },
    /// The file has a wrong extension, or is an input of the command.
    #[error(transparent)]
    Place(#[from] FileError),
}

impl RunLogError {
    /// Returns the reason without the name of the file.
    pub fn reason(&self) -> String {
        match self {
            Self::Begin { error, .. } | Self::Write { error, .. } => error.to_string(),
            Self::Exists { .. } => self.to_string(),
            Self::Place(error) => error.to_string(),
        }
    }
}

/// Port, disturbances and use of the scene of a growth, for the first line of its log.
#[derive(Debug, Clone, Copy, Default)]
pub struct RunOrigin<'a> {
    /// The port as the user gave it.
    pub port: &'a str,
    /// Disturbances of a simulated tip. `None` for a real robot.
    pub imperfection: Option<&'a ErrorModel>,
    /// True if the body is grown without regard to the scene of its plan.
    pub ignores_scene: bool,
}

impl<'a> From<&'a str> for RunOrigin<'a> {
    /// Creates the origin of a growth on this port, with the tip of a real robot.
    fn from(port: &'a str) -> Self {
        Self { port, imperfection: None, ignores_scene: false }
    }
}

/// Writer of a run log. It may be disabled, and then writes nothing.
#[derive(Default)]
pub struct RunLog(Option<OpenLog>);

/// State of a log that is being written.
struct OpenLog {
    lines: LineQueue,
    file: String,
    /// True if this growth has created the file, so the file may be deleted if the growth does not begin.
    is_new: bool,
    /// Earlier log that this log replaces. It is deleted once the first layer is laid. `None` afterwards, or without an
    /// earlier log.
    replaced: Option<DisplacedFile>,
    /// Frame of the simulated tip after the layers whose position was logged.
    laid_tip: Frame,
    /// Forecast from which the finish time in each status is computed. `None` if the pace is unknown.
    forecast: Option<Forecast>,
}

impl RunLog {
    /// Returns a disabled log, which writes nothing.
    pub fn disabled() -> Self {
        Self::default()
    }

    /// Creates a log file and writes its header. `feedback` is the noise of the sensors that the feedback assumes,
    /// `None` without feedback.
    ///
    /// # Errors
    /// If the file cannot be created, or exists already. An existing log is not overwritten, because it may be the only
    /// record of a body.
    pub fn create<'a>(
        path: &Path,
        plan: &Plan,
        job: &Job,
        feedback: Option<SensorNoise>,
        origin: impl Into<RunOrigin<'a>>,
    ) -> Result<Self, RunLogError> {
        format_from_extension(path, &ENDINGS)?;
        refuse_inputs(path)?;
        let name = path.display().to_string();
        let file = File::create_new(path).map_err(|error| match error.kind() {
            io::ErrorKind::AlreadyExists => RunLogError::Exists { file: name.clone() },
            _ => RunLogError::Begin { file: name.clone(), error },
        })?;
        let log = Self::to(Box::new(file), &name, plan.start.frame());
        log.with_header(plan, job, feedback, origin.into())
    }

    /// Like [`RunLog::create`], but replaces an existing log. The existing log is deleted once a layer of the new body
    /// is laid. If the growth does not begin, [`RunLog::discard`] restores the existing log.
    ///
    /// # Errors
    /// Like [`RunLog::create`].
    pub fn replace<'a>(
        path: &Path,
        plan: &Plan,
        job: &Job,
        feedback: Option<SensorNoise>,
        origin: impl Into<RunOrigin<'a>>,
    ) -> Result<Self, RunLogError> {
        format_from_extension(path, &ENDINGS)?;
        refuse_inputs(path)?;
        let Some(replaced) = DisplacedFile::move_aside(path)? else {
            return Self::create(path, plan, job, feedback, origin);
        };
        match Self::create(replaced.place(), plan, job, feedback, origin) {
            Ok(mut log) => {
                if let Some(open) = &mut log.0 {
                    open.replaced = Some(replaced);
                }
                Ok(log)
            }
            Err(error) => {
                replaced.restore();
                Err(error)
            }
        }
    }

    /// Like [`RunLog::create`], but writes to standard output.
    ///
    /// # Errors
    /// If standard output cannot be written.
    pub fn to_standard_output<'a>(
        plan: &Plan,
        job: &Job,
        feedback: Option<SensorNoise>,
        origin: impl Into<RunOrigin<'a>>,
    ) -> Result<Self, RunLogError> {
        let mut log = Self::to(Box::new(io::stdout()), "standard output", plan.start.frame());
        if let Some(open) = &mut log.0 {
            open.is_new = false;
        }
        log.with_header(plan, job, feedback, origin.into())
    }

    /// Returns a name for a log file that does not exist yet in the current directory: `growth-2026-11-23T014500.jsonl`
    /// with the current time, UTC.
    pub fn free_name() -> PathBuf {
        let now: String = utc_now().chars().filter(|letter| *letter != ':').take("2026-11-23T014500".len()).collect();
        let names = (1_u32..).map(|number| match number {
            1 => format!("growth-{now}.jsonl"),
            number => format!("growth-{now}-{number}.jsonl"),
        });
        names.map(PathBuf::from).find(|name| name.symlink_metadata().is_err()).unwrap_or_default()
    }

    fn with_header(
        self,
        plan: &Plan,
        job: &Job,
        feedback: Option<SensorNoise>,
        RunOrigin { port, imperfection, ignores_scene }: RunOrigin<'_>,
    ) -> Result<Self, RunLogError> {
        let mut log = self;
        let tip = if imperfection.is_some() { TipKind::Simulated } else { TipKind::Robot };
        let header = RunEvent::Header(Box::new(RunHeader {
            format: FORMAT.to_owned(),
            growbot: env!("CARGO_PKG_VERSION").to_owned(),
            started_utc: utc_now(),
            command_line: command_line(),
            port: port.to_owned(),
            tip,
            disturbances: imperfection.map(DisturbancesJson::from),
            ignore_scene: ignores_scene,
            robot: job.robot.name().to_owned(),
            robot_hash: job.robot.hash(),
            plan_id: job.plan_id,
            layers: job.layers.clone(),
            feedback: feedback.map(SensorNoiseJson::from),
            plan: PlanFile::with_robot(plan, job.robot),
        }));
        if let Err(error) = log.write(header) {
            // Delete the file of a log that could not be created.
            log.discard();
            return Err(match error {
                RunLogError::Write { file, error } => RunLogError::Begin { file, error },
                error => error,
            });
        }
        Ok(log)
    }

    /// Creates a log without a header that writes to any output. `base_from_start` is the frame at which the body
    /// begins.
    fn to(out: Box<dyn Write + Send>, file: &str, base_from_start: Frame) -> Self {
        Self(Some(OpenLog {
            lines: LineQueue::new(out),
            file: file.to_owned(),
            is_new: true,
            replaced: None,
            laid_tip: base_from_start,
            forecast: None,
        }))
    }

    /// Opens an existing log and appends a line for the resumed growth. `record` is the content of the log.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn resume(path: &Path, record: &RecordedRun, port: &str) -> Result<Self, RunLogError> {
        let name = path.display().to_string();
        let open = || {
            let mut file = OpenOptions::new().read(true).append(true).open(path)?;
            let mut last = [b'\n'];
            if file.seek(SeekFrom::End(0))? > 0 {
                file.seek(SeekFrom::End(-1))?;
                file.read_exact(&mut last)?;
            }
            if last != [b'\n'] {
                file.write_all(b"\n")?;
            }
            Ok(file)
        };
        let failed = |error| RunLogError::Begin { file: name.clone(), error };
        let mut log = Self::to(Box::new(open().map_err(failed)?), &name, record.start_frame());
        if let Some(open) = &mut log.0 {
            open.is_new = false;
        }
        let begun = log.write(RunEvent::Resumed(ResumeRecord {
            growbot: env!("CARGO_PKG_VERSION").to_owned(),
            command_line: command_line(),
            port: port.to_owned(),
        }));
        match begun {
            Err(RunLogError::Write { error, .. }) => Err(failed(error)),
            Err(error) => Err(error),
            Ok(()) => Ok(log),
        }
    }

    /// Sets the forecast from which `finish_utc` of each status is computed. `None` if the pace is unknown.
    pub fn set_forecast(&mut self, forecast: Option<Forecast>) {
        if let Some(open) = &mut self.0 {
            open.forecast = forecast;
        }
    }

    /// Writes an event, after all earlier lines that could not be written.
    ///
    /// # Errors
    /// If the file cannot be written, for example because a disk is full. The line then waits, and is retried with the
    /// next one.
    pub fn record(&mut self, event: &JobEvent) -> Result<(), RunLogError> {
        let Some(open) = &mut self.0 else { return Ok(()) };
        if matches!(event, JobEvent::Laid { .. }) {
            open.replaced = None;
        }
        let mut written = Ok(());
        let finish = match (event, open.forecast) {
            (JobEvent::Status(status), Some(forecast)) => forecast.finish_of(OffsetDateTime::now_utc(), status),
            _ => None,
        };
        for mut event in to_run_events(event, &mut open.laid_tip) {
            if let RunEvent::Status(status) = &mut event {
                status.finish_utc = finish.map(utc_text);
            }
            // If one event cannot be written, it and the following ones wait.
            written = self.write(event).and(written);
        }
        written
    }

    /// Deletes the log of a growth that did not begin, and restores the earlier log that it replaced. Does nothing to a
    /// log that was resumed.
    pub fn discard(self) {
        if let Some(open) = self.0.filter(|open| open.is_new) {
            match open.replaced {
                Some(replaced) => replaced.restore(),
                None => drop(fs::remove_file(open.file)),
            }
        }
    }

    /// Writes the result of the growth as the last line. The result contains the number of lines that are missing in
    /// the log because they were dropped.
    ///
    /// # Errors
    /// Like [`RunLog::record`].
    pub fn end(&mut self, result: &GrowthResult) -> Result<(), RunLogError> {
        let lost = self.0.as_ref().map_or(0, |open| open.lines.lost());
        let log_lines_missing = (lost > 0).then_some(lost);
        self.write(RunEvent::End { result: Box::new(GrowthResult { log_lines_missing, ..result.clone() }) })
    }

    /// Writes all earlier lines that could not be written.
    ///
    /// # Errors
    /// Like [`RunLog::record`].
    pub fn write_waiting(&mut self) -> Result<(), RunLogError> {
        let Some(open) = &mut self.0 else { return Ok(()) };
        open.lines.drain().map_err(|error| RunLogError::Write { file: open.file.clone(), error })
    }

    /// Returns the number of lines that are not in the file: those that wait and those that were dropped.
    pub fn missing_lines(&self) -> usize {
        self.0.as_ref().map_or(0, |open| open.lines.missing())
    }

    fn write(&mut self, event: RunEvent) -> Result<(), RunLogError> {
        let Some(open) = &mut self.0 else { return Ok(()) };
        let line = json_line(&RunLine { event, utc: Some(utc_now()) });
        open.lines.write(line).map_err(|error| RunLogError::Write { file: open.file.clone(), error })
    }
}

/// Returns the command line with which this program was started.
fn command_line() -> Vec<String> {
    std::env::args_os().map(|part| part.to_string_lossy().into_owned()).collect()
}

/// Format of dates and times, with three decimals of the seconds.
const MILLISECONDS: EncodedConfig =
    Config::DEFAULT.set_time_precision(TimePrecision::Second { decimal_digits: NonZero::new(3) }).encode();

/// Returns the current time (UTC) in RFC 3339 format with milliseconds. The text always has the same length.
pub fn utc_now() -> String {
    utc_text(OffsetDateTime::now_utc())
}

/// Formats a date and time in RFC 3339 format with milliseconds.
pub fn utc_text(time: OffsetDateTime) -> String {
    time.format(&Iso8601::<MILLISECONDS>).unwrap_or_default()
}

#[cfg(test)]
mod tests;
