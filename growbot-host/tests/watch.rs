//! Tests of the live page of a growth, requested over HTTP by all kinds of clients. The server must respond only to
//! clients on this machine that know the secret token.

use std::io::{BufRead, BufReader, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::Arc;

use growbot_client::growth::CommandQueue;
use growbot_client::status::RobotStatus;
use growbot_core::link::message::State;
use growbot_core::plan::Planner;
use growbot_core::pose::Pose;
use growbot_pictures::view::Subject;
use growbot_plan::job::{Job, JobEvent};
use growbot_plan::plan::{Plan, PlanOptions};
use growbot_serve::watch::WatchPage;
use running::{PATIENCE, PROGRAM, command, growbot};
use serde_json::{Value, json};

use crate::lab::Lab;
use crate::running;

/// Starts the live page of a growth of 40 mm. The page can send commands only if `orders` is given.
fn watch(orders: Option<Arc<CommandQueue>>) -> WatchPage {
    let robot = growbot_plan::robot_file::load("growbot-a".as_ref()).unwrap();
    let up = |z| Pose::from_degrees([0.0, 0.0, z, 0.0, 90.0]).unwrap();
    let search = PlanOptions { radius: 100.0, planner: Planner::Shortest, avoid_self_collision: false, existing: None };
    let plan = Plan::through_waypoints(&robot, &up(0.0), &[], &up(40.0), &search).unwrap();
    let job = Job::of_plan(&robot, &plan);
    let subject = Subject { name: "plan.json", robot: &robot, plan: &plan, run: None, laid: None, scene: None };
    let status = RobotStatus { port: "sim".to_owned(), simulated: true, ..RobotStatus::default() };
    WatchPage::start(&subject, &job, &[], status, orders, 0).unwrap()
}

/// Path of the live page below the path of its rights.
const LIVE: &str = "api/v1/jobs/growth/live/";

/// Returns the address of the page's server, and the path with the secret token.
fn server(watch: &WatchPage) -> (SocketAddr, String) {
    let (address, path) = watch.address().strip_prefix("http://").unwrap().split_once('/').unwrap();
    (address.parse().unwrap(), format!("/{path}"))
}

/// Returns the address of the page's server, and the path of the live page with the secret token.
fn parts(watch: &WatchPage) -> (SocketAddr, String) {
    let (address, path) = server(watch);
    (address, path + LIVE)
}

fn send(address: SocketAddr, method: &str, path: &str, headers: &[(&str, &str)]) -> TcpStream {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    let host = address.to_string();
    let mut request = format!("{method} {path} HTTP/1.1\r\nContent-Length: 0\r\n");
    for (name, value) in [("Host", &*host), ("Connection", "close")] {
        if !headers.iter().any(|(given, _)| *given == name) {
            request += &format!("{name}: {value}\r\n");
        }
    }
    for (name, value) in headers {
        request += &format!("{name}: {value}\r\n");
    }
    stream.write_all(format!("{request}\r\n").as_bytes()).unwrap();
    stream
}

/// Sends a request, and returns the head and the body of the response.
fn respond(address: SocketAddr, method: &str, path: &str, headers: &[(&str, &str)]) -> (String, String) {
    let mut answer = String::new();
    send(address, method, path, headers).read_to_string(&mut answer).unwrap();
    let (head, body) = answer.split_once("\r\n\r\n").unwrap();
    (head.to_owned(), body.to_owned())
}

/// Sends a request, and returns the status and the body of the response.
fn ask(address: SocketAddr, method: &str, path: &str, headers: &[(&str, &str)]) -> (u16, String) {
    let (head, body) = respond(address, method, path, headers);
    (head.split(' ').nth(1).unwrap().parse().unwrap(), body)
}

/// Returns the value of a header in the head of a response.
fn header<'a>(head: &'a str, name: &str) -> &'a str {
    let lines = head.lines().filter_map(|line| line.split_once(": "));
    { lines }.find(|(of, _)| of.eq_ignore_ascii_case(name)).unwrap_or_else(|| panic!("no {name}: {head}")).1
}

