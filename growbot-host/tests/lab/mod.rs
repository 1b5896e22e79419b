//! A running service with a simulated robot, and functions that send HTTP requests to the service.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpStream;
use std::os::unix::net::UnixStream;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::thread::sleep;
use std::time::{Duration, Instant};

use serde_json::Value;

use crate::running::{PATIENCE, PROGRAM, command};

/// Goal of a job of robot A2 that has [`LAYERS`] layers.
pub const GOAL: &str = "0,0,60,0,90";
pub const LAYERS: usize = 78;

/// A running service with a simulated robot, in a directory of its own.
pub struct Lab {
    pub directory: tempfile::TempDir,
    pub service: Option<Child>,
    pub pages: Option<(u16, [String; 2])>,
}

impl Lab {
    pub fn new(pace: f64) -> Self {
        Self::with(pace, "")
    }

    /// Starts a service with the simulated robot `lab` at this pace, and with additional lines in `growbot.toml`.
    pub fn with(pace: f64, more: &str) -> Self {
        Self::configured(&format!(
            "robot = \"growbot-a2\"\nport = \"sim:lab\"\n[robots.lab]\nport = \"sim:lab\"\nrobot = \"growbot-a2\"\npace = {pace}\n{more}"
        ))
    }

    /// Starts a service with this `growbot.toml`.
    pub fn configured(settings: &str) -> Self {
        let directory = tempfile::tempdir().unwrap();
        fs::create_dir(directory.path().join("growbot")).unwrap();
        fs::write(directory.path().join("growbot/growbot.toml"), settings).unwrap();
        fs::create_dir(directory.path().join("run")).unwrap();
        let mut lab = Self { directory, service: None, pages: None };
        lab.start();
        lab
    }

    pub fn command(&self, args: &[&str]) -> Command {
        self.program(PROGRAM, args)
    }

    /// Returns a command that starts another program with the settings of the service's user.
    pub fn program(&self, program: &str, args: &[&str]) -> Command {
        let mut command = command(program);
        command.current_dir(self.directory.path());
        command.env("XDG_CONFIG_HOME", self.directory.path());
        command.env("XDG_STATE_HOME", self.directory.path().join("state"));
        command.env("XDG_RUNTIME_DIR", self.directory.path().join("run"));
        command.args(args).stdin(Stdio::null());
        command
    }

    /// Runs a growbot command with the settings of the service's user. Returns the command's exit code and output.
    pub fn run(&self, args: &[&str]) -> (Option<i32>, String) {
        let output = self.command(args).output().unwrap();
        let text = [output.stdout, output.stderr].concat();
        (output.status.code(), String::from_utf8(text).unwrap())
    }

    /// Starts the service at the port that it had before, or at any free port.
    pub fn start(&mut self) {
        let port = self.pages.as_ref().map_or(0, |(port, _)| *port).to_string();
        self.start_with(self.command(&["serve", "--page-port", &port]));
    }

