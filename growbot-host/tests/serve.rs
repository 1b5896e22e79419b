//! The service, as its users meet it: the program itself, killed and started again, asked rightly and wrongly.

mod running;

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use growbot_client::growth::as_built_hash;
use growbot_client::run_log::RunRecord;
use growbot_core::random::Random;
use running::{PROGRAM, command};
use serde_json::{Value, json};

/// Nothing takes so long, on however busy a machine.
const PATIENCE: Duration = Duration::from_secs(120);
/// A body of robot A2 of so many layers.
const GOAL: &str = "0,0,60,0,90";
const LAYERS: usize = 78;

/// A user with a service and a simulated robot.
struct Lab {
    directory: tempfile::TempDir,
    service: Option<Child>,
    pages: Option<(u16, [String; 2])>,
}

impl Lab {
    fn new(pace: f64) -> Self {
        let directory = tempfile::tempdir().unwrap();
        let settings = format!(
            "robot = \"growbot-a2\"\nport = \"sim:lab\"\n[robots.lab]\nport = \"sim:lab\"\nrobot = \"growbot-a2\"\npace = {pace}\n"
        );
        fs::write(directory.path().join("growbot.toml"), settings).unwrap();
        fs::create_dir(directory.path().join("run")).unwrap();
        let mut lab = Self { directory, service: None, pages: None };
        lab.start();
        lab
    }

    fn command(&self, args: &[&str]) -> Command {
        let mut command = command(PROGRAM);
        command.current_dir(self.directory.path());
        command.env("XDG_STATE_HOME", self.directory.path().join("state"));
        command.env("XDG_RUNTIME_DIR", self.directory.path().join("run"));
        command.args(args).stdin(Stdio::null());
        command
    }

    /// What a command prints, and its exit code.
    fn run(&self, args: &[&str]) -> (Option<i32>, String) {
        let output = self.command(args).output().unwrap();
        let text = [output.stdout, output.stderr].concat();
        (output.status.code(), String::from_utf8(text).unwrap())
    }

    fn start(&mut self) {
        let port = self.pages.as_ref().map_or(0, |(port, _)| *port).to_string();
        let said = self.directory.path().join("said");
        let out = fs::File::create(&said).unwrap();
        let service = self.command(&["serve", "--page-port", &port]).stdout(out).stderr(Stdio::null()).spawn().unwrap();
        self.service = Some(service);
        let text = wait_for("the service says its addresses", || {
            let text = fs::read_to_string(&said).unwrap();
            (text.lines().count() == 2).then_some(text)
        });
        let addresses: Vec<&str> = text.lines().filter_map(|line| line.split_whitespace().last()).collect();
        let of = |address: &str| {
            let rest = address.strip_prefix("http://127.0.0.1:").unwrap();
            let (port, token) = rest.trim_end_matches('/').split_once('/').unwrap();
            (port.parse::<u16>().unwrap(), token.to_owned())
        };
        let (port, operate) = of(addresses[0]);
        let pages = (port, [operate, of(addresses[1]).1]);
        assert!(self.pages.as_ref().is_none_or(|before| *before == pages), "the pages are where they were");
        self.pages = Some(pages);
    }

    fn kill(&mut self) {
        let mut service = self.service.take().unwrap();
        service.kill().unwrap();
        service.wait().unwrap();
    }

    fn socket(&self) -> PathBuf {
        self.directory.path().join("run/growbot/serve.sock")
    }

    /// Asks on the user's socket.
    fn ask(&self, method: &str, path: &str, body: &str) -> (u16, Value) {
        let stream = UnixStream::connect(self.socket()).unwrap();
        let (status, text) = http(stream, method, &format!("/api/v1{path}"), &[], body);
        (status, serde_json::from_str(&text).unwrap_or(Value::String(text)))
    }

    /// Asks at the pages' address with these headers.
    fn ask_page(&self, path: &str, headers: &[&str], method: &str, body: &str) -> u16 {
        let stream = TcpStream::connect(("127.0.0.1", self.pages.as_ref().unwrap().0)).unwrap();
        http(stream, method, path, headers, body).0
    }

