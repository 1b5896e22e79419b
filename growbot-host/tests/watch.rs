//! Tests of the live page of a growth, requested over HTTP by all kinds of clients. The server must respond only to
//! clients on this machine that know the secret token.

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::Arc;

use growbot_client::growth::CommandQueue;
use growbot_core::plan::Planner;
use growbot_core::pose::Pose;
use growbot_pictures::view::Subject;
use growbot_plan::job::{Job, JobEvent};
use growbot_plan::plan::{Plan, PlanOptions};
use growbot_serve::watch::WatchPage;
use running::{PATIENCE, growbot};
use serde_json::{Value, json};

use crate::running;

/// Starts the live page of a growth of 40 mm. The page can send commands only if `orders` is given.
fn watch(orders: Option<Arc<CommandQueue>>) -> WatchPage {
    let robot = growbot_plan::robot_file::load("growbot-a".as_ref()).unwrap();
    let up = |z| Pose::from_degrees([0.0, 0.0, z, 0.0, 90.0]).unwrap();
    let search = PlanOptions { radius: 100.0, planner: Planner::Shortest, avoid_self_collision: false };
    let plan = Plan::through_waypoints(&robot, &up(0.0), &[], &up(40.0), &search).unwrap();
    let job = Job::of_plan(&robot, &plan);
    let subject = Subject { name: "plan.json", robot: &robot, plan: &plan, run: None, laid: None, scene: None };
    WatchPage::start(&subject, &job, &[], orders, 0).unwrap()
}

/// Returns the address of the page's server, and the path with the secret token.
fn parts(watch: &WatchPage) -> (SocketAddr, String) {
    let (address, path) = watch.address().strip_prefix("http://").unwrap().split_once('/').unwrap();
    (address.parse().unwrap(), format!("/{path}"))
}

fn send(address: SocketAddr, method: &str, path: &str, headers: &[(&str, &str)]) -> TcpStream {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let host = address.to_string();
    let mut request = format!("{method} {path} HTTP/1.1\r\nConnection: close\r\nContent-Length: 0\r\n");
    if !headers.iter().any(|(name, _)| *name == "Host") {
        request += &format!("Host: {host}\r\n");
    }
    for (name, value) in headers {
        request += &format!("{name}: {value}\r\n");
    }
    stream.write_all(format!("{request}\r\n").as_bytes()).unwrap();
    stream
}

/// Sends a request, and returns the status and the body of the response.
fn ask(address: SocketAddr, method: &str, path: &str, headers: &[(&str, &str)]) -> (u16, String) {
    let mut answer = String::new();
    send(address, method, path, headers).read_to_string(&mut answer).unwrap();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    (head.split(' ').nth(1).unwrap().parse().unwrap(), body.to_owned())
}

#[test]
fn the_page_is_served_only_at_its_secret_address() {
    let watch = watch(Some(Arc::default()));
    let (address, path) = parts(&watch);
    assert!(address.ip().is_loopback());
    assert_eq!(path.len(), 34);
    let (status, page) = ask(address, "GET", &path, &[]);
    assert_eq!(status, 200);
    assert!(page.contains("connect-src 'self'") && page.contains("\"live\":{\"control\":true}"));

    let nothing = (404, String::new());
    let wrong = path.replace(&path[1..2], if &path[1..2] == "0" { "1" } else { "0" });
    for path in
        ["/", "/updates", "/commands/stop", &wrong, &path[..33], &format!("{path}x"), &format!("{path}commands/dance")]
    {
        assert_eq!(ask(address, "GET", path, &[]), nothing, "{path}");
        assert_eq!(ask(address, "POST", path, &[]), nothing, "{path}");
    }
    let update = format!("{path}updates");
    let stop = format!("{path}commands/stop");
    for other in [
        ("Host", "evil.example"),
        ("Origin", "http://evil.example"),
        ("Origin", "null"),
        ("Sec-Fetch-Site", "cross-site"),
    ] {
        for (method, path) in [("GET", &path), ("GET", &update), ("POST", &stop)] {
            assert_eq!(ask(address, method, path, &[other]), nothing, "{method} {path} {other:?}");
        }
    }
    // A forwarded port has another number.
    let forwarded = [("Host", "localhost:8080"), ("Origin", "http://localhost:8080")];
    assert_eq!(ask(address, "GET", &path, &forwarded).0, 200);
}

