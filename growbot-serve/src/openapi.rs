//! Completes the generated OpenAPI document with details of the API that the Rust types do not contain.

use aide::openapi::OpenApi;
use serde_json::{Map, Value, json};

/// Returns the document, completed with the parameters of all paths. Problem details are the only error response of
/// each operation.
pub fn complete(document: &OpenApi) -> Value {
    let mut document = serde_json::to_value(document).unwrap_or_default();
    let paths = document.get_mut("paths").and_then(Value::as_object_mut);
    for (path, item) in paths.into_iter().flatten() {
        let parameters: Vec<Value> = names_in(path).map(in_path).collect();
        for operation in item.as_object_mut().into_iter().flat_map(Map::values_mut) {
            add(operation, &parameters);
            if let Some(responses) = operation.get_mut("responses").and_then(Value::as_object_mut) {
                responses.retain(|status, _| status.starts_with('2') || status == "default");
                responses.get_mut("default").map(name_problem);
            }
        }
    }
    document
}

/// Returns the names of a path's parameters, for example `robot` for `/robots/{robot}/jobs`.
fn names_in(path: &str) -> impl Iterator<Item = &str> {
    path.split('/').filter_map(|part| part.strip_prefix('{')?.strip_suffix('}'))
}

fn in_path(name: &str) -> Value {
    json!({ "name": name, "in": "path", "required": true, "schema": { "type": "string" } })
}

fn add(operation: &mut Value, parameters: &[Value]) {
    let Some(operation) = operation.as_object_mut() else { return };
    let known = operation.entry("parameters").or_insert_with(|| json!([]));
    if let Some(known) = known.as_array_mut() {
        known.extend_from_slice(parameters);
    }
}

/// Sets the media type of an error response to that of problem details.
fn name_problem(response: &mut Value) {
    if let Some(content) = response.get_mut("content").and_then(Value::as_object_mut)
        && let Some(schema) = content.remove("application/json")
    {
        content.insert("application/problem+json".to_owned(), schema);
    }
}
