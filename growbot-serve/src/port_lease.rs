//! Leases of a robot's port. A command that communicates with the board itself, such as `growbot console`, has the port
//! as long as it keeps its request open. Meanwhile the service handles only the emergency stop.

use std::convert::Infallible;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::Receiver;
use std::time::Duration;

use axum::extract::{Path, State};
use axum::response::sse::{Event, KeepAlive, Sse};
use axum::response::{IntoResponse, Response};
use axum::{Extension, Json};
use growbot_remote::api::LeaseRequest;
use tokio::task::spawn_blocking;

use super::access::Access;
use super::audit::CommandSource;
use super::handler::ServiceState;
use super::problem::Problem;
use super::robot_error::{ConnectionError, RobotRequestError};
use super::robot_request::{PendingRequest, PortLease, RobotRequest};
use super::robot_worker::RobotWorker;

/// Timeout of a lease request. The robot may be busy with a status request before it closes the port.
const LEASE_TIMEOUT: Duration = Duration::from_secs(10);
/// Interval at which the service checks whether the lease has ended.
const LEASE_POLL_INTERVAL: Duration = Duration::from_millis(50);

/// Guard of a lease. The lease ends when the guard is dropped.
struct LeaseEndGuard(Arc<AtomicBool>);

impl Drop for LeaseEndGuard {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// Leases the port of a robot without a job to a growbot command, until the command closes the request.
pub async fn lease_port(
    State(service): ServiceState,
    Extension(access): Extension<Access>,
    Path(name): Path<String>,
    Json(LeaseRequest { holder: to }): Json<LeaseRequest>,
) -> Result<Response, Problem> {
    if access != Access::Control(CommandSource::Socket) {
        return Err(Problem::forbidden("the service releases a port only to commands on its own machine"));
    }
    let keeper = Arc::clone(service.robot(&name).ok_or_else(|| Problem::not_found("robot", &name))?);
    let held = LeaseEndGuard(Arc::default());
    let loan = PortLease { to: to.clone(), is_over: Arc::clone(&held.0) };
    let outcome = spawn_blocking(move || {
        let _begins = keeper.lock_job_start();
        let outcome = keeper.ensure_idle().and_then(|()| keeper.request(RobotRequest::Lend(loan), LEASE_TIMEOUT));
        service.shared.audit.note(CommandSource::Socket, &name, &format!("lend to {to}"), &outcome);
        outcome
    });
    outcome.await.map_err(Problem::internal)??;
    // The stream sends no events. It ends when the client disconnects.
    let nothing = futures_util::stream::unfold(held, |held| async move {
        std::future::pending::<()>().await;
        Some((Ok::<_, Infallible>(Event::default()), held))
    });
    Ok(Sse::new(nothing).keep_alive(KeepAlive::new().interval(Duration::from_secs(1))).into_response())
}

impl RobotWorker {
    /// Waits until the lease of the closed port ends, and rejects all requests to the robot's thread in the meantime.
    /// Emergency stops are still sent, by a thread of their own.
    pub(super) fn wait_for_lease_end(&self, loan: &PortLease, requests: &Receiver<PendingRequest>) {
        let reason = Arc::new(ConnectionError::Leased(loan.to.clone()));
        self.update_state(|known| known.connection_error = Some(Arc::clone(&reason)));
        while !loan.is_over.load(Ordering::Acquire) {
            let Ok(pending) = requests.recv_timeout(LEASE_POLL_INTERVAL) else { continue };
            let (robot, reason) = (self.name.clone(), Arc::clone(&reason));
            self.respond_without_board(pending, RobotRequestError::Leased { robot, reason });
        }
    }
}
