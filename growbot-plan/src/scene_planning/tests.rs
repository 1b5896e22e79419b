//! Tests of plans through scenes.

use std::fs;

use growbot_core::pose::Position;
use nalgebra::Vector3;

use super::*;
use crate::margin::planning_margin_mm;
use crate::plan_file::{self, PlanFile, PlanFileError};
use crate::pose_text::parse_pose;
use crate::robot_file;

const SCENE: &str = "format = \"growbot-scene/1\"\nmargin_mm = 5\n[[ball]]\ncenter_mm = [0, 0, 300]\n\
                     radius_mm = 60\n[[capsule]]\nfrom_mm = [-500, 100, 500]\nto_mm = [500, 100, 500]\n\
                     radius_mm = 20\n";

struct PlanFixture {
    directory: tempfile::TempDir,
    robot: Robot,
    start: Pose,
    search: PlanOptions<'static>,
}

impl PlanFixture {
    fn new() -> Self {
        let directory = tempfile::tempdir().unwrap();
        fs::write(directory.path().join("scene.toml"), SCENE).unwrap();
        Self {
            directory,
            robot: robot_file::load(robot_file::DEFAULT.as_ref()).unwrap(),
            start: parse_pose("0,0,0,0,90").unwrap(),
            search: PlanOptions {
                radius: 100.0,
                planner: Planner::Shortest,
                avoid_self_collision: true,
                existing: None,
            },
        }
    }

    fn scene(&self) -> String {
        self.directory.path().join("scene.toml").display().to_string()
    }

    fn plan(&self, goals: &[Goal]) -> Result<Plan, ScenePlanError> {
        self.plan_within(goals, MAX_LENGTH_MM)
    }

    fn plan_within(&self, goals: &[Goal], max_length: f64) -> Result<Plan, ScenePlanError> {
        let (file, loaded) = (self.scene(), load(self.scene().as_ref()).unwrap());
        let margin = planning_margin_mm(&self.robot, &loaded);
        let through = SceneOptions {
            file: &file,
            loaded: &loaded,
            margin,
            effort: 1,
            deadline: None,
            first_only: false,
            max_length,
        };
        plan(&self.robot, &self.start, goals, &self.search, &through)
    }
}

fn pose(text: &str) -> Goal {
    Goal::Pose(parse_pose(text).unwrap())
}

fn position(x: f64, y: f64, z: f64) -> Goal {
    Goal::Position(Position::new(Vector3::new(x, y, z)).unwrap())
}

#[test]
fn plans_are_clear_of_the_scene_and_read_back() {
    let fixture = PlanFixture::new();
    let chains = [
        vec![position(0.0, 0.0, 800.0)],
        vec![pose("0,100,700,0,90")],
        vec![pose("200,0,300,0,90"), position(0.0, 0.0, 800.0)],
        vec![position(0.0, 200.0, 300.0), pose("0,0,900,0,45")],
    ];
    for goals in chains {
        let plan = fixture.plan(&goals).unwrap();
        let scene = plan.scene.clone().unwrap();
        assert!(scene.clearance >= 5.0, "{scene:?}");
        assert!(plan.warnings.iter().all(|warning| warning.code != crate::warning::SELF_COLLISION));
        let text = PlanFile::from(&plan).to_text();
        let (_, read) = plan_file::read(&text, "plan.json", None).unwrap();
        assert_eq!(read.scene.as_ref().map(|scene| scene.hash), Some(scene.hash));
        assert!((read.requirements.length - plan.requirements.length).abs() < 1e-6);
        // The clearance is proven again, so a plan that claims more is refused.
        let promises = PlanFile {
            scene: Some(SceneRefJson {
                file: scene.file.clone(),
                hash: format_hash(scene.hash),
                clearance_mm: scene.clearance + 0.01,
                margin_mm: Some(scene.margin),
            }),
            ..PlanFile::from(&plan)
        };
        let refused = plan_file::read(&promises.to_text(), "plan.json", None);
        assert!(matches!(refused, Err(PlanFileError::Scene(SceneCheckError::ClearanceOverstated { .. }))));
    }
}

#[test]
fn a_plan_is_refused_if_its_scene_is_changed_or_missing() {
    let fixture = PlanFixture::new();
    let text = PlanFile::from(&fixture.plan(&[position(0.0, 0.0, 800.0)]).unwrap()).to_text();
    fs::write(fixture.scene(), SCENE.replace("= 60", "= 61")).unwrap();
    let refused = plan_file::read(&text, "plan.json", None);
    assert!(matches!(refused, Err(PlanFileError::Scene(SceneCheckError::OtherScene { .. }))));
    fs::remove_file(fixture.scene()).unwrap();
    let refused = plan_file::read(&text, "plan.json", None);
    assert!(matches!(refused, Err(PlanFileError::Scene(SceneCheckError::Scene(_)))));
}

#[test]
fn a_plan_keeps_the_margin_with_which_it_was_made() {
    let fixture = PlanFixture::new();
    let plan = fixture.plan(&[position(0.0, 0.0, 800.0)]).unwrap();
    let written = PlanFile::from(&plan).scene.unwrap();
    assert_eq!(written.margin_mm, Some(5.0));
    for (margin_mm, is_kept) in [(Some(5.0), true), (Some(500.0), false), (None, true), (Some(-90.0), true)] {
        let scene = Some(SceneRefJson { margin_mm, ..written.clone() });
        let read = plan_file::read(&PlanFile { scene, ..PlanFile::from(&plan) }.to_text(), "plan.json", None);
        assert_eq!(read.is_ok(), is_kept, "{margin_mm:?}");
    }
    // The scene states no margin, so that of the robot is kept.
    fs::write(fixture.scene(), SCENE.replace("margin_mm = 5\n", "")).unwrap();
    let plan = fixture.plan(&[position(0.0, 0.0, 800.0)]).unwrap();
    let scene = plan.scene.unwrap();
    assert!(scene.margin == 4.82 && scene.clearance >= scene.margin, "{scene:?}");
    assert!(plan.warnings.iter().all(|warning| warning.code != NEAR_OBSTACLE));
}

