//! Tests of the cameras of robots: the service passes on nothing but pictures, within bounds, and stores one of each
//! layer.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, mpsc};
use std::thread;
use std::time::Duration;

use lab::{GOAL, Lab, wait_for};
use serde_json::{Value, json};

use crate::lab;
use crate::running;

const PICTURE: &[u8] = b"\xff\xd8\xff\xe0 a picture \xff\xd9";

/// A camera on this machine that sends a response to each request, by the request's path.
struct Camera {
    port: u16,
    requests: Arc<AtomicUsize>,
}

impl Camera {
    fn start(respond: impl Fn(&str) -> Vec<u8> + Send + 'static) -> Self {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let port = listener.local_addr().unwrap().port();
        let requests = Arc::new(AtomicUsize::new(0));
        let count = Arc::clone(&requests);
        thread::spawn(move || {
            for stream in listener.incoming() {
                let mut stream = stream.unwrap();
                let mut head = Vec::new();
                while !head.ends_with(b"\r\n\r\n") {
                    let mut byte = [0];
                    if stream.read(&mut byte).unwrap_or(0) == 0 {
                        break;
                    }
                    head.push(byte[0]);
                }
                count.fetch_add(1, Ordering::Relaxed);
                let head = String::from_utf8(head).unwrap();
                // The service may close the connection before it has read a long response.
                let _ = stream.write_all(&respond(head.split(' ').nth(1).unwrap_or_default()));
            }
        });
        Self { port, requests }
    }

    /// Returns the settings of a camera of the robot `lab` at this path.
    fn settings(&self, path: &str) -> String {
        format!("[serve.cameras]\nlab = \"http://127.0.0.1:{}/{path}\"\n", self.port)
    }
}

fn response(status: &str, headers: &str, body: &[u8]) -> Vec<u8> {
    let head = format!("HTTP/1.1 {status}\r\nconnection: close\r\n{headers}content-length: {}\r\n\r\n", body.len());
    [head.as_bytes(), body].concat()
}

fn picture() -> Value {
    String::from_utf8_lossy(PICTURE).into()
}

