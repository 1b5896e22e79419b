//! The log of a growth: one JSON object a line, each flushed, so that a log cut off anywhere is readable up to there.
//!
//! The first line has the versions, the robot, the plan and the layers that were handed over, the others what happened, the layers as
//! built among them, in the bytes of the link. So the body can be rebuilt from it bit for bit ([`RunRecord`]), and a growth that was
//! interrupted goes on from its log.

use std::fs::{self, File, OpenOptions};
use std::io::{self, Write};
use std::path::Path;

use growbot_core::angle::degrees;
use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_core::link::message::{Fault, Measured};
use growbot_core::pose::{Frame, Pose};
use growbot_core::robot::Robot;
use growbot_core::tracking::SensorNoise;
use serde_json::{Value, json};

use crate::crash::Crash;
use crate::feedback::{Count, Feedback};
use crate::growth::{Amendment, Job, News};
use crate::plan::Plan;
use crate::plan_check::pose;
use crate::plan_file::{PlanFile, PlanFileError, written_hash};

/// Name and version of the format, in the first line.
pub const FORMAT: &str = "growbot-run/2";

/// Why a log could not be written.
#[derive(Debug, thiserror::Error)]
#[error("cannot write the run log {file}: {error}; choose another place with --log")]
pub struct RunLogError {
    file: String,
    error: io::Error,
}

/// A log under way, or none.
pub struct RunLog(Option<(File, String)>);

impl RunLog {
    /// A log that is not kept.
    #[must_use]
    pub fn none() -> Self {
        Self(None)
    }

    /// Begins a log with versions, port, plan and layers; and with what the sensors are taken for, where there is feedback.
    ///
    /// # Errors
    /// If the file cannot be created. A log that is there already is not overwritten: it may be the only record of a body.
    pub fn begin(
        path: &Path,
        plan: &Plan,
        job: &Job,
        feedback: Option<SensorNoise>,
        port: &str,
    ) -> Result<Self, RunLogError> {
        let name = path.display().to_string();
        let file = File::create_new(path).map_err(|error| RunLogError { file: name.clone(), error })?;
        let mut log = Self(Some((file, name)));
        log.write(&json!({
            "event": "header",
            "format": FORMAT,
            "growbot": env!("CARGO_PKG_VERSION"),
            "port": port,
            "robot": job.robot.name(),
            "robot_hash": written_hash(job.robot.hash()),
            "plan_id": written_hash(job.plan_id),
            "layers": hex_of(&job.layers),
            "feedback": feedback.map(|noise| json!({ "odometry": noise.odometry, "direction": noise.direction })),
            "plan": PlanFile::from(plan),
        }))?;
        Ok(log)
    }

    /// Goes on with a log: what a cut has left of its last line is taken away first.
    ///
    /// # Errors
    /// If the file cannot be written.
    pub fn go_on(path: &Path, record: &RunRecord, port: &str) -> Result<Self, RunLogError> {
        let name = path.display().to_string();
        let open = || {
            let file = OpenOptions::new().append(true).open(path)?;
            file.set_len(record.bytes as u64)?;
            Ok(file)
        };
        let file = open().map_err(|error| RunLogError { file: name.clone(), error })?;
        let mut log = Self(Some((file, name)));
        log.write(&json!({ "event": "resumed", "growbot": env!("CARGO_PKG_VERSION"), "port": port }))?;
        Ok(log)
    }

