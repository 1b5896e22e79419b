//! Dialogues with simulated robots: one without defects, and one for each possible defect.

use std::cell::RefCell;
use std::rc::Rc;
use std::sync::Arc;
use std::time::Duration;

use growbot_client::client::Client;
use growbot_client::growth::CommandQueue;
use growbot_core::link::message::{MaintenanceTask, State};
use growbot_core::robot::{Robot, RobotDescription};
use growbot_plan::robot_file;
use growbot_plan::robot_kind::RobotKind;
use growbot_sim::port::sim::Sim;
use growbot_sim::tip::TipFault;
use growbot_sim::tip::manual_action::ManualAction;

use super::*;

/// Answers of a person whose robot has no defects.
const GOOD: [&str; 15] = ["", "", "", "", "", "", "", "yes", "", "50", "", "", "yes", "yes", ""];

/// A simulated robot, with a session of `growbot doctor` and its report.
struct Bench {
    sim: Rc<RefCell<Sim>>,
    session: DoctorSession,
    report: CommissioningReport,
}

impl Bench {
    fn new(answers: &[&str]) -> Self {
        Self::of(robot_file::load(robot_file::DEFAULT.as_ref()).unwrap(), answers)
    }

    fn of(robot: Robot, answers: &[&str]) -> Self {
        let sim = Rc::new(RefCell::new(Sim::new(robot.clone())));
        let mut client = Client::new(Box::new(Rc::clone(&sim)), "sim");
        client.open_session().unwrap();
        let hands = sim.borrow().tip_handle();
        let mut report = CommissioningReport::default();
        assert!(report.begin(&robot, "sim", RobotKind::Simulated).is_ok());
        let session = DoctorSession {
            client,
            robot,
            simulated_operator: Some(hands),
            orders: Default::default(),
            answers: OperatorInput::of(answers),
            recorded_answers: Vec::new(),
            kind: RobotKind::Simulated,
            port: "sim".to_owned(),
        };
        Self { sim, session, report }
    }

    /// Removes the simulation that does the requested actions.
    fn without_hands(mut self) -> Self {
        self.session.simulated_operator = None;
        self
    }

    fn with(self, fault: TipFault) -> Self {
        self.sim.borrow_mut().inject(fault);
        self
    }

    fn run(&mut self) -> Result<(), Failure> {
        let done =
            commission(&mut self.session, &mut self.report, RunOptions { file: None, again: false, prints: false });
        assert!(self.session.switch_off().is_ok());
        let mut sim = self.sim.borrow_mut();
        assert!(!matches!(sim.state(), State::Maintenance | State::Heating), "{:?}", sim.state());
        assert!(!sim.simulated_tip().heater_is_on());
        done
    }

    /// Returns the outcome and the finding of a step.
    fn step(&self, name: &str) -> (StepOutcome, String) {
        let json = serde_json::to_value(&self.report).unwrap();
        let steps = json["steps"].as_array().unwrap();
        let done = steps.iter().find(|done| done["step"] == name).unwrap_or_else(|| panic!("no {name} in {json}"));
        let text = |key: &str| done[key].as_str().unwrap_or_default().to_owned();
        (serde_json::from_value(done["outcome"].clone()).unwrap(), format!("{}; {}", text("found"), text("remedy")))
    }

    fn has(&self, name: &str) -> bool {
        serde_json::to_value(&self.report).unwrap()["steps"].as_array().unwrap().iter().any(|done| done["step"] == name)
    }
}

/// Returns the default robot with a change.
fn robot_with(change: impl FnOnce(&mut RobotDescription)) -> Robot {
    let mut description = robot_file::load(robot_file::DEFAULT.as_ref()).unwrap().description().clone();
    change(&mut description);
    Robot::new(description).unwrap()
}

/// Runs the commissioning of a bench, and checks that this step fails and that its finding contains these words.
fn fails(mut bench: Bench, step: &str, words: &[&str]) -> Bench {
    let _ = bench.run();
    let (outcome, text) = bench.step(step);
    assert_eq!(outcome, StepOutcome::Failed, "{step}: {text}");
    for word in words {
        assert!(text.contains(word), "{step}: {text:?} has no {word:?}");
    }
    bench
}

