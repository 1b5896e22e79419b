//! The thread on which requests other than stops and commands are handled. The thread that accepts connections reads
//! all requests and handles stops and commands itself, so these do not wait for other requests.

use std::{io, thread};

use axum::body::{Body, Bytes, HttpBody};
use axum::extract::{Request, State};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use futures_util::stream::unfold;
use http_body_util::{BodyExt, StreamBody};
use tokio::runtime::{Builder, Handle};
use tokio::sync::mpsc;
use tokio::task::JoinSet;

use super::problem::Problem;
use super::request_kind::RequestKind;

/// Maximum number of threads for files, the list of jobs, and computations.
const BLOCKING_THREADS: usize = 64;

/// Starts the thread for requests, and returns the handle of its runtime. The thread runs until the process ends.
///
/// # Errors
/// The operating system has no more threads or files.
pub fn start() -> io::Result<Handle> {
    let runtime = Builder::new_current_thread().enable_all().max_blocking_threads(BLOCKING_THREADS).build()?;
    let handle = runtime.handle().clone();
    let run = move || runtime.block_on(std::future::pending::<()>());
    thread::Builder::new().name("requests".to_owned()).spawn(run)?;
    Ok(handle)
}

/// Handles a request on the thread for requests, or on the calling thread if the request may be a stop. The request is
/// abandoned when its connection closes.
pub async fn handle_request(State(workers): State<Handle>, request: Request, next: Next) -> Response {
    if RequestKind::of(&request).is_urgent() {
        return next.run(request).await;
    }
    // The set abandons its task when it is dropped.
    let mut handled = JoinSet::new();
    handled.spawn_on(next.run(request), &workers);
    match handled.join_next().await {
        Some(Ok(response)) if HttpBody::size_hint(response.body()).exact().is_none() => {
            response.map(|body| forward(body, &workers))
        }
        Some(Ok(response)) => response,
        Some(Err(error)) => Problem::internal(error).into_response(),
        None => Problem::internal("the service could not handle the request: try again").into_response(),
    }
}

/// Returns a body with the same frames as `body`. Each frame is produced on the thread for requests while the previous
/// frame is being sent.
fn forward(mut body: Body, workers: &Handle) -> Body {
    let (sender, receiver) = mpsc::channel(1);
    workers.spawn(async move {
        loop {
            let frame = tokio::select! {
                frame = body.frame() => frame,
                // The connection is closed.
                () = sender.closed() => return,
            };
            let Some(frame) = frame else { return };
            if sender.send(frame).await.is_err() {
                return;
            }
        }
    });
    let frames = unfold(receiver, |mut receiver| async {
        let frame: Result<hyper::body::Frame<Bytes>, axum::Error> = receiver.recv().await?;
        Some((frame, receiver))
    });
    Body::new(StreamBody::new(frames))
}
