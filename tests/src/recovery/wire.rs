//! Growths over an unreliable line. Each growth ends, and each layer is laid once.

use std::cell::RefCell;
use std::fmt::Write;
use std::rc::Rc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread;

use growbot_client::client::Client;
use growbot_client::growth::{CommandQueue, grow_job};
use growbot_client::port::faulty::{FaultSpec, FaultyPort};
use growbot_core::link::message::HostSilencePolicy;
use growbot_plan::growth_report::Outcome;
use growbot_plan::job::Job;

use super::{Body, ReferenceGrowth, late_board, robot};

/// Layers of each job.
const LAYERS: u32 = 20;
/// Probabilities that a frame is lost, in each direction.
pub const LOSSES: [f64; 5] = [0.0, 0.01, 0.05, 0.1, 0.2];
/// Probabilities that a bit of a byte is flipped. The last is 1e-3 per bit.
pub const FLIPS: [f64; 4] = [0.0, 1e-4, 1e-3, 8e-3];

/// Results of the jobs over one kind of line.
#[derive(Debug, Clone, Default)]
pub struct Row {
    /// Number of jobs.
    pub jobs: u64,
    /// Descriptions of the jobs that did not end as expected.
    pub wrong: Vec<String>,
    /// Frames that were sent in both directions.
    pub frames: u64,
    /// Requests that were repeated.
    pub repeated: u64,
    /// Total time by the boards' clocks, s.
    pub seconds: f64,
}

/// Runs this many jobs, spread over all kinds of line, on all cores. Returns for each kind the probabilities of
/// [`LOSSES`] and [`FLIPS`], and the results.
///
/// # Panics
/// Panics if the undisturbed growth fails.
pub fn run(jobs: u64) -> Vec<(f64, f64, Row)> {
    let (robot, body) = (robot(), Body::of(LAYERS));
    let undisturbed = ReferenceGrowth::grow(&body.job(&robot));
    let wires: Vec<(f64, f64)> = LOSSES.iter().flat_map(|loss| FLIPS.map(|flip| (*loss, flip))).collect();
    let (next, rows) = (AtomicU64::new(0), Mutex::new(vec![Row::default(); wires.len()]));
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                let job = body.job(&robot);
                loop {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= jobs {
                        return;
                    }
                    let which = seed as usize % wires.len();
                    let (loss, flip) = wires[which];
                    let one = grow(&job, &undisturbed, loss, flip, seed);
                    let mut rows = rows.lock().expect("no growth panics with the rows in hand");
                    let row = &mut rows[which];
                    row.jobs += one.jobs;
                    row.wrong.extend(one.wrong);
                    row.frames += one.frames;
                    row.repeated += one.repeated;
                    row.seconds += one.seconds;
                }
            });
        }
    });
    let rows = rows.into_inner().expect("all growths have ended");
    wires.into_iter().zip(rows).map(|((loss, flip), row)| (loss, flip, row)).collect()
}

/// Runs one job. The line also duplicates, swaps and truncates frames, a tenth as often as it loses them.
fn grow(job: &Job, undisturbed: &ReferenceGrowth, loss: f64, flip: f64, seed: u64) -> Row {
    let spec = FaultSpec {
        drop: loss,
        flip,
        dup: loss / 10.0,
        reorder: loss / 10.0,
        truncate: loss / 10.0,
        seed,
        ..FaultSpec::default()
    };
    let board = late_board(job, seed);
    let wire = Rc::new(RefCell::new(FaultyPort::new(Box::new(Rc::clone(&board)), spec)));
    let mut client = Client::new(Box::new(Rc::clone(&wire)), "sim");
    let grown = grow_job(&mut client, job, HostSilencePolicy::Pause, &CommandQueue::default(), &mut |_| {});
    let feed_steps = board.borrow_mut().simulated_tip().feed_steps();
    let wrong = match &grown {
        Err(error) => Some(error.to_string()),
        Ok(grown) if grown.outcome != Outcome::Done => {
            Some(format!("the growth ended with {:?} instead of done", grown.outcome))
        }
        Ok(grown) if grown.as_built != undisturbed.as_built => {
            Some("the layers as built differ from those of the undisturbed growth".to_string())
        }
        Ok(_) if feed_steps != undisturbed.feed_steps => {
            Some(format!("the growth made {feed_steps} feed steps instead of {}", undisturbed.feed_steps))
        }
        Ok(_) => None,
    };
    let wrong = wrong.map(|wrong| format!("seed {seed}, loss {loss}, flips {flip}: {wrong}"));
    let frames = wire.borrow().tally().frames;
    let seconds = board.borrow().now_s();
    Row { jobs: 1, wrong: wrong.into_iter().collect(), frames, repeated: client.repeated(), seconds }
}

/// Formats the rows as a table.
pub fn table(rows: &[(f64, f64, Row)]) -> String {
    let mut text = String::from(
        "| frames lost | bits turned over, a byte | jobs | wrong | frames a job | requests repeated a job | time a job, s |\n|---|---|---|---|---|---|---|\n",
    );
    for (loss, flip, row) in rows {
        let each = |sum: f64| sum / row.jobs.max(1) as f64;
        let _ = writeln!(
            text,
            "| {:.0} % | {flip:.0e} | {} | {} | {:.0} | {:.1} | {:.0} |",
            loss * 100.0,
            row.jobs,
            row.wrong.len(),
            each(row.frames as f64),
            each(row.repeated as f64),
            each(row.seconds)
        );
    }
    text
}
