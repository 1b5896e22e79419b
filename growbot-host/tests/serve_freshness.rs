//! Tests of the age of the service's data and of orders: heartbeats, a silent board, late orders, and the WebSocket for
//! commands.

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;

use lab::{Lab, http, wait_for};
use serde_json::{Value, json};

use crate::lab;
use crate::running::command;

/// Requests a path from the address of the pages. Returns the status of the response, and a reader of its body.
fn open(lab: &Lab, path: &str, headers: &str) -> (u16, BufReader<TcpStream>) {
    let mut stream = lab.page();
    stream.write_all(format!("GET {path} HTTP/1.1\r\nhost: localhost\r\n{headers}\r\n").as_bytes()).unwrap();
    let mut reader = BufReader::new(stream);
    let (mut head, mut line) = (String::new(), String::new());
    while line != "\r\n" {
        line.clear();
        assert!(reader.read_line(&mut line).unwrap() > 0, "{head}");
        head += &line;
    }
    (head.split(' ').nth(1).unwrap().parse().unwrap(), reader)
}

/// Returns the content of the next `number` heartbeats of a stream of server-sent events.
fn heartbeats(reader: BufReader<TcpStream>, number: usize) -> Vec<Value> {
    let mut lines = reader.lines().map(Result::unwrap);
    let (mut found, mut others) = (Vec::new(), 0);
    while found.len() < number {
        let line = lines.next().unwrap();
        // A stream has at most 10 events a second. It has a comment if it was silent for 15 s.
        others += usize::from(line.starts_with("event: ") || line.starts_with(':'));
        assert!(others <= 100, "{others} events and comments, of which {} were heartbeats", found.len());
        if line.trim_end() == "event: heartbeat" {
            let data = lines.find_map(|line| Some(line.strip_prefix("data: ")?.to_owned())).unwrap();
            found.push(serde_json::from_str(data.trim_end()).unwrap());
        }
    }
    found
}

fn order(lab: &Lab, path: &str, time: &str, body: &str) -> (u16, String) {
    let stream = UnixStream::connect(lab.socket()).unwrap();
    http(stream, "POST", &format!("/api/v1{path}"), &[&format!("growbot-order-time: {time}")], body)
}

fn robot(lab: &Lab) -> Value {
    lab.ask("GET", "/robots/lab", "").1
}

#[test]
fn streams_have_heartbeats_with_the_age_of_each_status() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let (status, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": "100,100,600,0,45" }).to_string());
    assert_eq!(status, 201, "{job}");
    for (path, age) in [
        ("/events".to_owned(), "/status_age_s/lab"),
        (format!("/jobs/{}/live/updates", job["id"].as_str().unwrap()), "/status_age_s"),
    ] {
        let beats = heartbeats(open(&lab, &lab.at(&path), "").1, 2);
        let times: Vec<u64> = beats.iter().map(|beat| beat["time_ms"].as_u64().unwrap()).collect();
        // The interval is 2 s, and a stream that is busy is later.
        assert!(times[1] - times[0] >= 2000, "{path}: {times:?}");
        assert!(beats.iter().all(|beat| beat.pointer(age).unwrap().is_f64()), "{path}: {beats:?}");
    }
}

#[test]
fn a_silent_board_is_reported_as_stale_with_its_age() {
    let lab = Lab::new(5.0);
    lab.wait_until_ready();
    let fresh = robot(&lab);
    assert_eq!(fresh["stale"], false, "{fresh}");
    let (status, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": "100,100,600,0,45" }).to_string());
    assert_eq!(status, 201, "{job}");
    wait_for("it heats", || (robot(&lab)["state"] == "heating").then_some(()));
    let pid = lab.robot_process();
    assert!(command("kill").args(["-STOP", &pid]).status().unwrap().success());
    let stale = wait_for("its data are stale", || Some(robot(&lab)).filter(|robot| robot["stale"] == true));
    let (code, text) = lab.run(&["status"]);
    let (_, json) = lab.run(&["status", "--json"]);
    assert!(command("kill").args(["-CONT", &pid]).status().unwrap().success());
    // The service still waits for the board's response, so it has not found the connection lost.
    assert_eq!((&stale["connection"], &stale["state"]), (&json!("busy"), &json!("heating")), "{stale}");
    assert!(stale["status_age_s"].as_f64() > Some(5.0), "{stale}");
    assert!(code == Some(0) && text.contains("stale        the board last reported "), "{text}");
    let json: Value = serde_json::from_str(&json).unwrap();
    assert!(json["stale"] == true && json["status_age_s"].as_f64() > Some(5.0), "{json}");
    wait_for("its data are current", || (robot(&lab)["stale"] == false).then_some(()));
}

/// Orders that stop, pause or cool down are carried out however late they arrive. All other late orders are refused.
#[test]
fn late_orders_are_refused_unless_they_stop_or_pause() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let now = || heartbeats(open(&lab, &lab.at("/events"), "").1, 1)[0]["time_ms"].to_string();
    let commands = "/robots/lab/commands";
    let command = |name: &str| json!({ "command": name }).to_string();
    let grow = json!({ "to": "100,100,600,0,45" }).to_string();
    let preheat = json!({ "task": "preheat", "value": "200" }).to_string();
    let refused = |path: &str, body: &str| {
        let (status, problem) = order(&lab, path, "0", body);
        let cause = "s after it was given (limit 5 s), so the order was not carried out: check the robot's state";
        assert!(status == 409 && problem.contains(cause), "{path} {body}: {status} {problem}");
    };
    refused("/robots/lab/jobs", &grow);
    refused("/robots/lab/maintenance", &preheat);
    refused("/robots/lab/tuning", "{}");
    for name in ["continue", "clear-fault", "cancel", "withdraw-stop"] {
        refused(commands, &command(name));
    }
    assert_eq!((lab.ask("GET", "/jobs", "").1, robot(&lab)["target_c"].clone()), (json!([]), Value::Null));

    let (status, job) = order(&lab, "/robots/lab/jobs", &now(), &grow);
    assert_eq!(status, 201, "{job}");
    let id = serde_json::from_str::<Value>(&job).unwrap()["id"].as_str().unwrap().to_owned();
    let state = |wanted: &str| lab.wait_for_state(wanted);
    state("growing");
    assert_eq!(order(&lab, commands, "0", &command("pause")).0, 200);
    state("paused");
    refused(&format!("/jobs/{id}/live/commands/continue"), "");
    assert_eq!(order(&lab, &format!("/jobs/{id}/live/commands/continue"), &now(), "").0, 202);
    state("growing");
    assert_eq!(order(&lab, &format!("/jobs/{id}/live/commands/pause"), "0", "").0, 202);
    state("paused");
    assert_eq!(order(&lab, commands, "0", &command("stop")).0, 200);
    state("stopped");
    refused(&format!("/jobs/{id}/resume"), "{}");
    assert_eq!(order(&lab, "/robots/lab/maintenance", "0", &json!({ "task": "cooldown" }).to_string()).0, 200);
    assert_eq!(order(&lab, commands, "0", &command("emergency-stop")).0, 200);
    state("emergency-stop");
}

