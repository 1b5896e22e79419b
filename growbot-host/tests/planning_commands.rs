//! `growbot rmin`, `plan` and `layers` as users and scripts meet them: results, exit codes, messages.

mod running;

use std::fs;
use std::path::Path;

use running::{Ran, growbot, growbot_reading};
use serde_json::Value;

const TO: [&str; 3] = ["plan", "--to", "200,100,600,0,45"];
const HEADER: &str = "id,from_x_mm,from_y_mm,from_z_mm,from_heading_deg,from_pitch_deg,to_x_mm,to_y_mm,to_z_mm,to_heading_deg,to_pitch_deg";
const ROBOT_A: &str = include_str!("../../robots/growbot-a.toml");

fn json(text: &str) -> Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

fn with<'a>(args: &[&'a str], more: &[&'a str]) -> Vec<&'a str> {
    args.iter().chain(more).copied().collect()
}

/// The run ended with this code, nothing on standard output, and all these parts in what it said.
#[track_caller]
fn assert_refused(ran: &Ran, code: i32, parts: &[&str]) {
    assert_eq!((ran.code, ran.out.as_str()), (Some(code), ""), "{}", ran.err);
    for part in parts {
        assert!(ran.err.contains(part), "no {part:?} in {:?}", ran.err);
    }
    assert!(!ran.err.contains("panicked"), "{}", ran.err);
}

/// As [`assert_refused`], and the message is one line that says who speaks.
#[track_caller]
fn assert_refused_in_a_line(ran: &Ran, code: i32, parts: &[&str]) {
    assert_refused(ran, code, parts);
    assert!(ran.err.starts_with("growbot: ") && ran.err.matches('\n').count() == 1, "{:?}", ran.err);
}

/// A text file in a directory of the test's own.
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
    for args in [&["--help"][..], &["rmin", "--help"], &["plan", "--help"], &["plan", "-h"], &["layers", "--help"]] {
        let ran = growbot(args);
        assert!(ran.out.contains("Usage: growbot") && ran.out.contains("Example"), "{}", ran.out);
        assert!(ran.out.lines().all(|line| line.chars().count() <= 80), "{}", ran.out);
    }
}

#[test]
fn a_plan_is_a_table_a_line_or_a_file() {
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
}

