//! `growbot export` as users and scripts meet it: formats, results, exit codes, messages. What other programs read in
//! its files is tried by tests/exports/run.

mod running;

use std::fs;
use std::path::Path;

use running::{growbot, growbot_reading};
use serde_json::Value;
use tempfile::TempDir;

/// A directory with a plan of 100 mm, and the log of a growth of 5 mm.
struct Bodies(TempDir);

impl Bodies {
    fn new() -> Self {
        let bodies = Self(tempfile::tempdir().unwrap());
        assert_eq!(growbot(&["plan", "--to", "0,0,100,0,90", "-o", &bodies.path("plan.json")]).code, Some(0));
        let grow = ["grow", "--robot", "growbot-a2", "--to", "0,0,5,0,90", "--log", &bodies.path("run.jsonl")];
        assert_eq!(growbot(&grow).code, Some(0));
        bodies
    }

    fn path(&self, name: &str) -> String {
        self.0.path().join(name).to_str().unwrap().to_string()
    }

    /// Exports one to the other.
    #[track_caller]
    fn export(&self, from: &str, to: &str, more: &[&str]) -> Vec<u8> {
        let to = self.path(to);
        let ran = growbot(&[&["export", &self.path(from), "-o", &to], more].concat());
        assert_eq!((ran.code, ran.out.as_str()), (Some(0), ""), "{}", ran.err);
        fs::read(to).unwrap()
    }
}

#[test]
fn help_has_examples_and_fits_80_columns() {
    let ran = growbot(&["export", "--help"]);
    assert!(ran.out.contains("Usage: growbot") && ran.out.contains("Example"), "{}", ran.out);
    assert!(ran.out.lines().all(|line| line.chars().count() <= 80), "{}", ran.out);
}

#[test]
fn the_format_is_that_of_the_extension_unless_it_is_given() {
    let bodies = Bodies::new();
    assert!(bodies.export("plan.json", "a.stl", &[]).starts_with(b"binary STL, units mm"));
    assert!(bodies.export("plan.json", "a.GLB", &[]).starts_with(b"glTF"));
    assert!(bodies.export("plan.json", "a.csv", &[]).starts_with(b"laid,x_mm"));
    assert!(bodies.export("run.jsonl", "a.mcap", &[]).starts_with(b"\x89MCAP0\r\n"));
    assert!(bodies.export("plan.json", "b", &["--format", "csv"]).starts_with(b"laid,x_mm"));
    assert!(bodies.export("plan.json", "b.STL", &["--format", "stl"]).starts_with(b"binary STL, units mm"));
}

#[test]
fn a_plan_from_a_pipe_goes_into_a_pipe() {
    let plan = growbot(&["plan", "--to", "0,0,100,0,90", "--json"]).out;
    let ran = growbot_reading(&["export", "-", "--format", "csv"], &plan);
    assert_eq!((ran.code, ran.err.as_str()), (Some(0), ""));
    let layers = serde_json::from_str::<Value>(&plan).unwrap()["layers"].as_u64().unwrap();
    assert_eq!(ran.out.lines().count() as u64, layers + 2);
    assert!(ran.out.lines().last().unwrap().starts_with(&format!("{layers},")));
}

#[test]
fn a_log_is_exported_as_built_and_as_far_as_it_goes() {
    let bodies = Bodies::new();
    let whole = String::from_utf8(bodies.export("run.jsonl", "whole.csv", &[])).unwrap();
    assert!(whole.lines().skip(2).all(|row| row.contains(",laid-simulated,")), "{whole}");
    let commanded = String::from_utf8(bodies.export("run.jsonl", "commanded.csv", &["--body", "commanded"])).unwrap();
    assert!(commanded.lines().skip(2).all(|row| row.ends_with(",as-built")), "{commanded}");
    // Of a robot the log has no more than the steps say.
    let log = fs::read_to_string(bodies.path("run.jsonl")).unwrap();
    let steps: String =
        log.lines().filter(|line| !line.contains("\"event\":\"simulated\"")).flat_map(|line| [line, "\n"]).collect();
    assert!(steps.len() < log.len());
    fs::write(bodies.path("robot.jsonl"), &steps).unwrap();
    assert_eq!(String::from_utf8(bodies.export("robot.jsonl", "robot.csv", &[])).unwrap(), commanded);
    for (log, of) in [(&log, &whole), (&steps, &commanded)] {
        fs::write(bodies.path("cut.jsonl"), &log[..log.len() * 4 / 5]).unwrap();
        let part = String::from_utf8(bodies.export("cut.jsonl", "part.csv", &[])).unwrap();
        let told = part.lines().filter(|row| !row.contains(",as-built,")).count();
        assert!(part.lines().take(told).eq(of.lines().take(told)) && told > 1 && part.len() < of.len(), "{part}");
    }
}

#[test]
fn what_cannot_be_exported_is_refused_in_one_line_and_leaves_nothing() {
    let bodies = Bodies::new();
    let [plan, log, kept] = ["plan.json", "run.jsonl", "kept.stl"].map(|name| bodies.path(name));
    fs::write(&kept, "kept").unwrap();
    let header = fs::read_to_string(&log).unwrap().lines().next().unwrap().to_string() + "\n";
    fs::write(bodies.path("empty.jsonl"), &header).unwrap();
    fs::write(bodies.path("old.jsonl"), header.replace("growbot-run/3", "growbot-run/1")).unwrap();
    let names = |directory: &Path| fs::read_dir(directory).unwrap().count();
    let before = names(bodies.0.path());
    for (args, said) in [
        (vec![plan.as_str(), "-o", &bodies.path("a.mcap")], "run log"),
        (vec![&plan, "-o", &bodies.path("a.obj")], "--format"),
        (vec![&plan], "--format"),
        (vec![&bodies.path("empty.jsonl"), "-o", &kept], "0 mm long"),
        (vec![&bodies.path("old.jsonl"), "-o", &kept], "growbot-run/1"),
        (vec![&kept, "-o", &bodies.path("a.glb")], "no JSON"),
        (vec![&bodies.path("missing"), "-o", &kept], "missing"),
        (vec![&plan, "-o", &bodies.path("missing/a.stl")], "no directory"),
        (vec![&log, "-o", &kept, "--robot", "growbot-b"], "robot"),
        (vec![&plan, "-o", &kept, "--segments", "7"], "8..=1024"),
    ] {
        let ran = growbot(&[vec!["export"], args.clone()].concat());
        assert_eq!((ran.code, ran.out.as_str()), (Some(2), ""), "{args:?}: {}", ran.err);
        assert!(ran.err.contains(said), "{args:?}: {}", ran.err);
        assert!(args.contains(&"--segments") || ran.err.lines().count() == 1, "{args:?}: {}", ran.err);
    }
    assert_eq!(names(bodies.0.path()), before);
    assert_eq!(fs::read(&kept).unwrap(), b"kept");
}
