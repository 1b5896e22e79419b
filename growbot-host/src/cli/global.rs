//! Options of all commands: level and colours of messages.

use std::env;

use clap::{Args, ColorChoice, ValueEnum};
use growbot_host::messages::{self, Verbosity};

/// Level and colours of messages.
#[derive(Args)]
#[command(next_help_heading = "All commands")]
pub struct GlobalArgs {
    /// Colour messages and help: auto does so on terminals, unless NO_COLOR is set
    #[arg(long, global = true, value_name = "WHEN", value_enum, default_value_t = ColorChoice::Auto)]
    color: ColorChoice,
    /// Show only errors and warnings, without notes and progress
    #[arg(short, long, global = true, conflicts_with = "verbose")]
    quiet: bool,
    /// Also show where robot and port come from
    #[arg(short, long, global = true)]
    verbose: bool,
}

impl GlobalArgs {
    /// Sets level and colours of messages.
    pub fn apply(&self) {
        let level = match (self.quiet, self.verbose) {
            (true, _) => Verbosity::Quiet,
            (_, true) => Verbosity::Verbose,
            _ => Verbosity::Normal,
        };
        messages::set(level, self.color);
    }
}

/// Sets the colours of messages before the command line is parsed, and returns the value of `--color`. `Auto` if the
/// value is missing or unknown.
pub fn color_before_parsing() -> ColorChoice {
    let words: Vec<String> = env::args_os().map(|word| word.to_string_lossy().into_owned()).collect();
    let color = words.iter().enumerate().find_map(|(index, word)| match word.strip_prefix("--color") {
        Some("") => words.get(index + 1).map(String::as_str),
        Some(value) => value.strip_prefix('='),
        None => None,
    });
    let color = color.and_then(|color| ColorChoice::from_str(color, false).ok()).unwrap_or(ColorChoice::Auto);
    messages::set(Verbosity::Normal, color);
    color
}
