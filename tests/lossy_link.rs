//! Growths over lines that lose, corrupt, duplicate, swap and truncate frames.

use growbot_tests::recovery::wire::{run, table};

/// Number of jobs. `cargo recovery-campaign` runs 10,000.
const JOBS: u64 = 200;

#[test]
fn each_layer_is_laid_once_over_any_bad_link() {
    let rows = run(JOBS);
    println!("{}", table(&rows));
    let wrong: Vec<&String> = rows.iter().flat_map(|(.., row)| &row.wrong).collect();
    assert!(wrong.is_empty(), "{wrong:#?}");
    assert_eq!(rows.iter().map(|(.., row)| row.jobs).sum::<u64>(), JOBS);
}
