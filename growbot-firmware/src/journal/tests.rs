//! The journal against a flash that loses power at every byte of a story, and against flash that holds anything.

mod weak_cells;

use std::vec::Vec;

use super::*;
use crate::testing::flash::Flash;
use proptest::prelude::*;

/// Two sectors of 31 places: 15 are kept, so a job may have 47 layers.
type Small = Flash<1024>;
const SECTORS: usize = 2;

const ROBOT: u64 = 0xfeed_0123_4567_89ab;

/// What the caller does.
#[derive(Debug, Clone, Copy)]
enum Deed {
    Erase(u32),
    Begin(u64, u32),
    Begun,
    /// The next layer, and whether the one after it is begun at once.
    Commit(bool),
    Skip,
    Amend(u32, u64, u32),
    End,
}

/// All that can be known of a job.
#[derive(Debug, Clone, PartialEq)]
struct Known {
    state: JobState,
    carry: Carry,
    laid: Vec<LaidRecord>,
}

/// A layer that shows which one it is.
fn layer(plan_id: u64, index: u32) -> Laid {
    let mut as_built = LayerBytes::default();
    as_built[..8].copy_from_slice(&(plan_id ^ u64::from(index) << 32).to_le_bytes());
    as_built[8..].copy_from_slice(&index.to_le_bytes());
    Laid { as_built, height_units: 1 << 24 | index, lean_owed: [index as i16, -3 - index as i16] }
}

fn known<const S: usize>(journal: &mut Journal<Flash<S>>) -> Option<Known> {
    let state = *journal.job()?;
    let laid = (0..state.laid).map(|index| journal.laid(index).unwrap()).collect();
    assert_eq!(journal.laid(state.laid), None);
    Some(Known { state, carry: journal.carry(), laid })
}

impl Deed {
    fn done<const S: usize>(self, journal: &mut Journal<Flash<S>>) -> Result<(), JournalError> {
        let state = journal.job().copied();
        let next = || state.map_or((0, 0), |state| (state.plan_id, state.laid));
        let ((plan_id, index), laid) = (next(), layer(next().0, next().1));
        match self {
            Deed::Erase(layers) => {
                while journal.erase_step(layers)? {}
                Ok(())
            }
            Deed::Begin(plan_id, layers) => journal.begin(plan_id, ROBOT, layers),
            Deed::Begun => journal.begun(index),
            Deed::Commit(next_begun) => journal.committed(index, &laid, next_begun),
            Deed::Skip => journal.skipped(index, &layer(!plan_id, index)),
            Deed::Amend(from, plan_id, layers) => journal.amended(from, plan_id, layers),
            Deed::End => journal.ended(),
        }
    }

    /// What is to be known after it.
    fn after(self, before: Option<&Known>) -> Option<Known> {
        if let Deed::Begin(plan_id, layers) = self {
            let state = JobState { plan_id, robot: ROBOT, layers, laid: 0, begun: 0, ended: false };
            return Some(Known { state, carry: Carry::default(), laid: Vec::new() });
        }
        let mut known = before?.clone();
        let Known { state, carry, laid } = &mut known;
        let mut lay = |cut| {
            let plan_id = if cut { !state.plan_id } else { state.plan_id };
            let layer = layer(plan_id, state.laid);
            laid.push(LaidRecord { as_built: layer.as_built, cut });
            carry.height_units += u64::from(layer.height_units);
            carry.lean_owed = layer.lean_owed;
            state.laid += 1;
            state.begun = state.laid;
        };
        match self {
            Deed::Erase(_) | Deed::Begin(..) => {}
            Deed::Begun => state.begun = state.laid + 1,
            Deed::Commit(next_begun) => {
                lay(false);
                state.begun += u32::from(next_begun);
            }
            Deed::Skip => lay(true),
            Deed::Amend(_, plan_id, layers) => {
                (state.plan_id, state.layers) = (plan_id, layers);
            }
            Deed::End => state.ended = true,
        }
        Some(known)
    }
}

/// A job with everything that can happen in one: 22 layers.
fn job(plan_id: u64) -> Vec<Deed> {
    let mut deeds = std::vec![Deed::Begin(plan_id, 20), Deed::Begun];
    deeds.extend([Deed::Commit(true); 9]);
    deeds.extend([Deed::Commit(false), Deed::Begun, Deed::Commit(true), Deed::Skip, Deed::Begun]);
    deeds.extend([Deed::Amend(14, plan_id + 100, 22), Deed::Commit(true)]);
    deeds.extend([Deed::Commit(true); 8]);
    deeds.extend([Deed::Commit(false), Deed::End]);
    deeds
}

