//! Tests of the access to the service: files, folders and sockets of other users, and tokens of the pages.

use crate::lab;
use crate::running;

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpListener;
use std::os::fd::OwnedFd;
use std::os::unix::fs::{MetadataExt, PermissionsExt, chown};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use lab::{GOAL, Lab};
use running::{PROGRAM, in_lines};
use serde_json::{Value, json};

/// Numeric identifier of another user, which no process of the tests has.
const OTHER_USER: u32 = 54_321;
const STOP: &str = r#"{"command":"stop"}"#;

fn set_mode(path: &Path, mode: u32) {
    fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
}

/// Starts a second service, and returns its exit code and output. Its port is in use, so the service ends even if it
/// does not refuse its files.
fn serve_again(lab: &Lab) -> (Option<i32>, String) {
    let occupied = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let port = occupied.local_addr().unwrap().port();
    let (code, text) = lab.run(&["serve", "--page-port", &port.to_string()]);
    (code, in_lines(&text))
}

/// Checks that commands refuse to use the service for this reason, and that the emergency stop is then sent to the
/// robot directly.
fn check_not_asked(lab: &Lab, reason: &str) {
    for args in [&["status"][..], &["pause"], &["grow", "--to", GOAL]] {
        let (code, text) = lab.run(args);
        assert!(matches!(code, Some(1 | 2)) && in_lines(&text).contains(reason), "{args:?}: {text}");
    }
    let (code, text) = lab.run(&["estop"]);
    assert!(code == Some(0) && text.starts_with("emergency stop"), "{text}");
    assert!(in_lines(&text).contains(reason), "{text}");
}

#[test]
fn a_runtime_folder_that_others_can_access_is_refused_by_commands_and_service() {
    let mut lab = Lab::new(100.0);
    lab.wait_until_ready();
    let folder = lab.directory.path().join("run/growbot");
    for mode in [0o755, 0o777, 0o1777] {
        set_mode(&folder, mode);
        check_not_asked(&lab, &format!("{} has mode {mode:04o}", folder.display()));
    }
    set_mode(&folder, 0o700);
    // Others can move a folder if they can write the one above it.
    set_mode(&lab.directory.path().join("run"), 0o777);
    check_not_asked(&lab, "run has mode 0777");
    set_mode(&lab.directory.path().join("run"), 0o755);
    assert_eq!(lab.run(&["status"]).0, Some(0));
    set_mode(&folder, 0o750);
    lab.kill();
    let (code, text) = serve_again(&lab);
    assert!(code == Some(2) && text.contains("has mode 0750") && text.contains("`chmod go-rwx "), "{text}");
    set_mode(&folder, 0o700);
    // Only root can give a folder away.
    if chown(&folder, Some(OTHER_USER), None).is_ok() {
        let (code, text) = serve_again(&lab);
        assert!(code == Some(2) && text.contains("run/growbot belongs to user 54321"), "{text}");
        check_not_asked(&lab, "run/growbot belongs to user 54321");
    }
}

/// Python program that listens on the service's socket as another user, and prints what it receives. It changes to that
/// user before it listens.
const FALSE_SERVICE: &str = "
import os, socket, sys
listener = socket.socket(socket.AF_UNIX)
listener.bind(sys.argv[1])
os.setuid(int(sys.argv[2]))
listener.listen()
print('listening', flush=True)
while True:
    print('heard', listener.accept()[0].recv(1000), flush=True)
";

#[test]
fn a_false_service_of_another_user_is_not_asked() {
    let mut lab = Lab::new(100.0);
    lab.wait_until_ready();
    lab.kill();
    fs::remove_file(lab.socket()).unwrap();
    let socket = lab.socket().display().to_string();
    let mut python = running::command("python3");
    python.args(["-c", FALSE_SERVICE, &socket, &OTHER_USER.to_string()]);
    let mut service = python.stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
    let mut text = BufReader::new(service.stdout.take().unwrap());
    let mut line = String::new();
    text.read_line(&mut line).unwrap();
    // Only root can have a program of another user in its own folder.
    if line == "listening\n" {
        check_not_asked(&lab, &format!("listens on {socket} belongs to user 54321"));
    }
    service.kill().unwrap();
    service.wait().unwrap();
    let mut heard = String::new();
    text.read_to_string(&mut heard).unwrap();
    assert!(heard.lines().all(|line| line == "heard b''"), "{heard}");
}

