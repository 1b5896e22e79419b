//! JSON Schemas of plans, lines of run logs, results, scenes, notices and settings.
//!
//! The schemas are derived from the types that read and write these files, with their doc comments. In files that
//! growbot writes, a field that is always written is required, even if a reader does not need it.

use growbot_client::status::RobotStatus;
use growbot_plan::plan_file::PlanFile;
use growbot_plan::robot_schema::plain;
use growbot_plan::run_log::{GrowthResult, RunLine};
use growbot_scene::scene_file::SceneFile;
use growbot_serve::notification::Notification;
use growbot_serve::settings::SettingsToml;
use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde_json::{Value, json};

/// Returns the schema of plan files.
pub fn plan_schema() -> Value {
    of::<PlanFile>("growbot plan", "A path and the data needed to grow it. Lengths are in mm: names carry the unit.")
}

/// Returns the schema of scene files.
pub fn scene_schema() -> Value {
    of_read::<SceneFile>("growbot scene", "Obstacles for a growing body. Lengths are in mm: names carry the unit.")
}

/// Returns the schema of a line in a run log.
pub fn run_event_schema() -> Value {
    of::<RunLine>(
        "growbot run log, a line",
        "A line of a run log. Readers skip events and fields that they do not know.",
    )
}

/// Returns the schema of results, as `grow`, `resume` and `replay` print them with `--json`.
pub fn result_schema() -> Value {
    of::<GrowthResult>("growbot result", "Result of a growth. Lengths are in mm: names carry the unit.")
}

/// Returns the schema of the status of a robot, as `status --json` prints it, and as the service reports it.
pub fn status_schema() -> Value {
    of::<RobotStatus>("growbot status", "Status of a robot. Lengths are in mm: names carry the unit.")
}

/// Returns the schema of the notices that webhooks and commands of the service receive.
pub fn notice_schema() -> Value {
    of::<Notification>(
        "growbot notice",
        "Notification that `growbot serve` sends. Receivers skip fields that they do not know.",
    )
}

/// Returns the schema of `growbot.toml`.
pub fn settings_schema() -> Value {
    of_read::<SettingsToml>("growbot.toml", "Settings for all commands of growbot.")
}

fn of<T: JsonSchema>(title: &str, description: &str) -> Value {
    with::<T>(SchemaSettings::draft07().for_serialize(), title, description)
}

/// Returns the schema of a file that users write and growbot reads. A field with a default is optional.
fn of_read<T: JsonSchema>(title: &str, description: &str) -> Value {
    with::<T>(SchemaSettings::draft07(), title, description)
}

fn with<T: JsonSchema>(mut settings: SchemaSettings, title: &str, description: &str) -> Value {
    settings.inline_subschemas = true;
    let mut schema = settings.into_generator().into_root_schema_for::<T>().to_value();
    tidy(&mut schema);
    if let Some(root) = schema.as_object_mut() {
        root.insert("title".into(), json!(title));
        root.insert("description".into(), json!(description));
    }
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
