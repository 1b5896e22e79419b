//! Tests of existing and missing files. A run log replaces an existing file only with `--overwrite`. `-` is standard
//! input or output in all commands, and missing directories are created.
#![cfg(unix)]

use crate::running;

use std::fs;
use std::path::Path;

use running::{PROGRAM, command, growbot, growbot_reading, in_lines};
use serde_json::Value;
use tempfile::TempDir;

/// A directory in which commands run.
struct Place(TempDir);

impl Place {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_owned()
    }

    /// Runs growbot in the directory. Returns its exit code, standard output and standard error.
    fn run(&self, args: &[&str]) -> (Option<i32>, String, String) {
        let ran = command(PROGRAM).args(args).current_dir(self.0.path()).output().unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        (ran.status.code(), text(ran.stdout), in_lines(&text(ran.stderr)))
    }

    fn names(&self) -> Vec<String> {
        names(self.0.path())
    }
}

fn names(directory: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

const SHORT: [&str; 3] = ["grow", "--to", "0,0,5,0,90"];

#[test]
fn a_run_log_is_replaced_only_with_overwrite_and_a_started_growth() {
    let place = Place::new();
    fs::write(place.path("run.jsonl"), "before\n").unwrap();
    let log = ["--log", "run.jsonl"];
    let (code, _, err) = place.run(&[&SHORT[..], &log].concat());
    assert!(code == Some(2) && err.contains("run.jsonl already exists") && err.contains("--overwrite"), "{err}");
    assert_eq!(fs::read_to_string(place.path("run.jsonl")).unwrap(), "before\n");
    // No board responds there, so the growth does not begin.
    let (code, ..) = place.run(&[&SHORT[..], &log, &["--overwrite", "--port", "tcp:127.0.0.1:1"]].concat());
    assert_eq!(code, Some(2));
    assert_eq!(fs::read_to_string(place.path("run.jsonl")).unwrap(), "before\n");
    let (code, _, err) = place.run(&[&SHORT[..], &log, &["--overwrite"]].concat());
    assert_eq!(code, Some(0), "{err}");
    let text = fs::read_to_string(place.path("run.jsonl")).unwrap();
    assert!(text.starts_with("{\"event\":\"header\"") && text.contains("\"event\":\"end\""), "{text}");
    assert_eq!(place.names(), ["run.jsonl"]);
    // A symbolic link stays, and its target is replaced.
    std::os::unix::fs::symlink(place.path("run.jsonl"), place.path("link.jsonl")).unwrap();
    let (code, _, err) = place.run(&[&SHORT[..], &["--log", "link.jsonl", "--overwrite"]].concat());
    assert_eq!(code, Some(0), "{err}");
    assert!(fs::symlink_metadata(place.path("link.jsonl")).unwrap().is_symlink());
    assert_ne!(fs::read_to_string(place.path("run.jsonl")).unwrap(), text);
}

#[test]
fn each_run_log_without_a_name_gets_a_unique_one() {
    let place = Place::new();
    for count in 1..=3 {
        let (code, _, err) = place.run(&[&SHORT[..], &["--log"]].concat());
        assert_eq!(code, Some(0), "{err}");
        let names = place.names();
        assert_eq!(names.len(), count, "{names:?}");
        assert!(names.iter().any(|name| err.contains(name.as_str())), "{err}");
        for name in names {
            let stamp = name.strip_prefix("growth-").and_then(|rest| rest.strip_suffix(".jsonl")).unwrap();
            assert_eq!((&stamp[4..5], &stamp[10..11]), ("-", "T"), "{name}");
            assert!(stamp[11..17].chars().all(|digit| digit.is_ascii_digit()), "{name}");
        }
    }
}

#[test]
fn a_dash_means_standard_output_for_every_output_file() {
    let place = Place::new();
    assert_eq!(place.run(&["plan", "--to", "0,0,50,0,90", "-o", "plan.json"]).0, Some(0));
    let plan = fs::read_to_string(place.path("plan.json")).unwrap();
    let layers = place.run(&["layers", "plan.json"]).1;
    fs::write(place.path("queries.csv"), "id,to_x_mm,to_y_mm,to_z_mm\na,0,0,100\n").unwrap();
    for (args, begins) in [
        (&["plan", "--to", "0,0,50,0,90", "-o", "-"][..], &*plan),
        (&["plan", "--to", "0,0,50,0,90", "--json", "-o", "-"], "{\"format\""),
        (&["plan", "--batch", "queries.csv", "-o", "-"], "id,"),
        (&["layers", "plan.json", "-o", "-"], &*layers),
        (&["view", "plan.json", "-o", "-"], "<!doctype html>"),
        (&["view", "plan.json", "--svg", "-o", "-"], "<svg"),
        (&["export", "plan.json", "--format", "csv", "-o", "-"], "laid,"),
        (&["workspace", "--length", "200", "-o", "-"], "<svg"),
        (&["new-robot", "-o", "-"], "# my-robot"),
        (&["grow", "plan.json", "--log", "-"], "{\"event\":\"header\""),
    ] {
        let (code, out, err) = place.run(args);
        assert_eq!(code, Some(0), "{args:?}: {err}");
        assert!(out.to_lowercase().starts_with(&begins.to_lowercase()), "{args:?}: {}", &out[..out.len().min(200)]);
        assert!(!err.contains("written"), "{args:?}: {err}");
    }
    let (_, out, _) = place.run(&["grow", "plan.json", "--log", "-"]);
    assert!(out.lines().all(|line| line.starts_with('{') && line.ends_with('}')), "{out}");
    assert!(out.lines().last().unwrap().contains("\"event\":\"end\""), "{out}");
    assert_eq!(place.names(), ["plan.json", "queries.csv"]);
    // Output that would be there twice, or that cannot go to standard output, is refused.
    for args in [
        &["grow", "plan.json", "--log", "-", "--json"][..],
        &["workspace", "--length", "200", "-o", "-", "--json"],
        &["man", "-o", "-"],
        &["reproduce", "-o", "-"],
    ] {
        let (code, out, err) = place.run(args);
        assert!(code == Some(2) && out.is_empty() && err.contains("standard output"), "{args:?}: {err}");
    }
}

#[test]
fn a_dash_means_standard_input_for_at_most_one_input_file() {
    let place = Place::new();
    assert_eq!(place.run(&["plan", "--to", "0,0,50,0,90", "-o", "plan.json"]).0, Some(0));
    assert_eq!(place.run(&["grow", "plan.json", "--log", "run.jsonl"]).0, Some(0));
    let plan = fs::read_to_string(place.path("plan.json")).unwrap();
    let log = fs::read_to_string(place.path("run.jsonl")).unwrap();
    let robot = include_str!("../../robots/growbot-b.toml");
    for (args, input) in [
        (&["layers", "-"][..], &*plan),
        (&["simulate", "-"], &plan),
        (&["grow", "-"], &plan),
        (&["view", "-", "-o", "-"], &plan),
        (&["view", "-", "--svg", "-o", "-"], &log),
        (&["export", "-", "--format", "csv"], &plan),
        (&["replay", "-"], &log),
        (&["rmin", "--robot", "-"], robot),
        (&["robots", "-"], robot),
        (&["plan", "--via-csv", "-", "--to", "0,0,500,0,90"], "x,y,z\n0,0,250\n"),
        (&["plan", "--batch", "-"], "id,to_x_mm,to_y_mm,to_z_mm\na,0,0,100\n"),
    ] {
        let ran = growbot_reading(args, input);
        assert_eq!(ran.code, Some(0), "{args:?}: {}", ran.err);
        assert!(!ran.out.is_empty(), "{args:?}");
    }
    // `resume` reads a plan from standard input too, but a simulated board has nothing to resume.
    let ran = growbot_reading(&["resume", "-", "--yes"], &plan);
    assert!(ran.code == Some(1) && ran.err.contains("no unfinished body"), "{}", ran.err);
    let ran = growbot_reading(&["resume", "-", "--yes"], &log);
    assert!(ran.code == Some(2) && ran.err.contains("continued in its own file"), "{}", ran.err);
    for args in [&["layers", "-", "--robot", "-"][..], &["view", "--compare", "-", "-", "-o", "-"]] {
        let ran = growbot_reading(args, &plan);
        assert!(ran.code == Some(2) && ran.err.contains("can be only one"), "{args:?}: {}", ran.err);
    }
    let ran = growbot_reading(&["new-robot", "--base", "-"], robot);
    assert!(ran.code == Some(2) && ran.err.contains("standard input"), "{}", ran.err);
}

#[test]
fn directories_are_created_but_not_their_parents() {
    let place = Place::new();
    fs::write(place.path("file"), "").unwrap();
    let commands: [&[&str]; 2] = [&["man", "-o"], &["reproduce", "--table", "1", "--repeat", "2", "-o"]];
    for (index, args) in commands.into_iter().enumerate() {
        let new = format!("new{index}");
        for _ in 0..2 {
            let (code, _, err) = place.run(&[args, &[&new]].concat());
            assert_eq!(code, Some(0), "{args:?}: {err}");
            let count = names(&place.0.path().join(&new)).len();
            assert!(count > 0 && err.contains(&format!("{count} files written to {new}")), "{args:?}: {err}");
        }
        let (code, _, err) = place.run(&[args, &["missing/new"]].concat());
        assert!(code == Some(2) && err.contains("directory missing does not exist"), "{args:?}: {err}");
        let (code, _, err) = place.run(&[args, &["file"]].concat());
        assert!(code == Some(2) && err.contains("file is a file"), "{args:?}: {err}");
    }
}

#[test]
fn layers_are_written_in_the_format_of_the_file() {
    let place = Place::new();
    assert_eq!(place.run(&["plan", "--to", "0,0,50,0,90", "-o", "plan.json"]).0, Some(0));
    let (code, out, err) = place.run(&["layers", "plan.json", "-o", "layers.csv"]);
    assert!(code == Some(0) && out.is_empty() && err.contains("written to layers.csv"), "{out} {err}");
    assert_eq!(fs::read_to_string(place.path("layers.csv")).unwrap(), place.run(&["layers", "plan.json"]).1);
    for (args, listed) in [
        (&["layers", "plan.json", "-o", "layers.json"][..], ".csv"),
        (&["layers", "plan.json", "--json", "-o", "layers.csv"], ".json"),
        (&["plan", "--to", "0,0,50,0,90", "-o", "plan.txt"], ".json"),
        (&["view", "plan.json", "-o", "plan.doc"], ".html, .svg, .png or .pdf"),
        (&["grow", "plan.json", "--log", "run.log"], ".jsonl or .json"),
        (&["export", "plan.json", "--format", "stl", "-o", "body.solid"], ".stl"),
    ] {
        let (code, out, err) = place.run(args);
        assert!(
            code == Some(2) && out.is_empty() && err.contains(&format!("is not supported here; use {listed}")),
            "{args:?}: {err}"
        );
    }
    assert_eq!(growbot(&["layers", &place.path("plan.json"), "-o", "/dev/null"]).code, Some(0));
}

#[test]
fn a_plan_with_its_layers_is_read_like_a_plan() {
    let place = Place::new();
    assert_eq!(place.run(&["plan", "--to", "60,20,80,0,60", "-o", "plan.json"]).0, Some(0));
    let (code, _, err) = place.run(&["layers", "plan.json", "--json", "-o", "layers.json"]);
    assert_eq!(code, Some(0), "{err}");
    assert_eq!(place.run(&["layers", "layers.json"]).1, place.run(&["layers", "plan.json"]).1);
    let grown = |plan: &str| -> Value { serde_json::from_str(&place.run(&["grow", plan, "--json"]).1).unwrap() };
    assert_eq!(grown("layers.json")["as_built_hash"], grown("plan.json")["as_built_hash"]);
    assert_eq!(place.run(&["view", "layers.json", "-o", "view.svg"]).0, Some(0));

    let text = fs::read_to_string(place.path("layers.json")).unwrap();
    let whole: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(whole["layer_table"].as_array().unwrap().len() as u64, whole["layers"].as_u64().unwrap());
    type Change = fn(&mut Vec<Value>);
    let changes: [(Change, &str); 3] = [
        (|rows| rows[3]["height_mm"] = 0.5.into(), "row 3 of layer_table"),
        (|rows| drop(rows.pop()), "of layer_table"),
        (|rows| rows.push(rows[0].clone()), "of layer_table"),
    ];
    for (change, refusal) in changes {
        let mut changed = whole.clone();
        change(changed["layer_table"].as_array_mut().unwrap());
        fs::write(place.path("changed.json"), changed.to_string()).unwrap();
        for command in ["grow", "view", "layers"] {
            let (code, out, err) = place.run(&[command, "changed.json"]);
            assert!(code == Some(2) && out.is_empty() && err.contains(refusal), "{command}: {err}");
        }
    }
    assert_eq!(place.run(&["layers", "plan.json", "-o", "layers.csv"]).0, Some(0));
    for command in ["grow", "view", "layers"] {
        let (code, _, err) = place.run(&[command, "layers.csv"]);
        assert!(code == Some(2) && err.contains("growbot layers --json"), "{command}: {err}");
    }
}

#[test]
fn json_of_a_written_file_needs_a_file() {
    let place = Place::new();
    assert_eq!(place.run(&["plan", "--to", "0,0,50,0,90", "-o", "plan.json"]).0, Some(0));
    let (code, out, err) = place.run(&["export", "plan.json", "-o", "body.stl", "--json"]);
    assert_eq!((code, err.as_str()), (Some(0), ""), "{out}");
    let report: Value = serde_json::from_str(&out).unwrap();
    assert_eq!((&report["file"], &report["format"]), (&"body.stl".into(), &"stl".into()));
    assert_eq!(report["bytes"].as_u64(), Some(fs::metadata(place.path("body.stl")).unwrap().len()));
    assert_eq!(report["simulated"], false);
    for args in [
        &["export", "plan.json", "--format", "csv", "-o", "-", "--json"][..],
        &["view", "plan.json", "--svg", "-o", "-", "--json"],
    ] {
        let (code, out, err) = place.run(args);
        assert!(code == Some(2) && out.is_empty() && err.contains("name a file with -o"), "{args:?}: {err}");
    }
}
