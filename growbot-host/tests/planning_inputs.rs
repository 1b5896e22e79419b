//! Tests of the forms of goals for `growbot plan`: positions without a direction, lists of positions, batches, units.

use crate::running;

use std::fs;

use running::{Ran, growbot, growbot_reading};
use serde_json::Value;

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

fn plan(args: &[&str]) -> Value {
    let ran = growbot(&[&["plan", "--json"], args].concat());
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    json(&ran.out)
}

#[track_caller]
fn assert_refused(ran: &Ran, parts: &[&str]) {
    assert_eq!((ran.code, ran.out.as_str()), (Some(2), ""), "{}", ran.err);
    for part in parts {
        assert!(ran.err.contains(part), "no {part:?} in {:?}", ran.err);
    }
}

#[test]
fn a_goal_without_a_direction_is_planned_and_grown() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("plan.json").into_os_string().into_string().unwrap();
    let table = growbot(&["plan", "--to", "-20,10,60", "-o", &file]);
    assert_eq!(table.code, Some(0), "{}", table.err);
    assert!(table.out.contains("  to        -20, 10, 60 mm, heading ") && table.out.contains("(direction free)"));
    assert!(table.out.lines().all(|line| line.chars().count() <= 80), "{}", table.out);
    let written = json(&fs::read_to_string(&file).unwrap());
    assert_eq!(written["goal"]["direction_free"], true);
    assert!(written["start"].get("direction_free").is_none());
    let simulated = json(&growbot(&["simulate", &file, "--json"]).out);
    assert!(simulated["position_error_mm"].as_f64().unwrap() < 1e-6, "{simulated}");
    assert!(simulated["direction_error_deg"].as_f64().unwrap() < 1e-6, "{simulated}");
    let grown = json(growbot(&["grow", "--to", "-120,60,200", "--json"]).out.lines().last().unwrap());
    assert_eq!(grown["outcome"], "done", "{grown}");
    assert!(grown["position_error_mm"].as_f64().unwrap() < 0.1, "{grown}");
}

#[test]
fn no_other_direction_gives_a_shorter_path() {
    let free = plan(&["--to", "300,0,100"])["length_mm"].as_f64().unwrap();
    for direction in ["0,0", "0,-45", "90,0", "180,45", "20,-20"] {
        let directed = plan(&["--to", &format!("300,0,100,{direction}")])["length_mm"].as_f64().unwrap();
        // One of the directions may be the best one, so the last digits may differ.
        assert!(free <= directed * (1.0 + 1e-12), "{direction}: {directed} < {free}");
    }
}

#[test]
fn waypoints_come_from_options_or_a_file() {
    let options = plan(&["--via", "200,0,400", "--via", "500,100,300,0,-45", "--to", "800,0,0"]);
    let free: Vec<&Value> = options["via"].as_array().unwrap().iter().map(|via| &via["direction_free"]).collect();
    assert_eq!(free, [&Value::Bool(true), &Value::Null]);
    let lines = "x,y,z,heading,pitch\n200,0,400,,\n500,100,300,0,-45\n";
    let from_file = growbot_reading(&["plan", "--via-csv", "-", "--to", "800,0,0", "--json"], lines);
    assert_eq!(json(&from_file.out), options);
    // The output can be read again.
    assert_eq!(growbot_reading(&["layers", "-"], &from_file.out).code, Some(0));
    let refused = |text: &str, parts: &[&str]| {
        let ran = growbot_reading(&["plan", "--via-csv", "-", "--to", "800,0,0"], text);
        assert_refused(&ran, &[&["standard input: "], parts].concat());
    };
    refused("x,y,z\n1,2,3\n\n4,five,6\n", &["line 4: y is \"five\"", "write a number like"]);
    refused("x,y\n", &["no column z", "write x,y,z"]);
    assert_refused(&growbot(&["plan", "--via-csv", "none.csv", "--to", "1,2,3"]), &["cannot read none.csv"]);
    assert_refused(&growbot(&["plan", "--via-csv", "-", "--via", "1,2,3", "--to", "1,2,3"]), &["--via-csv", "--via"]);
}

#[test]
fn the_batch_format_follows_the_file_extension() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).into_os_string().into_string().unwrap();
    let queries = "id,to_x_mm,to_y_mm,to_z_mm,to_heading_deg,to_pitch_deg\na,200,0,400,,\nb,200,0,400,0,0\nc,1,2,x,,\n";
    let batch = |more: &[&str]| growbot_reading(&[&["plan", "--batch", "-"], more].concat(), queries);
    let csv = batch(&[]);
    assert_eq!(csv.code, Some(1), "one of them failed");
    assert!(csv.err.contains("1 of 3 queries failed: see the column error"), "{}", csv.err);
    assert!(csv.out.starts_with("id,to_x_mm,") && csv.out.lines().count() == 4, "{}", csv.out);
    let lines = batch(&["--json"]).out;
    assert_eq!(lines.lines().map(|line| json(line)["id"].clone()).collect::<Vec<_>>(), ["a", "b", "c"]);
    for (name, more, expected) in [
        ("answers.csv", &[][..], &csv.out),
        ("answers", &[], &csv.out),
        ("answers.jsonl", &[], &lines),
        ("answers.json", &["--json"], &lines),
    ] {
        let ran = batch(&[&["-o", &path(name)], more].concat());
        assert_eq!((ran.code, ran.out.as_str()), (Some(1), ""), "{}", ran.err);
        assert_eq!(&fs::read_to_string(path(name)).unwrap(), expected, "{name}");
    }
    assert_refused(&batch(&["-o", &path("a.csv"), "--json"]), &["a.csv", ".json or .jsonl"]);
    assert_refused(&batch(&["-o", &path("a.stl")]), &["a.stl", ".csv, .json or .jsonl"]);
    let bad = growbot_reading(&["plan", "--batch", "-", "-o", &path("bad.csv")], "id,to_x\n");
    assert_refused(&bad, &["did you mean to_x_mm?"]);
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 4, "nothing half-written is left");
}

