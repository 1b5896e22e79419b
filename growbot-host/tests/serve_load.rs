//! Tests the service under load: eight simulated robots grow one tube after another, twenty pages follow the growths,
//! half of them on WebSockets, and clients send two hundred requests per second. GROWBOT_LOAD_S=60 sets a duration of
//! 60 s. The test prints the duration of requests, which is meaningful on a machine without other work.

use std::collections::BTreeMap;
use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread::{self, sleep};
use std::time::{Duration, Instant};

use lab::{GOAL, Lab, wait_for};
use serde_json::{Value, json};

use crate::lab;

const ROBOTS: usize = 8;
const PAGES: usize = 20;
/// Number of requests per second of all `CLIENTS` together.
const RATE: usize = 200;
const CLIENTS: usize = 10;

/// State that all threads of the test share.
struct Load<'a> {
    lab: &'a Lab,
    until: Instant,
    /// Identifier of the latest job of each robot.
    jobs: Vec<Mutex<Option<String>>>,
    /// Number of robots that still grow or will grow another tube.
    growing: AtomicUsize,
    /// Number of finished jobs.
    grown: AtomicUsize,
}

/// Identifier of a job, and the events of the job that a page received: the number and the text of each line of the run
/// log.
type Told = (String, Vec<(u64, String)>);

/// Guard of a robot that grows. When it is dropped, also by a panic, it decrements the number of growing robots.
struct Ended<'a>(&'a AtomicUsize);

impl Drop for Ended<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

