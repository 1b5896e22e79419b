//! Reading of standard input by the console, the warning about a robot that still works when the console ends, and
//! the count of the commands in a script that are not run.

use std::io::{self, BufRead, BufReader};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::thread;
use std::time::{Duration, Instant};

use growbot_core::link::message::State;
use growbot_core::robot::Robot;
use growbot_plan::input::BoundedLines;

use super::commands::{BoardRequest, ConsoleCommand, parse};
use crate::cli::port_arg::SelectedPort;

/// Lines of standard input, as they arrive.
pub type StdinLines = Receiver<io::Result<Vec<u8>>>;

/// Maximum time for reading the rest of a script to count the commands that are not run.
const READING: Duration = Duration::from_millis(500);

/// Starts a thread that reads lines of standard input. A read may block for long, but Ctrl-C must not wait for it. The
/// thread ends with the input or with the program.
pub fn lines_of_stdin() -> StdinLines {
    let (read, lines) = mpsc::sync_channel(0);
    thread::spawn(move || {
        for line in BufReader::new(BoundedLines::of(io::stdin().lock())).split(b'\n') {
            let failed = line.is_err();
            if read.send(line).is_err() || failed {
                break;
            }
        }
    });
    lines
}

/// Returns true if a robot in this state heats or moves, or stays hot.
pub fn is_active(state: State) -> bool {
    matches!(
        state,
        State::Heating | State::Homing | State::Growing | State::Paused | State::Tuning | State::Maintenance
    )
}

/// Returns the warning about a robot that is still hot or moving when the console ends: the further behaviour of the
/// robot, and how to stop it.
pub fn still_active_text(state: State, robot: &Robot, port: &SelectedPort) -> String {
    let name = if state == State::Maintenance { "in maintenance" } else { state.name() };
    if port.is_in_process() {
        return format!("the simulated robot is {name} and ends with this program");
    }
    let future = if state == State::Tuning {
        "the robot continues to heat until tuning is done".to_owned()
    } else if state == State::Maintenance {
        "the heater is switched off 10 minutes after the latest command".to_owned()
    } else {
        let off_after = robot.description().pause.off_after_s;
        format!(
            "without a host the robot pauses after the current layer and switches its heater off after {off_after} s \
             more, or continues if it was started with --on-host-silence continue"
        )
    };
    format!("the robot is {name}: {future}; to stop it: `growbot stop --port {}`", port.text())
}

/// A command of a script that would have stopped the robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct StopCommand {
    name: &'static str,
    line: usize,
}

/// Commands of a script that are not run.
#[derive(Debug, Default, PartialEq, Eq)]
pub struct SkippedCommands {
    commands: usize,
    /// First of these commands that stops the robot, if any.
    stop: Option<StopCommand>,
    /// True if the script may contain more commands, because its end was not reached within `READING`.
    continues: bool,
}

impl SkippedCommands {
    /// Counts the commands after this line, for at most `READING`.
    pub fn after(number: usize, lines: &StdinLines) -> Self {
        let began = Instant::now();
        let mut left_out = Self::default();
        for number in number + 1.. {
            let line = match lines.recv_timeout(READING.saturating_sub(began.elapsed())) {
                Ok(Ok(line)) => line,
                Ok(Err(_)) | Err(RecvTimeoutError::Disconnected) => return left_out,
                Err(RecvTimeoutError::Timeout) => break,
            };
            if !left_out.count(number, &String::from_utf8_lossy(&line)) {
                return left_out;
            }
            if began.elapsed() >= READING {
                break;
            }
        }
        left_out.continues = true;
        left_out
    }

    /// Counts the command of a line. Returns false if the line ends the script.
    fn count(&mut self, number: usize, line: &str) -> bool {
        let stop = match parse(line) {
            Ok(ConsoleCommand::Nothing) => return true,
            Ok(ConsoleCommand::Quit) => return false,
            Ok(ConsoleCommand::Board(BoardRequest::Stop)) => Some("stop"),
            Ok(ConsoleCommand::Board(BoardRequest::EmergencyStop)) => Some("estop"),
            _ => None,
        };
        self.commands += 1;
        self.stop = self.stop.or(stop.map(|name| StopCommand { name, line: number }));
        true
    }

    /// Returns true if the script contains no more commands.
    pub fn is_nothing(&self) -> bool {
        self.commands == 0 && !self.continues
    }

    /// Returns a text for an error message: the number of commands that are not run, and the first of them that would
    /// stop the robot.
    pub fn text(&self) -> String {
        let (count, some) = (self.commands, if self.continues { "at least " } else { "" });
        let commands = if count == 1 { "command is" } else { "commands are" };
        match self.stop {
            _ if self.is_nothing() => "there were no later commands".to_owned(),
            None if count == 0 => "later commands are not executed".to_owned(),
            None => format!("{some}{count} more {commands} not executed"),
            Some(StopCommand { name, line }) => {
                format!("{some}{count} more {commands} not executed, among them `{name}` in line {line}")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn left_out(lines: &[&str], ends: bool) -> SkippedCommands {
        let (read, taken) = mpsc::sync_channel(lines.len());
        lines.iter().for_each(|line| read.send(Ok(line.as_bytes().to_vec())).unwrap());
        if ends {
            drop(read);
            SkippedCommands::after(2, &taken)
        } else {
            let skipped = SkippedCommands::after(2, &taken);
            drop(read);
            skipped
        }
    }

    #[test]
    fn skipped_commands_are_counted_and_the_first_stop_is_named() {
        let text = |lines: &[&str]| left_out(lines, true).text();
        assert_eq!(text(&[]), "there were no later commands");
        assert_eq!(text(&["", "status", " "]), "1 more command is not executed");
        assert_eq!(
            text(&["wait 5", "", "stop", "estop", "quit", "start"]),
            "3 more commands are not executed, among them `stop` in line 5"
        );
        assert_eq!(text(&["dance", "estop now"]), "2 more commands are not executed, among them `estop` in line 4");
        assert!(left_out(&["", "quit", "start"], true).is_nothing());
    }

    #[test]
    fn skipped_commands_of_an_open_script_are_a_lower_bound() {
        let skipped = left_out(&["status"], false);
        assert_eq!(skipped.text(), "at least 1 more command is not executed");
        assert!(!left_out(&[], false).is_nothing());
    }
}
