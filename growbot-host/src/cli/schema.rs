//! `growbot schema`: prints the JSON Schemas of the files and messages that growbot reads and writes.

use clap::{Args, ValueEnum};
use growbot_host::output::print;
use growbot_host::schema;
use growbot_plan::robot_schema::robot_file_schema;

use super::failure::Failure;

/// Print the JSON Schema of a kind of file
///
/// Editors and validators use it (draft 7) to check files. The schema of a run log is that of each line.
#[derive(Args)]
#[command(after_help = "Examples:\n  growbot schema run > growbot-run.schema.json\n  growbot schema result")]
pub struct SchemaArgs {
    /// Kind of file
    #[arg(value_name = "KIND")]
    kind: SchemaKind,
}

/// A kind of file.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum SchemaKind {
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
    /// The status of a robot, as `status` prints it with --json, and as the service reports it
    Status,
    /// A notice, as `growbot serve` sends it to webhooks and commands
    Notification,
    /// Settings, growbot.toml
    Settings,
}

/// Runs the command.
pub fn run(args: &SchemaArgs) -> Result<(), Failure> {
    let schema = match args.kind {
        SchemaKind::Robot => robot_file_schema(),
        SchemaKind::Plan => schema::plan_schema(),
        SchemaKind::Scene => schema::scene_schema(),
        SchemaKind::Run => schema::run_event_schema(),
        SchemaKind::Result => schema::result_schema(),
        SchemaKind::Status => schema::status_schema(),
        SchemaKind::Notification => schema::notice_schema(),
        SchemaKind::Settings => schema::settings_schema(),
    };
    Ok(print(&format!("{schema:#}\n"))?)
}