impl Load<'_> {
    /// Runs one job after another on a robot until the duration of the test is over. Returns the number of jobs.
    fn grow(&self, robot: usize) -> usize {
        let _ended = Ended(&self.growing);
        let mut grown = 0;
        while Instant::now() < self.until {
            let path = format!("/robots/{}/jobs", name(robot));
            let (status, job) = self.lab.ask("POST", &path, &json!({ "to": GOAL }).to_string());
            // The journal is full after some growths.
            if status == 409
                && job["detail"].as_str().is_some_and(|why| why.ends_with("wait until the nozzle has cooled"))
            {
                sleep(Duration::from_millis(100));
                continue;
            }
            assert_eq!(status, 201, "{job}");
            let id = job["id"].as_str().unwrap().to_owned();
            *self.jobs[robot].lock().unwrap() = Some(id.clone());
            assert_eq!(self.lab.wait_for_end(&id)["state"], "done");
            self.grown.fetch_add(1, Ordering::AcqRel);
            grown += 1;
        }
        grown
    }

    /// Follows the jobs of a robot like a page, each from its beginning to its end. Returns the events of each job.
    fn follow(&self, page: usize) -> Vec<Told> {
        let mut told: Vec<Told> = Vec::new();
        loop {
            let last = self.growing.load(Ordering::Acquire) == 0;
            let job = self.jobs[page % ROBOTS].lock().unwrap().clone();
            match job.filter(|job| told.last().is_none_or(|(before, _)| before != job)) {
                Some(job) => {
                    let lines = if page.is_multiple_of(2) { self.events(&job) } else { self.socket(&job) };
                    told.push((job, lines));
                }
                None if last => return told,
                None => sleep(Duration::from_millis(10)),
            }
        }
    }

    fn open(&self, path: &str, headers: &str) -> BufReader<TcpStream> {
        let mut stream = self.lab.page();
        let path = self.lab.at(path);
        stream.write_all(format!("GET {path} HTTP/1.1\r\nhost: localhost\r\n{headers}\r\n").as_bytes()).unwrap();
        let mut reader = BufReader::new(stream);
        let mut line = String::new();
        while line != "\r\n" {
            line.clear();
            assert!(reader.read_line(&mut line).unwrap() > 0, "no answer");
        }
        reader
    }

    /// Returns the server-sent events of a job until the stream ends. The chunks of the response contain whole lines.
    fn events(&self, job: &str) -> Vec<(u64, String)> {
        let reader = self.open(&format!("/jobs/{job}/events"), "connection: close\r\n");
        let (mut lines, mut data) = (Vec::new(), None);
        for line in reader.lines() {
            let line = line.unwrap();
            let line = line.trim_end_matches('\r');
            if let Some(text) = line.strip_prefix("data: ") {
                data = Some(text.to_owned());
            } else if let Some(id) = line.strip_prefix("id: ") {
                lines.push((id.parse().unwrap(), data.take().unwrap()));
            }
        }
        lines
    }

    /// Returns the events of a job from a WebSocket until the frame that closes it.
    fn socket(&self, job: &str) -> Vec<(u64, String)> {
        let headers = "connection: upgrade\r\nupgrade: websocket\r\nsec-websocket-version: 13\r\n\
                       sec-websocket-key: dGhlIHNhbXBsZSBub25jZQ==\r\n";
        let mut reader = self.open(&format!("/jobs/{job}/events/ws"), headers);
        let mut lines = Vec::new();
        loop {
            let (kind, bytes) = frame(&mut reader);
            match kind {
                1 => {
                    let message: Value = serde_json::from_slice(&bytes).unwrap();
                    assert_eq!((&message["version"], &message["event"]), (&json!(1), &json!("log")));
                    lines.push((message["id"].as_u64().unwrap(), message["data"].to_string()));
                }
                8 => return lines,
                // A ping.
                9 => {}
                kind => panic!("a frame of kind {kind}"),
            }
        }
    }

    /// Sends requests at a constant rate on one connection. Returns the duration of each request, and the number of
    /// requests before the first job was finished.
    fn ask(&self, client: usize) -> (Vec<Duration>, usize) {
        let paths = ["/robots", "/jobs?limit=20", "/robots/lab", "/openapi.json"].map(|path| self.lab.at(path));
        let (mut took, mut early) = (Vec::new(), 0);
        let mut stream = BufReader::new(self.lab.page());
        let pause = Duration::from_secs(1) * CLIENTS as u32 / RATE as u32;
        let mut next = Instant::now();
        while Instant::now() < self.until {
            let path = &paths[(took.len() + client) % paths.len()];
            let began = Instant::now();
            stream.get_mut().write_all(format!("GET {path} HTTP/1.1\r\nhost: localhost\r\n\r\n").as_bytes()).unwrap();
            assert_eq!(answer(&mut stream), 200);
            took.push(began.elapsed());
            early += usize::from(self.grown.load(Ordering::Acquire) == 0);
            next += pause;
            sleep(next.saturating_duration_since(Instant::now()));
        }
        (took, early)
    }
}

/// Reads a WebSocket frame of the server. Returns the frame's opcode and content.
fn frame(reader: &mut impl Read) -> (u8, Vec<u8>) {
    let mut head = [0; 2];
    reader.read_exact(&mut head).unwrap();
    assert!(head[0] & 0x80 != 0 && head[1] & 0x80 == 0, "a whole frame, unmasked");
    let length = match head[1] {
        126 => {
            let mut length = [0; 2];
            reader.read_exact(&mut length).unwrap();
            u64::from(u16::from_be_bytes(length))
        }
        127 => {
            let mut length = [0; 8];
            reader.read_exact(&mut length).unwrap();
            u64::from_be_bytes(length)
        }
        length => u64::from(length),
    };
    let mut bytes = vec![0; usize::try_from(length).unwrap()];
    reader.read_exact(&mut bytes).unwrap();
    (head[0] & 0xf, bytes)
}

/// Reads a whole HTTP response, and returns its status.
fn answer(reader: &mut impl BufRead) -> u16 {
    let (mut status, mut length) = (0, 0);
    loop {
        let mut line = String::new();
        assert!(reader.read_line(&mut line).unwrap() > 0, "no answer");
        if status == 0 {
            status = line.split(' ').nth(1).unwrap().parse().unwrap();
        }
        if let Some(text) = line.strip_prefix("content-length: ") {
            length = text.trim().parse().unwrap();
        }
        if line == "\r\n" {
            break;
        }
    }
    std::io::copy(&mut reader.take(length), &mut std::io::sink()).unwrap();
    status
}