#[test]
fn a_data_folder_has_one_service_whatever_its_socket() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    // A folder in place of the socket stops a service that does not heed the lock.
    fs::create_dir_all(lab.directory.path().join("other/growbot/serve.sock")).unwrap();
    set_mode(&lab.directory.path().join("other/growbot"), 0o700);
    let mut second = lab.command(&["serve", "--page-port", "0"]);
    let output = second.env("XDG_RUNTIME_DIR", lab.directory.path().join("other")).output().unwrap();
    let text = in_lines(&String::from_utf8(output.stderr).unwrap());
    let holder = format!("process {} of user ", lab.service.as_ref().unwrap().id());
    assert!(output.status.code() == Some(2) && text.contains("already runs `growbot serve`"), "{text}");
    assert!(text.contains(&holder) && text.contains("state/growbot/serve"), "{text}");
    assert_eq!(lab.run(&["status"]).0, Some(0));
}

/// Returns the paths of a folder and of everything in it.
fn tree(path: PathBuf) -> Vec<PathBuf> {
    let inside = fs::read_dir(&path).into_iter().flatten().flatten().flat_map(|entry| tree(entry.path())).collect();
    [vec![path], inside].concat()
}

#[test]
fn files_are_for_the_user_alone_and_others_are_refused() {
    let mut lab = Lab::new(100.0);
    lab.wait_until_ready();
    let (_, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": GOAL }).to_string());
    lab.wait_for_end(job["id"].as_str().unwrap());
    let state = lab.directory.path().join("state/growbot/serve");
    let all = [tree(state.clone()), tree(lab.directory.path().join("run/growbot"))].concat();
    let open = |path: &&PathBuf| fs::symlink_metadata(path).unwrap().mode() & 0o077 != 0;
    assert_eq!(all.iter().filter(open).collect::<Vec<_>>(), Vec::<&PathBuf>::new());
    assert!(all.len() > 10, "{all:?}");
    lab.kill();
    for name in ["tokens", "audit.jsonl", "jobs.sqlite", "jobs", "stops"] {
        let mode = fs::symlink_metadata(state.join(name)).unwrap().mode() & 0o7777;
        set_mode(&state.join(name), mode | 0o040);
        let (code, text) = serve_again(&lab);
        let is_reported = text.contains(&format!("serve/{name} has mode 0")) && text.contains("`chmod go-rwx ");
        assert!(code == Some(2) && is_reported, "{name}: {text}");
        set_mode(&state.join(name), mode);
    }
    lab.start();
}

/// Sends an HTTP request without a body. Returns the head of the response.
fn head(lab: &Lab, request: &str, headers: &[&str]) -> String {
    let headers: String = headers.iter().map(|header| format!("{header}\r\n")).collect();
    let mut stream = lab.page();
    write!(stream, "{request} HTTP/1.1\r\nconnection: close\r\n{headers}\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer.split("\r\n\r\n").next().unwrap().to_owned()
}

fn header<'a>(head: &'a str, name: &str) -> Option<&'a str> {
    head.lines().find_map(|line| line.strip_prefix(name)?.strip_prefix(": "))
}

/// Opens a path with a token as a browser does. Returns the location to which the browser is redirected, and the
/// cookie.
fn visit(lab: &Lab, path: &str, host: &str) -> (String, String) {
    let head = head(lab, &format!("GET {path}"), &[&format!("host: {host}"), "accept: text/html,*/*;q=0.8"]);
    assert!(head.starts_with("HTTP/1.1 303 "), "{head}");
    (header(&head, "location").unwrap().to_owned(), header(&head, "set-cookie").unwrap().to_owned())
}

