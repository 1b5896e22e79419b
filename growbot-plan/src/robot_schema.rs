//! JSON Schema of robot files. Editors use it to complete, explain and check.
//!
//! The schema has the fields, types and descriptions of [`RobotDescription`], from its derive and its doc comments. Its
//! bounds come from the checks: each number is set far too low and far too high, and the error contains the limit. A
//! limit that depends on another field cannot be a number in a schema. It is in the field's description, with the
//! advice of the error.

use growbot_core::robot::{Robot, RobotDescription, RobotError};
use schemars::generate::SchemaSettings;
use serde_json::{Map, Value, json};

use crate::robot_file::{self, MaterialPreset};

/// Returns the schema of robot files, with units and bounds. It uses draft 7, which TOML tools of editors support.
pub fn robot_file_schema() -> Value {
    let mut schema = robot_file_schema_without_bounds();
    let descriptions: Vec<Value> = robot_file::names().filter_map(description).collect();
    // One description of each field is enough. Later robots have the fields that earlier ones omit.
    let mut done: Vec<Vec<String>> = Vec::new();
    for description in &descriptions {
        let mut paths = Vec::new();
        collect_numbers(description, &mut Vec::new(), &mut paths);
        for path in &paths {
            if !done.contains(path) {
                if let Some(field) = field_mut(&mut schema, path) {
                    say_bounds(field, description, path, &paths);
                }
                done.push(path.clone());
            }
        }
    }
    schema
}

/// Returns the schema of robot files without bounds: types, defaults and descriptions of all fields.
pub fn robot_file_schema_without_bounds() -> Value {
    let mut settings = SchemaSettings::draft07();
    settings.inline_subschemas = true;
    let mut schema = settings.into_generator().into_root_schema_for::<RobotDescription>().to_value();
    let materials = SchemaSettings::draft07().with(|settings| settings.inline_subschemas = true);
    let preset = materials.into_generator().into_root_schema_for::<MaterialPreset>().to_value();
    schema["properties"]["materials"] = json!({
        "description": "Material presets for maintenance, by name. They stay on the host and are not part of the robot \
                        description.",
        "type": "object",
        "additionalProperties": without_head(preset),
    });
    tidy(&mut schema);
    if let Some(root) = schema.as_object_mut() {
        root.insert("title".into(), json!("growbot robot file"));
        root.insert(
            "description".into(),
            json!("Description of a robot that moves by growing. Lengths are in mm: names carry the unit."),
        );
    }
    schema
}

/// Removes the head of a schema (`$schema` and `title`), so that it can be a part of another schema.
fn without_head(mut schema: Value) -> Value {
    if let Some(root) = schema.as_object_mut() {
        root.remove("$schema");
        root.remove("title");
    }
    schema
}

/// Returns the meaning of the field with this path, for example `geometry.tip_radius_mm`. Empty if it does not exist.
pub fn meaning<'a>(schema: &'a Value, path: &str) -> &'a str {
    field(schema, path).and_then(|field| field.get("description")?.as_str()).unwrap_or_default()
}

/// Returns the allowed values of a field with their meanings. Empty if the field is not a choice.
pub fn choices<'a>(schema: &'a Value, path: &str) -> Vec<(&'a str, &'a str)> {
    let choices = field(schema, path).and_then(|field| field.get("oneOf")?.as_array());
    let choice = |choice: &'a Value| Some((choice.get("const")?.as_str()?, choice.get("description")?.as_str()?));
    choices.into_iter().flatten().filter_map(choice).collect()
}

fn field<'a>(schema: &'a Value, path: &str) -> Option<&'a Value> {
    path.split('.').try_fold(schema, |schema, key| schema.get("properties")?.get(key))
}

/// Removes the parts of a schema that TOML does not have (null) or only Rust needs (number formats, links), and line
/// breaks in descriptions.
fn tidy(schema: &mut Value) {
    match schema {
        Value::Array(items) => items.iter_mut().for_each(tidy),
        Value::Object(object) => {
            without_null(object);
            object.remove("format");
            object.retain(|_, value| !value.is_null());
            if let Some(Value::String(text)) = object.get_mut("description") {
                *text = plain(text);
            }
            object.values_mut().for_each(tidy);
        }
        _ => {}
    }
}

