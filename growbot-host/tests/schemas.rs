//! Tests of the JSON Schemas of `growbot schema`. Real plans, run logs and results must be valid, and changed ones
//! invalid.

use crate::describing_commands::commands;
use crate::running;

use std::fs;

use running::growbot;
use serde_json::{Value, json};

/// Returns the places where a value violates a JSON Schema. Only the keywords that growbot's schemas use are checked.
/// `at` is the path of the value.
pub fn faults(schema: &Value, value: &Value, at: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (keyword, answer) in schema.as_object().unwrap() {
        if !fits(keyword, answer, value, schema, at) {
            found.push(format!("{at}: {keyword} {answer} and not {value}"));
        }
    }
    for (key, schema) in schema["properties"].as_object().into_iter().flatten() {
        if let Some(value) = value.get(key) {
            found.extend(faults(schema, value, &format!("{at}.{key}")));
        }
    }
    found
}

fn fits(keyword: &str, answer: &Value, value: &Value, schema: &Value, at: &str) -> bool {
    let all =
        |items: &Value, check: &dyn Fn(&Value) -> bool| items.as_array().is_none_or(|items| items.iter().all(check));
    let matches = || answer.as_array().unwrap().iter().filter(|one| faults(one, value, at).is_empty()).count();
    match keyword {
        "$schema" | "title" | "description" | "default" | "properties" => true,
        "type" => match answer {
            Value::Array(kinds) => kinds.iter().any(|kind| is_of_type(kind.as_str().unwrap(), value)),
            kind => is_of_type(kind.as_str().unwrap(), value),
        },
        "minimum" => value.as_f64().is_none_or(|value| value >= answer.as_f64().unwrap()),
        "maximum" => value.as_f64().is_none_or(|value| value <= answer.as_f64().unwrap()),
        "const" => value == answer,
        "enum" => answer.as_array().unwrap().contains(value),
        "oneOf" => matches() == 1,
        "anyOf" => matches() > 0,
        "pattern" => {
            let is_hex = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit() || (b'a'..=b'f').contains(&byte));
            value.as_str().is_none_or(|text| match answer.as_str().unwrap() {
                "^[0-9a-f]{16}$" => text.len() == 16 && is_hex(text),
                "^([0-9a-f]{24})*$" => text.len() % 24 == 0 && is_hex(text),
                "^[a-z0-9-]+$" => {
                    let known = |byte: u8| byte.is_ascii_lowercase() || byte.is_ascii_digit() || byte == b'-';
                    !text.is_empty() && text.bytes().all(known)
                }
                other => panic!("{other}"),
            })
        }
        "items" => all(value, &|item| faults(answer, item, at).is_empty()),
        "maxLength" => value.as_str().is_none_or(|text| text.chars().count() as u64 <= answer.as_u64().unwrap()),
        "minItems" => value.as_array().is_none_or(|items| items.len() as u64 >= answer.as_u64().unwrap()),
        "maxItems" => value.as_array().is_none_or(|items| items.len() as u64 <= answer.as_u64().unwrap()),
        "required" => {
            value.as_object().is_none_or(|object| all(answer, &|key| object.contains_key(key.as_str().unwrap())))
        }
        "additionalProperties" => {
            let is_known = |key: &str| schema["properties"].get(key).is_some();
            let others = value.as_object().into_iter().flatten().filter(|(key, _)| !is_known(key));
            others.into_iter().all(|(_, other)| match answer {
                Value::Bool(allowed) => *allowed,
                schema => faults(schema, other, at).is_empty(),
            })
        }
        other => panic!("{other} at {at}"),
    }
}

fn is_of_type(kind: &str, value: &Value) -> bool {
    match kind {
        "object" => value.is_object(),
        "array" => value.is_array(),
        "string" => value.is_string(),
        "boolean" => value.is_boolean(),
        "integer" => value.is_i64() || value.is_u64(),
        "number" => value.is_number(),
        "null" => value.is_null(),
        kind => panic!("{kind}"),
    }
}

