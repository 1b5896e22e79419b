//! Tests of the client against services that respond late, in parts, or not at all.

use std::io::{ErrorKind, Read, Write};
use std::ops::ControlFlow;
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::PathBuf;
use std::sync::mpsc;
use std::thread::{self, JoinHandle};
use std::time::Duration;

use growbot_client::status::RobotStatus;
use serde_json::json;
use tempfile::TempDir;

use crate::api::{Job, JobState};
use crate::client::{JobLogUpdate, RequestHandle, ResponseError, ServiceClient, ServiceError};
use crate::remote_robot::RemoteRobot;
use crate::transport::connect_unix;

/// Timeout after which a test fails that waits for something that must happen.
const PATIENCE: Duration = Duration::from_secs(60);

/// Socket in a directory of its own.
struct Socket {
    path: PathBuf,
    _directory: TempDir,
}

fn listen() -> (UnixListener, Socket) {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("serve.sock");
    (UnixListener::bind(&path).unwrap(), Socket { path, _directory: directory })
}

/// Accepts a connection and reads the head of its request. Returns both.
fn accept(listener: &UnixListener) -> (UnixStream, String) {
    let (mut stream, _) = listener.accept().unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.set_write_timeout(Some(PATIENCE)).unwrap();
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        let mut byte = [0];
        stream.read_exact(&mut byte).unwrap();
        head.push(byte[0]);
    }
    (stream, String::from_utf8(head).unwrap())
}

/// Starts a service that runs `serve` in a thread of its own. Returns its client.
fn start(serve: impl FnOnce(UnixListener) + Send + 'static) -> (ServiceClient, Socket, JoinHandle<()>) {
    let (listener, socket) = listen();
    let client = ServiceClient { socket: socket.path.clone() };
    (client, socket, thread::spawn(|| serve(listener)))
}

/// Waits for a byte of the client. Returns true if the client closes the connection instead.
fn is_closed(stream: &mut UnixStream) -> bool {
    stream.read(&mut [0]).map_or_else(|error| error.kind() == ErrorKind::ConnectionReset, |count| count == 0)
}

fn respond(stream: &mut UnixStream, body: &str) {
    let length = body.len();
    write!(stream, "HTTP/1.1 200 OK\r\ncontent-length: {length}\r\n\r\n{body}").unwrap();
}

fn begin_chunks(stream: &mut UnixStream) {
    write!(stream, "HTTP/1.1 200 OK\r\ntransfer-encoding: chunked\r\n\r\n").unwrap();
}

fn send_chunk(stream: &mut UnixStream, text: &str) {
    write!(stream, "{:x}\r\n{text}\r\n", text.len()).unwrap();
}

fn job(state: JobState) -> Job {
    let job = json!({
        "id": "1", "robot": "lab", "name": "a job", "state": state, "plan_id": "0", "layers": 3, "laid": 0,
        "length_mm": 1.0, "simulated": true, "ignore_scene": false, "created_utc": "", "ended_utc": null,
        "reason": null,
    });
    serde_json::from_value(job).unwrap()
}

#[test]
fn a_service_that_does_not_respond_is_given_up_after_the_limit() {
    let (_listener, socket) = listen();
    let limit = Duration::from_millis(50);
    let error = ServiceClient { socket: socket.path.clone() }.robots(limit).unwrap_err();
    assert!(matches!(error, ServiceError::Unreachable(ResponseError::Late(found)) if found == limit), "{error}");
}

#[test]
fn a_response_that_does_not_end_is_given_up_after_the_limit() {
    let (client, _socket, service) = start(|listener| {
        let (mut stream, _) = accept(&listener);
        begin_chunks(&mut stream);
        // Each part comes in time, but the client does not wait for the end.
        while write!(stream, "1\r\n \r\n").is_ok() {
            thread::sleep(Duration::from_millis(5));
        }
    });
    let error = client.robots(Duration::from_millis(200)).unwrap_err();
    assert!(matches!(error, ServiceError::Unreachable(ResponseError::Late(_))), "{error}");
    service.join().unwrap();
}

#[test]
fn connecting_does_not_wait_for_a_service_that_accepts_nothing() {
    let (_listener, socket) = listen();
    let mut queued = Vec::new();
    let error = loop {
        match connect_unix(&socket.path) {
            Ok(stream) => queued.push(stream),
            Err(error) => break error,
        }
    };
    assert_eq!(error.kind(), ErrorKind::WouldBlock);
    assert!(!queued.is_empty());
}

#[test]
fn a_service_that_ends_without_a_response_is_unreachable() {
    let (client, _socket, service) = start(|listener| drop(accept(&listener)));
    let error = client.robots(PATIENCE).unwrap_err();
    assert!(matches!(error, ServiceError::Unreachable(ResponseError::Socket(_))), "{error}");
    service.join().unwrap();
}

