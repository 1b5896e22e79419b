//! Tests of `growbot ports`, of commands without `--port`, and of `growbot clear`.

use std::fs;

use serde_json::{Value, json};

use crate::lab::{GOAL, Lab};
use crate::running::growbot;

/// Settings of a service with one robot, and without a default port.
const ONE_ROBOT: &str =
    "robot = \"growbot-a2\"\n[robots.lab]\nport = \"sim:lab\"\nrobot = \"growbot-a2\"\npace = 1000\n";

/// Runs a command, and checks its exit code. Returns its output.
fn run(lab: &Lab, code: i32, args: &[&str]) -> String {
    let (ended, text) = lab.run(args);
    assert_eq!(ended, Some(code), "{args:?}: {text}");
    // Messages are wrapped.
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

fn ports(lab: &Lab) -> Vec<Value> {
    let listed: Value = serde_json::from_str(&run(lab, 0, &["ports", "--json"])).unwrap();
    let ports = listed["ports"].as_array().unwrap().clone();
    // The machine may have serial devices.
    ports.into_iter().filter(|port| port["source"] != "serial-device").collect()
}

#[test]
fn a_command_without_a_port_takes_the_only_robot() {
    let mut lab = Lab::configured(ONE_ROBOT);
    lab.wait_until_robot_is_ready("lab");
    assert_eq!(ports(&lab), [json!({ "port": "sim:lab", "name": "lab", "source": "service" })]);
    let status = run(&lab, 0, &["status"]);
    assert!(status.contains("this is lab at sim:lab, the only robot") && status.contains("idle"), "{status}");
    let grown = run(&lab, 0, &["grow", "--to", GOAL]);
    assert!(grown.contains("this is lab at sim:lab, the only robot of the service"), "{grown}");
    // The stop holds until it is cleared, with the service and without.
    for door in ["service", "port"] {
        run(&lab, 0, &["estop"]);
        let status = run(&lab, 0, &["status"]);
        assert!(status.contains("emergency-stop"), "{door}: {status}");
        let cleared = run(&lab, 0, &["clear", "--port", "lab"]);
        assert!(
            cleared.contains("the emergency-stop is cleared: the simulated robot accepts jobs again"),
            "{door}: {cleared}"
        );
        let status = run(&lab, 0, &["status"]);
        assert!(status.contains("idle"), "{door}: {status}");
        if door == "service" {
            lab.kill();
        }
    }
    assert_eq!(ports(&lab), [json!({ "port": "sim:lab", "name": "lab", "source": "settings" })]);

    // With another robot, a port must be given.
    run(&lab, 0, &["power", "on", "--port", "sim:other", "--pace", "1000"]);
    let both = run(&lab, 2, &["stop"]);
    assert!(both.contains("there are 2 robots: pass --port with one of them: lab at sim:lab, sim:other"), "{both}");
    run(&lab, 0, &["stop", "--port", "sim:other"]);
    let nothing = run(&lab, 0, &["clear", "--port", "sim:other"]);
    assert!(nothing.contains("there is nothing to clear: the simulated robot is in the state stopped"), "{nothing}");
    // A command that heats at once, discards a body or changes the board takes no robot by itself.
    for command in [&["tune"][..], &["cancel"], &["clear"], &["power", "off"]] {
        assert!(run(&lab, 2, command).contains("no port given: pass --port"), "{command:?}");
    }
    // With a settings file that cannot be read, the only robot of the others may not be the one that is meant.
    fs::write(lab.directory.path().join("growbot/growbot.toml"), "robot = ").unwrap();
    let unknown = run(&lab, 2, &["stop"]);
    assert!(unknown.contains("no port given: pass --port"), "{unknown}");
    let unknown = run(&lab, 1, &["estop"]);
    assert!(unknown.contains("cut the robot's power"), "{unknown}");
    run(&lab, 0, &["power", "off", "--port", "sim:other", "--robot", "growbot-a"]);
}

#[test]
fn a_robot_that_exists_only_in_the_service_is_not_listed_without_it() {
    let mut lab = Lab::configured(&ONE_ROBOT.replace("\"sim:lab\"", "\"sim\""));
    lab.wait_until_robot_is_ready("lab");
    assert_eq!(ports(&lab), [json!({ "port": "sim", "name": "lab", "source": "service" })]);
    lab.kill();
    assert_eq!(ports(&lab), [] as [Value; 0]);
    let refused = run(&lab, 2, &["status"]);
    assert!(refused.contains("no port given") && refused.contains("growbot ports"), "{refused}");
    let refused = run(&lab, 1, &["clear", "--port", "sim"]);
    assert!(refused.contains("the request to clear was not sent"), "{refused}");
}

#[test]
fn the_only_robot_of_the_service_is_not_grown_on_unasked_if_it_is_real() {
    let lab = Lab::configured("[robots.lab]\nport = \"/dev/ttyNONE7\"\nrobot = \"growbot-a2\"\n");
    for command in [&["grow", "--to", GOAL][..], &["console"]] {
        let refused = run(&lab, 2, command);
        assert!(refused.contains("pass --port lab to use it, or --port sim to simulate"), "{refused}");
    }
    run(&lab, 0, &["grow", "--to", GOAL, "--port", "sim"]);
}

#[test]
fn a_word_for_the_emergency_stop_says_that_nothing_was_stopped() {
    for word in ["e-stop", "emergency"] {
        let ran = growbot(&[word]);
        assert!(ran.code == Some(1) && ran.err.contains("no emergency stop was sent"), "{}", ran.err);
    }
    let ran = growbot(&["plan", "0,0,60,0,90"]);
    assert!(ran.err.contains("give the goal with --to 0,0,60,0,90"), "{}", ran.err);
    let ran = growbot(&["stop", "lab"]);
    assert!(ran.err.contains("give a port or a robot with --port lab"), "{}", ran.err);
}
