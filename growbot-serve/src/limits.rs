//! Limits of the resources that the clients of one role use at a time, so that no client blocks a client of another
//! role or delays a command to a robot. The roles are read-only pages, pages that can send commands, and growbot's
//! commands.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use axum::body::{Body, HttpBody, to_bytes};
use axum::extract::{Extension, Request, State};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use http_body_util::{BodyExt, LengthLimitError};
use rustix::process::setpriority_process;
use tokio::sync::{OwnedSemaphorePermit, Semaphore, oneshot};
use tokio::time::timeout;

use super::access::Access;
use super::connections::ConnectionLimiter;
use super::problem::Problem;
use crate::request_kind::{RequestKind, SHORT};

/// Maximum number of open streams of events for each role.
const STREAMS: usize = 64;
/// Maximum number of HTTP bodies longer than [`SHORT`] that are read or handled at a time, for each role.
const LONG_BODIES: usize = 2;
/// Maximum numbers of plans and pages that are computed at a time: for read-only clients, and for each other role.
const COMPUTATIONS: [usize; 2] = [2, 4];
/// Maximum numbers of responses with bodies longer than [`SHORT`] that are sent at a time: for read-only clients, and
/// for each other role.
const DOWNLOADS: [usize; 2] = [8, 16];
/// Maximum duration of the computation of a plan or a page.
const COMPUTATION_TIME: Duration = Duration::from_secs(30);

/// Niceness of the threads that compute. Threads that drive robots or stop them have the niceness 0, so they run first.
pub(super) const NICENESS: i32 = 10;

/// Limits of the resources that the clients of one role use.
pub struct RoleLimits {
    access: Access,
    streams: Arc<Semaphore>,
    long_bodies: Arc<Semaphore>,
    computations: Arc<Semaphore>,
    downloads: Arc<Semaphore>,
}

/// Permit for a stream of events. The permit is released when its last clone is dropped.
#[derive(Clone)]
pub struct StreamPermit(#[expect(dead_code, reason = "it is held")] Arc<OwnedSemaphorePermit>);

impl RoleLimits {
    /// Creates the limits of the role with these rights.
    pub fn new(access: Access) -> Arc<Self> {
        let of_role = usize::from(access != Access::View);
        let places = |count: usize| Arc::new(Semaphore::new(count));
        Arc::new(Self {
            access,
            streams: places(STREAMS),
            long_bodies: places(LONG_BODIES),
            computations: places(COMPUTATIONS[of_role]),
            downloads: places(DOWNLOADS[of_role]),
        })
    }

    /// Returns the rights of the role.
    pub fn access(&self) -> Access {
        self.access
    }

    /// Returns a permit for a long response. It is held until the response has been sent.
    pub fn permit_download(&self) -> Result<OwnedSemaphorePermit, Problem> {
        let permit = Arc::clone(&self.downloads).try_acquire_owned();
        permit.map_err(|_| {
            let count = DOWNLOADS[usize::from(self.access != Access::View)];
            Problem::busy(&format!("the service already sends {count} long responses"))
        })
    }

    /// Waits until the number of running computations allows one more, then runs the computation on a thread of its
    /// own. The computation must call [`Computation::check`] regularly, and end if that returns an error: when its time
    /// is over, or when the returned future is dropped because the client has disconnected.
    pub async fn compute<T: Send + 'static>(
        &self,
        what: impl FnOnce(&Computation) -> Result<T, Problem> + Send + 'static,
    ) -> Result<T, Problem> {
        let turn = Arc::clone(&self.computations).acquire_owned().await.map_err(Problem::internal)?;
        let requester = ComputationRequester::default();
        let computation = Computation::new(&requester.0);
        let (reply, computed) = oneshot::channel();
        let run = move || {
            let _turn = turn;
            // Without a lower priority the computation only slows down others.
            let _ = setpriority_process(None, NICENESS);
            // The requester may have gone.
            let _ = reply.send(what(&computation));
        };
        thread::Builder::new().name("computation".to_owned()).spawn(run).map_err(Problem::internal)?;
        computed.await.unwrap_or_else(|_| {
            Err(Problem::internal("a computation of the service has failed: see the messages of the service"))
        })
    }
}

/// Deadline of a computation, and the flag that the client that requested it has gone.
pub struct Computation {
    deadline: Instant,
    is_abandoned: Arc<AtomicBool>,
}

impl Computation {
    /// Sets the deadline of a computation that starts now. The computation is abandoned once the flag `is_abandoned` is
    /// set.
    pub fn new(is_abandoned: &Arc<AtomicBool>) -> Self {
        Self { deadline: Instant::now() + COMPUTATION_TIME, is_abandoned: Arc::clone(is_abandoned) }
    }

    /// Returns the time at which the computation has to end.
    pub fn deadline(&self) -> Instant {
        self.deadline
    }

    /// Returns an error if the computation has to end, because its client has gone or its deadline is over.
    pub fn check(&self) -> Result<(), Problem> {
        if self.is_abandoned.load(Ordering::Relaxed) {
            return Err(Problem::conflict("the client that sent the request has closed the connection"));
        }
        if Instant::now() >= self.deadline {
            return Err(Problem::bad(format!(
                "no plan was found and checked within {} s: give fewer waypoints or a simpler scene, or send a plan",
                COMPUTATION_TIME.as_secs()
            )));
        }
        Ok(())
    }
}

/// Guard for the client that requested a computation. The server drops the guard when the connection closes, which
/// abandons the computation.
#[derive(Default)]
struct ComputationRequester(Arc<AtomicBool>);

