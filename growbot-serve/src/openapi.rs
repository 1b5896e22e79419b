//! The OpenAPI document of an API: generated from the routes, and completed with details that the Rust types do not
//! contain.

use aide::axum::ApiRouter;
use aide::generate::in_context;
use aide::openapi::{Info, MediaType, OpenApi, Operation, ReferenceOr, Response, SchemaObject, Server, StatusCode};
use aide::transform::TransformOperation;
use axum::{Json, Router};
use schemars::{JsonSchema, Schema, json_schema};
use serde_json::{Map, Value, json};

use super::problem::Problem;
use crate::watch::heartbeat;

/// Example of a scene file.
const SCENE: &str = "format = \"growbot-scene/1\"\n[[halfspace]]\npoint_mm = [0, 0, -40]\nnormal = [0, 0, 1]\n";

/// Returns a function that sets the name and the description of an operation in the OpenAPI document, and problem
/// details as its default response.
pub fn describe(name: &'static str, words: &'static str) -> impl Fn(TransformOperation) -> TransformOperation {
    move |operation| operation.id(name).description(words).default_response::<Problem>()
}

/// Like [`describe`], for an operation that creates a `T`.
pub fn describe_creation<T: JsonSchema>(
    name: &'static str,
    words: &'static str,
) -> impl Fn(TransformOperation) -> TransformOperation {
    move |operation| operation.with(describe(name, words)).response::<201, Json<T>>()
}

/// Kind of a content that has no schema of its own.
#[derive(Debug, Clone, Copy)]
pub enum Content {
    /// Any JSON.
    Json,
    Text,
    Bytes,
}

impl Content {
    fn schema(self) -> Schema {
        match self {
            Self::Json => json_schema!({}),
            Self::Text => json_schema!({ "type": "string" }),
            Self::Bytes => json_schema!({ "type": "string", "format": "binary" }),
        }
    }
}

/// Returns a function that sets the successful response of an operation to a content of one of these media types.
pub fn returns(
    words: &'static str,
    types: &[(&'static str, Content)],
) -> impl Fn(TransformOperation) -> TransformOperation {
    move |mut operation| {
        let types = types.iter().map(|&(media_type, content)| (media_type, content.schema()));
        set_response(operation.inner_mut(), words, types);
        operation
    }
}

/// Returns a function that sets the successful response of an operation to a stream of server-sent events. The schema
/// of an event has its name as `event` and its content as `data`.
pub fn streams<T: JsonSchema>(words: &'static str) -> impl Fn(TransformOperation) -> TransformOperation {
    move |mut operation| {
        let event = in_context(|context| context.schema.subschema_for::<T>());
        set_response(operation.inner_mut(), words, [("text/event-stream", event)]);
        operation
    }
}

fn set_response<'a>(operation: &mut Operation, words: &str, types: impl IntoIterator<Item = (&'a str, Schema)>) {
    let content = types.into_iter().map(|(media_type, json_schema)| {
        let schema = Some(SchemaObject { json_schema, external_docs: None, example: None });
        (media_type.to_owned(), MediaType { schema, ..MediaType::default() })
    });
    let content = content.collect();
    let response = Response { description: words.to_owned(), content, ..Response::default() };
    let responses = &mut operation.responses.get_or_insert_default().responses;
    responses.insert(StatusCode::Code(200), ReferenceOr::Item(response));
}

/// Adds the header with the time of an order to an operation that is refused if it arrives late.
pub fn with_order_time(operation: TransformOperation) -> TransformOperation {
    let words = format!(
        "`time_ms` of the latest heartbeat, plus the time since it arrived. An order that is more than {} s old, or \
         more than {} s in the future, is refused, unless it stops or pauses the robot, or cools it down. Without \
         this header, the age is not checked.",
        heartbeat::MAX_ORDER_AGE.as_secs(),
        heartbeat::MAX_AHEAD.as_secs()
    );
    with_header(operation, heartbeat::HEADER, &words, &json!({ "type": "integer", "minimum": 0 }))
}

