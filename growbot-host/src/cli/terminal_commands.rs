//! Commands that the user types into the terminal of a growth while its robot waits.

use std::io::{self, IsTerminal};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use growbot_client::growth::CommandQueue;
use growbot_core::link::message::State;
use growbot_plan::job::Command;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::process::getpgrp;
use rustix::termios::tcgetpgrp;

/// Interval of the checks for a typed line.
const LOOK: Duration = Duration::from_millis(200);

/// The keyboard of the terminal, if this program has one. It is read only while the robot waits, so that other input
/// stays for the shell.
#[derive(Debug, Default)]
pub struct TerminalCommands {
    waits: Option<Arc<AtomicBool>>,
}

impl TerminalCommands {
    /// Starts to read commands from the terminal, if this program has one.
    pub fn of_terminal(orders: &Arc<CommandQueue>) -> Self {
        if !(io::stdin().is_terminal() && io::stderr().is_terminal()) {
            return Self::default();
        }
        let waits = Arc::new(AtomicBool::new(false));
        let (orders, waiting) = (Arc::clone(orders), Arc::clone(&waits));
        // The thread ends with the program.
        let reader = thread::Builder::new().name("keyboard".to_owned()).spawn(move || read(&orders, &waiting));
        Self { waits: reader.is_ok().then_some(waits) }
    }

    /// Returns true if the user can type commands.
    pub fn is_there(&self) -> bool {
        self.waits.is_some()
    }

    /// Updates the state of the robot. Commands are read only while the robot is paused or parked.
    pub fn set_state(&self, state: State) {
        if let Some(waits) = &self.waits {
            waits.store(matches!(state, State::Paused | State::Parked), Ordering::Relaxed);
        }
    }
}

/// Reads lines while the robot waits.
fn read(orders: &CommandQueue, waits: &AtomicBool) {
    loop {
        if !waits.load(Ordering::Relaxed) || !has_input() {
            thread::sleep(LOOK);
            continue;
        }
        let mut line = String::new();
        match io::stdin().read_line(&mut line) {
            Ok(0) | Err(_) => return,
            Ok(_) => match parse_command(&line) {
                Ok(Some(order)) => orders.push(order),
                Ok(None) => {}
                Err(why) => growbot_host::error!("{why}"),
            },
        }
    }
}

/// Returns true if typed input waits and this program is in the foreground. If a program in the background read from
/// the terminal, the shell would halt it.
fn has_input() -> bool {
    let stdin = io::stdin();
    if tcgetpgrp(&stdin).ok() != Some(getpgrp()) {
        return false;
    }
    let mut polled = [PollFd::new(&stdin, PollFlags::IN)];
    poll(&mut polled, Some(&Timespec::default())).is_ok_and(|ready| ready > 0)
}

/// Parses a line. `None` if it is empty.
fn parse_command(line: &str) -> Result<Option<Command>, String> {
    match line.trim() {
        "" => Ok(None),
        "c" | "continue" => Ok(Some(Command::Continue)),
        "stop" => Ok(Some(Command::Stop)),
        "preheat" => Ok(Some(Command::Preheat)),
        "unload" => Ok(Some(Command::Unload)),
        "load" => Ok(Some(Command::Load)),
        "purge" => Ok(Some(Command::Purge)),
        other => Err(format!(
            "unknown command {other:?}: type `continue` or `stop`; or, to change filament, `preheat`, `unload`, \
             `load`, `purge`"
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn typed_commands_are_parsed_and_others_refused() {
        assert_eq!(parse_command("continue\n"), Ok(Some(Command::Continue)));
        assert_eq!(parse_command(" c \n"), Ok(Some(Command::Continue)));
        assert_eq!(parse_command("stop\n"), Ok(Some(Command::Stop)));
        assert_eq!(parse_command("\n"), Ok(None));
        assert!(parse_command("go\n").unwrap_err().contains("`continue`"));
    }
}