#[test]
fn a_picture_of_each_layer_is_stored_and_the_current_one_is_shown() {
    let camera = Camera::start(|path| {
        if path == "/s3cret" {
            return response("302 Found", "location: /stream\r\n", b"");
        }
        // A stream without an end.
        let head = "HTTP/1.1 200 OK\r\ncontent-type: multipart/x-mixed-replace; boundary=frame\r\n\r\n--frame\r\n\
                    content-type: image/jpeg\r\n\r\n";
        [head.as_bytes(), PICTURE, b"\r\n--frame\r\n", &[b'x'; 100_000]].concat()
    });
    let lab = Lab::with(60.0, &camera.settings("s3cret"));
    lab.wait_until_ready();
    assert_eq!(lab.ask("GET", "/cameras", "").1, json!(["lab"]));
    assert_eq!(lab.ask("GET", "/robots/lab/camera", ""), (200, picture()));
    let read_only = format!("/{}/api/v1/robots/lab/camera", lab.pages.as_ref().unwrap().1[1]);
    assert_eq!(lab.ask_page(&read_only, &[], "GET", ""), 200);
    let (status, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": GOAL }).to_string());
    assert_eq!(status, 201, "{job}");
    let job = job["id"].as_str().unwrap();
    let ended = lab.wait_for_end(job);
    // Each layer lasts a quarter of a second, in which a busy machine may read no picture.
    let snapshots = lab.ask("GET", &format!("/jobs/{job}/snapshots"), "").1;
    let layers: Vec<u64> = snapshots.as_array().unwrap().iter().map(|layer| layer.as_u64().unwrap()).collect();
    assert!(!layers.is_empty() && layers.is_sorted_by(|a, b| a < b), "{layers:?}");
    assert!(layers.iter().all(|layer| *layer < ended["layers"].as_u64().unwrap()), "{layers:?}");
    for layer in &layers {
        assert_eq!(lab.ask("GET", &format!("/jobs/{job}/snapshots/{layer}"), ""), (200, picture()));
    }
    for (path, status) in [
        (format!("/jobs/{job}/snapshots/{}", u32::MAX), 404),
        ("/jobs/none/snapshots".to_owned(), 404),
        ("/robots/none/camera".to_owned(), 404),
        (format!("/jobs/{job}/snapshots/..%2F..%2Fjobs.sqlite"), 400),
    ] {
        assert_eq!(lab.ask("GET", &path, "").0, status, "{path}");
    }
}

#[test]
fn only_pictures_within_bounds_pass_and_no_message_gives_anything_away() {
    let elsewhere = Camera::start(|_| response("200 OK", "content-type: image/jpeg\r\n", PICTURE));
    let other = elsewhere.port;
    let bad: [(&str, Vec<u8>, &str); 8] = [
        ("status", response("401 Give-me-a-password", "", b"s3cret words"), "HTTP status 401"),
        ("elsewhere", response("302 Found", &format!("location: http://127.0.0.1:{other}/\r\n"), b""), "redirects"),
        ("round", response("302 Found", "location: /round\r\n", b""), "redirects"),
        ("nowhere", response("302 Found", "", b""), "redirects"),
        ("page", response("200 OK", "content-type: image/jpeg\r\n", b"<script>s3cret()</script>"), "neither a JPEG"),
        ("drawing", response("200 OK", "content-type: image/svg+xml\r\n", b"<svg>s3cret</svg>"), "neither a JPEG"),
        ("long", response("200 OK", "", &[PICTURE, &[0; 5 << 20]].concat()), "more than 4 MiB"),
        ("nonsense", b"s3cret\r\n\r\n".to_vec(), "does not respond by HTTP"),
    ];
    let responses = bad.clone();
    let camera = Camera::start(move |path| {
        let found = responses.iter().find(|(name, ..)| path == format!("/s3cret/{name}") || path == format!("/{name}"));
        found.map_or_else(|| response("404 None", "", b""), |(_, response, _)| response.clone())
    });
    for (name, _, expected) in bad {
        let lab = Lab::with(1.0, &camera.settings(&format!("s3cret/{name}")));
        let (status, problem) = lab.ask("GET", "/robots/lab/camera", "");
        let detail = problem["detail"].as_str().unwrap_or_default();
        assert!(status == 502 && detail.contains(expected), "{name}: {problem}");
        assert!(!problem.to_string().contains("s3cret") && !lab.heard().contains("s3cret"), "{name}: {problem}");
    }
    assert_eq!(elsewhere.requests.load(Ordering::Relaxed), 0);
}

#[test]
fn clients_share_a_silent_camera_and_delay_no_stop() {
    let (release, is_released) = mpsc::channel::<()>();
    let camera = Camera::start(move |_| {
        let _ = is_released.recv();
        response("200 OK", "", PICTURE)
    });
    let lab = Lab::with(60.0, &camera.settings(""));
    lab.wait_until_ready();
    let path = format!("/{}/api/v1/robots/lab/camera", lab.pages.as_ref().unwrap().1[1]);
    let ask = || {
        let mut stream = lab.page();
        write!(stream, "GET {path} HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\n\r\n").unwrap();
        stream
    };
    // Some wait, and others have gone.
    let mut waiting: Vec<_> = (0..20).map(|_| ask()).collect();
    for _ in 0..100 {
        drop(ask());
    }
    wait_for("a request to the camera", || (camera.requests.load(Ordering::Relaxed) > 0).then_some(()));
    assert_eq!(lab.ask("POST", "/robots/lab/emergency-stop", "").0, 200);
    assert_eq!(lab.ask("GET", "/jobs", "").0, 200);
    drop(release);
    for stream in &mut waiting {
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer).unwrap();
        // On a busy machine the camera may be released too late.
        assert!(answer.starts_with(b"HTTP/1.1 200") || answer.starts_with(b"HTTP/1.1 502"), "{answer:?}");
    }
    assert!(camera.requests.load(Ordering::Relaxed) < 20);
}

