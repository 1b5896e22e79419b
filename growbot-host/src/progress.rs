//! Progress of long work on standard error: on a terminal a bar with the remaining time, otherwise a line at intervals.

use std::io::{self, IsTerminal};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use growbot_plan::sanitize::one_line;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::messages::is_quiet;

/// Time without output after which a command shows on a terminal that it works.
const SILENCE: Duration = Duration::from_millis(300);
/// Interval between two pictures of the spinner.
const TICK: Duration = Duration::from_millis(100);
/// Minimum time between two lines about the progress, if no bar is shown.
const BETWEEN_LINES: Duration = Duration::from_secs(10);

/// Spinner of a command that has printed nothing yet.
static SPINNER: Mutex<Option<ProgressBar>> = Mutex::new(None);
/// Bar of the work that is under way.
static BAR: Mutex<Option<ProgressBar>> = Mutex::new(None);
/// True from the first output of the command on.
static HAS_PRINTED: AtomicBool = AtomicBool::new(false);

/// Shows a spinner on a terminal if the command prints nothing for a moment.
pub fn start_spinner() {
    if is_quiet() || !io::stderr().is_terminal() {
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
pub(crate) fn end_spinner() {
    // The lock comes first: a spinner that is being made is removed, and none is made later.
    let mut spinner = SPINNER.lock().unwrap_or_else(PoisonError::into_inner);
    HAS_PRINTED.store(true, Ordering::Relaxed);
    remove(&mut spinner);
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

/// Time at which the results of the work are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ResultTiming {
    /// Results are printed during the work. A bar on the same terminal would disturb them.
    Streamed,
    /// Results are printed at the end.
    AtEnd,
}

/// Progress of one piece of work.
pub struct Progress {
    bar: Option<ProgressBar>,
    total: Option<u64>,
    last_note: Instant,
}

impl Progress {
    /// Starts the display. `total` is the final position of [`Progress::update`]. `None` if it is not known.
    pub fn start(total: Option<u64>, results: ResultTiming) -> Self {
        end_spinner();
        let torn = results == ResultTiming::Streamed && io::stdout().is_terminal();
        let bar = (io::stderr().is_terminal() && !torn && !is_quiet()).then(|| {
            let bar = ProgressBar::with_draw_target(total, ProgressDrawTarget::stderr());
            let template =
                if total.is_some() { "{bar:30} {percent:>3} %  {msg}  {eta} left" } else { "{spinner} {msg}" };
            bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar
        });
        BAR.lock().unwrap_or_else(PoisonError::into_inner).clone_from(&bar);
        Self { bar, total, last_note: Instant::now() }
    }

    /// Updates the position. `message` describes it.
    pub fn update(&mut self, position: u64, message: impl FnOnce() -> String) {
        if let Some(bar) = &self.bar {
            bar.set_position(position);
            bar.set_message(one_line(&message()).into_owned());
        } else if self.last_note.elapsed() >= BETWEEN_LINES {
            self.last_note = Instant::now();
            match self.total {
                Some(total) if total > 0 => {
                    crate::note!("{}, {} %", message(), (100 * u128::from(position)) / u128::from(total));
                }
                _ => crate::note!("{}", message()),
            }
        }
    }

    /// Prints a message about an event. With a bar it is omitted, because the bar shows the progress.
    pub fn note(&self, message: &str) {
        if self.bar.is_none() {
            crate::note!("{message}");
        }
    }

    /// Prints a warning, above the bar if there is one.
    pub fn warn(&self, message: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| crate::warning!("{message}")),
            None => crate::warning!("{message}"),
        }
    }

    /// Removes the bar at the end of the work.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
