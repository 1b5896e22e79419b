//! Content of a run log: the job, the layers as the board has built them, and the true position of the plastic of a
//! simulated tip.

use std::path::Path;

use growbot_core::angle::{radians, wrap_positive};
use growbot_core::layer::Layer;
use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_core::link::message::LayerReadings;
use growbot_core::pose::{Frame, Pose};
use growbot_core::robot::Robot;
use growbot_core::tracking::SensorNoise;
use growbot_scene::scene_file::LoadedScene;
use serde_json::Value;

use super::event::{BoardRecord, LaidLayer, LayerJson, RunEvent, SimulatedLayer};
use super::header::{FORMAT, RunHeader, SensorNoiseJson, TipKind};
use super::reader::{Damage, Events, LogLine};
use super::result::{GrowthResult, OutcomeKind};
use crate::clearance_guard::SceneContext;
use crate::clock_drift::ClockDrift;
use crate::feedback::{EncoderReference, Feedback};
use crate::growth_report::as_built_or_commanded;
use crate::input::{InputError, MAX_LOG_BYTES, display_name, read_bytes};
use crate::job::{Amendment, Job};
use crate::plan::Plan;
use crate::plan_file::{self, PlanFile, PlanFileError, pose_from_json};
use crate::scene_planning::{self, SceneCheckError};

/// Maximum height of a layer that the bytes of the link can hold, mm, and maximum tilt, radians.
const MAX_HEIGHT: f64 = 256.0;
const MAX_TILT: f64 = 1.0;

/// Error of reading a run log.
#[derive(Debug, thiserror::Error)]
pub enum ReadRunLogError {
    /// The file does not exist, may not be read, or is too long.
    #[error("no run log to read: {0}")]
    File(#[from] InputError),
    /// The first line is not the header of a run log.
    #[error("{file} is not a run log that this version of growbot reads ({reason})")]
    Header {
        /// Name of the log's file.
        file: String,
        /// Reason why the first line is not a valid header.
        reason: String,
    },
    /// The plan in the log is not valid.
    #[error("{0}")]
    Plan(#[from] PlanFileError),
}

/// Source from which a recorded body is known.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BodyKind {
    /// The body is the plastic of a simulated tip at its true position.
    Laid,
    /// The body is computed from the steps that a simulated robot's board has made.
    Commanded,
    /// The body is computed from the steps that a real robot's board has made.
    AsBuilt,
}

impl BodyKind {
    /// Returns the name of the source for users.
    pub fn name(self) -> &'static str {
        match self {
            Self::Laid => "laid (simulated)",
            Self::Commanded => "commanded (simulated)",
            Self::AsBuilt => "as built",
        }
    }

    /// Returns the name of the source with a capital letter, for the heading of a table or a picture.
    pub fn title(self) -> &'static str {
        match self {
            Self::Laid => "Laid (simulated)",
            Self::Commanded => "Commanded (simulated)",
            Self::AsBuilt => "As built",
        }
    }
}

