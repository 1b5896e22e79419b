//! Routes of the API for cameras: the current picture of a robot, and the pictures of the layers of a job.

use std::sync::Arc;

use aide::OperationOutput;
use aide::axum::ApiRouter;
use aide::axum::routing::get_with;
use axum::Json;
use axum::extract::{Path, State};
use axum::http::header::{CACHE_CONTROL, CONTENT_TYPE, X_CONTENT_TYPE_OPTIONS};
use axum::response::{IntoResponse, Response};

use super::handler::{ApiResult, ServiceState, find_robot, found_job, run_blocking};
use super::openapi::{Content, describe, returns};
use super::picture::{Picture, PictureFormat};
use super::problem::Problem;
use super::service::Service;

/// Media types of pictures.
const PICTURE_TYPES: [(&str, Content); 2] =
    [(PictureFormat::Jpeg.media_type(), Content::Bytes), (PictureFormat::Png.media_type(), Content::Bytes)];

/// Returns the routes of cameras.
pub fn routes() -> ApiRouter<Arc<Service>> {
    let picture = || returns("The picture.", &PICTURE_TYPES);
    ApiRouter::new()
        .api_route("/cameras", get_with(cameras, describe("listCameras", "Names of the robots that have a camera.")))
        .api_route(
            "/robots/{robot}/camera",
            get_with(camera, |operation| {
                let words = "The next picture of the robot's camera. All clients that wait for one share it.";
                operation.with(describe("getCameraPicture", words)).with(picture())
            }),
        )
        .api_route(
            "/jobs/{job}/snapshots",
            get_with(
                snapshots,
                describe("listSnapshots", "The layers of a job of which a picture is stored, in order."),
            ),
        )
        .api_route(
            "/jobs/{job}/snapshots/{layer}",
            get_with(snapshot, |operation| {
                operation
                    .with(describe("getSnapshot", "The picture of a layer, taken when it was laid."))
                    .with(picture())
            }),
        )
}

/// The operations describe their pictures themselves.
impl OperationOutput for Picture {
    type Inner = Self;
}

impl IntoResponse for Picture {
    fn into_response(self) -> Response {
        let headers = [
            (CONTENT_TYPE, self.format.media_type()),
            (X_CONTENT_TYPE_OPTIONS, "nosniff"),
            (CACHE_CONTROL, "no-store"),
        ];
        (headers, self.bytes).into_response()
    }
}

async fn cameras(State(service): ServiceState) -> Json<Vec<String>> {
    Json(service.shared.cameras.robots())
}

async fn camera(State(service): ServiceState, Path(name): Path<String>) -> Result<Picture, Problem> {
    find_robot(&service, &name)?;
    let camera = service.shared.cameras.camera(&name).ok_or_else(|| Problem::not_found("camera of robot", &name))?;
    camera.picture().await.map_err(Problem::bad_gateway)
}

async fn snapshots(State(service): ServiceState, Path(job): Path<String>) -> ApiResult<Vec<u32>> {
    run_blocking(move || {
        let job = found_job(&service, &job)?;
        Ok(Json(service.shared.cameras.snapshots.layers(&job.id)))
    })
    .await
}

async fn snapshot(State(service): ServiceState, Path((job, layer)): Path<(String, u32)>) -> Result<Picture, Problem> {
    run_blocking(move || {
        let job = found_job(&service, &job)?;
        let found = service.shared.cameras.snapshots.get(&job.id, layer);
        found.ok_or_else(|| Problem::not_found("picture of layer", &layer.to_string()))
    })
    .await
}