pub fn schema(kind: &str) -> Value {
    let ran = growbot(&["schema", kind]);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    serde_json::from_str(&ran.out).unwrap()
}

fn printed(args: &[&str]) -> Value {
    let ran = growbot(args);
    serde_json::from_str(&ran.out).unwrap_or_else(|_| panic!("{args:?}: {}{}", ran.out, ran.err))
}

/// Applies a change to a copy of a value, and fails if the schema accepts the changed value.
fn assert_slip(schema: &Value, value: &Value, change: impl FnOnce(&mut Value)) {
    let mut changed = value.clone();
    change(&mut changed);
    assert!(!faults(schema, &changed, "").is_empty(), "{changed}");
}

#[test]
fn plans_match_their_schema_and_errors_do_not() {
    let schema = schema("plan");
    let plans = [
        &["plan", "--to", "200,100,600,0,45", "--json"][..],
        &["plan", "--to", "200,100,600,0,45", "--planner", "two-plane", "--json"],
        &["plan", "--to", "0,60,120,90,30", "--robot", "growbot-a2", "--json"],
        &["plan", "--to", "300,0,300,0,0", "--via", "0,0,200,0,90", "--json"],
        &["plan", "--to", "0,0,0.5,0,90", "--json"],
        &["plan", "--to", "300,0,300", "--via", "0,50,200", "--json"],
    ];
    for args in plans {
        let plan = printed(args);
        assert_eq!(faults(&schema, &plan, ""), [""; 0], "{args:?}");
        assert_slip(&schema, &plan, |plan| plan["length_mm"] = json!("long"));
        assert_slip(&schema, &plan, |plan| plan["planner"] = json!("teleport"));
        assert_slip(&schema, &plan, |plan| plan["goal"]["direction_free"] = json!("yes"));
        assert_slip(&schema, &plan, |plan| plan["layer_count"] = json!(1));
        assert_slip(&schema, &plan, |plan| plan["segments"][0]["kind"] = json!("spiral"));
    }
}

#[test]
fn the_status_matches_its_schema_and_errors_do_not() {
    let schema = schema("status");
    for args in [&["--port", "sim"][..], &["--port", "sim", "--robot", "growbot-b"]] {
        let status = printed(&[&["status", "--json"], args].concat());
        assert_eq!(faults(&schema, &status, ""), [""; 0], "{status}");
        assert_slip(&schema, &status, |status| status["connection"] = json!("loose"));
        assert_slip(&schema, &status, |status| status["sensors"]["on_index"] = json!("yes"));
        assert_slip(&schema, &status, |status| drop(status.as_object_mut().unwrap().remove("laid")));
    }
}

#[test]
fn settings_and_notices_match_their_schemas_and_errors_do_not() {
    let settings = schema("settings");
    let text = "port = \"sim\"\n[robots.lab]\nport = \"sim:lab\"\npace = 60.0\n[serve]\nport = 9000\nrequest_s = 60\n\
                origins = [\"https://robots.example\"]\n\
                [serve.notify]\nwebhook = \"https://hooks.example/\"\ncommand = [\"./tell.sh\"]\nevents = [\"finish\"]\n";
    let written: Value = serde_json::to_value(toml::from_str::<toml::Table>(text).unwrap()).unwrap();
    assert_eq!(faults(&settings, &written, ""), [""; 0]);
    assert_slip(&settings, &written, |written| written["serve"]["notify"]["events"][0] = json!("dance"));
    assert_slip(&settings, &written, |written| written["serve"]["notify"]["webhok"] = json!("https://hooks.example/"));
    assert_slip(&settings, &written, |written| written["serve"]["port"] = json!(70_000));
    assert_slip(&settings, &written, |written| written["serve"]["request_s"] = json!(0));
    assert_slip(&settings, &written, |written| written["robots"]["lab"]["baud"] = json!(9600));
    assert_slip(&settings, &written, |written| written["robots"]["other"] = json!({ "pace": 1.0 }));
    let notices = schema("notification");
    // The example of book/src/notify.md.
    let notice = json!({
        "version": 1, "event": "filament-runout", "time_utc": "2026-11-23T01:45:00.123Z", "robot": "lab",
        "simulated": false, "job": "20261122T214500123_lab", "laid": 212, "layers": 780, "fault": null, "message": "it"
    });
    assert_eq!(faults(&notices, &notice, ""), [""; 0]);
    assert_slip(&notices, &notice, |notice| notice["event"] = json!("dance"));
    assert_slip(&notices, &notice, |notice| drop(notice.as_object_mut().unwrap().remove("fault")));
    assert_slip(&notices, &notice, |notice| notice["laid"] = json!(-1));
}

