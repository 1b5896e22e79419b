//! Messages about a command line that cannot be parsed, in the style of all messages.

use std::env;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Command, Error};
use growbot_client::maintenance;
use growbot_plan::pose_text::parse_goal;

/// Commands of the terminal and of the console, besides those of maintenance, after which a robot moves or heats.
const MOVING_COMMANDS: [&str; 8] = ["grow", "resume", "continue", "start", "tune", "maintain", "doctor", "serve"];

/// Words that users type for `estop`. The message about them states that nothing was stopped.
pub const EMERGENCY_WORDS: [&str; 3] = ["emergency", "emergency-stop", "e-stop"];

/// Words that users type for a command that has another name, and what to type instead. Where a robot may move or heat
/// after the command, its help is named.
const OTHER_WORDS: [(&[&str], &str); 24] = [
    (&["abort", "halt", "kill", "quit", "exit"], "`growbot stop` stops a robot"),
    (&EMERGENCY_WORDS, "`growbot estop` switches everything off"),
    (&["reset", "unlock"], "`growbot clear` clears a fault or an emergency stop"),
    (&["discard", "give-up", "delete"], "`growbot cancel` discards the body under way"),
    (&["run", "start", "print", "build", "go", "demo"], "see `growbot grow --help` for growing a body"),
    (
        &[
            "heat", "preheat", "cool", "cooldown", "home", "load", "unload", "purge", "jog", "rotate", "move",
            "extrude", "retract", "feed",
        ],
        "see `growbot maintain --help` for heating, filament and homing",
    ),
    (&["slice"], "`growbot layers` prints the layers of a plan"),
    (&["temp", "temperature", "info", "state", "ps", "jobs"], "`growbot status` shows a robot"),
    (&["follow", "watch"], "`growbot attach` follows a growth of the service"),
    (&["materials", "material"], "`growbot robots` lists robots, and explains one with its materials"),
    (&["on", "off"], "`growbot power` switches a simulated robot on or off"),
    (&["sim", "emulate", "try"], "`growbot simulate --help` shows how to simulate growths"),
    (&["list", "ls", "devices", "scan", "detect"], "`growbot ports` lists robots and serial devices"),
    (&["connect", "shell", "repl", "terminal", "monitor"], "`growbot console --help` shows how to type commands"),
    (&["tui"], "`growbot console --tui` shows a robot on the whole terminal"),
    (&["gui", "web", "ui", "server", "service", "dashboard", "page"], "see `growbot serve --help` for the web page"),
    (&["show", "open", "plot", "draw", "render", "picture"], "`growbot view` shows a plan or a grown body"),
    (&["config", "configuration", "setup", "env"], "`growbot settings` shows the default robot and port"),
    (&["init", "new", "create", "add"], "`growbot new-robot` describes a robot of your own"),
    (&["calibrate", "pid", "autotune"], "see `growbot tune --help` for the heater's gains"),
    (&["test", "check", "commission", "diagnose"], "see `growbot doctor --help` for checking a robot"),
    (&["update", "upgrade", "firmware", "upload", "install"], "see `growbot flash --help` for a board's firmware"),
    (&["docs", "manual", "examples", "tutorial", "guide", "quickstart"], "`growbot man` prints the manual"),
    (&["version"], "`growbot --version` prints the version"),
];

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
    if let Some(instead) = other_word(error) {
        return format!("{what}: {instead}");
    }
    if let Some(instead) = other_argument(error, root) {
        return format!("{what}: {instead}; see `{} --help`", command_named(root));
    }
    let hint = suggestion(error).map(|meant| format!(" (did you mean {meant}?)")).unwrap_or_default();
    format!("{what}{hint}; see `{} --help`", command_named(root))
}

/// Returns what to type in place of an unknown command, if it is a known word for a command.
fn other_word(error: &Error) -> Option<&'static str> {
    let Some(ContextValue::String(typed)) = error.get(ContextKind::InvalidSubcommand) else { return None };
    let typed = typed.to_lowercase();
    OTHER_WORDS.iter().find(|(words, _)| words.contains(&&*typed)).map(|(_, instead)| *instead)
}

/// Returns how to give an argument that has been given in another form: a pose without its option, or a plan with one.
fn other_argument(error: &Error, root: &Command) -> Option<String> {
    let (ErrorKind::UnknownArgument, Some(ContextValue::String(given))) =
        (error.kind(), error.get(ContextKind::InvalidArg))
    else {
        return None;
    };
    let mut command = named_command(root).unwrap_or(root).clone();
    command.build();
    let has = |name: &str| command.get_arguments().any(|argument| argument.get_id() == name);
    match given.as_str() {
        "--plan" | "--file" | "--input" => Some("give the file without an option".to_owned()),
        "--goal" | "--target" | "--pose" => Some("give the goal with --to".to_owned()),
        "--dry-run" => Some("`growbot simulate` heats and moves nothing".to_owned()),
        "--all" if ["stop", "estop"].iter().any(|name| command.get_name() == *name) => {
            Some("`growbot estop` stops every robot of the service and of growbot.toml".to_owned())
        }
        "--port" if command.has_subcommands() => {
            Some("give --port after a command, as in `growbot status --port PORT`".to_owned())
        }
        option if option.starts_with('-') => None,
        pose if parse_goal(pose).is_ok() => has("to").then(|| format!("give the goal with --to {pose}")),
        // A command with a positional argument may have been given one too many.
        port if command.get_positionals().next().is_none() => {
            has("port").then(|| format!("give a port or a robot with --port {port}"))
        }
        _ => None,
    }
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

/// Returns the command that the command line names. `None` if it names none.
fn named_command(root: &Command) -> Option<&Command> {
    env::args().skip(1).find_map(|word| root.find_subcommand(word))
}

/// Returns `growbot` with the subcommand that the command line names.
fn command_named(root: &Command) -> String {
    named_command(root).map_or_else(|| "growbot".to_owned(), |command| format!("growbot {}", command.get_name()))
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
        assert_eq!(suggested(&["tuii"]), None);
        assert_eq!(suggested(&["inti"]), None);
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
    fn other_words_name_an_existing_command_and_its_help_if_it_moves_or_heats() {
        let root = Cli::command();
        for (words, instead) in OTHER_WORDS {
            let call = instead.split('`').nth(1).unwrap();
            let name = call.split(' ').nth(1).unwrap();
            let command = name.trim_start_matches("--");
            assert!(name == "--version" || root.find_subcommand(command).is_some(), "{instead}");
            assert!(!may_move(command) || call.ends_with("--help"), "{instead}");
            for word in words {
                assert!(root.find_subcommand(word).is_none(), "{word} is a command");
                let error = Cli::try_parse_from(["growbot", word]).err().unwrap();
                let told = message(&error, &root);
                assert!(told.ends_with(instead), "{told}");
            }
        }
    }

    #[test]
    fn a_goal_or_a_plan_in_another_form_is_told_the_right_one() {
        let told = |args: &[&str]| {
            let error = Cli::try_parse_from([&["growbot"], args].concat()).err().unwrap();
            message(&error, &Cli::command())
        };
        assert!(told(&["plan", "--goal", "0,0,60"]).contains("give the goal with --to"));
        let plan = told(&["grow", "--plan", "p.json"]);
        assert!(plan.contains("give the file without an option") && !plan.contains("--planner"), "{plan}");
    }

    #[test]
    fn all_commands_that_move_or_heat_exist() {
        let root = Cli::command();
        for name in MOVING_COMMANDS.iter().filter(|name| **name != "start") {
            assert!(root.find_subcommand(name).is_some(), "{name}");
        }
    }
}
