//! Handling of Ctrl-C, of SIGTERM and of the end of the terminal.

use std::io::{self, IsTerminal};
use std::sync::{Mutex, PoisonError};

use signal_hook::consts::SIGINT;
use signal_hook::low_level::emulate_default_handler;

use crate::display;

type Action = Box<dyn FnMut() + Send>;

/// Reaction to an interrupt. `None` while no signal is handled.
static ACTION: Mutex<Option<Action>> = Mutex::new(None);

/// Sets the reaction to an interrupt, in place of an earlier one.
///
/// # Errors
/// The signals cannot be handled.
pub fn on_interrupt(action: impl FnMut() + Send + 'static) -> Result<(), ctrlc::Error> {
    set_action(Box::new(action), ctrlc::set_handler)
}

/// Lets an interrupt remove the display of progress before it ends the program, if standard error is a terminal.
/// Unfinished files have no name, so none is left.
pub fn exit_on_interrupt() {
    if !io::stderr().is_terminal() {
        return;
    }
    let action = || {
        display::clear();
        // The shell learns that a signal has ended the program, so that a script or a loop ends, too.
        let _ = emulate_default_handler(SIGINT);
    };
    // Signals that the parent ignores, as `nohup` does, stay ignored. Without a handler the signal ends the program.
    let _ = set_action(Box::new(action), ctrlc::try_set_handler);
}

/// Sets the reaction, and installs the handler if there was none.
fn set_action(action: Action, install: fn(fn()) -> Result<(), ctrlc::Error>) -> Result<(), ctrlc::Error> {
    let lock = || ACTION.lock().unwrap_or_else(PoisonError::into_inner);
    if lock().replace(action).is_some() {
        return Ok(());
    }
    install(react).inspect_err(|_| *lock() = None)
}

fn react() {
    if let Some(action) = &mut *ACTION.lock().unwrap_or_else(PoisonError::into_inner) {
        action();
    }
}