#[test]
fn a_good_robot_passes_every_step() {
    let mut bench = Bench::new(&GOOD);
    assert!(bench.run().is_ok());
    for step in &STEPS {
        let (outcome, text) = bench.step(step.name);
        assert_eq!(outcome, StepOutcome::Passed, "{}: {text}", step.name);
    }
    let summary = Summary::new(&bench.report, &STEPS.map(|step| step.name));
    assert!(summary.is_good());
    let answers: usize =
        serde_json::to_value(&bench.report).unwrap()["steps"].as_array().unwrap().iter().map(answers_of).sum();
    assert_eq!(answers, GOOD.len());
}

fn answers_of(step: &serde_json::Value) -> usize {
    step["answers"].as_array().map_or(0, Vec::len)
}

#[test]
fn steps_can_be_skipped() {
    let mut bench = Bench::new(&["skip"; 9]);
    assert!(bench.run().is_ok());
    assert!(Summary::new(&bench.report, &STEPS.map(|step| step.name)).is_good());
    assert_eq!(bench.step("nozzle").0, StepOutcome::Skipped);
    assert!(bench.sim.borrow_mut().simulated_tip().nozzle_c() < 30.0);
}

#[test]
fn a_broken_sensor_fails_its_step() {
    let skips = ["skip"; 9];
    let answers = ["", "skip", "skip", "skip", "skip", "skip", "skip", "skip", "skip"];
    fails(Bench::new(&answers).with(TipFault::IndexStuck), "index", &["only on its mark", "head.index_low_on_mark"]);
    fails(Bench::new(&answers).with(TipFault::IndexDead), "index", &["only off its mark"]);
    fails(Bench::new(&skips).with(TipFault::OrientationSilent), "orientation", &["no reading", "SDA"]);
    fails(Bench::new(&skips).with(TipFault::SupplyLow { volts: 9.0 }), "supply", &["9.0 V", "10.2", "14", "voltmeter"]);
    let switch = ["skip", "", "", "skip", "skip", "skip", "skip", "skip", "skip", "skip"];
    fails(Bench::new(&switch).without_hands(), "filament", &["\"filament\" instead of \"no filament\"", "active_low"]);
}

#[test]
fn an_open_thermistor_aborts_before_any_motion() {
    let bench = fails(Bench::new(&GOOD).with(TipFault::ThermistorOpen), "temperature", &["no reading", "thermistor"]);
    assert!(!bench.has("index"));
}

#[test]
fn no_motion_without_a_working_emergency_stop() {
    let answers = ["skip", "skip", "", "skip", "", "yes"];
    let bench = fails(Bench::new(&answers).without_hands(), "emergency-stop", &["\"released\" instead of \"pressed\""]);
    assert!(!bench.has("head"));
}

#[test]
fn a_head_that_turns_the_wrong_way_or_not_at_all_is_detected() {
    let answers = ["skip", "skip", "skip", "skip", "", "no", "skip", "skip", "skip", "skip"];
    fails(Bench::new(&answers), "head", &["wrong way", "head.direction_high_is_positive"]);
    let answers = ["skip", "skip", "skip", "skip", "", "skip", "skip", "skip", "skip"];
    let bench = fails(Bench::new(&answers).with(TipFault::HeadBlocked), "head", &["index-not-found", "motor"]);
    assert_eq!(bench.sim.borrow().fault(), None, "cleared for the next step");
}

/// From any starting position, the head is at zero before it is commanded to turn.
#[test]
fn slow_homing_is_awaited() {
    let robot = robot_with(|description| {
        description.head.index_angle_deg = 8.0;
        description.head.homing_turns_per_s = 0.02;
    });
    for sixty_fourths in (0..64).step_by(3) {
        let mut bench = Bench::of(robot.clone(), &["", "yes"]);
        bench.session.act(ManualAction::TurnHead(sixty_fourths));
        let Ok(found) = motors::head(&mut bench.session) else { panic!("it was broken off") };
        assert_eq!(found.outcome, StepOutcome::Passed, "{sixty_fourths}: {found:?}");
    }
}

#[test]
fn a_feed_error_gives_the_corrected_steps() {
    let answers = ["skip", "skip", "skip", "skip", "skip", "", "45", "skip", "skip", "skip"];
    let bench = Bench::new(&answers);
    let steps = bench.session.robot.description().feed.steps_per_mm;
    let right = format!("feed.steps_per_mm = {:.2}", steps * 50.0 / 45.0);
    fails(bench, "feed", &["45 mm instead of 50 mm", "-10.0 %", "2 % is allowed", &right]);
}