/// Removes null from the types of optional fields. A JSON schema allows null for them, but TOML omits them.
fn without_null(object: &mut Map<String, Value>) {
    if let Some(Value::Array(kinds)) = object.get_mut("type") {
        kinds.retain(|kind| kind != "null");
        if let [only] = kinds.as_slice() {
            let only = only.clone();
            object.insert("type".into(), only);
        }
    }
    let Some(Value::Array(choices)) = object.get_mut("anyOf") else { return };
    choices.retain(|choice| choice.get("type").is_none_or(|kind| kind != "null"));
    if let [Value::Object(only)] = choices.as_mut_slice() {
        let only = std::mem::take(only);
        object.remove("anyOf");
        for (key, value) in only {
            // The field's own description is more specific than that of its type.
            object.entry(key).or_insert(value);
        }
    }
}

/// Converts a doc comment to plain text: one line, with links replaced by the names of fields in a file.
pub fn plain(text: &str) -> String {
    let mut plain = String::new();
    let mut rest = text;
    while let Some((before, after)) = rest.split_once("[`") {
        let Some((link, after)) = after.split_once("`]") else { break };
        plain += before;
        plain += &link.replace("::", ".").to_lowercase();
        rest = after;
    }
    plain += rest;
    plain.replace('`', "").split_whitespace().collect::<Vec<_>>().join(" ")
}

/// Returns the description of a built-in robot as a JSON tree. `None` if the name is unknown.
fn description(name: &str) -> Option<Value> {
    serde_json::to_value(robot_file::load(name.as_ref()).ok()?.description()).ok()
}

/// Adds the paths of all numbers below a value to `paths`. `here` is the path of the value. Numbers in arrays are
/// omitted, because they have no names.
fn collect_numbers(value: &Value, here: &mut Vec<String>, paths: &mut Vec<Vec<String>>) {
    match value {
        Value::Number(_) => paths.push(here.clone()),
        Value::Object(object) => {
            for (key, value) in object {
                here.push(key.clone());
                collect_numbers(value, here, paths);
                here.pop();
            }
        }
        _ => {}
    }
}

/// Returns the schema of the field with this path. `None` if it does not exist.
fn field_mut<'a>(schema: &'a mut Value, path: &[String]) -> Option<&'a mut Map<String, Value>> {
    path.iter().try_fold(schema, |schema, key| schema.get_mut("properties")?.get_mut(key))?.as_object_mut()
}

/// Returns the value of the field with this path. `None` if it does not exist.
fn value_mut<'a>(description: &'a mut Value, path: &[String]) -> Option<&'a mut Value> {
    path.iter().try_fold(description, |value, key| value.get_mut(key))
}

