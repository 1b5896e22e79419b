//! Messages on standard error in one style: `error:`, `warning:` or `note:`, then the text, in lines of 80 columns.
//!
//! Control characters are removed, so that text from outside cannot control the terminal
//! ([`growbot_plan::sanitize`]). Warnings that growbot's libraries log are printed in the same style.

use std::env;
use std::fmt;
use std::io::{self, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, AtomicU8, Ordering};

use clap::ColorChoice;
use growbot_plan::sanitize::one_line;
use growbot_plan::text_wrap::{TERMINAL_WIDTH, wrap};
use log::{LevelFilter, Log, Metadata, Record};

use crate::display;

/// Kind of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Severity {
    /// Reason why a command failed.
    Error,
    /// Possible problem, or information that the user must see.
    Warning,
    /// Result or progress. Not printed with `--quiet`.
    Note,
    /// Further information. Printed with `--verbose` only.
    Detail,
}

/// Level of messages that are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verbosity {
    /// Errors and warnings only.
    Quiet,
    /// Errors, warnings and notes.
    Normal,
    /// All messages.
    Verbose,
}

static LEVEL: AtomicU8 = AtomicU8::new(Verbosity::Normal as u8);
static COLOURED: AtomicBool = AtomicBool::new(false);

/// Sets the level of messages and their use of colours. `Auto` colours messages on terminals, unless `NO_COLOR` is set.
/// From then on, warnings that growbot's libraries log are printed.
pub fn set(level: Verbosity, colour: ColorChoice) {
    if log::set_logger(&LoggedWarnings).is_ok() {
        log::set_max_level(LevelFilter::Warn);
    }
    LEVEL.store(level as u8, Ordering::Relaxed);
    COLOURED.store(is_coloured(colour), Ordering::Relaxed);
}

/// Returns true if notes and progress are suppressed.
pub fn is_quiet() -> bool {
    LEVEL.load(Ordering::Relaxed) == Verbosity::Quiet as u8
}

fn is_coloured(colour: ColorChoice) -> bool {
    let is_set = |name| env::var_os(name).is_some_and(|value| !value.is_empty());
    match colour {
        ColorChoice::Always => true,
        ColorChoice::Never => false,
        ColorChoice::Auto => {
            io::stderr().is_terminal() && !is_set("NO_COLOR") && env::var_os("TERM").is_none_or(|name| name != "dumb")
        }
    }
}

/// Prints the reason why a command failed.
#[macro_export]
macro_rules! error {
    ($($words:tt)*) => { $crate::messages::print($crate::messages::Severity::Error, format_args!($($words)*)) };
}

/// Prints a warning.
#[macro_export]
macro_rules! warning {
    ($($words:tt)*) => { $crate::messages::print($crate::messages::Severity::Warning, format_args!($($words)*)) };
}

/// Prints a note about a result or progress.
#[macro_export]
macro_rules! note {
    ($($words:tt)*) => { $crate::messages::print($crate::messages::Severity::Note, format_args!($($words)*)) };
}

/// Prints further information if `--verbose` is set.
#[macro_export]
macro_rules! detail {
    ($($words:tt)*) => { $crate::messages::print($crate::messages::Severity::Detail, format_args!($($words)*)) };
}

impl Severity {
    fn label(self) -> &'static str {
        match self {
            Self::Error => "error:",
            Self::Warning => "warning:",
            Self::Note | Self::Detail => "note:",
        }
    }

    /// Returns the terminal's control sequence for bold red, yellow or green.
    fn colour(self) -> &'static str {
        match self {
            Self::Error => "\u{1b}[1;31m",
            Self::Warning => "\u{1b}[1;33m",
            Self::Note | Self::Detail => "\u{1b}[1;32m",
        }
    }

    fn is_shown(self) -> bool {
        match self {
            Self::Error | Self::Warning => true,
            Self::Note => !is_quiet(),
            Self::Detail => LEVEL.load(Ordering::Relaxed) == Verbosity::Verbose as u8,
        }
    }
}

/// Prints a message to standard error. Write errors are ignored, because a closed standard error is not a reason to
/// stop controlling a robot.
pub fn print(kind: Severity, message: fmt::Arguments) {
    if kind.is_shown() {
        display::end_spinner();
        let text = render(kind, &one_line(&message.to_string()), COLOURED.load(Ordering::Relaxed));
        let _ = io::stderr().write_all(text.as_bytes());
    }
}

/// Prints a question, or a line that belongs to one, without a label.
pub fn print_prompt(question: fmt::Arguments) {
    display::end_spinner();
    let _ = writeln!(io::stderr(), "{}", one_line(&question.to_string()));
}

/// Prints what growbot's libraries log. Other libraries log warnings too, which mean nothing to users.
struct LoggedWarnings;

impl Log for LoggedWarnings {
    fn enabled(&self, metadata: &Metadata) -> bool {
        metadata.target().starts_with("growbot_")
    }

    fn log(&self, record: &Record) {
        if self.enabled(record.metadata()) {
            print(Severity::Warning, *record.args());
        }
    }

    fn flush(&self) {}
}

/// Formats a message with its label and line breaks.
fn render(kind: Severity, message: &str, is_coloured: bool) -> String {
    let label = kind.label();
    let head = if is_coloured { format!("{}{label}\u{1b}[0m ", kind.colour()) } else { format!("{label} ") };
    wrap(message, TERMINAL_WIDTH, &head, "    ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_has_a_label_and_lines_of_80_columns() {
        assert_eq!(render(Severity::Note, "plan written to plan.json", false), "note: plan written to plan.json\n");
        let long = "word ".repeat(60);
        for kind in [Severity::Error, Severity::Warning, Severity::Note] {
            let text = render(kind, &long, false);
            assert!(text.lines().all(|line| line.chars().count() <= TERMINAL_WIDTH), "{text}");
            assert!(text.lines().skip(1).all(|line| line.starts_with("    word")), "{text}");
            assert_eq!(text.matches("word").count(), 60);
            // Each line is filled as far as possible.
            assert!(text.lines().next().unwrap().chars().count() > TERMINAL_WIDTH - 5, "{text}");
        }
        let path = format!("/{}", "x".repeat(100));
        assert_eq!(render(Severity::Error, &format!("cannot read {path}: no"), false).lines().count(), 3);
    }

    #[test]
    fn a_command_to_copy_is_not_wrapped() {
        let message = format!("{} `growbot stop --port /dev/ttyACM0` x", "word ".repeat(12));
        let text = render(Severity::Error, &message, false);
        assert!(text.lines().any(|line| line.contains("`growbot stop --port /dev/ttyACM0` x")), "{text}");
    }

    #[test]
    fn only_the_label_is_coloured() {
        assert_eq!(render(Severity::Error, "no", true), "\u{1b}[1;31merror:\u{1b}[0m no\n");
        assert!(!is_coloured(ColorChoice::Never) && is_coloured(ColorChoice::Always));
    }
}
