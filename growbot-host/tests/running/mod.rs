//! Runs the `growbot` command as a user would and returns its output. Tests start every program by [`command`].

use std::ffi::OsStr;
use std::io::Write;
use std::process::{Command, Stdio};
use std::time::Duration;

/// Time limit of each wait in a test. It is long, so that a busy machine does not exceed it.
pub const PATIENCE: Duration = Duration::from_secs(600);

/// Path of the `growbot` program.
pub const PROGRAM: &str = env!("CARGO_BIN_EXE_growbot");

/// Returns a command that starts the program without the growbot configuration of this machine, so that no test moves a
/// real robot.
pub fn command(program: impl AsRef<OsStr>) -> Command {
    let mut command = Command::new(program);
    remove_settings(&mut command);
    command.env("XDG_CONFIG_HOME", "/no/such/place");
    // The test must not use a service that runs on this machine either.
    command.env("XDG_RUNTIME_DIR", "/no/such/place").env("XDG_STATE_HOME", "/no/such/place");
    command
}

/// Removes all variables that begin with `GROWBOT_` from the environment of a program. Some of them are for the tests,
/// and growbot would refuse them.
fn remove_settings(command: &mut Command) {
    for (name, _) in std::env::vars_os() {
        if name.to_string_lossy().starts_with("GROWBOT_") {
            command.env_remove(name);
        }
    }
}

/// Result of a run of growbot.
pub struct Ran {
    /// Exit code.
    pub code: Option<i32>,
    /// Standard output.
    pub out: String,
    /// Standard error, with each message in one line.
    pub err: String,
}

/// Runs `growbot` with these arguments and this text on its standard input.
pub fn growbot_reading(args: &[&str], input: &str) -> Ran {
    growbot_reading_bytes(args, input.as_bytes())
}

/// Runs `growbot` with these arguments and these bytes on its standard input.
pub fn growbot_reading_bytes(args: &[&str], input: &[u8]) -> Ran {
    let mut child = command(PROGRAM)
        .args(args)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut stdin = child.stdin.take().unwrap();
    let input = input.to_owned();
    // A separate thread writes, because neither side may block the other. A command that refuses may not read at all.
    let writer = std::thread::spawn(move || drop(stdin.write_all(&input)));
    let output = child.wait_with_output().unwrap();
    writer.join().unwrap();
    Ran {
        code: output.status.code(),
        out: String::from_utf8(output.stdout).unwrap(),
        err: in_lines(&String::from_utf8(output.stderr).unwrap()),
    }
}

/// Joins the lines of each message into one line.
pub fn in_lines(messages: &str) -> String {
    messages.replace("\n    ", " ")
}

/// Runs `growbot` with these arguments and an empty standard input.
pub fn growbot(args: &[&str]) -> Ran {
    growbot_reading(args, "")
}

/// Runs `growbot` with these arguments and this standard input. Its standard output is a pipe that no program reads.
#[cfg(unix)]
#[allow(dead_code)]
pub fn growbot_unread(args: &[&str], input: &str) -> Ran {
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let mut child = Command::new(env!("CARGO_BIN_EXE_growbot"));
    remove_settings(&mut child);
    let mut child = child.args(args).stdin(Stdio::piped()).stdout(writer).stderr(Stdio::piped()).spawn().unwrap();
    // The input fits in the pipe, and a command that has ended need not read it.
    let _ = child.stdin.take().unwrap().write_all(input.as_bytes());
    let output = child.wait_with_output().unwrap();
    Ran { code: output.status.code(), out: String::new(), err: in_lines(&String::from_utf8(output.stderr).unwrap()) }
}
