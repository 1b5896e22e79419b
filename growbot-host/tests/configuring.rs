//! Tests of `growbot configure` on a simulated robot that keeps running: the board stores another robot description.

use std::fs;
use std::io::{Read, Write};
use std::net::TcpListener;
use std::thread;
use std::time::Duration;

use growbot_client::port::Port;
use growbot_plan::robot_file;
use growbot_sim::port::sim::Sim;
use running::growbot;
use serde_json::Value;

use crate::running;

fn json(ran: &running::Ran) -> Value {
    serde_json::from_str(&ran.out).unwrap()
}

/// A simulated robot of one test. It is switched off when the value is dropped.
struct Robot {
    port: String,
    directory: tempfile::TempDir,
}

impl Robot {
    fn on() -> Self {
        let directory = tempfile::tempdir().unwrap();
        let port = format!("sim:{}/bench", directory.path().display());
        let robot = Self { port, directory };
        robot.run(&["power", "on", "--pace", "1000"]);
        robot
    }

    fn run(&self, args: &[&str]) -> running::Ran {
        let ran = self.try_to(args);
        assert_eq!(ran.code, Some(0), "{args:?}: {}{}", ran.out, ran.err);
        ran
    }

    fn try_to(&self, args: &[&str]) -> running::Ran {
        growbot(&[args, &["--port", &self.port]].concat())
    }

    /// Returns the name and the hash of the robot description that the board stores.
    fn described(&self) -> (String, String) {
        let status = json(&self.run(&["status", "--json"]));
        let text = |key: &str| status[key].as_str().unwrap_or_default().to_owned();
        (text("robot"), text("robot_hash"))
    }
}

impl Drop for Robot {
    fn drop(&mut self) {
        self.try_to(&["power", "off"]);
    }
}

#[test]
fn a_description_is_sent_stored_and_reported() {
    let robot = Robot::on();
    let (name, hash) = robot.described();
    assert_eq!(name, "growbot-a");
    let mine = robot.directory.path().join("mine.toml");
    let text = include_str!("../../robots/growbot-b.toml").replace("\"growbot-b\"", "\"mine\"");
    fs::write(&mine, text).unwrap();
    let mine = mine.to_str().unwrap();

    let done = robot.run(&["configure", mine]);
    assert!(done.out.starts_with("the simulated board is now configured as mine ("), "{}", done.out);
    assert!(done.out.ends_with(&format!("; it was growbot-a ({hash})\n")), "{}", done.out);
    assert!(done.err.contains("note: give this robot in other commands, too, with --robot "), "{}", done.err);
    let configured = robot.described();
    assert_eq!(configured.0, "mine");
    assert!(done.out.contains(&configured.1), "{}", done.out);

    // The board keeps the description over a loss of power.
    robot.run(&["power", "off"]);
    let on = growbot(&["power", "on", "--pace", "1000", "--robot", mine, "--port", &robot.port]);
    assert_eq!(on.code, Some(0), "{}", on.err);
    assert_eq!(robot.described(), configured);

    // A command for another robot is refused with a remedy.
    let other = robot.try_to(&["grow", "--to", "0,0,20,0,90", "--robot", "growbot-a"]);
    assert_eq!(other.code, Some(2), "{}", other.err);
    for part in ["the board's robot is mine (", ", not growbot-a (", "growbot configure"] {
        assert!(other.err.contains(part), "{part}: {}", other.err);
    }
    let again = json(&robot.run(&["configure", "growbot-a", "--json"]));
    assert_eq!(again["robot"], "growbot-a");
    assert_eq!(again["robot_hash"], hash);
    assert_eq!(again["robot_before"], "mine");
    assert_eq!(again["robot_hash_before"], configured.1);
    assert_eq!(again["simulated"], true);
}

#[test]
fn failed_configuration_is_reported_and_changes_nothing() {
    let robot = Robot::on();
    let before = robot.described();
    let bad = robot.directory.path().join("bad.toml");
    fs::write(&bad, include_str!("../../robots/growbot-a.toml").replace("max_c = 240", "max_c = 24")).unwrap();
    let refused = robot.try_to(&["configure", bad.to_str().unwrap()]);
    assert_eq!(refused.code, Some(2), "{}", refused.err);
    assert!(refused.err.contains("heater."), "{}", refused.err);

    robot.run(&["maintain", "preheat", "200"]);
    let hot = robot.try_to(&["configure", "growbot-b"]);
    assert_eq!(hot.code, Some(1), "{}", hot.err);
    assert!(hot.err.contains("the board refused the robot description: this is not allowed in state"), "{}", hot.err);
    assert_eq!(robot.described(), before);
}

/// The port of a board over USB disappears while the board restarts. The command opens the port again.
#[test]
fn a_port_that_disappears_during_the_restart_is_reopened() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = format!("tcp:{}", listener.local_addr().unwrap());
    let board = thread::spawn(move || {
        let mut sim = Sim::new(robot_file::load("growbot-a".as_ref()).unwrap());
        let mut buffer = [0; 256];
        for _ in 0..2 {
            let (mut line, _) = listener.accept().unwrap();
            line.set_read_timeout(Some(Duration::from_millis(1))).unwrap();
            let boots = sim.boots();
            while sim.boots() == boots {
                match line.read(&mut buffer) {
                    Ok(0) => break,
                    Ok(count) => sim.send(&buffer[..count]).unwrap(),
                    Err(_) => {}
                }
                sim.run_for(Duration::from_millis(2));
                let count = sim.receive(&mut buffer, Duration::ZERO).unwrap();
                let _ = line.write_all(&buffer[..count]);
            }
        }
        sim.robot().name().to_owned()
    });
    let done = growbot(&["configure", "growbot-b", "--port", &port]);
    assert_eq!(done.code, Some(0), "{}{}", done.out, done.err);
    assert!(done.out.starts_with("the board is now configured as growbot-b ("), "{}", done.out);
    assert_eq!(board.join().unwrap(), "growbot-b");
}
