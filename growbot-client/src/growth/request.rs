//! A requested growth: checked, run and ended in the same way by every program.

use std::path::PathBuf;

use growbot_core::link::message::HostSilencePolicy;
use growbot_core::robot::Robot;
use growbot_core::simulation::ErrorModel;
use growbot_core::tracking::SensorNoise;
use growbot_plan::clearance_guard::{ClearanceViolation, SceneContext};
use growbot_plan::feedback::{Feedback, can_measure};
use growbot_plan::growth_report::GrowthReport;
use growbot_plan::job::{Job, JobEvent};
use growbot_plan::plan::Plan;
use growbot_plan::robot_kind::RobotKind;
use growbot_plan::run_log::{GrowthResult, OutcomeKind, RecordedRun, RunLog, RunLogError, RunOrigin};
use growbot_plan::scene_planning::SceneCheckError;
use growbot_plan::warning::BLOCKING;
use growbot_scene::scene_file::LoadedScene;

use super::{CommandQueue, GrowthError, GrowthOptions, OnInterrupted, OnParked, grow_job, resume_job};
use crate::client::Client;
use crate::ground_truth::{GroundTruth, grow_with_ground_truth};

/// Seed of the random errors of a simulated robot, unless the user gives another one.
pub const DEFAULT_SEED: u64 = 1;

/// A check of a growth that the user ignores.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Override {
    /// The plan has warnings because of which growbot refuses to grow it.
    Warnings,
    /// The plan is not clear of its scene. Corrections of the feedback are not kept clear of it either.
    Scene,
}

impl Override {
    /// Returns the overrides that a user has given.
    pub fn given(choices: [(bool, Self); 2]) -> Vec<Self> {
        choices.into_iter().filter(|(is_given, _)| *is_given).map(|(_, given)| given).collect()
    }
}

/// The layer at which a growth begins.
#[derive(Debug, Clone, Copy)]
pub enum Beginning<'a> {
    /// The growth begins with the first layer of the plan.
    FirstLayer,
    /// The growth resumes the job that the board stores.
    Resume {
        /// Content of the growth's run log. `None` without a log. The feedback is then off.
        record: Option<&'a RecordedRun>,
        /// Treatment of an interrupted layer.
        interrupted: OnInterrupted,
    },
}

/// A growth that a user requests.
#[derive(Debug, Clone, Copy)]
pub struct GrowthRequest<'a> {
    /// Robot for which the plan was made.
    pub robot: &'a Robot,
    /// Plan of the body.
    pub plan: &'a Plan,
    /// First layer of the growth.
    pub beginning: Beginning<'a>,
    /// Scene of the body. `None` without a scene.
    pub scene: Option<&'a LoadedScene>,
    /// Reason why the plan is not clear of the scene. `None` if it is clear, or without a scene.
    pub scene_error: Option<&'a SceneCheckError>,
    /// Checks that the user ignores.
    pub overrides: &'a [Override],
    /// Noise of the sensors that the feedback assumes. `None` for a growth without feedback. A resumed growth has the
    /// feedback of its run log.
    pub feedback: Option<SensorNoise>,
    /// Errors of the layers and measurements of a simulated robot.
    pub imperfection: ErrorModel,
    /// Kind of the robot.
    pub kind: RobotKind,
}

/// Reason why a growth is refused before anything is sent to its board. The message names no remedy, because each
/// program has its own.
#[derive(Debug, thiserror::Error)]
pub enum GrowthRefusal<'a> {
    /// The plan has warnings because of which growbot refuses to grow it.
    #[error("not grown because of {}", codes.join(", "))]
    Warnings {
        /// Codes of the warnings.
        codes: Vec<String>,
    },
    /// The plan is not clear of its scene.
    #[error("{0}")]
    Scene(&'a SceneCheckError),
    /// The layers of a robot that is not simulated cannot be disturbed.
    #[error("layers cannot be disturbed, because the robot is not simulated")]
    Disturbance,
    /// The noise of the sensors has no use without feedback on a robot that is not simulated.
    #[error("only feedback uses the noise of the robot's sensors")]
    SensorNoise,
    /// The robot has no sensor for feedback.
    #[error("robot {robot} has no sensor that measures layers")]
    NoSensor {
        /// Name of the robot.
        robot: String,
    },
    /// With feedback, the plan is too near to an obstacle of its scene.
    #[error(transparent)]
    Clearance(ClearanceViolation),
}