    /// Starts the service with this command, and waits until it prints the URLs of its pages.
    pub fn start_with(&mut self, command: Command) {
        let output = self.directory.path().join("output");
        let out = fs::File::create(&output).unwrap();
        let heard = self.directory.path().join("heard");
        let heard = fs::File::options().create(true).append(true).open(heard).unwrap();
        let service = { command }.stdout(out).stderr(heard).spawn().unwrap();
        self.service = Some(service);
        let text = wait_for("the service says its addresses", || {
            let text = fs::read_to_string(&output).unwrap();
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
        self.pages = Some(pages);
    }

    /// Returns the process identifier of the simulated robot `lab`: the process that has the robot's lock file open.
    pub fn robot_process(&self) -> String {
        let lock = self.directory.path().join("state/growbot/robots/lab/lock").canonicalize().unwrap();
        let has_it = |process: &fs::DirEntry| {
            let open = fs::read_dir(process.path().join("fd")).into_iter().flatten().flatten();
            open.map(|open| fs::read_link(open.path())).any(|link| link.is_ok_and(|link| link == lock))
        };
        let found = fs::read_dir("/proc").unwrap().flatten().find(has_it).unwrap();
        found.file_name().into_string().unwrap()
    }

    pub fn kill(&mut self) {
        let mut service = self.service.take().unwrap();
        service.kill().unwrap();
        service.wait().unwrap();
    }

    /// Returns the resident memory of the service, kB.
    pub fn memory_kb(&self) -> u64 {
        let status = fs::read_to_string(format!("/proc/{}/status", self.service.as_ref().unwrap().id())).unwrap();
        let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap();
        line.trim().trim_end_matches(" kB").parse().unwrap()
    }

    /// Returns the number of files and connections that the service has open.
    pub fn files(&self) -> usize {
        fs::read_dir(format!("/proc/{}/fd", self.service.as_ref().unwrap().id())).unwrap().count()
    }

    /// Returns the standard error of all services that this value has started.
    pub fn heard(&self) -> String {
        fs::read_to_string(self.directory.path().join("heard")).unwrap()
    }

    /// Returns the commands that the service has recorded in its audit log.
    pub fn orders(&self) -> Vec<Value> {
        let text = fs::read_to_string(self.directory.path().join("state/growbot/serve/audit.jsonl")).unwrap();
        text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
    }

    /// Opens a TCP connection to the address of the pages.
    pub fn page(&self) -> TcpStream {
        let stream = TcpStream::connect(("127.0.0.1", self.pages.as_ref().unwrap().0)).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Returns a path of the API, with the token for commands in front.
    pub fn at(&self, path: &str) -> String {
        format!("/{}/api/v1{path}", self.pages.as_ref().unwrap().1[0])
    }

    pub fn socket(&self) -> PathBuf {
        self.directory.path().join("run/growbot/serve.sock")
    }

    /// Sends an API request on the user's Unix socket. Returns the status and the JSON body of the response.
    pub fn ask(&self, method: &str, path: &str, body: &str) -> (u16, Value) {
        let stream = UnixStream::connect(self.socket()).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let (status, text) = http(stream, method, &format!("/api/v1{path}"), &[], body);
        (status, serde_json::from_str(&text).unwrap_or(Value::String(text)))
    }

    /// Sends a request with these headers to the address of the pages. Returns the status of the response.
    pub fn ask_page(&self, path: &str, headers: &[&str], method: &str, body: &str) -> u16 {
        http(self.page(), method, path, headers, body).0
    }

    pub fn wait_until_ready(&self) {
        self.wait_until_robot_is_ready("lab");
    }

    pub fn wait_until_robot_is_ready(&self, name: &str) {
        wait_for("the robot is ready", || {
            let (_, robot) = self.ask("GET", &format!("/robots/{name}"), "");
            (robot["connection"] == "ready").then_some(())
        });
    }

    /// Waits for the end of a job.
    pub fn wait_for_end(&self, job: &str) -> Value {
        wait_for("the job ends", || {
            let (_, job) = self.ask("GET", &format!("/jobs/{job}"), "");
            self.attended_robot(job["robot"].as_str().unwrap());
            (job["state"] != "active").then_some(job)
        })
    }

    /// Waits until the robot `lab` is in this state.
    pub fn wait_for_state(&self, state: &str) {
        wait_for(state, || (self.attended_robot("lab")["state"] == state).then_some(()));
    }

    /// Returns the status of a robot. On a busy machine the service may not run for seconds, which are minutes for a
    /// fast robot: it parks, and continues only if a person orders it. This orders it.
    pub fn attended_robot(&self, name: &str) -> Value {
        let (_, robot) = self.ask("GET", &format!("/robots/{name}"), "");
        if robot["state"] == "parked" && robot["pause_cause"] == "host-silent" {
            self.ask("POST", &format!("/robots/{name}/commands"), r#"{"command":"continue"}"#);
        }
        robot
    }

    pub fn log(&self, job: &str) -> PathBuf {
        self.directory.path().join(format!("state/growbot/serve/jobs/{job}.jsonl"))
    }
}

impl Drop for Lab {
    fn drop(&mut self) {
        if let Some(mut service) = self.service.take() {
            let _ = service.kill();
            let _ = service.wait();
        }
        // Switch off all simulated robots that the service has switched on.
        for robot in fs::read_dir(self.directory.path().join("state/growbot/robots")).into_iter().flatten().flatten() {
            let port = format!("sim:{}", robot.file_name().to_string_lossy());
            let _ = self.command(&["power", "off", "--port", &port]).output();
        }
    }
}

pub fn wait_for<T>(what: &str, mut look: impl FnMut() -> Option<T>) -> T {
    let began = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(began.elapsed() < PATIENCE, "{what}: not within {PATIENCE:?}");
        sleep(Duration::from_millis(10));
    }
}

/// Sends one HTTP request, which may be invalid. Returns the status and the body of the response.
pub fn http(mut stream: impl Read + Write, method: &str, path: &str, headers: &[&str], body: &str) -> (u16, String) {
    let mut request = format!("{method} {path} HTTP/1.1\r\nconnection: close\r\ncontent-length: {}\r\n", body.len());
    let has_header = |name: &str| headers.iter().any(|header| header.to_lowercase().starts_with(name));
    for (name, value) in [("host:", "localhost"), ("content-type:", "application/json")] {
        if !has_header(name) {
            request += &format!("{name} {value}\r\n");
        }
    }
    headers.iter().for_each(|header| request += &format!("{header}\r\n"));
    request += &format!("\r\n{body}");
    // The service may respond and close before it has received everything.
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
