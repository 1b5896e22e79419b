//! Tests of the limits for clients of the service. Too many connections, slow requests and long requests must not
//! prevent orders to a robot.

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::sync::Barrier;
use std::thread::{self, sleep};
use std::time::Duration;

use lab::{GOAL, Lab, http, wait_for};
use serde_json::{Value, json};

use crate::lab;

/// Number of connections that send only a part of a request.
const MANY: usize = 1500;
/// Maximum number of open connections, as in growbot-serve/src/connections.rs. `STREAMS` is the maximum number of
/// open event streams, as in limits.rs.
const CONNECTIONS: usize = 256;
const STREAMS: usize = 64;
const STOP: &str = r#"{"command":"emergency-stop"}"#;

/// Raises the limit on the number of files that this process may open.
fn raise_limit() {
    use rustix::process::{Resource, getrlimit, setrlimit};
    let mut limit = getrlimit(Resource::Nofile);
    limit.current = limit.maximum.map_or(Some(8192), |most| Some(most.min(8192)));
    setrlimit(Resource::Nofile, limit).unwrap();
}

#[test]
fn half_open_connections_do_not_block_others() {
    raise_limit();
    // Half a request may take a day, so waiting for one would never end.
    let lab = Lab::with(100.0, "[serve]\nrequest_s = 86400\n");
    lab.wait_until_ready();
    let (port, _) = lab.pages.clone().unwrap();
    let half = |mut stream: TcpStream| {
        // The service may already have closed this connection for another.
        let _ = stream.write_all(b"GET / HT");
        stream
    };
    let open: Vec<_> = (0..MANY).map(|_| half(TcpStream::connect(("127.0.0.1", port)).unwrap())).collect();
    assert_eq!(lab.ask_page(&lab.at("/robots"), &[], "GET", ""), 200);
    assert_eq!(lab.ask_page(&lab.at("/robots/lab/commands"), &[], "POST", STOP), 200);
    let files = lab.files();
    assert!((CONNECTIONS - 10..CONNECTIONS + 100).contains(&files), "{files} files are open");
    // Commands have their own connections, and the same number of half-open ones does not block them either.
    let open_there: Vec<_> = (0..MANY).map(|_| UnixStream::connect(lab.socket()).unwrap()).collect();
    let (code, output) = lab.run(&["estop"]);
    assert!(code == Some(0) && output.starts_with("emergency stop"), "{output}");
    assert_eq!(lab.ask("GET", "/robots/lab", "").1["state"], "emergency-stop");
    let files = lab.files();
    assert!(files < 2 * CONNECTIONS + 100, "{files} files are open");
    drop((open, open_there));
    wait_for("the connections are closed", || (lab.files() < 60).then_some(()));
}

#[test]
fn authenticated_connections_are_limited_and_commands_get_through() {
    raise_limit();
    // On a busy machine the connections take longer to open than idle ones stay open by default.
    let lab = Lab::with(100.0, "[serve]\nrequest_s = 600\n");
    lab.wait_until_ready();
    let request = format!("GET {} HTTP/1.1\r\nhost: localhost\r\n\r\n", lab.at("/robots"));
    let keep = || {
        let mut stream = lab.page();
        stream.write_all(request.as_bytes()).unwrap();
        let mut answer = [0; 12];
        stream.read_exact(&mut answer).unwrap();
        (stream, String::from_utf8_lossy(&answer).into_owned())
    };
    let open: Vec<_> = (0..CONNECTIONS).map(|_| keep()).collect();
    assert!(open.iter().all(|(_, answer)| answer == "HTTP/1.1 200"));
    assert_eq!(keep().1, "HTTP/1.1 503");
    let (status, problem) = http(lab.page(), "GET", &lab.at("/robots"), &[], "");
    assert!(
        status == 503 && problem.contains("256 connections to the service are already open: try again"),
        "{problem}"
    );
    assert_eq!(lab.ask("POST", "/robots/lab/commands", STOP).0, 200);
    drop(open);
    wait_for("there is room again", || (lab.ask_page(&lab.at("/robots"), &[], "GET", "") == 200).then_some(()));
}

