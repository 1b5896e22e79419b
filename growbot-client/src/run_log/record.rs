//! What a run log tells of a growth: the job, the layers as the board has built them, and of a simulated tip where its plastic is.

use std::path::Path;

use growbot_core::angle::{radians, wrap_positive};
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_core::link::message::Measured;
use growbot_core::pose::{Frame, Pose};
use growbot_core::robot::Robot;
use growbot_core::tracking::SensorNoise;
use serde_json::Value;

use super::FORMAT;
use super::hexadecimal::unhex;
use super::lines::{Damage, Events};
use crate::client::ClockDrift;
use crate::feedback::{Count, Feedback};
use crate::growth::Job;
use crate::input::{InputError, LONGEST_LOG, name_of, read_bytes};
use crate::plan::Plan;
use crate::plan_file::{PlanFile, PlanFileError, pose};

/// No layer is higher, mm, nor tilted more, radians: as the bytes of the link have it.
const HIGHEST: f64 = 256.0;
const MOST_TILT: f64 = 1.0;

/// Why a run log could not be read.
#[derive(Debug, thiserror::Error)]
pub enum RunRecordError {
    /// It is not there, may not be read, or is no file of such a length.
    #[error("no run log to read: {0}")]
    File(#[from] InputError),
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

/// Whose tip has laid a body, as the header of its log says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecordedTip {
    /// A robot's. Nobody has measured where its plastic is.
    Robot,
    /// A simulated one.
    Simulated,
}

impl RecordedTip {
    /// In the header.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Robot => "robot",
            Self::Simulated => "simulated",
        }
    }

    fn named(name: &str) -> Option<Self> {
        [Self::Robot, Self::Simulated].into_iter().find(|tip| tip.name() == name)
    }
}

/// What is known of a body that was grown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BodyKind {
    /// Where the plastic of a simulated tip lies.
    Laid,
    /// What the steps of a simulated robot's board have made.
    Commanded,
    /// What the steps of a robot's board have made.
    AsBuilt,
}

impl BodyKind {
    /// As people are told.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Laid => "laid (simulated)",
            Self::Commanded => "commanded (simulated)",
            Self::AsBuilt => "as built",
        }
    }
}

/// What a run log tells of a growth, as far as it goes.
#[derive(Debug, Clone, PartialEq)]
pub struct RunRecord {
    /// Name of the robot, and hash of its description.
    pub robot: (String, u64),
    /// Whose tip has laid the body.
    pub tip: RecordedTip,
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
    pub(super) counts: Vec<(usize, Count)>,
    /// Amendments that the board has taken.
    amendments: u32,
    /// The job as it was before the latest amendment: name, layers in all, and which layers the amendment took the place of, from where.
    before: Option<(u64, u32, usize, Vec<LayerBytes>)>,
    /// How it ended, if the log says so.
    pub outcome: Option<String>,
    /// What it came to, as `growbot grow --json` has said it, if the log says so.
    pub result: Option<Value>,
    /// Layers whose lines are missing, in order: they were laid, and the log has lost what it knew of them.
    pub lost: Vec<usize>,
    /// What could not be read.
    pub damage: Damage,
    /// Of a simulated tip: the layers as its plastic lies, perhaps one more than are laid. None where the log does not
    /// say.
    simulated: Vec<Option<Layer>>,
    /// The file, as errors call it.
    file: String,
}

impl RunRecord {
    /// Reads a log: all lines that are whole.
    ///
    /// # Errors
    /// [`RunRecordError`].
    pub fn open(path: &Path) -> Result<Self, RunRecordError> {
        Self::read(&read_bytes(path, LONGEST_LOG)?, &name_of(path))
    }

