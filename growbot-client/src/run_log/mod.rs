//! The log of a growth: one JSON object a line, each flushed, so that a log cut off anywhere is readable up to there, and one with torn
//! lines around them.
//!
//! The first line has the versions, the command, the robot, the plan and the layers that were handed over, and of a simulated tip how it is
//! disturbed; the others what happened, the layers as built among them, in the bytes of the link. So the body can be rebuilt from it bit for
//! bit ([`RunRecord`]), and a growth that was interrupted goes on from its log. Of a simulated tip the log also has where its plastic
//! really is.
//!
//! - [`RunLog`]: writes it; [`RunRecord`]: reads it; [`Events`]: its lines, and what of them cannot be read.

mod hexadecimal;
mod lines;
mod record;

use std::collections::VecDeque;
use std::fs::{self, File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::num::NonZero;
use std::path::Path;

use growbot_core::angle::degrees;
use growbot_core::kinematics::advance;
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::decode;
use growbot_core::link::crash::CrashRecord;
use growbot_core::link::message::Fault;
use growbot_core::pose::{Frame, Pose};
use growbot_core::simulation::Imperfection;
use growbot_core::tracking::SensorNoise;
use serde_json::{Value, json};
use time::OffsetDateTime;
use time::format_description::well_known::Iso8601;
use time::format_description::well_known::iso8601::{Config, EncodedConfig, TimePrecision};

use self::hexadecimal::hex;
pub use self::hexadecimal::hex_of;
pub use self::lines::{Damage, Events};
pub use self::record::{BodyKind, RecordedTip, RunRecord, RunRecordError};
use crate::crash::json_of_crash;
use crate::degrees::degrees_below_turn;
use crate::files::{FileError, refuse_ending, refuse_inputs};
use crate::growth::{Amendment, Job, JobEvent};
use crate::plan::Plan;
use crate::plan_file::{PlanFile, WrittenPose, written_hash};

/// Name and version of the format, in the first line.
pub const FORMAT: &str = "growbot-run/2";

/// Lines wait so long for a file that cannot be written, bytes in all; further ones are lost.
const MOST_WAITING: usize = 64 << 20;

/// Why a log could not be written.
#[derive(Debug, thiserror::Error)]
pub enum RunLogError {
    /// The log cannot be begun or gone on with.
    #[error("cannot write the run log {file}: {error}; choose another place with --log")]
    Begin {
        /// The file.
        file: String,
        /// The system's reason.
        error: io::Error,
    },
    /// A line cannot be written; it waits.
    #[error(
        "cannot write the run log {file}: {error}; its lines wait in memory and are written as soon as it can be: make room there, the growth goes on"
    )]
    Write {
        /// The file.
        file: String,
        /// The system's reason.
        error: io::Error,
    },
    /// It is no place for a log.
    #[error(transparent)]
    Place(#[from] FileError),
}

impl RunLogError {
    /// The system's reason alone.
    #[must_use]
    pub fn reason(&self) -> String {
        match self {
            Self::Begin { error, .. } | Self::Write { error, .. } => error.to_string(),
            Self::Place(error) => error.to_string(),
        }
    }
}

/// Where a growth takes place, for the first line of its log.
#[derive(Debug, Clone, Copy, Default)]
pub struct Origin<'a> {
    /// The port, as it was given.
    pub port: &'a str,
    /// How a simulated tip is disturbed; none for a robot.
    pub imperfection: Option<&'a Imperfection>,
}

impl<'a> From<&'a str> for Origin<'a> {
    /// A port of whose tip nothing is known.
    fn from(port: &'a str) -> Self {
        Self { port, imperfection: None }
    }
}

/// A log under way, or none.
#[derive(Default)]
pub struct RunLog(Option<Open>);

