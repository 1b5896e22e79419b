//! Tests of the service as its users meet it: the running program, killed and restarted, with valid and invalid
//! requests.

use std::fs;
use std::io::Write;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::thread::sleep;
use std::time::Duration;

use growbot_core::random::Rng;
use growbot_plan::growth_report::as_built_hash;
use growbot_plan::run_log::RecordedRun;
use lab::{GOAL, LAYERS, Lab, http, wait_for};
use running::command;
use serde_json::{Value, json};

use crate::fake_board::FakeBoard;
use crate::lab;
use crate::running;
use crate::schemas::{faults, schema};

/// Returns the indices of the layers that a run log reports as laid, in the order of the log.
fn laid(log: &Path) -> Vec<u64> {
    let text = fs::read_to_string(log).unwrap();
    let events = text.lines().filter_map(|line| serde_json::from_str::<Value>(line).ok());
    events.filter(|event| event["event"] == "laid").map(|event| event["layer"].as_u64().unwrap()).collect()
}

/// Kills and restarts the service repeatedly at random moments during growths. GROWBOT_KILLS=200 sets the number of
/// kills of the complete campaign.
#[test]
fn a_killed_service_resumes_and_lays_each_layer_once() {
    let kills: usize = std::env::var("GROWBOT_KILLS").map_or(6, |kills| kills.parse().unwrap());
    let mut lab = Lab::new(100.0);
    lab.wait_until_ready();
    let (status, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": GOAL }).to_string());
    assert_eq!(status, 201, "{job}");
    let undisturbed = lab.wait_for_end(job["id"].as_str().unwrap());
    assert_eq!(undisturbed["state"], "done");
    let built = |job: &Value| {
        let record = RecordedRun::open(&lab_log(&lab, job)).unwrap();
        assert_eq!(record.as_built.len(), LAYERS);
        as_built_hash(&record.as_built)
    };
    let hash = built(&undisturbed);
    let mut random = Rng::new(&[19, 1]);
    let (mut done, mut growths) = (0, 0);
    while done < kills {
        growths += 1;
        let job = wait_for("the body is begun", || {
            let (status, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": GOAL }).to_string());
            // The journal is full after some growths.
            let is_too_hot =
                job["detail"].as_str().is_some_and(|why| why.ends_with("wait until the nozzle has cooled"));
            assert!(status == 201 || is_too_hot, "{status} {job}");
            (status == 201).then_some(job)
        });
        let id = job["id"].as_str().unwrap().to_owned();
        for _ in 0..4 {
            sleep(Duration::from_millis((400.0 * (0.5 + 0.5 * random.uniform_symmetric())) as u64));
            lab.kill();
            sleep(Duration::from_millis((60.0 * (0.5 + 0.5 * random.uniform_symmetric())) as u64));
            lab.start();
            done += 1;
        }
        // A busy machine may restart the service so late that the board has parked. It then waits for a person.
        let job = wait_for("the job ends", || {
            if lab.ask("GET", "/robots/lab", "").1["state"] == "parked" {
                lab.ask("POST", "/robots/lab/commands", r#"{"command":"continue"}"#);
            }
            let (_, job) = lab.ask("GET", &format!("/jobs/{id}"), "");
            (job["state"] != "active").then_some(job)
        });
        assert_eq!(job["state"], "done", "{job}\n{}", lab.heard());
        assert_eq!(laid(&lab.log(&id)), (0..LAYERS as u64).collect::<Vec<_>>());
        let record = RecordedRun::open(&lab.log(&id)).unwrap();
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

/// Jobs are ordered while the service is still connecting to the robot.
#[test]
fn a_job_begun_right_after_startup_is_grown() {
    let mut lab = Lab::new(1000.0);
    lab.wait_until_ready();
    for _ in 0..5 {
        lab.kill();
        lab.start();
        let (status, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": GOAL }).to_string());
        assert_eq!(status, 201, "{job}");
        assert_eq!(lab.wait_for_end(job["id"].as_str().unwrap())["state"], "done", "{}", lab.heard());
    }
}

#[test]
fn commands_go_through_the_service_that_owns_the_robot() {
    let lab = Lab::new(50.0);
    lab.wait_until_ready();
    let (code, answer) = lab.run(&["status"]);
    assert!(code == Some(0) && answer.contains("owned by the service, simulated"), "{answer}");
    // The command prints the status of the service, which has the schema of a board's status without a service.
    let status: Value = serde_json::from_str(&lab.run(&["status", "--json"]).1).unwrap();
    assert_eq!(faults(&schema("status"), &status, ""), [""; 0], "{status}");
    assert_eq!(status["firmware"], env!("CARGO_PKG_VERSION"), "{status}");
    let fields = |status: &Value| status.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
    assert_eq!(fields(&lab.ask("GET", "/robots/lab", "").1), fields(&status));
    let growth = lab.command(&["grow", "--to", "100,100,600,0,45", "--log", "copy.jsonl"]);
    let mut growth = { growth }.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let state = |wanted: &str| {
        wait_for(wanted, || {
            let (_, answer) = lab.run(&["status", "--json"]);
            let status: Value = serde_json::from_str(&answer).unwrap();
            (status["state"] == wanted).then_some(status)
        })
    };
    state("growing");
    let (code, answer) = lab.run(&["grow", "--to", GOAL]);
    assert!(code == Some(1) && answer.contains("has an active job"), "{answer}");
    let report = |args: &[&str]| {
        let (code, answer) = lab.run(args);
        let report: Value = serde_json::from_str(&answer).unwrap_or_else(|_| panic!("{answer}"));
        assert_eq!((code, faults(&schema("command"), &report, "")), (Some(0), vec![]), "{report}");
        assert_eq!(report["simulated"], true, "{report}");
    };
    report(&["pause", "--json"]);
    let paused = state("paused");
    assert!(paused["pause_cause"] == "requested" && paused["laid"].as_u64() > Some(0), "{paused}");
    let recovery = || -> Value { serde_json::from_str(&lab.run(&["recover", "--json"]).1).unwrap() };
    assert_eq!(
        (recovery()["situation"].as_str(), recovery()["steps"][1]["action"].as_str()),
        (Some("paused"), Some("continue"))
    );
    assert_eq!(lab.ask("GET", "/robots/lab/recovery", "").1, recovery());
    // The growth moves filament in its pause, by the amounts of the board.
    assert_eq!(lab.run(&["maintain", "preheat"]).0, Some(0));
    let (code, answer) = lab.run(&["maintain", "load", "5"]);
    assert!(code == Some(1) && answer.contains("has an active job"), "{answer}");
    report(&["continue", "--json"]);
    state("growing");
    assert_eq!(recovery(), Value::Null);
    let (code, answer) = lab.run(&["maintain", "preheat"]);
    assert!(code == Some(1) && answer.contains("has an active job"), "{answer}");
    let (code, answer) = lab.run(&["estop"]);
    assert!(code == Some(0) && answer.starts_with("emergency stop"), "{answer}");
    assert_eq!(growth.wait().unwrap().code(), Some(1));
    let copy = RecordedRun::open(&lab.directory.path().join("copy.jsonl")).unwrap();
    assert_eq!(copy.outcome().name(), "stopped");
    let (code, answer) = lab.run(&["pause"]);
    assert!(code == Some(1) && answer.contains("has no active job"), "{answer}");
    let (status, _) = lab.ask("POST", "/robots/lab/commands", r#"{"command":"clear-fault"}"#);
    assert_eq!(status, 200);
    assert_eq!(lab.run(&["maintain", "preheat", "120"]).0, Some(0));
    assert_eq!(lab.run(&["cancel"]).0, Some(0));
    let (code, answer) = lab.run(&["serve", "--page-port", "0"]);
    assert!(code == Some(2) && answer.contains("already runs `growbot serve`"), "{answer}");
}

#[test]
fn a_frozen_service_does_not_block_the_emergency_stop() {
    let lab = Lab::new(5.0);
    lab.wait_until_ready();
    let pid = lab.service.as_ref().unwrap().id().to_string();
    assert!(command("kill").args(["-STOP", &pid]).status().unwrap().success());
    let (code, answer) = lab.run(&["estop"]);
    assert!(command("kill").args(["-CONT", &pid]).status().unwrap().success());
    assert!(code == Some(0) && answer.starts_with("emergency stop"), "{answer}");
    wait_for("the service hears of it", || {
        let (_, robot) = lab.ask("GET", "/robots/lab", "");
        (robot["state"] == "emergency-stop").then_some(())
    });
}

#[test]
fn ended_jobs_do_not_change() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let grow = |robot: &str| {
        let body = json!({ "to": GOAL }).to_string();
        let path = format!("/api/v1/robots/{robot}/jobs");
        let stream = UnixStream::connect(lab.socket()).unwrap();
        let (status, body) = http(stream, "POST", &path, &["idempotency-key: one"], &body);
        (status, serde_json::from_str::<Value>(&body).unwrap())
    };
    let (status, job) = grow("lab");
    assert_eq!(status, 201, "{job}");
    let id = job["id"].as_str().unwrap();
    let done = lab.wait_for_end(id);
    assert_eq!(done["state"], "done", "{done}");
    // A repeated request returns the same job.
    assert_eq!(grow("lab"), (200, done.clone()));
    let (status, problem) = lab.ask("POST", &format!("/jobs/{id}/resume"), "{}");
    assert!(status == 409 && problem["detail"].as_str().unwrap().contains("is done"), "{status} {problem}");
    assert_eq!(lab.ask("GET", &format!("/jobs/{id}"), "").1, done);
    let (code, answer) = lab.run(&["resume"]);
    assert!(code == Some(1) && answer.contains("no unfinished job"), "{answer}");
    for given in [["--interrupted-layer", "keep"], ["--on-host-silence", "continue"], ["--scene", "none.toml"]] {
        let (code, answer) = lab.run(&["resume", given[0], given[1]]);
        assert!(code == Some(2) && answer.contains(given[0]) && answer.contains("does not support"), "{answer}");
    }
}

/// Returns the identifier of the process that has this file open.
fn who_has_open(file: &Path) -> String {
    let file = file.canonicalize().unwrap();
    let processes = fs::read_dir("/proc").unwrap().flatten();
    let has_it = |process: &fs::DirEntry| {
        let open = fs::read_dir(process.path().join("fd")).into_iter().flatten().flatten();
        open.map(|open| fs::read_link(open.path())).any(|link| link.is_ok_and(|link| link == file))
    };
    let found = { processes }.find(has_it).unwrap_or_else(|| panic!("nobody has {} open", file.display()));
    found.file_name().into_string().unwrap()
}

#[test]
fn an_emergency_stop_of_a_silent_robot_is_reported_as_failed() {
    let lab = Lab::new(5.0);
    lab.wait_until_ready();
    let pid = who_has_open(&lab.directory.path().join("state/growbot/robots/lab/lock"));
    assert!(command("kill").args(["-STOP", &pid]).status().unwrap().success());
    // The robot stays silent until the service responds.
    let (status, problem) = lab.ask("POST", "/robots/lab/commands", r#"{"command":"emergency-stop"}"#);
    assert!(command("kill").args(["-CONT", &pid]).status().unwrap().success());
    assert!(
        status == 409 && problem["detail"].as_str().unwrap().contains("cut the robot's power"),
        "{status} {problem}"
    );
}

#[test]
fn unauthorised_and_invalid_requests_are_refused_with_the_reason() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let (_, [operate, read]) = lab.pages.clone().unwrap();
    let at = |token: &str, path: &str| format!("/{token}/{path}");
    let stop = r#"{"command":"stop"}"#;
    let order = at(&operate, "api/v1/robots/lab/commands");
    let local = "host: 127.0.0.1";
    let cases: [(u16, &str, String, &[&str], &str); 20] = [
        (200, "GET", at(&operate, ""), &[local], ""),
        (200, "GET", at(&read, "robots.js"), &[local], ""),
        (200, "GET", at(&read, "api/v1/robots"), &[local], ""),
        (200, "POST", order.clone(), &[local], stop),
        (200, "GET", at(&operate, "api/v1/robots/lab/status"), &[local], ""),
        (403, "GET", at(&read, "api/v1/robots/lab/status"), &[local], ""),
        (403, "POST", at(&read, "api/v1/robots/lab/commands"), &[local], stop),
        (403, "POST", at(&read, "api/v1/robots/lab/jobs"), &[local], r#"{"to":"0,0,60"}"#),
        (404, "GET", "/".to_owned(), &[local], ""),
        (404, "GET", at(&"0".repeat(32), ""), &[local], ""),
        (404, "GET", at(&operate, "api/v1/jobs/..%2f..%2ftokens/log"), &[local], ""),
        (404, "GET", at(&operate, "../tokens"), &[local], ""),
        (404, "POST", order.clone(), &["host: evil.example"], stop),
        (404, "POST", order.clone(), &[local, "origin: http://evil.example"], stop),
        (404, "POST", order.clone(), &[local, "sec-fetch-site: cross-site"], stop),
        (415, "POST", order.clone(), &[local, "content-type: text/plain"], stop),
        (422, "POST", order.clone(), &[local], r#"{"command":"dance"}"#),
        (400, "POST", order.clone(), &[local], "{"),
        (422, "POST", at(&operate, "api/v1/robots/lab/jobs"), &[local], r#"{"to":"0,0,nan"}"#),
        (404, "POST", at(&operate, "api/v1/robots/none/commands"), &[local], stop),
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
fn requests_of_another_release_are_refused_with_the_advice_to_reload() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let reload = "reload the page, or update the program that sent the request";
    for (method, path, body, status, cause) in [
        (
            "POST",
            "/robots/lab/orders",
            r#"{"order":"emergency-stop"}"#,
            404,
            "this release has no route POST /api/v1/robots/lab/orders: ",
        ),
        (
            "POST",
            "/jobs/1/live/orders/stop",
            "",
            404,
            "this release has no route POST /api/v1/jobs/1/live/orders/stop: ",
        ),
        ("GET", "/addresses", "", 404, "this release has no route GET /api/v1/addresses: "),
        ("GET", "/events/socket", "", 404, "this release has no route GET /api/v1/events/socket: "),
        ("POST", "/robots/lab/commands", r#"{"order":"stop"}"#, 422, "unknown field `order`, expected `command`"),
        ("POST", "/robots/lab/jobs", r#"{"to":"0,0,60,0,90","scale":2}"#, 422, "unknown field `scale`"),
        ("GET", "/jobs?max=5", "", 400, "unknown field `max`, expected `limit`"),
    ] {
        // Browsers send the origin with each request of a page.
        let (port, [control, _]) = lab.pages.as_ref().unwrap();
        let headers = [format!("host: 127.0.0.1:{port}"), format!("origin: http://127.0.0.1:{port}")];
        let headers = headers.each_ref().map(String::as_str);
        let (found, text) = http(lab.page(), method, &format!("/{control}/api/v1{path}"), &headers, body);
        let problem: Value =
            serde_json::from_str(&text).unwrap_or_else(|error| panic!("{path}: {found}: {text:?}: {error}"));
        let detail = problem["detail"].as_str().unwrap();
        assert_eq!((found, &problem["status"]), (status, &json!(status)), "{path}: {text}");
        assert!(detail.contains(cause) && detail.contains(reload), "{path}: {detail}");
        assert_eq!(lab.ask(method, path, body), (found, problem), "{path} on the socket");
    }
    // Nothing was read in part: no job was started, and the robot was not stopped.
    assert_eq!(lab.ask("GET", "/jobs", "").1, json!([]));
    assert_eq!(lab.ask("GET", "/robots/lab", "").1["connection"], "ready");
}

#[test]
fn a_board_of_another_release_gets_no_job_and_can_be_stopped() {
    let board = FakeBoard::lasting("growbot-a2");
    board.set_other_release(true);
    let lab = Lab::configured(&format!("[robots.lab]\nport = \"{}\"\nrobot = \"growbot-a2\"\n", board.port()));
    let cause = "the board's firmware is of another release";
    wait_for("the board is refused", || {
        let (_, robot) = lab.ask("GET", "/robots/lab", "");
        robot["connection_error"].as_str().is_some_and(|error| error.contains(cause)).then_some(())
    });
    let (status, problem) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": GOAL }).to_string());
    assert!(status == 409 && problem["detail"].as_str().unwrap().contains(cause), "{problem}");
    for command in ["stop", "emergency-stop"] {
        let (status, robot) = lab.ask("POST", "/robots/lab/commands", &json!({ "command": command }).to_string());
        assert_eq!(status, 200, "{command}: {robot}");
    }
    board.set_other_release(false);
    wait_for("the board has stopped", || {
        let (_, robot) = lab.ask("GET", "/robots/lab", "");
        (robot["state"] == "emergency-stop").then_some(())
    });
}

#[test]
fn the_job_list_is_rebuilt_from_the_run_logs() {
    let mut lab = Lab::new(100.0);
    lab.wait_until_ready();
    let (_, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": GOAL }).to_string());
    let id = job["id"].as_str().unwrap().to_owned();
    assert_eq!(lab.wait_for_end(&id)["state"], "done");
    // One log of another release has an unknown event, and one has a format that this release cannot read.
    let log = fs::read_to_string(lab.log(&id)).unwrap();
    let newer = log.replacen("growbot-run/4", "growbot-run/5", 1);
    assert_ne!(newer, log);
    fs::write(lab.log("20991123T014500123_lab"), newer).unwrap();
    fs::write(lab.log(&id), log.replacen("\n", "\n{\"time_utc\":\"x\",\"event\":\"dance\"}\n", 1)).unwrap();
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
        let heard = lab.heard().replace("\n    ", " ");
        assert!(
            heard.contains(
                "the format is \"growbot-run/5\", but this version of growbot reads \"growbot-run/4\": use the version \
                 that wrote the file (0.1.0)"
            ),
            "{heard}"
        );
    }
}

#[test]
fn a_direct_command_leases_the_link_of_the_service() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let mut console = lab.command(&["console"]);
    let mut console = console.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
    let trouble = || lab.ask("GET", "/robots/lab", "").1["connection_error"].clone();
    wait_for("the line is lent", || {
        (trouble() == "the port is in use by growbot console: end that program first").then_some(())
    });
    let (status, problem) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": GOAL }).to_string());
    assert!(status == 409 && problem["detail"].as_str().unwrap().contains("in use by growbot console"), "{problem}");
    let (code, answer) = lab.run(&["tune"]);
    assert!(code == Some(1) && answer.contains("in use by growbot console"), "{answer}");
    let (status, answer) = lab.ask("POST", "/robots/lab/commands", r#"{"command":"emergency-stop"}"#);
    assert_eq!(status, 200, "{answer}");
    console.stdin.take().unwrap().write_all(b"status\nclear\nquit\n").unwrap();
    let output = console.wait_with_output().unwrap();
    let text = String::from_utf8([output.stdout, output.stderr].concat()).unwrap();
    assert!(
        output.status.success() && text.contains("released the port of simulated robot lab to this command"),
        "{text}"
    );
    assert!(text.contains("emergency-stop") && text.contains("cleared"), "{text}");
    lab.wait_until_ready();
    // A console that is killed returns the line too.
    let mut killed = lab.command(&["console"]).stdin(Stdio::piped()).stdout(Stdio::null()).spawn().unwrap();
    wait_for("the line is lent", || trouble().is_string().then_some(()));
    killed.kill().unwrap();
    killed.wait().unwrap();
    lab.wait_until_ready();
    let page = lab.at("/robots/lab/port-lease");
    assert_eq!(lab.ask_page(&page, &["host: 127.0.0.1"], "POST", r#"{"holder":"me"}"#), 403);
    assert_eq!(lab.ask_page(&lab.at("/page-urls"), &["host: 127.0.0.1"], "GET", ""), 403);
    // A growth is watched on the page of the service.
    let (code, answer) = lab.run(&["grow", "--to", GOAL, "--watch", "--pace", "3"]);
    assert!(code == Some(2) && answer.contains("--pace applies only to growths without a service"), "{answer}");
    let (code, answer) = lab.run(&["grow", "--to", GOAL, "--watch"]);
    let (port, [_, look]) = lab.pages.clone().unwrap();
    assert_eq!(code, Some(0), "{answer}");
    let at = answer.split_once("live view:").unwrap().1.split_whitespace().next().unwrap();
    assert!(at.starts_with(&format!("http://127.0.0.1:{port}/{look}/api/v1/jobs/")), "{answer}");
    let (status, _) = http(lab.page(), "GET", at.split_once(&port.to_string()).unwrap().1, &["host: 127.0.0.1"], "");
    assert_eq!(status, 200, "{at}");
    let (status, problem) = lab.ask("POST", "/robots/none/port-lease", r#"{"holder":"me"}"#);
    assert_eq!(status, 404, "{problem}");
}