    /// Writes what happened.
    ///
    /// # Errors
    /// If the file cannot be written, say because a disk is full.
    pub fn news(&mut self, news: &News) -> Result<(), RunLogError> {
        match news {
            News::Board(hello) => self.write(&json!({
                "event": "board",
                "firmware": hello.firmware,
                "schema": written_hash(hello.schema),
                "boot_id": hello.boot_id,
                "reset_cause": hello.reset_cause.name(),
                "state": hello.status.state.name(),
                "laid": hello.status.laid,
                "cut": hello.status.cut.map(|cut| [cut.least, cut.most]),
            })),
            News::Crash(words) => {
                let mut line = Crash::new(words, None).json();
                line["event"] = "crash".into();
                self.write(&line)
            }
            News::State(state) => self.write(&json!({ "event": "state", "state": state.name() })),
            News::Status(status) => self.write(&json!({
                "event": "status",
                "state": status.state.name(),
                "fault": status.fault.map(Fault::code),
                "temperature_c": status.temperature_centi_c.map(|centi| f64::from(centi) / 100.0),
                "target_c": status.target_centi_c.map(|centi| f64::from(centi) / 100.0),
                "laid": status.laid,
                "uptime_ms": status.uptime_ms,
            })),
            News::Laid(index, as_built, measured) => {
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
                self.write(&line)
            }
            News::Counting(count) => self.write(&json!({
                "event": "counting",
                "boot_id": count.boot_id,
                "laid": count.laid,
                "filament_pulses": count.filament_pulses,
            })),
            News::Amending(Amendment { plan_id, from, total, layers }) => self.write(&json!({
                "event": "amending",
                "plan_id": written_hash(*plan_id),
                "from": from,
                "total": total,
                "layers": hex_of(layers),
            })),
            News::NotAmended(why) => self.write(&json!({ "event": "not-amended", "why": why })),
            News::HandingOver(from, layers) => {
                self.write(&json!({ "event": "handing-over", "from": from, "layers": hex_of(layers) }))
            }
            News::Ordered(order) => self.write(&json!({ "event": "ordered", "order": order.name() })),
            News::NotObeyed(why) => self.write(&json!({ "event": "not-obeyed", "why": why })),
            News::Silent => self.write(&json!({ "event": "silent" })),
            News::Back => self.write(&json!({ "event": "back" })),
        }
    }

    /// Takes the log of a job that never began away: there is no body to remember.
    pub fn discard(self) {
        if let Some((_, name)) = self.0 {
            let _ = fs::remove_file(name);
        }
    }

    /// Writes how it ended.
    ///
    /// # Errors
    /// As [`RunLog::news`].
    pub fn end(&mut self, result: &Value) -> Result<(), RunLogError> {
        self.write(&json!({ "event": "end", "result": result }))
    }

    fn write(&mut self, line: &Value) -> Result<(), RunLogError> {
        let Some((file, name)) = &mut self.0 else { return Ok(()) };
        writeln!(file, "{line}").and_then(|()| file.flush()).map_err(|error| RunLogError { file: name.clone(), error })
    }
}

/// Why a run log could not be read.
#[derive(Debug, thiserror::Error)]
pub enum RunRecordError {
    /// It is not there, or may not be read.
    #[error("cannot read the run log {file}: {error}")]
    File {
        /// The file.
        file: String,
        /// The system's reason.
        error: io::Error,
    },
    /// Its first line is no header of a run log.
    #[error("{file} is no run log ({reason}): give a file that `growbot grow --log` has written")]
    Header {
        /// The file.
        file: String,
        /// What is wrong with it.
        reason: String,
    },
    /// The plan in it.
    #[error(transparent)]
    Plan(#[from] PlanFileError),
}

/// What a run log tells of a growth, as far as it goes.
#[derive(Debug, Clone, PartialEq)]
pub struct RunRecord {
    /// Name of the robot, and hash of its description.
    pub robot: (String, u64),
    /// The plan.
    pub plan: PlanFile,
    /// What the sensors were taken for; none without feedback.
    pub feedback: Option<SensorNoise>,
    /// The job's name, as it was amended last.
    pub plan_id: u64,
    /// Layers of the job.
    pub total: u32,
    /// The layers that were handed over.
    pub layers: Vec<LayerBytes>,
    /// The layers as built, from the first on; none where nothing is known of one.
    pub as_built: Vec<Option<LayerBytes>>,
    /// What was measured after each of them.
    pub measured: Vec<Option<Measured>>,
    /// From where filament was counted, each with how many layers had been told before.
    counts: Vec<(usize, Count)>,
    /// Amendments that the board has taken.
    amendments: u32,
    /// The job as it was before the latest amendment: name, layers in all, and those handed over.
    before: Option<(u64, u32, Vec<LayerBytes>)>,
    /// How it ended, if the log says so.
    pub outcome: Option<String>,
    /// What it came to, as `growbot grow --json` has said it, if the log says so.
    pub result: Option<Value>,
    /// The file, as errors call it.
    file: String,
    /// Bytes of the whole lines.
    bytes: usize,
    /// Bytes after those, of a line that was cut off.
    pub cut_off: usize,
}

impl RunRecord {
    /// Reads a log up to the last whole line.
    ///
    /// # Errors
    /// [`RunRecordError`].
    pub fn open(path: &Path) -> Result<Self, RunRecordError> {
        let file = path.display().to_string();
        let bytes = fs::read(path).map_err(|error| RunRecordError::File { file: file.clone(), error })?;
        Self::read(&bytes, &file)
    }