/// Limit of a field, and the advice in the error about it.
type Limit = (f64, &'static str);

/// Inserts the bounds of a number into the schema of its field. A bound that depends on another field is only
/// described in text.
fn say_bounds(field: &mut Map<String, Value>, description: &Value, path: &[String], others: &[Vec<String>]) {
    let whole = field.get("type").is_some_and(|kind| kind == "integer");
    let (low, high) = if whole { (json!(0), json!(u32::MAX)) } else { (json!(-1e300), json!(1e300)) };
    let mut advice: Vec<&str> = Vec::new();
    for (keyword, extreme) in [("minimum", low), ("maximum", high)] {
        let Some((limit, words)) = limit(description, path, &extreme) else { continue };
        if !advice.contains(&words) {
            advice.push(words);
        }
        let moves = others.iter().filter(|other| *other != path).any(|other| {
            let changed = |change: fn(&Value) -> Value| {
                let mut changed = description.clone();
                if let Some(value) = value_mut(&mut changed, other) {
                    *value = change(value);
                }
                changed
            };
            let raised = self::limit(&changed(raised), path, &extreme);
            raised.is_some_and(|(other, _)| (other - limit).abs() > 1e-12 * limit.abs())
                || is_accepted(&changed(|value| if value.is_u64() { json!(0) } else { json!(0.0) }), path, &extreme)
        });
        if moves {
            field.remove(keyword);
        } else {
            let limit = if whole { json!(limit as u64) } else { json!(limit) };
            field.insert(keyword.into(), limit);
        }
    }
    let range = match (field.get("minimum"), field.get("maximum")) {
        (Some(min), Some(max)) => format!("{min} to {max}: "),
        (Some(min), None) => format!("{min} or more: "),
        (None, Some(max)) => format!("{max} or less: "),
        (None, None) => String::new(),
    };
    if let (Some(Value::String(text)), false) = (field.get_mut("description"), advice.is_empty()) {
        *text += &format!(" Accepted values: {range}{}.", advice.join("; "));
    }
}

/// Returns true if the robot description is valid with `value` at `path`.
fn is_accepted(description: &Value, path: &[String], value: &Value) -> bool {
    with(description, path, value).is_some_and(|description| Robot::new(description).is_ok())
}

/// Returns the description with `value` at `path`. `None` if the type of the value is wrong.
fn with(description: &Value, path: &[String], value: &Value) -> Option<RobotDescription> {
    let mut changed = description.clone();
    *value_mut(&mut changed, path)? = value.clone();
    serde_json::from_value(changed).ok()
}

/// Returns a slightly larger number. A whole number grows by one.
fn raised(value: &Value) -> Value {
    match (value.as_u64(), value.as_f64()) {
        (Some(whole), _) => json!(whole + 1),
        (None, Some(number)) => json!(if number == 0.0 { 0.001 } else { number * 1.01 }),
        _ => value.clone(),
    }
}

/// Returns the limit that rejects this value of a field. `None` if the value is valid or another field is rejected.
fn limit(description: &Value, path: &[String], extreme: &Value) -> Option<Limit> {
    match Robot::new(with(description, path, extreme)?) {
        Err(RobotError::TooSmall { field, limit, advice, .. } | RobotError::TooLarge { field, limit, advice, .. })
            if field == path.join(".") =>
        {
            Some((limit, advice))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_match_the_checks() {
        let schema = robot_file_schema();
        let bounds = |path| {
            let field = field(&schema, path).unwrap();
            (field.get("minimum").and_then(Value::as_f64), field.get("maximum").and_then(Value::as_f64))
        };
        assert_eq!(bounds("geometry.tip_radius_mm"), (Some(0.001), Some(1e4)));
        assert_eq!(bounds("motion.tick_hz"), (Some(100.0), Some(1e6)));
        assert_eq!(bounds("heater.max_c"), (Some(40.0), Some(500.0)));
        assert_eq!(bounds("fan.growing_duty"), (Some(0.0), Some(1.0)));
        // These end where another field sets the limit: R_min, the max height, the nozzle's limit.
        assert_eq!(bounds("planning_radius_mm"), (None, Some(1e4)));
        assert_eq!(bounds("layer.height_max_mm"), (None, Some(255.0)));
        assert_eq!(bounds("heater.target_c"), (Some(30.0), None));
        // Maintenance also moves filament at this speed, even if it is not retracted in a pause.
        assert_eq!(bounds("feed.retract_mm_per_s"), (Some(0.001), Some(1e6)));
    }

    #[test]
    fn lower_limits_of_boards_are_documented() {
        let schema = robot_file_schema();
        let text = meaning(&schema, "motion.tick_hz");
        assert!(text.contains("100 kHz"), "{text}");
        assert_eq!(growbot_core::robot::MAX_BOARD_TICK_HZ, 100_000);
        assert!(meaning(&schema, "test_bench").contains("debug probe"));
    }

    #[test]
    fn a_field_beyond_a_bound_of_the_schema_is_refused() {
        let schema = robot_file_schema();
        let description = description(robot_file::DEFAULT).unwrap();
        let mut paths = Vec::new();
        collect_numbers(&description, &mut Vec::new(), &mut paths);
        let mut tried = 0;
        for path in &paths {
            let field = field(&schema, &path.join(".")).unwrap();
            for (keyword, step) in [("minimum", -1.0), ("maximum", 1.0)] {
                let Some(bound) = field.get(keyword) else { continue };
                let beyond = match bound.as_u64() {
                    Some(whole) => json!(whole.saturating_add_signed(step as i64)),
                    None => json!(bound.as_f64().unwrap() + step),
                };
                assert!(!is_accepted(&description, path, &beyond), "{}: {beyond}", path.join("."));
                tried += 1;
            }
        }
        assert!(tried > 80, "{tried}");
    }

    #[test]
    fn every_field_has_a_description_without_rust_terms() {
        fn look(schema: &Value, path: &str) {
            for (key, field) in schema["properties"].as_object().into_iter().flatten() {
                let path = format!("{path}.{key}");
                let text = field["description"].as_str().unwrap_or_else(|| panic!("{path}"));
                assert!(!text.is_empty() && !text.contains(['`', '\n']) && !text.contains("::"), "{path}: {text}");
                assert!(field.get("type").is_some() || field.get("oneOf").is_some(), "{path}: {field}");
                look(field, &path);
            }
        }
        let schema = robot_file_schema();
        look(&schema, "");
        assert!(!schema.to_string().contains("null"));
        assert_eq!(
            choices(&schema, "motion.strategy").iter().map(|(word, _)| *word).collect::<Vec<_>>(),
            ["feed", "speed"]
        );
        assert!(meaning(&schema, "pause.standby_c").contains("If heater.target_c is lower"));
    }
}
