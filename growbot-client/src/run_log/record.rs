//! What a run log tells of a growth: the job, the layers as the board has built them, and of a simulated tip where its
//! plastic is.

use std::path::Path;

use growbot_core::angle::{radians, wrap_positive};
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_core::link::message::Measured;
use growbot_core::pose::{Frame, Pose};
use growbot_core::robot::Robot;
use growbot_core::tracking::SensorNoise;
use growbot_scene::file::LoadedScene;
use serde_json::Value;

use super::FORMAT;
use super::event::{LaidLayer, RunEvent, SimulatedLayer, WrittenLayer};
use super::header::{Header, RecordedTip, WrittenNoise};
use super::lines::{Damage, Events, Line};
use super::result::{GrowthResult, ResultOutcome};
use crate::client::ClockDrift;
use crate::feedback::{Count, Feedback};
use crate::growth::{Amendment, Job, as_built_or_commanded};
use crate::input::{InputError, LONGEST_LOG, name_of, read_bytes};
use crate::keep_clear::Surroundings;
use crate::plan::Plan;
use crate::plan_file::{self, PlanFile, PlanFileError, pose};
use crate::through_scene::{self, UnclearError};

/// No layer is higher, mm, nor tilted more, radians: as the bytes of the link have it.
const MAX_HEIGHT: f64 = 256.0;
const MAX_TILT: f64 = 1.0;

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

    /// The same at the head of a table or a picture.
    #[must_use]
    pub fn title(self) -> &'static str {
        match self {
            Self::Laid => "Laid (simulated)",
            Self::Commanded => "Commanded (simulated)",
            Self::AsBuilt => "As built",
        }
    }
}

/// What a run log tells of a growth, as far as it goes.
#[derive(Debug, Clone, PartialEq)]
pub struct RunRecord {
    /// The robot.
    pub robot: RobotId,
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
    /// From where filament was counted.
    pub(super) counts: Vec<CountBefore>,
    /// Amendments that the board has taken.
    amendments: u32,
    /// What the latest amendment has replaced.
    replaced: Option<Replaced>,
    /// What the growth came to, if the log says so.
    pub result: Option<GrowthResult>,
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

/// A robot as the header of a log names it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RobotId {
    /// Its name.
    pub name: String,
    /// Hash of its description.
    pub hash: u64,
}

/// A count of the filament's encoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct CountBefore {
    /// Index of the layer before which it was taken.
    pub layer: usize,
    /// The count.
    pub count: Count,
}

