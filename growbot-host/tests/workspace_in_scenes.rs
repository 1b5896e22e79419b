//! Tests of `growbot workspace --scene`: each goal has one of three results, and a goal with the result `path` can be
//! planned.

use crate::running;

use std::fs;

use running::growbot;
use serde_json::Value;

/// Returns the text of a scene with a ball, and with six walls that enclose a space which no path can enter.
fn scene() -> String {
    let walls = (0..6).map(|side| {
        let (mut centre, mut size) = ([0.0, 0.0, 450.0], [260.0; 3]);
        centre[side / 2] += if side % 2 == 0 { 125.0 } else { -125.0 };
        size[side / 2] = 10.0;
        format!("[[box]]\ncenter_mm = {centre:?}\nsize_mm = {size:?}\n")
    });
    let ball = "[[ball]]\ncenter_mm = [200, 0, 200]\nradius_mm = 60\n";
    format!("format = \"growbot-scene/1\"\nmargin_mm = 5\n{ball}{}", walls.collect::<String>())
}

fn number(value: &Value, name: &str) -> u64 {
    value[name].as_u64().unwrap_or_else(|| panic!("{name}: {value}"))
}

#[test]
fn every_goal_has_one_of_three_results() {
    let directory = tempfile::tempdir().unwrap();
    let path = |name: &str| directory.path().join(name).display().to_string();
    let (room, goals) = (path("room.toml"), path("goals.csv"));
    fs::write(&room, scene()).unwrap();
    let asked = ["workspace", "--length", "600", "--scene", &room];

    let ran = growbot(&[&asked[..], &["-o", &goals]].concat());
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    for part in ["1000 goals", "a path, proven to be clear", "every passage to the goal is too narrow", "--effort 1"] {
        assert!(ran.out.contains(part), "no {part:?} in {}", ran.out);
    }
    let ran = growbot(&[&asked[..], &["--json"]].concat());
    assert_eq!(ran.out, growbot(&[&asked[..], &["--json"]].concat()).out, "the same question has the same answer");
    let told: Value = serde_json::from_str(&ran.out).unwrap();
    let counted = ["path", "none", "not_found"].map(|name| number(&told, name));
    assert_eq!(counted.iter().sum::<u64>(), 1000);
    let because = ["too_far", "too_near", "separated", "at_resolution", "not_clear"];
    assert_eq!(because.iter().map(|name| number(&told["none_because"], name)).sum::<u64>(), counted[1]);
    // 1.5 % of the goals are within the walls, minus those that are too near to them.
    assert!(number(&told["none_because"], "separated") >= 1, "{told}");
    assert!(number(&told["none_because"], "too_near") > 20, "{told}");
    let bands = told["bands"].as_array().unwrap();
    assert_eq!(bands.iter().map(|band| number(band, "path")).sum::<u64>(), counted[0]);

    let written = fs::read_to_string(&goals).unwrap();
    let rows: Vec<Vec<&str>> = written.lines().skip(1).map(|row| row.split(',').collect()).collect();
    assert_eq!(rows.len(), 1000);
    let with = |answer: &str| rows.iter().filter(|row| row[3] == answer).collect::<Vec<_>>();
    assert_eq!([with("path").len(), with("none").len(), with("not_found").len()].map(|count| count as u64), counted);
    // A goal within reach has a plan of at most that length.
    for row in with("path").iter().step_by(200) {
        let (goal, length) = (row[..3].join(","), row[5].parse::<f64>().unwrap());
        let plan =
            growbot(&["plan", "--to", &goal, "--scene", &room, "--effort", "1", "--max-length", "600", "--json"]);
        let plan: Value = serde_json::from_str(&plan.out).unwrap_or_else(|error| panic!("{error}: {}", plan.err));
        assert!(length <= 600.0 && plan["length_mm"].as_f64().unwrap() <= length + 1e-6, "{goal}");
    }
    let separated = rows.iter().find(|row| row[4] == "separated").unwrap()[..3].join(",");
    let plan = growbot(&["plan", "--to", &separated, "--scene", &room]);
    assert!(plan.code == Some(1) && plan.err.contains("every passage between start and goal"), "{}", plan.err);
}

#[test]
fn invalid_requests_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let room = directory.path().join("room.toml").display().to_string();
    fs::write(&room, scene()).unwrap();
    let refused = |more: &[&str], code: i32, part: &str| {
        let ran = growbot(&[&["workspace", "--length", "300"][..], more].concat());
        assert!(ran.code == Some(code) && ran.out.is_empty() && ran.err.contains(part), "{}", ran.err);
    };
    refused(&["--scene", "no.toml"], 2, "no.toml");
    refused(&["--scene", &room, "-o", "reach.svg"], 2, "csv");
    refused(&["--scene", &room, "--from", "200,0,200,0,90"], 1, "the start is inside an obstacle");
    refused(&["--scene", &room, "--radius", "50"], 2, "R_min");
    refused(&["--effort", "2"], 2, "--scene");
}