#[test]
fn run_logs_and_results_match_their_schemas_and_errors_do_not() {
    let (line_schema, result_schema) = (schema("run"), schema("result"));
    let directory = tempfile::tempdir().unwrap();
    let growths = [
        &["--to", "0,0,12,0,90"][..],
        &["--to", "60,20,200,0,60", "--noise", "10", "--feedback"],
        &["--to", "0,0,20,0,90", "--link-fault", "drop=2%,flip=1e-4"],
    ];
    let mut kinds = Vec::new();
    for (index, args) in growths.iter().enumerate() {
        let log = directory.path().join(format!("{index}.jsonl")).to_str().unwrap().to_owned();
        let result = printed(&[&["grow", "--json", "--log", &log], *args].concat());
        let replayed = printed(&["replay", "--json", &log]);
        for result in [&result, &replayed] {
            assert_eq!(faults(&result_schema, result, ""), [""; 0], "{args:?}");
            assert_slip(&result_schema, result, |result| result["outcome"] = json!("bored"));
            assert_slip(&result_schema, result, |result| result["plan_id"] = json!(7));
            assert_slip(&result_schema, result, |result| drop(result.as_object_mut().unwrap().remove("layers")));
        }
        for line in fs::read_to_string(&log).unwrap().lines() {
            let line: Value = serde_json::from_str(line).unwrap();
            assert_eq!(faults(&line_schema, &line, ""), [""; 0], "{args:?}");
            assert_slip(&line_schema, &line, |line| line["event"] = json!("dance"));
            assert_slip(&line_schema, &line, |line| line["utc"] = json!(12));
            kinds.push(line["event"].as_str().unwrap().to_owned());
        }
    }
    kinds.sort_unstable();
    kinds.dedup();
    let expected = ["amendment", "board", "encoder-reference", "end", "header", "laid", "simulated", "state", "status"];
    for kind in expected {
        assert!(kinds.iter().any(|found| found == kind), "{kind}: {kinds:?}");
    }
}

#[test]
fn a_refused_growth_has_a_valid_result() {
    let refused = printed(&["grow", "--to", "0,0,1e6,0,90", "--json"]);
    assert_eq!(
        (&refused["outcome"], faults(&schema("result"), &refused, "").len()),
        (&json!("refused"), 0),
        "{refused}"
    );
    assert!(refused["error"].as_str().unwrap().contains("--force"), "{refused}");
}