/// What an amendment has replaced.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Replaced {
    /// The job's name before.
    plan_id: u64,
    /// Layers of the job before.
    total: u32,
    /// Index of the first layer that was replaced.
    from: usize,
    /// The layers that were replaced.
    layers: Vec<LayerBytes>,
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
        let first = events.next_line().filter(|_| events.damage == Damage::default());
        let mut record = match first.ok_or_else(|| wrong("its first line is no whole line of JSON"))? {
            Line::Event(RunEvent::Header(header))
                if header.format == FORMAT && header.plan.format == plan_file::FORMAT =>
            {
                Self::of_header(*header, file)
            }
            Line::Event(event) => return Err(wrong_header(&serde_json::to_value(event).unwrap_or_default(), file)),
            Line::Other(fields) => return Err(wrong_header(&fields.into(), file)),
        };
        for event in events.by_ref() {
            record.ingest(event);
        }
        record.damage = events.damage;
        Ok(record)
    }

    /// The layers as the board's steps have built them: one of which nothing is known is as it was handed over.
    pub fn commanded(&self) -> impl Iterator<Item = LayerBytes> {
        as_built_or_commanded(&self.as_built, &self.layers)
    }

    /// Layers laid of which nothing is known.
    #[must_use]
    pub fn unknown(&self) -> usize {
        self.as_built.iter().filter(|layer| layer.is_none()).count()
    }

    /// How the growth ended, if the log says so.
    #[must_use]
    pub fn outcome(&self) -> ResultOutcome {
        self.result.as_ref().map_or(ResultOutcome::Unfinished, |result| result.outcome)
    }

    /// By how much the board's clock was wrong, where it was stopped for that.
    #[must_use]
    pub fn clock_drift(&self) -> Option<ClockDrift> {
        self.result.as_ref()?.clock_drift
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

    /// The robot of the run: as its log describes it or, failing that, the built-in one of its name.
    ///
    /// # Errors
    /// As [`PlanFile::own_robot`].
    pub fn own_robot(&self) -> Result<Robot, PlanFileError> {
        self.plan.own_robot(&self.file)
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
        Ok((pose("start", &self.plan.start).map_err(fault)?, pose("goal", &self.plan.goal.pose()).map_err(fault)?))
    }

    /// The board stores this job: where it has refused the latest amendment, the job is as before.
    pub fn is_stored_as(&mut self, plan_id: u64) {
        if self.replaced.as_ref().is_some_and(|before| before.plan_id == plan_id) {
            self.revert_amendment();
        }
    }

    fn revert_amendment(&mut self) {
        if let Some(Replaced { plan_id, total, from, layers }) = self.replaced.take() {
            self.layers.truncate(from);
            self.layers.extend(layers);
            (self.plan_id, self.total) = (plan_id, total);
            self.amendments = self.amendments.saturating_sub(1);
        }
    }

    /// The scene that the plan leads through, which lies beside the log or is given; none for a plan without.
    ///
    /// # Errors
    /// It is missing or has changed, or the plan is not clear of it.
    pub fn scene(&self, plan: &Plan, robot: &Robot, given: Option<&Path>) -> Result<Option<LoadedScene>, UnclearError> {
        let Some(written) = &self.plan.scene else { return Ok(None) };
        let beside = Path::new(&self.file).parent().unwrap_or(Path::new(""));
        let (_, loaded) = through_scene::verified(written, plan, robot, beside, given)?;
        Ok(Some(loaded))
    }

    /// The feedback as it stood when the log ended, which keeps off a scene from there on; none for a growth without.
    #[must_use]
    pub fn feedback<'a>(
        &self,
        job: &Job<'a>,
        plan: &'a Plan,
        around: Option<&'a Surroundings<'a>>,
    ) -> Option<Feedback<'a>> {
        self.fed_back(job, plan, around, |_| ())
    }

    /// Where feedback took the tip to be after each layer; none for a growth without.
    #[must_use]
    pub fn estimated(&self, job: &Job, plan: &Plan) -> Option<Vec<Frame>> {
        let mut path = Vec::with_capacity(self.as_built.len());
        self.fed_back(job, plan, None, |feedback| path.push(feedback.result().estimate.base_from_tip))?;
        Some(path)
    }

    /// The feedback of the whole log, which is looked at after each layer.
    fn fed_back<'a>(
        &self,
        job: &Job<'a>,
        plan: &'a Plan,
        around: Option<&'a Surroundings<'a>>,
        mut after_layer: impl FnMut(&Feedback),
    ) -> Option<Feedback<'a>> {
        let mut feedback = Feedback::new(job.robot, job.start, &plan.path, &plan.legs, self.feedback?);
        feedback = around.into_iter().fold(feedback, Feedback::among);
        let mut counts = self.counts.iter().peekable();
        for (index, (as_built, measured)) in self.as_built.iter().zip(&self.measured).enumerate() {
            while let Some(before) = counts.next_if(|before| before.layer <= index) {
                feedback.count_from(&before.count);
            }
            if let Some(layer) = as_built.as_ref().or(self.layers.get(index)) {
                feedback.laid(layer, measured.as_ref());
                after_layer(&feedback);
            }
        }
        counts.for_each(|before| feedback.count_from(&before.count));
        (0..self.amendments).for_each(|_| feedback.amended());
        Some(feedback)
    }

    fn of_header(header: Header, file: &str) -> Self {
        Self {
            feedback: header.feedback.and_then(WrittenNoise::checked),
            robot: RobotId { name: header.robot, hash: header.robot_hash },
            tip: header.tip,
            plan: header.plan,
            file: file.to_string(),
            plan_id: header.plan_id,
            total: header.layers.len() as u32,
            layers: header.layers,
            as_built: Vec::new(),
            measured: Vec::new(),
            counts: Vec::new(),
            amendments: 0,
            replaced: None,
            result: None,
            lost: Vec::new(),
            damage: Damage::default(),
            simulated: Vec::new(),
        }
    }

    fn ingest(&mut self, event: RunEvent) {
        match event {
            RunEvent::Laid(laid) => self.laid(&laid),
            RunEvent::Simulated(layer) => self.place(&layer),
            RunEvent::Counting(count) => self.counts.push(CountBefore { layer: self.as_built.len(), count }),
            RunEvent::Amending(amendment) => self.amend(amendment),
            RunEvent::NotAmended { .. } => self.revert_amendment(),
            // The job before the latest amendment had what that put there, and not what is handed over since.
            RunEvent::HandingOver { from, layers } => drop(self.replace(from as usize, layers)),
            RunEvent::Resumed(_) => self.result = None,
            RunEvent::End { result } => self.result = Some(*result),
            _ => {}
        }
    }

    fn amend(&mut self, amendment: Amendment) {
        let Amendment { plan_id, from, total, layers } = amendment;
        if let Some(layers) = self.replace(from as usize, layers) {
            let before = Replaced { plan_id: self.plan_id, total: self.total, from: from as usize, layers };
            self.replaced = Some(before);
            (self.plan_id, self.total) = (plan_id, total);
            self.amendments = self.amendments.saturating_add(1);
        }
    }

    /// Replaces the layers from an index on; gives what was there.
    fn replace(&mut self, from: usize, layers: Vec<LayerBytes>) -> Option<Vec<LayerBytes>> {
        let before = (from <= self.layers.len()).then(|| self.layers.split_off(from))?;
        self.layers.extend(layers);
        Some(before)
    }

    /// A layer was laid. Those before it whose lines are missing were laid too.
    fn laid(&mut self, laid: &LaidLayer) {
        let (index, next) = (laid.layer as usize, self.as_built.len());
        let measured = laid.measured.map(Measured::from);
        if let Ok(at) = self.lost.binary_search(&index) {
            // It is reported again after a resumption.
            self.lost.remove(at);
            if let (Some(layer), Some(known)) = (self.as_built.get_mut(index), self.measured.get_mut(index)) {
                (*layer, *known) = (laid.as_built, measured);
            }
        } else if index >= next && (index == next || index < self.layers.len()) {
            self.lost.extend(next..index);
            self.as_built.resize(index, None);
            self.measured.resize(index, None);
            self.as_built.push(laid.as_built);
            self.measured.push(measured);
        }
        // Otherwise it is reported again after a resumption: the first report stands.
    }

    /// Where a layer of a simulated tip lies.
    fn place(&mut self, placed: &SimulatedLayer) {
        let WrittenLayer { alpha_deg, height_mm, tilt_deg } = placed.numbers;
        let (index, tilt) = (placed.layer as usize, radians(tilt_deg));
        // One more than there are layers may be under way.
        let is_one = index <= self.layers.len().max(self.simulated.len());
        if is_one
            && (0.0..=MAX_HEIGHT).contains(&height_mm)
            && (0.0..=MAX_TILT).contains(&tilt)
            && alpha_deg.is_finite()
        {
            if self.simulated.len() <= index {
                self.simulated.resize(index + 1, None);
            }
            if let Some(layer) = self.simulated.get_mut(index) {
                *layer = Some(Layer { alpha: wrap_positive(radians(alpha_deg)), height: height_mm, tilt });
            }
        }
    }
}

/// Why the first line of a log is no header that can be read: its format, its plan, or another field.
fn wrong_header(fields: &Value, file: &str) -> RunRecordError {
    let wrong = |reason: String| RunRecordError::Header { file: file.to_string(), reason };
    match fields.get("format").and_then(Value::as_str) {
        None => return wrong("its header has no \"format\"".to_string()),
        Some(FORMAT) => {}
        Some(format) => {
            let by = fields.get("growbot").and_then(Value::as_str).unwrap_or("of its time");
            return wrong(format!(
                "its format is {format:?}, I read {FORMAT:?}: use growbot {by}, which has written it"
            ));
        }
    }
    let plan = fields.get("plan").unwrap_or(&Value::Null).to_string();
    match (serde_json::from_value::<Header>(fields.clone()), PlanFile::parse(&plan, file)) {
        (_, Err(error)) => error.into(),
        (Err(error), Ok(_)) => wrong(match error.to_string().replace('`', "\"").strip_prefix("missing field ") {
            Some(field) => format!("its header has no {field}"),
            None => format!("its header has {}", error.to_string().replace('`', "\"")),
        }),
        (Ok(_), Ok(_)) => wrong("its first line is no header".to_string()),
    }
}
