//! Computations that Ctrl-C ends.

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use growbot_plan::parallel;
use pyo3::prelude::*;

use crate::error::Error;

/// Interval at which a computation polls whether the user has pressed Ctrl-C.
const LOOK: Duration = Duration::from_millis(50);

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