impl GrowthRefusal<'_> {
    /// Returns the code of the refusal for programs.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Warnings { .. } => "plan-warnings",
            Self::Scene(_) => "scene-not-clear",
            Self::Disturbance => "disturbed-hardware",
            Self::SensorNoise => "noise-without-feedback",
            Self::NoSensor { .. } => "no-sensor",
            Self::Clearance(_) => "too-near",
        }
    }

    /// Reports whether the request itself contradicts the robot, unlike a plan that could be grown if the user ignored
    /// a check.
    pub fn is_invalid_request(&self) -> bool {
        matches!(self, Self::Disturbance | Self::SensorNoise | Self::NoSensor { .. })
    }
}

/// File to which the run log of a growth is written.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum LogTarget {
    /// No file.
    Disabled,
    /// Standard output.
    StandardOutput,
    /// A new file. For a resumed growth with a record, the file of that record, to which lines are added.
    File(PathBuf),
    /// A file that replaces an existing log once a layer of the new body is laid.
    Replaced(PathBuf),
}

impl LogTarget {
    /// Returns the file for a copy of a run log that another program writes. `None` if no file is requested.
    ///
    /// # Errors
    /// [`RunLogError::Exists`] if a new file is requested and the file exists.
    pub fn copy(self) -> Result<Option<PathBuf>, RunLogError> {
        match self {
            Self::File(file) if file.exists() => Err(RunLogError::Exists { file: file.display().to_string() }),
            Self::File(file) | Self::Replaced(file) => Ok(Some(file)),
            Self::Disabled | Self::StandardOutput => Ok(None),
        }
    }
}

/// Board of a growth, with the body of its simulated tip.
pub struct GrowthBoard<'a> {
    /// Connection to the board.
    pub client: &'a mut Client,
    /// Body that the simulated tip has really laid. `None` for a robot that is not simulated.
    pub truth: Option<&'a mut dyn GroundTruth>,
    /// Commands of users during the growth.
    pub commands: &'a CommandQueue,
    /// Reaction of the board if it receives nothing from this host for too long.
    pub silence: HostSilencePolicy,
    /// Reaction of the growth when the board switches its heater off after a long pause (parks).
    pub parked: OnParked,
}

impl<'a> GrowthRequest<'a> {
    /// Creates a request to grow a plan from its first layer on a robot that is not simulated, without scene and
    /// feedback.
    pub fn new(robot: &'a Robot, plan: &'a Plan) -> Self {
        Self {
            robot,
            plan,
            beginning: Beginning::FirstLayer,
            scene: None,
            scene_error: None,
            overrides: &[],
            feedback: None,
            imperfection: ErrorModel { seed: DEFAULT_SEED, ..ErrorModel::default() },
            kind: RobotKind::Real,
        }
    }

