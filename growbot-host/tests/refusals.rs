//! Every door to a growth refuses the same requests with the same reason: the command without and with a service, the
//! API and the console here, the terminal interface in its own tests, Python in growbot-py/tests/test_board.py.

use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::lab::Lab;
use crate::running::{growbot, growbot_reading};

/// Balls in the straight path upwards, and beside it.
const IN_THE_WAY: &str = "format = \"growbot-scene/1\"\n[[ball]]\ncenter_mm = [0, 0, 90]\nradius_mm = 40\n";
const AROUND: [[f64; 2]; 4] = [[62.83, 0.0], [-62.83, 0.0], [0.0, 62.83], [0.0, -62.83]];

/// A request that is refused.
struct Refused<'a> {
    /// Part of the reason that every door gives.
    reason: &'a str,
    /// Code of the reason, for programs.
    code: &'a str,
    robot: &'a str,
    /// Arguments of `grow`, and the same request for the API.
    args: Vec<&'a str>,
    job: Value,
    /// Line for the console. `None` if the console has no such request.
    line: Option<&'a str>,
}

fn plan(directory: &Path) -> Value {
    let file = directory.join("plan.json");
    let args = ["plan", "--to", "0,0,60,0,90", "--robot", "growbot-a", "-o", file.to_str().unwrap()];
    assert_eq!(growbot(&args).code, Some(0));
    serde_json::from_slice(&fs::read(file).unwrap()).unwrap()
}

#[test]
fn each_refusal_has_the_same_reason_through_each_door() {
    let lab = Lab::configured(
        "[robots.sensed]\nport = \"sim:sensed\"\nrobot = \"growbot-a\"\npace = 300\n\
         [robots.bare]\nport = \"sim:bare\"\nrobot = \"growbot-a2\"\npace = 300\n",
    );
    for name in ["sensed", "bare"] {
        lab.wait_until_robot_is_ready(name);
    }
    let directory = lab.directory.path();
    let file = |name: &str, text: &str| {
        fs::write(directory.join(name), text).unwrap();
        directory.join(name).to_str().unwrap().to_owned()
    };
    let plain = plan(directory);
    let mut warns = plain.clone();
    warns["warnings"] =
        json!([{ "code": "self-collision", "message": "it meets itself", "value": 31.0, "limit": 47.1 }]);
    let (warning, straight) = (file("warns.json", &warns.to_string()), file("straight.json", &plain.to_string()));
    let in_the_way = file("in-the-way.toml", IN_THE_WAY);
    let balls = AROUND.map(|[x, y]| format!("[[ball]]\ncenter_mm = [{x}, {y}, 40]\nradius_mm = 40\n"));
    let narrow = file("narrow.toml", &format!("format = \"growbot-scene/1\"\n{}", balls.concat()));
    let far = "0,0,4000,0,90";
    let rows = [
        Refused {
            reason: "not grown because of filament-short",
            code: "plan-warnings",
            robot: "bare",
            args: vec!["--to", far],
            job: json!({ "to": far }),
            line: Some("grow 0,0,4000,0,90"),
        },
        Refused {
            reason: "not grown because of self-collision",
            code: "plan-warnings",
            robot: "sensed",
            args: vec![&warning],
            job: json!({ "plan": warns }),
            line: None,
        },
        Refused {
            reason: "has no sensor that measures layers",
            code: "no-sensor",
            robot: "bare",
            args: vec!["--to", "0,0,60,0,90", "--feedback"],
            job: json!({ "to": "0,0,60,0,90", "feedback": true }),
            line: None,
        },
        Refused {
            reason: "into the ball",
            code: "scene-not-clear",
            robot: "sensed",
            args: vec![&straight, "--scene", &in_the_way],
            job: json!({ "plan": plain, "scene": in_the_way }),
            line: None,
        },
        Refused {
            reason: "the body must keep a distance of",
            code: "too-near",
            robot: "sensed",
            args: vec!["--to", "0,0,60,0,90", "--scene", &narrow, "--margin", "0", "--feedback"],
            job: json!({ "to": "0,0,60,0,90", "scene": narrow, "margin_mm": 0.0, "feedback": true }),
            line: None,
        },
    ];
    for Refused { reason, code: refusal, robot, args, job, line } in &rows {
        let description = if *robot == "bare" { "growbot-a2" } else { "growbot-a" };
        let options = ["--robot", description];
        let ran = growbot(&[&["grow", "--port", "sim"], &args[..], &options].concat());
        let words = ran.err.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(matches!(ran.code, Some(1 | 2)) && words.contains(reason), "{reason}: {}", ran.err);
        let (code, text) = lab.run(&[&["grow", "--port", robot], &args[..], &options].concat());
        let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(code == ran.code && words.contains(reason), "{reason}: {text}");
        let (status, problem) = lab.ask("POST", &format!("/robots/{robot}/jobs"), &job.to_string());
        let detail = problem["detail"].as_str().unwrap_or_default();
        assert!(matches!(status, 409 | 422) && detail.contains(reason), "{reason}: {status} {problem}");
        assert_eq!(problem["code"], *refusal, "{problem}");
        let json = growbot(&[&["grow", "--json", "--port", "sim"], &args[..], &options].concat());
        if json.code == Some(1) {
            let result: Value = serde_json::from_str(json.out.lines().last().unwrap()).unwrap();
            assert_eq!((&result["outcome"], &result["refusal"]), (&json!("refused"), &json!(refusal)), "{result}");
        }
        if let Some(line) = line {
            let ran = growbot_reading(&["console", "--port", "sim", "--robot", description], line);
            let words = ran.err.split_whitespace().collect::<Vec<_>>().join(" ");
            assert!(ran.code == Some(1) && words.contains(&format!("{refusal}: {reason}")), "{reason}: {}", ran.err);
        }
    }
    // Nothing was begun.
    assert_eq!(lab.ask("GET", "/jobs", "").1, json!([]));
}