#[test]
fn a_token_is_in_the_address_once_and_then_in_a_cookie_or_header() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let (_, [control, view]) = lab.pages.clone().unwrap();
    let (location, cookie) = visit(&lab, &format!("/{control}/"), "localhost");
    assert_eq!(location, "../control/");
    let attributes: Vec<&str> = cookie.split("; ").skip(1).collect();
    assert_eq!(attributes, ["Path=/", "HttpOnly", "SameSite=Strict"]);
    let deep = visit(&lab, &format!("/{view}/api/v1/jobs/7/live/?at=2"), "127.0.0.1:8017");
    assert_eq!(deep.0, "../../../../../../view/api/v1/jobs/7/live/?at=2");
    let sent = |cookie: &str| format!("cookie: other=1; {}", cookie.split("; ").next().unwrap());
    let [control_cookie, view_cookie] = [sent(&cookie), sent(&deep.1)];
    let [by_control, by_view] = [&control, &view].map(|token| format!("authorization: Bearer {token}"));
    let command = "api/v1/robots/lab/commands";
    for (status, path, sent) in [
        (200, "/control/".to_owned(), &*control_cookie),
        (200, "/control/robots.js".to_owned(), &control_cookie),
        (200, format!("/control/{command}"), &control_cookie),
        (200, format!("/control/{command}"), &by_control),
        (200, "/view/".to_owned(), &view_cookie),
        (403, format!("/view/{command}"), &view_cookie),
        (403, format!("/view/{command}"), &by_view),
        (401, "/control/".to_owned(), ""),
        (401, format!("/control/{command}"), ""),
        (401, format!("/control/{command}"), &view_cookie),
        (401, format!("/control/{command}"), &by_view),
        (401, format!("/view/{command}"), &by_control),
        (401, "/control/api/v1/robots".to_owned(), "authorization: Basic bGFiOmxhYg=="),
        (401, "/view/api/v1/events".to_owned(), "cookie: growbot="),
        // Programs may have the token in each path.
        (200, format!("/{control}/{command}"), ""),
    ] {
        let (method, body) = if path.ends_with("commands") { ("POST", STOP) } else { ("GET", "") };
        let sent: Vec<&str> = Some(sent).into_iter().filter(|sent| !sent.is_empty()).collect();
        assert_eq!(lab.ask_page(&path, &sent, method, body), status, "{method} {path} {sent:?}");
    }
    // A cookie gives other pages nothing.
    for other in ["origin: http://127.0.0.1:9999", "origin: https://evil.example", "sec-fetch-site: same-site"] {
        let status = lab.ask_page(&format!("/control/{command}"), &[&control_cookie, other], "POST", STOP);
        assert_eq!(status, 404, "{other}");
    }
    let refused = head(&lab, "GET /control/api/v1/robots", &["host: localhost"]);
    assert_eq!(header(&refused, "content-type"), Some("application/problem+json"), "{refused}");
}

#[test]
fn tokens_of_a_service_that_has_lost_its_port_are_void() {
    let mut lab = Lab::new(100.0);
    lab.wait_until_ready();
    let (port, before) = lab.pages.clone().unwrap();
    lab.kill();
    // Another user can now take the port and read what open pages send there.
    drop(TcpListener::bind(("127.0.0.1", port)).unwrap());
    lab.start();
    let (same_port, now) = lab.pages.clone().unwrap();
    assert_eq!(port, same_port);
    for token in &before {
        assert!(!now.contains(token), "{before:?} {now:?}");
        let by_header = format!("authorization: Bearer {token}");
        for path in ["/control/api/v1/robots", "/view/api/v1/robots"] {
            assert_eq!(lab.ask_page(path, &[&by_header], "GET", ""), 401);
        }
        assert_eq!(lab.ask_page(&format!("/{token}/api/v1/robots/lab/commands"), &[], "POST", STOP), 404);
    }
    assert_eq!(lab.ask_page(&lab.at("/robots/lab/commands"), &[], "POST", STOP), 200);
}

/// Returns a command that starts the service with handed-over sockets, as systemd does. `sockets` is the number of
/// sockets.
fn handed_over(lab: &Lab, sockets: &str, listener: &TcpListener) -> Command {
    // The service closes those that it takes when it starts a robot. One more would stay open in the robot.
    let second = if sockets == "1" { "" } else { "4<&0" };
    let script = format!("exec 3<&0 {second} </dev/null; LISTEN_PID=$$ LISTEN_FDS={sockets} exec \"$0\" serve");
    let settings = lab.command(&[]);
    let mut command = running::command("sh");
    command.args(["-c", &script, PROGRAM]).current_dir(lab.directory.path());
    command.envs(settings.get_envs().filter_map(|(name, value)| Some((name, value?))));
    command.stdin(OwnedFd::from(listener.try_clone().unwrap()));
    command
}

