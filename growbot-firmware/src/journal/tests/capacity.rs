//! Tests of the journal's capacity, its erasures and the wear of its sectors.

use super::*;
use growbot_core::job::MAX_JOB_LAYERS;

#[test]
fn new_and_zeroed_flash_has_no_journal_and_is_not_written() {
    for byte in [0, 0x55, 0xff] {
        let flash = Small::new(SECTORS);
        flash.set_bytes(&[byte; 2048]);
        let mut journal = Journal::open(flash.clone());
        assert_eq!(journal.job(), None);
        assert_eq!(journal.layer(0), None);
        assert!(journal.needs_erasing(1));
        assert_eq!(journal.begin_job(1, ROBOT, 1), Err(JournalError::Full));
        assert_eq!((flash.bytes(), flash.erasures()), (std::vec![byte; 2048], std::vec![0, 0]));
        live(&flash, &story(), || None);
    }
}

#[test]
fn the_journal_works_with_any_number_of_sectors() {
    for sectors in [1, 3, 4] {
        let flash = Small::new(sectors);
        for _ in 0..5 {
            let mut losses = [Some((2000, 1)), Some((3000, 2))].into_iter();
            live(&flash, &story(), || losses.next().flatten());
        }
    }
}

/// Records many jobs, each of up to `max_layers` layers. Returns the number of their records, and the number of
/// erasures of each sector.
fn many_jobs(max_layers: u64) -> (u32, Vec<u32>) {
    let flash = Small::new(SECTORS);
    let mut records = 0;
    for plan_id in 1..=600 {
        let mut journal = Journal::open(flash.clone());
        let layers = (plan_id * 7 % max_layers) as u32 + 1;
        while journal.erase_step(layers).unwrap() {}
        assert!(!journal.needs_erasing(layers));
        journal.begin_job(plan_id, ROBOT, layers).unwrap();
        for index in 0..layers {
            journal.record_laid(index, &layer(plan_id, index), true).unwrap();
        }
        journal.record_ended().unwrap();
        // A start that writes skips a slot that may have been written to.
        records += layers + 2 + 1;
        let known = known(&mut Journal::open(flash.clone())).unwrap();
        assert_eq!((known.state.plan_id, known.state.layers_laid, known.state.ended), (plan_id, layers, true));
        assert!((0..).zip(&known.laid).all(|(index, laid)| laid.as_built == layer(plan_id, index).as_built));
    }
    (records, flash.erasures())
}

#[test]
fn hundreds_of_jobs_wear_the_sectors_evenly() {
    for max_layers in [1, 5, 16, 30, 47] {
        let (records, erasures) = many_jobs(max_layers);
        assert!(erasures[0].abs_diff(erasures[1]) <= 1, "{erasures:?}");
        let places = 31 * erasures.iter().sum::<u32>();
        if max_layers <= 16 {
            // With the slots reserved for other records the jobs fit a sector. No slot is erased before it was used.
            assert!(places <= records + 2 * 31, "{places} places for {records} records");
        }
        // With the least favourable length of jobs, 5/8 of the slots are used.
        assert!(places * 5 <= (records + 2 * 31) * 8, "{places} places for {records} records");
    }
}

#[test]
fn the_robots_flash_holds_a_job_of_6000_layers_and_2000_pauses() {
    let flash = Flash::<{ 128 * 1024 }>::new(2);
    let mut journal = Journal::open(flash.clone());
    let layers = journal.capacity();
    assert_eq!(layers, MAX_JOB_LAYERS);
    while journal.erase_step(layers).unwrap() {}
    assert!(journal.needs_erasing(layers + 1));
    assert_eq!(journal.begin_job(1, ROBOT, layers + 1), Err(JournalError::Full));
    journal.begin_job(2, ROBOT, layers).unwrap();
    for index in 0..layers {
        let paused = index % 3 == 0 && index < 2045 * 3;
        if paused {
            journal.record_begun(index).unwrap();
        }
        journal.record_laid(index, &layer(2, index), false).unwrap();
    }
    journal.record_ended().unwrap();
    let mut journal = Journal::open(flash);
    assert_eq!(known(&mut journal).unwrap().state.layers_laid, layers);
    for index in [6142, 0, 3000, 2999, 3001] {
        assert_eq!(journal.layer(index).unwrap().as_built, layer(2, index).as_built, "{index}");
    }
}

#[test]
fn a_job_that_exceeds_the_journal_is_not_resumed() {
    let flash = Small::new(SECTORS);
    let mut journal = Journal::open(flash.clone());
    while journal.erase_step(47).unwrap() {}
    journal.begin_job(1, ROBOT, 47).unwrap();
    for _ in 0..61 {
        journal.record_begun(0).unwrap();
    }
    assert_eq!(journal.record_laid(0, &layer(1, 0), true), Err(JournalError::Full));
    assert_eq!(journal.record_laid(1, &layer(1, 1), true), Err(JournalError::NoJob));
    assert_eq!(Journal::open(flash.clone()).job(), None);
    live(&flash, &story(), || None);
}

#[test]
fn after_any_job_every_slot_is_used_at_most_once() {
    for records in 1..60 {
        for restarted in [false, true] {
            let flash = Small::new(SECTORS);
            let mut journal = Journal::open(flash.clone());
            while journal.erase_step(47).unwrap() {}
            journal.begin_job(1, ROBOT, 4).unwrap();
            (0..records).for_each(|_| journal.record_begun(0).unwrap());
            journal.record_ended().unwrap();
            while journal.erase_step(47).unwrap() {}
            let mut places = 62;
            if restarted {
                // The first blank slot may have been written to.
                journal = Journal::open(flash.clone());
                places -= 1;
            }
            assert_eq!(room(&journal), places - 15);
            journal.begin_job(2, ROBOT, 46).unwrap();
            (1..places).for_each(|_| journal.record_begun(0).unwrap());
            assert_eq!(journal.job().copied(), Journal::open(flash.clone()).job().copied());
            assert_eq!(journal.record_begun(0), Err(JournalError::Full), "{records} records");
        }
    }
}
