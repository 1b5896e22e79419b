//! A live page of an active growth, which also shows the plan. It is served on this machine.
//!
//! - [`WatchPage`] is the page's server and receives the growth's events.
//! - `growth_tracker` tracks the state of the growth, and computes the part that a page has not yet received.
//! - `live_growth` has the state that the pages and the thread that follows the growth share.
//! - `server` is the HTTP server, on the loopback interface only. `sockets` are the page's WebSockets.
//! - `heartbeat` has the heartbeats, which show that the data of a page are current, and the check of an order's age.
//! - `origin_check` rejects requests from other pages. `allowed_origins` are the reverse proxies whose pages it allows.
//! - growbot-pictures/viewer/src/live.js is the client.
//!
//! Updates are server-sent events, at most five a second. A page that connects late or reconnects receives the whole
//! state that it does not have, so no queue of events can grow. On `sim` a growth takes seconds, so its time can be
//! limited to a multiple of real time ([`growbot_sim::port`], `paced.rs`).

pub(crate) mod allowed_origins;
mod growth_tracker;
pub(crate) mod heartbeat;
mod live_growth;
pub(crate) mod origin_check;
pub(crate) mod server;
pub(crate) mod sockets;

use std::io;
use std::net::{Ipv4Addr, TcpListener};
use std::sync::Arc;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use growbot_client::growth::CommandQueue;
use growbot_core::layer_bytes::LayerBytes;
use growbot_pictures::view::page::PageAccess;
use growbot_pictures::view::{Subject, ViewError, page};
use growbot_plan::job::{Job, JobEvent};
use growbot_plan::run_log::GrowthResult;
use tokio::sync::oneshot;

pub use self::live_growth::LiveGrowth;
use self::server::WatchState;

/// Maximum time for which the program waits at the end until the open pages have received the result.
const LAST_WORDS: Duration = Duration::from_secs(3);

/// Errors that prevent a live page.
#[derive(Debug, thiserror::Error)]
pub enum WatchError {
    /// The address cannot be bound.
    #[error("cannot serve the page at 127.0.0.1:{port} ({error})")]
    Address {
        /// Requested port. 0 stands for any free port.
        port: u16,
        /// Error of the operating system.
        error: io::Error,
    },
    /// The operating system provides no random numbers for the address.
    #[error("cannot get random numbers for a secret address ({0})")]
    Random(getrandom::Error),
    /// The server does not start.
    #[error("cannot start the page's server ({0})")]
    Server(io::Error),
    /// The page cannot be created.
    #[error("{0}")]
    View(#[from] ViewError),
}

/// Server of a live page of a growth. It stops when it is dropped.
pub struct WatchPage {
    shared: Arc<WatchState>,
    address: String,
    server: Option<(oneshot::Sender<()>, JoinHandle<()>)>,
}

impl WatchPage {
    /// Serves the live page of a plan and its job on this port. Port 0 stands for any free port. `known` are the layers
    /// that have already been built. The page can send commands only if `orders`, the queue of commands, is given.
    ///
    /// # Errors
    /// [`WatchError`].
    pub fn start(
        subject: &Subject,
        job: &Job,
        known: &[Option<LayerBytes>],
        orders: Option<Arc<CommandQueue>>,
        port: u16,
    ) -> Result<Self, WatchError> {
        let of_address = |error| WatchError::Address { port, error };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(of_address)?;
        listener.set_nonblocking(true).map_err(of_address)?;
        let bound = listener.local_addr().map_err(of_address)?;
        let token = random_token().map_err(WatchError::Random)?;
        let shared = Arc::new(WatchState {
            page: page::render_live(subject, if orders.is_some() { PageAccess::Control } else { PageAccess::View })?,
            token,
            live: LiveGrowth::new(job, known, orders),
        });
        let address = format!("http://{bound}/{}/", shared.token);
        let (stop, stopped) = oneshot::channel();
        let serving = Arc::clone(&shared);
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build().map_err(WatchError::Server)?;
        let listener = {
            let _inside = runtime.enter();
            tokio::net::TcpListener::from_std(listener).map_err(WatchError::Server)?
        };
        let thread = thread::Builder::new()
            .name("watch".to_string())
            .spawn(move || runtime.block_on(server::serve(listener, serving, stopped)))
            .map_err(WatchError::Server)?;
        Ok(Self { shared, address, server: Some((stop, thread)) })
    }

    /// Returns the URL of the page.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Sets the pace of the robot's clock, in multiples of real time, from which the expected end of the growth is
    /// computed. `None` if the pace is not known.
    pub fn set_pace(&self, pace: Option<f64>) {
        self.shared.live.set_pace(pace);
    }

    /// Updates the state of the growth with an event, and sends the change to the pages.
    pub fn ingest(&self, event: &JobEvent) {
        self.shared.live.ingest(event);
    }

    /// Shows a problem with this program's own files on the pages, or clears it.
    pub fn set_warning(&self, words: Option<String>) {
        self.shared.live.set_warning(words);
    }

    /// Sends the result to the pages, in the format of `growbot grow --json`. Waits at most 3 s until the open pages
    /// have received it.
    pub fn end(self, result: GrowthResult) {
        self.shared.live.end(result);
        let began = Instant::now();
        while self.shared.live.changes.receiver_count() > 0 && began.elapsed() < LAST_WORDS {
            thread::sleep(Duration::from_millis(20));
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

/// Returns 128 random bits as 32 hexadecimal digits.
pub(crate) fn random_token() -> Result<String, getrandom::Error> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}