#[test]
fn a_connected_heater_blocks_the_lamp_and_nozzle_steps() {
    let answers = ["skip", "skip", "skip", "skip", "skip", "skip", "", "", "yes", "yes", ""];
    let bench = fails(Bench::new(&answers).without_hands(), "no-heater", &["got warmer", "cut the power"]);
    assert!(!bench.has("lamp") && !bench.has("nozzle"));
}

#[test]
fn a_lamp_that_stays_dark_or_lit_blocks_the_nozzle_step() {
    let answers = |lit, dark| ["skip", "skip", "skip", "skip", "skip", "skip", "skip", "", lit, dark, ""];
    let bench = fails(Bench::new(&answers("no", "")), "lamp", &["stayed dark", "both switches"]);
    assert!(!bench.has("nozzle"));
    let bench = fails(Bench::new(&answers("yes", "no")), "lamp", &["after the emergency stop", "cut the power"]);
    assert!(!bench.has("nozzle"));
}

#[test]
fn a_lamp_switched_off_by_the_board_fails_the_step() {
    for answer in ["yes", "no"] {
        let mut bench = Bench::new(&[answer, "yes"]).with(TipFault::HeaterOpen);
        assert!(matches!(bench.session.maintain(MaintenanceTask::Preheat { target_centi_c: 6000 }), Ok(None)));
        // The person is slow.
        let off = bench.session.wait_until(Duration::from_secs(600), None, |seen| seen.status.fault.is_some());
        assert!(matches!(off, Ok(Some(_))));
        let Ok(found) = heating::check_lamp(&mut bench.session) else { panic!("it was broken off") };
        assert_eq!(found.outcome, StepOutcome::Failed, "{found:?}");
        assert!(found.found.contains("before you answered, because of heating-too-slow"), "{found:?}");
        assert!(found.remedy.is_some_and(|remedy| remedy.contains("answer sooner")));
        assert!(!bench.sim.borrow_mut().simulated_tip().heater_is_on());
    }
}

#[test]
fn welded_switches_are_detected_in_the_nozzle_step() {
    let mut answers = ["skip"; 9];
    answers[8] = "";
    let bench = Bench::new(&answers).with(TipFault::SecondSwitchClosed);
    fails(bench, "nozzle", &["heater-switch-welded"]);
    fails(Bench::new(&answers).with(TipFault::PowerStageOn), "nozzle", &["heater-stuck-on"]);
    fails(Bench::new(&answers).with(TipFault::HeaterOpen), "nozzle", &["heating-too-slow"]);
}

#[test]
fn an_unconfigured_board_is_configured_first() {
    let bench = Bench::new(&GOOD);
    bench.sim.borrow_mut().restart_without_description();
    let bench = fails(bench, "description", &["no robot description", "growbot configure FILE --port sim"]);
    assert!(!bench.has("temperature"));
}

#[test]
fn steps_after_the_end_of_input_are_not_done() {
    let mut bench = Bench::new(&["", ""]);
    let Err(failure) = bench.run() else { panic!("it has not ended") };
    assert!(!failure.is_bad_input() && failure.message().contains("give a line for each"), "{}", failure.message());
    assert_eq!((bench.step("index").0, bench.step("filament").0), (StepOutcome::Passed, StepOutcome::NotDone));
    assert!(!Summary::new(&bench.report, &STEPS.map(|step| step.name)).is_good());
}

#[test]
fn an_invalid_answer_in_a_pipe_aborts_without_heating() {
    let mut bench = Bench::new(&["skip", "skip", "skip", "skip", "skip", "skip", "skip", "", "perhaps"]);
    let Err(failure) = bench.run() else { panic!("it has not ended") };
    assert!(failure.is_bad_input() && failure.message().contains("\"perhaps\""), "{}", failure.message());
    assert_eq!(bench.sim.borrow().state(), State::EmergencyStop, "the lamp was on");
}