/// Commands with `--json`, and the kind of schema that their output fits. `DIR` is a directory with files.
const OUTPUTS: [(&[&str], &str); 34] = [
    (&["power", "on", "--port", "sim:DIR/robot"], "command"),
    (&["cancel", "--port", "sim:DIR/robot"], "command"),
    (&["clear", "--port", "sim:DIR/robot"], "command"),
    (&["maintain", "cooldown", "--port", "sim:DIR/robot"], "command"),
    (&["power", "status", "--port", "sim:DIR/robot"], "command"),
    (&["stop", "--port", "sim:DIR/robot"], "command"),
    (&["estop", "--port", "sim:DIR/robot"], "command"),
    (&["recover", "--port", "sim:DIR/robot"], "recovery"),
    (&["power", "off", "--port", "sim:DIR/robot"], "command"),
    (&["configure", "growbot-b", "--port", "sim"], "configure"),
    (&["doctor", "--port", "sim"], "doctor"),
    (&["grow", "--to", "0,0,12,0,90", "--log", "DIR/run.jsonl"], "result"),
    (&["replay", "DIR/run.jsonl"], "result"),
    (&["export", "DIR/run.jsonl", "-o", "DIR/body.stl"], "file"),
    (&["view", "DIR/run.jsonl"], "file"),
    (&["layers", "DIR/plan.json"], "plan"),
    (&["plan", "--to", "200,100,600,0,45"], "plan"),
    (&["ports"], "ports"),
    (&["reproduce", "--figure", "7", "--repeat", "2"], "reproduce"),
    (&["reproduce", "--table", "1", "--repeat", "2"], "reproduce"),
    (&["rmin"], "rmin"),
    (&["robots"], "robots"),
    (&["robots", "growbot-b"], "robots"),
    (&["scene", "DIR/scene.toml"], "scene-summary"),
    (&["settings"], "settings-list"),
    (&["simulate", "--to", "0,0,60,0,90"], "simulate"),
    (&["simulate", "--to", "60,20,200,0,60", "--noise", "10", "--feedback", "--repeat", "3"], "simulate"),
    (&["simulate", "--to", "60,20,200,0,60", "--noise", "10", "--scene", "DIR/scene.toml", "--sag"], "simulate"),
    (&["simulate", "--to", "60,20,200,0,60", "--repeat", "2", "--scene", "DIR/scene.toml"], "simulate"),
    (&["status", "--port", "sim"], "status"),
    (&["tune", "--port", "sim"], "tune"),
    (&["workspace", "--length", "300"], "workspace"),
    (&["workspace", "--length", "300", "--heading", "0", "--pitch", "90"], "workspace"),
    (&["workspace", "--length", "100", "--scene", "DIR/scene.toml", "--effort", "1"], "workspace"),
];

/// Commands with the same types of output, which need a growth of a service or an unfinished body. They are checked in
/// `serve`.
const OUTPUTS_OF_GROWTHS: [&str; 4] = ["attach", "continue", "pause", "resume"];

#[test]
fn the_output_of_each_command_fits_its_schema() {
    let directory = tempfile::tempdir().unwrap();
    let dir = directory.path().to_str().unwrap();
    fs::write(
        directory.path().join("scene.toml"),
        "format = \"growbot-scene/1\"\n[[ball]]\ncenter_mm = [400, 0, 0]\nradius_mm = 50\n",
    )
    .unwrap();
    let plan = directory.path().join("plan.json");
    assert_eq!(growbot(&["plan", "--to", "0,0,12,0,90", "-o", plan.to_str().unwrap()]).code, Some(0));
    for (args, kind) in OUTPUTS {
        let args: Vec<String> = args.iter().map(|arg| arg.replace("DIR", dir)).collect();
        let args: Vec<&str> = args.iter().map(String::as_str).chain(["--json"]).collect();
        let output = printed(&args);
        let found = faults(&schema(kind), &output, "");
        let shown: Vec<String> = found.iter().map(|fault| fault.chars().take(200).collect()).collect();
        assert_eq!(shown, [""; 0], "{args:?}");
    }
    for command in commands() {
        let help = growbot(&[&command, "--help"]).out;
        let has_json = help.lines().any(|line| line.trim_start().starts_with("--json"));
        let is_tested =
            OUTPUTS.iter().any(|(args, _)| args[0] == command) || OUTPUTS_OF_GROWTHS.contains(&command.as_str());
        assert_eq!(has_json, is_tested, "{command}");
    }
}
