//! Tests of `growbot reproduce` as researchers and scripts run it: files, exit codes, messages.

use crate::running;

use std::fs;
use std::path::Path;

use running::{Ran, growbot};
use serde_json::Value;

fn names(directory: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(directory).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[track_caller]
fn assert_refused(ran: &Ran, part: &str) {
    assert_eq!((ran.code, ran.out.as_str()), (Some(2), ""), "{}", ran.err);
    assert!(ran.err.contains(part) && !ran.err.contains("panicked"), "no {part:?} in {:?}", ran.err);
}

#[test]
fn help_fits_80_columns_and_has_examples() {
    let ran = growbot(&["reproduce", "--help"]);
    assert!(ran.out.contains("Usage: growbot reproduce") && ran.out.contains("Examples"), "{}", ran.out);
    assert!(ran.out.lines().all(|line| line.chars().count() <= 80), "{}", ran.out);
}

#[test]
fn files_are_complete_and_results_go_to_standard_output() {
    let directory = tempfile::tempdir().unwrap();
    let output = directory.path().join("paper");
    let output = output.to_str().unwrap();
    let run = ["reproduce", "--figure", "7", "--table", "1", "--repeat", "2", "--seed", "5", "-o", output];
    let ran = growbot(&run);
    assert_eq!(ran.code, Some(0), "{}", ran.err);
    assert!(ran.out.contains("seed 5") && ran.out.contains("Table 1"), "{}", ran.out);
    let all = ["figure7.svg", "growths.csv", "paths.csv", "report.html", "summary.csv", "table1.csv", "tests.csv"];
    assert_eq!(names(output.as_ref()), all);
    let before = fs::read(Path::new(output).join("report.html")).unwrap();
    let page = String::from_utf8_lossy(&before);
    assert!(page.contains("growbot reproduce --table 1 --figure 7 --repeat 2 --seed 5 -o DIR"), "{page}");
    // A second run overwrites the files.
    assert_eq!(growbot(&[&run[..], &["--pdf"]].concat()).out, ran.out);
    assert!(fs::read(Path::new(output).join("figure7.pdf")).unwrap().starts_with(b"%PDF-"));
    fs::remove_file(Path::new(output).join("figure7.pdf")).unwrap();
    assert_eq!(fs::read(Path::new(output).join("report.html")).unwrap(), before);
    assert_eq!(names(output.as_ref()), all);
}

#[test]
fn json_is_one_line() {
    let ran = growbot(&["reproduce", "--figure", "7", "--repeat", "2", "--json"]);
    assert_eq!((ran.code, ran.out.matches('\n').count()), (Some(0), 1), "{}", ran.err);
    let value: Value = serde_json::from_str(&ran.out).unwrap();
    assert_eq!((value["seed"].as_u64(), value["repeat"].as_u64()), (Some(2019), Some(2)));
    assert_eq!(value["disturbances"]["growth_noise"]["distribution"], "uniform");
    assert_eq!(value["disturbances"]["direction_noise"]["standard_deviation"], 0.5);
    assert!(value["summaries"].as_array().unwrap().len() > 10);
}

#[test]
fn bad_input_is_refused_before_any_work() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("file");
    fs::write(&file, "mine").unwrap();
    let missing = directory.path().join("missing").join("deeper");
    let (file_text, missing) = (file.to_str().unwrap(), missing.to_str().unwrap());
    for (args, part) in [
        (&["--table", "4"][..], "4 is not in 1..=3"),
        (&["--figure", "3"], "3 is not in 4..=8"),
        (&["--repeat", "1"], "--repeat is 1: give a number from 2 to 1000"),
        (&["--repeat", "1000000"], "--repeat is 1000000"),
        (&["--seed", "-1"], "--seed"),
        (&["-o", file_text], "is a file"),
        (&["--pdf"], "--output"),
        (&["-o", missing], "does not exist"),
    ] {
        assert_refused(&growbot(&[&["reproduce"], args].concat()), part);
    }
    assert_eq!(fs::read_to_string(&file).unwrap(), "mine");
    assert_eq!(names(directory.path()), ["file"]);
}

#[cfg(unix)]
#[test]
fn failed_writes_leave_no_partial_file() {
    let directory = tempfile::tempdir().unwrap();
    // A directory has the name of a file, and the command does not replace it.
    fs::create_dir(directory.path().join("report.html")).unwrap();
    let output = directory.path().to_str().unwrap();
    assert_refused(&growbot(&["reproduce", "--table", "3", "--repeat", "2", "-o", output]), "report.html");
    assert_eq!(names(directory.path()), ["report.html", "table3.csv"]);
}
