//! Tests of bodies that begin at the tip of another body.

use growbot_core::layer::grow;
use growbot_core::layer_bytes::decode;
use growbot_core::plan::goal_error;
use growbot_plan::job::Job;
use growbot_plan::plan::Plan;
use growbot_plan::plan_file::{LoadedPlan, read_in_scene};
use growbot_plan::run_log::RecordedRun;
use serde_json::{Value, json};

use crate::lab::Lab;
use crate::running::growbot;

/// Grows a body on a simulated robot, and returns its run log.
fn grow_logged(directory: &std::path::Path, name: &str, of: &[&str]) -> String {
    let log = directory.join(name).display().to_string();
    let ran = growbot(&[&["grow", "--log", &log, "--quiet"], of].concat());
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    log
}

/// Plans on from the tip of a run log, and returns the file of the plan and the plan.
fn plan_on(directory: &std::path::Path, log: &str, goal: &str) -> (String, Plan) {
    let file = directory.join(format!("{}.json", goal.replace(',', "_"))).display().to_string();
    let ran = growbot(&["plan", "--continue", log, "--to", goal, "-o", &file]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    let text = std::fs::read_to_string(&file).unwrap();
    let LoadedPlan { plan, .. } = read_in_scene(&text, "the plan", None, None).unwrap();
    (file, plan)
}

/// The layers of all bodies, one after the other from the start of the first, end at the goal of the last. They would
/// not, if the plan began without the roll of the tip.
#[test]
fn a_body_continues_in_the_frame_of_the_tip() {
    let directory = tempfile::tempdir().unwrap();
    // Two bends in different planes turn the frame of the tip about its direction.
    let log = grow_logged(directory.path(), "first.jsonl", &["--via", "60,30,150", "--to", "100,180,300,80,20"]);
    let first = RecordedRun::open(log.as_ref()).unwrap();
    let (file, second) = plan_on(directory.path(), &log, "100,400,420,100,60");
    assert!(second.start.roll().abs() > 0.1, "{:?}", second.start);
    assert_eq!(second.existing_layers, first.commanded().collect::<Vec<_>>());
    let log = grow_logged(directory.path(), "second.jsonl", &[&file]);
    let replayed = growbot(&["replay", &log, "--json"]);
    let replayed: Value = serde_json::from_str(&replayed.out).unwrap();
    assert!(replayed["position_error_mm"].as_f64().unwrap() < 0.1, "{replayed}");
    // Each planner begins in that frame, around obstacles and with feedback, too.
    let scene = directory.path().join("room.toml").display().to_string();
    std::fs::write(&scene, "format = \"growbot-scene/1\"\n[[ball]]\ncenter_mm = [100, 450, 560]\nradius_mm = 30\n")
        .unwrap();
    for more in [&["--planner", "two-plane"][..], &["--scene", &scene], &["--via", "60,480,560"]] {
        let given = ["plan", "--continue", &log, "--to", "100,500,700,100,60", "-o", &file];
        let ran = growbot(&[&given, more].concat());
        assert_eq!(ran.code, Some(0), "{more:?}: {}", ran.err);
        let grow = ["grow", &file, "--json", "--feedback", "--bias", "2"];
        let grown = growbot(&[&grow[..], if more[0] == "--scene" { more } else { &[] }].concat());
        let grown: Value = serde_json::from_str(&grown.out).unwrap_or_else(|_| panic!("{more:?}: {}", grown.err));
        assert!(grown["position_error_mm"].as_f64().unwrap() < 2.0, "{more:?}: {grown}");
    }
    let (_, third) = plan_on(directory.path(), &log, "100,500,700,100,60");
    assert_eq!(third.existing_layers.len(), second.existing_layers.len() + second.requirements.layers);
    let robot = first.own_robot().unwrap();
    let (start, _) = first.start_and_goal().unwrap();
    let rest = Job::of_plan(&robot, &third).layers;
    let layers = third.existing_layers.iter().chain(&rest).map(decode);
    // Each layer is rounded to the steps of the motors.
    let miss = goal_error(&grow(&start.frame(), layers), &third.goal);
    assert!(miss.distance < 0.2 && miss.angle < 2e-3, "{miss:?}");
}

#[test]
fn a_path_that_runs_into_the_existing_body_has_a_warning_in_every_form() {
    let directory = tempfile::tempdir().unwrap();
    let log = grow_logged(directory.path(), "rod.jsonl", &["--to", "0,0,500,0,90"]);
    let through = "100,10,130,0,30";
    let (file, plan) = plan_on(directory.path(), &log, through);
    let codes: Vec<&str> = plan.warnings.iter().map(|warning| warning.code.as_str()).collect();
    assert_eq!(codes, ["continues-body", "self-collision"]);
    assert!(plan.warnings[1].message.contains("runs into the existing body: at"), "{:?}", plan.warnings);
    // A path around the body is longer.
    let around = growbot(&["plan", "--continue", &log, "--to", through, "--avoid-self-collision", "--json"]);
    let around: Value = serde_json::from_str(&around.out).unwrap();
    assert_eq!(around["warnings"][0]["code"], "continues-body");
    assert_eq!(around["warnings"].as_array().unwrap().len(), 1);
    assert!(around["length_mm"].as_f64().unwrap() > plan.requirements.length);
    // The warning is found again if it is removed from the file.
    let mut written: Value = serde_json::from_str(&std::fs::read_to_string(&file).unwrap()).unwrap();
    written["warnings"] = json!([]);
    let read = read_in_scene(&written.to_string(), "the plan", None, None).unwrap();
    assert_eq!(read.plan.warnings.len(), plan.warnings.len());
    // A layer without height hides nothing of the body, but one that bends has no centreline.
    let layers = written["existing_layers"].as_str().unwrap().to_owned();
    for (tilt, accepted) in [("00000000", true), ("00000001", false)] {
        written["existing_layers"] = json!(format!("{}{tilt}{layers}", "0".repeat(16)));
        let read = read_in_scene(&written.to_string(), "the plan", None, None);
        assert_eq!(read.map(|read| read.plan.warnings.len()).ok(), accepted.then_some(plan.warnings.len()));
    }
    written["existing_layers"] = json!("0");
    let refused = read_in_scene(&written.to_string(), "the plan", None, None);
    assert!(refused.is_err_and(|error| error.to_string().contains("not layers")));
}

#[test]
fn nothing_continues_a_body_whose_tip_is_not_known() {
    let directory = tempfile::tempdir().unwrap();
    let log = grow_logged(directory.path(), "run.jsonl", &["--to", "0,0,40,0,90"]);
    let lines = std::fs::read_to_string(&log).unwrap();
    let refused = |text: &str, robot: &[&str]| {
        std::fs::write(&log, text).unwrap();
        let ran = growbot(&[&["plan", "--continue", &log, "--to", "0,0,90,0,90"], robot].concat());
        assert_eq!(ran.code, Some(2), "{}", ran.out);
        ran.err
    };
    let (all, _) = lines.trim_end().rsplit_once('\n').unwrap();
    assert!(refused(all, &[]).contains("the outcome of the growth is unfinished"));
    let lost_board = lines.replace("\"outcome\":\"done\"", "\"outcome\":\"lost\"");
    assert!(refused(&lost_board, &[]).contains("the outcome of the growth is lost"));
    let jam = lines.replace("\"outcome\":\"done\"", "\"outcome\":\"fault\"");
    let jam = jam.replace("\"fault\":null", "\"fault\":\"filament-jam\"");
    assert!(refused(&jam, &[]).contains("the fault filament-jam"), "{}", refused(&jam, &[]));
    let header = lines.lines().next().unwrap();
    let end = lines.lines().last().unwrap();
    let nothing = refused(&format!("{header}\n{end}\n"), &[]);
    assert!(nothing.contains("no layer of the body is laid"), "{nothing}");
    let lost: String =
        lines.lines().filter(|line| !line.contains("\"layer\":7,")).map(|line| format!("{line}\n")).collect();
    assert!(refused(&lost, &[]).contains("nothing is known of 1 layers"), "{}", refused(&lost, &[]));
    assert!(refused(&lines, &["--robot", "growbot-b"]).contains("pass the robot of the body with --robot"));
    let both = growbot(&["plan", "--continue", &log, "--from", "0,0,0,0,90", "--to", "0,0,90,0,90"]);
    assert_eq!(both.code, Some(2), "{}", both.out);
}

/// The tip of a simulated robot is placed at the start of each body, or its sensors would measure the earlier ones,
/// too.
#[test]
fn feedback_measures_each_body_from_its_own_start() {
    let lab = Lab::configured("[robots.lab]\nport = \"sim:lab\"\nrobot = \"growbot-a\"\npace = 5000.0\n");
    lab.wait_until_ready();
    let grow = |wanted: &Value| {
        let (status, job) = lab.ask("POST", "/robots/lab/jobs", &wanted.to_string());
        assert_eq!(status, 201, "{job}");
        let id = job["id"].as_str().unwrap().to_owned();
        assert_eq!(lab.wait_for_end(&id)["state"], "done");
        let record = RecordedRun::open(&lab.log(&id)).unwrap();
        let arrival = record.result.unwrap().arrival.unwrap();
        assert!(arrival.position_error_mm < 0.5, "{arrival:?}");
        id
    };
    grow(&json!({ "to": "20,0,60" }));
    let last = grow(&json!({ "to": "20,0,60", "feedback": true }));
    grow(&json!({ "from": format!("tip:{last}"), "to": "80,20,130", "feedback": true }));
}

/// The service begins a body at the last tip only as long as no other body has been grown.
#[test]
fn the_service_grows_on_only_from_the_last_body() {
    let lab = Lab::new(300.0);
    lab.wait_until_ready();
    let on = |goal: &str, job: &Value| {
        let from = format!("tip:{}", job["id"].as_str().unwrap_or_default());
        json!({ "to": goal, "from": from, "name": goal })
    };
    let plan = |wanted: &Value| lab.ask("POST", "/plans?robot=lab", &wanted.to_string());
    let grow = |wanted: &Value| lab.ask("POST", "/robots/lab/jobs", &wanted.to_string());
    assert_eq!(plan(&on("0,0,60,0,90", &Value::Null)).0, 404);
    let ended = |job: &Value| lab.wait_for_end(job["id"].as_str().unwrap())["state"].clone();
    let (status, first) = grow(&json!({ "to": "0,0,30,0,90" }));
    assert_eq!((status, ended(&first)), (201, json!("done")), "{first}");
    let (status, planned) = plan(&on("0,0,60,0,90", &first));
    assert_eq!(status, 200, "{planned}");
    assert!((planned["plan"]["start"]["z_mm"].as_f64().unwrap() - 30.0).abs() < 0.01, "{planned}");
    let (status, problem) = lab.ask("POST", "/robots/lab/queue", &on("0,0,60,0,90", &first).to_string());
    assert!(status == 409 && problem["detail"].as_str().unwrap().contains("cannot wait"), "{problem}");
    let given = json!({ "plan": planned["plan"] });
    let (status, second) = grow(&given);
    assert_eq!((status, ended(&second)), (201, json!("done")), "{second}");
    // Another body has been grown since, which is the second half of it.
    let (status, problem) = grow(&given);
    assert!(status == 409 && problem["detail"].as_str().unwrap().contains("not the last one"), "{problem}");
    let (status, problem) = grow(&on("0,0,90,0,90", &first));
    assert!(status == 409 && problem["detail"].as_str().unwrap().contains("does not have the body"), "{problem}");
    // A service that was restarted knows the body, too.
    let mut lab = lab;
    lab.kill();
    lab.start();
    lab.wait_until_ready();
    let grow = |wanted: &Value| lab.ask("POST", "/robots/lab/jobs", &wanted.to_string());
    let ended = |job: &Value| lab.wait_for_end(job["id"].as_str().unwrap())["state"].clone();
    let (status, third) = grow(&on("0,0,90,0,90", &second));
    assert_eq!((status, ended(&third)), (201, json!("done")), "{third}");
    let log = RecordedRun::open(&lab.log(third["id"].as_str().unwrap())).unwrap();
    let laid = [&first, &second].map(|job| job["layers"].as_u64().unwrap()).iter().sum::<u64>();
    assert_eq!(log.plan.existing_layers.len() as u64, laid);
    // Once the board has discarded the body, nothing begins at its tip.
    assert_eq!(lab.run(&["cancel", "--port", "sim:lab"]).0, Some(0));
    let (status, problem) = grow(&on("0,0,120,0,90", &third));
    assert!(status == 409 && problem["detail"].as_str().unwrap().contains("does not have the body"), "{problem}");
}
