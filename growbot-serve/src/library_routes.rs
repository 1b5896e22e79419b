//! Routes of the API for the library: plans, scenes and robot files under names.

use std::sync::Arc;

use aide::axum::ApiRouter;
use aide::axum::routing::{get_with, post_with};
use axum::extract::{Path, State};
use axum::http::StatusCode;
use axum::http::header::CONTENT_TYPE;
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use growbot_pictures::view::thumbnail;
use growbot_plan::plan_file::{self, LoadedPlan};
use growbot_plan::robot_file;
use growbot_plan::run_log::utc_now;
use growbot_scene::scene_file::{self, SceneBox};
use schemars::JsonSchema;
use serde::Deserialize;
use serde_json::value::RawValue;

use super::access::{Access, require_control};
use super::grow_request::{ensure_storable_plan, scene_of_plan};
use super::handler::{ApiResult, ServiceState, run_blocking};
use super::json_body::JsonBody;
use super::library_store::{LibraryEntry, LibraryError, LibraryKind, StoredEntry};
use super::limits::RoleLimits;
use super::openapi::{Content, describe, describe_creation, returns};
use super::paths::ServicePaths;
use super::problem::Problem;
use super::scene_store;
use super::service::Service;

/// Returns the routes of the library.
pub fn routes() -> ApiRouter<Arc<Service>> {
    ApiRouter::new()
        .api_route(
            "/library",
            get_with(
                entries,
                describe("listLibrary", "The plans, scenes and robot files of the library, the latest first."),
            )
            .post_with(
                add,
                describe_creation::<LibraryEntry>(
                    "addLibraryEntry",
                    "Keep a plan, a stored scene or a robot file under a name, after a check.",
                ),
            ),
        )
        .api_route(
            "/library/{entry}/remove",
            post_with(
                remove,
                describe(
                    "removeLibraryEntry",
                    "Remove an entry from the library. Jobs and queued bodies keep what they use of it. The response \
                     has the entries that remain.",
                ),
            ),
        )
        .api_route(
            "/library/{entry}/file",
            get_with(file, |operation| {
                let words = "The content of an entry: a plan, a robot file, or the file of a scene.";
                let types = [
                    ("application/json", Content::Json),
                    ("application/octet-stream", Content::Bytes),
                    ("text/plain", Content::Text),
                ];
                operation.with(describe("getLibraryFile", words)).with(returns("The content.", &types))
            }),
        )
        .api_route(
            "/library/{entry}/thumbnail",
            get_with(picture, |operation| {
                let words = "The thumbnail of a plan or a scene. Empty for a robot file.";
                operation
                    .with(describe("getLibraryThumbnail", words))
                    .with(returns("The thumbnail.", &[("image/svg+xml", Content::Text)]))
            }),
        )
}

impl From<LibraryError> for Problem {
    fn from(error: LibraryError) -> Self {
        match error {
            LibraryError::NotFound(id) => Self::not_found("entry of the library", &id),
            LibraryError::Name(_) => Self::bad(error),
            LibraryError::NameTaken(..) | LibraryError::Full | LibraryError::TooLarge => Self::conflict(error),
            LibraryError::File { .. } | LibraryError::Write(_) => Self::internal(error),
        }
    }
}

/// New entry: a name, and one of a plan, a scene and a robot file. The scene of a plan can be given with it.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(example = serde_json::json!({ "name": "the floor", "scene": "964f007737e9afc6.toml" }))]
pub struct NewLibraryEntry {
    /// Name for people, 1 to 100 characters. Each kind has it once.
    #[schemars(length(min = 1, max = 100))]
    name: String,
    /// A plan, in the format that `growbot plan -o` writes.
    #[schemars(with = "Option<serde_json::Value>")]
    plan: Option<Box<RawValue>>,
    /// Name of a scene that `/scenes` has stored.
    scene: Option<String>,
    /// Text of a robot file.
    robot_file: Option<String>,
}

async fn entries(State(service): ServiceState) -> ApiResult<Vec<LibraryEntry>> {
    run_blocking(move || Ok(Json(service.shared.library.entries()?))).await
}