impl Drop for ComputationRequester {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Reads the whole body of a request before it is handled. Rejects a body that is too long or too slow. The body of a
/// stop is ignored.
pub async fn buffer_body(
    State(connections): State<Arc<ConnectionLimiter>>,
    Extension(limits): Extension<Arc<RoleLimits>>,
    request: Request,
    next: Next,
) -> Response {
    let kind = RequestKind::of(&request);
    let max = kind.max_body(limits.access, request.uri().path());
    let (parts, body) = request.into_parts();
    let length = HttpBody::size_hint(&body);
    if kind == RequestKind::Stop || length.exact() == Some(0) {
        return next.run(Request::from_parts(parts, Body::empty())).await;
    }
    if length.lower() > max as u64 {
        return Problem::too_long(max).into_response();
    }
    let mut _place = None;
    if max > SHORT && length.upper().is_none_or(|length| length > SHORT as u64) {
        match Arc::clone(&limits.long_bodies).try_acquire_owned() {
            Ok(place) => _place = Some(place),
            Err(_) => {
                return Problem::busy(&format!("the service already handles {LONG_BODIES} long requests"))
                    .into_response();
            }
        }
    }
    let limit = connections.request_timeout();
    match timeout(limit, to_bytes(body, max)).await {
        Ok(Ok(bytes)) => next.run(Request::from_parts(parts, bytes.into())).await,
        Ok(Err(error)) if is_too_long(&error) => Problem::too_long(max).into_response(),
        Ok(Err(error)) => Problem::bad(format!("the request was interrupted: {error}")).into_response(),
        Err(_) => Problem::too_slow(limit).into_response(),
    }
}

fn is_too_long(error: &axum::Error) -> bool {
    std::error::Error::source(error).is_some_and(<dyn std::error::Error>::is::<LengthLimitError>)
}

/// Handles a request. A stream of events or a long response needs a permit, and is rejected if all permits are in use.
pub async fn limit_concurrency(
    Extension(limits): Extension<Arc<RoleLimits>>,
    mut request: Request,
    next: Next,
) -> Response {
    if RequestKind::of(&request) == RequestKind::Stream {
        let Ok(place) = Arc::clone(&limits.streams).try_acquire_owned() else {
            return Problem::busy(&format!("{STREAMS} event streams of the service are already open")).into_response();
        };
        let permit = StreamPermit(Arc::new(place));
        request.extensions_mut().insert(permit.clone());
        return holding(permit, next.run(request).await);
    }
    let response = next.run(request).await;
    if HttpBody::size_hint(response.body()).exact().is_none_or(|length| length <= SHORT as u64) {
        return response;
    }
    match limits.permit_download() {
        Ok(permit) => holding(permit, response),
        Err(problem) => problem.into_response(),
    }
}

/// Returns the response, which then holds the permit until its body has been sent.
pub fn holding<P: Send + Sync + 'static>(permit: P, response: Response) -> Response {
    let permit = Arc::new(permit);
    response.map(|body| {
        Body::new(body.map_frame(move |frame| {
            let _held = &permit;
            frame
        }))
    })
}

#[cfg(test)]
mod tests {
    use std::future::Future;
    use std::sync::mpsc;
    use std::task::{Context, Waker};

    use super::*;
    use crate::audit::CommandSource;

    fn runtime() -> tokio::runtime::Runtime {
        tokio::runtime::Builder::new_current_thread().enable_all().build().unwrap()
    }

    #[test]
    fn computations_of_one_role_do_not_hold_up_those_of_another() {
        let (view, control) = (RoleLimits::new(Access::View), RoleLimits::new(Access::Control(CommandSource::Web)));
        runtime().block_on(async {
            let (ends, begun) = (mpsc::channel::<()>(), mpsc::channel());
            let held = Arc::new(std::sync::Mutex::new(ends.1));
            let mut computing = tokio::task::JoinSet::new();
            for _ in 0..4 {
                let (view, begun, held) = (Arc::clone(&view), begun.0.clone(), Arc::clone(&held));
                computing.spawn(async move {
                    let wait = move |_: &Computation| {
                        begun.send(()).unwrap();
                        // It computes until the test ends.
                        let _ = held.lock().unwrap().recv();
                        Ok(())
                    };
                    view.compute(wait).await
                });
            }
            let begun = tokio::task::spawn_blocking(move || (begun.1.recv(), begun.1.recv(), begun.1)).await.unwrap();
            assert_eq!(control.compute(|_| Ok(7)).await, Ok(7));
            assert!(begun.2.try_recv().is_err(), "two at a time");
            drop(ends.0);
            while let Some(computed) = computing.join_next().await {
                computed.unwrap().unwrap();
            }
        });
    }

    #[test]
    fn a_computation_ends_with_its_requester() {
        let limits = RoleLimits::new(Access::View);
        let runtime = runtime();
        let _entered = runtime.enter();
        let ((begins, begun), (ends, ended)) = (mpsc::channel(), mpsc::channel());
        let mut computing = Box::pin(limits.compute(move |computation| {
            computation.check()?;
            begins.send(()).unwrap();
            let problem = std::iter::repeat_with(|| computation.check()).find_map(Result::err).unwrap();
            ends.send(problem.detail.clone()).unwrap();
            Err::<(), _>(problem)
        }));
        assert!(computing.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_pending());
        begun.recv().unwrap();
        drop(computing);
        assert_eq!(ended.recv().unwrap(), "the client that sent the request has closed the connection");
    }

    #[test]
    fn a_computation_ends_at_its_deadline() {
        let computation = Computation { deadline: Instant::now(), is_abandoned: Arc::default() };
        let problem = computation.check().unwrap_err();
        assert!(problem.detail.contains("no plan was found and checked within 30 s"), "{}", problem.detail);
    }
}
