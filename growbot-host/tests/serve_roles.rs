//! Tests the service while read-only clients use as much as they can: connections, streams, bodies, downloads,
//! WebSockets and computations. Clients that can send commands, and stops, must be served nevertheless, and the
//! service's memory must stay small.
//!
//! Prints for each load the longest time of a stop and of an emergency stop, ms, and the memory of the service, MB.
//! GROWBOT_STOPS=25 repeats these stops 25 times.

use crate::lab;
use crate::running;

use std::fs;
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::thread;
use std::time::{Duration, Instant};

use lab::{GOAL, Lab, http, wait_for};
use running::command;
use serde_json::{Value, json};

/// Maximum number of open connections, as in growbot-serve/src/connections.rs.
const CONNECTIONS: usize = 256;
/// Maximum number of open connections of read-only clients, as in growbot-serve/src/connections.rs.
const VIEW_CONNECTIONS: usize = 128;
/// Maximum number of open event streams for each role, as in growbot-serve/src/limits.rs.
const STREAMS: usize = 64;
/// Maximum number of long responses that are sent to read-only clients at a time, as in
/// growbot-serve/src/limits.rs.
const VIEW_DOWNLOADS: usize = 8;
/// Maximum memory of the service after each load, kB.
const MAX_MEMORY_KB: u64 = 100_000;
/// Number of points of a scene whose file has almost the maximum length of a request.
const POINTS: usize = 1_000_000;
/// Number of waypoints of a plan whose computation takes seconds.
const MANY_WAYPOINTS: usize = 100;

/// Returns a path of the API, with the read-only token in front.
fn view_at(lab: &Lab, path: &str) -> String {
    format!("/{}/api/v1{path}", lab.pages.as_ref().unwrap().1[1])
}

fn get(path: &str) -> String {
    format!("GET {path} HTTP/1.1\r\nhost: localhost\r\n\r\n")
}

fn post(path: &str, headers: &str) -> String {
    format!("POST {path} HTTP/1.1\r\nhost: localhost\r\ncontent-type: application/json\r\n{headers}\r\n\r\n")
}

/// Sends a request, and reads the status of its response. Returns the open connection, from which the rest of the
/// response is not read, and the status.
fn begin(lab: &Lab, request: &str) -> (TcpStream, u16) {
    let mut stream = lab.page();
    stream.write_all(request.as_bytes()).unwrap();
    let mut answer = [0; 12];
    stream.read_exact(&mut answer).unwrap();
    (stream, String::from_utf8_lossy(&answer[9..]).parse().unwrap())
}

fn count(kept: &[(TcpStream, u16)], status: u16) -> usize {
    kept.iter().filter(|(_, of)| *of == status).count()
}

/// Returns requests to stop in three forms: a command in a body, a command in a body of unknown length, and a stop with
/// a body that never ends.
fn stops(lab: &Lab) -> [String; 3] {
    let stop = r#"{"command":"stop"}"#;
    [
        post(&lab.at("/robots/lab/commands"), &format!("content-length: {}", stop.len())) + stop,
        post(&lab.at("/robots/lab/commands"), "transfer-encoding: chunked")
            + &format!("{:x}\r\n{stop}\r\n0\r\n\r\n", stop.len()),
        post(&lab.at("/robots/lab/stop"), "transfer-encoding: chunked") + "1000000\r\nwhatever",
    ]
}