/// Sends this start of a request, then one byte after another without an end. Returns the status of the response. 0 if
/// the connection is closed without a response.
fn status_of(mut stream: TcpStream, request: &str) -> u16 {
    // The service may close the connection before the request is written.
    let _ = stream.write_all(request.as_bytes());
    stream.set_read_timeout(Some(Duration::from_millis(20))).unwrap();
    let mut answer = Vec::new();
    let mut part = [0; 4096];
    loop {
        match stream.read(&mut part) {
            Ok(0) => break,
            Ok(read) => answer.extend_from_slice(&part[..read]),
            // The rest arrives slowly, but without a long silence.
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {
                if stream.write_all(b"x").is_err() {
                    break;
                }
            }
            Err(_) => break,
        }
        if answer.windows(4).any(|end| end == b"\r\n\r\n") {
            break;
        }
    }
    let answer = String::from_utf8_lossy(&answer);
    answer.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0)
}

/// Returns the head of a request for a job. `length` is the header with the length of the body.
fn post(lab: &Lab, length: &str) -> String {
    let path = lab.at("/robots/lab/jobs");
    format!("POST {path} HTTP/1.1\r\nhost: localhost\r\ncontent-type: application/json\r\n{length}\r\n\r\n")
}

#[test]
fn slow_requests_are_refused() {
    let lab = Lab::with(100.0, "[serve]\nrequest_s = 1\n");
    lab.wait_until_ready();
    thread::scope(|scope| {
        let head = scope.spawn(|| status_of(lab.page(), "GET / HTTP/1.1\r\nx: "));
        let body = scope.spawn(|| status_of(lab.page(), &post(&lab, "content-length: 1000")));
        let long = scope.spawn(|| status_of(lab.page(), &post(&lab, "content-length: 100000")));
        // A connection may be closed without the response 408.
        assert!(matches!(head.join().unwrap(), 0 | 408));
        assert_eq!((body.join().unwrap(), long.join().unwrap()), (408, 408));
    });
    assert!(lab.orders().is_empty(), "{:?}", lab.orders());
}

#[test]
fn long_requests_are_refused_and_do_not_block_commands() {
    let lab = Lab::with(100.0, "[serve]\nrequest_s = 86400\n");
    lab.wait_until_ready();
    let chunk = format!("100000\r\n{}\r\n", "0".repeat(1 << 20)).repeat(17);
    assert_eq!(status_of(lab.page(), &(post(&lab, "transfer-encoding: chunked") + &chunk)), 413);
    assert_eq!(status_of(lab.page(), &post(&lab, "content-length: 17000000")), 413);
    // The service handles two long requests at a time and refuses further ones. Commands are short, so they do not
    // wait.
    let long = post(&lab, "transfer-encoding: chunked\r\nexpect: 100-continue");
    let read: Vec<_> = (0..2).map(|_| status_of_kept(&lab, &long)).collect();
    assert!(read.iter().all(|(_, status)| *status == 100));
    assert_eq!(status_of_kept(&lab, &long).1, 503);
    assert_eq!(lab.ask_page(&lab.at("/robots/lab/commands"), &[], "POST", STOP), 200);
    drop(read);
    wait_for("there is a place again", || (status_of_kept(&lab, &long).1 == 100).then_some(()));
    let orders = lab.orders();
    assert_eq!(orders.len(), 1, "{orders:?}");
}

#[test]
fn event_streams_are_limited_and_freed_when_closed() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let request = format!("GET {} HTTP/1.1\r\nhost: localhost\r\n\r\n", lab.at("/events"));
    let streams: Vec<_> = (0..STREAMS).map(|_| status_of_kept(&lab, &request)).collect();
    assert!(streams.iter().all(|(_, status)| *status == 200));
    assert_eq!(status_of_kept(&lab, &request).1, 503);
    assert_eq!(lab.ask_page(&lab.at("/robots"), &[], "GET", ""), 200);
    drop(streams);
    wait_for("there is a place again", || (status_of_kept(&lab, &request).1 == 200).then_some(()));
}

fn status_of_kept(lab: &Lab, request: &str) -> (TcpStream, u16) {
    let mut stream = lab.page();
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = [0; 12];
    stream.read_exact(&mut answer).unwrap();
    (stream, String::from_utf8_lossy(&answer[9..]).parse().unwrap())
}