#[test]
fn the_page_is_served_on_loopback_only() {
    let watch = watch(None);
    let port = parts(&watch).0.port();
    // The address of this machine for others. Nothing is sent.
    let own = UdpSocket::bind("0.0.0.0:0").unwrap();
    let outside = own.connect("192.0.2.1:9").and_then(|()| own.local_addr()).map(|address| address.ip());
    match outside {
        Ok(ip) if !ip.is_loopback() => {
            let error = TcpStream::connect_timeout(&SocketAddr::new(ip, port), PATIENCE).unwrap_err();
            assert_eq!(error.kind(), ErrorKind::ConnectionRefused, "{ip}: {error}");
        }
        // On a machine without a network, the test binds the port at another loopback address to show that it is free.
        _ => drop(TcpListener::bind(("127.0.0.2", port)).unwrap()),
    }
}

#[test]
fn commands_need_control_access() {
    let orders = Arc::new(CommandQueue::default());
    let controlling = watch(Some(Arc::clone(&orders)));
    let (address, path) = parts(&controlling);
    let origin = format!("http://{address}");
    assert_eq!(ask(address, "GET", &format!("{path}commands/stop"), &[]).0, 404);
    assert!(!orders.stop_requested());
    assert_eq!(ask(address, "POST", &format!("{path}commands/stop"), &[("Origin", &origin)]).0, 202);
    assert!(orders.stop_requested());

    let looking = watch(None);
    let (address, path) = parts(&looking);
    let (status, why) = ask(address, "POST", &format!("{path}commands/stop"), &[]);
    assert_eq!(status, 403);
    assert!(why.contains("may control the robot"), "{why}");
    assert!(ask(address, "GET", &path, &[]).1.contains("\"live\":{\"control\":false}"));
}

#[test]
fn updates_are_streamed_and_the_end_is_last() {
    let watch = watch(None);
    let (address, path) = parts(&watch);
    let stream = send(address, "GET", &format!("{path}updates"), &[]);
    let mut lines = BufReader::new(stream).lines().map(Result::unwrap);
    let mut next = move || -> Option<Value> {
        lines.find(|line| line == "event: update")?;
        let line = lines.next()?;
        Some(serde_json::from_str(&line["data: ".len()..]).unwrap())
    };
    let first = next().unwrap();
    assert_eq!((&first["state"], &first["layers"]["built"]), (&json!("starting"), &json!("")));
    let total = first["total_layers"].as_u64().unwrap();
    assert!(total > 50);
    for index in 0..3 {
        watch.ingest(&JobEvent::Laid { index, as_built: Some([index as u8; 12]), measured: None });
    }
    let mut laid = 0;
    while laid < 3 {
        let update = next().unwrap();
        assert_eq!(update["layers"]["from"].as_u64(), Some(laid));
        laid += update["layers"]["built"].as_str().unwrap().len() as u64 / 24;
        assert_eq!(update["remaining_s"].as_f64(), Some((total - laid) as f64 * 18.0));
    }
    watch.end(serde_json::from_value(json!({ "outcome": "stopped" })).unwrap());
    let last = std::iter::from_fn(next).last().unwrap();
    assert_eq!(last["result"]["outcome"], "stopped");
    assert_eq!(TcpStream::connect(address).unwrap_err().kind(), ErrorKind::ConnectionRefused);
}

#[test]
fn failed_watching_gives_the_reason() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    let goal = ["grow", "--to", "0,0,40,0,90"];
    for (args, part) in [
        (vec!["--watch", "--watch-port", &port], "choose another port with --watch-port"),
        (vec!["--control"], "--watch"),
        (vec!["--watch-port", "0"], "--watch"),
        (vec!["--pace", "0"], "not between 0.1 and"),
        (vec!["--pace", "1e-300"], "not between 0.1 and"),
        (vec!["--pace", "fast"], "is not a number"),
        (vec!["--pace", "nan"], "not between 0.1 and"),
        (vec!["--pace", "2", "--port", "tcp:127.0.0.1:1"], "--pace applies only to --port sim"),
    ] {
        let ran = growbot(&[&goal[..], &args].concat());
        assert_eq!(ran.code, Some(2), "{args:?}: {}", ran.err);
        assert!(ran.err.contains(part) && !ran.err.contains("panicked") && ran.out.is_empty(), "{args:?}: {}", ran.err);
    }
}

#[test]
fn a_watched_growth_ends_like_an_unwatched_one() {
    let goal = ["grow", "--to", "0,0,40,0,90", "--json"];
    let plain = growbot(&goal);
    let watched = growbot(&[&goal[..], &["--watch", "--pace", "100000"]].concat());
    assert_eq!((watched.code, &watched.out), (Some(0), &plain.out));
    assert!(watched.err.contains("note: live view: http://127.0.0.1:"), "{}", watched.err);
}
