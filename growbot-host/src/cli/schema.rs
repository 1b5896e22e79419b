//! `growbot schema`: the JSON Schemas of what growbot reads and writes.

use clap::{Args, ValueEnum};
use growbot_host::output::print;
use growbot_host::schema::{of_robot_files, written};

use super::Failure;

/// Print the JSON Schema of a kind of file
///
/// Editors and validators check files by it (draft 7). Of a run log it is the schema of each line.
#[derive(Args)]
#[command(after_help = "Examples:\n  growbot schema run > growbot-run.schema.json\n  growbot schema result")]
pub struct SchemaArgs {
    /// The kind of file
    #[arg(value_name = "KIND")]
    kind: Kind,
}

/// A kind of file.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum Kind {
    /// Robot files, as `growbot robots --schema`
    Robot,
    /// Plans, as `growbot plan` writes them
    Plan,
    /// Scene files, as `growbot plan --scene` reads them
    Scene,
    /// A line of a run log, as `growbot grow --log` writes it
    Run,
    /// A result, as `grow`, `resume` and `replay` print it with --json
    Result,
    /// A notice, as webhooks and commands of `growbot serve` are told
    Notice,
    /// Settings, growbot.toml
    Settings,
}

/// Runs the command.
pub fn run(args: &SchemaArgs) -> Result<(), Failure> {
    let schema = match args.kind {
        Kind::Robot => of_robot_files(),
        Kind::Plan => written::of_plans(),
        Kind::Scene => written::of_scenes(),
        Kind::Run => written::of_run_lines(),
        Kind::Result => written::of_results(),
        Kind::Notice => written::of_notices(),
        Kind::Settings => written::of_settings(),
    };
    Ok(print(&format!("{schema:#}\n"))?)
}