/// Content of a run log. A log that was cut off is read up to its last complete line.
#[derive(Debug, Clone, PartialEq)]
pub struct RecordedRun {
    /// Name and hash of the robot that has grown the body.
    pub robot: RobotId,
    /// Port of the robot, as the user gave it. Empty if the log does not contain it.
    pub port: String,
    /// Kind of tip that laid the body.
    pub tip: TipKind,
    /// True if the body was grown without regard to its scene.
    pub ignore_scene: bool,
    /// Plan that the header of the log contains.
    pub plan: PlanFile,
    /// Noise of the sensors that the feedback assumed. `None` without feedback.
    pub feedback: Option<SensorNoise>,
    /// Plan id of the job after its latest amendment.
    pub plan_id: u64,
    /// Number of layers of the job after its latest amendment.
    pub total: u32,
    /// Layers that were sent to the board, as commanded.
    pub layers: Vec<LayerBytes>,
    /// Layers as built, from the first layer on. `None` for a layer of which nothing is known.
    pub as_built: Vec<Option<LayerBytes>>,
    /// Sensor readings after each layer in `as_built`. `None` for a layer without readings.
    pub measured: Vec<Option<LayerReadings>>,
    /// Readings of the filament's encoder from which the feedback measured growth, in order.
    pub(super) counts: Vec<CountBefore>,
    /// Number of amendments that the board has accepted.
    amendments: u32,
    /// Part of the job that the latest amendment has replaced, for the case that the board has refused it. `None`
    /// without an amendment.
    replaced: Option<ReplacedLayers>,
    /// Name of the board's latest state, if the log contains one.
    pub board_state: Option<String>,
    /// Result of the growth, if the log contains it.
    pub result: Option<GrowthResult>,
    /// Indices of the layers whose lines are missing, in order. They were laid, but the log has lost their data.
    pub lost: Vec<usize>,
    /// Parts of the log that could not be read.
    pub damage: Damage,
    /// For a simulated tip: layers with their errors, as the plastic lies, including a layer in progress. `None` for a
    /// layer whose position is not in the log.
    simulated: Vec<Option<Layer>>,
    /// Name of the file in error messages.
    file: String,
}

/// Identity of the robot in the header of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RobotId {
    /// Name of the robot.
    pub name: String,
    /// Hash of the robot's description.
    pub hash: u64,
}

/// A reading of the filament's encoder before a layer, from which the feedback measured growth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct CountBefore {
    /// Index of the layer before which the encoder was read.
    pub layer: usize,
    /// The reading, with the boot number of the board.
    pub count: EncoderReference,
}

/// The part of a job that an amendment has replaced.
#[derive(Debug, Clone, PartialEq, Eq)]
struct ReplacedLayers {
    /// Plan id of the job before the amendment.
    plan_id: u64,
    /// Number of layers of the job before the amendment.
    total: u32,
    /// Index of the first layer that the amendment has replaced.
    from: usize,
    /// Layers that the amendment has replaced.
    layers: Vec<LayerBytes>,
}

impl RecordedRun {
    /// Reads a run log from a file, or from standard input for `-`.
    ///
    /// # Errors
    /// [`ReadRunLogError`].
    pub fn open(path: &Path) -> Result<Self, ReadRunLogError> {
        Self::read(&read_bytes(path, MAX_LOG_BYTES)?, &display_name(path))
    }

    /// Reads a run log from its bytes. `file` is the name of the log in error messages.
    ///
    /// # Errors
    /// [`ReadRunLogError::Header`] or [`ReadRunLogError::Plan`].
    pub fn read(bytes: &[u8], file: &str) -> Result<Self, ReadRunLogError> {
        let wrong = |reason: &str| ReadRunLogError::Header { file: file.to_string(), reason: reason.to_string() };
        if bytes.is_empty() {
            return Err(wrong("the file is empty"));
        }
        let mut events = Events::of(bytes);
        let first = events.next_line().filter(|_| events.damage == Damage::default());
        let mut record = match first.ok_or_else(|| wrong("the first line is not complete JSON"))? {
            LogLine::Event(RunEvent::Header(header))
                if header.format == FORMAT && header.plan.format == plan_file::FORMAT =>
            {
                Self::of_header(*header, file)
            }
            LogLine::Event(event) => return Err(wrong_header(&serde_json::to_value(event).unwrap_or_default(), file)),
            LogLine::Other(fields) => return Err(wrong_header(&fields.into(), file)),
        };
        for event in events.by_ref() {
            record.ingest(event);
        }
        record.damage = events.damage;
        Ok(record)
    }

    /// Returns the laid layers as built, computed from the board's steps. A layer of which nothing is known is returned
    /// as it was sent.
    pub fn commanded(&self) -> impl Iterator<Item = LayerBytes> {
        as_built_or_commanded(&self.as_built, &self.layers)
    }

