//! Progress of long work, on standard error: a bar with the time left on a terminal, a plain line now and then
//! otherwise.

use std::io::{self, IsTerminal};
use std::time::{Duration, Instant};

use growbot_client::printable::one_line;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};

use crate::messages::is_quiet;

/// Time between plain lines.
const BETWEEN_LINES: Duration = Duration::from_secs(10);

/// When the results of the work are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Results {
    /// While it runs: on the same terminal a bar would tear them.
    Streamed,
    /// Once it is over.
    AtEnd,
}

/// The progress of one piece of work.
pub struct Progress {
    bar: Option<ProgressBar>,
    total: Option<u64>,
    said: Instant,
}

impl Progress {
    /// Starts; `total` is what [`Progress::at`] counts up to, if that is known.
    #[must_use]
    pub fn start(total: Option<u64>, results: Results) -> Self {
        let torn = results == Results::Streamed && io::stdout().is_terminal();
        let bar = (io::stderr().is_terminal() && !torn && !is_quiet()).then(|| {
            let bar = ProgressBar::with_draw_target(total, ProgressDrawTarget::stderr());
            let template =
                if total.is_some() { "{bar:30} {percent:>3} %  {msg}  {eta} left" } else { "{spinner} {msg}" };
            bar.set_style(ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar
        });
        Self { bar, total, said: Instant::now() }
    }

    /// The work has come to `position` of the total; `message` says in words what is done.
    pub fn at(&mut self, position: u64, message: impl FnOnce() -> String) {
        if let Some(bar) = &self.bar {
            bar.set_position(position);
            bar.set_message(one_line(&message()).into_owned());
        } else if self.said.elapsed() >= BETWEEN_LINES {
            self.said = Instant::now();
            match self.total {
                Some(total) if total > 0 => {
                    crate::note!("{}, {} %", message(), (100 * u128::from(position)) / u128::from(total));
                }
                _ => crate::note!("{}", message()),
            }
        }
    }

    /// Something has happened: a line where there is no bar to show it.
    pub fn say(&self, message: &str) {
        if self.bar.is_none() {
            crate::note!("{message}");
        }
    }

    /// Something has happened that must be seen: a line, above the bar where there is one.
    pub fn warn(&self, message: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| crate::warning!("{message}")),
            None => crate::warning!("{message}"),
        }
    }

    /// The work is over: takes the bar away.
    pub fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
