//! Tests of jobs of the service in scenes with obstacles.

use std::fs;

use growbot_plan::run_log::RecordedRun;
use lab::{Lab, http};
use serde_json::{Value, json};

use crate::lab;

/// Scene with a ball beside the straight path upwards.
const BALL: &str = "format = \"growbot-scene/1\"\nmargin_mm = 5.0\n[[ball]]\ncenter_mm = [70, 0, 40]\nradius_mm = 40\n";
/// Scene with a ball in the straight path upwards.
const IN_THE_WAY: &str = "format = \"growbot-scene/1\"\n[[ball]]\ncenter_mm = [0, 0, 90]\nradius_mm = 40\n";

/// Entry in `growbot.toml` of an additional robot, which has sensors.
const SENSED: &str = "[robots.sensed]\nport = \"sim:sensed\"\nrobot = \"growbot-a\"\npace = 3000.0\n";

fn lab() -> Lab {
    let lab = Lab::with(300.0, SENSED);
    lab.wait_until_ready();
    lab.wait_until_robot_is_ready("sensed");
    lab
}

#[test]
fn the_service_keeps_bodies_clear_of_their_scene() {
    let lab = lab();
    let scene = lab.directory.path().join("ball.toml");
    fs::write(&scene, BALL).unwrap();
    // A command plans. The service runs in another directory, but finds the scene.
    let (code, answer) =
        lab.run(&["plan", "--to", "0,0,60,0,90", "--scene", "ball.toml", "--robot", "growbot-a", "-o", "plan.json"]);
    assert_eq!(code, Some(0), "{answer}");
    let (code, answer) = lab.run(&["grow", "plan.json", "--port", "sim:sensed", "--feedback", "--log", "run.jsonl"]);
    assert_eq!(code, Some(0), "{answer}");
    let record = RecordedRun::open(&lab.directory.path().join("run.jsonl")).unwrap();
    let (robot, of) = (record.own_robot().unwrap(), record.feedback.is_some());
    let plan = record.plan(&robot).unwrap();
    assert!(of && record.scene(&plan, &robot, None).unwrap().is_some(), "the log knows scene and feedback");
    // A scene that the plan does not know.
    fs::write(&scene, IN_THE_WAY).unwrap();
    let (_, answer) = lab.run(&["plan", "--to", "0,0,60,0,90", "-o", "straight.json"]);
    let straight: Value =
        serde_json::from_slice(&fs::read(lab.directory.path().join("straight.json")).unwrap()).expect(&answer);
    let wanted = json!({ "plan": straight, "scene": scene });
    let (status, problem) = lab.ask("POST", "/robots/lab/jobs", &wanted.to_string());
    let detail = problem["detail"].as_str().unwrap_or_default();
    assert!(status == 422 && detail.contains("into the ball"), "{status} {problem}");
    // A margin that the sensors cannot keep.
    let around = [[62.83, 0.0], [-62.83, 0.0], [0.0, 62.83], [0.0, -62.83]];
    let balls = around.map(|[x, y]| format!("[[ball]]\ncenter_mm = [{x}, {y}, 40]\nradius_mm = 40\n"));
    fs::write(&scene, format!("format = \"growbot-scene/1\"\n{}", balls.concat())).unwrap();
    let wanted = json!({ "to": "0,0,60,0,90", "scene": scene, "margin_mm": 0.0, "feedback": true });
    let (status, problem) = lab.ask("POST", "/robots/lab/jobs", &wanted.to_string());
    assert!(
        status == 409 && problem["detail"].as_str().unwrap().contains("no sensor that measures layers"),
        "{status} {problem}"
    );
    let (status, problem) = lab.ask("POST", "/robots/sensed/jobs", &wanted.to_string());
    let detail = problem["detail"].as_str().unwrap_or_default();
    assert!(status == 409 && detail.contains("larger margin_mm"), "{status} {problem}");
}

