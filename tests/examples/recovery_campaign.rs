//! Runs every interruption of a growth of 300 layers, and 10,000 growths over bad lines: `cargo recovery-campaign
//! [JOBS]`.

use std::process::ExitCode;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use growbot_tests::recovery::crash::{Interruption, check, crash_at};
use growbot_tests::recovery::{Body, ReferenceGrowth, robot, wire};

fn main() -> ExitCode {
    let jobs = std::env::args().nth(1).and_then(|text| text.parse().ok()).unwrap_or(10_000);
    let (robot, body) = (robot(), Body::of(300));
    let undisturbed = ReferenceGrowth::grow(&body.job(&robot));
    let events = undisturbed.events - 2;
    let (next, wrong) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
    std::thread::scope(|scope| {
        for _ in 0..std::thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                let job = body.job(&robot);
                loop {
                    let at = next.fetch_add(1, Ordering::Relaxed);
                    let (event, crash) =
                        (1 + at / Interruption::ALL.len(), Interruption::ALL[at % Interruption::ALL.len()]);
                    if event > events {
                        return;
                    }
                    let done = crash_at(&job, &undisturbed, crash, event)
                        .and_then(|recovered| check(&job, &undisturbed, crash, &recovered));
                    if let Err(error) = done {
                        wrong.lock().expect("nobody panics").push(format!("{crash:?} at event {event}: {error}"));
                    }
                }
            });
        }
    });
    let wrong = wrong.into_inner().expect("nobody panics");
    println!(
        "{} interruptions of a growth of 300 layers, {} of them wrong",
        events * Interruption::ALL.len(),
        wrong.len()
    );
    for one in &wrong {
        println!("{one}");
    }
    let rows = wire::run(jobs);
    println!("{}", wire::table(&rows));
    let mut all_right = wrong.is_empty();
    for one in rows.iter().flat_map(|(.., row)| &row.wrong) {
        println!("{one}");
        all_right = false;
    }
    if all_right { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
