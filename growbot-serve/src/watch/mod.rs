//! A live page of an active growth, which also shows the plan. It is served on this machine.
//!
//! - [`WatchPage`] serves the service's page for the growth of this process, without a service. `watched_growth` is
//!   that growth as the source of the page.
//! - `growth_tracker` tracks the state of the growth, and computes the part that a page has not yet received.
//! - `live_growth` has the state that the pages and the thread that follows the growth share, and its streams of
//!   events.
//! - `sockets` are the WebSockets of pages.
//! - `heartbeat` has the heartbeats, which show that the data of a page are current, and the check of an order's age.
//! - `origin_check` rejects requests from other pages. `allowed_origins` are the reverse proxies whose pages it allows.
//! - growbot-pictures/viewer/src/live.js is the client.
//!
//! Updates are events, at most five a second. A page that connects late or reconnects receives the whole state that it
//! does not have, so no queue of events can grow. On `sim` a growth takes seconds, so its time can be limited to a
//! multiple of real time ([`growbot_sim::port`], `paced.rs`).

pub(crate) mod allowed_origins;
mod growth_tracker;
pub(crate) mod heartbeat;
pub(crate) mod live_growth;
pub(crate) mod origin_check;
pub(crate) mod sockets;
mod watched_growth;

use std::io;
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use axum::Router;
use axum::response::Redirect;
use axum::routing::get;
use growbot_client::growth::CommandQueue;
use growbot_client::status::RobotStatus;
use growbot_core::layer_bytes::LayerBytes;
use growbot_pictures::view::{Subject, ViewError};
use growbot_plan::job::Job;
use growbot_plan::run_log::GrowthResult;
use growbot_remote::PREFIX;
use tokio::sync::oneshot;
use tokio::time::sleep;

use self::live_growth::LiveGrowth;
use self::watched_growth::{JOB, WatchedGrowth};
use crate::config::ServeEntry;
use crate::connections::ConnectionLimiter;
use crate::live_routes;
use crate::page_listener::listen;
use crate::server_error::ServerError;
use crate::site::Site;
use crate::tokens::new_token;

/// Maximum time for which the program waits at the end until the open pages have received the result.
const LAST_WORDS: Duration = Duration::from_secs(3);
/// Maximum time in which open connections can close by themselves when the server stops.
const TO_CLOSE: Duration = Duration::from_millis(500);
/// Interval of the checks whether pages or connections are still open.
const POLL_INTERVAL: Duration = Duration::from_millis(20);

/// Errors that prevent a live page.
#[derive(Debug, thiserror::Error)]
pub enum WatchError {
    /// The address cannot be bound.
    #[error(transparent)]
    Listen(#[from] ServerError),
    /// The server does not start.
    #[error("cannot start the page's server ({0})")]
    Server(io::Error),
    /// The page cannot be created.
    #[error("{0}")]
    View(#[from] ViewError),
}

/// Server of a live page of the growth of this process. It stops when it is dropped.
pub struct WatchPage {
    growth: Arc<WatchedGrowth>,
    address: String,
    server: Option<(oneshot::Sender<()>, JoinHandle<()>)>,
}

impl WatchPage {
    /// Serves the live page of a plan and its job on this port. Port 0 stands for any free port. `known` are the layers
    /// that have already been built, and `robot` is the part of the robot's status that its board does not report:
    /// port, kind and pace. The page can send commands only if `orders`, the queue of commands, is given.
    ///
    /// # Errors
    /// [`WatchError`].
    pub fn start(
        subject: &Subject,
        job: &Job,
        known: &[Option<LayerBytes>],
        robot: RobotStatus,
        orders: Option<Arc<CommandQueue>>,
        port: u16,
    ) -> Result<Self, WatchError> {
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(WatchError::Server)?;
        let listener = runtime.block_on(listen(None, port))?;
        let bound = listener.local_addr().map_err(WatchError::Server)?;
        let token = new_token().map_err(WatchError::Server)?;
        let growth = Arc::new(WatchedGrowth::new(subject, job, known, robot, orders)?);
        let to_growth = Redirect::to(&format!("{}/jobs/{JOB}/live/", PREFIX.trim_start_matches('/')));
        let page = Router::new().route("/", get(|| async move { to_growth }));
        let site = Site::new(Arc::clone(&growth), page, live_routes::routes(), runtime.handle().clone());
        let door = ConnectionLimiter::new(ServeEntry::default().request());
        let pages = site.for_tokens(&[(&token, growth.access())], &door, allowed_origins::AllowedOrigins::default());
        let (stop, stopped) = oneshot::channel();
        let serve = async move {
            tokio::select! { _ = Arc::clone(&door).serve(listener, pages) => {}, _ = stopped => {} }
            let began = Instant::now();
            while door.has_connections() && began.elapsed() < TO_CLOSE {
                sleep(POLL_INTERVAL).await;
            }
        };
        let thread = thread::Builder::new()
            .name("watch".to_string())
            .spawn(move || runtime.block_on(serve))
            .map_err(WatchError::Server)?;
        Ok(Self { growth, address: format!("http://{bound}/{token}/"), server: Some((stop, thread)) })
    }

    /// Returns the URL of the page.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Returns the state of the growth that the page shows.
    pub fn growth(&self) -> &LiveGrowth {
        &self.growth.live
    }

    /// Sends the result to the pages, in the format of `growbot grow --json`. Waits at most 3 s until the open pages
    /// have received it.
    pub fn end(self, result: GrowthResult) {
        self.growth.live.end(result);
        let began = Instant::now();
        while self.growth.live.is_followed() && began.elapsed() < LAST_WORDS {
            thread::sleep(POLL_INTERVAL);
        }
    }
}

impl Drop for WatchPage {
    fn drop(&mut self) {
        if let Some((stop, thread)) = self.server.take() {
            let _ = stop.send(());
            let _ = thread.join();
        }
    }
}
