//! Computations and waits that Ctrl-C ends. Python's other threads run meanwhile.

use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

use growbot_plan::parallel;
use growbot_remote::client::ServiceError;
use pyo3::prelude::*;

use crate::error::{Error, ErrorKind};

/// Interval at which a computation or a waiting call polls whether the user has pressed Ctrl-C.
pub const LOOK: Duration = Duration::from_millis(50);

/// Calls `work` for each item, on this number of threads, and returns the results in order. The Python interpreter is
/// released meanwhile. Ctrl-C ends the computation with an error.
pub fn interruptible<T: Sync, U: Send>(
    py: Python<'_>,
    threads: usize,
    items: &[T],
    work: impl Fn(&T) -> U + Sync,
) -> Result<Vec<U>, Error> {
    let ended = AtomicBool::new(false);
    let (results, signal) = py.detach(|| {
        let mut signal = None;
        let mut look = || {
            #[allow(clippy::redundant_closure_for_method_calls, reason = "the method is not for any lifetime")]
            if let Err(error) = Python::attach(|py| py.check_signals()) {
                ended.store(true, Ordering::Relaxed);
                signal = Some(error);
            }
        };
        let work = |item: &T| (!ended.load(Ordering::Relaxed)).then(|| work(item));
        let results = if threads == 1 {
            here(items, work, &mut look)
        } else {
            parallel::map_on(threads, items, work, |_| look())
        };
        (results, signal)
    });
    match signal {
        Some(error) => Err(error.into()),
        None => Ok(results.into_iter().flatten().collect()),
    }
}

/// Calls `work` for each item on the calling thread, and `look` at intervals. This is faster than a new thread, which
/// would have to request memory from the system first.
fn here<T, U>(items: &[T], work: impl Fn(&T) -> U, look: &mut impl FnMut()) -> Vec<U> {
    let mut looked = Instant::now();
    let mut one = |item: &T| {
        if looked.elapsed() > LOOK {
            look();
            looked = Instant::now();
        }
        work(item)
    };
    let results = items.iter().map(&mut one).collect();
    look();
    results
}

/// Locks a mutex, also after a panic of another thread.
pub fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the error for a board whose connection is closed.
pub fn disconnected() -> Error {
    Error::new(ErrorKind::Board, "the board is disconnected: connect again with growbot.connect")
}

/// Waits for a response. Ctrl-C ends the wait.
pub fn receive<T: Send>(py: Python<'_>, receiver: Receiver<Result<T, Error>>) -> Result<T, Error> {
    let receiver = Mutex::new(receiver);
    loop {
        match py.detach(|| lock(&receiver).recv_timeout(LOOK)) {
            Ok(response) => return response,
            Err(RecvTimeoutError::Timeout) => py.check_signals()?,
            Err(RecvTimeoutError::Disconnected) => return Err(disconnected()),
        }
    }
}

/// Runs a request to the service in a thread of its own. Returns the channel on which the response arrives.
pub fn in_thread<T: Send + 'static>(
    request: impl FnOnce() -> Result<T, ServiceError> + Send + 'static,
) -> Receiver<Result<T, Error>> {
    let (sender, receiver) = mpsc::channel();
    let thread = thread::Builder::new().name("growbot".to_owned());
    // Without a thread, the receiver is disconnected.
    let _ = thread.spawn(move || sender.send(request().map_err(Error::from)));
    receiver
}
