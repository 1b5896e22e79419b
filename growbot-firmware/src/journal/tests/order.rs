//! Tests of the journal with missing, stray and misplaced records, and with jobs that replace each other.

use super::*;

#[test]
fn bad_slots_are_skipped_and_jobs_on_broken_flash_are_not_resumed() {
    let flash = Small::new(SECTORS);
    let mut journal = Journal::open(flash.clone());
    while journal.erase_step(4).unwrap() {}
    journal.begin_job(1, ROBOT, 4).unwrap();
    let spoil = |places: std::ops::Range<usize>| {
        let mut bytes = flash.bytes();
        // These bits of the layer's first byte can no longer be set.
        places.for_each(|place| bytes[32 * place + 8] = 0);
        flash.set_bytes(&bytes);
    };
    spoil(2..4);
    journal.record_laid(0, &layer(1, 0), true).unwrap();
    assert_eq!(known(&mut Journal::open(flash.clone())), known(&mut journal));
    assert_eq!(journal.job().unwrap().layers_laid, 1);
    // The spoiled slots were struck out, so that they never read as records again.
    assert!(flash.bytes()[2 * 32..4 * 32].iter().all(|byte| *byte == 0));
    spoil(5..8);
    assert_eq!(journal.record_laid(1, &layer(1, 1), true), Err(JournalError::Flash));
    assert_eq!(Journal::open(flash.clone()).job(), None);
}

#[test]
fn any_missing_record_is_detected() {
    // Record 2 is the second one: a layer is begun.
    for missing in 2..6 {
        let flash = Small::new(SECTORS);
        let mut journal = Journal::open(flash.clone());
        while journal.erase_step(4).unwrap() {}
        journal.begin_job(1, ROBOT, 4).unwrap();
        journal.record_begun(0).unwrap();
        journal.record_laid(0, &layer(1, 0), false).unwrap();
        journal.record_begun(1).unwrap();
        journal.record_begun(1).unwrap();
        journal.record_laid(1, &layer(1, 1), false).unwrap();
        let mut bytes = flash.bytes();
        bytes[32 * missing..32 * (missing + 1)].fill(0);
        flash.set_bytes(&bytes);
        assert_eq!(Journal::open(flash.clone()).job(), None, "record {missing}");
    }
}

#[test]
fn up_to_14_consecutive_missing_records_are_detected() {
    // The records are counted modulo 16. A record that is stored twice counts once.
    let flash = Small::new(SECTORS);
    let mut journal = Journal::open(flash.clone());
    while journal.erase_step(4).unwrap() {}
    journal.begin_job(1, ROBOT, 4).unwrap();
    for _ in 0..20 {
        journal.record_begun(0).unwrap();
    }
    let whole = flash.bytes();
    for missing in 1..=14 {
        for first in 2..22 - missing {
            let mut bytes = whole.clone();
            bytes[32 * first..32 * (first + missing)].fill(0);
            flash.set_bytes(&bytes);
            assert_eq!(Journal::open(flash.clone()).job(), None, "{missing} from {first} on");
        }
    }
}

#[test]
fn records_of_earlier_jobs_are_ignored_in_any_slot() {
    let flash = Small::new(SECTORS);
    let mut journal = Journal::open(flash.clone());
    while journal.erase_step(4).unwrap() {}
    journal.begin_job(1, ROBOT, 4).unwrap();
    let place = |number: usize| 32 * number..32 * (number + 1);
    let earlier = flash.bytes()[place(1)].to_vec();
    journal.begin_job(2, ROBOT, 4).unwrap();
    journal.record_laid(0, &layer(2, 0), true).unwrap();
    let before = known(&mut journal);
    let mut bytes = flash.bytes();
    bytes[place(4)].copy_from_slice(&earlier);
    bytes[place(5)].copy_from_slice(&earlier);
    flash.set_bytes(&bytes);
    assert_eq!(known(&mut Journal::open(flash)), before);
}

#[test]
fn a_job_that_cannot_begin_ends_the_unfinished_one() {
    let flash = Small::new(SECTORS);
    let mut journal = Journal::open(flash.clone());
    while journal.erase_step(4).unwrap() {}
    journal.begin_job(1, ROBOT, 4).unwrap();
    journal.record_begun(0).unwrap();
    assert_eq!(journal.begin_job(2, ROBOT, 1000), Err(JournalError::Full));
    assert_eq!((journal.job(), Journal::open(flash).job()), (None, None));
}

#[test]
fn a_job_that_cannot_begin_keeps_the_finished_one() {
    let flash = Small::new(SECTORS);
    let mut journal = Journal::open(flash.clone());
    while journal.erase_step(4).unwrap() {}
    journal.begin_job(1, ROBOT, 1).unwrap();
    journal.record_laid(0, &layer(1, 0), false).unwrap();
    journal.record_ended().unwrap();
    let ended = journal.job().copied();
    assert_eq!(journal.begin_job(2, ROBOT, 1000), Err(JournalError::Full));
    assert_eq!((journal.job().copied(), Journal::open(flash).job().copied()), (ended, ended));
}

type Try = fn(&mut Journal<Small>) -> Result<(), JournalError>;

#[test]
fn out_of_order_records_end_the_resumable_job() {
    let out_of_order: [Try; 8] = [
        |journal| journal.record_begun(3),
        |journal| journal.record_laid(1, &layer(1, 1), false),
        |journal| journal.record_skipped(3, &layer(1, 3)),
        |journal| journal.record_amended(1, 2, 8),
        |journal| journal.record_amended(9, 2, 8),
        // An index has 24 bits.
        |journal| journal.record_amended(1 << 24, 2, u32::MAX),
        // The job has four layers.
        |journal| (2..5).try_for_each(|index| journal.record_laid(index, &layer(1, index), false)),
        |journal| {
            (2..4).try_for_each(|index| journal.record_laid(index, &layer(1, index), false))?;
            journal.record_begun(4)
        },
    ];
    for deed in out_of_order {
        let flash = Small::new(SECTORS);
        let mut journal = Journal::open(flash.clone());
        assert_eq!(journal.record_ended(), Err(JournalError::NoJob));
        while journal.erase_step(4).unwrap() {}
        journal.begin_job(1, ROBOT, 4).unwrap();
        journal.record_laid(0, &layer(1, 0), true).unwrap();
        journal.record_laid(1, &layer(1, 1), true).unwrap();
        assert_eq!(deed(&mut journal), Err(JournalError::OutOfOrder));
        assert_eq!((journal.job(), Journal::open(flash).job()), (None, None));
    }
}

#[test]
fn an_unfinished_job_is_erased_only_after_it_is_forgotten() {
    let flash = Small::new(SECTORS);
    let mut journal = Journal::open(flash.clone());
    while journal.erase_step(20).unwrap() {}
    journal.begin_job(1, ROBOT, 20).unwrap();
    journal.record_begun(0).unwrap();
    let before = known(&mut journal);
    // Sector 1 is blank or contains nothing of the job, and sector 0 contains the job.
    let refused = loop {
        match journal.erase_step(47) {
            Ok(more) => assert!(more),
            Err(error) => break error,
        }
    };
    assert_eq!(refused, JournalError::JobNotEnded);
    assert_eq!(known(&mut Journal::open(flash.clone())), before);
    journal.forget();
    assert_eq!(journal.job(), None);
    while journal.erase_step(47).unwrap() {}
    assert_eq!(Journal::open(flash.clone()).job(), None);
    journal.begin_job(2, ROBOT, 47).unwrap();
    assert_eq!(Journal::open(flash).job().unwrap().plan_id, 2);
}
