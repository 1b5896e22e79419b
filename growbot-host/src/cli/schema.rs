//! `growbot schema`: prints the JSON Schemas of the files and messages that growbot reads and writes.
//!
//! The schemas are derived from the types that read and write these files, with their doc comments. In files that
//! growbot writes, a field that is always written is required, even if a reader does not need it.

use clap::{Args, ValueEnum};
use growbot_client::command_report::{CommandReport, ConfigurationReport, TuningReport};
use growbot_client::commissioning_report::CommissioningReport;
use growbot_client::recovery::RecoverySequence;
use growbot_client::status::RobotStatus;
use growbot_host::output::print;
use growbot_paper::tables::ReproductionJson;
use growbot_plan::file_report::FileReport;
use growbot_plan::plan_file::PlanFile;
use growbot_plan::robot_json::{MinRadius, RobotDetails, RobotOverview};
use growbot_plan::robot_schema::{plain, robot_file_schema};
use growbot_plan::run_log::{GrowthResult, RunLine};
use growbot_plan::workspace::{SceneWorkspaceJson, WorkspaceJson};
use growbot_scene::scene_file::SceneFile;
use growbot_scene::scene_summary::SceneSummary;
use growbot_serve::known_ports::KnownPorts;
use growbot_serve::notification::Notification;
use growbot_serve::settings::{SettingsJson, SettingsToml};
use growbot_sim::simulation::json::{SimulatedCampaign, SimulatedGrowth};
use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde_json::{Value, json};

use super::failure::Failure;

/// Print the JSON Schema of a kind of file, or of what a command prints with --json
///
/// Editors and validators use it (draft 7) to check files. The schema of a run log is that of each line.
#[derive(Args)]
#[command(after_help = "Examples:\n  growbot schema run > growbot-run.schema.json\n  growbot schema workspace")]
pub struct SchemaArgs {
    /// Kind of file, or of output
    #[arg(value_name = "KIND")]
    kind: SchemaKind,
}

/// A kind of file, or of output.
#[derive(Debug, Clone, Copy, ValueEnum)]
enum SchemaKind {
    /// Robot files, as `growbot robots --schema`
    Robot,
    /// Plans, as `growbot plan` writes them
    Plan,
    /// Scene files, as `growbot plan --scene` reads them
    Scene,
    /// A line of a run log, as `growbot grow --log` writes it. Readers skip events and fields that they do not know
    Run,
    /// Settings, growbot.toml
    Settings,
    /// A notice, as `growbot serve` sends it to webhooks and commands. Receivers skip fields that they do not know
    Notification,
    /// A result, as `grow`, `resume`, `attach` and `replay` print it
    Result,
    /// The status of a robot, as `status` prints it, and as the service reports it
    Status,
    /// Output of `stop`, `estop`, `pause`, `continue`, `cancel`, `clear`, `maintain` and `power`
    Command,
    /// Output of `configure`
    Configure,
    /// Output of `doctor`, and its report
    Doctor,
    /// Output of `export` and `view`
    File,
    /// Output of `ports`
    Ports,
    /// Output of `recover`: null, or a guided sequence
    Recovery,
    /// Output of `reproduce`
    Reproduce,
    /// Output of `rmin`
    Rmin,
    /// Output of `robots`
    Robots,
    /// Output of `scene`
    SceneSummary,
    /// Output of `settings`
    SettingsList,
    /// Output of `simulate`
    Simulate,
    /// Output of `tune`
    Tune,
    /// Output of `workspace`
    Workspace,
}

/// Runs the command.
pub fn run(args: &SchemaArgs) -> Result<(), Failure> {
    Ok(print(&format!("{:#}\n", args.kind.schema()))?)
}

impl SchemaKind {
    fn schema(self) -> Value {
        let mut schema = match self {
            Self::Robot => return robot_file_schema(),
            Self::Plan => written::<PlanFile>(),
            Self::Scene => read::<SceneFile>(),
            Self::Run => written::<RunLine>(),
            Self::Settings => read::<SettingsToml>(),
            Self::Notification => written::<Notification>(),
            Self::Result => written::<GrowthResult>(),
            Self::Status => written::<RobotStatus>(),
            Self::Command => written::<CommandReport>(),
            Self::Configure => written::<ConfigurationReport>(),
            Self::Doctor => written::<CommissioningReport>(),
            Self::File => written::<FileReport>(),
            Self::Ports => written::<KnownPorts>(),
            Self::Recovery => written::<Option<RecoverySequence>>(),
            Self::Reproduce => written::<ReproductionJson>(),
            Self::Rmin => written::<MinRadius>(),
            Self::Robots => either(written::<Vec<RobotOverview>>(), written::<RobotDetails>()),
            Self::SceneSummary => written::<SceneSummary>(),
            Self::SettingsList => written::<SettingsJson>(),
            Self::Simulate => either(written::<SimulatedGrowth>(), written::<SimulatedCampaign>()),
            Self::Tune => written::<TuningReport>(),
            Self::Workspace => either(written::<WorkspaceJson>(), written::<SceneWorkspaceJson>()),
        };
        let shown = self.to_possible_value().unwrap_or_default();
        let help = shown.get_help().map(ToString::to_string).unwrap_or_default();
        schema["title"] = format!("growbot {}", shown.get_name()).into();
        schema["description"] = format!("{help}. Lengths are in mm: names carry the unit.").into();
        schema
    }
}

/// Returns the schema of a file or message that growbot writes.
fn written<T: JsonSchema>() -> Value {
    of::<T>(SchemaSettings::draft07().for_serialize())
}

/// Returns the schema of a file that users write and growbot reads. A field with a default is optional.
fn read<T: JsonSchema>() -> Value {
    of::<T>(SchemaSettings::draft07())
}

/// Returns the schema of output that has one of two forms.
fn either(mut one: Value, mut other: Value) -> Value {
    let draft = one["$schema"].take();
    for schema in [&mut one, &mut other].into_iter().filter_map(Value::as_object_mut) {
        schema.remove("$schema");
    }
    json!({ "$schema": draft, "anyOf": [one, other] })
}

fn of<T: JsonSchema>(mut settings: SchemaSettings) -> Value {
    settings.inline_subschemas = true;
    let mut schema = settings.into_generator().into_root_schema_for::<T>().to_value();
    tidy(&mut schema);
    schema
}

/// Removes the parts of a schema that only Rust needs (number formats, links in descriptions), and line breaks in
/// descriptions.
fn tidy(schema: &mut Value) {
    match schema {
        Value::Array(items) => items.iter_mut().for_each(tidy),
        Value::Object(object) => {
            if object.get("format").is_some_and(Value::is_string) {
                object.remove("format");
            }
            if let Some(Value::String(text)) = object.get_mut("description") {
                *text = plain(text);
            }
            object.values_mut().for_each(tidy);
        }
        _ => {}
    }
}
