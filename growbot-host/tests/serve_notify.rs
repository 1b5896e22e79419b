//! Tests of the notices that the service sends to a webhook and to a command. No receiver may delay a robot.

use std::fs;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::os::unix::fs::PermissionsExt;
use std::sync::mpsc::{self, Receiver, Sender};
use std::thread;
use std::time::{SystemTime, UNIX_EPOCH};

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use lab::{GOAL, LAYERS, Lab, wait_for};
use ring::hmac;
use running::PATIENCE;
use serde_json::{Value, json};

use crate::lab;
use crate::running;

/// Goal of a growth that lasts long enough for the test to pause and stop it.
const LONG_GOAL: &str = "100,100,600,0,45";

/// An HTTP request that a webhook of the test received.
struct Got {
    head: String,
    body: String,
}

impl Got {
    fn header(&self, name: &str) -> &str {
        let line = self.head.lines().find(|line| line.to_lowercase().starts_with(&format!("{name}:")));
        line.unwrap().split_once(':').unwrap().1.trim()
    }

    fn notice(&self) -> Value {
        serde_json::from_str(&self.body).unwrap()
    }

    /// Returns true if the request has a valid signature with this secret, whose time is `since_s`, s since 1970, or
    /// later.
    fn is_signed(&self, secret: &str, since_s: u64) -> bool {
        let key = STANDARD.decode(secret.trim().strip_prefix("whsec_").unwrap()).unwrap();
        let time = self.header("webhook-timestamp");
        let signed = format!("{}.{time}.{}", self.header("webhook-id"), self.body);
        let signature = self.header("webhook-signature").strip_prefix("v1,").unwrap();
        (since_s..=now_s()).contains(&time.parse().unwrap())
            && hmac::verify(
                &hmac::Key::new(hmac::HMAC_SHA256, &key),
                signed.as_bytes(),
                &STANDARD.decode(signature).unwrap(),
            )
            .is_ok()
    }
}

/// Returns the time since the Unix epoch, s.
fn now_s() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap().as_secs()
}

/// Reads one HTTP request.
fn read_request(stream: &mut TcpStream) -> Got {
    let mut bytes = Vec::new();
    let mut part = [0; 4096];
    loop {
        let text = String::from_utf8_lossy(&bytes).into_owned();
        if let Some((head, body)) = text.split_once("\r\n\r\n") {
            let got = Got { head: head.to_owned(), body: body.to_owned() };
            if body.len() >= got.header("content-length").parse().unwrap() {
                return got;
            }
        }
        let read = stream.read(&mut part).unwrap();
        assert!(read > 0, "the request was interrupted: {text}");
        bytes.extend_from_slice(&part[..read]);
    }
}

/// Starts a thread that receives HTTP requests on a listener, and responds with these statuses in turn. The last status
/// is repeated. Returns a channel of the requests.
fn receive(listener: TcpListener, statuses: &'static [u16]) -> Receiver<Got> {
    let (sender, receiver): (Sender<Got>, _) = mpsc::channel();
    thread::spawn(move || {
        for number in 0.. {
            let (mut stream, _) = listener.accept().unwrap();
            let got = read_request(&mut stream);
            let status = statuses[number.min(statuses.len() - 1)];
            let answer = format!("HTTP/1.1 {status} Said\r\ncontent-length: 0\r\nconnection: close\r\n\r\n");
            stream.write_all(answer.as_bytes()).unwrap();
            if sender.send(got).is_err() {
                return;
            }
        }
    });
    receiver
}

fn local() -> (TcpListener, u16) {
    let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let port = listener.local_addr().unwrap().port();
    (listener, port)
}

fn webhook(port: u16) -> String {
    format!("[serve.notify]\nwebhook = \"http://127.0.0.1:{port}/s3cret?key=s3cret\"\n")
}