#[test]
fn each_flag_of_a_job_overrides_one_refusal_and_no_other() {
    let lab = lab();
    fs::write(lab.directory.path().join("near.toml"), IN_THE_WAY).unwrap();
    fs::write(lab.directory.path().join("old.jsonl"), "").unwrap();
    let (_, answer) = lab.run(&["plan", "--to", "0,0,60,0,90", "-o", "plain.json"]);
    let plain: Value =
        serde_json::from_slice(&fs::read(lab.directory.path().join("plain.json")).unwrap()).expect(&answer);
    let mut warns = plain.clone();
    warns["warnings"] =
        json!([{ "code": "self-collision", "message": "it meets itself", "value": 31.0, "limit": 47.1 }]);
    fs::write(lab.directory.path().join("warns.json"), warns.to_string()).unwrap();
    let near = lab.directory.path().join("near.toml");
    for (job, flag, other, refusal) in [
        (json!({ "plan": warns }), "force", "ignore_scene", "self-collision"),
        (json!({ "plan": plain, "scene": near }), "ignore_scene", "force", "into the ball"),
    ] {
        let with = |flag: &str| {
            let mut job = job.clone();
            job[flag] = json!(true);
            lab.ask("POST", "/robots/lab/jobs", &job.to_string())
        };
        let (status, problem) = with(other);
        let detail = problem["detail"].as_str().unwrap_or_default();
        assert!(matches!(status, 409 | 422) && detail.contains(refusal) && detail.contains(flag), "{status} {problem}");
        let (status, job) = with(flag);
        assert_eq!((status, job["ignore_scene"].as_bool()), (201, Some(flag == "ignore_scene")), "{job}");
        let id = job["id"].as_str().unwrap();
        let ended = lab.wait_for_end(id);
        assert_eq!((&ended["state"], &ended["ignore_scene"]), (&json!("done"), &job["ignore_scene"]));
        let record = RecordedRun::open(&lab.log(id)).unwrap();
        assert_eq!(record.ignore_scene, flag == "ignore_scene");
    }
    let recorded = lab.orders();
    assert_eq!(
        recorded.iter().filter(|line| line["command"] == "grow, ignoring the scene" && line["error"].is_null()).count(),
        1,
        "{recorded:?}"
    );
    // The command passes its flags to the service.
    for (arguments, flag, others, refusal) in [
        (vec!["warns.json"], "--force", ["--ignore-scene", "--overwrite"], "self-collision"),
        (vec!["plain.json", "--scene", "near.toml"], "--ignore-scene", ["--force", "--overwrite"], "into the ball"),
        (vec!["plain.json", "--log", "old.jsonl"], "--overwrite", ["--force", "--ignore-scene"], "already exists"),
    ] {
        let grow = |flags: &[&str]| lab.run(&[&["grow", "--port", "sim:lab"], &arguments[..], flags].concat());
        let (code, answer) = grow(&others);
        assert!(code != Some(0) && answer.contains(refusal), "{code:?} {answer}");
        let (code, answer) = grow(&[flag]);
        assert_eq!(code, Some(0), "{answer}");
    }
}

#[test]
fn a_body_is_resumed_in_its_original_scene() {
    let lab = lab();
    let scene = lab.directory.path().join("ball.toml");
    fs::write(&scene, BALL).unwrap();
    let wanted = json!({ "to": "0,0,120,0,90", "scene": scene, "feedback": true });
    let (status, job) = lab.ask("POST", "/robots/sensed/jobs", &wanted.to_string());
    assert_eq!(status, 201, "{job}");
    let id = job["id"].as_str().unwrap();
    lab::wait_for("some layers are laid", || {
        let (_, robot) = lab.ask("GET", "/robots/sensed", "");
        (robot["laid"].as_u64() > Some(5)).then_some(())
    });
    assert_eq!(lab.run(&["stop", "--port", "sim:sensed"]).0, Some(0));
    lab.wait_for_end(id);
    let resume = format!("/jobs/{id}/resume");
    fs::write(&scene, IN_THE_WAY).unwrap();
    let (status, problem) = lab.ask("POST", &resume, "{}");
    assert!(status == 409 && problem["detail"].as_str().unwrap().contains("ball.toml"), "{status} {problem}");
    fs::write(&scene, BALL).unwrap();
    let (status, answer) = lab.ask("POST", &resume, "{}");
    assert_eq!(status, 200, "{answer}");
    assert_eq!(lab.wait_for_end(id)["state"], "done");
}