/// A log that is written.
struct Open {
    out: Box<dyn Write>,
    file: String,
    /// Whether there was no such file before.
    is_new: bool,
    /// Lines that are not written yet, the first one to come.
    waiting: VecDeque<String>,
    /// Bytes in them.
    waiting_bytes: usize,
    /// Lines for which there was no room in memory.
    lost: usize,
    /// Bytes of the first line waiting that were written before it failed: another line is begun for it.
    torn: usize,
    /// The simulated tip after the layers of which it has been told where they are.
    laid_tip: Frame,
}

impl RunLog {
    /// A log that is not kept.
    #[must_use]
    pub fn none() -> Self {
        Self::default()
    }

    /// Begins a log with versions, command, port, plan and layers; and with what the sensors are taken for, where there is feedback.
    ///
    /// # Errors
    /// If the file cannot be created. A log that is there already is not overwritten: it may be the only record of a body.
    pub fn begin<'a>(
        path: &Path,
        plan: &Plan,
        job: &Job,
        feedback: Option<SensorNoise>,
        origin: impl Into<Origin<'a>>,
    ) -> Result<Self, RunLogError> {
        let Origin { port, imperfection } = origin.into();
        let tip = if imperfection.is_some() { RecordedTip::Simulated } else { RecordedTip::Robot };
        refuse_ending(path, &["jsonl", "json"])?;
        refuse_inputs(path)?;
        let name = path.display().to_string();
        let failed = |error| RunLogError::Begin { file: name.clone(), error };
        let file = File::create_new(path).map_err(failed)?;
        let mut log = Self::to(Box::new(file), &name, plan.start.frame());
        let header = json!({
            "event": "header",
            "format": FORMAT,
            "growbot": env!("CARGO_PKG_VERSION"),
            "started_utc": utc_now(),
            "command": std::env::args_os().map(|part| part.to_string_lossy().into_owned()).collect::<Vec<_>>(),
            "port": port,
            "tip": tip.name(),
            "disturbances": imperfection.map(disturbances),
            "robot": job.robot.name(),
            "robot_hash": written_hash(job.robot.hash()),
            "plan_id": written_hash(job.plan_id),
            "layers": hex_of(&job.layers),
            "feedback": feedback.map(|noise| json!({ "odometry": noise.odometry, "direction": noise.direction })),
            "plan": PlanFile::from(plan),
        });
        if let Err(error) = log.write(header) {
            // Of a log that cannot even be begun nothing is left behind.
            let _ = fs::remove_file(path);
            return Err(match error {
                RunLogError::Write { error, .. } => failed(error),
                error => error,
            });
        }
        Ok(log)
    }

    /// A log to anywhere, of a body that begins at this frame.
    fn to(out: Box<dyn Write>, file: &str, base_from_start: Frame) -> Self {
        Self(Some(Open {
            out,
            file: file.to_owned(),
            is_new: true,
            waiting: VecDeque::new(),
            waiting_bytes: 0,
            lost: 0,
            torn: 0,
            laid_tip: base_from_start,
        }))
    }

    /// Goes on with a log, on a new line: nothing of what is there is taken away.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn go_on(path: &Path, record: &RunRecord, port: &str) -> Result<Self, RunLogError> {
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
        let begun = log.write(json!({
            "event": "resumed",
            "growbot": env!("CARGO_PKG_VERSION"),
            "command": std::env::args_os().map(|part| part.to_string_lossy().into_owned()).collect::<Vec<_>>(),
            "port": port,
        }));
        match begun {
            Err(RunLogError::Write { error, .. }) => Err(failed(error)),
            Err(error) => Err(error),
            Ok(()) => Ok(log),
        }
    }

    /// Writes what happened, and what could not be written before.
    ///
    /// # Errors
    /// If the file cannot be written, say because a disk is full: then the line waits and is tried again with the next one.
    pub fn record(&mut self, event: &JobEvent) -> Result<(), RunLogError> {
        match event {
            JobEvent::Board(hello) => self.write(json!({
                "event": "board",
                "firmware": hello.firmware,
                "schema": written_hash(hello.schema),
                "boot_id": hello.boot_id,
                "reset_cause": hello.reset_cause.name(),
                "state": hello.status.state.name(),
                "laid": hello.status.laid,
                "cut": hello.status.interrupted.map(|layer| [layer.min, layer.max]),
            })),
            JobEvent::Crash(words) => {
                let mut line = json_of_crash(&CrashRecord::from(words));
                line["event"] = "crash".into();
                self.write(line)
            }
            JobEvent::State(state) => self.write(json!({ "event": "state", "state": state.name() })),
            JobEvent::Status(status) => self.write(json!({
                "event": "status",
                "state": status.state.name(),
                "fault": status.fault.map(Fault::code),
                "temperature_c": status.temperature_centi_c.map(|centi| f64::from(centi) / 100.0),
                "target_c": status.target_centi_c.map(|centi| f64::from(centi) / 100.0),
                "laid": status.laid,
                "uptime_ms": status.uptime_ms,
            })),
            JobEvent::Laid { index, as_built, measured } => {
                let mut line = json!({ "event": "laid", "layer": index, "as_built": as_built.as_ref().map(hex) });
                if let Some(bytes) = as_built {
                    let layer = decode(bytes);
                    line["alpha_deg"] = degrees(layer.alpha).into();
                    line["height_mm"] = layer.height.into();
                    line["tilt_deg"] = degrees(layer.tilt).into();
                }
                if let Some(measured) = measured {
                    line["filament_pulses"] = measured.filament_pulses.into();
                    line["gravity_milli_g"] = json!(measured.gravity_milli_g);
                }
                self.write(line)
            }
            JobEvent::Simulated { from, layers } => self.simulated(*from, layers),
            JobEvent::Counting(count) => self.write(json!({
                "event": "counting",
                "boot_id": count.boot_id,
                "laid": count.laid,
                "filament_pulses": count.filament_pulses,
            })),
            JobEvent::Amending(Amendment { plan_id, from, total, layers }) => self.write(json!({
                "event": "amending",
                "plan_id": written_hash(*plan_id),
                "from": from,
                "total": total,
                "layers": hex_of(layers),
            })),
            JobEvent::NotAmended(why) => self.write(json!({ "event": "not-amended", "why": why })),
            JobEvent::HandingOver { from, layers } => {
                self.write(json!({ "event": "handing-over", "from": from, "layers": hex_of(layers) }))
            }
            JobEvent::Ordered(order) => self.write(json!({ "event": "ordered", "order": order.name() })),
            JobEvent::NotObeyed(why) => self.write(json!({ "event": "not-obeyed", "why": why })),
            JobEvent::Silent => self.write(json!({ "event": "silent" })),
            JobEvent::Back => self.write(json!({ "event": "back" })),
        }
    }

    /// Where the plastic of a simulated tip is: layer by layer, and the tip after each.
    fn simulated(&mut self, from: u32, layers: &[Layer]) -> Result<(), RunLogError> {
        let mut written = Ok(());
        for (index, layer) in (u64::from(from)..).zip(layers) {
            let Some(open) = &mut self.0 else { break };
            open.laid_tip = advance(&open.laid_tip, &layer.step());
            let tip = WrittenPose::from(&Pose::from_frame(&open.laid_tip));
            written = self.write(json!({
                "event": "simulated",
                "layer": index,
                "alpha_deg": degrees_below_turn(layer.alpha),
                "height_mm": layer.height,
                "tilt_deg": degrees(layer.tilt),
                "tip": tip,
            }));
        }
        written
    }

    /// Takes the log of a job that never began away: there is no body to remember. One that was there before stays.
    pub fn discard(self) {
        if let Some(open) = self.0.filter(|open| open.is_new) {
            let _ = fs::remove_file(open.file);
        }
    }

    /// Writes how it ended.
    ///
    /// # Errors
    /// As [`RunLog::record`].
    pub fn end(&mut self, result: &Value) -> Result<(), RunLogError> {
        self.write(json!({ "event": "end", "result": result }))
    }

    /// Lines that are not in the file: those that wait, and those that are lost.
    #[must_use]
    pub fn missing(&self) -> usize {
        self.0.as_ref().map_or(0, |open| open.waiting.len() + open.lost)
    }

    fn write(&mut self, mut line: Value) -> Result<(), RunLogError> {
        let Some(open) = &mut self.0 else { return Ok(()) };
        line["utc"] = utc_now().into();
        let line = format!("{line}\n");
        if open.waiting_bytes + line.len() > MOST_WAITING {
            open.lost += 1;
        } else {
            open.waiting_bytes += line.len();
            open.waiting.push_back(line);
        }
        open.drain().map_err(|error| RunLogError::Write { file: open.file.clone(), error })
    }
}

