//! The run logs of one growth, by the command and by the service. growbot-py/tests/test_board.py compares the command's
//! with Python's.

use std::fs;

use serde_json::Value;

use crate::lab::{GOAL, Lab};
use crate::running::growbot;

/// Returns the lines of a run log without what may differ: times, port, command line and the statuses, whose number
/// depends on how often the program requests it.
fn comparable(path: &str) -> Vec<Value> {
    let text = fs::read_to_string(path).unwrap();
    let lines = text.lines().map(|line| serde_json::from_str::<Value>(line).unwrap());
    let lines = lines.filter(|line| line["event"] != "status");
    lines
        .map(|mut line| {
            for key in ["utc", "started_utc", "command_line", "port"] {
                line.as_object_mut().unwrap().remove(key);
            }
            line
        })
        .collect()
}

#[test]
fn a_growth_of_the_service_leaves_the_log_of_the_command() {
    for (goal, options) in [(GOAL, &[][..]), ("60,0,200,0,45", &["--feedback"])] {
        // A board that has grown before also reports that it discards that job.
        let lab = Lab::configured("[robots.lab]\nport = \"sim\"\nrobot = \"growbot-a\"\n");
        lab.wait_until_ready();
        let at = |name: &str| lab.directory.path().join(name).to_str().unwrap().to_owned();
        let (local, copy) = (at("local.jsonl"), at("copy.jsonl"));
        // From a file and without helicoids, whose last digits change whenever a plan is read: the service reads it
        // again.
        let plan = at("plan.json");
        assert_eq!(growbot(&["plan", "--to", goal, "--robot", "growbot-a", "-o", &plan]).code, Some(0));
        let ran = growbot(&[&["grow", &plan, "--port", "sim", "--log", &local], options].concat());
        assert_eq!(ran.code, Some(0), "{}", ran.err);
        let (code, text) = lab.run(&[&["grow", &plan, "--port", "lab", "--log", &copy], options].concat());
        assert_eq!(code, Some(0), "{text}");
        let (local, copy) = (comparable(&local), comparable(&copy));
        let events = |log: &[Value]| log.iter().map(|line| line["event"].clone()).collect::<Vec<_>>();
        assert_eq!(events(&local), events(&copy));
        for (line, other) in local.iter().zip(&copy) {
            assert_eq!(line, other);
        }
        assert!(local.len() > 100, "{}", local.len());
    }
}