/// Several clients order a job at the same time.
#[test]
fn only_one_of_several_simultaneous_jobs_begins() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let begin = |key: Option<&str>| {
        let stream = UnixStream::connect(lab.socket()).unwrap();
        let key = key.map(|key| format!("idempotency-key: {key}"));
        let headers: Vec<&str> = key.as_deref().into_iter().collect();
        http(stream, "POST", "/api/v1/robots/lab/jobs", &headers, &json!({ "to": GOAL }).to_string())
    };
    for round in 0..4 {
        let key = (round == 3).then_some("the same");
        let barrier = Barrier::new(6);
        let answers: Vec<(u16, String)> = thread::scope(|scope| {
            let asked = (0..6).map(|_| {
                scope.spawn(|| {
                    barrier.wait();
                    begin(key)
                })
            });
            asked.collect::<Vec<_>>().into_iter().map(|asked| asked.join().unwrap()).collect()
        });
        let count = |status: u16| answers.iter().filter(|(of, _)| *of == status).count();
        // A repeated request returns its job.
        let others = if key.is_some() { 200 } else { 409 };
        assert_eq!((count(201), count(others)), (1, 5), "{answers:?}");
        let began = answers.iter().find(|(status, _)| *status == 201).unwrap();
        let job = serde_json::from_str::<Value>(&began.1).unwrap()["id"].as_str().unwrap().to_owned();
        assert_eq!(lab.ask("GET", "/robots/lab", "").1["job"], job);
        let (_, jobs) = lab.ask("GET", "/jobs", "");
        assert_eq!(jobs.as_array().unwrap().len(), round + 1, "{jobs}");
        assert_eq!(lab.ask("POST", "/robots/lab/commands", r#"{"command":"stop"}"#).0, 200);
        assert_eq!(lab.wait_for_end(&job)["state"], "interrupted");
        wait_for("it can be given up", || {
            (lab.ask("POST", "/robots/lab/commands", r#"{"command":"cancel"}"#).0 == 200).then_some(())
        });
    }
    // No refused request begins a job later.
    sleep(Duration::from_secs(1));
    assert_eq!(lab.ask("GET", "/robots/lab", "").1["job"], Value::Null);
    let of = |order: &str| lab.orders().iter().filter(|of| of["command"] == order && of["error"].is_null()).count();
    assert_eq!((of("grow"), of("cancel")), (9, 4), "four that began, and five answered with the job of the fourth");
}

/// A plan with more layers than a board can store is refused before its layers are computed, even with `force`. An
/// idempotency key can be used for one request only.
#[test]
fn too_many_layers_and_reused_keys_are_refused() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let begin = |key: &str, body: Value| {
        let stream = UnixStream::connect(lab.socket()).unwrap();
        http(stream, "POST", "/api/v1/robots/lab/jobs", &[&format!("idempotency-key: {key}")], &body.to_string())
    };
    let (status, answer) = begin("far", json!({ "to": "0,0,8000,0,90", "force": true }));
    assert!(status == 409 && answer.contains("layers, but a board can store 6143"), "{status}: {answer}");
    let (status, first) = begin("one", json!({ "to": GOAL }));
    assert_eq!(status, 201, "{first}");
    assert_eq!(begin("one", json!({ "to": GOAL })).0, 200);
    let (status, answer) = begin("one", json!({ "to": "0,0,100,0,90" }));
    assert!(status == 409 && answer.contains("with a different request"), "{status}: {answer}");
    assert_eq!(lab.ask("POST", "/robots/lab/commands", r#"{"command":"stop"}"#).0, 200);
    let id = serde_json::from_str::<Value>(&first).unwrap()["id"].as_str().unwrap().to_owned();
    assert_eq!(lab.wait_for_end(&id)["state"], "interrupted");
    assert_eq!(lab.ask("POST", "/robots/lab/commands", r#"{"command":"cancel"}"#).0, 200);
    assert_eq!(lab.ask("GET", &format!("/jobs/{id}"), "").1["state"], "failed");
}
