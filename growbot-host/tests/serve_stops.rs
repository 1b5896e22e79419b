//! Tests of stops by the service as its users meet them: while the robot is silent, over a restart, during planning,
//! and without a port.

use std::fs;
use std::io::{Read, Write};
use std::os::unix::net::UnixStream;
use std::time::Duration;

use serde_json::{Value, json};

use crate::lab::{GOAL, Lab, wait_for};
use crate::running::command;

fn signal(pid: &str, signal: &str) {
    assert!(command("kill").args([signal, pid]).status().unwrap().success());
}

fn robot(lab: &Lab) -> Value {
    lab.ask("GET", "/robots/lab", "").1
}

#[test]
fn a_stop_of_a_silent_robot_is_delivered_when_it_is_back_also_after_a_restart() {
    for restarts in [false, true] {
        let mut lab = Lab::new(5.0);
        lab.wait_until_ready();
        let (status, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": "100,100,600,0,45" }).to_string());
        assert_eq!(status, 201, "{job}");
        let pid = lab.robot_process();
        signal(&pid, "-STOP");
        let (status, problem) = lab.ask("POST", "/robots/lab/commands", r#"{"command":"emergency-stop"}"#);
        let detail = problem["detail"].as_str().unwrap();
        assert!(
            status == 409 && detail.contains("cut the robot's power") && detail.contains("keeps the stop"),
            "{detail}"
        );
        assert_eq!(robot(&lab)["pending_stop"], "emergency-stop");
        if restarts {
            lab.kill();
            let stop = lab.directory.path().join("state/growbot/serve/stops/lab.json");
            let stop: Value = serde_json::from_slice(&fs::read(stop).unwrap()).unwrap();
            assert_eq!(stop["level"], "emergency-stop");
            // The next service delivers it as soon as it has switched the robot on.
            lab.start();
        }
        // The robot of a service that was killed may have ended.
        let is_awake = command("kill").args(["-CONT", &pid]).status().unwrap().success();
        assert!(is_awake || restarts);
        let off = wait_for("the stop is delivered", || {
            let robot = robot(&lab);
            (robot["connection"] == "ready" && robot["pending_stop"].is_null()).then_some(robot)
        });
        // The restarted service found the robot off, and switched it on. A loss of power is a fault, and stays one.
        let state = if restarts { "fault" } else { "emergency-stop" };
        assert_eq!((&off["state"], &off["target_c"]), (&json!(state), &Value::Null), "{off}");
        let ended = lab.wait_for_end(job["id"].as_str().unwrap());
        assert_eq!(ended["state"], "interrupted", "{ended}");
        let (status, problem) = lab.ask("POST", "/robots/lab/commands", r#"{"command":"withdraw-stop"}"#);
        assert!(status == 409 && problem["detail"].as_str().unwrap().contains("nothing to withdraw"), "{problem}");
    }
}

/// Opens a connection, sends the head of a POST request, and waits until the service has received the head. `length` is
/// the announced length of the body.
fn send_head(lab: &Lab, path: &str, length: usize) -> UnixStream {
    let mut stream = UnixStream::connect(lab.socket()).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let head = format!(
        "POST /api/v1{path} HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\ncontent-type: application/json\r\n\
         expect: 100-continue\r\ncontent-length: {length}\r\n\r\n"
    );
    stream.write_all(head.as_bytes()).unwrap();
    let mut answer = [0; 25];
    stream.read_exact(&mut answer).unwrap();
    assert_eq!(&answer, b"HTTP/1.1 100 Continue\r\n\r\n");
    stream
}

#[test]
fn a_stop_voids_the_orders_that_arrived_before_it() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let orders = [
        ("/robots/lab/jobs", json!({ "to": GOAL }).to_string()),
        ("/robots/lab/maintenance", json!({ "task": "preheat", "value": "200" }).to_string()),
        ("/robots/lab/tuning", json!({ "target_c": 200.0 }).to_string()),
    ];
    for stop in ["stop", "emergency-stop", "cancel"] {
        for (path, body) in &orders {
            let mut order = send_head(&lab, path, body.len());
            let (status, answer) = lab.ask("POST", "/robots/lab/commands", &json!({ "command": stop }).to_string());
            assert_eq!(status, 200, "{answer}");
            order.write_all(body.as_bytes()).unwrap();
            let mut answer = String::new();
            order.read_to_string(&mut answer).unwrap();
            assert!(answer.contains("409 Conflict") && answer.contains("again"), "{stop} {path}: {answer}");
            assert_eq!(robot(&lab)["target_c"], Value::Null, "{stop} {path}");
        }
        lab.ask("POST", "/robots/lab/commands", r#"{"command":"clear-fault"}"#);
    }
    // An order after the stop is carried out.
    let (status, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": GOAL }).to_string());
    assert_eq!(status, 201, "{job}");
}

#[test]
fn an_emergency_stop_without_a_port_stops_every_robot() {
    let settings = "[robots.lab]\nport = \"sim:lab\"\nrobot = \"growbot-a2\"\n\
                    [robots.bench]\nport = \"sim\"\nrobot = \"growbot-a2\"\n";
    let mut lab = Lab::configured(settings);
    for name in ["lab", "bench"] {
        lab.wait_until_robot_is_ready(name);
    }
    let (code, output) = lab.run(&["estop"]);
    assert!(
        code == Some(0) && output.contains("robot at sim:lab are off") && output.contains("robot at sim are off"),
        "{output}"
    );
    for name in ["lab", "bench"] {
        assert_eq!(lab.ask("GET", &format!("/robots/{name}"), "").1["state"], "emergency-stop");
    }
    // Names work wherever a port does.
    let (code, output) = lab.run(&["status", "--port", "bench"]);
    assert!(code == Some(0) && output.contains("bench, owned by the service, simulated"), "{output}");
    let (code, output) = lab.run(&["stop", "--port", "lab"]);
    assert!(code == Some(0) && output.contains("are off"), "{output}");
    lab.kill();
    let (code, output) = lab.run(&["estop", "--port", "lab"]);
    assert!(code == Some(0) && output.starts_with("emergency stop"), "{output}");
    let (code, output) = lab.run(&["estop"]);
    assert!(code == Some(0) && output.starts_with("emergency stop"), "without the service: {output}");
    let (code, output) = lab.run(&["stop", "--port", "none"]);
    assert!(code == Some(2) && output.contains("unknown port `none`"), "{output}");
}
