//! Tests of `growbot grow`, `simulate` and `resume` in a scene with obstacles.

use crate::running;

use std::fs;
use std::path::Path;

use running::{Ran, growbot};
use serde_json::Value;
use tempfile::TempDir;

const ROOM: &str = "format = \"growbot-scene/1\"\nmargin_mm = 5.0\n[[ball]]\ncenter_mm = [0, 0, 300]\nradius_mm = 60\n";
/// Options for noise of the growth, and for the sensor noise that feedback assumes.
const SENSORS: [&str; 6] = ["--noise", "10", "--odometry-noise", "1", "--direction-noise", "0.5"];

/// A directory with the scene `room.toml` and two plans: `straight.json`, whose path hits the ball of the scene, and
/// `past.json`, whose path avoids the ball.
struct Fixture {
    directory: TempDir,
}

impl Fixture {
    fn new() -> Self {
        let fixture = Self { directory: tempfile::tempdir().unwrap() };
        fs::write(fixture.path("room.toml"), ROOM).unwrap();
        let (straight, past, room) =
            (fixture.path("straight.json"), fixture.path("past.json"), fixture.path("room.toml"));
        assert_eq!(growbot(&["plan", "--to", "0,0,500", "-o", &straight]).code, Some(0));
        assert_eq!(growbot(&["plan", "--to", "0,0,500", "--scene", &room, "-o", &past]).code, Some(0));
        // The plan names the scene as a program that runs in the directory would write it.
        let text = fs::read_to_string(&past).unwrap().replace(&room, "room.toml");
        fs::write(&past, text).unwrap();
        fixture
    }

    fn path(&self, name: &str) -> String {
        self.directory.path().join(name).to_str().unwrap().to_owned()
    }
}

/// Returns the JSON in the last line of a command's output.
fn json(ran: &Ran) -> Value {
    serde_json::from_str(ran.out.lines().last().unwrap()).unwrap()
}

/// Returns the events with this name from a run log.
fn events(log: &str, name: &str) -> Vec<Value> {
    let text = fs::read_to_string(Path::new(log)).unwrap();
    let lines = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    lines.filter(|line| line["event"] == name).collect()
}

#[test]
fn a_plan_without_clearance_is_refused_with_value_limit_and_remedy() {
    let fixture = Fixture::new();
    let (straight, room) = (fixture.path("straight.json"), fixture.path("room.toml"));
    let refused = growbot(&["grow", &straight, "--scene", &room, "--json"]);
    assert_eq!(refused.code, Some(1), "{}", refused.err);
    let words = refused.err.replace("\n    ", " ");
    for part in ["run 82.80 mm into the ball at 0, 0, 300", "the margin is 5 mm", "`growbot plan --scene`"] {
        assert!(words.contains(part), "{part}: {words}");
    }
    assert_eq!(words.matches("error: ").count(), 1);
    assert_eq!(json(&refused)["outcome"], "refused");
    // A simulation reports where the body touches.
    let simulated = growbot(&["simulate", &straight, "--scene", &room, "--json"]);
    assert_eq!(simulated.code, Some(0));
    let scene = &json(&simulated)["scene"];
    let at = scene["contact"]["at_mm"].as_f64().unwrap();
    assert!((at - (300.0 - 60.0 - 22.8)).abs() < 1.0, "{scene}");
    assert_eq!(scene["contact"]["obstacle"], "the ball at 0, 0, 300");
    assert!(scene["clearance_mm"].as_f64().unwrap() < -80.0 && scene["paused"].is_null());
}

#[test]
fn the_scene_of_a_plan_is_found_or_given_and_must_match() {
    let fixture = Fixture::new();
    let (past, room, other) = (fixture.path("past.json"), fixture.path("room.toml"), fixture.path("other.toml"));
    let simulate = |args: &[&str]| growbot(&[&["simulate", past.as_str(), "--json"], args].concat());
    let beside = simulate(&[]);
    assert_eq!(beside.code, Some(0), "{}", beside.err);
    assert!(json(&beside)["scene"]["clearance_mm"].as_f64().unwrap() > 4.9);
    fs::rename(&room, &other).unwrap();
    for command in ["grow", "simulate"] {
        let missing = growbot(&[command, &past]);
        assert_eq!(missing.code, Some(2));
        let words = missing.err.replace("\n    ", " ");
        assert!(words.contains("room.toml") && words.contains("--scene"), "{words}");
    }
    assert_eq!(simulate(&["--scene", &other]).code, Some(0));
    fs::write(&room, ROOM.replace("= 60", "= 61")).unwrap();
    for changed in [simulate(&[]), simulate(&["--scene", &room])] {
        assert_eq!(changed.code, Some(2));
        assert!(changed.err.contains("has changed"), "{}", changed.err);
    }
}

