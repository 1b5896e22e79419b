//! Tests of `growbot rmin`, `plan` and `layers` as users and scripts run them: results, exit codes, messages.

use std::fs;
use std::path::Path;

use running::{PROGRAM, Ran, command, growbot, growbot_reading};
use serde_json::Value;

use crate::running;

/// Arguments for a plan with known results. The planner `two-plane` is given, so that improvements of other planners do
/// not change the results.
const TO: [&str; 5] = ["plan", "--to", "200,100,600,0,45", "--planner", "two-plane"];
const HEADER: &str = "id,from_x_mm,from_y_mm,from_z_mm,from_heading_deg,from_pitch_deg,to_x_mm,to_y_mm,to_z_mm,to_heading_deg,to_pitch_deg";
const ROBOT_A: &str = include_str!("../../robots/growbot-a.toml");

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

fn with<'a>(args: &[&'a str], more: &[&'a str]) -> Vec<&'a str> {
    args.iter().chain(more).copied().collect()
}

/// Checks that a command ended with this exit code, an empty standard output and a message that contains all these
/// parts.
#[track_caller]
fn assert_refused(ran: &Ran, code: i32, parts: &[&str]) {
    assert_eq!((ran.code, ran.out.as_str()), (Some(code), ""), "{}", ran.err);
    for part in parts {
        assert!(ran.err.contains(part), "no {part:?} in {:?}", ran.err);
    }
    assert!(!ran.err.contains("panicked"), "{}", ran.err);
}

/// Like [`assert_refused`], but the message must also be one line that begins with `error: `.
#[track_caller]
fn assert_refused_in_a_line(ran: &Ran, code: i32, parts: &[&str]) {
    assert_refused(ran, code, parts);
    assert!(ran.err.starts_with("error: ") && ran.err.matches('\n').count() == 1, "{:?}", ran.err);
}

/// Writes a text file into the directory and returns its path.
fn file(directory: &Path, name: &str, text: &str) -> String {
    let path = directory.join(name);
    fs::write(&path, text).unwrap();
    path.into_os_string().into_string().unwrap()
}

#[test]
fn rmin_of_robot_a_is_98_20() {
    assert!(growbot(&["rmin"]).out.starts_with("growbot-a: R_min is 98.20 mm\n"));
    let rmin = json(&growbot(&["rmin", "--json"]).out);
    let names: Vec<&String> = rmin.as_object().unwrap().keys().collect();
    assert_eq!(names, ["r_min_geometry_mm", "r_min_layers_mm", "r_min_mm", "robot"]);
    assert!((rmin["r_min_mm"].as_f64().unwrap() - 98.2).abs() < 1e-9);
    assert_eq!(rmin["robot"], "growbot-a");
}

#[test]
fn help_has_examples_and_fits_80_columns() {
    assert!(growbot(&["--version"]).out.starts_with("growbot 0."));
    for args in [
        &["--help"][..],
        &["rmin", "--help"],
        &["plan", "--help"],
        &["plan", "-h"],
        &["layers", "--help"],
        &["grow", "--help"],
        &["workspace", "--help"],
    ] {
        let ran = growbot(args);
        assert!(ran.out.contains("Usage: growbot") && ran.out.contains("Example"), "{}", ran.out);
        assert!(ran.out.lines().all(|line| line.chars().count() <= 80), "{}", ran.out);
    }
}

#[test]
fn plan_prints_a_table_a_line_or_a_file() {
    let directory = tempfile::tempdir().unwrap();
    let path = file(directory.path(), "plan.json", "something old");
    let ran = growbot(&with(&TO, &["-o", &path]));
    assert_eq!(ran.code, Some(0));
    assert!(ran.out.contains("layers    833") && ran.out.contains("4 h 10 min"), "{}", ran.out);
    assert!(ran.out.lines().all(|line| line.chars().count() <= 80));
    let written = json(&fs::read_to_string(&path).unwrap());
    let line = growbot(&with(&TO, &["--json"])).out;
    assert_eq!(line.matches('\n').count(), 1);
    assert_eq!(json(&line), written);
    assert_eq!(growbot(&with(&TO, &["--json", "-o", &path])).out, line);
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 1, "something is left beside the plan");

    assert_eq!(written["format"], "growbot-plan/1");
    assert_eq!(written["robot"], "growbot-a");
    assert_eq!(written["planner"], "two-plane");
    assert_eq!(written["robot_hash"].as_str().unwrap().len(), 16);
    assert_eq!(written["start"], json(r#"{"x_mm":0.0,"y_mm":0.0,"z_mm":0.0,"heading_deg":0.0,"pitch_deg":90.0}"#));
    assert_eq!(written["goal"], json(r#"{"x_mm":200.0,"y_mm":100.0,"z_mm":600.0,"heading_deg":0.0,"pitch_deg":45.0}"#));
    assert_eq!(written["duration_s"].as_f64(), Some(833.0 * 18.0));
    assert_eq!(written["path_type"], "CCCSC");
    assert_eq!(written["candidates"], 1);
    assert_eq!(written["two_plane_length_mm"], written["length_mm"]);
    assert_eq!(written["two_plane_longer_percent"], 0.0);
    let absent = ["via", "legs", "passed_over"];
    assert!(absent.iter().all(|field| written.get(field).is_none()), "{written}");
}

fn number(value: &Value, field: &str) -> f64 {
    value[field].as_f64().unwrap_or_else(|| panic!("no number {field} in {value}"))
}

#[test]
fn the_shortest_path_is_the_default_and_never_longer_than_the_two_plane_path() {
    for to in ["200,100,600,0,45", "-150,80,-40,200,-60", "0,0,500,0,90", "0,0,0,0,90", "0,0,30,0,-90"] {
        let plan = json(&growbot(&["plan", "--to", to, "--json"]).out);
        let two_plane = json(&growbot(&["plan", "--to", to, "--json", "--planner", "two-plane"]).out);
        assert_eq!((plan["planner"].as_str(), two_plane["planner"].as_str()), (Some("shortest"), Some("two-plane")));
        assert!(number(&plan, "length_mm") <= number(&two_plane, "length_mm") * (1.0 + 1e-9), "{to}");
        assert_eq!(plan["two_plane_length_mm"], two_plane["length_mm"], "{to}");
        let percent = 100.0 * (number(&two_plane, "length_mm") / number(&plan, "length_mm") - 1.0);
        let percent = if percent.is_finite() { percent } else { 0.0 };
        assert!((number(&plan, "two_plane_longer_percent") - percent).abs() < 1e-6, "{plan}");
        assert!(number(&plan, "candidates") >= 1.0, "{plan}");
        assert_eq!(plan["path_type"].as_str().unwrap().len(), plan["segments"].as_array().unwrap().len());
    }
}

#[test]
fn a_plan_lists_complete_and_statistical_searches() {
    let searched = |planner: &str, to: &str| {
        let plan = json(&growbot(&["plan", "--to", to, "--json", "--planner", planner]).out);
        [plan["complete"].to_string(), plan["statistical"].to_string()]
    };
    assert_eq!(searched("shortest", "600,0,0,0,0"), [r#"["CSC","planar"]"#, "null"]);
    assert_eq!(searched("shortest", "60,40,80,200,-20"), [r#"["CSC","planar"]"#, r#"["H"]"#]);
    assert_eq!(searched("two-plane", "60,40,80,200,-20"), ["null", "null"]);
}

#[test]
fn plans_of_older_versions_are_accepted() {
    let mut plan = json(&growbot(&with(&TO, &["--json"])).out);
    for field in ["path_type", "candidates", "two_plane_length_mm", "two_plane_longer_percent"] {
        assert!(plan.as_object_mut().unwrap().remove(field).is_some(), "{field}");
    }
    let layers = growbot_reading(&["layers", "-"], &plan.to_string());
    assert_eq!((layers.code, layers.out.lines().count()), (Some(0), 834), "{}", layers.err);
}

/// Returns the codes of the warnings of a plan in JSON.
fn codes(plan: &Value) -> Vec<&str> {
    plan["warnings"].as_array().unwrap().iter().map(|warning| warning["code"].as_str().unwrap()).collect()
}

/// Options for a goal behind the start with the same direction. The path of the planner `two-plane` to this goal
/// intersects itself.
const LOOP: [&str; 6] = ["--to", "0,0,-40,0,90", "--planner", "two-plane", "--radius", "100"];

#[test]
fn warnings_are_printed_and_prevent_growing() {
    let ran = growbot(&with(&["plan", "--json"], &LOOP));
    let plan = json(&ran.out);
    assert_eq!(ran.code, Some(0), "a warning is no failure");
    assert!(codes(&plan).contains(&"self-collision"), "{plan}");
    let warning = plan["warnings"].as_array().unwrap().iter().find(|w| w["code"] == "self-collision").unwrap();
    assert!(number(warning, "value") < 45.6 && number(warning, "limit") == 45.6, "{warning}");
    assert!(warning["message"].as_str().unwrap().contains("mm"), "{warning}");
    let table = growbot(&with(&["plan"], &LOOP)).out;
    assert!(table.contains("warning (self-collision): ") && table.lines().all(|line| line.len() <= 80), "{table}");

    // 330 m of filament are enough for 3.6 m of body.
    let long = json(&growbot(&["plan", "--to", "0,0,3600,0,90", "--json"]).out);
    assert_eq!(codes(&long), ["filament-short"]);
    assert_eq!(number(&long["warnings"][0], "limit"), 330_000.0);
    assert_eq!(long["warnings"][0]["value"], long["filament_mm"]);

    for args in [&LOOP[..], &["--to", "0,0,3600,0,90"]] {
        let ran = growbot(&with(&["grow", "--json"], args));
        assert_eq!(ran.code, Some(1), "{}", ran.err);
        assert_eq!(json(&ran.out)["outcome"], "refused");
        assert!(ran.err.contains("--force"), "{}", ran.err);
    }

    // Warnings of a plan that is read from a file are printed only once.
    let layers = growbot_reading(&["grow", "-", "--json"], &plan.to_string());
    assert_eq!(layers.code, Some(1));
    assert_eq!(layers.err.matches("warning: self-collision").count(), 1, "{}", layers.err);
}

#[test]
fn clear_of_self_prefers_a_collision_free_path() {
    for to in ["0,0,-40,0,90", "30,0,-100,0,90", "0,0,150,0,-90", "400,0,300,90,0"] {
        let shortest = json(&growbot(&["plan", "--to", to, "--json"]).out);
        let clear = json(&growbot(&["plan", "--to", to, "--avoid-self-collision", "--json"]).out);
        let collides = |plan: &Value| codes(plan).contains(&"self-collision");
        assert!(number(&clear, "length_mm") >= number(&shortest, "length_mm") * (1.0 - 1e-12));
        assert!(collides(&shortest) || clear == shortest, "{to}: {shortest} is clear");
        assert_eq!(clear.get("passed_over").is_some(), clear["segments"] != shortest["segments"], "{clear}");
        assert!(!collides(&clear) || clear == shortest, "{to}: {clear} is neither clear nor the shortest");
        // For a batch the option applies to every query.
        let queries = format!("{HEADER}\n1,0,0,0,0,90,{to}\n");
        let mut answer =
            json(&growbot_reading(&["plan", "--batch", "-", "--avoid-self-collision", "--json"], &queries).out);
        assert_eq!(answer.as_object_mut().unwrap().remove("id"), Some("1".into()));
        assert_eq!(answer, clear);
    }
}

#[test]
fn waypoints_are_passed_in_order() {
    let via = ["plan", "--via", "200,0,400,0,0", "--via", "600,0,300,0,-45", "--to", "800,0,0,0,-90"];
    let plan = json(&growbot(&with(&via, &["--json"])).out);
    assert_eq!(plan["via"].as_array().unwrap().len(), 2);
    assert_eq!(plan["via"][1], json(r#"{"x_mm":600.0,"y_mm":0.0,"z_mm":300.0,"heading_deg":0.0,"pitch_deg":-45.0}"#));
    let legs = plan["legs"].as_array().unwrap();
    assert_eq!(legs.len(), 3);
    let sum = |field: &str| legs.iter().map(|leg| number(leg, field)).sum::<f64>();
    assert!((sum("length_mm") - number(&plan, "length_mm")).abs() < 1e-9);
    assert!((sum("two_plane_length_mm") - number(&plan, "two_plane_length_mm")).abs() < 1e-9);
    assert_eq!(sum("candidates"), number(&plan, "candidates"));
    assert_eq!(sum("segments") as usize, plan["segments"].as_array().unwrap().len());
    let words: String = legs.iter().map(|leg| leg["path_type"].as_str().unwrap()).collect();
    assert_eq!(plan["path_type"], words);

    let table = growbot(&via).out;
    assert!(table.contains("  via       600, 0, 300 mm") && table.contains("  leg 3 "), "{table}");
    assert!(table.lines().all(|line| line.chars().count() <= 80), "{table}");

    assert_refused(&growbot(&["plan", "--via", "1,2", "--to", "0,0,9,0,90"]), 2, &["--via", "this is 2"]);
    let batch = growbot(&["plan", "--batch", "-", "--json", "--via", "1,2,3,4,5"]);
    assert_refused(&batch, 2, &["--batch", "--via"]);
}

#[test]
fn a_plan_that_misses_its_waypoints_is_refused() {
    let good = growbot(&["plan", "--via", "200,0,400,0,0", "--to", "800,0,0,0,-90", "--json"]).out;
    assert_eq!(growbot_reading(&["layers", "-"], &good).code, Some(0));
    let refused = |change: &dyn Fn(&mut Value), parts: &[&str]| {
        let mut plan = json(&good);
        change(&mut plan);
        assert_refused_in_a_line(&growbot_reading(&["layers", "-"], &plan.to_string()), 2, parts);
    };
    refused(&|plan| plan["via"][0]["x_mm"] = 200.001.into(), &["from via 1", "plan again"]);
    refused(&|plan| plan["via"][0]["pitch_deg"] = 0.1.into(), &["from via 1", "rad"]);
    refused(&|plan| plan["via"][0]["pitch_deg"] = 91.into(), &["via: pitch is 91"]);
    refused(&|plan| drop(plan["legs"].as_array_mut().unwrap().pop()), &["1 legs", "2"]);
    refused(&|plan| drop(plan.as_object_mut().unwrap().remove("via")), &["2 legs"]);
    refused(&|plan| plan["legs"][0]["segments"] = 0.into(), &["number of segments in the legs"]);
    refused(&|plan| plan["legs"][0]["path_type"] = "X".into(), &["path_type is \"X\""]);
    refused(&|plan| plan["legs"][1]["length_mm"] = 1.into(), &["length_mm of a leg is 1"]);
    refused(&|plan| plan["path_type"] = "HHH".into(), &["path_type is \"HHH\""]);
    refused(&|plan| plan["candidates"] = 1_000_000.into(), &["candidates is 1000000"]);
    refused(&|plan| plan["two_plane_longer_percent"] = 99.5.into(), &["two_plane_longer_percent is 99.5"]);
}

#[test]
fn poses_are_parsed_in_common_notations() {
    let plan = json(&growbot(&["plan", "--from", "-1, -2, -3, 190, -90", "--to", "-120,0,400,-30,12.3", "--json"]).out);
    assert_eq!(plan["start"], json(r#"{"x_mm":-1.0,"y_mm":-2.0,"z_mm":-3.0,"heading_deg":-170.0,"pitch_deg":-90.0}"#));
    assert_eq!(plan["goal"]["heading_deg"], -30.0);
    assert_eq!(plan["goal"]["pitch_deg"], 12.3);
    for (pose, part) in [
        ("1,2,3,4", "this is 4"),
        ("1,2,3,4,5,6", "this is 6"),
        ("1,2,x,4,5", "z is \"x\""),
        ("nan,2,3,4,5", "x is NaN"),
        ("1,-inf,3,4,5", "y is -inf"),
        ("1,2,3,4,90.001", "pitch is 90.001 deg"),
        ("1,2,3,4,-91", "pitch is -91 deg"),
        ("2e7,0,0,0,0", "x is 20000000 mm"),
    ] {
        assert_refused(&growbot(&["plan", "--to", pose]), 2, &["--to", part]);
        assert_refused(&growbot(&["plan", "--from", pose, "--to", "0,0,9,0,0"]), 2, &["--from", part]);
    }
    assert_refused(&growbot(&["plan"]), 2, &["--to <POSE>"]);
}

#[test]
fn the_radius_defaults_to_the_robots_and_is_at_least_r_min() {
    let radius = |more: &[&str]| json(&growbot(&with(&with(&TO, &["--json"]), more)).out)["radius_mm"].clone();
    assert_eq!(radius(&[]), 100.0);
    assert_eq!(radius(&["--radius", "98.2"]), 98.2);
    assert_eq!(radius(&["--robot", "growbot-b"]), 680.0);
    for (text, parts) in [
        ("98.1", ["98.1 mm", "R_min = 98.2 mm"]),
        ("-5", ["-5 mm", "R_min = 98.2 mm"]),
        ("nan", ["NaN mm", "at most 1000000 mm"]),
        ("inf", ["inf mm", "at most 1000000 mm"]),
    ] {
        assert_refused_in_a_line(&growbot(&with(&TO, &["--radius", text])), 2, &parts);
    }
    assert_refused(&growbot(&with(&TO, &["--radius", "wide"])), 2, &["--radius", "wide"]);
    assert_refused(&growbot(&with(&TO[..3], &["--planner", "teleport"])), 2, &["teleport", "two-plane"]);
}

#[test]
fn robots_are_given_by_name_or_file() {
    let directory = tempfile::tempdir().unwrap();
    let of = |robot: &str| growbot(&["rmin", "--robot", robot]);
    assert_refused_in_a_line(&of("growbot-9"), 2, &["\"growbot-9\"", "did you mean growbot-", "growbot-a8, growbot-b"]);
    assert_refused_in_a_line(&of("none/robot.toml"), 2, &["none/robot.toml"]);
    assert_refused_in_a_line(&of(&directory.path().display().to_string()), 2, &["directory"]);
    let mine = file(directory.path(), "mine.toml", &ROBOT_A.replace("\"growbot-a\"", "\"mine\""));
    assert!(of(&mine).out.starts_with("mine: R_min is 98.20 mm"));
    for (from, to, parts) in [
        ("height_max_mm", "hieght_max_mm", [", column 1: ", "`hieght_max_mm`", "did you mean height_max_mm?"]),
        ("radius_mm = 100.0", "radius_mm = 90.0", ["planning_radius_mm is 90", "98.2", "R_min"]),
        ("[wall]", "[wall", ["line ", "column ", ""]),
    ] {
        let text = ROBOT_A.replace(from, to);
        assert_ne!(text, ROBOT_A);
        let bad = file(directory.path(), "bad.toml", &text);
        assert_refused_in_a_line(&of(&bad), 2, &with(&parts, &["bad.toml"]));
    }
}

#[test]
fn an_unwritable_plan_is_refused_and_leaves_no_file() {
    let directory = tempfile::tempdir().unwrap();
    let missing = directory.path().join("missing/plan.json").display().to_string();
    let ran = growbot(&with(&TO, &["-o", &missing]));
    assert_refused_in_a_line(&ran, 2, &["cannot write", "plan.json", "does not exist", "missing"]);
    let here = directory.path().display().to_string();
    assert_refused_in_a_line(&growbot(&with(&TO, &["-o", &here])), 2, &["cannot write", "directory"]);
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0);
}

#[test]
fn plan_files_of_other_robots_and_other_files_are_refused() {
    let directory = tempfile::tempdir().unwrap();
    let good = growbot(&with(&TO, &["--json"])).out;
    let layers = |text: &str| growbot(&["layers", &file(directory.path(), "p.json", text)]);
    assert_eq!(layers(&good).code, Some(0));
    let hash = json(&good)["robot_hash"].as_str().unwrap().to_owned();
    let changed = |from: &str, to: &str| {
        assert!(good.contains(from), "{from} in {good}");
        layers(&good.replacen(from, to, 1))
    };
    assert_refused_in_a_line(&growbot(&["layers", "none.json"]), 2, &["cannot read none.json"]);
    assert_refused_in_a_line(&layers(&good[..400]), 2, &["p.json", "ends in the middle", "line 1"]);
    assert_refused_in_a_line(&layers(""), 2, &["ends in the middle"]);
    assert_refused_in_a_line(&layers("solid cube"), 2, &["not JSON", "line 1 column 1"]);
    assert_refused_in_a_line(&layers("{\"a\":1}"), 2, &["is not a plan", "format"]);
    assert_refused_in_a_line(
        &changed("plan/1", "plan/2"),
        2,
        &["\"growbot-plan/2\"", "\"growbot-plan/1\"", "plan again"],
    );
    assert_refused_in_a_line(&changed("\"arc\"", "\"spiral\""), 2, &["spiral", "helicoid"]);
    assert_refused_in_a_line(&changed("\"goal\"", "\"gaol\""), 2, &["gaol"]);
    assert_refused_in_a_line(&changed(&hash, "0123456789abcdef"), 2, &["0123456789abcdef", &hash, "growbot-a"]);
    assert_refused_in_a_line(&changed("growbot-a\"", "growbot-b\""), 2, &["\"growbot-b\"", "\"growbot-a\""]);
    assert_refused_in_a_line(&changed("growbot-a\"", "my-own\""), 2, &["\"my-own\"", "\"growbot-a\"", "--robot"]);
    assert_refused_in_a_line(&changed("\"z_mm\":600.0", "\"z_mm\":600.001"), 2, &["from the goal", "mm"]);
    assert_refused_in_a_line(&changed("\"pitch_deg\":45.0", "\"pitch_deg\":95.0"), 2, &["goal", "95 deg", "90"]);
    assert_refused_in_a_line(&changed("\"radius_mm\":100.0", "\"radius_mm\":90.0"), 2, &["radius_mm is 90", "98.2"]);
    assert_refused_in_a_line(&changed("\"layers\":833", "\"layers\":933"), 2, &["layers is 933", "833"]);
    assert_refused_in_a_line(&changed("\"beta_deg\":", "\"beta_deg\":-"), 2, &["beta_deg of segment 0 is -"]);
    assert_refused_in_a_line(&changed("\"beta_deg\":3", "\"beta_deg\":4"), 2, &["segment 0", "R_min = 98.2 mm"]);
    assert_refused_in_a_line(&changed("\"length_mm\":6", "\"length_mm\":1e999,\"x\":6"), 2, &["out of range"]);

    let path = file(directory.path(), "p.json", &good);
    let other = growbot(&["layers", &path, "--robot", "growbot-b"]);
    assert_refused_in_a_line(&other, 2, &["\"growbot-a\"", "\"growbot-b\""]);
}

#[test]
fn plans_embed_a_custom_robot_and_older_ones_need_its_file() {
    let directory = tempfile::tempdir().unwrap();
    let robot = file(directory.path(), "mine.toml", &ROBOT_A.replace("\"growbot-a\"", "\"mine\""));
    let plan = growbot(&with(&TO, &["--json", "--robot", &robot])).out;
    let mut older = json(&plan);
    older.as_object_mut().unwrap().remove("robot_description").unwrap();
    let older = older.to_string();
    let refused = growbot_reading(&["layers", "-"], &older);
    assert_refused_in_a_line(&refused, 2, &["standard input", "\"mine\"", "--robot"]);
    for (args, plan) in [(&["layers", "-", "--robot", &robot][..], &older), (&["layers", "-"], &plan)] {
        let layers = growbot_reading(args, plan);
        assert_eq!((layers.code, layers.out.lines().count()), (Some(0), 834));
    }
}

#[test]
fn batch_results_are_in_order_and_errors_do_not_stop_the_batch() {
    let line = |id: &str, z: &str, more: &str| format!("{id},0,0,0,0,90,0,0,{z},0,90{more}\n");
    let good: String = (0..300).map(|i| line(&format!("q{i}"), &(300 + i).to_string(), "")).collect();
    let ran = growbot_reading(&["plan", "--batch", "-", "--json"], &format!("{HEADER}\n{good}"));
    assert_eq!((ran.code, ran.err.as_str()), (Some(0), ""));
    for (i, answer) in ran.out.lines().enumerate() {
        let answer = json(answer);
        assert_eq!(answer["id"], format!("q{i}"));
        assert_eq!(answer["goal"]["z_mm"].as_f64(), Some(300.0 + i as f64));
    }
    // A line of a batch is the output of the single command with an id.
    let mut first = json(ran.out.lines().next().unwrap());
    first.as_object_mut().unwrap().remove("id");
    assert_eq!(first, json(&growbot(&["plan", "--to", "0,0,300,0,90", "--json"]).out));

    let mixed = [
        line("a", "500", ",150,"),
        line("b", "up", ",,"),
        line("c", "500", ",20,"),
        line("d", "500", ",,shortest-ish"),
        "e,1,2\n".to_owned(),
        line("f", "500", ",,two-plane"),
    ];
    let queries = format!("{HEADER},radius_mm,planner\n{}", mixed.concat());
    let ran = growbot_reading(&["plan", "--batch", "-", "--json", "--radius", "120"], &queries);
    assert_eq!(ran.code, Some(1));
    assert!(ran.err.contains("4 of 6 queries failed"), "{}", ran.err);
    let answers: Vec<Value> = ran.out.lines().map(json).collect();
    let told: Vec<(&str, Option<f64>)> =
        answers.iter().map(|answer| (answer["id"].as_str().unwrap(), answer["radius_mm"].as_f64())).collect();
    let expected = [("a", Some(150.0)), ("b", None), ("c", None), ("d", None), ("e", None), ("f", Some(120.0))];
    assert_eq!(told, expected);
    for (answer, part) in answers[1..5].iter().zip(["to_z_mm is \"up\"", "R_min = 98.2 mm", "shortest-ish", "3 fields"])
    {
        assert_eq!(answer.as_object().unwrap().len(), 2);
        assert!(answer["error"].as_str().unwrap().contains(part), "{answer}");
    }
}

#[test]
fn an_id_is_returned_unchanged_with_control_characters_escaped() {
    let id = "a\u{1b}[31m\u{7}\u{7f}\u{9b}2J\u{202e}\u{2066}\u{2028}\tb\u{e4}";
    let rows = format!("{HEADER}\n{id},0,0,0,0,90,0,0,500,0,90\n{id},0,0,0,0,90,0,0,500,0,95\n");
    let ran = growbot_reading(&["plan", "--batch", "-", "--json"], &rows);
    assert_eq!(ran.out.lines().count(), 2, "{}", ran.out);
    for line in ran.out.lines() {
        assert_eq!(json(line)["id"], id, "{line}");
        assert!(!line.contains(growbot_plan::sanitize::is_control), "{line:?}");
        assert!(line.contains("\\u009b2J\\u202e\\u2066\\u2028\\tb\u{e4}"), "{line}");
    }
}

#[test]
fn a_batch_that_cannot_start_is_refused() {
    let batch = |text: &str| growbot_reading(&["plan", "--batch", "-", "--json"], text);
    assert_refused_in_a_line(&batch(""), 2, &["standard input", "no column id"]);
    assert_refused_in_a_line(&batch(&HEADER.replace(",to_x_mm", "")), 2, &["no column to_x_mm"]);
    assert_refused_in_a_line(&batch(&HEADER.replace("to_x_mm", "to_x")), 2, &["\"to_x\"", "did you mean to_x_mm?"]);
    assert_refused_in_a_line(&batch(&format!("{HEADER},id")), 2, &["column id twice"]);
    assert_eq!(batch(HEADER).code, Some(0), "no queries are no fault");
    let refused = |more: &[&str]| growbot(&with(&["plan", "--batch", "none.csv"], more));
    assert_refused_in_a_line(&refused(&["--json"]), 2, &["cannot read none.csv"]);
    assert_refused_in_a_line(&refused(&["--json", "--radius", "5"]), 2, &["5 mm", "98.2 mm"]);
    assert_refused(&refused(&["--json", "--to", "0,0,9,0,90"]), 2, &["--batch", "--to"]);
    assert_refused(&refused(&["--json", "--via", "0,0,9,0,90"]), 2, &["--batch", "--via"]);
}

#[cfg(unix)]
#[test]
fn a_closed_standard_output_ends_the_command_silently() {
    use std::io::{BufRead, BufReader};
    use std::process::Stdio;
    let directory = tempfile::tempdir().unwrap();
    let rows: String = (0..20_000).map(|i| format!("{i},0,0,0,0,90,0,0,500,0,90\n")).collect();
    let queries = file(directory.path(), "q.csv", &format!("{HEADER}\n{rows}"));
    let plan = directory.path().join("p.json").display().to_string();
    assert_eq!(growbot(&["plan", "--to", "100000,0,0,0,0", "-o", &plan]).code, Some(0));
    for args in [&["plan", "--batch", &queries, "--json"][..], &["layers", &plan]] {
        let mut child = command(PROGRAM).args(args).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        let mut first = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut first).unwrap();
        let ended = child.wait_with_output().unwrap();
        assert_eq!((ended.status.code(), String::from_utf8(ended.stderr).unwrap().as_str()), (Some(0), ""), "{args:?}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_reported() {
    let full = || fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let ran = command(PROGRAM).args(with(&TO, &["--json"])).stdout(full()).output().unwrap();
    assert_eq!(ran.status.code(), Some(2));
    assert!(String::from_utf8(ran.stderr).unwrap().starts_with("error: cannot write to standard output"));
}

#[test]
fn workspace_prints_a_table_a_line_or_a_picture() {
    let directory = tempfile::tempdir().unwrap();
    let picture = directory.path().join("reach.svg").display().to_string();
    let any = ["workspace", "--length", "1000", "--planner", "two-plane"];
    let ran = growbot(&with(&any, &["-o", &picture]));
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert!(ran.out.contains("ahead       1000 mm") && ran.out.contains("900 -  1000"), "{}", ran.out);
    assert!(ran.out.lines().all(|line| line.len() <= 80), "{}", ran.out);
    let svg = fs::read_to_string(&picture).unwrap();
    assert!(svg.starts_with("<svg xmlns=") && svg.ends_with("</svg>\n") && svg.len() < 1_000_000);
    assert!(!svg.contains("NaN") && !svg.contains("inf"));

    let told = json(&growbot(&with(&any, &["--json"])).out);
    assert_eq!(told, json(&growbot(&with(&any, &["--json"])).out), "the same question has the same answer");
    assert_eq!((number(&told, "ahead_mm"), number(&told, "radius_mm")), (1000.0, 100.0));
    assert_eq!(told["shares"].as_array().unwrap().len(), 10);
    assert!(number(&told, "behind_mm") < number(&told, "aside_towards_x_mm"));

    let down = growbot(&with(&any, &["--heading", "0", "--pitch", "-90", "--json"]));
    let down = json(&down.out);
    assert!(number(&down, "volume_mm3") < number(&told, "volume_mm3") && number(&down, "volume_error_mm3") > 0.0);
    assert_eq!(down["directions"], 1);
    // A goal that is reported as reachable has a plan of that length.
    let goal = format!("0,0,{},0,-90", number(&down, "ahead_mm"));
    let plan = json(&growbot(&["plan", "--to", &goal, "--planner", "two-plane", "--json"]).out);
    assert!(number(&plan, "length_mm") <= 1000.0, "{plan}");

    let refused =
        |more: &[&str], parts: &[&str]| assert_refused_in_a_line(&growbot(&with(&["workspace"], more)), 2, parts);
    refused(&["--length", "0"], &["length of the body is 0 mm", "1000000 mm"]);
    refused(&["--length", "nan"], &["length of the body is NaN mm"]);
    refused(&["--radius", "50"], &["50 mm", "R_min = 98.2 mm"]);
    refused(&["--heading", "0", "--pitch", "91"], &["pitch is 91 deg"]);
    refused(&["--length", "100", "-o", "-", "--json"], &["both go to standard output"]);
    refused(&["--length", "100", "-o", "/no/such/place.svg"], &["directory /no/such does not exist"]);
    assert_refused(&growbot(&["workspace", "--heading", "0"]), 2, &["--pitch"]);
}

#[test]
fn no_plan_exceeds_the_maximum_length() {
    let goal = ["plan", "--to", "200,100,600,0,45"];
    assert_eq!(growbot(&with(&goal, &["--max-length", "700"])).code, Some(0));
    let refused = growbot(&with(&goal, &["--max-length", "640"]));
    assert_refused_in_a_line(
        &refused,
        1,
        &["the shortest path found is 64", "--max-length is 640 mm", "raise --max-length"],
    );
    assert_refused(&growbot(&with(&goal, &["--max-length", "0"])), 2, &["above 0"]);
    // In a batch the limit applies to each query.
    let queries = "id,to_x_mm,to_y_mm,to_z_mm\nnear,0,0,300\nfar,0,0,800\n";
    let ran = growbot_reading(&["plan", "--batch", "-", "--json", "--max-length", "700"], queries);
    assert_eq!(ran.code, Some(1), "{}", ran.err);
    let answers: Vec<Value> = ran.out.lines().map(json).collect();
    assert_eq!((number(&answers[0], "length_mm"), answers[0].get("error")), (300.0, None));
    let error = answers[1]["error"].as_str().unwrap();
    assert!(error.contains("800.0 mm long") && error.contains("--max-length is 700 mm"), "{error}");
    let directory = tempfile::tempdir().unwrap();
    let ball = "format = \"growbot-scene/1\"\n[[ball]]\ncenter_mm = [0, 0, 300]\nradius_mm = 60\n";
    let scene = file(directory.path(), "scene.toml", ball);
    let goal = ["plan", "--to", "0,0,700", "--effort", "1", "--scene", &scene];
    assert_eq!(growbot(&with(&goal, &["--max-length", "800"])).code, Some(0));
    let refused = growbot(&with(&goal, &["--max-length", "600"]));
    assert_refused_in_a_line(
        &refused,
        1,
        &["the goal is 700 mm from the start of its leg", "only 600 mm of --max-length"],
    );
}