#[test]
fn the_page_is_served_only_at_its_secret_address() {
    let watch = watch(Some(Arc::default()));
    let (address, start) = server(&watch);
    assert!(address.ip().is_loopback());
    assert_eq!(start.len(), 34);
    let path = format!("{start}{LIVE}");
    let (status, page) = ask(address, "GET", &path, &[]);
    assert_eq!(status, 200);
    assert!(page.contains("connect-src 'self'") && page.contains("\"live\":{\"control\":true}"));

    let nothing = (404, String::new());
    let wrong = format!("/{}{}", if &start[1..2] == "0" { "1" } else { "0" }, &path[2..]);
    for path in ["/", "/updates", "/api/v1/robots", &format!("/{LIVE}"), &wrong, &start[..33], "/view/", "/view/api/"] {
        assert_eq!(ask(address, "GET", path, &[]), nothing, "{path}");
        assert_eq!(ask(address, "POST", path, &[]), nothing, "{path}");
    }
    // Without the token, in the address or in a header, the address that browsers show is of no use.
    for (method, below) in [("GET", ""), ("GET", LIVE), ("POST", "api/v1/jobs/growth/live/commands/stop")] {
        let (status, why) = ask(address, method, &format!("/control/{below}"), &[]);
        assert!(status == 401 && why.contains("no access token"), "{below}: {status} {why}");
    }
    for (method, below) in [("GET", "x"), ("GET", "commands/stop"), ("POST", "commands/dance")] {
        let (status, why) = ask(address, method, &format!("{path}{below}"), &[]);
        assert!([404, 405].contains(&status) && why.contains("\"detail\""), "{below}: {status} {why}");
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

/// A browser gets the token as a cookie, and arrives at the live page without the token in its address.
#[test]
fn a_browser_is_led_to_the_live_page() {
    for (watch, rights) in [(watch(None), "view"), (watch(Some(Arc::default())), "control")] {
        let (address, start) = server(&watch);
        let (head, _) = respond(address, "GET", &start, &[("Accept", "text/html")]);
        assert!(head.starts_with("HTTP/1.1 303 ") && header(&head, "location") == format!("../{rights}/"), "{head}");
        let cookie = header(&head, "set-cookie");
        assert!(cookie.contains("; HttpOnly; SameSite=Strict"), "{cookie}");
        let cookie = [("Cookie", cookie.split(';').next().unwrap())];
        let (head, _) = respond(address, "GET", &format!("/{rights}/"), &cookie);
        assert!(head.starts_with("HTTP/1.1 303 ") && header(&head, "location") == LIVE, "{head}");
        assert_eq!(ask(address, "GET", &format!("/{rights}/{LIVE}"), &cookie).0, 200);
        let other = if rights == "view" { "control" } else { "view" };
        assert_eq!(ask(address, "GET", &format!("/{other}/{LIVE}"), &cookie), (404, String::new()));
    }
}

/// The page of a growth in this process has the robot of the growth. It has no list of jobs, plans or scenes, and no
/// commands to a robot without its growth.
#[test]
fn the_robot_of_the_growth_is_all_that_is_shown() {
    let watch = watch(Some(Arc::default()));
    let (address, start) = server(&watch);
    let api = |method: &str, path: &str| ask(address, method, &format!("{start}api/v1{path}"), &[]);
    let json = |path: &str| serde_json::from_str::<Value>(&api("GET", path).1).unwrap();
    let robot = || json("/robots/growbot-a");
    let first = robot();
    assert_eq!((&first["port"], &first["simulated"], &first["job"]), (&json!("sim"), &json!(true), &json!("growth")));
    assert_eq!((&first["state"], &first["stale"]), (&Value::Null, &json!(true)));
    watch.growth().ingest(&JobEvent::State(State::Heating));
    watch.growth().ingest(&JobEvent::Laid { index: 0, as_built: None, measured: None });
    let later = robot();
    assert_eq!((&later["state"], &later["stale"], &later["laid"]), (&json!("heating"), &json!(false), &json!(1)));
    assert_eq!(json("/robots").as_array().unwrap().len(), 1);
    assert_eq!(json("/access"), json!({ "can_control": true }));
    for (method, path) in [
        ("GET", "/jobs"),
        ("GET", "/jobs/growth"),
        ("GET", "/jobs/growth/log"),
        ("GET", "/jobs/growth/view"),
        ("GET", "/jobs/other/live/"),
        ("POST", "/jobs/other/live/commands/stop"),
        ("POST", "/jobs/growth/resume"),
        ("POST", "/robots/growbot-a/jobs"),
        ("POST", "/robots/growbot-a/commands"),
        ("POST", "/robots/growbot-a/maintenance"),
        ("POST", "/robots/growbot-a/tuning"),
        ("POST", "/robots/growbot-a/port-lease"),
        ("POST", "/plans"),
        ("POST", "/scenes"),
        ("GET", "/page-urls"),
        ("GET", "/robots/other"),
    ] {
        assert_eq!(api(method, path).0, 404, "{method} {path}");
    }
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
    assert_eq!(ask(address, "GET", &format!("{path}commands/stop"), &[]).0, 405);
    assert!(!orders.stop_requested());
    assert_eq!(ask(address, "POST", &format!("{path}commands/stop"), &[("Origin", &origin)]).0, 202);
    assert!(orders.stop_requested());
    // An old order is refused, unless it stops or pauses the robot.
    let late = [("growbot-order-time", "0")];
    let (status, why) = ask(address, "POST", &format!("{path}commands/continue"), &late);
    assert!(status == 409 && why.contains("after it was given (limit 5 s)"), "{status} {why}");
    assert!(!orders.pause_waits());
    assert_eq!(ask(address, "POST", &format!("{path}commands/pause"), &late).0, 202);
    assert!(orders.pause_waits());

    let looking = watch(None);
    let (address, path) = parts(&looking);
    for below in ["commands/stop", "commands/emergency-stop", "commands/pause"] {
        let (status, why) = ask(address, "POST", &format!("{path}{below}"), &[]);
        assert!(status == 403 && why.contains("this URL is read-only"), "{status} {why}");
    }
    let upgrade = [
        ("Upgrade", "websocket"),
        ("Connection", "upgrade"),
        ("Sec-WebSocket-Version", "13"),
        ("Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ=="),
    ];
    assert_eq!(ask(address, "GET", &format!("{path}commands/ws"), &upgrade).0, 403);
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
        watch.growth().ingest(&JobEvent::Laid { index, as_built: Some([index as u8; 12]), measured: None });
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

/// Watching needs no service. It leaves no files, and does not touch a service that runs: neither its socket nor its
/// jobs.
#[test]
fn watching_leaves_no_files_and_works_beside_a_service() {
    let goal = ["grow", "--to", "0,0,40,0,90", "--port", "sim", "--watch", "--control", "--pace", "100000"];
    let directory = tempfile::tempdir().unwrap();
    let mut alone = command(PROGRAM);
    for variable in ["XDG_CONFIG_HOME", "XDG_STATE_HOME", "XDG_RUNTIME_DIR", "HOME"] {
        alone.env(variable, directory.path());
    }
    let ran = alone.current_dir(directory.path()).args(goal).output().unwrap();
    assert!(ran.status.success() && String::from_utf8_lossy(&ran.stderr).contains("live view: http://127.0.0.1:"));
    assert_eq!(std::fs::read_dir(directory.path()).unwrap().count(), 0);

    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let (code, text) = lab.run(&goal);
    let port = lab.pages.as_ref().unwrap().0;
    let is_own = text.contains("live view: http://127.0.0.1:") && !text.contains(&format!("127.0.0.1:{port}/"));
    assert!(code == Some(0) && is_own, "{text}");
    assert_eq!(lab.ask("GET", "/jobs", ""), (200, json!([])));
    assert!(lab.orders().is_empty());
}
