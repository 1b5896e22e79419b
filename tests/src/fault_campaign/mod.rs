//! Every fault of a tip, at every time of a growth, on many variations of a robot.
//!
//! [`cases`] defines the faults, their onsets and the expected codes. [`growth`] runs one growth with one fault.
//! [`table`] formats the table of docs/safety-evidence.md. `cargo fault-campaign` runs the whole campaign, and the
//! tests run a part.

pub mod cases;
pub mod growth;
pub mod rig;
pub mod table;

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::thread;

use cases::Case;
use growth::{Observation, Plant};

/// Runs every case on variations of the robot with this plant and these seeds, on all cores. The result is in the order
/// of the cases, with all variations of a case together.
///
/// # Panics
/// Panics if a growth cannot be run.
pub fn run(plant: Plant, cases: &[Case], seeds: std::ops::Range<u64>) -> Vec<(Case, Vec<Observation>)> {
    let jobs: Vec<(usize, u64)> =
        (0..cases.len()).flat_map(|case| seeds.clone().map(move |seed| (case, seed))).collect();
    let next = AtomicUsize::new(0);
    let seen: Mutex<Vec<(usize, u64, Observation)>> = Mutex::new(Vec::new());
    thread::scope(|scope| {
        for _ in 0..thread::available_parallelism().map_or(1, usize::from) {
            scope.spawn(|| {
                while let Some(&(case, seed)) = jobs.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let one = growth::run_case(plant, &cases[case], seed);
                    seen.lock().expect("no growth panics with the list in hand").push((case, seed, one));
                }
            });
        }
    });
    let mut seen = seen.into_inner().expect("all growths have ended");
    seen.sort_by_key(|(case, seed, _)| (*case, *seed));
    let mut rows: Vec<(Case, Vec<Observation>)> = cases.iter().map(|case| (*case, Vec::new())).collect();
    for (case, _, one) in seen {
        rows[case].1.push(one);
    }
    rows
}

/// Returns one line for each growth that is wrong. The seeds start at 0.
pub fn mismatches(plant: Plant, rows: &[(Case, Vec<Observation>)]) -> Vec<String> {
    let robot = growth::robot(plant);
    let of_case = |(case, seen): &(Case, Vec<Observation>)| {
        let why = |(seed, one): (usize, &Observation)| {
            Some(format!("{plant:?}, {case:?}, seed {seed}: {}", one.mismatch(case, &robot)?))
        };
        seen.iter().enumerate().filter_map(why).collect::<Vec<_>>()
    };
    rows.iter().flat_map(of_case).collect()
}