    /// Returns the number of laid layers of which nothing is known.
    pub fn unknown_layers(&self) -> usize {
        self.as_built.iter().filter(|layer| layer.is_none()).count()
    }

    /// Returns the outcome of the growth. [`OutcomeKind::Unfinished`] if the log does not contain it.
    pub fn outcome(&self) -> OutcomeKind {
        self.result.as_ref().map_or(OutcomeKind::Unfinished, |result| result.outcome)
    }

    /// Returns the measured error of the board's clock. `None` unless the growth was stopped because of this error.
    pub fn clock_drift(&self) -> Option<ClockDrift> {
        self.result.as_ref()?.clock_drift
    }

    /// Reports whether the body was grown by a simulated robot.
    pub fn is_simulated(&self) -> bool {
        self.tip == TipKind::Simulated
    }

    /// Returns the layers of a simulated tip with their errors, as the plastic lies, including a layer in progress. A
    /// layer whose position is not in the log is returned as the board's steps have built it. `None` for a real robot,
    /// or if the log has laid layers but no position of any of them.
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

    /// Returns the source from which the body is known: the position of its plastic, or the steps of the board.
    pub fn body_kind(&self) -> BodyKind {
        match (self.tip, self.simulated()) {
            (TipKind::Robot, _) => BodyKind::AsBuilt,
            (TipKind::Simulated, None) => BodyKind::Commanded,
            (TipKind::Simulated, Some(_)) => BodyKind::Laid,
        }
    }

    /// Reports whether the log contains the position of the plastic of the layer of this index.
    pub fn has_simulated_layer(&self, index: usize) -> bool {
        self.is_simulated() && self.simulated.get(index).is_some_and(Option::is_some)
    }

    /// Returns the number of laid layers of a simulated tip whose position is not in the log. 0 for a real robot.
    pub fn missing_simulated_layers(&self) -> usize {
        if self.is_simulated() {
            (0..self.as_built.len()).filter(|index| !self.has_simulated_layer(*index)).count()
        } else {
            0
        }
    }

    /// Returns the layers as built before the first layer whose line is lost. The board need not report these layers
    /// again when the growth is resumed.
    pub fn known_layers(&self) -> Vec<Option<LayerBytes>> {
        let end = self.lost.first().copied().unwrap_or(self.as_built.len());
        self.as_built.get(..end).unwrap_or(&self.as_built).to_vec()
    }

    /// Returns the frame at which the body begins. If the plan has no valid start, returns the identity.
    pub(super) fn start_frame(&self) -> Frame {
        pose_from_json("start", &self.plan.start).map_or_else(|_| Frame::identity(), |start| start.frame())
    }

    /// Returns the robot of the run: the one described in the log, or else the built-in one of its name.
    ///
    /// # Errors
    /// Like [`PlanFile::own_robot`].
    pub fn own_robot(&self) -> Result<Robot, PlanFileError> {
        self.plan.own_robot(&self.file)
    }

    /// Returns the plan after checking it against its robot.
    ///
    /// # Errors
    /// If the plan is not valid, or was made for another robot.
    pub fn plan(&self, robot: &Robot) -> Result<Plan, PlanFileError> {
        self.plan.check(robot).map_err(|fault| PlanFileError::Fault { file: self.file.clone(), fault })
    }

    /// Returns the start pose and the goal pose of the plan.
    ///
    /// # Errors
    /// If the start or the goal is not a valid pose.
    pub fn start_and_goal(&self) -> Result<(Pose, Pose), PlanFileError> {
        let fault = |fault| PlanFileError::Fault { file: self.file.clone(), fault };
        Ok((
            pose_from_json("start", &self.plan.start).map_err(fault)?,
            pose_from_json("goal", &self.plan.goal.pose()).map_err(fault)?,
        ))
    }