#[test]
fn a_page_sends_its_scenes_and_cannot_name_local_files() {
    let lab = lab();
    let ask = |path: &str, body: &str| {
        let (status, text) = http(lab.page(), "POST", &lab.at(path), &["host: 127.0.0.1"], body);
        (status, serde_json::from_str::<Value>(&text).unwrap_or(Value::String(text)))
    };
    let (status, kept) = ask("/scenes?name=Ball.TOML", BALL);
    assert_eq!(status, 200, "{kept}");
    let name = kept["scene"].as_str().unwrap();
    let (status, planned) = ask("/plans?robot=lab", &json!({ "to": "0,0,60,0,90", "scene": name }).to_string());
    assert_eq!(status, 200, "{planned}");
    assert!(planned["plan"]["scene"]["clearance_mm"].as_f64().unwrap() >= 5.0, "{planned}");
    assert_eq!(planned["plan"]["scene"]["margin_mm"], 5.0);
    assert_eq!(kept["box"], json!({ "min_mm": [30.0, -40.0, 0.0], "max_mm": [110.0, 40.0, 80.0] }));
    // A request may set another margin. The tube is 22.8 mm thick from its centre, and the ball begins at 30 mm.
    let with_margin = |margin: f64| {
        let request = json!({ "to": "0,0,60,0,90", "scene": name, "margin_mm": margin });
        ask("/plans?robot=lab", &request.to_string())
    };
    let (status, near) = with_margin(1.0);
    assert_eq!((status, &near["plan"]["scene"]["margin_mm"]), (200, &json!(1.0)), "{near}");
    for refused in [20.0, -1.0, 1e9] {
        let (status, problem) = with_margin(refused);
        assert!(status == 422 && problem["detail"].as_str().unwrap().contains("margin"), "{status} {problem}");
    }
    // The plan names the scene that was sent, so it can be grown as it is.
    let (status, job) = ask("/robots/lab/jobs", &json!({ "plan": planned["plan"], "scene": name }).to_string());
    assert_eq!(status, 201, "{job}");
    assert_eq!(lab.wait_for_end(job["id"].as_str().unwrap())["state"], "done");
    let elsewhere = lab.directory.path().join("ball.toml");
    fs::write(&elsewhere, BALL).unwrap();
    for scene in [elsewhere.to_str().unwrap(), "../tokens", "/etc/passwd", ".", "", "0123456789abcdef.toml"] {
        let (status, problem) = ask("/plans?robot=lab", &json!({ "to": "0,0,60,0,90", "scene": scene }).to_string());
        assert!(
            status == 422 && problem["detail"].as_str().unwrap().contains("/scenes"),
            "{scene}: {status} {problem}"
        );
    }
    let points = "format = \"growbot-scene/1\"\n[[points]]\nfile = \"/etc/passwd\"\nradius_mm = 1\n";
    for (name, body, why) in [
        ("room.exe", BALL, "does not have the extension of a scene"),
        ("no-ending", BALL, "does not have the extension of a scene"),
        ("points.toml", points, "which was not sent"),
        ("wrong.toml", "ball", "wrong.toml"),
        ("wrong.stl", "ball", "wrong.stl"),
    ] {
        let (status, problem) = ask(&format!("/scenes?name={name}"), body);
        assert!(status == 422 && problem["detail"].as_str().unwrap().contains(why), "{name}: {status} {problem}");
    }
    let kept = fs::read_dir(lab.directory.path().join("state/growbot/serve/scenes")).unwrap().count();
    assert_eq!(kept, 1, "what is no scene is not kept");
}