    /// Reads the bytes of a log. `file` is what errors call it.
    ///
    /// # Errors
    /// [`RunRecordError::Header`] or [`RunRecordError::Plan`].
    pub fn read(bytes: &[u8], file: &str) -> Result<Self, RunRecordError> {
        let mut lines = bytes.split_inclusive(|byte| *byte == b'\n');
        let wrong = |reason: &str| RunRecordError::Header { file: file.to_string(), reason: reason.to_string() };
        let first = lines.next().ok_or_else(|| wrong("it is empty"))?;
        let header = whole(first).ok_or_else(|| wrong("its first line is no whole line of JSON"))?;
        let mut record = Self::of_header(&header, file)?;
        record.bytes = first.len();
        for line in lines {
            // A line that was cut off, or is no JSON, ends what can be trusted.
            let Some(event) = whole(line) else { break };
            record.take(&event);
            record.bytes += line.len();
        }
        record.cut_off = bytes.len() - record.bytes;
        Ok(record)
    }

    /// The plan, checked against its robot.
    ///
    /// # Errors
    /// Whatever is wrong with it, or another robot.
    pub fn plan(&self, robot: &Robot) -> Result<Plan, PlanFileError> {
        self.plan.check(robot).map_err(|fault| PlanFileError::Fault { file: self.file.clone(), fault })
    }

    /// Where the body began and was to end.
    ///
    /// # Errors
    /// Poses that are none.
    pub fn start_and_goal(&self) -> Result<(Pose, Pose), PlanFileError> {
        let fault = |fault| PlanFileError::Fault { file: self.file.clone(), fault };
        Ok((pose("start", &self.plan.start).map_err(fault)?, pose("goal", &self.plan.goal).map_err(fault)?))
    }

    /// The board has this job: where it has not taken the latest amendment, the job is as before.
    pub fn is_held_as(&mut self, plan_id: u64) {
        if self.before.as_ref().is_some_and(|(before, ..)| *before == plan_id) {
            self.take_back();
        }
    }

    fn take_back(&mut self) {
        if let Some((plan_id, total, layers)) = self.before.take() {
            (self.plan_id, self.total, self.layers) = (plan_id, total, layers);
            self.amendments -= 1;
        }
    }

    /// The feedback as it stood when the log ended; none for a growth without.
    #[must_use]
    pub fn feedback<'a>(&self, job: &Job<'a>, plan: &'a Plan) -> Option<Feedback<'a>> {
        self.fed_back(job, plan, |_| ())
    }

    /// Where feedback took the tip to be after each layer; none for a growth without.
    #[must_use]
    pub fn estimated(&self, job: &Job, plan: &Plan) -> Option<Vec<Frame>> {
        let mut path = Vec::with_capacity(self.as_built.len());
        self.fed_back(job, plan, |feedback| path.push(feedback.result().estimate.base_from_tip))?;
        Some(path)
    }

