//! A growth under way as a page on this machine: the view of its plan, live.
//!
//! - [`Watch`]: the page's address, and its events;
//! - `watched`: how the growth stands, and what of it a page does not know yet;
//! - `server`: HTTP, on the loopback interface alone;
//! - `guard`: who gets an answer;
//! - growbot-pictures/viewer/src/live.js: the other end.
//!
//! Updates are server-sent events, five a second at most. A page that comes late, or comes back, gets everything that
//! it lacks, so no queue can grow. On `sim` a growth takes seconds, so its time can be limited to a multiple of real
//! time ([`growbot_sim::port`], `paced.rs`).

pub(crate) mod guard;
pub(crate) mod server;
mod watched;

use std::io;
use std::net::{Ipv4Addr, TcpListener};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use growbot_client::growth::{Job, JobEvent, Orders};
use growbot_client::run_log::GrowthResult;
use growbot_core::layer_bytes::LayerBytes;
use tokio::sync::{oneshot, watch};

use self::watched::Watched;
use growbot_pictures::view::{Subject, ViewError, page};

/// Open pages are given so long to hear the end.
const LAST_WORDS: Duration = Duration::from_secs(3);

/// Why there is nothing to watch.
#[derive(Debug, thiserror::Error)]
pub enum WatchError {
    /// The address is taken.
    #[error(
        "cannot serve the page at 127.0.0.1:{port} ({error}): choose another port with --watch-port, or leave it out"
    )]
    Address {
        /// The port asked for, 0 for any.
        port: u16,
        /// The system's reason.
        error: io::Error,
    },
    /// The system gives no random numbers for the address.
    #[error("the system gives no random numbers for a secret address ({0}): leave --watch out")]
    Random(getrandom::Error),
    /// The server does not start.
    #[error("cannot start the page's server ({0}): leave --watch out")]
    Server(io::Error),
    /// There is no page of this.
    #[error(transparent)]
    View(#[from] ViewError),
}

/// The server's side: the page, and the growth.
pub(crate) struct Shared {
    page: String,
    /// Every address begins with it.
    token: String,
    live: Arc<Live>,
}

/// A growth under way, as pages and the thread that follows it share it.
pub struct Live {
    /// None where pages may only look.
    orders: Option<Arc<Orders>>,
    watched: Mutex<Watched>,
    /// Counts what has changed; each open page listens.
    changes: watch::Sender<u64>,
    is_left: AtomicBool,
}

impl Live {
    /// A growth that is about to begin, or to be resumed after `known` layers. With orders, pages may give some.
    #[must_use]
    pub fn new(job: &Job, known: &[Option<LayerBytes>], orders: Option<Arc<Orders>>) -> Arc<Self> {
        let watched = Mutex::new(Watched::new(job, known));
        Arc::new(Self { orders, watched, changes: watch::Sender::new(0), is_left: AtomicBool::new(false) })
    }

    fn watched(&self) -> MutexGuard<'_, Watched> {
        self.watched.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Has pages tell when the growth is done: the robot's clock runs so fast, in multiples of real time.
    pub fn runs_at(&self, pace: Option<f64>) {
        self.watched().runs_at(pace);
    }

    /// Tells pages what happened.
    pub fn ingest(&self, event: &JobEvent) {
        self.watched().ingest(event);
        self.changed();
    }

    /// Tells pages what is wrong with this program's own files, until nothing is.
    pub fn warn(&self, words: Option<String>) {
        self.watched().warn(words);
        self.changed();
    }

    /// Tells pages how it ended, as `growbot grow --json` says it.
    pub fn end(&self, result: GrowthResult) {
        self.watched().end(result);
        self.changed();
    }

    /// It is followed by another: pages that look at this one are to ask anew.
    pub fn leave(&self) {
        self.is_left.store(true, Ordering::Release);
        self.changed();
    }

    fn changed(&self) {
        self.changes.send_modify(|changes| *changes += 1);
    }
}

/// A page that follows a growth. Dropped, it is gone.
pub struct Watch {
    shared: Arc<Shared>,
    address: String,
    server: Option<(oneshot::Sender<()>, JoinHandle<()>)>,
}

impl Watch {
    /// Serves the page of a plan and its job on this port, 0 for any; `known` are the layers that have been built
    /// already. With orders, the page may give some.
    ///
    /// # Errors
    /// [`WatchError`].
    pub fn start(
        subject: &Subject,
        job: &Job,
        known: &[Option<LayerBytes>],
        orders: Option<Arc<Orders>>,
        port: u16,
    ) -> Result<Self, WatchError> {
        let of_address = |error| WatchError::Address { port, error };
        let listener = TcpListener::bind((Ipv4Addr::LOCALHOST, port)).map_err(of_address)?;
        listener.set_nonblocking(true).map_err(of_address)?;
        let bound = listener.local_addr().map_err(of_address)?;
        let token = token().map_err(WatchError::Random)?;
        let shared = Arc::new(Shared {
            page: page::of_growth(subject, orders.is_some())?,
            token,
            live: Live::new(job, known, orders),
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

    /// Where the page is.
    #[must_use]
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Has pages tell when the growth is done: the robot's clock runs so fast, in multiples of real time.
    pub fn runs_at(&self, pace: Option<f64>) {
        self.shared.live.runs_at(pace);
    }

    /// Tells pages what happened.
    pub fn ingest(&self, event: &JobEvent) {
        self.shared.live.ingest(event);
    }

    /// Tells pages what is wrong with this program's own files, until nothing is.
    pub fn warn(&self, words: Option<String>) {
        self.shared.live.warn(words);
    }

    /// Tells pages how it ended, as `growbot grow --json` says it, and waits a moment for those that are open to hear
    /// it.
    pub fn end(self, result: GrowthResult) {
        self.shared.live.end(result);
        let asked = Instant::now();
        while self.shared.live.changes.receiver_count() > 0 && asked.elapsed() < LAST_WORDS {
            thread::sleep(Duration::from_millis(20));
        }
    }
}

impl Drop for Watch {
    fn drop(&mut self) {
        if let Some((stop, thread)) = self.server.take() {
            let _ = stop.send(());
            let _ = thread.join();
        }
    }
}

/// 128 random bits, as 32 hexadecimal digits.
pub(crate) fn token() -> Result<String, getrandom::Error> {
    let mut bytes = [0; 16];
    getrandom::fill(&mut bytes)?;
    Ok(bytes.iter().map(|byte| format!("{byte:02x}")).collect())
}
