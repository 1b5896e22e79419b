//! Inputs of a command: a robot and its plan, with the run log and the scene.

use std::path::Path;

use growbot_core::robot::Robot;
use growbot_pictures::view::{NamedScene, Subject};
use growbot_plan::input::{MAX_LOG_BYTES, display_name, read_bytes, text_of};
use growbot_plan::plan::Plan;
use growbot_plan::plan_file::{self, LoadedPlan, PlanFileError};
use growbot_plan::pose_text::parse_goal;
use growbot_plan::run_log::RecordedRun;
use growbot_scene::scene_file::{LoadedScene, load};
use serde_json::Value;

use super::failure::Failure;
use super::remedies;

/// Returns an error if the file does not exist and its name is a pose, which users type in place of a plan.
pub fn refuse_pose(file: &Path) -> Result<(), Failure> {
    match file.to_str() {
        Some(pose) if !file.exists() && parse_goal(pose).is_ok() => Err(Failure::bad_input(format!(
            "{pose} is a pose, and a file is expected: `growbot plan --to {pose} -o plan.json` makes a plan"
        ))),
        _ => Ok(()),
    }
}

/// A robot and its plan, with the run log if the body was grown.
pub struct BodyInput {
    pub robot: Robot,
    pub plan: Plan,
    /// Run log of the body: its record, and its bytes. `None` for a plan.
    pub run: Option<(RecordedRun, Vec<u8>)>,
    /// Scene that is shown with the body: its name, and its contents. `None` without a scene.
    pub scene: Option<(String, LoadedScene)>,
}

impl BodyInput {
    /// Returns the plan without a run log. `given` is the file of the scene, if it is not the one that the plan names.
    pub fn of_plan(loaded: LoadedPlan, given: Option<&Path>) -> Self {
        let LoadedPlan { robot, plan, scene } = loaded;
        let scene = scene.map(|scene| (scene_name(given, plan.scene.as_ref().map(|scene| &scene.file)), scene));
        Self { robot, plan, run: None, scene }
    }

    /// Returns the record of the run log. `None` for a plan.
    pub fn record(&self) -> Option<&RecordedRun> {
        self.run.as_ref().map(|(record, _)| record)
    }

    /// Returns true if the body was grown by a simulated robot.
    pub fn is_simulated(&self) -> bool {
        self.record().is_some_and(RecordedRun::is_simulated)
    }

    /// Returns the scene. `None` without a scene.
    pub fn scene(&self) -> Option<&LoadedScene> {
        self.scene.as_ref().map(|(_, loaded)| loaded)
    }

    /// Returns the scene with its name. `None` without a scene.
    pub fn named_scene(&self) -> Option<NamedScene<'_>> {
        self.scene.as_ref().map(|(file, loaded)| NamedScene { file, scene: &loaded.scene })
    }

    /// Returns the body for a view that has this name.
    pub fn subject<'a>(&'a self, name: &'a str) -> Subject<'a> {
        let Self { robot, plan, .. } = self;
        Subject { name, robot, plan, run: self.record(), laid: None, scene: self.named_scene() }
    }

    /// Reads a plan or a run log from a file, from standard input (`-`), or from a pipe that the shell has opened.
    /// The input is read only once, because a pipe cannot be read again. The scene is that of the plan, read from the
    /// file `given` if there is one. If the plan has no scene, `given` is the scene.
    pub fn open(file: &Path, robot: Option<&Path>, given: Option<&Path>) -> Result<Self, Failure> {
        let mut opened = Self::read(file, robot, given)?;
        if let (None, Some(given)) = (&opened.scene, given) {
            opened.scene = Some((given.display().to_string(), load(given)?));
        }
        Ok(opened)
    }

    fn read(file: &Path, robot: Option<&Path>, given: Option<&Path>) -> Result<Self, Failure> {
        refuse_pose(file)?;
        let bytes = read_bytes(file, MAX_LOG_BYTES)?;
        if is_log(&bytes) {
            let record = RecordedRun::read(&bytes, &display_name(file))?;
            warn_of_damage(&record, file);
            let robot = robot_of(&record, robot)?;
            let plan = record.plan(&robot)?;
            let scene = match record.scene(&plan, &robot, given) {
                Ok(scene) => scene,
                Err(error) if given.is_some() => return Err(error.into()),
                // A grown body can be shown without its scene.
                Err(error) => {
                    growbot_host::warning!(
                        "{}; the scene of {} is left out",
                        remedies::message(&error),
                        display_name(file)
                    );
                    None
                }
            };
            let scene =
                scene.map(|scene| (scene_name(given, record.plan.scene.as_ref().map(|scene| &scene.file)), scene));
            return Ok(Self { robot, plan, run: Some((record, bytes)), scene });
        }
        match plan_file::read_in_scene(&text_of(bytes, file)?, &display_name(file), robot, given) {
            Err(PlanFileError::NotJson { file, error }) => Err(neither(&file, &format!("not JSON: {error}"))),
            Err(PlanFileError::NoPlan { file, error }) => Err(neither(&file, &error.to_string())),
            Err(error) => Err(error.into()),
            Ok(loaded) => Ok(Self::of_plan(loaded, given)),
        }
    }
}

/// Returns the name of a scene: the given file, or else the name in the plan.
fn scene_name(given: Option<&Path>, named: Option<&String>) -> String {
    given.map(|given| given.display().to_string()).or_else(|| named.cloned()).unwrap_or_default()
}

fn neither(file: &str, reason: &str) -> Failure {
    Failure::bad_input(format_args!(
        "{file} is neither a run log nor a plan ({reason}): give a file that `growbot grow --log` or `growbot plan -o` \
         wrote"
    ))
}

/// Returns true if a file begins like a run log: with a line of JSON that is an event.
fn is_log(bytes: &[u8]) -> bool {
    let first = bytes.split(|byte| *byte == b'\n').next().unwrap_or_default();
    serde_json::from_slice::<Value>(first).is_ok_and(|line| line.get("event").is_some())
}

/// Returns the robot of a run: the given one, or else the one that the log describes or names. A log refers to no other
/// file.
pub fn robot_of(record: &RecordedRun, robot: Option<&Path>) -> Result<Robot, Failure> {
    match robot {
        Some(robot) => Ok(growbot_plan::robot_file::load(robot)?),
        None => Ok(record.own_robot()?),
    }
}

/// Warns about the parts of a run log that could not be read.
pub fn warn_of_damage(record: &RecordedRun, file: &Path) {
    if let Some(words) = record.damage.message(&display_name(file)) {
        growbot_host::warning!("{words}");
    }
}