#[test]
fn a_batch_starts_at_the_given_pose() {
    let queries = "id,to_x_mm,to_y_mm,to_z_mm\na,0,0,400\n";
    let answer = growbot_reading(&["plan", "--batch", "-", "--json", "--from", "0,0,100,0,90"], queries);
    assert_eq!(json(&answer.out)["length_mm"], 300.0);
}

#[test]
fn units_are_converted_to_mm_and_degrees() {
    let plain = plan(&["--from", "0,0,100,0,90", "--to", "200,100,600,0,45", "--radius", "120"]);
    let units = plan(&["--from", "0mm,0,0.1m,0deg,90deg", "--to", "0.2m,100mm,.6m,0rad,45deg", "--radius", "0.12m"]);
    assert_eq!(plain, units);
    let simulated = |step: &str, noise: &str| {
        let to = serde_json::to_string(&plain).unwrap();
        let args = ["simulate", "-", "--slice", "whole", "--step", step, "--tilt-noise", noise, "--json"];
        json(&growbot_reading(&args, &to).out)
    };
    assert_eq!(simulated("0.5", "0.5"), simulated("0.5mm", "0.5deg"));
    let workspace = |more: &[&str]| growbot(&[&["workspace", "--json"], more].concat()).out;
    assert_eq!(workspace(&["--length", "1000"]), workspace(&["--length", "1m"]));
    assert_refused(&growbot(&["plan", "--to", "1,2,3deg"]), &["z is \"3deg\"", "0.6m"]);
    assert_refused(&growbot(&["plan", "--to", "1,2,3", "--radius", "1rad"]), &["--radius", "\"1rad\"", "not a length"]);
}

#[test]
fn values_that_look_like_metres_or_radians_give_a_warning() {
    let stderr_of = |args: &[&str]| growbot(&[&["plan"], args].concat()).err;
    assert!(
        stderr_of(&["--to", "0.2,0.1,0.6"])
            .contains("warning: the goal is 0.64 mm from the start, but the tube is 45.6")
    );
    assert!(stderr_of(&["--to", "0.2,0.1,0.6"]).contains("did you mean metres?"));
    assert!(stderr_of(&["--to", "200,100,600,0,0.785"]).contains("did you mean radians?"));
    for quiet in ["200,100,600,0,45", "0.2m,0.1m,0.6m", "20mm,10mm,10mm", "200,100,600,0,1", "200,100,600,0,0.785deg"] {
        assert_eq!(stderr_of(&["--to", quiet]), "", "{quiet}");
    }
}

#[test]
fn vertical_poses_have_no_heading_and_no_heading_error() {
    let grown = growbot(&["grow", "--to", "0,0,60,0,90", "--json"]);
    let grown = json(grown.out.lines().last().unwrap());
    assert_eq!((&grown["heading_error_deg"], &grown["final"]["heading_deg"]), (&Value::Null, &Value::Null));
    assert!(grown["direction_error_deg"].as_f64().unwrap() < 1e-3);
    let table = growbot(&["grow", "--to", "0,0,60,0,90"]).out;
    for name in ["target", "final"] {
        let row: Vec<&str> = table.lines().find(|line| line.starts_with(name)).unwrap().split_whitespace().collect();
        assert_eq!((row[4], row[5]), ("-", "90.000"), "{table}");
    }
    let repeated =
        |more: &[&str]| growbot(&[&["simulate", "--to", "0,0,60,0,90", "--tilt-noise", "1"], more].concat()).out;
    let campaign = json(&repeated(&["--repeat", "5", "--json"]));
    assert_eq!(campaign["heading_error_deg"], Value::Null);
    assert!(campaign["pitch_error_deg"]["mean"].as_f64().unwrap() > 0.0);
    let table = repeated(&["--repeat", "5"]);
    let heading = table.lines().find(|line| line.starts_with("heading, deg")).unwrap();
    assert_eq!(heading.matches(" -").count(), 6, "{table}");
    assert!(repeated(&[]).contains("deg of pitch; no heading error, because a vertical direction has no heading"));
}

#[test]
fn zeros_have_no_sign_and_rounding_errors_are_hidden() {
    let table = growbot(&["simulate", "--to", "300,0,0,0,-90"]).out;
    assert!(table.contains("final         300.000      0.000      0.000            -     -90.000"), "{table}");
    assert!(!table.contains("-0.000"), "{table}");
    let campaign = growbot(&["simulate", "--to", "300,0,0,0,-90", "--repeat", "2"]).out;
    assert!(!campaign.contains("e-1"), "{campaign}");
    let layers = growbot_reading(&["layers", "-"], &serde_json::to_string(&plan(&["--to", "300,0,0"])).unwrap()).out;
    for field in layers.lines().skip(1).flat_map(|line| line.split(',')) {
        let number: f64 = field.parse().unwrap();
        assert!(field.len() <= 24 && number.to_string().parse::<f64>() == Ok(number), "{field}");
    }
}
