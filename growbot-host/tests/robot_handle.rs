//! Each command in each state of a robot: the same exit code, effect and message, whether the command itself opens the
//! robot's port or a service owns it.

use std::fs;
use std::io::{BufRead, BufReader, Read, Write};
use std::process::Stdio;

use serde_json::Value;

use crate::lab::{Lab, wait_for};
use crate::running::{PROGRAM, command, in_lines};

/// Programs that can own the robot's port.
#[derive(Debug, Clone, Copy, PartialEq)]
enum PortOwner {
    Command,
    Service,
}

/// A command, its exit code, and a part of its message.
struct Row {
    args: &'static [&'static str],
    code: i32,
    message: &'static str,
    /// State of the board after the command. `None` if the state does not change.
    after: Option<&'static str>,
}

const fn row(args: &'static [&'static str], code: i32, message: &'static str) -> Row {
    Row { args, code, message, after: None }
}

const fn changing(args: &'static [&'static str], message: &'static str, after: &'static str) -> Row {
    Row { args, code: 0, message, after: Some(after) }
}

const OFF: &str = "heater and steppers of the simulated robot are off";
const NOT_HOT: &str = "motors of an idle board turn only while the nozzle is hot: preheat the nozzle first";
const TOO_HOT: &str = "the temperature must be between 50 and 235 C";

/// Commands that give the same result in each state.
const EVERYWHERE: [Row; 3] = [
    row(&["maintain", "load", "nope"], 2, "\"nope\" is neither a number nor a material of the robot file"),
    row(&["maintain", "rotate"], 2, "\"\" is not a number: give a number, for example `rotate 10`"),
    row(&["maintain", "home", "1"], 2, "`home` takes no arguments: remove \"1\""),
];

const IDLE: [Row; 9] = [
    row(&["clear"], 0, "there is nothing to clear: the simulated robot is in the state idle"),
    row(&["cancel"], 0, "the simulated board stores no body: there is nothing to discard; heater and steppers are off"),
    row(&["maintain", "jog", "5"], 1, NOT_HOT),
    row(&["maintain", "home"], 1, NOT_HOT),
    row(&["maintain", "preheat", "900"], 1, TOO_HOT),
    row(&["maintain", "cooldown"], 0, "simulated robot: heater and steppers are off"),
    changing(&["maintain", "preheat", "100"], "simulated robot: the nozzle heats to 100 C", "maintenance"),
    changing(&["stop"], OFF, "stopped"),
    changing(&["estop"], OFF, "emergency-stop"),
];

const STOPPED: [Row; 6] = [
    row(&["clear"], 0, "there is nothing to clear: the simulated robot is in the state stopped"),
    row(&["maintain", "jog", "5"], 1, "this is not allowed in state stopped"),
    row(&["stop"], 0, OFF),
    changing(&["grow", "--to", "0,0,60,0,90"], "78 layers of 78", "done"),
    changing(&["cancel"], "discarded by the simulated board after", "idle"),
    changing(&["estop"], OFF, "emergency-stop"),
];

const DONE: [Row; 5] = [
    row(&["clear"], 0, "there is nothing to clear: the simulated robot is in the state done"),
    row(&["maintain", "home"], 1, "this is not allowed in state done"),
    changing(&["stop"], OFF, "stopped"),
    changing(&["cancel"], "discarded by the simulated board after 78 layers", "idle"),
    changing(&["maintain", "preheat", "100"], "simulated robot: the nozzle heats to 100 C", "maintenance"),
];

const EMERGENCY_STOP: [Row; 6] = [
    row(&["estop"], 0, OFF),
    row(&["maintain", "jog", "5"], 1, "this is not allowed in state emergency-stop"),
    row(&["maintain", "preheat", "100"], 1, "this is not allowed in state emergency-stop"),
    row(&["grow", "--to", "0,0,60,0,90"], 1, "emergency-stop"),
    row(&["stop"], 0, OFF),
    changing(&["clear"], "the emergency-stop is cleared: the simulated robot accepts jobs again", "idle"),
];