/// Sends a text in a masked WebSocket frame, as clients do. The mask is 0.
fn send_text(stream: &mut impl Write, text: &str) {
    let mut frame = vec![0x81, 0x80 | 126];
    frame.extend_from_slice(&u16::try_from(text.len()).unwrap().to_be_bytes());
    frame.extend_from_slice(&[0; 4]);
    frame.extend_from_slice(text.as_bytes());
    stream.write_all(&frame).unwrap();
}

/// Reads the next WebSocket message of the server, and returns its JSON.
fn read_text(reader: &mut impl Read) -> Value {
    let mut head = [0; 2];
    reader.read_exact(&mut head).unwrap();
    assert_eq!(head[0], 0x81, "a whole text");
    let length = match head[1] {
        126 => {
            let mut length = [0; 2];
            reader.read_exact(&mut length).unwrap();
            u16::from_be_bytes(length).into()
        }
        length => usize::from(length),
    };
    let mut text = vec![0; length];
    reader.read_exact(&mut text).unwrap();
    serde_json::from_slice(&text).unwrap()
}

#[test]
fn a_socket_carries_commands_past_those_that_wait() {
    let lab = Lab::new(5.0);
    lab.wait_until_ready();
    let upgrade = "connection: upgrade\r\nupgrade: websocket\r\nsec-websocket-version: 13\r\n\
                   sec-websocket-key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
    let (status, mut socket) = open(&lab, &lab.at("/commands/ws"), upgrade);
    assert_eq!(status, 101);
    let mut ask = |messages: &[Value]| {
        messages.iter().for_each(|message| send_text(socket.get_mut(), &message.to_string()));
        messages.iter().map(|_| read_text(&mut socket)).collect::<Vec<_>>()
    };
    let late = &ask(&[json!({ "id": 7, "robot": "lab", "command": "clear-fault", "time_ms": 0 })])[0];
    assert_eq!((&late["id"], &late["status"]), (&json!(7), &json!(409)), "{late}");
    assert!(late["body"]["detail"].as_str().unwrap().contains("after it was given (limit 5 s)"), "{late}");
    let stopped = &ask(&[json!({ "id": 8, "robot": "lab", "command": "emergency-stop", "time_ms": 0 })])[0];
    assert_eq!((&stopped["status"], &stopped["body"]["state"]), (&json!(200), &json!("emergency-stop")));
    for (message, status, cause) in [
        (json!({ "id": 9, "robot": "none", "command": "stop" }), 404, "no robot \"none\""),
        (json!({ "id": 9, "robot": "lab", "command": "dance" }), 422, "unknown variant `dance`"),
        (json!({ "id": 9, "robot": "lab", "order": "stop" }), 400, "unknown field `order`"),
    ] {
        let reply = &ask(&[message])[0];
        let detail = reply["body"]["detail"].as_str().unwrap();
        assert!(reply["status"] == status && detail.contains(cause), "{reply}");
    }
    // The stop of a silent robot waits for its confirmation. The command after it is answered first.
    let pid = lab.robot_process();
    assert!(command("kill").args(["-STOP", &pid]).status().unwrap().success());
    let replies = ask(&[
        json!({ "id": 10, "robot": "lab", "command": "stop" }),
        json!({ "id": 11, "robot": "lab", "command": "pause" }),
    ]);
    assert!(command("kill").args(["-CONT", &pid]).status().unwrap().success());
    let ids: Vec<&Value> = replies.iter().map(|reply| &reply["id"]).collect();
    assert_eq!(ids, [11, 10], "{replies:?}");
    // The orders are recorded like those by HTTP, and the read-only address has no such socket.
    assert!(lab.orders().iter().any(|order| order["command"] == "emergency-stop"));
    let (_, [_, read]) = lab.pages.clone().unwrap();
    assert_eq!(open(&lab, &format!("/{read}/api/v1/commands/ws"), upgrade).0, 403);
}