    /// Reads the bytes of a log. `file` is what errors call it.
    ///
    /// # Errors
    /// [`RunRecordError::Header`] or [`RunRecordError::Plan`].
    pub fn read(bytes: &[u8], file: &str) -> Result<Self, RunRecordError> {
        let wrong = |reason: &str| RunRecordError::Header { file: file.to_string(), reason: reason.to_string() };
        if bytes.is_empty() {
            return Err(wrong("it is empty"));
        }
        let mut events = Events::of(bytes);
        let header = events.next().filter(|_| events.damage == Damage::default());
        let mut record =
            Self::of_header(&header.ok_or_else(|| wrong("its first line is no whole line of JSON"))?, file)?;
        for event in events.by_ref() {
            record.take(&event);
        }
        record.damage = events.damage;
        Ok(record)
    }

    /// The layers as the board's steps have built them: one of which nothing is known is as it was handed over.
    pub fn commanded(&self) -> impl Iterator<Item = LayerBytes> {
        let layers = self.as_built.iter().enumerate();
        layers.map_while(|(index, as_built)| as_built.or_else(|| self.layers.get(index).copied()))
    }

    /// By how much the board's clock was wrong, where it was stopped for that.
    #[must_use]
    pub fn clock_drift(&self) -> Option<ClockDrift> {
        ClockDrift::read(self.result.as_ref()?.get("clock_drift")?)
    }