#[test]
fn an_interrupt_while_heating_switches_the_nozzle_off() {
    let mut bench = Bench::new(&[]);
    let orders = Arc::new(CommandQueue::default());
    bench.session.orders = Arc::clone(&orders);
    assert!(matches!(bench.session.maintain(MaintenanceTask::Preheat { target_centi_c: 6000 }), Ok(None)));
    let sim = Rc::clone(&bench.sim);
    let watched = bench.session.wait_until(Duration::from_secs(300), None, |seen| {
        assert_eq!(seen.status.state, State::Maintenance);
        if sim.borrow_mut().simulated_tip().heater_is_on() {
            orders.interrupt();
        }
        false
    });
    let Err(failure) = watched else { panic!("it was not interrupted") };
    assert_eq!(failure.message(), "stopped: heater and steppers of the simulated robot are off");
    assert_eq!(bench.sim.borrow().state(), State::Stopped);
    assert!(!bench.sim.borrow_mut().simulated_tip().heater_is_on());
}

#[test]
fn an_interrupt_at_a_question_aborts() {
    let mut bench = Bench::new(&GOOD);
    bench.session.orders.interrupt();
    let Err(failure) = bench.run() else { panic!("it was not interrupted") };
    assert!(failure.message().starts_with("stopped"), "{}", failure.message());
}

#[test]
fn a_report_is_continued_where_it_ended() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("doctor.json");
    let mut bench = Bench::new(&GOOD[..7]);
    assert!(bench.run().is_err());
    assert!(bench.report.write(&file).is_ok());
    let Ok(mut report) = CommissioningReport::open(&file) else { panic!("the report is not read") };
    assert_eq!(report, bench.report);
    let robot = |name: &str| robot_file::load(name.as_ref()).unwrap();
    assert!(report.begin(&robot("growbot-b"), "sim", RobotKind::Simulated).is_err());
    assert!(report.begin(&robot("growbot-a"), "sim", RobotKind::Real).is_err());
    assert!(report.begin(&robot("growbot-a"), "/dev/ttyACM0", RobotKind::Simulated).is_ok());
    let mut rest = Bench::new(&GOOD[6..]);
    rest.report = report;
    assert!(rest.run().is_ok());
    assert!(Summary::new(&rest.report, &STEPS.map(|step| step.name)).is_good());
}

#[test]
fn a_changed_description_repeats_the_gating_steps() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("doctor.json");
    let mut bench = Bench::new(&GOOD);
    assert!(bench.run().is_ok() && bench.report.write(&file).is_ok());
    let hash = format!("{:016x}", bench.session.robot.hash());
    let steps = serde_json::to_value(&bench.report).unwrap()["steps"].as_array().unwrap().clone();
    assert!(steps.iter().all(|step| step["description"] == *hash));
    assert_eq!(serde_json::to_value(&bench.report).unwrap()["description"], *hash);

    let edited = robot_with(|description| description.heater.power_w += 1.0);
    let gates = STEPS.iter().filter(|step| step.asks && step.gates).count();
    // The emergency stop is tried, and the steps after it are left for another time.
    let mut again = Bench::of(edited.clone(), &["", "", "quit"]);
    again.report = CommissioningReport::open(&file).unwrap_or_default();
    assert!(again.report.begin(&edited, "sim", RobotKind::Simulated).is_ok());
    assert!(again.run().is_err());
    let outcomes = ["emergency-stop", "head", "no-heater", "lamp", "nozzle"].map(|name| again.step(name).0);
    let (passed, not_done) = (StepOutcome::Passed, StepOutcome::NotDone);
    assert_eq!((gates, outcomes), (4, [passed, passed, not_done, not_done, not_done]));
    assert!(again.step("nozzle").1.contains(&format!("another robot description ({hash}")));
    assert!(!Summary::new(&again.report, &STEPS.map(|step| step.name)).is_good());

    let mut rest = Bench::of(edited, &["", "", "yes", "yes", ""]);
    rest.report = again.report;
    assert!(rest.run().is_ok());
    assert!(Summary::new(&rest.report, &STEPS.map(|step| step.name)).is_good());
}

#[test]
fn invalid_reports_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("doctor.json");
    for text in [
        "",
        "{}",
        "[1,2",
        "{\"format\":\"growbot-doctor/2\",\"robot\":\"a\",\"port\":\"\",\"simulated\":false,\"steps\":[]}",
    ] {
        std::fs::write(&file, text).unwrap();
        let Err(error) = CommissioningReport::open(&file) else { panic!("it was not refused") };
        let failure = Failure::from(error);
        let message = failure.message();
        assert!(failure.is_bad_input() && message.contains("as a report of growbot doctor: "), "{message}");
        assert!(message.ends_with("; name another file with -o"), "{message}");
    }
}
