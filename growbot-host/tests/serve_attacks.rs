//! Sends thousands of invalid requests, drawn from a seed, to the service. Each must be refused with the right status,
//! and must not move a robot. Afterwards the state of the service must be unchanged.
//!
//! The default number of requests is 5,000. GROWBOT_ATTACKS=50000 sets another number.

use crate::lab;

use std::io::{Read, Write};

use growbot_core::random::Rng;
use lab::{GOAL, Lab, http};
use serde_json::json;

/// An invalid request, and the HTTP statuses that are allowed in the response. 0 stands for a connection that is closed
/// without a response.
struct Attack {
    request: Vec<u8>,
    statuses: &'static [u16],
}

/// Generator of random invalid requests.
struct Attacker<'a> {
    random: Rng,
    lab: &'a Lab,
}

impl Attacker<'_> {
    fn below(&mut self, most: usize) -> usize {
        (self.random.uniform_symmetric().abs() * most as f64) as usize % most
    }

    fn of<T: Copy>(&mut self, choice: &[T]) -> T {
        choice[self.below(choice.len())]
    }

    fn hex(&mut self, digits: usize) -> String {
        (0..digits).map(|_| self.of(b"0123456789abcdef") as char).collect()
    }

    fn noise(&mut self, bytes: usize) -> Vec<u8> {
        (0..bytes).map(|_| self.below(256) as u8).collect()
    }

    fn draw(&mut self) -> Attack {
        match self.below(9) {
            0 => self.wrong_token(),
            1 => self.wrong_origin(),
            2 => self.traversal(),
            3 => self.only_reading(),
            4 => self.wrong_body(),
            5 => self.no_such_thing(),
            6 => self.wrong_method(),
            7 => self.too_much(),
            _ => self.no_http(),
        }
    }

    /// Returns path and body of an order that would be carried out if it were sent with a valid token and an allowed
    /// origin.
    fn order(&mut self) -> (String, &'static str) {
        match self.below(3) {
            0 => ("robots/lab/commands".to_owned(), r#"{"command":"emergency-stop"}"#),
            1 => ("robots/lab/maintenance".to_owned(), r#"{"task":"preheat","value":"200"}"#),
            _ => ("robots/lab/jobs".to_owned(), r#"{"to":"0,0,60,0,90"}"#),
        }
    }

    fn wrong_token(&mut self) -> Attack {
        let (_, [operate, _]) = self.lab.pages.clone().unwrap();
        let token = match self.below(5) {
            0 => self.hex(32),
            1 => operate[..31].to_owned(),
            2 => operate.to_uppercase() + "0",
            3 => String::new(),
            _ => {
                let digit = self.below(32);
                let other = if &operate[digit..=digit] == "0" { "1" } else { "0" };
                format!("{}{other}{}", &operate[..digit], &operate[digit + 1..])
            }
        };
        let (path, body) = self.order();
        Attack { request: post(&format!("/{token}/api/v1/{path}"), &["host: localhost"], body), statuses: &[404] }
    }

    /// Returns an order with the origin of another page, or with a host name that is not a name of this machine.
    fn wrong_origin(&mut self) -> Attack {
        let (path, body) = self.order();
        let headers: &[&str] = self.of(&[
            &["host: evil.example"] as &[&str],
            &["host: 127.0.0.1.evil.example"],
            &["host: 192.168.0.7:8017"],
            &["host: localhost", "origin: http://evil.example"],
            &["host: localhost", "origin: null"],
            &["host: localhost", "origin: https://localhost"],
            &["host: localhost", "sec-fetch-site: cross-site"],
            &["host: localhost", "sec-fetch-site: same-site"],
            &[],
        ]);
        Attack { request: post(&self.lab.at(&format!("/{path}")), headers, body), statuses: &[404] }
    }

    fn traversal(&mut self) -> Attack {
        let up = self.of(&["../", "..%2f", "%2e%2e/", "%2e%2e%2f", "..%5c", "....//", "%252e%252e%252f", "..%c0%af"]);
        let target = self.of(&["tokens", "audit.jsonl", "jobs.sqlite", "etc/passwd", "webhook-secret"]);
        let up = up.repeat(1 + self.below(6));
        let path = match self.below(4) {
            0 => self.lab.at(&format!("/jobs/{up}{target}/log")),
            1 => self.lab.at(&format!("/jobs/{up}{target}/events")),
            2 => self.lab.at(&format!("/robots/{up}{target}")),
            _ => format!("/{}/{up}{target}", self.lab.pages.as_ref().unwrap().1[0]),
        };
        // A path that is not text is an invalid request for any target.
        Attack { request: ask("GET", &path, &["host: localhost"], ""), statuses: &[400, 404] }
    }

    fn only_reading(&mut self) -> Attack {
        let (path, body) = self.order();
        let path = format!("/{}/api/v1/{path}", self.lab.pages.as_ref().unwrap().1[1]);
        Attack { request: post(&path, &["host: localhost"], body), statuses: &[403] }
    }

    fn wrong_body(&mut self) -> Attack {
        let (path, body) = self.order();
        let path = self.lab.at(&format!("/{path}"));
        let mut bytes = body.as_bytes().to_vec();
        let at = self.below(bytes.len());
        let (bytes, statuses): (Vec<u8>, &[u16]) = match self.below(7) {
            0 => (bytes[..at].to_vec(), &[400]),
            1 => {
                bytes[at] = self.of(&[0, 0xff, 0xc0, 7]);
                (bytes, &[400])
            }
            2 => (body.replace(':', r#":{"a":"#).replace('}', "}}").into_bytes(), &[422]),
            3 => (body.replacen('{', r#"{"unknown":1,"#, 1).into_bytes(), &[422]),
            4 => ("[".repeat(1 + at * 1000).into_bytes(), &[400, 413, 422]),
            5 => (self.of(&["null", "0", "[]", "{}", "\"\"", "1e999"]).as_bytes().to_vec(), &[400, 422]),
            _ => {
                let kind = self.of(&["text/plain", "application/x-www-form-urlencoded", "multipart/form-data", ""]);
                let headers = ["host: localhost", &format!("content-type: {kind}")];
                return Attack { request: ask("POST", &path, &headers, body), statuses: &[415] };
            }
        };
        Attack { request: request("POST", &path, &["host: localhost", JSON], &bytes), statuses }
    }

    fn no_such_thing(&mut self) -> Attack {
        let name = self.hex(8);
        let (method, path, body) = match self.below(5) {
            0 => ("POST", format!("/robots/{name}/commands"), r#"{"command":"stop"}"#),
            1 => ("POST", format!("/jobs/{name}/resume"), ""),
            2 => ("GET", format!("/jobs/{name}"), ""),
            3 => ("GET", format!("/plans/{}/view", self.below(1000)), ""),
            _ => ("GET", format!("/{name}"), ""),
        };
        Attack { request: ask(method, &self.lab.at(&path), &["host: localhost", JSON], body), statuses: &[404] }
    }

    fn wrong_method(&mut self) -> Attack {
        let (path, body) = self.order();
        let method = self.of(&["GET", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "BREW"]);
        let path = self.lab.at(&format!("/{path}"));
        Attack { request: ask(method, &path, &["host: localhost", JSON], body), statuses: &[405] }
    }

    fn too_much(&mut self) -> Attack {
        let (path, _) = self.order();
        let path = self.lab.at(&format!("/{path}"));
        match self.below(3) {
            // The length is only announced. The service refuses without waiting for the body.
            0 => {
                let length = format!("content-length: {}", (17 << 20) + self.below(1 << 40));
                Attack { request: head("POST", &path, &["host: localhost", JSON, &length]), statuses: &[413] }
            }
            // The status depends on how much of the request has arrived when the service checks it.
            1 => {
                let long = format!("x: {}", "a".repeat(500_000));
                Attack { request: head("POST", &path, &["host: localhost", JSON, &long]), statuses: &[400, 431, 0] }
            }
            _ => {
                let many = vec!["x: y"; 200];
                Attack { request: head("POST", &path, &many), statuses: &[431, 0] }
            }
        }
    }

    fn no_http(&mut self) -> Attack {
        let (path, body) = self.order();
        let path = self.lab.at(&format!("/{path}"));
        let length = 1 + self.below(300);
        let request = match self.below(6) {
            0 => [self.noise(length), b"\r\n\r\n".to_vec()].concat(),
            1 => format!("POST {path} HTTP/9.9\r\nhost: localhost\r\n\r\n").into_bytes(),
            2 => head("POST", &path, &["host: localhost", JSON, "content-length: -1"]),
            3 => head("POST", &path, &["host: localhost", JSON, "content-length: 5", "content-length: 7"]),
            4 => {
                let both = ["host: localhost", JSON, "transfer-encoding: chunked"];
                [head("POST", &path, &both), b"zz\r\n".to_vec(), body.as_bytes().to_vec()].concat()
            }
            _ => format!("POST {path}\u{0} HTTP/1.1\r\nhost: localhost\r\n\r\n").into_bytes(),
        };
        Attack { request, statuses: &[400, 422, 0] }
    }
}

const JSON: &str = "content-type: application/json";

fn head(method: &str, path: &str, headers: &[&str]) -> Vec<u8> {
    let headers: String = headers.iter().map(|header| format!("{header}\r\n")).collect();
    format!("{method} {path} HTTP/1.1\r\nconnection: close\r\n{headers}\r\n").into_bytes()
}

fn request(method: &str, path: &str, headers: &[&str], body: &[u8]) -> Vec<u8> {
    let length = format!("content-length: {}", body.len());
    [head(method, path, &[headers, &[&length]].concat()), body.to_vec()].concat()
}

fn ask(method: &str, path: &str, headers: &[&str], body: &str) -> Vec<u8> {
    request(method, path, headers, body.as_bytes())
}

fn post(path: &str, headers: &[&str], body: &str) -> Vec<u8> {
    ask("POST", path, &[headers, &[JSON]].concat(), body)
}

/// Sends a request, and returns the status of the response. 0 if the connection is closed without a response.
fn status(lab: &Lab, request: &[u8]) -> u16 {
    let mut stream = lab.page();
    // The service may refuse and close before it has received everything.
    let _ = stream.write_all(request);
    let mut answer = Vec::new();
    let mut part = [0; 4096];
    while !answer.windows(4).any(|end| end == b"\r\n\r\n") {
        match stream.read(&mut part) {
            Ok(read @ 1..) => answer.extend_from_slice(&part[..read]),
            Ok(0) => break,
            Err(error) if error.kind() == std::io::ErrorKind::ConnectionReset => break,
            Err(error) => panic!("no answer to {:?}: {error}", String::from_utf8_lossy(request)),
        }
    }
    String::from_utf8_lossy(&answer).split(' ').nth(1).and_then(|status| status.parse().ok()).unwrap_or(0)
}

#[test]
fn invalid_requests_are_refused_without_effect() {
    let count: usize = std::env::var("GROWBOT_ATTACKS").map_or(5000, |count| count.parse().unwrap());
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    let how_it_is = || {
        let (_, robot) = lab.ask("GET", "/robots/lab", "");
        let of = |key: &str| robot[key].clone();
        (["state", "board", "fault", "job", "target_c", "laid", "layers"].map(of), lab.ask("GET", "/jobs", "").1)
    };
    let before = how_it_is();
    let mut attacker = Attacker { random: Rng::new(&[19, 2]), lab: &lab };
    let mut answered = std::collections::BTreeMap::new();
    let mut memory_kb = 0;
    for number in 0..count {
        let Attack { request, statuses } = attacker.draw();
        let status = status(&lab, &request);
        let request_text = String::from_utf8_lossy(&request[..request.len().min(400)]);
        assert!(statuses.contains(&status), "{number}: {status}, and not {statuses:?}, to {request_text:?}");
        *answered.entry(status).or_insert(0) += 1;
        if number == count / 5 {
            memory_kb = lab.memory_kb();
        }
    }
    let (grown_kb, files) = (lab.memory_kb().saturating_sub(memory_kb), lab.files());
    println!(
        "{count} requests, by status: {answered:?}; {memory_kb} kB after a fifth of them, {grown_kb} kB more after all"
    );
    assert!(grown_kb < 10_000, "{grown_kb} kB more than {memory_kb} kB");
    assert!(files < 60, "{files} files are open");
    assert_eq!(how_it_is(), before);
    let orders = lab.orders();
    assert!(orders.iter().all(|order| order["error"].is_string()), "{orders:?}");
    assert!(!lab.heard().contains("panicked"), "{}", lab.heard());
    // The service still executes a valid request.
    let (status, job) = lab.ask("POST", "/robots/lab/jobs", &json!({ "to": GOAL }).to_string());
    assert_eq!(status, 201, "{job}");
    assert_eq!(lab.wait_for_end(job["id"].as_str().unwrap())["state"], "done");
}

#[test]
fn refusals_are_problem_details_and_foreign_pages_open_no_socket() {
    let lab = Lab::new(100.0);
    lab.wait_until_ready();
    for (method, path, body, wanted) in [
        ("POST", "/robots/lab/commands", "{", 400),
        ("POST", "/robots/lab/commands", r#"{"command":"dance"}"#, 422),
        ("PUT", "/robots/lab/commands", "", 405),
        ("GET", "/jobs?limit=many", "", 400),
        ("GET", "/jobs/none", "", 404),
    ] {
        let (status, problem) = lab.ask(method, path, body);
        let is_reported = problem["detail"].as_str().is_some_and(|detail| !detail.is_empty());
        assert!(status == wanted && problem["status"] == wanted && is_reported, "{method} {path}: {status} {problem}");
    }
    let (_, document) = lab.ask("GET", "/openapi.json", "");
    let operation = &document["paths"]["/robots/{robot}/commands"]["post"];
    let parameters = operation["parameters"].as_array().unwrap().iter().map(|parameter| &parameter["name"]);
    assert_eq!(parameters.collect::<Vec<_>>(), ["growbot-order-time", "robot"], "{operation}");
    let created: Vec<&String> =
        document["paths"]["/library"]["post"]["responses"].as_object().unwrap().keys().collect();
    assert_eq!(created, ["201", "default"]);
    let responses: Vec<&String> = operation["responses"].as_object().unwrap().keys().collect();
    assert_eq!(responses, ["200", "default"]);
    assert!(operation["responses"]["default"]["content"]["application/problem+json"].is_object(), "{operation}");
    let upgrade = ["connection: upgrade", "upgrade: websocket", "sec-websocket-version: 13"];
    let key = "sec-websocket-key: dGhlIHNhbXBsZSBub25jZQ==";
    let open = |headers: &[&str]| {
        let headers = [&upgrade[..], &[key], headers].concat();
        let headers: String = headers.iter().map(|header| format!("{header}\r\n")).collect();
        let path = lab.at("/events/ws");
        status(&lab, format!("GET {path} HTTP/1.1\r\n{headers}\r\n").as_bytes())
    };
    assert_eq!(open(&["host: localhost", "origin: http://localhost"]), 101);
    assert_eq!(open(&["host: localhost"]), 101);
    assert_eq!(open(&["host: localhost", "origin: http://evil.example"]), 404);
    assert_eq!(open(&["host: evil.example", "origin: http://evil.example"]), 404);
    assert_eq!(open(&["host: localhost", "sec-fetch-site: cross-site"]), 404);
    let (status, _) = http(lab.page(), "GET", &lab.at("/events/ws"), &[], "");
    assert_eq!(status, 400, "a socket that is asked for without an upgrade");
}