    /// Reverts the latest amendment if `plan_id`, the job that the board stores, is that of the job before it, because
    /// the board has then not applied the amendment.
    pub fn sync_to_board(&mut self, plan_id: u64) {
        if self.replaced.as_ref().is_some_and(|before| before.plan_id == plan_id) {
            self.revert_amendment();
        }
    }

    fn revert_amendment(&mut self) {
        if let Some(ReplacedLayers { plan_id, total, from, layers }) = self.replaced.take() {
            self.layers.truncate(from);
            self.layers.extend(layers);
            (self.plan_id, self.total) = (plan_id, total);
            self.amendments = self.amendments.saturating_sub(1);
        }
    }

    /// Loads the scene of the plan from the file `given`, or else from the one that the plan names, relative to the
    /// directory of the log. `None` for a plan without a scene.
    ///
    /// # Errors
    /// If the scene is missing or has changed, or the plan is not clear of it.
    pub fn scene(
        &self,
        plan: &Plan,
        robot: &Robot,
        given: Option<&Path>,
    ) -> Result<Option<LoadedScene>, SceneCheckError> {
        let Some(written) = &self.plan.scene else { return Ok(None) };
        let beside = Path::new(&self.file).parent().unwrap_or(Path::new(""));
        let (_, loaded) = scene_planning::load_verified_scene(written, plan, robot, beside, given)?;
        Ok(Some(loaded))
    }

