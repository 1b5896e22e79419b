//! Routes of the API for plans, their pages, and the scenes that they avoid.

use std::sync::Arc;

use axum::body::Bytes;
use axum::extract::{Path, Query, State};
use axum::response::Html;
use axum::{Extension, Json};
use growbot_core::robot::Robot;
use growbot_core::slicing::{Slicing, layers};
use growbot_pictures::view::{NamedScene, Subject, page, thinned};
use growbot_plan::plan::Plan;
use growbot_plan::plan_deviation::centreline;
use growbot_plan::plan_file::PlanFile;
use growbot_remote::api::GrowRequest;
use growbot_scene::scene_file::SceneBox;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::access::{Access, require_control};
use super::grow_request::{PlanInScene, resolve_request};
use super::handler::{ApiResult, ServiceState, find_robot};
use super::json_body::JsonBody;
use super::limits::RoleLimits;
use super::problem::Problem;
use super::scene_store;

/// Maximum number of points of a centreline after its start.
const MAX_CENTRELINE_POINTS: usize = 200;

/// Returns the name of the file of a plan's scene, without its directory. Empty for a plan without a scene.
pub fn scene_name(plan: &Plan) -> &str {
    plan.scene.as_ref().map_or("", |scene| scene.file.rsplit('/').next().unwrap_or_default())
}

/// The robot to plan for, and what the response has.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct PlanQuery {
    /// Name of the robot in the service.
    #[schemars(example = &"lab")]
    robot: String,
    /// `none` to make no page of the plan, for example while a person drags the goal.
    #[serde(default)]
    page: PlanPage,
}

/// The page of a plan that the service makes.
#[derive(Debug, Default, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
enum PlanPage {
    /// A page that the service keeps.
    #[default]
    Kept,
    /// No page.
    None,
}

/// A plan and its page.
#[derive(Debug, Serialize, JsonSchema)]
pub struct PlanResponse {
    /// The plan, in the format of `growbot plan --json`.
    plan: Value,
    /// Points of the planned centreline, from the start to the goal, mm: x, y, z. At most 201.
    centreline_mm: Vec<[f64; 3]>,
    /// Path of the plan's page, relative to the address of this API. The service keeps only the latest pages. `null` if
    /// no page is made.
    view_path: Option<String>,
}

pub async fn new_plan(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Extension(limits): Extension<Arc<RoleLimits>>,
    Query(PlanQuery { robot, page: plan_page }): Query<PlanQuery>,
    JsonBody(wanted): JsonBody<GrowRequest>,
) -> ApiResult<PlanResponse> {
    let keeper = Arc::clone(find_robot(&service, &robot)?);
    let computed = limits.compute(move |computation| {
        let robot = keeper.description().map_err(Problem::conflict)?;
        let PlanInScene { plan, scene } =
            resolve_request(&wanted, &robot, &|job| keeper.last_body(job), service.places(), access, computation)?;
        let view_path = match plan_page {
            PlanPage::None => None,
            PlanPage::Kept => {
                let scene = scene.as_ref().map(|loaded| NamedScene { file: scene_name(&plan), scene: &loaded.scene });
                let subject = Subject { name: "preview", robot: &robot, plan: &plan, run: None, laid: None, scene };
                let page = page::render(&subject).map_err(Problem::bad)?;
                Some(format!("plans/{}/view", service.shared.keep_preview(page.into())))
            }
        };
        let centreline_mm = planned_centreline(&plan, &robot);
        let plan = serde_json::to_value(PlanFile::with_robot(&plan, &robot)).map_err(Problem::internal)?;
        Ok(Json(PlanResponse { plan, centreline_mm, view_path }))
    });
    computed.await
}

/// Returns points of a plan's centreline, mm, with its start and its end.
fn planned_centreline(plan: &Plan, robot: &Robot) -> Vec<[f64; 3]> {
    let layers = layers(&plan.path, robot, Slicing::Exact).map(|sliced| sliced.layer);
    thinned(&centreline(&plan.start.frame(), layers), MAX_CENTRELINE_POINTS).into_iter().map(Into::into).collect()
}

/// Name of a scene's file.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct SceneUploadQuery {
    /// File name. Its extension is the format: .toml, .stl, .obj, .ply, .glb or .pcd.
    #[schemars(example = &"floor.toml")]
    name: String,
}

/// A scene that the service has stored.
#[derive(Debug, Serialize, JsonSchema)]
pub struct SceneUploadResponse {
    /// Name of the scene, for the field `scene` of a plan or job request.
    scene: String,
    /// Bounding box of the scene's obstacles as they were read, without half spaces. `null` if the scene has only half
    /// spaces.
    #[serde(rename = "box")]
    bounds: Option<SceneBox>,
}

pub async fn new_scene(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Extension(limits): Extension<Arc<RoleLimits>>,
    Query(SceneUploadQuery { name }): Query<SceneUploadQuery>,
    bytes: Bytes,
) -> ApiResult<SceneUploadResponse> {
    require_control(access)?;
    let stored = limits.compute(move |_| {
        let (scene, bounds) = scene_store::store(service.places(), &name, &bytes)?;
        Ok(Json(SceneUploadResponse { scene, bounds }))
    });
    stored.await
}

pub async fn view_plan(State(service): ServiceState, Path(number): Path<u64>) -> Result<Html<Bytes>, Problem> {
    let page = service.shared.preview(number);
    page.map(Html)
        .ok_or_else(|| Problem::not_found("page (only the latest are kept: plan again) of plan", &number.to_string()))
}