/// Jobs after one another, with every kind of erasure: of new flash, of one sector, of the one in which the last job ended.
fn story() -> Vec<Deed> {
    let mut deeds = std::vec![Deed::Erase(20)];
    deeds.extend(job(1));
    deeds.push(Deed::Erase(20));
    deeds.extend(job(2));
    deeds.push(Deed::Erase(47));
    deeds.extend(job(3));
    // One that is given up for the next one.
    deeds.push(Deed::Erase(8));
    deeds.extend([Deed::Begin(4, 8), Deed::Begun, Deed::Commit(true), Deed::Begin(5, 3), Deed::Begun]);
    deeds.extend([Deed::Commit(true), Deed::Commit(true), Deed::Commit(false), Deed::End]);
    deeds
}

/// Lives through a story. Power is lost when `losses` says, and each time the journal must know what it knew before the deed under way, or
/// after it; then the story goes on from there.
fn live<const S: usize>(flash: &Flash<S>, story: &[Deed], mut losses: impl FnMut() -> Option<(usize, u64)>) {
    let power_up = |next: Option<(usize, u64)>| {
        flash.power_up();
        if let Some((bytes, seed)) = next {
            flash.lose_power_after(bytes, seed);
        }
    };
    let mut journal = Journal::open(flash.clone());
    let mut before = known(&mut journal);
    power_up(losses());
    for (number, deed) in story.iter().enumerate() {
        loop {
            let after = deed.after(before.as_ref());
            let result = deed.done(&mut journal);
            if result.is_err() {
                assert!(flash.has_lost_power(), "deed {number}, {deed:?}: {result:?}");
            }
            if flash.has_lost_power() {
                power_up(None);
                journal = Journal::open(flash.clone());
            }
            let now = if result.is_err() { known(&mut journal) } else { None };
            let unended = before.as_ref().is_some_and(|known| !known.state.ended);
            // An ended job goes with its sector, and one that has not ended when the next one begins.
            let may_be_gone = matches!(deed, Deed::Erase(_)) && !unended || matches!(deed, Deed::Begin(..)) && unended;
            if result.is_ok() {
                before = if may_be_gone && journal.job().is_none() { None } else { after };
                assert_eq!(journal.job(), before.as_ref().map(|known| &known.state), "deed {number}, {deed:?}");
                break;
            }
            power_up(losses());
            let is_record = !matches!(deed, Deed::Erase(_));
            if is_record && now == after {
                before = after;
                break;
            }
            assert!(now == before || may_be_gone && now.is_none(), "deed {number}, {deed:?}: {now:?} after {before:?}");
            before = now;
        }
    }
    flash.power_up();
    assert_eq!(known(&mut journal), before);
    assert_eq!(known(&mut Journal::open(flash.clone())), before);
    assert!(before.unwrap().state.ended);
}

#[test]
fn a_loss_of_power_at_any_byte_costs_the_record_under_way_at_most() {
    let story = story();
    let mut losses = 0;
    for bytes in 0.. {
        let flash = Small::new(SECTORS);
        let mut first = Some((bytes, bytes as u64));
        let mut lost = 0;
        live(&flash, &story, || {
            lost += 1;
            first.take()
        });
        losses += lost - 1;
        if lost == 1 {
            break;
        }
    }
    std::println!("{losses} losses of power");
    assert!(losses > 7000);
}

#[test]
fn losses_of_power_again_and_again_cost_no_more() {
    let mut seed = 1_u64;
    for _ in 0..crate::testing::number_from_environment("GROWBOT_POWER_LOSSES", 300) {
        let flash = Small::new(SECTORS);
        live(&flash, &story(), || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            Some((150 + (seed >> 33) as usize % 2500, seed))
        });
    }
}

#[test]
fn new_flash_and_the_emulators_zeros_hold_no_journal_and_are_not_written_to() {
    for byte in [0, 0x55, 0xff] {
        let flash = Small::new(SECTORS);
        flash.set_bytes(&[byte; 2048]);
        let mut journal = Journal::open(flash.clone());
        assert_eq!(journal.job(), None);
        assert_eq!(journal.laid(0), None);
        assert!(journal.needs_erasing(1));
        assert_eq!(journal.begin(1, ROBOT, 1), Err(JournalError::Full));
        assert_eq!((flash.bytes(), flash.erasures()), (std::vec![byte; 2048], std::vec![0, 0]));
        live(&flash, &story(), || None);
    }
}