    fn wait_until_ready(&self) {
        wait_for("the robot is ready", || {
            let (_, robot) = self.ask("GET", "/robots/lab", "");
            (robot["state"] == "ready").then_some(())
        });
    }

    fn wait_for_end(&self, job: &str) -> Value {
        wait_for("the job ends", || {
            let (_, job) = self.ask("GET", &format!("/jobs/{job}"), "");
            (job["state"] != "active").then_some(job)
        })
    }

    fn log(&self, job: &str) -> PathBuf {
        self.directory.path().join(format!("state/growbot/serve/jobs/{job}.jsonl"))
    }
}

impl Drop for Lab {
    fn drop(&mut self) {
        if let Some(mut service) = self.service.take() {
            let _ = service.kill();
            let _ = service.wait();
        }
        let _ = self.command(&["power", "off", "--port", "sim:lab"]).output();
    }
}

fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let began = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(began.elapsed() < PATIENCE, "{what}: not within {PATIENCE:?}");
        sleep(Duration::from_millis(10));
    }
}

/// One request by hand, so that wrong ones can be made too: the status and the body of the answer.
fn http(mut stream: impl Read + Write, method: &str, path: &str, headers: &[&str], body: &str) -> (u16, String) {
    let mut request = format!("{method} {path} HTTP/1.1\r\nconnection: close\r\ncontent-length: {}\r\n", body.len());
    let said = |name: &str| headers.iter().any(|header| header.to_lowercase().starts_with(name));
    for (name, value) in [("host:", "localhost"), ("content-type:", "application/json")] {
        if !said(name) {
            request += &format!("{name} {value}\r\n");
        }
    }
    headers.iter().for_each(|header| request += &format!("{header}\r\n"));
    request += &format!("\r\n{body}");
    // It may answer, and close, before it has everything.
    let _ = stream.write_all(request.as_bytes());
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    let answer = String::from_utf8_lossy(&answer).into_owned();
    let status = answer.split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0);
    let (head, body) = answer.split_once("\r\n\r\n").unwrap_or_default();
    let is_chunked = head.to_lowercase().contains("transfer-encoding: chunked");
    (status, if is_chunked { unchunked(body) } else { body.to_owned() })
}

fn unchunked(mut text: &str) -> String {
    let mut whole = String::new();
    while let Some((length, rest)) = text.split_once("\r\n") {
        let Ok(length @ 1..) = usize::from_str_radix(length, 16) else { break };
        whole += &rest[..length];
        text = &rest[length + 2..];
    }
    whole
}

/// Indices of the layers that a log says are laid, in order.
fn laid(log: &Path) -> Vec<u64> {
    let text = fs::read_to_string(log).unwrap();
    let events = text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    events.filter(|event| event["event"] == "laid").map(|event| event["layer"].as_u64().unwrap()).collect()
}

