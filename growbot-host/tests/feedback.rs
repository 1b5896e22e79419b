//! Tests of growths with feedback on simulated robots that lay layers imperfectly. The growths must reach their goals
//! nevertheless, also over bad lines and after interruptions.

use std::cell::{Cell, RefCell};
use std::fs;
use std::rc::Rc;
use std::time::Duration;

use growbot_client::client::Client;
use growbot_client::growth::{CommandQueue, GrowthError, GrowthOptions, grow_job, resume_job};
use growbot_client::port::{Port, PortError};
use growbot_client::stop_signal::Permit;
use growbot_core::link::message::{Empty, EnergizingRequest, HostSilencePolicy, ResetCause, State};
use growbot_core::plan::Planner;
use growbot_core::pose::Pose;
use growbot_core::robot::Robot;
use growbot_core::simulation::{Disturbance, ErrorModel};
use growbot_core::tracking::SensorNoise;
use growbot_plan::feedback::Feedback;
use growbot_plan::growth_report::{GrowthReport, MeasuredBy, Outcome};
use growbot_plan::job::{Command, Job, JobEvent};
use growbot_plan::plan::{Plan, PlanOptions};
use growbot_plan::robot_file;
use growbot_plan::run_log::{RecordedRun, RunLog};
use growbot_sim::port::sim::Sim;
use running::growbot;
use serde_json::Value;

use crate::running;

/// Runs `growbot grow` to a nearby pose with these additional options, and returns the result in JSON.
fn grown(more: &[&str]) -> Value {
    let ran = growbot(&[&["grow", "--to", "100,50,300,0,45", "--json"], more].concat());
    assert_eq!(ran.code, Some(0), "{more:?}: {}", ran.err);
    serde_json::from_str(&ran.out).unwrap()
}

fn error(result: &Value) -> f64 {
    result["normalized_position_error"].as_f64().unwrap()
}

#[test]
fn biased_deposition_is_learned() {
    for bias in ["5", "-5"] {
        let open = grown(&["--bias", bias]);
        let closed = grown(&["--bias", bias, "--feedback"]);
        assert!(error(&open) > 0.04 && error(&closed) < 0.002, "{} {}", error(&open), error(&closed));
        let feedback = &closed["feedback"];
        assert!(feedback["amendments"].as_u64().unwrap() > 300, "{feedback}");
        assert!((feedback["growth_bias_percent"].as_f64().unwrap() - bias.parse::<f64>().unwrap()).abs() < 0.5);
        assert!(feedback["estimate_error_mm"].as_f64().unwrap() < 0.5, "{feedback}");
        assert_eq!((&closed["measured_by"], &open["feedback"]), (&"tip".into(), &Value::Null));
    }
}

#[test]
fn noise_is_corrected_and_the_same_seed_gives_the_same_run() {
    let noisy = ["--noise", "10", "--odometry-noise", "1", "--direction-noise", "0.5", "--seed"];
    let (mut open, mut closed) = (0.0, 0.0);
    for seed in ["1", "2", "3", "4"] {
        let args = [&noisy[..], &[seed]].concat();
        open += error(&grown(&args)) / 4.0;
        let result = grown(&[&args[..], &["--feedback"]].concat());
        assert_eq!(result["seed"].as_u64(), seed.parse().ok());
        closed += error(&result) / 4.0;
    }
    // The heading is not observed, and a near goal leaves little length to correct it.
    assert!(closed < 0.0015 && closed < 0.6 * open, "{closed} {open}");
    let args = [&noisy[..], &["9", "--feedback"]].concat();
    assert_eq!(grown(&args), grown(&args));
}

