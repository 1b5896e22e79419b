//! Tests of the library of the service: plans, scenes and robot files under names.

use growbot_plan::robot_file;
use serde_json::{Value, json};

use crate::lab::Lab;

const BALL: &str = "format = \"growbot-scene/1\"\n[[ball]]\ncenter_mm = [0, 90, 100]\nradius_mm = 40\n";

fn keep(lab: &Lab, entry: &Value) -> (u16, Value) {
    lab.ask("POST", "/library", &entry.to_string())
}

fn entries(lab: &Lab) -> Value {
    lab.ask("GET", "/library", "").1
}

/// Returns what the library has under an entry, and the status.
fn content(lab: &Lab, entry: &Value, part: &str) -> (u16, Value) {
    lab.ask("GET", &format!("/library/{}/{part}", entry["id"].as_str().unwrap()), "")
}

#[test]
fn plans_scenes_and_robot_files_are_kept_and_removed() {
    let mut lab = Lab::new(300.0);
    lab.wait_until_ready();
    assert_eq!(entries(&lab), json!([]));
    let (_, scene) = lab.ask("POST", "/scenes?name=ball.toml", BALL);
    let (status, planned) =
        lab.ask("POST", "/plans?robot=lab", &json!({ "to": "0,0,60,0,90", "scene": scene["scene"] }).to_string());
    assert_eq!(status, 200, "{planned}");
    let (status, plan) = keep(&lab, &json!({ "name": "pipe/../rack 7", "plan": planned["plan"] }));
    assert_eq!((status, &plan["kind"], &plan["scene"]), (201, &json!("plan"), &scene["scene"]), "{plan}");
    assert_eq!(plan["summary"], "60.0 mm, 78 layers, for growbot-a2");
    let (status, ball) = keep(&lab, &json!({ "name": "ball", "scene": scene["scene"] }));
    assert_eq!((status, &ball["summary"]), (201, &json!("80 x 80 x 80 mm")), "{ball}");
    let text = robot_file::text_of("growbot-a".as_ref()).unwrap().0;
    let (status, robot) = keep(&lab, &json!({ "name": "ball", "robot_file": text }));
    assert_eq!((status, &robot["kind"]), (201, &json!("robot")), "a name belongs to one entry of each kind: {robot}");
    let kept = json!([robot, ball, plan]);
    assert_eq!(entries(&lab), kept);

    // The entries outlive the service, and the plan grows as it was kept.
    lab.kill();
    lab.start();
    lab.wait_until_ready();
    assert_eq!(entries(&lab), kept);
    let (_, file) = content(&lab, &plan, "file");
    assert_eq!(file, planned["plan"]);
    let order = json!({ "plan": file, "scene": plan["scene"] });
    let (status, job) = lab.ask("POST", "/robots/lab/jobs", &order.to_string());
    assert_eq!(status, 201, "{job}");

    // A job keeps its plan and its scene when their entries are removed.
    for entry in [&plan, &ball] {
        let path = format!("/library/{}/remove", entry["id"].as_str().unwrap());
        assert_eq!(lab.ask("POST", &path, "").0, 200);
        assert_eq!(lab.ask("POST", &path, "").0, 404);
        assert_eq!(content(&lab, entry, "file").0, 404);
    }
    assert_eq!(entries(&lab), json!([robot]));
    assert_eq!(lab.wait_for_end(job["id"].as_str().unwrap())["state"], "done");
    let (status, _) =
        lab.ask("POST", "/plans?robot=lab", &json!({ "to": "0,0,60,0,90", "scene": scene["scene"] }).to_string());
    assert_eq!(status, 200);
}

#[test]
fn the_library_refuses_what_it_cannot_keep() {
    let lab = Lab::new(300.0);
    lab.wait_until_ready();
    let text = robot_file::text_of("growbot-a".as_ref()).unwrap().0;
    let refused = |entry: Value, status: u16, reason: &str| {
        let (found, problem) = keep(&lab, &entry);
        assert_eq!(found, status, "{problem}");
        assert!(problem["detail"].as_str().unwrap().contains(reason), "{problem}");
    };
    refused(json!({ "name": "two", "scene": "a.toml", "robot_file": text }), 422, "one of");
    let long = json!({ "format": "growbot-plan/1", "layers": 13_000_000 });
    refused(json!({ "name": "long", "plan": long }), 409, "a board can store");
    refused(json!({ "name": "none" }), 422, "one of");
    refused(json!({ "name": "plan", "plan": { "format": "growbot-plan/1" } }), 422, "plan");
    refused(json!({ "name": "scene", "scene": "../tokens" }), 422, "no scene");
    refused(json!({ "name": "robot", "robot_file": "name = 1" }), 422, "expected a string");
    for name in [String::new(), " spaced".to_owned(), "a\nb".to_owned(), "x".repeat(101)] {
        refused(json!({ "name": name, "robot_file": text }), 422, "1 to 100 characters");
    }
    assert_eq!(keep(&lab, &json!({ "name": "mine", "robot_file": text })).0, 201);
    refused(json!({ "name": "mine", "robot_file": text }), 409, "choose another name");
    assert_eq!(lab.ask("GET", "/library/..%2Ftokens/file", "").0, 404);
    assert_eq!(lab.ask("POST", "/library/1/remove", "").0, 404);
}