/// The service is killed again and again, at moments that a seed draws: GROWBOT_KILLS=200 for the complete campaign.
#[test]
fn a_service_that_is_killed_finds_its_robot_and_lays_each_layer_once() {
    let kills: usize = std::env::var("GROWBOT_KILLS").map_or(6, |kills| kills.parse().unwrap());
    let mut lab = Lab::new(20.0);
    lab.wait_until_ready();
    let (status, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": GOAL }).to_string());
    assert_eq!(status, 201, "{job}");
    let undisturbed = lab.wait_for_end(job["id"].as_str().unwrap());
    assert_eq!(undisturbed["state"], "done");
    let built = |job: &Value| {
        let record = RunRecord::open(&lab_log(&lab, job)).unwrap();
        assert_eq!(record.as_built.len(), LAYERS);
        as_built_hash(&record.as_built)
    };
    let hash = built(&undisturbed);
    let mut random = Random::new(&[19, 1]);
    let (mut done, mut growths) = (0, 0);
    while done < kills {
        growths += 1;
        let (status, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": GOAL }).to_string());
        assert_eq!(status, 201, "{job}");
        let id = job["id"].as_str().unwrap().to_owned();
        for _ in 0..4 {
            sleep(Duration::from_millis((2000.0 * (0.5 + 0.5 * random.even())) as u64));
            lab.kill();
            sleep(Duration::from_millis((300.0 * (0.5 + 0.5 * random.even())) as u64));
            lab.start();
            done += 1;
        }
        let job = lab.wait_for_end(&id);
        assert_eq!(job["state"], "done", "{job}");
        assert_eq!(laid(&lab.log(&id)), (0..LAYERS as u64).collect::<Vec<_>>());
        let record = RunRecord::open(&lab.log(&id)).unwrap();
        assert_eq!(as_built_hash(&record.as_built), hash, "growth {growths}");
        let database =
            rusqlite::Connection::open(lab.directory.path().join("state/growbot/serve/jobs.sqlite")).unwrap();
        let check: String = database.query_row("PRAGMA integrity_check", [], |row| row.get(0)).unwrap();
        assert_eq!(check, "ok");
    }
    println!("{done} kills in {growths} growths of {LAYERS} layers: each layer laid once, as without");
}

fn lab_log(lab: &Lab, job: &Value) -> PathBuf {
    lab.log(job["id"].as_str().unwrap())
}

#[test]
fn commands_ask_the_service_that_owns_their_robot() {
    let lab = Lab::new(5.0);
    lab.wait_until_ready();
    let (code, said) = lab.run(&["status"]);
    assert!(code == Some(0) && said.contains("owned by the service, simulated"), "{said}");
    let growth = lab.command(&["grow", "--to", "100,100,600,0,45", "--log", "copy.jsonl"]);
    let mut growth = { growth }.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let state = |wanted: &str| {
        wait_for(wanted, || {
            let (_, said) = lab.run(&["status", "--json"]);
            let status: Value = serde_json::from_str(&said).unwrap();
            (status["state"] == wanted).then_some(status)
        })
    };
    state("growing");
    let (code, said) = lab.run(&["grow", "--to", GOAL]);
    assert!(code == Some(1) && said.contains("has a job"), "{said}");
    assert_eq!(lab.run(&["pause"]).0, Some(0));
    let paused = state("paused");
    assert!(paused["pause_cause"] == "as asked" && paused["laid"].as_u64() > Some(0), "{paused}");
    assert_eq!(lab.run(&["continue"]).0, Some(0));
    state("growing");
    let (code, said) = lab.run(&["estop"]);
    assert!(code == Some(0) && said.starts_with("emergency stop"), "{said}");
    assert_eq!(growth.wait().unwrap().code(), Some(1));
    let copy = RunRecord::open(&lab.directory.path().join("copy.jsonl")).unwrap();
    assert_eq!(copy.outcome().name(), "stopped");
    let (code, said) = lab.run(&["pause"]);
    assert!(code == Some(1) && said.contains("nothing to pause"), "{said}");
    let (status, _) = lab.ask("POST", "/robots/lab/orders", r#"{"order":"clear-fault"}"#);
    assert_eq!(status, 200);
    assert_eq!(lab.run(&["maintain", "preheat", "120"]).0, Some(0));
    assert_eq!(lab.run(&["cancel"]).0, Some(0));
    let (code, said) = lab.run(&["serve", "--page-port", "0"]);
    assert!(code == Some(2) && said.contains("another growbot serve"), "{said}");
}

#[test]
fn a_frozen_service_does_not_keep_the_emergency_stop_from_the_robot() {
    let lab = Lab::new(5.0);
    lab.wait_until_ready();
    let pid = lab.service.as_ref().unwrap().id().to_string();
    assert!(command("kill").args(["-STOP", &pid]).status().unwrap().success());
    let (code, said) = lab.run(&["estop"]);
    assert!(command("kill").args(["-CONT", &pid]).status().unwrap().success());
    assert!(code == Some(0) && said.starts_with("emergency stop"), "{said}");
    wait_for("the service hears of it", || {
        let (_, robot) = lab.ask("GET", "/robots/lab", "");
        (robot["board"] == "emergency-stop").then_some(())
    });
}

#[test]
fn who_may_not_ask_is_refused_and_what_is_wrong_is_told() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let (_, [operate, read]) = lab.pages.clone().unwrap();
    let at = |token: &str, path: &str| format!("/{token}/{path}");
    let stop = r#"{"order":"stop"}"#;
    let order = at(&operate, "api/v1/robots/lab/orders");
    let local = "host: 127.0.0.1";
    let cases: [(u16, &str, String, &[&str], &str); 18] = [
        (200, "GET", at(&operate, ""), &[local], ""),
        (200, "GET", at(&read, "robots.js"), &[local], ""),
        (200, "GET", at(&read, "api/v1/robots"), &[local], ""),
        (200, "POST", order.clone(), &[local], stop),
        (403, "POST", at(&read, "api/v1/robots/lab/orders"), &[local], stop),
        (403, "POST", at(&read, "api/v1/robots/lab/jobs"), &[local], r#"{"to":"0,0,60"}"#),
        (404, "GET", "/".to_owned(), &[local], ""),
        (404, "GET", at(&"0".repeat(32), ""), &[local], ""),
        (404, "GET", at(&operate, "api/v1/jobs/..%2f..%2ftokens/log"), &[local], ""),
        (404, "GET", at(&operate, "../tokens"), &[local], ""),
        (404, "POST", order.clone(), &["host: evil.example"], stop),
        (404, "POST", order.clone(), &[local, "origin: http://evil.example"], stop),
        (404, "POST", order.clone(), &[local, "sec-fetch-site: cross-site"], stop),
        (415, "POST", order.clone(), &[local, "content-type: text/plain"], stop),
        (422, "POST", order.clone(), &[local], r#"{"order":"dance"}"#),
        (400, "POST", order.clone(), &[local], "{"),
        (422, "POST", at(&operate, "api/v1/robots/lab/jobs"), &[local], r#"{"to":"0,0,nan"}"#),
        (404, "POST", at(&operate, "api/v1/robots/none/orders"), &[local], stop),
    ];
    for (status, method, path, headers, body) in cases {
        assert_eq!(lab.ask_page(&path, headers, method, body), status, "{method} {path} {headers:?} {body}");
    }
    let huge = format!(r#"{{"to":"{}"}}"#, "0".repeat(17 << 20));
    assert_eq!(lab.ask("POST", "/robots/lab/jobs", &huge).0, 413);
    let key = ["idempotency-key: once"];
    let begin = || {
        let stream = UnixStream::connect(lab.socket()).unwrap();
        http(stream, "POST", "/api/v1/robots/lab/jobs", &key, &json!({ "to": GOAL }).to_string())
    };
    let ((first, one), (second, other)) = (begin(), begin());
    let id = |text: &str| serde_json::from_str::<Value>(text).unwrap()["id"].clone();
    assert_eq!((first, second, id(&one)), (201, 200, id(&other)));
    let (_, document) = lab.ask("GET", "/openapi.json", "");
    assert_eq!(document["openapi"], "3.1.0");
    assert!(document["paths"].as_object().unwrap().len() >= 8, "{document}");
}

#[test]
fn the_list_of_jobs_is_made_anew_from_the_run_logs() {
    let mut lab = Lab::new(100.0);
    lab.wait_until_ready();
    let (_, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": GOAL }).to_string());
    let id = job["id"].as_str().unwrap().to_owned();
    assert_eq!(lab.wait_for_end(&id)["state"], "done");
    let database = lab.directory.path().join("state/growbot/serve/jobs.sqlite");
    for damage in [None, Some("this is no database")] {
        lab.kill();
        for extra in ["-wal", "-shm"] {
            let _ = fs::remove_file(format!("{}{extra}", database.display()));
        }
        match damage {
            None => fs::remove_file(&database).unwrap(),
            Some(words) => fs::write(&database, words.repeat(1000)).unwrap(),
        }
        lab.start();
        let (_, jobs) = lab.ask("GET", "/jobs", "");
        assert_eq!(jobs.as_array().unwrap().len(), 1);
        assert_eq!((&jobs[0]["id"], &jobs[0]["state"], &jobs[0]["laid"]), (&json!(id), &json!("done"), &json!(LAYERS)));
    }
}