    /// The feedback of the whole log, which is looked at after each layer.
    fn fed_back<'a>(
        &self,
        job: &Job<'a>,
        plan: &'a Plan,
        mut after_layer: impl FnMut(&Feedback),
    ) -> Option<Feedback<'a>> {
        let mut feedback = Feedback::new(job.robot, job.start, &plan.path, &plan.legs, self.feedback?);
        let mut counts = self.counts.iter().peekable();
        for (index, (as_built, measured)) in self.as_built.iter().zip(&self.measured).enumerate() {
            while let Some((_, count)) = counts.next_if(|(told, _)| *told <= index) {
                feedback.count_from(count);
            }
            if let Some(layer) = as_built.as_ref().or(self.layers.get(index)) {
                feedback.laid(layer, measured.as_ref());
                after_layer(&feedback);
            }
        }
        counts.for_each(|(_, count)| feedback.count_from(count));
        (0..self.amendments).for_each(|_| feedback.amended());
        Some(feedback)
    }

    fn of_header(header: &Value, file: &str) -> Result<Self, RunRecordError> {
        let wrong = |reason: String| RunRecordError::Header { file: file.to_string(), reason };
        let text = |field: &str| {
            header.get(field).and_then(Value::as_str).ok_or_else(|| wrong(format!("its header has no \"{field}\"")))
        };
        let format = text("format")?;
        if format != FORMAT {
            return Err(wrong(format!("its format is {format:?}, I read {FORMAT:?}")));
        }
        let hash = |field: &str| {
            u64::from_str_radix(text(field)?, 16).map_err(|_| wrong(format!("its \"{field}\" is no hash")))
        };
        let layers = unhex(text("layers")?).ok_or_else(|| wrong("its \"layers\" are no layers".to_string()))?;
        let plan = header.get("plan").cloned().unwrap_or_default();
        let noise = |field: &str| header.get("feedback")?.get(field)?.as_f64().filter(|noise| *noise >= 0.0);
        Ok(Self {
            feedback: noise("odometry")
                .zip(noise("direction"))
                .map(|(odometry, direction)| SensorNoise { odometry, direction }),
            robot: (text("robot")?.to_string(), hash("robot_hash")?),
            plan: PlanFile::parse(&plan.to_string(), file)?,
            file: file.to_string(),
            plan_id: hash("plan_id")?,
            total: layers.len() as u32,
            layers,
            as_built: Vec::new(),
            measured: Vec::new(),
            counts: Vec::new(),
            amendments: 0,
            before: None,
            outcome: None,
            result: None,
            bytes: 0,
            cut_off: 0,
        })
    }

    /// The layers with those of an event in the place of what was there from its first on.
    fn with(&self, event: &Value) -> Option<Vec<LayerBytes>> {
        let from = number(event, "from")? as usize;
        let layers = unhex(event.get("layers")?.as_str()?)?;
        Some([self.layers.get(..from)?, &layers].concat())
    }

    fn take(&mut self, event: &Value) {
        match event.get("event").and_then(Value::as_str) {
            Some("laid") => {
                let index = event.get("layer").and_then(Value::as_u64);
                let bytes = event.get("as_built").and_then(Value::as_str).and_then(unhex);
                // After a resumption layers may be told again: the first report stands.
                if index == Some(self.as_built.len() as u64) {
                    self.as_built.push(bytes.and_then(|layers| layers.first().copied()));
                    self.measured.push(measured(event));
                }
            }
            Some("counting") => {
                if let (Some(boot_id), Some(laid)) = (number(event, "boot_id"), number(event, "laid")) {
                    let filament_pulses = number(event, "filament_pulses");
                    self.counts.push((self.as_built.len(), Count { boot_id, laid, filament_pulses }));
                }
            }
            Some("amending") => {
                if let (Some(plan_id), Some(total)) = (hash(event, "plan_id"), number(event, "total"))
                    && let Some(layers) = self.with(event)
                {
                    let layers = std::mem::replace(&mut self.layers, layers);
                    self.before = Some((self.plan_id, self.total, layers));
                    (self.plan_id, self.total) = (plan_id, total);
                    self.amendments += 1;
                }
            }
            Some("not-amended") => self.take_back(),
            Some("handing-over") => {
                if let Some(layers) = self.with(event) {
                    self.layers = layers;
                }
            }
            Some("resumed") => (self.outcome, self.result) = (None, None),
            Some("end") => {
                self.result = event.get("result").cloned();
                let outcome = event.get("result").and_then(|result| result.get("outcome"));
                self.outcome = outcome.and_then(Value::as_str).map(ToString::to_string);
            }
            _ => {}
        }
    }
}