#[test]
fn one_sector_does_and_more_do_too() {
    for sectors in [1, 3, 4] {
        let flash = Small::new(sectors);
        for _ in 0..5 {
            let mut losses = [Some((2000, 1)), Some((3000, 2))].into_iter();
            live(&flash, &story(), || losses.next().flatten());
        }
    }
}

/// Jobs of up to so many layers. Records that they take, and how often each sector was erased.
fn many_jobs(most_layers: u64) -> (u32, Vec<u32>) {
    let flash = Small::new(SECTORS);
    let mut records = 0;
    for plan_id in 1..=600 {
        let mut journal = Journal::open(flash.clone());
        let layers = (plan_id * 7 % most_layers) as u32 + 1;
        while journal.erase_step(layers).unwrap() {}
        assert!(!journal.needs_erasing(layers));
        journal.begin(plan_id, ROBOT, layers).unwrap();
        for index in 0..layers {
            journal.committed(index, &layer(plan_id, index), true).unwrap();
        }
        journal.ended().unwrap();
        // A start that writes passes over a place, which may have been written to.
        records += layers + 2 + 1;
        let known = known(&mut Journal::open(flash.clone())).unwrap();
        assert_eq!((known.state.plan_id, known.state.laid, known.state.ended), (plan_id, layers, true));
        assert!((0..).zip(&known.laid).all(|(index, laid)| laid.as_built == layer(plan_id, index).as_built));
    }
    (records, flash.erasures())
}

#[test]
fn hundreds_of_jobs_wear_the_sectors_evenly() {
    for most_layers in [1, 5, 16, 30, 47] {
        let (records, erasures) = many_jobs(most_layers);
        assert!(erasures[0].abs_diff(erasures[1]) <= 1, "{erasures:?}");
        let places = 31 * erasures.iter().sum::<u32>();
        if most_layers <= 16 {
            // With those kept for other records they fit a sector: no place is erased before it was used.
            assert!(places <= records + 2 * 31, "{places} places for {records} records");
        }
        // At the worst length of jobs, 5/8 are used.
        assert!(places * 5 <= (records + 2 * 31) * 8, "{places} places for {records} records");
    }
}

#[test]
fn a_job_of_the_robots_flash_may_have_six_thousand_layers_and_two_thousand_holds() {
    let flash = Flash::<{ 128 * 1024 }>::new(2);
    let mut journal = Journal::open(flash.clone());
    let layers = journal.capacity();
    assert_eq!(layers, 6143);
    while journal.erase_step(layers).unwrap() {}
    assert!(journal.needs_erasing(layers + 1));
    assert_eq!(journal.begin(1, ROBOT, layers + 1), Err(JournalError::Full));
    journal.begin(2, ROBOT, layers).unwrap();
    for index in 0..layers {
        let held = index % 3 == 0 && index < 2045 * 3;
        if held {
            journal.begun(index).unwrap();
        }
        journal.committed(index, &layer(2, index), false).unwrap();
    }
    journal.ended().unwrap();
    let mut journal = Journal::open(flash);
    assert_eq!(known(&mut journal).unwrap().state.laid, layers);
    for index in [6142, 0, 3000, 2999, 3001] {
        assert_eq!(journal.laid(index).unwrap().as_built, layer(2, index).as_built, "{index}");
    }
}

#[test]
fn a_job_whose_records_find_no_room_is_not_resumed() {
    let flash = Small::new(SECTORS);
    let mut journal = Journal::open(flash.clone());
    while journal.erase_step(47).unwrap() {}
    journal.begin(1, ROBOT, 47).unwrap();
    for _ in 0..61 {
        journal.begun(0).unwrap();
    }
    assert_eq!(journal.committed(0, &layer(1, 0), true), Err(JournalError::Full));
    assert_eq!(journal.committed(1, &layer(1, 1), true), Err(JournalError::NoJob));
    assert_eq!(Journal::open(flash.clone()).job(), None);
    live(&flash, &story(), || None);
}