#[test]
fn no_plan_exceeds_the_maximum_length() {
    let fixture = PlanFixture::new();
    let goals = [position(200.0, 0.0, 300.0), position(0.0, 0.0, 800.0)];
    let free = fixture.plan(&goals).unwrap().requirements.length;
    for max_length in [free + 1.0, 700.0, 300.0] {
        match fixture.plan_within(&goals, max_length) {
            Ok(plan) => assert!(plan.requirements.length <= max_length && max_length > free),
            // The second leg is 539 mm at least.
            Err(ScenePlanError::NoPath(NoPathError::TooFar { distance, left })) => {
                assert!(distance > left && max_length < free);
            }
            Err(other) => panic!("{max_length}: {other:?}"),
        }
    }
}

#[test]
fn the_proof_of_a_long_body_ends_at_its_deadline() {
    let fixture = PlanFixture::new();
    // Along 100 m beside a wall, the proof needs fifty million distances, all of the same size.
    let wall = "[[halfspace]]\npoint_mm = [0, 0, -900]\nnormal = [0, 0, 1]\n";
    fs::write(fixture.scene(), SCENE.to_owned() + wall).unwrap();
    let (file, loaded) = (fixture.scene(), load(fixture.scene().as_ref()).unwrap());
    let start = parse_pose("0,0,-500,0,0").unwrap();
    let within = |seconds: f64| {
        let deadline = Some(Instant::now() + Duration::from_secs_f64(seconds));
        let (margin, max_length) = (5.0, MAX_LENGTH_MM);
        let through =
            SceneOptions { file: &file, loaded: &loaded, margin, effort: 1, deadline, first_only: false, max_length };
        let far = [pose("100000,0,-500,0,0")];
        plan(&fixture.robot, &start, &far, &fixture.search, &through).unwrap().scene.unwrap().clearance
    };
    // A plan that had no time reports only the clearance that it was made for.
    assert_eq!(within(0.0), 5.0 + CLEARANCE_TOLERANCE_MM);
    assert!(within(0.0) < within(600.0));
}

#[test]
fn planning_ends_at_the_first_error_of_its_check() {
    let fixture = PlanFixture::new();
    let (file, loaded) = (fixture.scene(), load(fixture.scene().as_ref()).unwrap());
    let through = SceneOptions {
        file: &file,
        loaded: &loaded,
        margin: 5.0,
        effort: 1,
        deadline: None,
        first_only: false,
        max_length: MAX_LENGTH_MM,
    };
    let goals = [pose("300,0,300,0,0"), pose("900,0,300,0,0")];
    for allowed in 0..3 {
        let calls = Cell::new(0);
        let check = || {
            calls.set(calls.get() + 1);
            if calls.get() > allowed { Err(NoPathError::NotFound.into()) } else { Ok::<_, ScenePlanError>(()) }
        };
        let planned = plan_while(&fixture.robot, &fixture.start, &goals, &fixture.search, &through, &check);
        // It is called before each of the two legs.
        assert_eq!((planned.is_ok(), calls.get()), (allowed == 2, 2.min(allowed + 1)));
    }
}

#[test]
fn the_two_plane_planner_tries_only_two_plane_paths() {
    let fixture = PlanFixture::new();
    let fixture = PlanFixture { search: PlanOptions { planner: Planner::TwoPlane, ..fixture.search }, ..fixture };
    let refused = |goal| match fixture.plan(&[goal]) {
        Err(ScenePlanError::NoPath(no_path)) => no_path,
        other => panic!("{other:?}"),
    };
    assert_eq!(refused(pose("0,0,800,0,90")), NoPathError::TwoPlaneBlocked);
    assert!(matches!(refused(pose("0,0,310,0,90")), NoPathError::Goal { .. }));
    assert_eq!(NoPathError::TwoPlaneBlocked.code(), "none-at-resolution");
    assert!(fixture.plan(&[pose("300,0,300,0,0")]).is_ok());
}

#[test]
fn unreachable_goals_are_refused_with_the_reason() {
    let fixture = PlanFixture::new();
    let refused = |goal| match fixture.plan(&[goal]) {
        Err(ScenePlanError::NoPath(no_path)) => no_path,
        other => panic!("{other:?}"),
    };
    assert!(matches!(refused(position(0.0, 0.0, 310.0)), NoPathError::Goal { .. }));
    assert_eq!(refused(position(0.0, 0.0, 310.0)).code(), "none-at-resolution");
    assert_eq!(NoPathError::NotFound.code(), "not-found-in-time");
    let box_round_the_goal = (0..6).map(|side| {
        let mut centre = [0.0, 0.0, 2000.0];
        centre[side / 2] += if side % 2 == 0 { 100.0 } else { -100.0 };
        let mut size = [210.0; 3];
        size[side / 2] = 10.0;
        format!("[[box]]\ncenter_mm = {centre:?}\nsize_mm = {size:?}\n")
    });
    fs::write(fixture.scene(), SCENE.to_owned() + &box_round_the_goal.collect::<String>()).unwrap();
    assert!(matches!(refused(position(0.0, 0.0, 2000.0)), NoPathError::Separated { .. }));
}