    /// Checks everything that can be checked without the board.
    ///
    /// # Errors
    /// The first reason against the growth.
    pub fn check(&self) -> Result<(), GrowthRefusal<'a>> {
        let warnings = self.plan.warnings.iter().map(|warning| &warning.code);
        let codes: Vec<String> = warnings.filter(|code| BLOCKING.contains(&code.as_str())).cloned().collect();
        if !codes.is_empty() && !self.overrides.contains(&Override::Warnings) {
            return Err(GrowthRefusal::Warnings { codes });
        }
        if let Some(error) = self.scene_error.filter(|_| !self.overrides.contains(&Override::Scene)) {
            return Err(GrowthRefusal::Scene(error));
        }
        let ErrorModel { disturbance, noise, .. } = self.imperfection;
        if !self.kind.is_simulated() && disturbance != ErrorModel::default().disturbance {
            return Err(GrowthRefusal::Disturbance);
        }
        if !self.kind.is_simulated() && self.feedback.is_none() && noise != ErrorModel::default().noise {
            return Err(GrowthRefusal::SensorNoise);
        }
        if self.feedback.is_some() && !can_measure(self.robot) {
            return Err(GrowthRefusal::NoSensor { robot: self.robot.name().to_owned() });
        }
        let context = self.scene_context();
        let feedback = context.as_ref().and_then(|context| self.new_feedback(Some(context)));
        feedback.map_or(Ok(()), |feedback| feedback.check_start().map_err(GrowthRefusal::Clearance))
    }

    /// Reports whether the body is grown without regard to its scene.
    pub fn ignores_scene(&self) -> bool {
        (self.scene.is_some() || self.plan.scene.is_some()) && self.overrides.contains(&Override::Scene)
    }

    /// Reports whether layers or measurements of a simulated robot are to have errors.
    pub fn has_imperfection(&self) -> bool {
        let (ErrorModel { disturbance, noise, .. }, default) = (self.imperfection, ErrorModel::default());
        (disturbance, noise) != (default.disturbance, default.noise)
    }

    /// Returns the job for the board.
    pub fn job(&self) -> Job<'a> {
        let mut job = Job::of_plan(self.robot, self.plan);
        if let Beginning::Resume { record: Some(record), .. } = self.beginning {
            // The original layers, because the plan's file may have rounded its numbers.
            (job.plan_id, job.layers) = (record.plan_id, record.layers.clone());
        }
        job
    }

    /// Opens the run log of the growth. `port` is the port as the user gave it.
    ///
    /// # Errors
    /// If the file cannot be written, or exists already.
    pub fn open_log(&self, target: &LogTarget, job: &Job, port: &str) -> Result<RunLog, RunLogError> {
        let (plan, feedback) = (self.plan, self.feedback);
        let imperfection = self.kind.is_simulated().then_some(&self.imperfection);
        let origin = RunOrigin { port, imperfection, ignores_scene: self.ignores_scene() };
        match (target, self.beginning) {
            (LogTarget::Disabled, _) => Ok(RunLog::disabled()),
            (LogTarget::File(path), Beginning::Resume { record: Some(record), .. }) => {
                RunLog::resume(path, record, port)
            }
            (LogTarget::StandardOutput, _) => RunLog::to_standard_output(plan, job, feedback, origin),
            (LogTarget::File(path), _) => RunLog::create(path, plan, job, feedback, origin),
            (LogTarget::Replaced(path), _) => RunLog::replace(path, plan, job, feedback, origin),
        }
    }

    /// Runs the growth until it ends. `job` is the job of this request. `on_event` receives the events of the job.
    ///
    /// # Errors
    /// Like [`grow_job`] and [`resume_job`].
    pub fn run(
        &self,
        job: &Job,
        board: GrowthBoard,
        on_event: &mut dyn FnMut(&JobEvent),
    ) -> Result<GrowthReport, GrowthError> {
        let GrowthBoard { client, truth, commands, silence, parked } = board;
        let context = self.scene_context();
        match self.beginning {
            Beginning::FirstLayer => {
                let feedback = self.new_feedback(context.as_ref());
                let options = GrowthOptions { feedback, parked, ..silence.into() };
                grow_with_ground_truth(truth, job, on_event, |on_event| {
                    grow_job(client, job, options, commands, on_event)
                })
            }
            Beginning::Resume { record, interrupted } => {
                let feedback = record.and_then(|record| record.feedback(job, self.plan, context.as_ref()));
                let known = record.map_or_else(Vec::new, RecordedRun::known_layers);
                let options = GrowthOptions { silence, feedback, parked, interrupted };
                resume_job(client, job, known, options, commands, on_event)
            }
        }
    }

    /// Returns the result of the growth, and ends its log: with the result as the last line, or by deleting the log if
    /// nothing began. The result has the number of lines that could not be written.
    ///
    /// # Errors
    /// The error of the log. The result is complete nevertheless.
    pub fn end(
        &self,
        grown: &Result<GrowthReport, GrowthError>,
        log: &mut RunLog,
    ) -> (GrowthResult, Result<(), RunLogError>) {
        let mut result = self.result(grown);
        if result.outcome == OutcomeKind::Refused {
            std::mem::take(log).discard();
            return (result, Ok(()));
        }
        let written = log.end(&result);
        result.log_lines_missing = Some(log.missing_lines()).filter(|missing| *missing > 0);
        (result, written)
    }

    /// Returns the result of the growth, or of a growth that did not begin or whose outcome is not known.
    pub fn result(&self, grown: &Result<GrowthReport, GrowthError>) -> GrowthResult {
        let (outcome, error) = match grown {
            Ok(grown) => {
                let scene = self.scene.map(|loaded| &loaded.scene);
                return GrowthResult::new(grown, (self.robot, self.plan), scene, self.seed(), self.kind);
            }
            Err(GrowthError::Interrupted(error)) => (OutcomeKind::Lost, error.to_string()),
            Err(error) => (OutcomeKind::Refused, error.to_string()),
        };
        let nothing = GrowthResult::nothing_grown(outcome, self.plan, self.seed(), self.kind);
        GrowthResult { error: Some(error), ..nothing }
    }

    /// Returns the result of a growth that was refused before it began. `why` is the reason with its remedy.
    pub fn refused(&self, refusal: &GrowthRefusal, why: String) -> GrowthResult {
        let nothing = GrowthResult::nothing_grown(OutcomeKind::Refused, self.plan, None, self.kind);
        GrowthResult { error: Some(why), refusal: Some(refusal.code().to_owned()), ..nothing }
    }

    /// Returns the seed of the random errors of a simulated robot. `None` if nothing is random.
    fn seed(&self) -> Option<u64> {
        (self.kind.is_simulated() && self.has_imperfection()).then_some(self.imperfection.seed)
    }

    /// Returns the scene of which corrections of the feedback are kept clear. `None` if there are no corrections, or
    /// no scene, or if the user ignores it.
    fn scene_context(&self) -> Option<SceneContext<'a>> {
        let has_feedback = match self.beginning {
            Beginning::FirstLayer => self.feedback.is_some(),
            Beginning::Resume { record, .. } => record.is_some_and(|record| record.feedback.is_some()),
        };
        let scene = self.scene.filter(|_| has_feedback && !self.overrides.contains(&Override::Scene))?;
        Some(SceneContext::new(self.robot, scene, self.plan.radius).after_layers(&self.plan.existing_layers))
    }

    fn new_feedback<'c>(&'c self, context: Option<&'c SceneContext<'c>>) -> Option<Feedback<'c>> {
        let plan = self.plan;
        let feedback = Feedback::new(self.robot, &plan.start, &plan.path, &plan.legs, self.feedback?);
        Some(context.into_iter().fold(feedback, Feedback::with_scene))
    }
}

