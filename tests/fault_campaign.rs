//! Every fault at every time of a growth is noticed, with the right code, before the nozzle gets too hot.
//!
//! A part of the campaign here; all of it, as SAFETY.md prints it, by `cargo fault-campaign`.

use growbot_tests::fault_campaign::cases::Case;
use growbot_tests::fault_campaign::{growth, run, table};

/// Copies of the robot for each case.
const SEEDS: std::ops::Range<u64> = 0..2;

#[test]
fn every_fault_is_noticed_in_time_with_the_right_code() {
    let robot = growth::robot();
    let rows = run(&Case::all(), SEEDS);
    println!("{}", table::markdown(&rows));
    let mut wrong = Vec::new();
    for (case, seen) in &rows {
        for (one, seed) in seen.iter().zip(SEEDS) {
            wrong.extend(one.wrong(case, &robot).map(|why| format!("{case:?}, seed {seed}: {why}")));
        }
    }
    assert!(wrong.is_empty(), "{} growths went wrong:\n{}", wrong.len(), wrong.join("\n"));
}