#[test]
fn the_reason_of_a_rejection_is_read_even_if_the_request_was_not() {
    let (client, _socket, service) = start(|listener| {
        let (mut stream, head) = accept(&listener);
        assert!(head.starts_with("POST /api/v1/plans HTTP/1.1\r\n"), "{head}");
        let body = r#"{"title":"too long","status":413,"detail":"send a shorter one","code":"long"}"#;
        write!(stream, "HTTP/1.1 413 No\r\ncontent-length: {}\r\n\r\n{body}", body.len()).unwrap();
    });
    let request = "x".repeat(10_000_000);
    let error = client.request("/plans", Some(request), Some(PATIENCE)).err().unwrap();
    assert!(
        matches!(&error, ServiceError::Rejected { status: 413, detail, code }
            if detail == "send a shorter one" && code.as_deref() == Some("long")),
        "{error}"
    );
    service.join().unwrap();
}

#[test]
fn each_line_of_a_job_comes_once_over_lost_connections_and_restarts() {
    let (client, _socket, service) = start(|listener| {
        let (mut stream, head) = accept(&listener);
        assert!(head.starts_with("GET /api/v1/jobs/1/events?after=0 "), "{head}");
        begin_chunks(&mut stream);
        send_chunk(&mut stream, "event: log\ndata: one\nid: 1\n\n");
        // An event in two parts, and one that is cut off.
        send_chunk(&mut stream, "event: log\nda");
        send_chunk(&mut stream, "ta: two\nid: 2\n\nevent: log\ndata: thr");
        drop(stream);
        // The job goes on, although the service closes the connection.
        let (mut stream, head) = accept(&listener);
        assert!(head.starts_with("GET /api/v1/jobs/1/events?after=2 "), "{head}");
        begin_chunks(&mut stream);
        send_chunk(&mut stream, ":\n\nevent: log\ndata: three\nid: 3\n\n");
        send_chunk(&mut stream, "");
        let (mut stream, _) = accept(&listener);
        respond(&mut stream, &serde_json::to_string(&job(JobState::Active)).unwrap());
        let (mut stream, head) = accept(&listener);
        assert!(head.starts_with("GET /api/v1/jobs/1/events?after=3 "), "{head}");
        begin_chunks(&mut stream);
        send_chunk(&mut stream, "");
        let (mut stream, _) = accept(&listener);
        respond(&mut stream, &serde_json::to_string(&job(JobState::Done)).unwrap());
    });
    let mut seen = Vec::new();
    let ended = client.follow_job("1", |update| {
        seen.push(match update {
            JobLogUpdate::Line(line) => line.to_owned(),
            other => format!("{other:?}"),
        });
        ControlFlow::Continue(())
    });
    assert_eq!(ended.unwrap(), Some(job(JobState::Done)));
    assert_eq!(seen, ["one", "two", "NoResponse", "NoChange", "three"]);
    service.join().unwrap();
}

#[test]
fn a_follower_can_leave_a_job() {
    let (client, _socket, service) = start(|listener| {
        let (mut stream, _) = accept(&listener);
        begin_chunks(&mut stream);
        send_chunk(&mut stream, "data: one\nid: 1\n\n");
        assert!(is_closed(&mut stream));
    });
    assert_eq!(client.follow_job("1", |_| ControlFlow::Break(())).unwrap(), None);
    service.join().unwrap();
}

#[test]
fn a_lease_lasts_until_it_is_dropped_however_much_the_service_sends() {
    let (all_sent, sent) = mpsc::channel();
    let (client, _socket, service) = start(move |listener| {
        let (mut stream, head) = accept(&listener);
        assert!(head.starts_with("POST /api/v1/robots/lab/port-lease "), "{head}");
        let mut body = [0; r#"{"holder":"a test"}"#.len()];
        stream.read_exact(&mut body).unwrap();
        begin_chunks(&mut stream);
        // More signs of life than a socket holds.
        for _ in 0..100_000 {
            send_chunk(&mut stream, ":\n\n");
        }
        all_sent.send(()).unwrap();
        assert!(is_closed(&mut stream));
    });
    let robot = RemoteRobot { client, name: "lab".to_owned(), found: RobotStatus::default() };
    let lease = robot.lease_port("a test").unwrap();
    sent.recv_timeout(PATIENCE).unwrap();
    drop(lease);
    service.join().unwrap();
}

#[test]
fn a_request_that_is_given_up_closes_its_connection_or_is_not_sent() {
    let (received, has_received) = mpsc::channel();
    let (client, _socket, service) = start(move |listener| {
        let (mut stream, head) = accept(&listener);
        assert!(head.starts_with("POST"), "{head}");
        // The body of the request.
        stream.read_exact(&mut [0; 2]).unwrap();
        received.send(()).unwrap();
        assert!(is_closed(&mut stream), "the connection is open");
        // The other request is not sent, so its connection is closed without a byte.
        let (mut stream, _) = listener.accept().unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        assert!(is_closed(&mut stream), "a request was sent");
    });
    let handle = RequestHandle::default();
    let (sent, requests) = (handle.clone(), client.clone());
    let request = thread::spawn(move || {
        requests.request_by(&sent, "/robots/lab/jobs", Some(json!({})), Some(PATIENCE)).map(drop)
    });
    has_received.recv_timeout(PATIENCE).unwrap();
    handle.give_up();
    assert!(matches!(request.join().unwrap(), Err(ServiceError::Unreachable(_))));
    let late = client.request_by(&handle, "/robots/lab/jobs", Some(json!({})), Some(PATIENCE)).map(drop);
    assert!(matches!(late, Err(ServiceError::Unreachable(ResponseError::Socket(_)))));
    service.join().unwrap();
}