const MAINTENANCE: [Row; 5] = [
    row(&["clear"], 0, "there is nothing to clear: the simulated robot is in the state maintenance"),
    row(&["maintain", "preheat", "900"], 1, TOO_HOT),
    changing(&["maintain", "cooldown"], "simulated robot: heater and steppers are off", "idle"),
    changing(&["stop"], OFF, "stopped"),
    changing(&["estop"], OFF, "emergency-stop"),
];

const FAULT: [Row; 7] = [
    row(&["stop"], 0, OFF),
    // The fault stays, because its cause is not known to be gone.
    row(&["estop"], 0, OFF),
    row(&["cancel"], 0, "discarded by the simulated board after 0 layers"),
    row(&["maintain", "jog", "5"], 1, "this is not allowed in state fault"),
    row(&["maintain", "preheat", "100"], 1, "this is not allowed in state fault"),
    row(&["grow", "--to", "0,0,60,0,90"], 1, "this is not allowed in state fault"),
    changing(&["clear"], "the fault is cleared: the simulated robot accepts jobs again", "idle"),
];

const STATES: [(&str, &[Row]); 5] = [
    ("idle", &IDLE),
    ("stopped", &STOPPED),
    ("done", &DONE),
    ("emergency-stop", &EMERGENCY_STOP),
    ("maintenance", &MAINTENANCE),
];

/// Brings the robot into a state, from any other.
fn bring_into(lab: &Lab, state: &str, owner: PortOwner) {
    for command in ["clear", "cancel"] {
        assert_eq!(lab.run(&[command, "--port", "sim:lab"]).0, Some(0));
    }
    match state {
        "idle" => {}
        "maintenance" => assert_eq!(lab.run(&["maintain", "preheat", "100", "--port", "sim:lab"]).0, Some(0)),
        "emergency-stop" => assert_eq!(lab.run(&["estop", "--port", "sim:lab"]).0, Some(0)),
        "done" => assert_eq!(lab.run(&["grow", "--to", "0,0,60,0,90", "--port", "sim:lab"]).0, Some(0)),
        "fault" => assert_eq!(lab.run(&["grow", "--to", "0,0,60,0,90", "--port", "sim:lab"]).0, Some(1)),
        _ => {
            let mut grow = lab.command(&["grow", "--to", "0,0,300,0,90", "--port", "sim:lab"]);
            let mut growing = grow.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
            let mut notes = BufReader::new(growing.stderr.take().unwrap()).lines();
            assert!(notes.any(|note| note.unwrap().ends_with("growing")));
            match owner {
                // The port is in use, so the growth is stopped from its own terminal.
                PortOwner::Command => {
                    assert!(command("kill").args(["-INT", &growing.id().to_string()]).status().unwrap().success());
                }
                PortOwner::Service => assert_eq!(lab.run(&["stop", "--port", "sim:lab"]).0, Some(0)),
            }
            let rest: Vec<String> = notes.map(Result::unwrap).collect();
            assert_eq!(growing.wait().unwrap().code(), Some(1), "{rest:?}");
        }
    }
    assert_eq!(state_of(lab), state);
}

fn state_of(lab: &Lab) -> String {
    let (code, text) = lab.run(&["status", "--json", "--port", "sim:lab"]);
    assert_eq!(code, Some(0), "{text}");
    let status: Value = serde_json::from_str(&text).unwrap();
    // What only the board knows is in the status through either owner, unless the robot has a job.
    let supply = status["sensors"]["supply_v"].as_f64();
    assert!(supply.is_some_and(|volts| (11.5..12.5).contains(&volts)), "{text}");
    assert_eq!(status["image"]["check"], "not-sealed", "{text}");
    let state = status["state"].as_str().unwrap();
    assert!(state != "emergency-stop" || status["latest_fault"]["fault"] == "emergency-stop", "{text}");
    state.to_owned()
}