fn begin(lab: &Lab, goal: &str) -> String {
    let (status, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": goal }).to_string());
    assert_eq!(status, 201, "{job}");
    job["id"].as_str().unwrap().to_owned()
}

fn order(lab: &Lab, order: &str) {
    let (status, answer) = lab.ask("POST", "/robots/lab/commands", &json!({ "command": order }).to_string());
    assert_eq!(status, 200, "{answer}");
}

/// Waits until the service has no queued notice. This is needed before the service is killed, because a service that is
/// killed before it has recorded a delivery repeats the delivery.
fn wait_until_all_is_told(lab: &Lab) {
    let database = lab.directory.path().join("state/growbot/serve/jobs.sqlite");
    let database = rusqlite::Connection::open(database).unwrap();
    wait_for("nothing waits to be told", || {
        let waiting: i64 = database.query_row("SELECT count(*) FROM notice", [], |row| row.get(0)).unwrap();
        (waiting == 0).then_some(())
    });
}

/// Checks that neither the secret part of the webhook's address nor the webhook's secret appears in an output of the
/// service.
fn nothing_is_given_away(lab: &Lab) {
    let secret = fs::read_to_string(lab.directory.path().join("state/growbot/serve/webhook-secret")).unwrap();
    let outputs = [lab.heard(), lab.ask("GET", "/robots", "").1.to_string(), lab.ask("GET", "/jobs", "").1.to_string()];
    assert!(outputs.iter().all(|output| !output.contains("s3cret") && !output.contains(secret.trim())), "{outputs:?}");
}

#[test]
fn a_webhook_is_signed_and_retried_until_accepted() {
    let (listener, port) = local();
    let got = receive(listener, &[500, 200]);
    let lab = Lab::with(20.0, &webhook(port));
    lab.wait_until_ready();
    let since_s = now_s();
    let job = begin(&lab, LONG_GOAL);
    lab.wait_for_state("growing");
    order(&lab, "pause");
    let first = got.recv_timeout(PATIENCE).unwrap();
    let again = got.recv_timeout(PATIENCE).unwrap();
    let secret = fs::read_to_string(lab.directory.path().join("state/growbot/serve/webhook-secret")).unwrap();
    assert!(first.is_signed(&secret, since_s) && again.is_signed(&secret, since_s));
    assert!(!first.is_signed("whsec_AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA=", since_s), "a check that can fail");
    assert_eq!((first.header("webhook-id"), &first.body), (again.header("webhook-id"), &again.body));
    let notice = again.notice();
    assert_eq!((&notice["event"], &notice["robot"], &notice["job"]), (&json!("pause"), &json!("lab"), &json!(job)));
    assert_eq!((&notice["version"], &notice["simulated"]), (&json!(1), &json!(true)));
    let message = notice["message"].as_str().unwrap();
    assert!(
        message.starts_with("simulated robot lab pauses after layer ") && message.ends_with("on request"),
        "{message}"
    );
    let heard = lab.heard().replace("\n    ", " ");
    assert!(heard.contains("http://127.0.0.1 did not accept a notification (the receiver responded 500)"), "{heard}");
    nothing_is_given_away(&lab);
}

#[test]
fn undelivered_notifications_are_sent_after_a_restart() {
    let (listener, port) = local();
    drop(listener);
    let mut lab = Lab::with(100.0, &webhook(port));
    lab.wait_until_ready();
    let job = begin(&lab, GOAL);
    assert_eq!(lab.wait_for_end(&job)["state"], "done");
    wait_for("it is tried", || lab.heard().contains("did not accept a notification").then_some(()));
    nothing_is_given_away(&lab);
    lab.kill();
    let got = receive(TcpListener::bind(("127.0.0.1", port)).unwrap(), &[204]);
    lab.start();
    let finish = got.recv_timeout(PATIENCE).unwrap().notice();
    assert_eq!((&finish["event"], &finish["job"], &finish["laid"]), (&json!("finish"), &json!(job), &json!(LAYERS)));
    // The notice is not repeated.
    wait_until_all_is_told(&lab);
    lab.kill();
    lab.start();
    lab.wait_until_ready();
    let next = begin(&lab, GOAL);
    let finish = got.recv_timeout(PATIENCE).unwrap().notice();
    assert_eq!((&finish["event"], &finish["job"]), (&json!("finish"), &json!(next)));
}

#[test]
fn restarts_a_lost_robot_and_an_emergency_stop_are_each_notified_once() {
    let (listener, port) = local();
    let got = receive(listener, &[204]);
    // At a higher pace, a board whose service restarts late on a busy machine parks, and then waits for a person.
    let mut lab = Lab::with(20.0, &webhook(port));
    lab.wait_until_ready();
    let job = begin(&lab, LONG_GOAL);
    lab.wait_for_state("growing");
    let next = || got.recv_timeout(PATIENCE).unwrap().notice();
    lab.kill();
    lab.start();
    let notice = next();
    assert_eq!((&notice["event"], &notice["job"]), (&json!("service-restart"), &json!(job)));
    lab.wait_for_state("growing");
    assert_eq!(lab.run(&["power", "off", "--port", "sim:lab"]).0, Some(0));
    let notice = next();
    assert_eq!((&notice["event"], &notice["job"]), (&json!("disconnected"), &json!(job)));
    assert!(notice["message"].as_str().unwrap().contains("has lost its connection after layer"), "{notice}");
    assert_eq!(lab.run(&["power", "on", "--port", "sim:lab", "--robot", "growbot-a2", "--pace", "20"]).0, Some(0));
    let mut events = [next(), next()].map(|notice| notice["event"].as_str().unwrap().to_owned());
    events.sort();
    assert_eq!(events, ["board-restart", "interrupted"]);
    lab.wait_until_ready();
    order(&lab, "emergency-stop");
    assert_eq!(next()["event"], "emergency-stop");
    wait_until_all_is_told(&lab);
    lab.kill();
    lab.start();
    lab.wait_until_ready();
    order(&lab, "clear-fault");
    order(&lab, "emergency-stop");
    assert_eq!(next()["event"], "emergency-stop", "nothing comes twice");
}

/// A receiver without TLS receives no part of a notice for an `https` address.
#[test]
fn https_sends_nothing_before_the_certificate_is_verified() {
    let (listener, port) = local();
    let lab = Lab::with(100.0, &webhook(port).replace("http://127.0.0.1", "https://localhost"));
    lab.wait_until_ready();
    let job = begin(&lab, GOAL);
    let (mut stream, _) = listener.accept().unwrap();
    let mut hello = vec![0; 5];
    stream.read_exact(&mut hello).unwrap();
    assert_eq!((hello[0], hello[1]), (22, 3), "the record of a TLS handshake");
    hello.resize(5 + usize::from(u16::from_be_bytes([hello[3], hello[4]])), 0);
    stream.read_exact(&mut hello[5..]).unwrap();
    stream.write_all(b"HTTP/1.1 200 OK\r\ncontent-length: 0\r\n\r\n").unwrap();
    let text = String::from_utf8_lossy(&hello);
    assert!(!text.contains("s3cret") && !text.contains("finish") && text.contains("localhost"), "{text}");
    wait_for("it is tried", || lab.heard().contains("https://localhost did not accept a notification").then_some(()));
    assert_eq!(lab.wait_for_end(&job)["state"], "done");
    nothing_is_given_away(&lab);
    assert!(!lab.heard().contains("panicked"), "{}", lab.heard());
}

#[test]
fn an_unresponsive_receiver_does_not_delay_robots() {
    let (listener, port) = local();
    let lab = Lab::with(100.0, &webhook(port));
    lab.wait_until_ready();
    let job = begin(&lab, LONG_GOAL);
    lab.wait_for_state("growing");
    order(&lab, "pause");
    let (mut silent, _) = listener.accept().unwrap();
    assert_eq!(read_request(&mut silent).notice()["event"], "pause");
    order(&lab, "continue");
    lab.wait_for_state("growing");
    let laid = || lab.attended_robot("lab")["laid"].as_u64().unwrap();
    let before = laid();
    wait_for("it grows on", || (laid() > before + 3).then_some(()));
    order(&lab, "stop");
    assert_eq!(lab.wait_for_end(&job)["state"], "interrupted");
    // The service still waits for the response and has not closed the connection.
    silent.set_nonblocking(true).unwrap();
    let error = silent.read(&mut [0; 16]).unwrap_err();
    assert_eq!(error.kind(), std::io::ErrorKind::WouldBlock, "{error}");
}

#[test]
fn a_command_is_retried_until_success_and_a_power_loss_is_notified() {
    let lab_settings = "[serve.notify]\ncommand = [\"../tell.sh\", \"told\"]\nevents = [\"finish\", \"interrupted\"]\n";
    let mut lab = Lab::with(100.0, lab_settings);
    let path = |name: &str| lab.directory.path().join(name);
    let script = "#!/bin/sh\ncd \"$(dirname \"$0\")\"\n[ -e tried ] || { touch tried; exit 3; }\n\
                  echo \"$GROWBOT_NOTIFICATION_EVENT $GROWBOT_NOTIFICATION_ROBOT $GROWBOT_NOTIFICATION_MESSAGE\" >>$1.env\ncat >>$1\necho >>$1\n";
    fs::write(path("tell.sh"), script).unwrap();
    fs::set_permissions(path("tell.sh"), fs::Permissions::from_mode(0o755)).unwrap();
    let (told, env) = (path("told"), path("told.env"));
    lab.wait_until_ready();
    let notices = |count: usize| {
        wait_for("the command is run", || {
            let text = fs::read_to_string(&told).unwrap_or_default();
            (text.lines().count() >= count).then(|| text.lines().map(str::to_owned).collect::<Vec<_>>())
        })
    };
    let job = begin(&lab, GOAL);
    assert_eq!(lab.wait_for_end(&job)["state"], "done");
    let notice: Value = serde_json::from_str(&notices(1)[0]).unwrap();
    assert_eq!((&notice["event"], &notice["job"]), (&json!("finish"), &json!(job)));
    let text = fs::read_to_string(&env).unwrap();
    assert_eq!(text, format!("finish lab simulated robot lab has laid all {LAYERS} layers\n"));
    assert!(lab.heard().replace("\n    ", " ").contains("exit status: 3"), "{}", lab.heard());
    let job = begin(&lab, LONG_GOAL);
    lab.wait_for_state("growing");
    order(&lab, "pause");
    // A board parks soon after a pause at this pace, on a busy machine before the pause is seen.
    wait_for("paused", || {
        let state = lab.ask("GET", "/robots/lab", "").1["state"].clone();
        (state == "paused" || state == "parked").then_some(())
    });
    assert_eq!(lab.run(&["power", "off", "--port", "sim:lab"]).0, Some(0));
    assert_eq!(lab.run(&["power", "on", "--port", "sim:lab", "--robot", "growbot-a2", "--pace", "100"]).0, Some(0));
    let notice: Value = serde_json::from_str(&notices(2)[1]).unwrap();
    assert_eq!((&notice["event"], &notice["job"]), (&json!("interrupted"), &json!(job)), "{notice}");
    wait_until_all_is_told(&lab);
    lab.kill();
    lab.start();
    lab.wait_until_ready();
    order(&lab, "cancel");
    let last = begin(&lab, GOAL);
    let all = notices(3);
    let third: Value = serde_json::from_str(&all[2]).unwrap();
    assert_eq!((&third["event"], &third["job"]), (&json!("finish"), &json!(last)));
    assert_eq!(all.len(), 3, "neither the pause, which is not asked for, nor anything twice");
}

#[test]
fn invalid_notification_settings_are_refused_at_startup() {
    for (settings, wanted) in [
        ("webhook = \"hooks.example/s3cret\"", "cannot be used: give a URL"),
        ("command = []", "the command of [serve.notify] is empty"),
        ("events = [\"dance\"]", "dance"),
        ("webhok = \"http://localhost/\"", "webhok"),
    ] {
        let directory = tempfile::tempdir().unwrap();
        fs::create_dir(directory.path().join("growbot")).unwrap();
        fs::write(directory.path().join("growbot/growbot.toml"), format!("[serve.notify]\n{settings}\n")).unwrap();
        let mut serve = running::command(running::PROGRAM);
        serve.env("XDG_CONFIG_HOME", directory.path()).env("XDG_STATE_HOME", directory.path().join("state"));
        serve.env("XDG_RUNTIME_DIR", directory.path().join("state")).args(["serve", "--page-port", "0"]);
        let output = serve.output().unwrap();
        let message = running::in_lines(&String::from_utf8(output.stderr).unwrap());
        assert!(output.status.code() == Some(2) && message.contains(wanted), "{settings}: {message}");
        assert!(!message.contains("s3cret"), "{message}");
    }
}
