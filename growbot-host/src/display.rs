//! The last line of the terminal, which shows the spinner or the bar of a command that works.

use std::io::{self, IsTerminal};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

use indicatif::ProgressBar;

/// Time without output after which a command shows on a terminal that it works.
const SILENCE: Duration = Duration::from_millis(300);
/// Interval between two pictures of the spinner.
const TICK: Duration = Duration::from_millis(100);

/// Spinner of a command that has printed nothing yet.
static SPINNER: Mutex<Option<ProgressBar>> = Mutex::new(None);
/// Bar of the work that is under way.
static BAR: Mutex<Option<ProgressBar>> = Mutex::new(None);
/// True from the first output of the command on.
static HAS_PRINTED: AtomicBool = AtomicBool::new(false);

/// Shows a spinner on a terminal if the command prints nothing for a moment.
pub fn start_spinner() {
    if !io::stderr().is_terminal() {
        return;
    }
    thread::spawn(|| {
        thread::sleep(SILENCE);
        let mut spinner = SPINNER.lock().unwrap_or_else(PoisonError::into_inner);
        if !HAS_PRINTED.load(Ordering::Relaxed) {
            let bar = spinner.insert(ProgressBar::new_spinner().with_message("working"));
            bar.enable_steady_tick(TICK);
        }
    });
}

/// Removes the spinner, before the first output.
pub fn end_spinner() {
    // The lock comes first: a spinner that is being made is removed, and none is made later.
    let mut spinner = SPINNER.lock().unwrap_or_else(PoisonError::into_inner);
    HAS_PRINTED.store(true, Ordering::Relaxed);
    remove(&mut spinner);
}

/// Puts a bar in the place of the spinner. The caller updates the bar.
pub fn show(bar: Option<ProgressBar>) {
    end_spinner();
    *BAR.lock().unwrap_or_else(PoisonError::into_inner) = bar;
}

/// Removes the spinner and the bar from the terminal.
pub fn clear() {
    end_spinner();
    remove(&mut BAR.lock().unwrap_or_else(PoisonError::into_inner));
}

fn remove(shown: &mut Option<ProgressBar>) {
    if let Some(bar) = shown.take() {
        bar.finish_and_clear();
    }
}