#[test]
fn feedback_follows_a_straight_path_and_reports_the_greatest_distance_from_it() {
    let directory = tempfile::tempdir().unwrap();
    let log = directory.path().join("run.jsonl").to_str().unwrap().to_owned();
    for seed in ["1", "2", "3"] {
        let straight = ["grow", "--to", "0,0,600,0,90", "--noise", "10", "--seed", seed, "--json"];
        let ran = growbot(&[&straight[..], &["--feedback", "--log", &log, "--overwrite"]].concat());
        assert_eq!(ran.code, Some(0), "{}", ran.err);
        let result: Value = serde_json::from_str(&ran.out).unwrap();
        let deviation = &result["plan_deviation"];
        // The tip overshoots by less than a layer.
        assert!(deviation["max_mm"].as_f64().unwrap() < 0.5, "seed {seed}: {result}");
        assert_eq!(deviation["limit_mm"], 3.0);
        assert!(result["warnings"].is_null() && !ran.err.contains("far-from-plan"), "{result}");
        let text = fs::read_to_string(&log).unwrap();
        let end: Value = serde_json::from_str(text.lines().last().unwrap()).unwrap();
        assert_eq!((&end["event"], &end["result"]["plan_deviation"]), (&"end".into(), deviation));
    }
    let page = directory.path().join("page.html").to_str().unwrap().to_owned();
    assert_eq!(growbot(&["view", &log, "-o", &page]).code, Some(0));
    assert!(fs::read_to_string(&page).unwrap().contains("Off the plan"));
}

#[test]
fn a_body_far_from_its_plan_gives_a_warning() {
    let ran = growbot(&["grow", "--to", "0,0,300,0,90", "--bias", "5", "--json"]);
    let result: Value = serde_json::from_str(&ran.out).unwrap();
    let warning = &result["warnings"][0];
    assert_eq!((&warning["code"], &warning["limit"]), (&"far-from-plan".into(), &1.6.into()));
    assert!((warning["value"].as_f64().unwrap() - 15.0).abs() < 0.5, "{result}");
    assert!(ran.err.contains("far-from-plan") && ran.err.contains("1.6 mm"), "{}", ran.err);
}

#[test]
fn a_bad_link_changes_little() {
    let result = grown(&["--noise", "10", "--feedback", "--link-fault", "drop=2%,flip=1e-4"]);
    assert_eq!(result["outcome"], "done");
    assert!(error(&result) < 0.002, "{result}");
}

#[test]
fn feedback_without_disturbance_changes_almost_nothing() {
    assert!(error(&grown(&["--feedback"])) < 0.001);
}

#[test]
fn a_growth_with_feedback_is_replayed_from_its_log() {
    let directory = tempfile::tempdir().unwrap();
    let log = directory.path().join("run.jsonl").to_str().unwrap().to_owned();
    let result = grown(&["--noise", "5", "--feedback", "--log", &log]);
    let replayed = growbot(&["replay", &log, "--json"]);
    assert_eq!(replayed.code, Some(0), "{}", replayed.err);
    let replayed: Value = serde_json::from_str(&replayed.out).unwrap();
    assert_eq!(replayed["as_built_hash"], result["as_built_hash"]);
    assert_eq!(replayed["layers"], result["layers"]);
    assert_eq!(replayed["outcome"], "done");
    for same in ["amendments", "estimate", "estimated_position_error_mm", "position_sd_mm", "growth_bias_percent"] {
        assert_eq!(replayed["feedback"][same], result["feedback"][same], "{same}");
    }
    let told = growbot(&["replay", &log]);
    assert!(told.out.contains("from the steps\n") && told.out.contains("estimate  "), "{}", told.out);

    // A log of a robot without a robot file is replayed nevertheless. A robot that `--robot` names must exist.
    let elsewhere = fs::read_to_string(&log).unwrap().replace("\"growbot-a\"", "\"my-robot\"");
    fs::write(&log, elsewhere).unwrap();
    let without = growbot(&["replay", &log]);
    assert_eq!((without.code, without.err.lines().count()), (Some(0), 1), "{}", without.err);
    assert!(without.err.contains("my-robot") && without.out.contains("as built"), "{}{}", without.err, without.out);
    assert!(!without.out.contains("estimate  "), "{}", without.out);
    assert_eq!(growbot(&["replay", &log, "--robot", "other.toml"]).code, Some(2));
}