#[test]
fn a_place_that_does_not_take_its_record_is_passed_over_and_of_broken_flash_nothing_is_resumed() {
    let flash = Small::new(SECTORS);
    let mut journal = Journal::open(flash.clone());
    while journal.erase_step(4).unwrap() {}
    journal.begin(1, ROBOT, 4).unwrap();
    let spoil = |places: std::ops::Range<usize>| {
        let mut bytes = flash.bytes();
        // Bits of the layer's first byte that cannot be set any more.
        places.for_each(|place| bytes[32 * place + 8] = 0);
        flash.set_bytes(&bytes);
    };
    spoil(2..4);
    journal.committed(0, &layer(1, 0), true).unwrap();
    assert_eq!(known(&mut Journal::open(flash.clone())), known(&mut journal));
    assert_eq!(journal.job().unwrap().laid, 1);
    // Such a place never reads as a record again.
    assert!(flash.bytes()[2 * 32..4 * 32].iter().all(|byte| *byte == 0));
    spoil(5..8);
    assert_eq!(journal.committed(1, &layer(1, 1), true), Err(JournalError::Flash));
    assert_eq!(Journal::open(flash.clone()).job(), None);
}

#[test]
fn a_record_that_is_missing_is_noticed_whatever_it_was() {
    // The second one: that a layer is begun.
    for missing in 2..6 {
        let flash = Small::new(SECTORS);
        let mut journal = Journal::open(flash.clone());
        while journal.erase_step(4).unwrap() {}
        journal.begin(1, ROBOT, 4).unwrap();
        journal.begun(0).unwrap();
        journal.committed(0, &layer(1, 0), false).unwrap();
        journal.begun(1).unwrap();
        journal.begun(1).unwrap();
        journal.committed(1, &layer(1, 1), false).unwrap();
        let mut bytes = flash.bytes();
        bytes[32 * missing..32 * (missing + 1)].fill(0);
        flash.set_bytes(&bytes);
        assert_eq!(Journal::open(flash.clone()).job(), None, "record {missing}");
    }
}

