//! The JSON Schemas of what growbot writes: plans, the lines of run logs, and results.
//!
//! They are derived from the very types that write and read it, by their doc comments, as growbot writes it: a field
//! that is always there is required, also where a reader does without.

use growbot_client::plan_file::PlanFile;
use growbot_client::run_log::{GrowthResult, RunLine};
use growbot_scene::scene_file::SceneFile;
use schemars::JsonSchema;
use schemars::generate::SchemaSettings;
use serde_json::{Value, json};

use super::plain;
use crate::serve::notices::Notice;
use crate::settings::Written;

/// Of plan files.
#[must_use]
pub fn of_plans() -> Value {
    of::<PlanFile>("growbot plan", "A path with what it takes to grow it. Lengths are in mm: names carry the unit.")
}

/// Of scene files.
#[must_use]
pub fn of_scenes() -> Value {
    of_read::<SceneFile>("growbot scene", "Obstacles for a growing body. Lengths are in mm: names carry the unit.")
}

/// Of each line of a run log.
#[must_use]
pub fn of_run_lines() -> Value {
    of::<RunLine>(
        "growbot run log, a line",
        "A line of a run log. Readers skip events and fields that they do not know.",
    )
}

/// Of results, as `grow`, `resume` and `replay` print them with `--json`.
#[must_use]
pub fn of_results() -> Value {
    of::<GrowthResult>("growbot result", "What a growth came to. Lengths are in mm: names carry the unit.")
}

/// Of what webhooks and commands of the service are told.
#[must_use]
pub fn of_notices() -> Value {
    of::<Notice>(
        "growbot notice",
        "What `growbot serve` tells who does not look. Receivers skip fields that they do not know.",
    )
}

/// Of `growbot.toml`.
#[must_use]
pub fn of_settings() -> Value {
    of_read::<Written>("growbot.toml", "What is set for all commands of growbot.")
}

fn of<T: JsonSchema>(title: &str, description: &str) -> Value {
    with::<T>(SchemaSettings::draft07().for_serialize(), title, description)
}

/// Of what growbot reads and people write: what has a default may be left out.
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

/// Takes out what only Rust has (formats, links), and line breaks within descriptions.
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
