//! Parallel processing of many items on all cores.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{self, RecvTimeoutError, Sender};
use std::thread;
use std::time::Duration;

/// Interval at which progress is reported.
const PROGRESS_INTERVAL: Duration = Duration::from_millis(50);

/// Applies `work` to all items and returns the results in the order of the items. Calls `at` with the number of
/// finished items, every 50 ms and at the end.
pub fn map<T: Sync, U: Send>(items: &[T], work: impl Fn(&T) -> U + Sync, at: impl FnMut(usize)) -> Vec<U> {
    map_on(thread::available_parallelism().map_or(1, usize::from), items, work, at)
}

/// Like [`map`], but on `threads` threads, at least one.
pub fn map_on<T: Sync, U: Send>(
    threads: usize,
    items: &[T],
    work: impl Fn(&T) -> U + Sync,
    mut at: impl FnMut(usize),
) -> Vec<U> {
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    // Nothing is sent. The channel closes when the last worker is finished.
    let (working, finished) = mpsc::channel::<()>();
    let take = |_working: Sender<()>| {
        let mut mine = Vec::new();
        while let Some((index, item)) =
            Some(next.fetch_add(1, Ordering::Relaxed)).and_then(|i| Some((i, items.get(i)?)))
        {
            mine.push((index, work(item)));
            done.fetch_add(1, Ordering::Relaxed);
        }
        mine
    };
    let mut results: Vec<(usize, U)> = thread::scope(|scope| {
        let workers: Vec<_> = (0..threads.max(1))
            .map(|_| {
                let working = working.clone();
                scope.spawn(move || take(working))
            })
            .collect();
        drop(working);
        while finished.recv_timeout(PROGRESS_INTERVAL) == Err(RecvTimeoutError::Timeout) {
            at(done.load(Ordering::Relaxed));
        }
        at(done.load(Ordering::Relaxed));
        // A worker that panicked has printed its message. Its panic is resumed here.
        workers
            .into_iter()
            .flat_map(|worker| worker.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
            .collect()
    });
    results.sort_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}

#[cfg(test)]
mod tests {
    #[test]
    fn results_keep_their_order() {
        let items: Vec<u64> = (0..1000).collect();
        assert_eq!(super::map(&items, |item| item * item, |_| {}), items.iter().map(|i| i * i).collect::<Vec<_>>());
        assert!(super::map(&[0_u8; 0], |item| *item, |_| {}).is_empty());
        let mut done = 0;
        assert_eq!(super::map_on(0, &items, |item| *item, |now| done = now), items);
        assert_eq!(done, 1000);
    }
}