impl Open {
    /// Writes what waits. What a failure has left of a line is ended first, and the whole line comes on a new one.
    fn drain(&mut self) -> io::Result<()> {
        while let Some(line) = self.waiting.front() {
            if self.torn > 0 {
                self.out.write_all(b"\n")?;
                // Where only the end of the line was missing, it is whole now.
                let is_whole = self.torn + 1 == line.len();
                self.torn = 0;
                if is_whole {
                    self.take_written();
                    continue;
                }
            }
            let mut rest = line.as_bytes();
            while !rest.is_empty() {
                match self.out.write(rest) {
                    Ok(0) => return Err(io::ErrorKind::WriteZero.into()),
                    Ok(count) => {
                        rest = rest.get(count..).unwrap_or_default();
                        self.torn += count;
                    }
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    Err(error) => return Err(error),
                }
            }
            self.torn = 0;
            self.take_written();
        }
        self.out.flush()
    }

    fn take_written(&mut self) {
        let written = self.waiting.pop_front().map_or(0, |line| line.len());
        self.waiting_bytes = self.waiting_bytes.saturating_sub(written);
    }
}

/// Seconds with three decimals.
const MILLISECONDS: EncodedConfig =
    Config::DEFAULT.set_time_precision(TimePrecision::Second { decimal_digits: NonZero::new(3) }).encode();