#[test]
fn layers_that_are_reported_late_get_no_picture() {
    let camera = Camera::start(|_| response("200 OK", "", PICTURE));
    let mut lab = Lab::with(60.0, &camera.settings(""));
    lab.wait_until_ready();
    let (_, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": "0,0,100,0,90" }).to_string());
    let job = job["id"].as_str().unwrap();
    let laid = |lab: &Lab| lab.attended_robot("lab")["laid"].as_u64().unwrap_or(0);
    wait_for("three layers", || (laid(&lab) >= 3).then_some(()));
    lab.kill();
    // The robot lays more layers, which it reports to the next service.
    thread::sleep(Duration::from_secs(3));
    lab.start();
    let late = wait_for("the robot reports them", || {
        lab.attended_robot("lab");
        let log = fs::read_to_string(lab.log(job)).unwrap();
        let events: Vec<Value> = log.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
        let board = events.iter().rposition(|event| event["event"] == "board").filter(|at| *at > 1)?;
        let laid = |event: &Value| (event["event"] == "laid").then(|| event["layer"].as_u64().unwrap());
        let (before, after) = (events[..board].iter().filter_map(laid).max()?, events.iter().filter_map(laid).max()?);
        // The latest of them may have a picture.
        let latest = events[board]["laid"].as_u64()? - 1;
        (after > latest).then(|| before + 1..latest)
    });
    assert!(late.clone().count() > 1, "{late:?}");
    let layers = lab.ask("GET", &format!("/jobs/{job}/snapshots"), "").1;
    assert!(late.clone().all(|layer| !layers.as_array().unwrap().contains(&layer.into())), "{late:?}: {layers}");
}

#[test]
fn a_body_grows_on_if_its_camera_fails() {
    let camera = Camera::start(|_| response("500 s3cret", "x: s3cret\r\n", b"s3cret"));
    let lab = Lab::with(60.0, &camera.settings("s3cret"));
    lab.wait_until_ready();
    let (_, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": GOAL }).to_string());
    let job = job["id"].as_str().unwrap();
    assert_eq!(lab.wait_for_end(job)["state"], "done");
    assert_eq!(lab.ask("GET", &format!("/jobs/{job}/snapshots"), "").1, json!([]));
    let heard = running::in_lines(&lab.heard());
    assert!(heard.contains("no picture of lab is stored: the camera responds with the HTTP status 500"), "{heard}");
    assert!(!heard.contains("s3cret"), "{heard}");
}

#[test]
fn robots_without_a_camera_and_invalid_settings_are_refused() {
    // The robots of a project may be others than those of the user's own settings.
    let lab = Lab::with(1.0, "[serve.cameras]\nother = \"http://camera/s3cret\"\n");
    assert_eq!(lab.ask("GET", "/cameras", "").1, json!([]));
    assert_eq!(lab.ask("GET", "/robots/lab/camera", "").0, 404);
    let heard = running::in_lines(&lab.heard());
    assert!(heard.contains("names other, but the service has no such robot: its camera is not used"), "{heard}");
    assert!(!heard.contains("s3cret"), "{heard}");
    for (settings, expected) in [
        ("[serve.cameras]\nlab = \"camera/s3cret\"", "the camera of lab in [serve.cameras] cannot be used: give a URL"),
        ("[serve]\ncameras = \"http://camera/s3cret\"", "give the address of each robot's camera as a text"),
        ("[serve.cameras]\nlab = [\"http://camera/s3cret\"]", "give the address of each robot's camera as a text"),
    ] {
        let directory = tempfile::tempdir().unwrap();
        fs::create_dir(directory.path().join("growbot")).unwrap();
        let settings = format!("[robots.lab]\nport = \"sim:lab\"\n{settings}\n");
        fs::write(directory.path().join("growbot/growbot.toml"), &settings).unwrap();
        let mut serve = running::command(running::PROGRAM);
        serve.env("XDG_CONFIG_HOME", directory.path()).env("XDG_STATE_HOME", directory.path().join("state"));
        serve.env("XDG_RUNTIME_DIR", directory.path().join("state")).args(["serve", "--page-port", "0"]);
        let output = serve.output().unwrap();
        let message = running::in_lines(&String::from_utf8(output.stderr).unwrap());
        assert!(output.status.code() == Some(2) && message.contains(expected), "{settings}: {message}");
        assert!(!message.contains("s3cret"), "{message}");
    }
}