#[test]
fn invalid_requests_are_refused_before_the_job() {
    for (args, part) in [
        (vec!["--noise", "95"], "the value is 95 percent: give 0 to 90"),
        (
            vec!["--bias", "2", "--port", "tcp:localhost:1"],
            "the robot is not simulated: remove the noise and bias options",
        ),
        (vec!["--odometry-noise", "2", "--port", "tcp:localhost:1"], "add --feedback"),
        (vec!["--robot", "growbot-a2", "--feedback"], "robot growbot-a2 has no sensor that measures layers"),
    ] {
        let ran = growbot(&[&["grow", "--to", "0,0,30,0,90"][..], &args].concat());
        assert_eq!(ran.code, Some(2), "{args:?}: {}", ran.err);
        assert!(ran.err.contains(part) && ran.out.is_empty(), "{args:?}: {}", ran.err);
    }
}

/// The line to a simulated robot, which is the first field. The line is cut while the second field is true.
struct Line(Rc<RefCell<Sim>>, Rc<Cell<bool>>);

impl Line {
    fn is_whole(&self) -> Result<(), PortError> {
        if self.1.get() { Err(PortError::Lost("sim".to_string(), std::io::Error::other("cut"))) } else { Ok(()) }
    }
}

impl Port for Line {
    fn send(&mut self, bytes: &[u8]) -> Result<(), PortError> {
        self.is_whole()?;
        self.0.send(bytes)
    }

    fn receive(&mut self, buffer: &mut [u8], timeout: Duration) -> Result<usize, PortError> {
        self.is_whole()?;
        self.0.receive(buffer, timeout)
    }

    fn now(&self) -> Duration {
        self.0.now()
    }
}

/// A simulated robot that lays layers imperfectly, with a plan, and the directory of its run log.
struct Try {
    robot: Robot,
    plan: Plan,
    folder: tempfile::TempDir,
    sim: Rc<RefCell<Sim>>,
}

const NOISE: SensorNoise = SensorNoise { odometry: 0.01, direction: 0.005 };

impl Try {
    fn new() -> Self {
        let robot = robot_file::load("growbot-a".as_ref()).unwrap();
        let pose = |numbers| Pose::from_degrees(numbers).unwrap();
        let search =
            PlanOptions { radius: 100.0, planner: Planner::Shortest, avoid_self_collision: false, existing: None };
        let (start, goal) = (pose([0.0, 0.0, 0.0, 0.0, 90.0]), pose([40.0, 30.0, 120.0, 30.0, 45.0]));
        let plan = Plan::through_waypoints(&robot, &start, &[], &goal, &search).unwrap();
        let mut sim = Sim::new(robot.clone());
        let disturbance = Disturbance { growth_bias: -0.08, growth_noise: 0.1, ..Disturbance::default() };
        sim.simulated_tip().disturb(&ErrorModel { disturbance, noise: NOISE, seed: 3 });
        let folder = tempfile::tempdir().unwrap();
        Self { robot, plan, folder, sim: Rc::new(RefCell::new(sim)) }
    }