/// Returns a lab whose robot `sim:lab` is on, and whose service runs if it is the owner.
fn lab_of(owner: PortOwner) -> Lab {
    lab_with_robot(owner, "growbot-a2")
}

/// Like [`lab_of`], with another robot.
fn lab_with_robot(owner: PortOwner, robot: &str) -> Lab {
    // Fast enough to be quick, and slow enough that a growth is stopped before its end.
    let mut lab = Lab::configured(&format!(
        "robot = \"{robot}\"\nport = \"sim:lab\"\n[robots.lab]\nport = \"sim:lab\"\nrobot = \"{robot}\"\npace = 60.0\n"
    ));
    lab.wait_until_ready();
    if owner == PortOwner::Command {
        lab.kill();
        let _ = lab.run(&["power", "off", "--port", "sim:lab"]);
        let on = ["power", "on", "--port", "sim:lab", "--robot", robot, "--pace", "60"];
        assert_eq!(lab.run(&on).0, Some(0));
    }
    lab
}

#[test]
fn each_command_has_the_same_result_through_either_owner_of_the_port() {
    for owner in [PortOwner::Service, PortOwner::Command] {
        let lab = lab_of(owner);
        for (state, rows) in STATES {
            check_rows(&lab, state, rows, owner);
        }
    }
}

/// The nozzle of this robot heats too slowly, so each growth ends with a fault.
#[test]
fn each_command_has_the_same_result_while_a_fault_is_latched() {
    let directory = tempfile::tempdir().unwrap();
    let file = directory.path().join("slow.toml");
    let described = include_str!("../../robots/growbot-a2.toml");
    let slow: String = described
        .lines()
        .map(|line| match line.starts_with("heating_timeout_s = ") {
            true => "heating_timeout_s = 10.0\n".to_owned(),
            false => format!("{line}\n"),
        })
        .collect();
    assert_ne!(slow, described);
    fs::write(&file, slow).unwrap();
    for owner in [PortOwner::Service, PortOwner::Command] {
        check_rows(&lab_with_robot(owner, file.to_str().unwrap()), "fault", &FAULT, owner);
    }
}

/// Checks the result of each row in a state.
fn check_rows(lab: &Lab, state: &str, rows: &[Row], owner: PortOwner) {
    bring_into(lab, state, owner);
    for Row { args, code, message, after } in rows.iter().chain(&EVERYWHERE) {
        if state_of(lab) != state {
            bring_into(lab, state, owner);
        }
        let (ended, text) = lab.run(&[args, &["--port", "sim:lab"][..]].concat());
        let text = in_lines(&text).split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(text.contains(message), "{owner:?}, {state}, {args:?}: {text}");
        assert_eq!(ended, Some(*code), "{owner:?}, {state}, {args:?}: {text}");
        let found = state_of(lab);
        assert_eq!(found, after.unwrap_or(state), "{owner:?}, {state}, {args:?}: {text}");
    }
}

#[test]
fn a_status_does_not_wait_for_a_silent_board() {
    let lab = lab_of(PortOwner::Service);
    assert_eq!(state_of(&lab), "idle");
    let pid = lab.robot_process();
    let signal = |name: &str| assert!(command("kill").args([name, &pid]).status().unwrap().success());
    signal("-STOP");
    let (code, text) = lab.run(&["status", "--json", "--port", "sim:lab"]);
    signal("-CONT");
    assert_eq!(code, Some(0), "{text}");
    // The service has not requested them, or the board has not responded.
    let status: Value = serde_json::from_str(&text).unwrap();
    assert_eq!(status["sensors"], Value::Null, "{text}");
}

/// Ways in which a program ends that follows a growth.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Ending {
    /// Ctrl-C on its terminal.
    CtrlC,
    /// The closing of its terminal.
    TerminalClosed,
    /// SIGTERM, with a terminal.
    Terminated,
    /// SIGTERM, without a terminal.
    TerminatedInPipe,
    /// SIGKILL.
    Killed,
}