/// Adds an optional header to an operation.
pub fn with_header<'a>(
    mut operation: TransformOperation<'a>,
    name: &str,
    words: &str,
    schema: &Value,
) -> TransformOperation<'a> {
    let header = json!({ "name": name, "in": "header", "description": words, "schema": schema });
    operation.inner_mut().parameters.extend(serde_json::from_value(header).map(ReferenceOr::Item));
    operation
}

/// Returns the router of an API, and its OpenAPI document with the parameters of all paths. Problem details are the
/// only error response of each operation.
pub fn documented<S: Clone + Send + Sync + 'static>(api: ApiRouter<S>) -> (Router<S>, Value) {
    let mut document = OpenApi {
        info: Info {
            title: "growbot serve".to_owned(),
            description: Some(
                "Robots, their jobs, and commands to them. Lengths are in mm, angles in degrees, temperatures in C: \
                 names carry the unit. Requests carry the access token of the URLs that the service prints, as \
                 `Authorization: Bearer TOKEN`; requests on the Unix socket in the user's runtime directory need none."
                    .to_owned(),
            ),
            version: "1".to_owned(),
            ..Info::default()
        },
        // Relative to the address of the document.
        servers: vec![Server { url: "../v1".to_owned(), ..Server::default() }],
        ..OpenApi::default()
    };
    let router = api.finish_api(&mut document);
    (router, complete(&document))
}

fn complete(document: &OpenApi) -> Value {
    let mut document = serde_json::to_value(document).unwrap_or_default();
    let schemas = document.pointer_mut("/components/schemas").and_then(Value::as_object_mut);
    schemas.into_iter().flat_map(Map::values_mut).for_each(list_values);
    let paths = document.get_mut("paths").and_then(Value::as_object_mut);
    for (path, item) in paths.into_iter().flatten() {
        let parameters: Vec<Value> = names_in(path).map(in_path).collect();
        for operation in item.as_object_mut().into_iter().flat_map(Map::values_mut) {
            add(operation, &parameters);
            if let Some(responses) = operation.get_mut("responses").and_then(Value::as_object_mut) {
                responses.retain(|status, _| status.starts_with('2') || status == "default");
                responses.get_mut("default").map(name_problem);
            }
            if let Some(bytes) = operation.pointer_mut("/requestBody/content/application~1octet-stream") {
                bytes["schema"] = Content::Bytes.schema().to_value();
                bytes["example"] = SCENE.into();
            }
        }
    }
    document
}

/// Changes the schema of an enumeration whose values have descriptions of their own to a list of values, because some
/// generators of clients support only these.
fn list_values(schema: &mut Value) {
    let Some(variants) = schema["oneOf"].as_array() else { return };
    let Some(values) = variants.iter().map(|variant| variant.get("const").cloned()).collect::<Option<Vec<_>>>() else {
        return;
    };
    let mut words = schema["description"].as_str().unwrap_or_default().to_owned() + "\n";
    for variant in variants {
        let [value, meaning] = ["const", "description"].map(|key| variant[key].as_str().unwrap_or_default());
        words += &format!("\n- `{value}`: {meaning}");
    }
    *schema = json!({ "type": "string", "description": words, "enum": values });
}

/// Returns the names of a path's parameters, for example `robot` for `/robots/{robot}/jobs`.
fn names_in(path: &str) -> impl Iterator<Item = &str> {
    path.split('/').filter_map(|part| part.strip_prefix('{')?.strip_suffix('}'))
}

fn in_path(name: &str) -> Value {
    let text = json!({ "type": "string" });
    let (words, schema) = match name {
        "robot" => ("Name of the robot in the service.", text),
        "job" => ("Identifier of the job.", text),
        "queued" => ("Identifier of the queued body.", text),
        "entry" => ("Identifier of the entry of the library.", text),
        "layer" => ("Index of the layer, from 0.", json!({ "type": "integer", "minimum": 0, "maximum": u32::MAX })),
        "number" => ("Number of the plan's page, as in `view_path`.", json!({ "type": "integer", "minimum": 0 })),
        _ => ("", text),
    };
    json!({ "name": name, "in": "path", "required": true, "description": words, "schema": schema })
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
