//! `growbot completions`: Tab in a shell.

use clap::builder::PossibleValuesParser;
use clap::{Args, Command, CommandFactory};
use clap_complete::Shell;
use growbot_client::robot_file;
use growbot_host::output::print;

use super::{Cli, Failure, ROBOT};

/// Print the completions of a shell: commands, options, names of robots
///
/// Where a robot is asked for, bash, zsh and fish offer the built-in names; bash offers files too, once no name fits.
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

/// Runs the command.
pub fn run(args: &CompletionsArgs) -> Result<(), Failure> {
    let mut command = Cli::command().mut_subcommands(with_names_of_robots);
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "growbot", &mut script);
    Ok(print(&String::from_utf8_lossy(&script))?)
}

/// The command, with the built-in robots as what its arguments that name a robot may be.
fn with_names_of_robots(command: Command) -> Command {
    command.mut_args(|arg| match arg.get_value_names() {
        Some([name]) if name == ROBOT => arg.value_parser(PossibleValuesParser::new(robot_file::names())),
        _ => arg,
    })
}