#[test]
fn poses_are_read_as_people_type_them() {
    let plan = json(&growbot(&["plan", "--from", "-1, -2, -3, 190, -90", "--to", "-120,0,400,-30,12.3", "--json"]).out);
    assert_eq!(plan["start"], json(r#"{"x_mm":-1.0,"y_mm":-2.0,"z_mm":-3.0,"heading_deg":-170.0,"pitch_deg":-90.0}"#));
    assert_eq!(plan["goal"]["heading_deg"], -30.0);
    assert_eq!(plan["goal"]["pitch_deg"], 12.3);
    for (pose, part) in [
        ("1,2,3", "this is 3"),
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
fn a_radius_is_the_robots_or_at_least_r_min() {
    let radius = |more: &[&str]| json(&growbot(&with(&with(&TO, &["--json"]), more)).out)["radius_mm"].clone();
    assert_eq!(radius(&[]), 100.0);
    assert_eq!(radius(&["--radius", "98.2"]), 98.2);
    assert_eq!(radius(&["--robot", "growbot-b"]), 680.0);
    for (text, parts) in [
        ("98.1", ["98.1 mm", "R_min = 98.2 mm"]),
        ("-5", ["-5 mm", "R_min = 98.2 mm"]),
        ("nan", ["NaN mm", "up to 1000000 mm"]),
        ("inf", ["inf mm", "up to 1000000 mm"]),
    ] {
        assert_refused_in_a_line(&growbot(&with(&TO, &["--radius", text])), 2, &parts);
    }
    assert_refused(&growbot(&with(&TO, &["--radius", "wide"])), 2, &["--radius", "wide"]);
    assert_refused(&growbot(&with(&TO, &["--planner", "teleport"])), 2, &["teleport", "two-plane"]);
}

#[test]
fn robots_come_by_name_or_from_files() {
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
fn a_plan_that_cannot_be_written_is_refused_and_leaves_nothing() {
    let directory = tempfile::tempdir().unwrap();
    let missing = directory.path().join("missing/plan.json").display().to_string();
    let ran = growbot(&with(&TO, &["-o", &missing]));
    assert_refused_in_a_line(&ran, 2, &["cannot write", "plan.json", "no directory", "missing"]);
    let here = directory.path().display().to_string();
    assert_refused_in_a_line(&growbot(&with(&TO, &["-o", &here])), 2, &["cannot write", "directory"]);
    assert_refused_in_a_line(&growbot(&with(&TO, &["-o", "-"])), 2, &["--json"]);
    assert_eq!(fs::read_dir(directory.path()).unwrap().count(), 0);
}

#[test]
fn files_that_are_no_plan_of_this_robot_are_refused() {
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
    assert_refused_in_a_line(&layers(&good[..400]), 2, &["p.json", "stops in the middle", "line 1"]);
    assert_refused_in_a_line(&layers(""), 2, &["stops in the middle"]);
    assert_refused_in_a_line(&layers("solid cube"), 2, &["no JSON", "line 1 column 1"]);
    assert_refused_in_a_line(&layers("{\"a\":1}"), 2, &["no plan", "format"]);
    assert_refused_in_a_line(
        &changed("plan/1", "plan/2"),
        2,
        &["\"growbot-plan/2\"", "\"growbot-plan/1\"", "plan again"],
    );
    assert_refused_in_a_line(&changed("\"arc\"", "\"helicoid\""), 2, &["helicoid", "arc"]);
    assert_refused_in_a_line(&changed("\"goal\"", "\"gaol\""), 2, &["gaol"]);
    assert_refused_in_a_line(&changed(&hash, "0123456789abcdef"), 2, &["0123456789abcdef", &hash, "growbot-a"]);
    assert_refused_in_a_line(&changed("growbot-a\"", "growbot-b\""), 2, &["growbot-b", &hash]);
    assert_refused_in_a_line(&changed("growbot-a\"", "my-own\""), 2, &["\"my-own\"", "--robot FILE"]);
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
fn plans_of_ones_own_robot_need_its_file() {
    let directory = tempfile::tempdir().unwrap();
    let robot = file(directory.path(), "mine.toml", &ROBOT_A.replace("\"growbot-a\"", "\"mine\""));
    let plan = growbot(&with(&TO, &["--json", "--robot", &robot])).out;
    assert_refused_in_a_line(
        &growbot_reading(&["layers", "-"], &plan),
        2,
        &["standard input", "\"mine\"", "--robot FILE"],
    );
    let layers = growbot_reading(&["layers", "-", "--robot", &robot], &plan);
    assert_eq!((layers.code, layers.out.lines().count()), (Some(0), 834));
}

#[test]
fn a_batch_is_answered_in_order_and_faults_do_not_stop_it() {
    let line = |id: &str, z: &str, more: &str| format!("{id},0,0,0,0,90,0,0,{z},0,90{more}\n");
    let good: String = (0..300).map(|i| line(&format!("q{i}"), &(300 + i).to_string(), "")).collect();
    let ran = growbot_reading(&["plan", "--batch", "-", "--json"], &format!("{HEADER}\n{good}"));
    assert_eq!((ran.code, ran.err.as_str()), (Some(0), ""));
    for (i, answer) in ran.out.lines().enumerate() {
        let answer = json(answer);
        assert_eq!(answer["id"], format!("q{i}"));
        assert_eq!(answer["goal"]["z_mm"].as_f64(), Some(300.0 + i as f64));
    }
    // One answer is what the single command prints, and the id.
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
fn a_batch_that_cannot_start_is_refused() {
    let batch = |text: &str| growbot_reading(&["plan", "--batch", "-", "--json"], text);
    assert_refused_in_a_line(&batch(""), 2, &["standard input", "no column id"]);
    assert_refused_in_a_line(&batch(&HEADER.replace(",to_x_mm", "")), 2, &["no column to_x_mm"]);
    assert_refused_in_a_line(&batch(&HEADER.replace("to_x_mm", "to_x")), 2, &["\"to_x\"", "did you mean to_x_mm?"]);
    assert_refused_in_a_line(&batch(&format!("{HEADER},id")), 2, &["column id twice"]);
    assert_eq!(batch(HEADER).code, Some(0), "no queries are no fault");
    let refused = |more: &[&str]| growbot(&with(&["plan", "--batch", "none.csv"], more));
    assert_refused_in_a_line(&refused(&["--json"]), 2, &["cannot read none.csv"]);
    assert_refused_in_a_line(&refused(&[]), 2, &["--json"]);
    assert_refused_in_a_line(&refused(&["--json", "--radius", "5"]), 2, &["5 mm", "98.2 mm"]);
    assert_refused(&refused(&["--json", "--to", "0,0,9,0,90"]), 2, &["--batch", "--to"]);
    assert_refused(&refused(&["--json", "-o", "x.json"]), 2, &["--batch", "--output"]);
}

#[cfg(unix)]
#[test]
fn a_reader_that_goes_away_ends_the_work_quietly() {
    use std::io::{BufRead, BufReader};
    use std::process::{Command, Stdio};
    let directory = tempfile::tempdir().unwrap();
    let rows: String = (0..20_000).map(|i| format!("{i},0,0,0,0,90,0,0,500,0,90\n")).collect();
    let queries = file(directory.path(), "q.csv", &format!("{HEADER}\n{rows}"));
    let plan = directory.path().join("p.json").display().to_string();
    assert_eq!(growbot(&["plan", "--to", "100000,0,0,0,0", "-o", &plan]).code, Some(0));
    for args in [&["plan", "--batch", &queries, "--json"][..], &["layers", &plan]] {
        let mut child = Command::new(env!("CARGO_BIN_EXE_growbot"))
            .args(args)
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut first = String::new();
        BufReader::new(child.stdout.take().unwrap()).read_line(&mut first).unwrap();
        let ended = child.wait_with_output().unwrap();
        assert_eq!((ended.status.code(), String::from_utf8(ended.stderr).unwrap().as_str()), (Some(0), ""), "{args:?}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_told() {
    use std::process::Command;
    let full = || fs::OpenOptions::new().write(true).open("/dev/full").unwrap();
    let ran = Command::new(env!("CARGO_BIN_EXE_growbot")).args(with(&TO, &["--json"])).stdout(full()).output().unwrap();
    assert_eq!(ran.status.code(), Some(2));
    assert!(String::from_utf8(ran.stderr).unwrap().starts_with("growbot: cannot write to standard output"));
}
