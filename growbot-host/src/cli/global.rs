//! Options of all commands: level and colours of messages.

use std::env;

use clap::{Args, ColorChoice, CommandFactory, FromArgMatches, ValueEnum};
use growbot_host::messages::{self, Verbosity};

use super::Cli;

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

/// Parses the command line, and sets level and colours of messages. The colours also apply if the rest of the command
/// line cannot be parsed.
pub fn parse() -> Result<Cli, clap::Error> {
    let when = asked_for();
    messages::set(Verbosity::Normal, when);
    let matches = Cli::command().color(when).try_get_matches()?;
    let cli = Cli::from_arg_matches(&matches)?;
    let GlobalArgs { color, quiet, verbose } = &cli.global;
    let level = match (quiet, verbose) {
        (true, _) => Verbosity::Quiet,
        (_, true) => Verbosity::Verbose,
        _ => Verbosity::Normal,
    };
    messages::set(level, *color);
    Ok(cli)
}

/// Returns the value of `--color` before the command line is parsed. `Auto` if the value is missing or unknown.
fn asked_for() -> ColorChoice {
    let words: Vec<String> = env::args_os().map(|word| word.to_string_lossy().into_owned()).collect();
    let color = words.iter().enumerate().find_map(|(index, word)| match word.strip_prefix("--color") {
        Some("") => words.get(index + 1).map(String::as_str),
        Some(value) => value.strip_prefix('='),
        None => None,
    });
    color.and_then(|color| ColorChoice::from_str(color, false).ok()).unwrap_or(ColorChoice::Auto)
}
