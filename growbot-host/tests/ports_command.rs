//! Tests of `growbot ports`, of commands without `--port`, and of `growbot clear`.

use serde_json::{Value, json};

use crate::lab::{GOAL, Lab};

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
        let cleared = run(&lab, 0, &["clear"]);
        assert!(cleared.contains("cleared: the simulated robot accepts jobs again"), "{door}: {cleared}");
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
    // An emergency stop stops all.
    let stopped = run(&lab, 0, &["estop"]);
    assert!(stopped.contains("at sim:lab are off") && stopped.contains("at sim:other are off"), "{stopped}");
    run(&lab, 0, &["power", "off", "--port", "sim:other"]);
}

#[test]
fn a_robot_that_exists_only_in_the_service_is_not_listed_without_it() {
    let mut lab = Lab::configured(&ONE_ROBOT.replace("\"sim:lab\"", "\"sim\""));
    lab.wait_until_robot_is_ready("lab");
    assert_eq!(ports(&lab), [json!({ "port": "sim", "name": "lab", "source": "service" })]);
    lab.kill();
    assert_eq!(ports(&lab), [] as [Value; 0]);
    let refused = run(&lab, 2, &["clear"]);
    assert!(refused.contains("no port given") && refused.contains("growbot ports"), "{refused}");
    let refused = run(&lab, 1, &["clear", "--port", "sim"]);
    assert!(refused.contains("the request to clear was not sent"), "{refused}");
}
