//! The OpenAPI document of an API: generated from the routes, and completed with details that the Rust types do not
//! contain.

use aide::axum::ApiRouter;
use aide::openapi::{Info, OpenApi};
use aide::transform::TransformOperation;
use axum::Router;
use serde_json::{Map, Value, json};

use super::problem::Problem;

/// Returns a function that sets the description of an operation in the OpenAPI document, and problem details as its
/// default response.
pub fn describe(words: &'static str) -> impl Fn(TransformOperation) -> TransformOperation {
    move |operation| operation.description(words).default_response::<Problem>()
}

/// Returns the router of an API, and its OpenAPI document with the parameters of all paths. Problem details are the
/// only error response of each operation.
pub fn documented<S: Clone + Send + Sync + 'static>(api: ApiRouter<S>) -> (Router<S>, Value) {
    let mut document = OpenApi {
        info: Info {
            title: "growbot serve".to_owned(),
            description: Some(
                "Robots, their jobs, and commands to them. Lengths are in mm, angles in degrees, temperatures in C: \
                 names carry the unit. Requests carry the access token of the URLs that `growbot serve` prints, as \
                 `Authorization: Bearer TOKEN`; requests on the Unix socket in the user's runtime directory need none."
                    .to_owned(),
            ),
            version: "1".to_owned(),
            ..Info::default()
        },
        ..OpenApi::default()
    };
    let router = api.finish_api(&mut document);
    (router, complete(&document))
}

fn complete(document: &OpenApi) -> Value {
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
