//! Measures the time until a growing robot on a serial line (a pty) carries out an order: from a command in another
//! terminal, from the page, and the emergency stop while the service is frozen, while a console leases the port, and
//! over TCP with one connection. Prints a table. GROWBOT_ORDERS=50 repeats each measurement 50 times.

#[allow(dead_code, reason = "no test needs all of it")]
use crate::emergency;
use crate::lab;
use crate::running;

use std::io::Write;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use emergency::Bench;
use growbot_core::link::message::State;
use lab::{Lab, wait_for};
use running::command;
use serde_json::json;

/// A growth on a simulated board on a serial line or TCP, which a service drives.
struct Growth {
    /// Console that leases the port of the service and drives the growth. `None` if the service drives it.
    console: Option<Child>,
    lab: Lab,
    bench: Bench,
}

impl Drop for Growth {
    fn drop(&mut self) {
        if let Some(console) = &mut self.console {
            let _ = console.kill();
            let _ = console.wait();
        }
    }
}

impl Growth {
    /// Starts a growth that takes hours, and waits until the board grows.
    fn begin() -> Self {
        Self::begin_at(Bench::warm())
    }

    fn begin_at(bench: Bench) -> Self {
        let growth = Self::at_rest(bench);
        let (status, job) = growth.lab.ask("POST", "/robots/lab/jobs", &json!({ "to": "0,0,300,0,90" }).to_string());
        assert_eq!(status, 201, "{job}");
        growth.wait_for(State::Growing);
        growth
    }

    /// Starts the growth by a console, to which the service leases the port, and waits until the board heats.
    fn begin_by_console() -> Self {
        let mut growth = Self::at_rest(Bench::warm());
        let mut command = growth.lab.command(&["console"]);
        let command = command.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::null());
        let console = growth.console.insert(command.spawn().unwrap());
        console.stdin.take().unwrap().write_all(b"plan 0,0,300,0,90\nstart\nwait 1000000\n").unwrap();
        wait_for("the board heats", || growth.bench.seen().heats.then_some(()));
        growth
    }

    fn at_rest(bench: Bench) -> Self {
        let port = &bench.name;
        let lab = Lab::configured(&format!(
            "port = \"{port}\"\nrobot = \"growbot-a\"\n[robots.lab]\nport = \"{port}\"\nrobot = \"growbot-a\"\n"
        ));
        lab.wait_until_ready();
        Self { console: None, lab, bench }
    }

    fn wait_for(&self, state: State) {
        wait_for(state.name(), || (self.bench.seen().state == state).then_some(()));
    }

    /// Runs a command that must succeed, and returns its duration.
    fn command(&self, args: &[&str]) -> Duration {
        let began = Instant::now();
        let (code, answer) = self.lab.run(args);
        let took = began.elapsed();
        assert_eq!(code, Some(0), "{answer}");
        took
    }

    /// Runs `growbot estop`, and returns its duration. The command is repeated if the 3 s for which it waits for a
    /// confirmation are too short on a starved machine.
    fn estop(&self) -> Duration {
        let began = Instant::now();
        wait_for("a confirmation", || {
            let (code, answer) = self.lab.run(&["estop"]);
            assert!(code == Some(0) || answer.contains("DID NOT CONFIRM"), "{answer}");
            (code == Some(0)).then(|| began.elapsed())
        })
    }

    /// Sends a request to the page, and returns the time until its response.
    fn page(&self, method: &str, path: &str, body: &str) -> Duration {
        let began = Instant::now();
        let status = self.lab.ask_page(&self.lab.at(path), &[], method, body);
        let took = began.elapsed();
        assert_eq!(status, 200);
        took
    }

    fn order(&self, order: &str) -> Duration {
        self.page("POST", "/robots/lab/commands", &json!({ "command": order }).to_string())
    }

    /// Calls `send`, which sends an emergency stop. Returns the time until everything is switched off, and the duration
    /// of `send`, after which the sender knows the result.
    fn emergency_stop(&self, send: impl FnOnce() -> Duration + Send) -> (Duration, Duration) {
        let (off, told) = std::thread::scope(|scope| {
            let began = Instant::now();
            let sender = scope.spawn(send);
            while self.bench.seen().passed.is_none() {
                std::thread::sleep(Duration::from_micros(200));
            }
            (began.elapsed(), sender.join().unwrap())
        });
        assert_eq!(self.bench.seen().off_at_once, Some(true));
        (off, told)
    }
}

/// Prints the median and the maximum of these times as a row of the table.
fn print(what: &str, mut times: Vec<Duration>) {
    times.sort();
    let ms = |time: &Duration| time.as_secs_f64() * 1e3;
    println!("| {what} | {:.1} | {:.1} |", ms(&times[times.len() / 2]), ms(times.last().unwrap()));
}

#[test]
fn commands_from_another_terminal_and_the_page_act_during_a_growth() {
    let count: usize = std::env::var("GROWBOT_ORDERS").map_or(1, |count| count.parse().unwrap());
    println!("| during a growth on a pty, each {count} times | median, ms | max, ms |\n|---|---|---|");
    let growth = Growth::begin();
    let (mut status, mut pause, mut page_status, mut page_pause) = (vec![], vec![], vec![], vec![]);
    for _ in 0..count {
        status.push(growth.command(&["status"]));
        page_status.push(growth.page("GET", "/robots/lab", ""));
        pause.push(growth.command(&["pause"]));
        growth.wait_for(State::Paused);
        growth.command(&["continue"]);
        growth.wait_for(State::Growing);
        page_pause.push(growth.order("pause"));
        growth.wait_for(State::Paused);
        growth.order("continue");
        growth.wait_for(State::Growing);
    }
    print("`growbot status`", status);
    print("status on the page", page_status);
    print("`growbot pause`", pause);
    print("pause on the page", page_pause);
    drop(growth);
    let (mut by_command, mut by_page, mut frozen) = (vec![], vec![], vec![]);
    let (mut leased, mut page_leased, mut on_tcp) = (vec![], vec![], vec![]);
    for _ in 0..count {
        let growth = Growth::begin();
        by_command.push(growth.emergency_stop(|| growth.estop()));
        let growth = Growth::begin();
        by_page.push(growth.emergency_stop(|| growth.order("emergency-stop")));
        let growth = Growth::begin();
        let pid = growth.lab.service.as_ref().unwrap().id().to_string();
        assert!(command("kill").args(["-STOP", &pid]).status().unwrap().success());
        frozen.push(growth.emergency_stop(|| growth.estop()));
        assert!(command("kill").args(["-CONT", &pid]).status().unwrap().success());
        let growth = Growth::begin_by_console();
        leased.push(growth.emergency_stop(|| growth.estop()));
        let growth = Growth::begin_by_console();
        page_leased.push(growth.emergency_stop(|| growth.order("emergency-stop")));
        let growth = Growth::begin_at(Bench::on_tcp());
        on_tcp.push(growth.emergency_stop(|| growth.estop()));
    }
    for (what, times) in [
        ("`growbot estop`", by_command),
        ("on the page", by_page),
        ("`growbot estop`, the service frozen", frozen),
        ("`growbot estop`, the port leased by a console", leased),
        ("on the page, the port leased by a console", page_leased),
        ("`growbot estop`, a robot behind TCP", on_tcp),
    ] {
        let (off, told) = times.into_iter().unzip();
        print(&format!("{what}: everything off"), off);
        print(&format!("{what}: confirmed"), told);
    }
}