#[test]
fn samples_report_contacts_in_open_loop_but_not_in_closed_loop() {
    let fixture = Fixture::new();
    let (past, samples) = (fixture.path("past.json"), fixture.path("samples.csv"));
    let run = |feedback: &[&str]| {
        let args =
            ["simulate", &past, "--noise", "10", "--bias", "-10", "--repeat", "4", "--json", "--samples", &samples];
        let ran = growbot(&[&args, feedback].concat());
        assert_eq!(ran.code, Some(0), "{}", ran.err);
        let table = fs::read_to_string(&samples).unwrap();
        let column = |name: &str| {
            let index = table.lines().next().unwrap().split(',').position(|column| column == name).unwrap();
            let rows = table.lines().skip(1);
            rows.filter(|row| !row.split(',').nth(index).unwrap().is_empty()).count()
        };
        (json(&ran)["scene"].clone(), column("contact_at_mm"), column("clearance_mm"), column("paused_at_mm"))
    };
    let (scene, contacts, clearances, _) = run(&[]);
    assert_eq!((scene["contacts"].as_u64().unwrap(), clearances), (contacts as u64, 4));
    assert_eq!(contacts, 4, "{scene}");
    assert!(scene["first_contact"]["seed"] == 1 && scene["min_clearance_mm"].as_f64().unwrap() < 0.0, "{scene}");
    let (scene, contacts, _, pauses) = run(&["--feedback", "--gravity-only"]);
    assert_eq!((scene["contacts"].as_u64(), contacts), (Some(0), 0), "{scene}");
    assert_eq!(scene["pauses"].as_u64().unwrap(), pauses as u64);
    assert!(scene["min_clearance_mm"].as_f64().unwrap() > 0.0);
}

#[test]
fn a_detour_replaces_a_correction_without_clearance_and_is_logged() {
    let fixture = Fixture::new();
    let (tight, log) = (fixture.path("tight.toml"), fixture.path("run.jsonl"));
    // Such a small margin is used up before the body has passed the ball.
    fs::write(&tight, ROOM.replace("5.0", "0.2")).unwrap();
    let args = ["grow", "--to", "0,0,500", "--scene", &tight, "--feedback", "--log", &log, "--json"];
    let grown = growbot(&[&args, &SENSORS[..]].concat());
    assert_eq!(grown.code, Some(0), "{}", grown.err);
    assert_eq!(json(&grown)["outcome"], "done");
    let detours = events(&log, "detour");
    assert!(!detours.is_empty() && events(&log, "clearance-violation").is_empty());
    let instead = &detours[0]["instead_of"];
    assert_eq!(instead["obstacle"], "the ball at 0, 0, 300");
    let number = |value: &Value| value.as_f64().unwrap();
    assert!(number(&instead["clearance_mm"]) < number(&instead["deviation_mm"]), "{instead}");
    assert!(number(&detours[0]["clearance_mm"]) > number(&instead["deviation_mm"]));
    assert!(grown.err.contains("takes another path"), "{}", grown.err);
}

#[test]
fn without_a_detour_a_start_is_refused_and_an_active_growth_pauses() {
    let fixture = Fixture::new();
    let (shaft, log) = (fixture.path("shaft.toml"), fixture.path("run.jsonl"));
    let shaft_of = |free: f64| {
        let boxes = [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]].map(|[x, y]| {
            let off = 60.0 + free;
            format!("[[box]]\ncenter_mm = [{}, {}, 300]\nsize_mm = [120, 120, 500]\n", x * off, y * off)
        });
        fs::write(&shaft, format!("format = \"growbot-scene/1\"\n{}", boxes.concat())).unwrap();
    };
    let args =
        ["grow", "--to", "0,0,600,0,90", "--scene", &shaft, "--margin", "0", "--feedback", "--log", &log, "--json"];
    // The tube has a radius of 22.8 mm, and the uncertainty of the position exceeds the rest of the shaft.
    shaft_of(23.3);
    let refused = growbot(&[&args, &SENSORS[..]].concat());
    assert_eq!(refused.code, Some(1), "{}", refused.err);
    assert_eq!(json(&refused)["outcome"], "refused");
    assert!(refused.err.contains("3 standard deviations"), "{}", refused.err);
    // Random tilts of the layers move the body off its line.
    shaft_of(27.0);
    let paused = growbot(&[&args, &SENSORS[..], &["--tilt-noise", "0.4"]].concat());
    assert_eq!(paused.code, Some(1), "{}", paused.err);
    assert_ne!(json(&paused)["outcome"], "done");
    let too_near = events(&log, "clearance-violation");
    assert_eq!(too_near.len(), 1);
    assert!(too_near[0]["obstacle"].as_str().unwrap().starts_with("the box at"), "{too_near:?}");
    assert!(too_near[0]["no_detour"].is_string());
    assert!(paused.err.replace("\n    ", " ").contains("the robot pauses"), "{}", paused.err);
    // Only layers that were already in progress follow.
    let laid = events(&log, "laid").len() as u64;
    assert!(laid < 776 && laid <= too_near[0]["layer"].as_u64().unwrap(), "{laid} {too_near:?}");
}

