//! Types and functions that the handlers of all routes use.

use std::sync::Arc;

use axum::Json;
use axum::extract::State;
use growbot_remote::api::Job;
use tokio::task::spawn_blocking;

use super::problem::Problem;
use super::robot_worker::RobotWorker;
use super::service::Service;

pub(super) type ServiceState = State<Arc<Service>>;

pub(super) type ApiResult<T> = Result<Json<T>, Problem>;

pub(super) fn find_robot<'a>(service: &'a Service, name: &str) -> Result<&'a Arc<RobotWorker>, Problem> {
    service.robot(name).ok_or_else(|| Problem::not_found("robot", name))
}

pub(super) fn found_job(service: &Service, id: &str) -> Result<Job, Problem> {
    service.job(id).ok_or_else(|| Problem::not_found("job", id))
}

/// Runs a slow task on a thread of its own, so that it does not block the server.
pub(super) async fn run_blocking<T: Send + 'static>(
    what: impl FnOnce() -> Result<T, Problem> + Send + 'static,
) -> Result<T, Problem> {
    spawn_blocking(what).await.map_err(Problem::internal)?
}