/// Now, as RFC 3339 has it, to the millisecond: always as long.
fn utc_now() -> String {
    OffsetDateTime::now_utc().format(&Iso8601::<MILLISECONDS>).unwrap_or_default()
}

/// How a simulated tip is off: what is drawn from which distribution, what is always so, and the seed.
fn disturbances(imperfection: &Imperfection) -> Value {
    let Imperfection { disturbance, noise, seed } = imperfection;
    let uniform = |most: f64, unit: &str| json!({ "distribution": "uniform", "mean": 0.0, "most": most, "unit": unit });
    let normal = |deviation: f64, unit: &str| json!({ "distribution": "normal", "mean": 0.0, "standard_deviation": deviation, "unit": unit });
    let constant = |value: f64, unit: &str| json!({ "distribution": "constant", "value": value, "unit": unit });
    let percent = |share: f64| 100.0 * share;
    json!({
        "seed": seed,
        "growth_noise": uniform(percent(disturbance.growth_noise), "percent"),
        "growth_bias": constant(percent(disturbance.growth_bias), "percent"),
        "tilt_noise": uniform(degrees(disturbance.tilt_noise), "deg"),
        "tilt_bias": constant(percent(disturbance.tilt_bias), "percent"),
        "alpha_noise": uniform(degrees(disturbance.alpha_noise), "deg"),
        "alpha_bias": constant(degrees(disturbance.alpha_bias), "deg"),
        "twist_noise": uniform(degrees(disturbance.twist_noise), "deg"),
        "twist_bias": constant(degrees(disturbance.twist_bias), "deg"),
        "odometry_noise": normal(percent(noise.odometry), "percent"),
        "direction_noise": normal(degrees(noise.direction), "deg"),
    })
}

#[cfg(test)]
mod tests;