#[test]
fn up_to_14_records_that_are_missing_in_a_row_are_noticed() {
    // They are counted modulo 16, and one that is there twice counts once.
    let flash = Small::new(SECTORS);
    let mut journal = Journal::open(flash.clone());
    while journal.erase_step(4).unwrap() {}
    journal.begin(1, ROBOT, 4).unwrap();
    for _ in 0..20 {
        journal.begun(0).unwrap();
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
fn a_record_of_a_job_before_the_present_one_counts_for_nothing_wherever_it_lies() {
    let flash = Small::new(SECTORS);
    let mut journal = Journal::open(flash.clone());
    while journal.erase_step(4).unwrap() {}
    journal.begin(1, ROBOT, 4).unwrap();
    let place = |number: usize| 32 * number..32 * (number + 1);
    let earlier = flash.bytes()[place(1)].to_vec();
    journal.begin(2, ROBOT, 4).unwrap();
    journal.committed(0, &layer(2, 0), true).unwrap();
    let before = known(&mut journal);
    let mut bytes = flash.bytes();
    bytes[place(4)].copy_from_slice(&earlier);
    bytes[place(5)].copy_from_slice(&earlier);
    flash.set_bytes(&bytes);
    assert_eq!(known(&mut Journal::open(flash)), before);
}

/// The most layers of a job that could begin now.
fn room(journal: &Journal<Small>) -> u32 {
    (0..=64).rev().find(|layers| !journal.needs_erasing(*layers)).unwrap_or(0)
}

#[test]
fn after_any_job_all_places_can_be_used_and_none_twice() {
    for records in 1..60 {
        for restarted in [false, true] {
            let flash = Small::new(SECTORS);
            let mut journal = Journal::open(flash.clone());
            while journal.erase_step(47).unwrap() {}
            journal.begin(1, ROBOT, 4).unwrap();
            (0..records).for_each(|_| journal.begun(0).unwrap());
            journal.ended().unwrap();
            while journal.erase_step(47).unwrap() {}
            let mut places = 62;
            if restarted {
                // The first blank place may have been written to.
                journal = Journal::open(flash.clone());
                places -= 1;
            }
            assert_eq!(room(&journal), places - 15);
            journal.begin(2, ROBOT, 46).unwrap();
            (1..places).for_each(|_| journal.begun(0).unwrap());
            assert_eq!(journal.job().copied(), Journal::open(flash.clone()).job().copied());
            assert_eq!(journal.begun(0), Err(JournalError::Full), "{records} records");
        }
    }
}

#[test]
fn a_job_that_cannot_begin_ends_the_one_that_has_not() {
    let flash = Small::new(SECTORS);
    let mut journal = Journal::open(flash.clone());
    while journal.erase_step(4).unwrap() {}
    journal.begin(1, ROBOT, 4).unwrap();
    journal.begun(0).unwrap();
    assert_eq!(journal.begin(2, ROBOT, 1000), Err(JournalError::Full));
    assert_eq!((journal.job(), Journal::open(flash).job()), (None, None));
}

#[test]
fn a_job_that_cannot_begin_leaves_the_one_that_has_ended() {
    let flash = Small::new(SECTORS);
    let mut journal = Journal::open(flash.clone());
    while journal.erase_step(4).unwrap() {}
    journal.begin(1, ROBOT, 1).unwrap();
    journal.committed(0, &layer(1, 0), false).unwrap();
    journal.ended().unwrap();
    let ended = journal.job().copied();
    assert_eq!(journal.begin(2, ROBOT, 1000), Err(JournalError::Full));
    assert_eq!((journal.job().copied(), Journal::open(flash).job().copied()), (ended, ended));
}

type Try = fn(&mut Journal<Small>) -> Result<(), JournalError>;

#[test]
fn what_does_not_follow_ends_what_can_be_resumed() {
    let out_of_order: [Try; 8] = [
        |journal| journal.begun(3),
        |journal| journal.committed(1, &layer(1, 1), false),
        |journal| journal.skipped(3, &layer(1, 3)),
        |journal| journal.amended(1, 2, 8),
        |journal| journal.amended(9, 2, 8),
        // An index has 24 bits.
        |journal| journal.amended(1 << 24, 2, u32::MAX),
        // The job has four layers.
        |journal| (2..5).try_for_each(|index| journal.committed(index, &layer(1, index), false)),
        |journal| {
            (2..4).try_for_each(|index| journal.committed(index, &layer(1, index), false))?;
            journal.begun(4)
        },
    ];
    for deed in out_of_order {
        let flash = Small::new(SECTORS);
        let mut journal = Journal::open(flash.clone());
        assert_eq!(journal.ended(), Err(JournalError::NoJob));
        while journal.erase_step(4).unwrap() {}
        journal.begin(1, ROBOT, 4).unwrap();
        journal.committed(0, &layer(1, 0), true).unwrap();
        journal.committed(1, &layer(1, 1), true).unwrap();
        assert_eq!(deed(&mut journal), Err(JournalError::OutOfOrder));
        assert_eq!((journal.job(), Journal::open(flash).job()), (None, None));
    }
}

#[test]
fn a_job_that_has_not_ended_is_not_erased_before_it_is_forgotten() {
    let flash = Small::new(SECTORS);
    let mut journal = Journal::open(flash.clone());
    while journal.erase_step(20).unwrap() {}
    journal.begin(1, ROBOT, 20).unwrap();
    journal.begun(0).unwrap();
    let before = known(&mut journal);
    // Sector 1 is blank or has nothing of the job; sector 0 holds it.
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
    journal.begin(2, ROBOT, 47).unwrap();
    assert_eq!(Journal::open(flash).job().unwrap().plan_id, 2);
}

proptest! {
    #[test]
    fn flash_that_holds_anything_holds_no_journal(bytes in prop::collection::vec(any::<u8>(), 2048)) {
        let flash = Small::new(SECTORS);
        flash.set_bytes(&bytes);
        prop_assert!(Journal::open(flash.clone()).job().is_none());
        prop_assert_eq!(flash.bytes(), bytes);
        live(&flash, &story(), || None);
    }

    #[test]
    fn flipped_bits_yield_what_was_known_at_a_time_or_nothing(
        deeds in 1_usize..90,
        bits in prop::collection::vec(0_usize..2048 * 8, 1..20),
    ) {
        let flash = Small::new(SECTORS);
        let mut journal = Journal::open(flash.clone());
        let mut history = std::vec![None];
        for deed in story().iter().take(deeds) {
            deed.done(&mut journal).unwrap();
            history.push(known(&mut journal));
        }
        let mut bytes = flash.bytes();
        for bit in bits {
            bytes[bit / 8] ^= 1 << (bit % 8);
        }
        flash.set_bytes(&bytes);
        prop_assert!(history.contains(&known(&mut Journal::open(flash))));
    }
}