    /// Returns the feedback in its state at the end of the log, to resume the growth. With `scene`, its corrections are
    /// then checked to stay clear of the scene. `None` for a growth without feedback.
    pub fn feedback<'a>(
        &self,
        job: &Job<'a>,
        plan: &'a Plan,
        scene: Option<&'a SceneContext<'a>>,
    ) -> Option<Feedback<'a>> {
        self.replay_feedback(job, plan, scene, |_| ())
    }

    /// Returns the frame of the tip after each layer as the feedback estimated it. `None` for a growth without
    /// feedback.
    pub fn estimated(&self, job: &Job, plan: &Plan) -> Option<Vec<Frame>> {
        let mut path = Vec::with_capacity(self.as_built.len());
        self.replay_feedback(job, plan, None, |feedback| path.push(feedback.result().estimate.base_from_tip))?;
        Some(path)
    }

    /// Computes the feedback again from all layers and readings in the log, and calls `after_layer` after each layer.
    fn replay_feedback<'a>(
        &self,
        job: &Job<'a>,
        plan: &'a Plan,
        scene: Option<&'a SceneContext<'a>>,
        mut after_layer: impl FnMut(&Feedback),
    ) -> Option<Feedback<'a>> {
        let mut feedback = Feedback::new(job.robot, job.start, &plan.path, &plan.legs, self.feedback?);
        feedback = scene.into_iter().fold(feedback, Feedback::with_scene);
        let mut counts = self.counts.iter().peekable();
        for (index, (as_built, measured)) in self.as_built.iter().zip(&self.measured).enumerate() {
            while let Some(before) = counts.next_if(|before| before.layer <= index) {
                feedback.set_encoder_reference(&before.count);
            }
            if let Some(layer) = as_built.as_ref().or(self.layers.get(index)) {
                feedback.record_layer(layer, measured.as_ref());
                after_layer(&feedback);
            }
        }
        counts.for_each(|before| feedback.set_encoder_reference(&before.count));
        (0..self.amendments).for_each(|_| feedback.record_amendment());
        Some(feedback)
    }

    fn of_header(header: RunHeader, file: &str) -> Self {
        Self {
            feedback: header.feedback.and_then(SensorNoiseJson::checked),
            robot: RobotId { name: header.robot, hash: header.robot_hash },
            port: header.port,
            tip: header.tip,
            ignore_scene: header.ignore_scene,
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
            board_state: None,
            result: None,
            lost: Vec::new(),
            damage: Damage::default(),
            simulated: Vec::new(),
        }
    }

    fn ingest(&mut self, event: RunEvent) {
        match event {
            RunEvent::State { state } => self.board_state = Some(state),
            RunEvent::Board(BoardRecord { state, .. }) => self.board_state = Some(state),
            RunEvent::Status(status) => self.board_state = status.state.or(self.board_state.take()),
            RunEvent::Laid(laid) => self.apply_laid(&laid),
            RunEvent::Simulated(layer) => self.place(&layer),
            RunEvent::EncoderReference(count) => self.counts.push(CountBefore { layer: self.as_built.len(), count }),
            RunEvent::Amendment(amendment) => self.amend(amendment),
            RunEvent::AmendmentRejected { .. } => self.revert_amendment(),
            // The layers that this replaces are dropped, because reverting the latest amendment restores the layers
            // from before that amendment.
            RunEvent::LayersSent { from, layers } => drop(self.replace(from as usize, layers)),
            RunEvent::Resumed(_) => self.result = None,
            RunEvent::End { result } => self.result = Some(*result),
            _ => {}
        }
    }

    fn amend(&mut self, amendment: Amendment) {
        let Amendment { plan_id, from, total, layers } = amendment;
        if let Some(layers) = self.replace(from as usize, layers) {
            let before = ReplacedLayers { plan_id: self.plan_id, total: self.total, from: from as usize, layers };
            self.replaced = Some(before);
            (self.plan_id, self.total) = (plan_id, total);
            self.amendments = self.amendments.saturating_add(1);
        }
    }

    /// Replaces the sent layers from an index on. Returns the replaced layers, or `None` if the index is beyond the
    /// layers.
    fn replace(&mut self, from: usize, layers: Vec<LayerBytes>) -> Option<Vec<LayerBytes>> {
        let before = (from <= self.layers.len()).then(|| self.layers.split_off(from))?;
        self.layers.extend(layers);
        Some(before)
    }

    /// Records a laid layer. Earlier layers that are not in the log are recorded as lost, because they were laid too.
    fn apply_laid(&mut self, laid: &LaidLayer) {
        let (index, next) = (laid.layer as usize, self.as_built.len());
        let measured = laid.measured.map(LayerReadings::from);
        if let Ok(at) = self.lost.binary_search(&index) {
            // After a resumption, the board has reported the layer again.
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
        // Otherwise the layer was already reported, and the first report stays valid.
    }

    /// Records the position of a layer of a simulated tip, if its values are valid.
    fn place(&mut self, placed: &SimulatedLayer) {
        let LayerJson { alpha_deg, height_mm, tilt_deg } = placed.numbers;
        let (index, tilt) = (placed.layer as usize, radians(tilt_deg));
        // The log may contain the position of one layer in progress after the last layer of the job.
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

/// Returns the error for a first line that is not a valid header: its format, its plan or another field is wrong.
fn wrong_header(fields: &Value, file: &str) -> ReadRunLogError {
    let wrong = |reason: String| ReadRunLogError::Header { file: file.to_string(), reason };
    match fields.get("format").and_then(Value::as_str) {
        None => return wrong("the header has no \"format\"".to_string()),
        Some(FORMAT) => {}
        Some(format) => {
            let version = fields.get("growbot").and_then(Value::as_str).unwrap_or("of unknown version");
            return wrong(format!(
                "the format is {format:?}, but this version of growbot reads {FORMAT:?}: use the version that wrote \
                 the file ({version})"
            ));
        }
    }
    let plan = fields.get("plan").unwrap_or(&Value::Null).to_string();
    match (serde_json::from_value::<RunHeader>(fields.clone()), PlanFile::parse(&plan, file)) {
        (_, Err(error)) => error.into(),
        (Err(error), Ok(_)) => wrong(match error.to_string().replace('`', "\"").strip_prefix("missing field ") {
            Some(field) => format!("the header has no {field}"),
            None => format!("the header has {}", error.to_string().replace('`', "\"")),
        }),
        (Ok(_), Ok(_)) => wrong("the first line is not a header".to_string()),
    }
}
