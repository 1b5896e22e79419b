//! Messages about a command line that cannot be parsed, in the style of all messages.

use std::env;

use clap::error::{ContextKind, ContextValue};
use clap::{Command, Error};
use growbot_client::maintenance;

/// Commands of the terminal and of the console, besides those of maintenance, after which a robot moves or heats.
const MOVING_COMMANDS: [&str; 8] = ["grow", "resume", "continue", "start", "tune", "maintain", "doctor", "serve"];

/// Returns true if a robot may move or heat after this command. No message suggests such a command, because users
/// repeat a suggestion without reading it.
pub fn may_move(command: &str) -> bool {
    let mut maintaining = maintenance::COMMANDS.iter().map(|(name, ..)| *name).filter(|name| *name != "cooldown");
    MOVING_COMMANDS.contains(&command) || maintaining.any(|name| name == command)
}

/// Returns the error of the command line in one sentence: the mistake, a suggestion, and the command that shows the
/// help. `root` is the definition of the command line.
pub fn message(error: &Error, root: &Command) -> String {
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
    format!("{what}{hint}; see `{} --help`", command_named(root))
}

/// Returns the word that clap suggests for a mistyped one. `None` without a suggestion, or if the robot may move or
/// heat after the suggested command.
fn suggestion(error: &Error) -> Option<String> {
    let kinds = [ContextKind::SuggestedSubcommand, ContextKind::SuggestedArg, ContextKind::SuggestedValue];
    kinds.into_iter().find_map(|kind| match error.get(kind)? {
        ContextValue::String(meant) => Some(meant).filter(|meant| !may_move(meant)).cloned(),
        // The best one is the last.
        ContextValue::Strings(meant) => meant.iter().rfind(|meant| !may_move(meant)).cloned(),
        _ => None,
    })
}

/// Returns `growbot` with the subcommand that the command line names.
fn command_named(root: &Command) -> String {
    let named = env::args().skip(1).find(|word| root.find_subcommand(word).is_some());
    named.map_or_else(|| "growbot".to_owned(), |name| format!("growbot {name}"))
}

#[cfg(test)]
mod tests {
    use clap::{CommandFactory, Parser};

    use super::*;
    use crate::cli::Cli;

    /// Returns the suggestion for the arguments of a mistyped command line.
    fn suggested(args: &[&str]) -> Option<String> {
        let error = Cli::try_parse_from([&["growbot"], args].concat()).err()?;
        let message = message(&error, &Cli::command());
        let (_, rest) = message.split_once("(did you mean ")?;
        rest.split_once("?)").map(|(meant, _)| meant.to_owned())
    }

    #[test]
    fn no_mistyped_command_suggests_one_that_moves_or_heats() {
        assert_eq!(suggested(&["tui"]), None);
        assert_eq!(suggested(&["init"]), None);
        assert_eq!(suggested(&["plam"]).as_deref(), Some("plan"));
        assert_eq!(suggested(&["sattus"]).as_deref(), Some("status"));
        let root = Cli::command();
        let mut tried = 0;
        for name in root.get_subcommands().map(Command::get_name) {
            for at in 0..name.len() {
                let (before, after) = name.split_at(at);
                let rest = &after[1..];
                for typed in [format!("{before}{rest}"), format!("{before}x{rest}"), format!("{before}x{after}")] {
                    let meant = suggested(&[&typed]);
                    assert!(!meant.as_deref().is_some_and(may_move), "{typed}: {meant:?}");
                    tried += 1;
                }
            }
        }
        assert!(tried > 300, "{tried}");
        assert_eq!(suggested(&["maintain", "hom"]), None);
        assert_eq!(suggested(&["maintain", "coldown"]).as_deref(), Some("cooldown"));
    }

    #[test]
    fn all_commands_that_move_or_heat_exist() {
        let root = Cli::command();
        for name in MOVING_COMMANDS.iter().filter(|name| **name != "start") {
            assert!(root.find_subcommand(name).is_some(), "{name}");
        }
    }
}
