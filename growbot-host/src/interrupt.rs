//! Handling of Ctrl-C, of SIGTERM and of the end of the terminal.

use std::io::{self, IsTerminal};
use std::process;
use std::sync::{Mutex, PoisonError};

use crate::display;

/// Exit code of a command that an interrupt has ended, as in shells.
const INTERRUPTED: i32 = 130;

type Action = Box<dyn FnMut() + Send>;

/// Reaction to an interrupt. `None` before the first call of [`on_interrupt`].
static ACTION: Mutex<Option<Action>> = Mutex::new(None);

/// Sets the reaction to an interrupt, in place of an earlier one.
///
/// # Errors
/// The signals cannot be handled.
pub fn on_interrupt(action: impl FnMut() + Send + 'static) -> Result<(), ctrlc::Error> {
    let earlier = ACTION.lock().unwrap_or_else(PoisonError::into_inner).replace(Box::new(action));
    if earlier.is_some() {
        return Ok(());
    }
    ctrlc::set_handler(|| {
        if let Some(action) = &mut *ACTION.lock().unwrap_or_else(PoisonError::into_inner) {
            action();
        }
    })
}

/// Lets an interrupt remove the display of progress and end the program, if standard error is a terminal. Unfinished
/// files have no name, so none is left.
pub fn exit_on_interrupt() {
    // Without a display there is nothing to remove, and signals that `nohup` ignores must stay ignored.
    if !io::stderr().is_terminal() {
        return;
    }
    // Without a handler the signal ends the program, too.
    let _ = on_interrupt(|| {
        display::clear();
        process::exit(INTERRUPTED);
    });
}