    fn job(&self) -> Job<'_> {
        Job::of_plan(&self.robot, &self.plan)
    }

    /// Grows the plan with feedback, and calls `at` after the layer of index 60. `at` can cut the line and give
    /// commands.
    fn grow(&self, mut at: impl FnMut(&Cell<bool>, &CommandQueue)) -> Result<GrowthReport, GrowthError> {
        let job = self.job();
        let mut log = RunLog::create(&self.folder.path().join("run"), &self.plan, &job, Some(NOISE), "sim").unwrap();
        let feedback = Feedback::new(&self.robot, &self.plan.start, &self.plan.path, &self.plan.legs, NOISE);
        let cut = Rc::new(Cell::new(false));
        let mut client = Client::new(Box::new(Line(Rc::clone(&self.sim), Rc::clone(&cut))), "sim");
        let orders = CommandQueue::default();
        let manner = GrowthOptions { feedback: Some(feedback), ..HostSilencePolicy::Continue.into() };
        let grown = grow_job(&mut client, &job, manner, &orders, &mut |event| {
            log.record(event).unwrap();
            if matches!(event, JobEvent::Laid { index: 60, .. }) {
                at(&cut, &orders);
            }
        });
        client.drop_without_goodbye();
        grown
    }

    /// Resumes the growth from its run log.
    fn resume(&self) -> GrowthReport {
        let mut client = Client::new(Box::new(Rc::clone(&self.sim)), "sim");
        let hello = client.open_session().unwrap();
        if hello.status.state == State::Fault {
            client
                .energize("to clear the fault", &EnergizingRequest::ClearFault(Empty {}), &Permit::standalone())
                .unwrap();
        }
        let mut record = RecordedRun::open(&self.folder.path().join("run")).unwrap();
        record.sync_to_board(hello.status.plan_id);
        let mut job = self.job();
        (job.plan_id, job.layers) = (record.plan_id, record.layers.clone());
        let plan = record.plan(&self.robot).unwrap();
        let feedback = record.feedback(&job, &plan, None);
        assert!(feedback.is_some());
        let (orders, known) = (CommandQueue::default(), record.as_built.clone());
        let manner = GrowthOptions { feedback, ..HostSilencePolicy::Pause.into() };
        resume_job(&mut client, &job, known, manner, &orders, &mut |_| {}).unwrap()
    }

    /// Returns the true distance of the tip from the goal, divided by the length of the plan.
    fn miss(&self) -> f64 {
        let there = self.sim.borrow_mut().simulated_tip().base_from_tip();
        (there.translation.vector - self.plan.goal.position()).norm() / self.plan.requirements.length
    }
}

#[test]
fn a_stopped_growth_resumes_with_feedback() {
    let tried = Try::new();
    let stopped = tried.grow(|_, orders| orders.push(Command::Stop)).unwrap();
    assert_eq!(stopped.outcome, Outcome::Stopped);
    let done = tried.resume();
    assert_eq!((done.outcome, done.measured_by), (Outcome::Done, MeasuredBy::Estimate));
    // Without feedback it would be 8 %. The encoder measures the interrupted layer and its repetition.
    assert!(tried.miss() < 0.006, "{}", tried.miss());
    assert!(done.feedback.is_some_and(|fed_back| (fed_back.estimate.systematic_errors.growth + 0.08).abs() < 0.02));
}

#[test]
fn a_growth_resumes_with_feedback_after_a_power_loss() {
    let tried = Try::new();
    let lost = tried.grow(|_, _| tried.sim.borrow_mut().reset(ResetCause::PowerOn)).unwrap();
    assert_eq!(lost.outcome, Outcome::Interrupted);
    let done = tried.resume();
    assert_eq!(done.outcome, Outcome::Done);
    assert!(tried.miss() < 0.012, "{}", tried.miss());
}

#[test]
fn a_board_that_grew_without_its_host_is_amended_again() {
    let tried = Try::new();
    tried.grow(|cut, _| cut.set(true)).unwrap_err();
    // The board lays five more layers without reporting them to a host.
    tried.sim.borrow_mut().run_for(Duration::from_secs(90));
    assert_eq!(tried.sim.borrow_mut().state(), State::Growing);
    let done = tried.resume();
    assert_eq!(done.outcome, Outcome::Done);
    assert!(done.unknown_layers() == 0 && done.as_built.len() > 150, "{}", done.as_built.len());
    assert!(tried.miss() < 0.006, "{}", tried.miss());
}
