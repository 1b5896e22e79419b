//! The help of the command line: commands in groups, and examples before options.

use clap::Command;
use growbot_plan::text_wrap::{TERMINAL_WIDTH, wrap};

/// Commands by what users want to do.
const GROUPS: [(&str, &[&str]); 6] = [
    ("Plan a body", &["plan", "scene", "workspace", "rmin", "simulate"]),
    ("Grow it", &["grow", "resume", "pause", "continue", "attach", "serve", "console", "maintain"]),
    ("Stop it", &["stop", "estop", "cancel", "clear", "recover"]),
    ("Look at it", &["status", "view", "layers", "replay", "export"]),
    ("Set up a robot", &["ports", "robots", "new-robot", "doctor", "tune", "configure", "flash", "power", "settings"]),
    ("Other", &["reproduce", "schema", "completions", "man", "help"]),
];
/// Description of the command that clap adds.
const HELP_ABOUT: &str = "Print the help of a command";
/// Columns of the names of commands.
const NAME_WIDTH: usize = 15;

/// Returns the command line with commands in groups, and with the examples of each command before its options.
pub fn with_groups(root: Command) -> Command {
    let header = *root.get_styles().get_header();
    let template = format!(
        "{{about-with-newline}}\n{{usage-heading}} {{usage}}\n\n{}\n{header}Options:{header:#}\n{{options}}{{after-help}}",
        groups(&root)
    );
    root.mut_subcommands(with_examples_first).help_template(template)
}

fn groups(root: &Command) -> String {
    let (header, literal) = (root.get_styles().get_header(), root.get_styles().get_literal());
    let about = |name: &str| {
        let about = root.find_subcommand(name).and_then(Command::get_about);
        about.map_or_else(|| HELP_ABOUT.to_owned(), ToString::to_string)
    };
    let mut text = String::new();
    for (title, commands) in GROUPS {
        text += &format!("{header}{title}:{header:#}\n");
        for name in commands {
            let lines = wrap(&about(name), TERMINAL_WIDTH, &" ".repeat(NAME_WIDTH), &" ".repeat(NAME_WIDTH));
            let padding = " ".repeat(NAME_WIDTH - 2 - name.len());
            text += &format!("  {literal}{name}{literal:#}{padding}{}", &lines[NAME_WIDTH..]);
        }
        text.push('\n');
    }
    text.trim_end().to_owned() + "\n"
}

/// Moves the examples of a command from the end of its help to the beginning.
fn with_examples_first(command: Command) -> Command {
    let after = command.get_after_help().map(ToString::to_string).unwrap_or_default();
    let (examples, rest): (Vec<&str>, Vec<&str>) =
        after.split("\n\n").partition(|paragraph| paragraph.starts_with("Example"));
    if examples.is_empty() {
        return command;
    }
    command
        .before_help(examples.join("\n\n"))
        .after_help(rest.join("\n\n"))
        .help_template("{about-with-newline}\n{before-help}{usage-heading} {usage}\n\n{all-args}{after-help}")
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use clap::CommandFactory;

    use super::*;
    use crate::cli::Cli;

    #[test]
    fn each_command_is_in_one_group_and_begins_with_an_example() {
        let mut root = with_groups(Cli::command());
        root.build();
        let listed: Vec<&str> = GROUPS.iter().flat_map(|(_, commands)| commands.iter().copied()).collect();
        let unique: BTreeSet<&str> = listed.iter().copied().collect();
        let all: BTreeSet<&str> = root.get_subcommands().map(Command::get_name).collect();
        assert_eq!((unique, listed.len()), (all.clone(), all.len()));
        for command in root.get_subcommands_mut().filter(|command| command.get_name() != "help") {
            let (name, help) = (command.get_name().to_owned(), command.render_long_help().to_string());
            let (example, usage) = (help.find("\nExample"), help.find("\nUsage:"));
            assert!(example.is_some() && example < usage, "{name}: {help}");
        }
    }
}