fn name(robot: usize) -> String {
    if robot == 0 { "lab".to_owned() } else { format!("lab{robot}") }
}

#[test]
fn pages_get_every_event_once_while_requests_are_served() {
    let seconds: u64 = std::env::var("GROWBOT_LOAD_S").map_or(4, |seconds| seconds.parse().unwrap());
    let more = (1..ROBOTS).map(name);
    let more: String = more
        .map(|name| format!("[robots.{name}]\nport = \"sim:{name}\"\nrobot = \"growbot-a2\"\npace = 100.0\n"))
        .collect();
    let lab = Lab::with(100.0, &more);
    wait_for("all robots are ready", || {
        let (_, robots) = lab.ask("GET", "/robots", "");
        robots.as_array().unwrap().iter().all(|robot| robot["connection"] == "ready").then_some(())
    });
    let load = Load {
        lab: &lab,
        until: Instant::now() + Duration::from_secs(seconds),
        jobs: (0..ROBOTS).map(|_| Mutex::default()).collect(),
        growing: AtomicUsize::new(ROBOTS),
        grown: AtomicUsize::new(0),
    };
    let (grown, told, (took, early), memory) = thread::scope(|scope| {
        let growers: Vec<_> = (0..ROBOTS)
            .map(|robot| {
                scope.spawn({
                    let load = &load;
                    move || load.grow(robot)
                })
            })
            .collect();
        let pages: Vec<_> = (0..PAGES)
            .map(|page| {
                scope.spawn({
                    let load = &load;
                    move || load.follow(page)
                })
            })
            .collect();
        let clients: Vec<_> = (0..CLIENTS)
            .map(|client| {
                scope.spawn({
                    let load = &load;
                    move || load.ask(client)
                })
            })
            .collect();
        sleep(Duration::from_secs(seconds / 4));
        let at_start = lab.memory_kb();
        let answered: (Vec<_>, Vec<_>) = clients.into_iter().map(|client| client.join().unwrap()).unzip();
        let memory = (at_start, lab.memory_kb());
        let grown: usize = growers.into_iter().map(|grower| grower.join().unwrap()).sum();
        let told: Vec<Told> = pages.into_iter().flat_map(|page| page.join().unwrap()).collect();
        (grown, told, answered, memory)
    });
    let mut logs: BTreeMap<&str, Vec<Value>> = BTreeMap::new();
    let mut events = 0;
    for (job, lines) in &told {
        let log = logs.entry(job).or_insert_with(|| {
            let text = fs::read_to_string(lab.log(job)).unwrap();
            text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
        });
        let numbers: Vec<u64> = lines.iter().map(|(number, _)| *number).collect();
        assert_eq!(numbers, (1..=log.len() as u64).collect::<Vec<_>>(), "{job}");
        let received: Vec<Value> = lines.iter().map(|(_, line)| serde_json::from_str(line).unwrap()).collect();
        assert!(received == *log, "{job}: other lines than those of its log");
        events += lines.len();
    }
    let mut took = took.concat();
    took.sort_unstable();
    let (median, late) = (took[took.len() / 2], took[took.len() * 99 / 100]);
    println!(
        "{seconds} s, {ROBOTS} robots, {grown} bodies, {PAGES} pages, {} streams, {events} events, each once; {} requests, \
         median {median:?}, 99 % within {late:?}; {} kB after a quarter, {} kB at the end",
        told.len(),
        took.len(),
        memory.0,
        memory.1
    );
    assert!(grown >= ROBOTS && told.len() >= PAGES, "{grown} {}", told.len());
    assert!(
        early.iter().all(|early| *early > 1),
        "requests wait for growths: {early:?} were answered during the first"
    );
    assert!(memory.1 < memory.0 + 20_000, "{memory:?} kB");
    assert!(!lab.heard().contains("panicked"), "{}", lab.heard());
}