#[test]
fn tokens_stay_valid_while_the_service_manager_holds_the_port() {
    let mut lab = Lab::new(100.0);
    lab.kill();
    let listen = |port| TcpListener::bind(("127.0.0.1", port)).unwrap();
    let held = listen(0);
    lab.start_with(handed_over(&lab, "1", &held));
    let first = lab.pages.clone().unwrap();
    assert_eq!(first.0, held.local_addr().unwrap().port());
    lab.wait_until_ready();
    lab.kill();
    assert!(TcpListener::bind(("127.0.0.1", first.0)).is_err(), "another program has taken the port");
    // An order that arrives meanwhile waits for the next service.
    let request = format!(
        "POST {} HTTP/1.1\r\nhost: localhost\r\nconnection: close\r\ncontent-type: application/json\r\n\
         content-length: {}\r\n\r\n{STOP}",
        lab.at("/robots/lab/commands"),
        STOP.len()
    );
    let mut waiting = lab.page();
    waiting.write_all(request.as_bytes()).unwrap();
    lab.start_with(handed_over(&lab, "1", &held));
    assert_eq!(lab.pages.clone().unwrap(), first);
    let mut answer = String::new();
    waiting.read_to_string(&mut answer).unwrap();
    assert!(!answer.starts_with("HTTP/1.1 4"), "{answer}");
    // The manager has lost the port, too.
    lab.kill();
    drop(held);
    lab.start_with(handed_over(&lab, "1", &listen(first.0)));
    let (port, tokens) = lab.pages.clone().unwrap();
    assert!(port == first.0 && tokens.iter().all(|token| !first.1.contains(token)), "{first:?} {tokens:?}");
}

#[test]
fn only_one_socket_of_this_machine_alone_is_taken_over() {
    // The running service holds the lock, so another one ends even if it does not refuse the sockets.
    let lab = Lab::new(100.0);
    let public = TcpListener::bind(("0.0.0.0", 0)).unwrap();
    let local = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    for (listener, sockets, reason) in
        [(&public, "1", "which other machines can reach"), (&local, "2", "there are 2 sockets: correct ListenStream")]
    {
        let output = handed_over(&lab, sockets, listener).output().unwrap();
        let text = in_lines(&String::from_utf8(output.stderr).unwrap());
        assert!(output.status.code() == Some(2) && text.contains(reason), "{text}");
    }
}

#[test]
fn pages_behind_a_configured_proxy_are_served() {
    let lab = Lab::with(100.0, "[serve]\norigins = [\"https://robots.example\"]\n");
    lab.wait_until_ready();
    let (_, [control, _]) = lab.pages.clone().unwrap();
    let (_, cookie) = visit(&lab, &format!("/{control}/"), "robots.example");
    assert!(cookie.ends_with("; Secure"), "{cookie}");
    let cookie = format!("cookie: {}", cookie.split("; ").next().unwrap());
    let order = |headers: &[&str]| {
        let headers = [&[&*cookie], headers].concat();
        lab.ask_page("/control/api/v1/robots/lab/commands", &headers, "POST", STOP)
    };
    for host in ["host: robots.example", "host: localhost", "host: 127.0.0.1:8017"] {
        assert_eq!(order(&[host, "origin: https://robots.example", "sec-fetch-site: same-origin"]), 200, "{host}");
    }
    for headers in [
        ["host: robots.example", "origin: https://evil.example"],
        ["host: robots.example", "origin: http://robots.example"],
        ["host: evil.example", "origin: https://robots.example"],
        ["host: robots.example", "sec-fetch-site: cross-site"],
    ] {
        assert_eq!(order(&headers), 404, "{headers:?}");
    }
    let wrong = lab.directory.path().join("growbot/growbot.toml");
    fs::write(&wrong, "[serve]\norigins = [\"robots.example\"]\n").unwrap();
    let (code, text) = serve_again(&lab);
    assert!(code == Some(2) && text.contains("growbot.toml, line 2") && text.contains("scheme and host"), "{text}");
    let _: Value = lab.ask("GET", "/robots/lab", "").1;
}