async fn add(
    State(service): ServiceState,
    Extension(limits): Extension<Arc<RoleLimits>>,
    JsonBody(wanted): JsonBody<NewLibraryEntry>,
) -> Result<(StatusCode, Json<LibraryEntry>), Problem> {
    let by = require_control(limits.access())?;
    let added = limits.compute(move |_| {
        let added = service.shared.library.add(checked(wanted, service.places())?);
        service.shared.audit.note(by, "library", "add", &added);
        Ok((StatusCode::CREATED, Json(added?)))
    });
    added.await
}

/// Returns the checked entry with its summary and its picture.
fn checked(wanted: NewLibraryEntry, places: &ServicePaths) -> Result<StoredEntry, Problem> {
    let NewLibraryEntry { name, plan, scene, robot_file } = wanted;
    let (kind, scene, text, summary, thumbnail) = match (plan, scene, robot_file) {
        (Some(written), scene, None) => {
            ensure_storable_plan(&written)?;
            let scene = scene.or_else(|| scene_of_plan(&written));
            let path = scene.as_ref().map(|scene| scene_store::find(places, scene)).transpose()?;
            let opened = plan_file::read_in_scene(written.get(), &name, None, path.as_deref());
            let LoadedPlan { robot, plan, .. } = opened.map_err(Problem::bad)?;
            let requirements = &plan.requirements;
            let summary =
                format!("{:.1} mm, {} layers, for {}", requirements.length, requirements.layers, robot.name());
            (LibraryKind::Plan, scene, written.get().to_owned(), summary, thumbnail::of_plan(&plan, &robot))
        }
        (None, Some(scene), None) => {
            let loaded = scene_file::load(&scene_store::find(places, &scene)?).map_err(Problem::bad)?;
            let bounds = loaded.bounding_box();
            let summary = bounds.as_ref().map_or_else(
                || "half spaces".to_owned(),
                |SceneBox { min_mm: [x, y, z], max_mm: [to_x, to_y, to_z] }| {
                    format!("{:.0} x {:.0} x {:.0} mm", to_x - x, to_y - y, to_z - z)
                },
            );
            (LibraryKind::Scene, Some(scene), String::new(), summary, thumbnail::of_scene(bounds.as_ref()))
        }
        (None, None, Some(text)) => {
            let robot = robot_file::parse(&text, &name).map_err(Problem::bad)?;
            let summary = format!("{}, bends of {:.0} mm", robot.name(), robot.description().planning_radius_mm);
            (LibraryKind::Robot, None, text, summary, String::new())
        }
        _ => return Err(Problem::bad("give one of \"plan\", \"scene\" and \"robot_file\" with the name")),
    };
    let entry = LibraryEntry { id: String::new(), kind, name, summary, scene, created_utc: utc_now() };
    Ok(StoredEntry { entry, text, thumbnail })
}

async fn remove(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Path(id): Path<String>,
) -> ApiResult<Vec<LibraryEntry>> {
    let by = require_control(access)?;
    run_blocking(move || {
        let remaining = service.shared.library.remove(&id);
        service.shared.audit.note(by, "library", "remove", &remaining);
        Ok(Json(remaining?))
    })
    .await
}

async fn file(State(service): ServiceState, Path(id): Path<String>) -> Result<Response, Problem> {
    run_blocking(move || {
        let StoredEntry { entry, text, .. } = service.shared.library.get(&id)?;
        Ok(match (entry.kind, entry.scene) {
            (LibraryKind::Plan, _) => ([(CONTENT_TYPE, "application/json")], text).into_response(),
            (LibraryKind::Scene, Some(scene)) => {
                let bytes = std::fs::read(scene_store::find(service.places(), &scene)?).map_err(Problem::internal)?;
                ([(CONTENT_TYPE, "application/octet-stream")], bytes).into_response()
            }
            _ => ([(CONTENT_TYPE, "text/plain; charset=utf-8")], text).into_response(),
        })
    })
    .await
}

async fn picture(State(service): ServiceState, Path(id): Path<String>) -> Result<Response, Problem> {
    run_blocking(move || {
        let thumbnail = service.shared.library.get(&id)?.thumbnail;
        Ok(([(CONTENT_TYPE, "image/svg+xml")], thumbnail).into_response())
    })
    .await
}