/// A number of an event.
fn number(event: &Value, field: &str) -> Option<u32> {
    event.get(field)?.as_u64()?.try_into().ok()
}

/// A hash of an event.
fn hash(event: &Value, field: &str) -> Option<u64> {
    u64::from_str_radix(event.get(field)?.as_str()?, 16).ok()
}

/// What was measured after a layer.
fn measured(event: &Value) -> Option<Measured> {
    let gravity = event.get("gravity_milli_g")?;
    let part = |axis: usize| gravity.get(axis)?.as_i64()?.try_into().ok();
    let gravity_milli_g = part(0).zip(part(1)).zip(part(2)).map(|((x, y), z)| [x, y, z]);
    Some(Measured { filament_pulses: number(event, "filament_pulses"), gravity_milli_g })
}

/// The JSON of a line that has its end.
fn whole(line: &[u8]) -> Option<Value> {
    serde_json::from_slice(line.strip_suffix(b"\n")?).ok()
}

fn hex(bytes: &LayerBytes) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Layers one after the other, 24 hexadecimal digits each.
pub(crate) fn hex_of(layers: &[LayerBytes]) -> String {
    layers.iter().map(hex).collect()
}

/// Layers from the hex digits of their bytes.
fn unhex(text: &str) -> Option<Vec<LayerBytes>> {
    let digits: Vec<u8> =
        text.chars().map(|digit| digit.to_digit(16).map(|value| value as u8)).collect::<Option<_>>()?;
    let (layers, []) = digits.as_chunks::<24>() else { return None };
    let layer = |digits: &[u8; 24]| {
        let (pairs, _) = digits.as_chunks::<2>();
        let mut bytes = [0; 12];
        for (byte, [high, low]) in bytes.iter_mut().zip(pairs) {
            *byte = high << 4 | low;
        }
        bytes
    };
    Some(layers.iter().map(layer).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_survive_their_digits() {
        let layers = [[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 255], [0xab; 12]];
        let text: String = layers.iter().map(hex).collect();
        assert_eq!(unhex(&text).unwrap(), layers);
        assert_eq!(unhex("").unwrap(), Vec::<LayerBytes>::new());
        for wrong in ["0", "0g", &"0".repeat(23), "\u{e9}"] {
            assert_eq!(unhex(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn a_crash_of_the_firmware_is_written_with_its_registers_and_changes_nothing_else() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("run.jsonl");
        fs::write(&path, log(&[])).unwrap();
        let before = RunRecord::open(&path).unwrap();
        let mut log = RunLog::go_on(&path, &before, "sim").unwrap();
        let mut words = [0x1001; growbot_core::link::crash::CRASH_WORDS];
        words[..9].copy_from_slice(&[3 << 16 | 3, 7, 0xfeed_beef, 0x1000_0800, 0xFFFF_FFF9, 1 << 16, 1 << 30, 1, 2]);
        log.news(&News::Crash(words)).unwrap();
        let text = fs::read_to_string(&path).unwrap();
        let line: Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
        assert_eq!(
            (&line["event"], &line["cause"], &line["boot_id"]),
            (&"crash".into(), &"processor fault".into(), &7.into())
        );
        assert_eq!((&line["pc"], &line["cfsr"]), (&"00001001".into(), &"00010000".into()));
        assert_eq!((&line["reasons"][0], &line["image_crc"]), (&"UNDEFINSTR".into(), &"feedbeef".into()));
        let after = RunRecord::open(&path).unwrap();
        assert_eq!((after.as_built, after.layers, after.outcome), (before.as_built, before.layers, before.outcome));
    }

    /// A log of three layers with feedback, and lines after its header.
    fn log(lines: &[Value]) -> Vec<u8> {
        let robot = crate::robot_file::load("growbot-a".as_ref()).unwrap();
        let up = |z| Pose::from_degrees([0.0, 0.0, z, 0.0, 90.0]).unwrap();
        let search =
            crate::plan::Search { radius: 100.0, planner: growbot_core::plan::Planner::Shortest, clear_of_self: false };
        let plan = Plan::through(&robot, &up(0.0), &[], &up(2.1), &search).unwrap();
        let job = Job::new(&robot, &plan.start, &plan.goal, &plan.path);
        let file = tempfile::tempdir().unwrap();
        let path = file.path().join("run.jsonl");
        let noise = SensorNoise { odometry: 0.01, direction: 0.002 };
        let mut log = RunLog::begin(&path, &plan, &job, Some(noise), "sim").unwrap();
        for line in lines {
            log.write(line).unwrap();
        }
        fs::read(&path).unwrap()
    }

    #[test]
    fn amendments_are_read_back_and_those_that_the_board_did_not_take_are_none() {
        let other = |byte: u8| [byte; 12];
        let amending = |plan_id: u64, from: u32, layers: &[LayerBytes]| json!({ "event": "amending", "plan_id": written_hash(plan_id), "from": from, "total": 9, "layers": hex_of(layers) });
        let lines = [
            json!({ "event": "counting", "boot_id": 5, "laid": 0, "filament_pulses": 3 }),
            amending(7, 1, &[other(1), other(2)]),
            json!({ "event": "laid", "layer": 0, "as_built": hex(&other(9)), "filament_pulses": 60, "gravity_milli_g": [0, -3, 999] }),
            json!({ "event": "laid", "layer": 1, "as_built": null, "filament_pulses": null, "gravity_milli_g": null }),
            amending(8, 2, &[other(3)]),
            json!({ "event": "not-amended" }),
            json!({ "event": "handing-over", "from": 3, "layers": hex_of(&[other(4)]) }),
            amending(9, 3, &[other(5)]),
        ];
        let mut record = RunRecord::read(&log(&lines), "log").unwrap();
        assert_eq!((record.plan_id, record.total, record.layers.len()), (9, 9, 4));
        assert_eq!(record.layers[1..], [other(1), other(2), other(5)]);
        assert_eq!(
            record.measured[0],
            Some(Measured { filament_pulses: Some(60), gravity_milli_g: Some([0, -3, 999]) })
        );
        assert_eq!(record.measured[1], Some(Measured::default()));
        assert_eq!(record.counts, [(0, Count { boot_id: 5, laid: 0, filament_pulses: Some(3) })]);
        // The board has taken the latest one, or it has not.
        record.is_held_as(9);
        assert_eq!(record.plan_id, 9);
        record.is_held_as(7);
        assert_eq!((record.plan_id, record.layers[3]), (7, other(4)));
    }

    #[test]
    fn a_log_without_feedback_has_none() {
        let mut bytes = log(&[]);
        assert!(RunRecord::read(&bytes, "log").unwrap().feedback.is_some());
        let text = String::from_utf8(bytes).unwrap();
        let mut header: Value = serde_json::from_str(&text).unwrap();
        header["feedback"] = Value::Null;
        bytes = format!("{header}\n").into_bytes();
        assert_eq!(RunRecord::read(&bytes, "log").unwrap().feedback, None);
    }
}
