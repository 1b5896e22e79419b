//! Messages about a command line that cannot be parsed, in the style of all messages.

use std::env;

use clap::error::{ContextKind, ContextValue};
use clap::{CommandFactory, Error};

use super::Cli;

/// Returns the error of the command line in one sentence: the mistake, a suggestion, and the command that shows the
/// help.
pub fn message(error: &Error) -> String {
    let rendered = error.render().to_string();
    let paragraphs: Vec<String> = rendered
        .trim_start_matches("error: ")
        .split("\n\n")
        .map(|paragraph| paragraph.split_whitespace().collect::<Vec<_>>().join(" "))
        .collect();
    let what = paragraphs.first().map(|what| what.trim_end_matches('.').to_owned()).unwrap_or_default();
    let what = what
        .replace("invalid digit found in string", "give a whole number")
        .replace("invalid float literal", "give a number");
    let hint = suggestion(error).map(|meant| format!(" (did you mean {meant}?)")).unwrap_or_default();
    format!("{what}{hint}; see `{} --help`", command_named())
}

/// Returns the suggested word, if any.
fn suggestion(error: &Error) -> Option<String> {
    let kinds = [ContextKind::SuggestedSubcommand, ContextKind::SuggestedArg, ContextKind::SuggestedValue];
    kinds.into_iter().find_map(|kind| match error.get(kind)? {
        ContextValue::String(meant) => Some(meant.clone()),
        ContextValue::Strings(meant) => meant.first().cloned(),
        _ => None,
    })
}

/// Returns the command that the command line names.
fn command_named() -> String {
    let root = Cli::command();
    let named = env::args().skip(1).find(|word| root.find_subcommand(word).is_some());
    named.map_or_else(|| "growbot".to_owned(), |name| format!("growbot {name}"))
}
