//! Hostile inputs for growbot: changed files, and boards that send nonsense. A seed determines all of them.

pub mod boards;
pub mod mutation;

use std::fs;
use std::io::{Read, Write};
use std::path::Path;
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use growbot_plan::sanitize::is_control;

use crate::running::{PROGRAM, command};

/// Returns the number in an environment variable, or `unless_set`.
pub fn number(variable: &str, unless_set: u64) -> u64 {
    std::env::var(variable).ok().map_or(unless_set, |text| text.parse().expect("the variable is a whole number"))
}

/// Result of a run of growbot.
pub struct Ran {
    /// Exit code. `None` if the command was killed or crashed.
    pub code: Option<i32>,
    /// True if the command was still running after its time limit.
    pub hung: bool,
    /// Standard output.
    pub out: Vec<u8>,
    /// Standard error.
    pub err: Vec<u8>,
}

/// Runs growbot in a directory with these arguments, this standard input and this time limit.
pub fn run(directory: &Path, args: &[String], input: &[u8], limit: Duration) -> Ran {
    let mut child = command(PROGRAM)
        .args(args)
        .current_dir(directory)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let (mut stdin, mut stdout, mut stderr) =
        (child.stdin.take().unwrap(), child.stdout.take().unwrap(), child.stderr.take().unwrap());
    let input = input.to_vec();
    let writer = thread::spawn(move || drop(stdin.write_all(&input)));
    let read = |from: &mut dyn Read| {
        let mut bytes = Vec::new();
        let _ = from.read_to_end(&mut bytes);
        bytes
    };
    let out = thread::spawn(move || read(&mut stdout));
    let err = thread::spawn(move || read(&mut stderr));
    let began = Instant::now();
    let (code, hung) = loop {
        match child.try_wait().unwrap() {
            Some(status) => break (status.code(), false),
            None if began.elapsed() > limit => {
                let _ = child.kill();
                let _ = child.wait();
                break (None, true);
            }
            None => thread::sleep(Duration::from_millis(2)),
        }
    };
    writer.join().unwrap();
    Ran { code, hung, out: out.join().unwrap(), err: err.join().unwrap() }
}

/// Returns the faults of a run that may have written `output`: a crash, a hang, an undocumented exit code, characters
/// that control a terminal, or a partial file.
pub fn faults(ran: &Ran, directory: &Path, output: Option<&str>) -> Vec<String> {
    let mut faults = Vec::new();
    if ran.hung {
        faults.push("it hangs".to_owned());
    } else if !matches!(ran.code, Some(0..=2)) {
        faults.push(format!("exit code {:?}", ran.code));
    }
    for (name, bytes) in [("standard output", &ran.out), ("standard error", &ran.err)] {
        match std::str::from_utf8(bytes) {
            Err(error) => faults.push(format!("{name} is no text at byte {}", error.valid_up_to())),
            Ok(text) => {
                if let Some(letter) = text.chars().find(|letter| *letter != '\n' && is_control(*letter)) {
                    faults.push(format!("{name} holds {letter:?}"));
                }
                if text.contains("panicked at") {
                    faults.push(format!("a panic: {text}"));
                }
            }
        }
    }
    for entry in fs::read_dir(directory).unwrap() {
        let name = entry.unwrap().file_name().to_string_lossy().into_owned();
        if name.ends_with(".partial") {
            faults.push(format!("{name} was left behind"));
        }
    }
    if let Some(output) = output {
        let written = fs::metadata(directory.join(output)).ok().map(|file| file.len());
        match (ran.code, written) {
            (Some(0), None) => faults.push(format!("{output} was not written, and no message reports it")),
            (Some(0 | 1), Some(0)) => faults.push(format!("{output} is empty")),
            (Some(2), Some(_)) => faults.push(format!("{output} was written in spite of exit code 2")),
            _ => {}
        }
    }
    faults
}