/// Checks that stops and emergency stops are served under this load. Prints the longest time of each, ms, and the
/// service's memory, MB.
fn check_service(lab: &Lab, load: &str) {
    let repeats: usize = std::env::var("GROWBOT_STOPS").map_or(1, |count| count.parse().unwrap());
    let send = |request: &str| {
        let began = Instant::now();
        let (mut response, status) = begin(lab, request);
        let mut rest = || {
            let mut rest = vec![0; 4096];
            let count = response.read(&mut rest).unwrap();
            String::from_utf8_lossy(&rest[..count]).into_owned()
        };
        assert!(status == 200, "{load}: {request}: {status} {}", rest());
        began.elapsed()
    };
    let (mut stop_times, mut emergency_times) = (Vec::new(), Vec::new());
    for _ in 0..repeats {
        stop_times.extend(stops(lab).map(|stop| send(&stop)));
        emergency_times.push(send(&post(&lab.at("/robots/lab/emergency-stop"), "content-length: 0")));
        assert_eq!(lab.ask("POST", "/robots/lab/commands", r#"{"command":"clear-fault"}"#).0, 200);
    }
    let longest = |times: Vec<Duration>| times.into_iter().max().unwrap_or_default().as_secs_f64() * 1e3;
    let (stop, emergency) = (longest(stop_times), longest(emergency_times));
    println!("| {load} | {stop:.1} | {emergency:.1} | {} |", lab.memory_kb() / 1000);
}

/// Runs a job to its end, and returns its identifier.
fn grown(lab: &Lab) -> String {
    let (status, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": GOAL }).to_string());
    assert_eq!(status, 201, "{job}");
    let id = job["id"].as_str().unwrap().to_owned();
    assert_eq!(lab.wait_for_end(&id)["state"], "done");
    id
}

#[test]
fn read_only_clients_leave_places_for_operators() {
    let lab = Lab::with(100.0, "[serve]\nrequest_s = 86400\n");
    lab.wait_until_ready();
    let streams: Vec<_> = (0..=STREAMS).map(|_| begin(&lab, &get(&view_at(&lab, "/events")))).collect();
    assert_eq!((count(&streams, 200), count(&streams, 503)), (STREAMS, 1));
    let kept: Vec<_> = (0..CONNECTIONS).map(|_| begin(&lab, &get(&view_at(&lab, "/robots")))).collect();
    let others = VIEW_CONNECTIONS - STREAMS - 1;
    assert_eq!((count(&kept, 200), count(&kept, 503)), (others, CONNECTIONS - others));
    check_service(&lab, "256 connections and 64 streams of readers");
    assert_eq!(begin(&lab, &get(&lab.at("/events"))).1, 200);
    assert_eq!(lab.ask_page(&lab.at("/robots"), &[], "GET", ""), 200);
}

#[test]
fn a_stop_is_served_beyond_all_limits() {
    let lab = Lab::with(100.0, "[serve]\nrequest_s = 86400\n");
    lab.wait_until_ready();
    let kept: Vec<_> = (0..CONNECTIONS).map(|_| begin(&lab, &get(&lab.at("/robots")))).collect();
    assert_eq!(count(&kept, 200), CONNECTIONS);
    for _ in 0..25 {
        assert_eq!(begin(&lab, &get(&lab.at("/robots"))).1, 503);
        assert_eq!(begin(&lab, &stops(&lab)[2]).1, 200);
    }
    assert_eq!(begin(&lab, &post(&view_at(&lab, "/robots/lab/stop"), "content-length: 0")).1, 503, "a reader's stop");
    drop(kept);
    let long = post(&lab.at("/robots/lab/jobs"), "transfer-encoding: chunked\r\nexpect: 100-continue");
    wait_for("there is room again", || (begin(&lab, &long).1 == 100).then_some(()));
    let long: Vec<_> = (0..2).map(|_| begin(&lab, &long)).collect();
    check_service(&lab, "two long bodies that are being read");
    drop(long);
}

/// A disk that does not respond is simulated: the run log is replaced by a pipe without a writer.
#[test]
fn a_stop_is_served_while_the_disk_hangs() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let log = lab.log(&grown(&lab));
    fs::remove_file(&log).unwrap();
    assert!(command("mkfifo").arg(&log).status().unwrap().success());
    let job = log.file_stem().unwrap().to_string_lossy().into_owned();
    let hanging = ["log", "events", "view"].map(|what| {
        let mut stream = lab.page();
        stream.write_all(get(&view_at(&lab, &format!("/jobs/{job}/{what}"))).as_bytes()).unwrap();
        stream
    });
    assert_eq!(lab.ask_page(&lab.at("/robots"), &[], "GET", ""), 200);
    check_service(&lab, "a disk that hangs");
    assert_eq!(lab.ask_page(&lab.at("/robots"), &[], "GET", ""), 200);
    hanging[0].set_nonblocking(true).unwrap();
    assert_eq!((&hanging[0]).read(&mut [0]).unwrap_err().kind(), ErrorKind::WouldBlock, "the log is not sent");
}

#[test]
fn bodies_names_and_waypoints_are_bounded() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let ask = |path: &str, body: &str| http(lab.page(), "POST", path, &[], body);
    let long = |bytes: usize| json!({ "to": GOAL, "from": "0".repeat(bytes) }).to_string();
    let (plans, jobs) = ("/plans?robot=lab", "/robots/lab/jobs");
    assert_eq!(ask(&view_at(&lab, plans), &long(60_000)).0, 422);
    let (status, problem) = ask(&view_at(&lab, plans), &long(70_000));
    assert!(status == 413 && problem.contains("longer than 65536 bytes"), "{status}: {problem}");
    assert_eq!(ask(&lab.at(plans), &long(70_000)).0, 422);
    let (status, problem) = ask(&lab.at(jobs), &long(1_100_000));
    assert!(status == 413 && problem.contains("longer than 1048576 bytes"), "{status}: {problem}");
    let (status, problem) = ask(&lab.at("/robots/lab/commands"), &long(5000));
    assert!(status == 413 && problem.contains("longer than 4096 bytes"), "{status}: {problem}");
    let (status, problem) = ask(&lab.at(jobs), &json!({ "to": GOAL, "name": "n".repeat(513) }).to_string());
    assert!(status == 422 && problem.contains("has 513 characters: give at most 512"), "{status}: {problem}");
    let (status, problem) = ask(&view_at(&lab, plans), &json!({ "to": GOAL, "via": vec![GOAL; 101] }).to_string());
    assert!(status == 422 && problem.contains("has 101 waypoints: give at most 100"), "{status}: {problem}");
    let (status, problem) = ask(&view_at(&lab, plans), &json!({ "to": "0,0,9000000,0,90" }).to_string());
    assert!(status == 409 && problem.contains("layers, but a board can store 6143"), "{status}: {problem}");
    assert_eq!(lab.ask("GET", "/jobs", "").1, json!([]));
    check_service(&lab, "refused requests");
}

#[test]
fn slow_readers_and_unfinished_frames_use_little_memory() {
    let lab = Lab::with(100.0, "[serve]\nrequest_s = 86400\n");
    lab.wait_until_ready();
    let job = grown(&lab);
    let mut log = fs::File::options().append(true).open(lab.log(&job)).unwrap();
    let line = json!({ "event": "other", "text": "x".repeat(1000) }).to_string() + "\n";
    log.write_all(line.repeat(8000).as_bytes()).unwrap();
    let readers: Vec<_> = (0..100).map(|_| begin(&lab, &get(&view_at(&lab, &format!("/jobs/{job}/log"))))).collect();
    assert_eq!((count(&readers, 200), count(&readers, 503)), (VIEW_DOWNLOADS, 100 - VIEW_DOWNLOADS));
    check_service(&lab, "100 readers of a log of 8 MB that take nothing");
    assert!(lab.memory_kb() < MAX_MEMORY_KB, "{} kB", lab.memory_kb());
    // The log is sent in full, part by part.
    let whole = http(lab.page(), "GET", &lab.at(&format!("/jobs/{job}/log")), &[], "").1;
    assert!(whole == fs::read_to_string(lab.log(&job)).unwrap(), "{} bytes", whole.len());
    drop(readers);
    let path = view_at(&lab, &format!("/jobs/{job}/events"));
    let followers: Vec<_> = (0..STREAMS).map(|_| begin(&lab, &get(&path))).collect();
    assert_eq!(count(&followers, 200), STREAMS);
    check_service(&lab, "64 streams of its lines that take nothing");
    assert!(lab.memory_kb() < MAX_MEMORY_KB, "{} kB", lab.memory_kb());
    drop(followers);
    let upgrade = "connection: upgrade\r\nupgrade: websocket\r\nsec-websocket-version: 13\r\n\
                   sec-websocket-key: dGhlIHNhbXBsZSBub25jZQ==";
    let open = format!("GET {} HTTP/1.1\r\nhost: localhost\r\n{upgrade}\r\n\r\n", view_at(&lab, "/events/ws"));
    let mut sockets: Vec<_> = (0..STREAMS)
        .map(|_| {
            wait_for("a stream is free", || {
                let socket = begin(&lab, &open);
                (socket.1 == 101).then_some(socket.0)
            })
        })
        .collect();
    for socket in &mut sockets {
        // A message of 16 MB of which the end never comes. The service may have closed the socket before.
        let head = [0x81, 0xff, 0, 0, 0, 0, 1, 0, 0, 0, 1, 2, 3, 4];
        let _ = socket.write_all(&head).and_then(|()| socket.write_all(&vec![7; 1 << 20]));
    }
    check_service(&lab, "64 sockets with unfinished frames");
    for socket in &mut sockets {
        socket.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let closed = socket.read_to_end(&mut Vec::new());
        assert!(closed.map_or_else(|error| error.kind() == ErrorKind::ConnectionReset, |_| true), "it is closed");
    }
    assert!(lab.memory_kb() < MAX_MEMORY_KB, "{} kB", lab.memory_kb());
}

#[test]
fn computations_of_readers_do_not_hold_up_an_operators_job() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let place = |number: usize| format!("{},{},{}", 20 * (number % 3), 20 * (number % 2), 300 + 30 * number);
    let via: Vec<String> = (0..MANY_WAYPOINTS).map(place).collect();
    let body = json!({ "to": "0,0,3400", "via": via }).to_string();
    let request = post(&view_at(&lab, "/plans?robot=lab"), &format!("content-length: {}", body.len())) + &body;
    let plans: Vec<_> = (0..4)
        .map(|_| {
            let mut stream = lab.page();
            stream.write_all(request.as_bytes()).unwrap();
            stream
        })
        .collect();
    wait_for("two plans are computed", || (computations(&lab) == 2).then_some(()));
    check_service(&lab, "four plans with 100 waypoints");
    grown(&lab);
    assert!(computations(&lab) <= 2);
    drop(plans);
    wait_for("the plans end with their clients", || (computations(&lab) == 0).then_some(()));
}