/// Writes a scene without a margin, and returns its path. Its only obstacle is a horizontal wall above a tube that ends
/// horizontally at a height of 300 mm. `spare` is the distance between the wall and the outside of the tube, mm.
fn wall_above(fixture: &Fixture, spare: f64) -> String {
    let (wall, top) = (fixture.path("wall.toml"), 300.0 + 22.8 + spare);
    let plane = format!("[[halfspace]]\npoint_mm = [0, 0, {top}]\nnormal = [0, 0, -1]\n");
    fs::write(&wall, format!("format = \"growbot-scene/1\"\n{plane}")).unwrap();
    wall
}

const LEVEL: &str = "400,0,300,0,0";

#[test]
fn a_plan_keeps_the_expected_deviation_of_its_robot_unless_another_margin_is_given() {
    let fixture = Fixture::new();
    let wall = wall_above(&fixture, 0.05);
    let plan = |more: &[&str]| growbot(&[&["plan", "--to", LEVEL, "--scene", &wall, "--json"], more].concat());
    let refused = plan(&[]);
    assert_eq!(refused.code, Some(1), "{}", refused.err);
    let words = refused.err.replace("\n    ", " ");
    // Half the tube is 22.8 mm, and 3 standard deviations of robot A are 4.82 mm.
    assert!(words.contains("needs 27.62") && words.contains("--margin"), "{words}");
    let near = plan(&["--margin", "0.01"]);
    assert_eq!(near.code, Some(0), "{}", near.err);
    let found = json(&near);
    assert_eq!(found["scene"]["margin_mm"], 0.01);
    let warning = &found["warnings"][0];
    assert_eq!(warning["code"], "near-obstacle");
    assert_eq!(warning["limit"], 4.82);
    let message = warning["message"].as_str().unwrap();
    let touching: u32 = message.split(" of 100 simulated").next().unwrap().rsplit(' ').next().unwrap().parse().unwrap();
    assert!((30..=70).contains(&touching), "{message}");
    for bad in ["-1", "nan", "1e9"] {
        assert_eq!(plan(&["--margin", bad]).code, Some(2), "{bad}");
    }
    // The text shows the margin, and a plan file keeps it.
    let file = fixture.path("near.json");
    let shown = growbot(&["plan", "--to", LEVEL, "--scene", &wall, "--margin", "0.01", "-o", &file]);
    assert!(shown.out.contains("\n  margin    0.01 mm\n"), "{}", shown.out);
    assert!(shown.out.contains("warning (near-obstacle): "), "{}", shown.out);
    for command in ["simulate", "view", "layers"] {
        let output = fixture.path(&format!("{command}.html"));
        let args = if command == "view" { vec![command, &file, "-o", &output] } else { vec![command, &file] };
        assert_eq!(growbot(&args).code, Some(0), "{command}");
    }
    assert!(
        fs::read_to_string(fixture.path("view.html")).unwrap().contains("simulated growths with that noise touch it")
    );
    let wider = growbot(&["simulate", &file, "--scene", &wall, "--margin", "3"]);
    assert!(wider.err.replace("\n    ", " ").contains("the margin is 3 mm"), "{}", wider.err);
}

#[test]
fn the_grown_body_is_checked_for_contact() {
    let fixture = Fixture::new();
    let (wall, log) = (wall_above(&fixture, 0.05), fixture.path("run.jsonl"));
    let grow = |more: &[&str]| {
        let args = ["grow", "--to", LEVEL, "--scene", &wall, "--margin", "0", "--overwrite", "--log", &log, "--json"];
        growbot(&[&args, more].concat())
    };
    let touches = grow(&["--bias", "2"]);
    assert_eq!(touches.code, Some(0), "{}", touches.err);
    let result = json(&touches);
    assert_eq!((&result["scene"]["contact"], &result["warnings"][0]["code"]), (&true.into(), &"far-from-plan".into()));
    assert_eq!(result["warnings"][1]["code"], "touches-obstacle");
    assert!(result["scene"]["obstacle"].as_str().unwrap().starts_with("the half space"), "{result}");
    assert!(touches.err.contains("touches-obstacle"), "{}", touches.err);
    let end = &events(&log, "end")[0]["result"];
    assert_eq!((&end["scene"], &end["plan_deviation"]), (&result["scene"], &result["plan_deviation"]));
    let clear = json(&grow(&["--bias", "-1"]));
    assert_eq!(clear["scene"]["contact"], false);
    assert!(clear["scene"]["clearance_mm"].as_f64().unwrap() > 0.05, "{clear}");
    assert!(clear["warnings"].is_null() || clear["warnings"][0]["code"] == "far-from-plan", "{clear}");
}