/// Each ending of a program, with the state to which it brings a robot whose port the program owns, and a robot of the
/// service. SAFETY.md has this table, too.
const ENDINGS: [(Ending, &str, &str); 5] = [
    (Ending::CtrlC, "stopped", "stopped"),
    (Ending::TerminalClosed, "stopped", "done"),
    (Ending::Terminated, "stopped", "stopped"),
    (Ending::TerminatedInPipe, "stopped", "done"),
    (Ending::Killed, "paused", "done"),
];

#[test]
fn the_end_of_a_program_has_the_documented_effect_on_the_robot() {
    for owner in [PortOwner::Service, PortOwner::Command] {
        let lab = lab_of(owner);
        for (ending, of_command, of_service) in ENDINGS {
            bring_into(&lab, "idle", owner);
            let grow = ["grow", "--to", "0,0,300,0,90", "--port", "sim:lab", "--on-host-silence", "pause"];
            let grow = if owner == PortOwner::Service { &grow[..5] } else { &grow[..] };
            let line = format!("exec {PROGRAM} {}", grow.join(" "));
            let mut child = match ending {
                Ending::TerminatedInPipe => lab.command(grow),
                _ => lab.program("script", &["--quiet", "--return", "--flush", "--command", &line, "/dev/null"]),
            };
            let mut child = child.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
            let shown: Box<dyn Read> = match ending {
                Ending::TerminatedInPipe => Box::new(child.stderr.take().unwrap()),
                _ => Box::new(child.stdout.take().unwrap()),
            };
            let mut shown = BufReader::new(shown);
            let mut part = Vec::new();
            while !String::from_utf8_lossy(&part).contains("growing") {
                assert_ne!(shown.read_until(b'g', &mut part).unwrap(), 0, "{}", String::from_utf8_lossy(&part));
            }
            let pid = child.id().to_string();
            let signal = |name: &str, pid: &str| {
                assert!(command("kill").args([name, pid]).status().unwrap().success(), "{ending:?}");
            };
            match ending {
                Ending::CtrlC => child.stdin.as_mut().unwrap().write_all(b"\x03").unwrap(),
                Ending::TerminalClosed => signal("-KILL", &pid),
                Ending::Terminated => signal("-TERM", &grandchild(&pid)),
                Ending::TerminatedInPipe => signal("-TERM", &pid),
                Ending::Killed => signal("-KILL", &grandchild(&pid)),
            }
            let _ = shown.read_to_end(&mut part);
            child.wait().unwrap();
            let expected = if owner == PortOwner::Command { of_command } else { of_service };
            wait_for(&format!("{owner:?}, {ending:?}: {expected}"), || {
                if owner == PortOwner::Service {
                    lab.attended_robot("lab");
                }
                let (code, text) = lab.run(&["status", "--json", "--port", "sim:lab"]);
                // The port is in use until the program has ended.
                let status = serde_json::from_str::<Value>(&text).ok().filter(|_| code == Some(0))?;
                let state = status["state"].as_str()?;
                // A service that does not run for a while on a busy machine continues such a pause by itself.
                let is_silent = status["pause_cause"] == "host-silent";
                let is_over = match owner {
                    PortOwner::Command => !["heating", "homing", "growing"].contains(&state),
                    PortOwner::Service => ["stopped", "done"].contains(&state),
                };
                // A board without its host pauses, and parks later.
                let state = if is_silent && state == "parked" { "paused" } else { state };
                assert!(!is_over || state == expected, "{owner:?}, {ending:?}: {text}");
                is_over.then_some(())
            });
        }
    }
}

/// Returns the process that a process has started.
fn grandchild(pid: &str) -> String {
    fs::read_to_string(format!("/proc/{pid}/task/{pid}/children")).unwrap().trim().to_owned()
}
