//! Progress of long work on standard error: on a terminal a bar with the remaining time, otherwise a line at intervals.

use std::io::{self, IsTerminal};
use std::time::{Duration, Instant};

use growbot_plan::sanitize::one_line;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::display;
use crate::messages::is_quiet;

/// Minimum time between two lines about the progress, if no bar is shown.
const BETWEEN_LINES: Duration = Duration::from_secs(10);

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
        let torn = results == ResultTiming::Streamed && io::stdout().is_terminal();
        let bar = (io::stderr().is_terminal() && !torn && !is_quiet()).then(|| {
            let bar = ProgressBar::with_draw_target(total, ProgressDrawTarget::stderr());
            let template =
                if total.is_some() { "{bar:30} {percent:>3} %  {msg}  {eta} left" } else { "{spinner} {msg}" };
            bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar
        });
        display::show(bar.clone());
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