#[cfg(test)]
mod tests {
    use growbot_core::plan::Planner;
    use growbot_core::pose::Pose;
    use growbot_core::simulation::Disturbance;
    use growbot_plan::robot_file;
    use growbot_plan::scene_planning::attach_scene;

    use super::*;

    const UP: [f64; 5] = [0.0, 0.0, 0.0, 0.0, 90.0];
    const NOISE: SensorNoise = SensorNoise { odometry: 0.01, direction: 0.2 };

    fn plan(robot: &Robot, goal: [f64; 5]) -> Plan {
        let [start, goal] = [UP, goal].map(|pose| Pose::from_degrees(pose).unwrap());
        Plan::new(robot, &start, &goal, 100.0, Planner::Shortest).unwrap()
    }

    fn request<'a>(robot: &'a Robot, plan: &'a Plan) -> GrowthRequest<'a> {
        GrowthRequest { kind: RobotKind::Simulated, ..GrowthRequest::new(robot, plan) }
    }

    /// Returns a scene with a shaft round a straight body, with this distance from its centreline to the walls.
    fn shaft(free_mm: f64) -> LoadedScene {
        let directory = tempfile::tempdir().unwrap();
        let file = directory.path().join("shaft.toml");
        let walls = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]].map(|[x, y]| {
            let off = 60.0 + free_mm;
            format!("[[box]]\ncenter_mm = [{}, {}, 300]\nsize_mm = [120, 120, 500]\n", x * off, y * off)
        });
        let text = format!("format = \"growbot-scene/1\"\nmargin_mm = 0\n{}", walls.concat());
        std::fs::write(&file, text).unwrap();
        growbot_scene::scene_file::load(&file).unwrap()
    }

    #[test]
    fn each_reason_is_refused_with_its_code_unless_it_is_ignored() {
        let [robot, blind] = ["growbot-a", "growbot-a2"].map(|name| robot_file::load(name.as_ref()).unwrap());
        let straight = plan(&robot, [0.0, 0.0, 600.0, 0.0, 90.0]);
        // The spool is too short for it.
        let long = plan(&robot, [0.0, 0.0, 5000.0, 0.0, 90.0]);
        let sound = request(&robot, &straight);
        sound.check().unwrap();
        let disturbed = ErrorModel {
            disturbance: Disturbance { growth_noise: 0.1, ..Disturbance::default() },
            ..ErrorModel::default()
        };
        let noisy = ErrorModel { noise: NOISE, ..ErrorModel::default() };
        let [near, touching] = [23.3, 20.0].map(shaft);
        let unclear = attach_scene(&mut straight.clone(), &robot, "shaft.toml", &touching).unwrap_err();
        let of_blind = plan(&blind, [0.0, 0.0, 600.0, 0.0, 90.0]);
        let ignored: [&[Override]; 2] = [&[Override::Warnings], &[Override::Scene]];
        for (refused, code, by) in [
            (request(&robot, &long), "plan-warnings", Some(ignored[0])),
            (
                GrowthRequest { scene: Some(&touching), scene_error: Some(&unclear), ..sound },
                "scene-not-clear",
                Some(ignored[1]),
            ),
            (GrowthRequest { imperfection: disturbed, kind: RobotKind::Real, ..sound }, "disturbed-hardware", None),
            (GrowthRequest { imperfection: noisy, kind: RobotKind::Real, ..sound }, "noise-without-feedback", None),
            (GrowthRequest { feedback: Some(NOISE), ..request(&blind, &of_blind) }, "no-sensor", None),
            (GrowthRequest { scene: Some(&near), feedback: Some(NOISE), ..sound }, "too-near", Some(ignored[1])),
        ] {
            let refusal = refused.check().err().unwrap_or_else(|| panic!("{code} is not refused"));
            assert_eq!(refusal.code(), code, "{refusal}");
            assert_eq!(refusal.is_invalid_request(), by.is_none(), "{refusal}");
            for overrides in ignored {
                let checked = GrowthRequest { overrides, ..refused }.check();
                assert_eq!(checked.is_ok(), by == Some(overrides), "{code} with {overrides:?}");
            }
        }
        GrowthRequest { imperfection: disturbed, ..sound }.check().unwrap();
        GrowthRequest { imperfection: noisy, kind: RobotKind::Real, feedback: Some(NOISE), ..sound }.check().unwrap();
    }
}
