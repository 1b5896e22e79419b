//! `growbot completions`: prints the completions of a shell.

use clap::builder::PossibleValuesParser;
use clap::{Args, Command};
use clap_complete::Shell;
use growbot_host::output::print;
use growbot_plan::robot_file;

use super::failure::Failure;
use super::robot_arg::ROBOT;

/// Print the completions of a shell: commands, options, names of robots
///
/// For a robot, bash, zsh and fish offer the built-in names. If no name matches, bash offers files.
#[derive(Args)]
#[command(after_help = "\
Examples:
  growbot completions bash > ~/.local/share/bash-completion/completions/growbot
  growbot completions zsh > ~/.zfunc/_growbot
  growbot completions fish > ~/.config/fish/completions/growbot.fish

In zsh, ~/.zfunc must be in fpath before compinit is called. A new shell has it.")]
pub struct CompletionsArgs {
    /// The shell
    #[arg(value_name = "SHELL")]
    shell: Shell,
}

/// Runs the command. `root` is the definition of the command line.
pub fn run(args: &CompletionsArgs, root: Command) -> Result<(), Failure> {
    let mut command = root.mut_subcommands(with_names_of_robots);
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "growbot", &mut script);
    Ok(print(&String::from_utf8_lossy(&script))?)
}

/// Returns the command with the names of the built-in robots as possible values of each argument that names a robot.
fn with_names_of_robots(command: Command) -> Command {
    command.mut_args(|arg| match arg.get_value_names() {
        Some([name]) if name == ROBOT => arg.value_parser(PossibleValuesParser::new(robot_file::names())),
        _ => arg,
    })
}