/// Returns the number of plans and pages that the service is computing.
fn computations(lab: &Lab) -> usize {
    let tasks = fs::read_dir(format!("/proc/{}/task", lab.service.as_ref().unwrap().id())).unwrap().flatten();
    // A thread may have ended.
    let names = tasks.filter_map(|task| fs::read_to_string(task.path().join("comm")).ok());
    names.filter(|name| name.trim_end() == "computation").count()
}

/// The service's memory stays small after long requests: JSON of 1 MB from two clients at a time, and a scene of 15 MB
/// in which four plans at a time are computed.
#[test]
fn memory_of_long_bodies_is_released() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let check = |load: &str| {
        check_service(&lab, load);
        assert!(lab.memory_kb() < MAX_MEMORY_KB, "{load}: {} kB", lab.memory_kb());
    };
    let ask = |path: &str, body: &str| http(lab.page(), "POST", &lab.at(path), &[], body);
    let texts = format!(r#"{{"to":"{GOAL}","plan":[{}0]}}"#, r#"{"a":"b"},"#.repeat(100_000));
    for path in ["/robots/lab/jobs", "/plans?robot=lab"] {
        thread::scope(|scope| {
            let both = [(); 2].map(|()| scope.spawn(|| ask(path, &texts).0));
            check_service(&lab, "two bodies of JSON of 1 MB");
            both.into_iter().for_each(|one| assert_eq!(one.join().unwrap(), 422, "{path}"));
        });
        check("after them");
    }
    let point = |number: usize| format!("{} {} 2000\n", 1000 + number % 997, 1000 + number / 997);
    let points: String = (0..POINTS).map(point).collect();
    let cloud = format!(
        "VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH {POINTS}\nHEIGHT 1\n\
         VIEWPOINT 0 0 0 1 0 0 0\nPOINTS {POINTS}\nDATA ascii\n{points}"
    );
    let (status, stored) = ask("/scenes?name=cloud.pcd", &cloud);
    assert_eq!(status, 200, "{stored}");
    check("after a point cloud of 15 MB");
    let scene = serde_json::from_str::<Value>(&stored).unwrap()["scene"].clone();
    let body = json!({ "to": "300,0,600,0,0", "scene": scene }).to_string();
    thread::scope(|scope| {
        let plans = [(); 4].map(|()| scope.spawn(|| ask("/plans?robot=lab", &body)));
        check_service(&lab, "four plans through it");
        for plan in plans {
            // On a busy machine a plan takes longer than the service allows.
            let (status, text) = plan.join().unwrap();
            assert!(
                status == 200 || status == 422 && text.contains("no plan was found and checked within"),
                "{status}: {text}"
            );
        }
    });
    check("after them");
}