    /// Whether the body was grown by a simulated robot.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        self.tip == RecordedTip::Simulated
    }

    /// The layers as the plastic of a simulated tip lies, the one under way included. None of a robot, and none where
    /// the log has layers and does not say of one where it lies. One of which it does not say is as the steps have
    /// built it.
    #[must_use]
    pub fn simulated(&self) -> Option<Vec<Layer>> {
        let says = self.as_built.is_empty() || self.simulated.iter().any(Option::is_some);
        (self.is_simulated() && says).then(|| {
            let mut commanded = self.commanded();
            let count = self.simulated.len().max(self.as_built.len());
            (0..count)
                .map_while(|index| {
                    let commanded = commanded.next().map(|layer| decode(&layer));
                    self.simulated.get(index).copied().flatten().or(commanded)
                })
                .collect()
        })
    }

    /// What is known of the body: where its plastic lies, or what the steps have made.
    #[must_use]
    pub fn body_kind(&self) -> BodyKind {
        match (self.tip, self.simulated()) {
            (RecordedTip::Robot, _) => BodyKind::AsBuilt,
            (RecordedTip::Simulated, None) => BodyKind::Commanded,
            (RecordedTip::Simulated, Some(_)) => BodyKind::Laid,
        }
    }

    /// Whether the log says where the plastic of the layer of this index lies.
    #[must_use]
    pub fn says_where(&self, index: usize) -> bool {
        self.is_simulated() && self.simulated.get(index).is_some_and(Option::is_some)
    }

    /// Layers laid of which the log of a simulated tip does not say where they are. The one under way is not laid.
    #[must_use]
    pub fn not_simulated(&self) -> usize {
        if self.is_simulated() { (0..self.as_built.len()).filter(|index| !self.says_where(*index)).count() } else { 0 }
    }

    /// The layers as built up to the first whose line is lost: what a board need not tell again.
    #[must_use]
    pub fn known(&self) -> Vec<Option<LayerBytes>> {
        let end = self.lost.first().copied().unwrap_or(self.as_built.len());
        self.as_built.get(..end).unwrap_or(&self.as_built).to_vec()
    }

    /// The frame that the body begins at; that of the base where the plan has no start.
    #[must_use]
    pub(super) fn start_frame(&self) -> Frame {
        pose("start", &self.plan.start).map_or_else(|_| Frame::identity(), |start| start.frame())
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
        if let Some((plan_id, total, from, layers)) = self.before.take() {
            self.layers.truncate(from);
            self.layers.extend(layers);
            (self.plan_id, self.total) = (plan_id, total);
            self.amendments = self.amendments.saturating_sub(1);
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
        let tip = text("tip")?;
        let tip = RecordedTip::named(tip)
            .ok_or_else(|| wrong(format!("its \"tip\" is {tip:?}, neither \"robot\" nor \"simulated\"")))?;
        let plan = header.get("plan").cloned().unwrap_or_default();
        let noise = |field: &str| header.get("feedback")?.get(field)?.as_f64().filter(|noise| *noise >= 0.0);
        Ok(Self {
            feedback: noise("odometry")
                .zip(noise("direction"))
                .map(|(odometry, direction)| SensorNoise { odometry, direction }),
            robot: (text("robot")?.to_string(), hash("robot_hash")?),
            tip,
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
            lost: Vec::new(),
            damage: Damage::default(),
            simulated: Vec::new(),
        })
    }

    /// Puts the layers of an event in the place of what is there from its first on; gives from where on, and what was there.
    fn put(&mut self, event: &Value) -> Option<(usize, Vec<LayerBytes>)> {
        let from = number(event, "from")? as usize;
        let layers = unhex(event.get("layers")?.as_str()?)?;
        let before = (from <= self.layers.len()).then(|| self.layers.split_off(from))?;
        self.layers.extend(layers);
        Some((from, before))
    }

    /// A layer was laid. Those before it whose lines are missing were laid too.
    fn laid(&mut self, index: usize, event: &Value) {
        let next = self.as_built.len();
        let as_built = event.get("as_built").and_then(Value::as_str).and_then(unhex);
        let as_built = as_built.and_then(|layers| layers.first().copied());
        if let Ok(at) = self.lost.binary_search(&index) {
            // It is told again after a resumption.
            self.lost.remove(at);
            if let (Some(layer), Some(known)) = (self.as_built.get_mut(index), self.measured.get_mut(index)) {
                (*layer, *known) = (as_built, measured(event));
            }
        } else if index >= next && (index == next || index < self.layers.len()) {
            self.lost.extend(next..index);
            self.as_built.resize(index, None);
            self.measured.resize(index, None);
            self.as_built.push(as_built);
            self.measured.push(measured(event));
        }
        // Otherwise it is told again after a resumption: the first report stands.
    }

    /// Where a layer of a simulated tip lies.
    fn lies(&mut self, index: usize, event: &Value) {
        let number = |field: &str| event.get(field).and_then(Value::as_f64).filter(|number| number.is_finite());
        let (Some(alpha), Some(height), Some(tilt)) = (number("alpha_deg"), number("height_mm"), number("tilt_deg"))
        else {
            return;
        };
        let tilt = radians(tilt);
        // One more than there are layers may be under way.
        let is_one = index <= self.layers.len().max(self.simulated.len());
        if is_one && (0.0..=HIGHEST).contains(&height) && (0.0..=MOST_TILT).contains(&tilt) {
            if self.simulated.len() <= index {
                self.simulated.resize(index + 1, None);
            }
            if let Some(layer) = self.simulated.get_mut(index) {
                *layer = Some(Layer { alpha: wrap_positive(radians(alpha)), height, tilt });
            }
        }
    }

    fn take(&mut self, event: &Value) {
        match event.get("event").and_then(Value::as_str) {
            Some(kind @ ("laid" | "simulated")) => {
                let index = event.get("layer").and_then(Value::as_u64).and_then(|index| index.try_into().ok());
                match (kind, index) {
                    ("laid", Some(index)) => self.laid(index, event),
                    (_, Some(index)) => self.lies(index, event),
                    (_, None) => {}
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
                    && let Some((from, layers)) = self.put(event)
                {
                    self.before = Some((self.plan_id, self.total, from, layers));
                    (self.plan_id, self.total) = (plan_id, total);
                    self.amendments = self.amendments.saturating_add(1);
                }
            }
            Some("not-amended") => self.take_back(),
            Some("handing-over") => {
                // The job before the latest amendment had what that put there, and not what is handed over since.
                let _ = self.put(event);
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
