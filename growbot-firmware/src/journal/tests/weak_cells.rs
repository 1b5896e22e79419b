//! Tests of the journal with a last record whose cells read differently at each start after a loss of power.
//!
//! Bits that were being programmed when power was lost may read as 0 or as 1 at any time until they are programmed
//! again. For all readings, in any order, the data that one start finds must never change later. They must be the data
//! from before the record or from after it.

use super::*;
use crate::journal::record::RecordBytes;

/// Weak cells of a record: the bits that may read differently each time.
struct Weak {
    /// Bytes of the record with the values of the bits that are not weak.
    base: RecordBytes,
    /// Mask of the weak bits.
    mask: RecordBytes,
    /// Bytes from which the weak bits take their values when the record is read.
    readings: Vec<RecordBytes>,
}

/// Returns the ways in which cells of a record may be weak: each word, with the later words written or not, and each
/// bit.
fn weaknesses(record: &RecordBytes) -> Vec<Weak> {
    let mut all = Vec::new();
    let half = |pattern: u8| record.map(|byte| byte | pattern);
    for word in 0..8 {
        let at = 4 * word..4 * word + 4;
        let mut mask = [0; 32];
        mask[at.clone()].copy_from_slice(&record[at.clone()].iter().map(|byte| !byte).collect::<Vec<_>>());
        let mut torn = *record;
        torn[at.end..].fill(0xff);
        for base in [*record, torn] {
            all.push(Weak { base, mask, readings: std::vec![*record, BLANK, half(0xA5), half(0x5A)] });
        }
    }
    for bit in (0..256).filter(|bit| record[bit / 8] >> (bit % 8) & 1 == 0) {
        let mut mask = [0; 32];
        mask[bit / 8] = 1 << (bit % 8);
        all.push(Weak { base: *record, mask, readings: std::vec![*record, BLANK] });
    }
    all
}

/// A journal call, the content of the flash after it, the offset of its last write, and the data that the journal must
/// find if that write is lost (`before`) or complete (`after`).
struct Case {
    deed: Deed,
    bytes: Vec<u8>,
    offset: usize,
    before: Option<Known>,
    after: Option<Known>,
}

/// Returns a case for each record of [`story`]. In the flash of the case, that record is the last one.
fn cases() -> Vec<Case> {
    let flash = Small::new(SECTORS);
    let mut journal = Journal::open(flash.clone());
    let mut known_before = None;
    let mut cases = Vec::new();
    for deed in story() {
        if let Deed::Erase(layers) = deed {
            loop {
                let before = flash.bytes();
                if !journal.needs_erasing(layers) {
                    break;
                }
                journal.erase_step(layers).unwrap();
                known_before = known(&mut journal);
                let bytes = flash.bytes();
                let offset =
                    (0..SECTORS).map(|sector| 1024 * sector).find(|at| bytes[*at..*at + 32] != before[*at..*at + 32]);
                let (before, after) = (known_before.clone(), known_before.clone());
                cases.push(Case { deed, bytes, offset: offset.unwrap(), before, after });
            }
            continue;
        }
        let before = flash.bytes();
        deed.done(&mut journal).unwrap();
        let bytes = flash.bytes();
        let after = deed.after(known_before.as_ref());
        let offset = (0..bytes.len()).step_by(32).rfind(|at| bytes[*at..*at + 32] != before[*at..*at + 32]);
        cases.push(Case { deed, bytes, offset: offset.unwrap(), before: known_before, after: after.clone() });
        known_before = after;
    }
    cases
}

/// Makes the journal calls that follow on these data. Returns the data that the journal must have afterwards.
fn carry_on(journal: &mut Journal<Small>, known: Option<Known>) -> Option<Known> {
    let deeds = match known.as_ref().map(|known| known.state) {
        Some(state) if !state.ended && state.layers_laid < state.layer_count => std::vec![Deed::Commit(true)],
        Some(state) if !state.ended => std::vec![Deed::End],
        _ => std::vec![Deed::Erase(3), Deed::Begin(99, 3)],
    };
    deeds.into_iter().fold(known, |known, deed| {
        deed.done(journal).unwrap();
        deed.after(known.as_ref())
    })
}

impl Case {
    fn flash(&self, weak: &Weak) -> Small {
        let flash = Small::new(SECTORS);
        let mut bytes = self.bytes.clone();
        bytes[self.offset..self.offset + 32].copy_from_slice(&weak.base);
        flash.set_bytes(&bytes);
        flash.weaken(self.offset, &weak.mask);
        flash
    }

    /// Starts the journal once for each reading of the weak cells, and checks the data that it finds. If `works`, makes
    /// further calls after each start.
    fn live(&self, weak: &Weak, readings: &[RecordBytes], works: bool) {
        let flash = self.flash(weak);
        let mut expected: Option<Option<Known>> = None;
        for reading in readings {
            flash.read_weak_as(reading);
            let mut journal = Journal::open(flash.clone());
            let found = known(&mut journal);
            let what = || std::format!("{:?}, mask {:x?}, base {:x?}, {readings:x?}", self.deed, weak.mask, weak.base);
            match &expected {
                None => assert!(found == self.before || found == self.after, "{found:?}: {}", what()),
                Some(expected) => assert_eq!(&found, expected, "{}", what()),
            }
            expected = Some(if works { carry_on(&mut journal, found) } else { found });
        }
    }
}

/// Returns every sequence of `length` elements that are taken from `of`.
fn sequences<T: Copy>(of: &[T], length: usize) -> Vec<Vec<T>> {
    (0..length).fold(std::vec![Vec::new()], |sequences, _| {
        let longer = |sequence: Vec<T>| of.iter().map(move |next| [&sequence[..], &[*next]].concat());
        sequences.into_iter().flat_map(longer).collect()
    })
}

#[test]
fn no_state_is_lost_for_any_reading_of_the_last_record_at_three_starts() {
    let mut lives = 0;
    for case in cases() {
        let record = case.bytes[case.offset..case.offset + 32].try_into().unwrap();
        for weak in weaknesses(&record) {
            for readings in sequences(&weak.readings, 3) {
                for works in [false, true] {
                    case.live(&weak, &readings, works);
                    lives += 1;
                }
            }
        }
    }
    std::println!("{lives} sequences of three starts");
    assert!(lives > 200_000);
}

#[test]
fn a_power_loss_during_recovery_loses_at_most_the_weak_record() {
    let mut losses = 0;
    for case in cases() {
        let record = case.bytes[case.offset..case.offset + 32].try_into().unwrap();
        for weak in weaknesses(&record).iter().filter(|weak| weak.readings.len() > 2) {
            for readings in sequences(&weak.readings, 2) {
                for bytes in [0, 1, 4, 11, 16, 27, 31, 32, 33, 48] {
                    let flash = case.flash(weak);
                    flash.read_weak_as(&readings[0]);
                    flash.lose_power_after(bytes, bytes as u64);
                    drop(Journal::open(flash.clone()));
                    flash.power_up();
                    flash.read_weak_as(&readings[1]);
                    let mut journal = Journal::open(flash.clone());
                    let found = known(&mut journal);
                    assert!(found == case.before || found == case.after, "{:?}: {found:?}", case.deed);
                    let expected = carry_on(&mut journal, found);
                    flash.read_weak_as(&readings[0]);
                    assert_eq!(known(&mut Journal::open(flash)), expected, "{:?}", case.deed);
                    losses += 1;
                }
            }
        }
    }
    assert!(losses > 100_000, "{losses}");
}

#[test]
fn a_skipped_slot_that_later_reads_as_valid_loses_nothing() {
    // One bit of the slot reads as 1 although the record is written there, so that the record goes to the next slot.
    // Later the bit reads as 0.
    let flash = Small::new(SECTORS);
    let mut journal = Journal::open(flash.clone());
    Deed::Erase(20).done(&mut journal).unwrap();
    Deed::Begin(1, 20).done(&mut journal).unwrap();
    let mut expected = known(&mut journal);
    for deed in [Deed::Begun, Deed::Commit(true), Deed::Skip, Deed::Amend(14, 101, 22)] {
        deed.done(&mut journal).unwrap();
        expected = deed.after(expected.as_ref());
        let mut bytes = flash.bytes();
        let written = (0..bytes.len()).step_by(32).rfind(|at| bytes[*at..*at + 32] != BLANK && at / 1024 == 0).unwrap();
        // The same record is stored again in the next slot.
        let copy: Vec<u8> = bytes[written..written + 32].to_vec();
        bytes[written + 32..written + 64].copy_from_slice(&copy);
        flash.set_bytes(&bytes);
        journal = Journal::open(flash.clone());
        assert_eq!(known(&mut journal), expected, "{deed:?}");
    }
}

#[test]
fn a_record_that_reads_as_blank_and_reappears_later_loses_nothing() {
    for case in cases() {
        let record: RecordBytes = case.bytes[case.offset..case.offset + 32].try_into().unwrap();
        let half = record.map(|byte| byte | 0xA5);
        let weak = Weak { base: BLANK, mask: record.map(|byte| !byte), readings: std::vec![record, BLANK, half] };
        for readings in sequences(&weak.readings, 4) {
            case.live(&weak, &readings, true);
        }
    }
}

#[test]
fn a_sector_found_blank_is_blank_at_the_next_start() {
    let whole = Small::new(SECTORS);
    Deed::Erase(47).done(&mut Journal::open(whole.clone())).unwrap();
    for sector in 0..SECTORS {
        let offset = 1024 * sector;
        let record: RecordBytes = whole.bytes()[offset..offset + 32].try_into().unwrap();
        let flash = Small::new(SECTORS);
        flash.set_bytes(&whole.bytes());
        flash.weaken(offset, &record.map(|byte| !byte));
        for reading in [record, BLANK, record.map(|byte| byte | 0xA5)] {
            flash.read_weak_as(&reading);
            // One slot is skipped.
            assert_eq!(room(&Journal::open(flash.clone())), 62 - 1 - 15, "sector {sector}");
        }
    }
}

#[test]
fn an_unreadable_record_does_not_reappear_at_the_next_start() {
    for case in cases().iter().filter(|case| !matches!(case.deed, Deed::Erase(_))) {
        // Flash that refuses to be read is treated like a record of zeros.
        assert_eq!(
            flickering(case, &[&[0_u8; 32][..]; 3]),
            [case.before.clone(), case.before.clone()],
            "{:?}",
            case.deed
        );
    }
}

/// Starts the journal twice. At the first start the last record reads as in `readings`, one after the other, and at the
/// second start it reads correctly. Returns the data that the journal finds at each start.
fn flickering(case: &Case, readings: &[&[u8]]) -> [Option<Known>; 2] {
    let flash = Small::new(SECTORS);
    flash.set_bytes(&case.bytes);
    flash.flicker(case.offset, readings);
    [(); 2].map(|()| known(&mut Journal::open(flash.clone())))
}

#[test]
fn a_record_that_is_valid_in_one_of_three_reads_counts() {
    for case in cases().iter().filter(|case| !matches!(case.deed, Deed::Erase(_))) {
        let record = &case.bytes[case.offset..case.offset + 32];
        let mut other = record.to_vec();
        other[30] ^= 0x40;
        for readings in [&[&other[..], record][..], &[&other, &other, record]] {
            assert_eq!(flickering(case, readings), [case.after.clone(), case.after.clone()], "{:?}", case.deed);
        }
        assert_eq!(flickering(case, &[&other, &other, &other]), [case.before.clone(), case.before.clone()]);
    }
}

#[test]
fn a_record_in_weak_cells_is_rewritten_to_another_slot() {
    for case in cases().iter().filter(|case| !matches!(case.deed, Deed::Erase(_))) {
        let flash = Small::new(SECTORS);
        flash.set_bytes(&case.bytes);
        let record = &case.bytes[case.offset..case.offset + 32];
        let mut other = record.to_vec();
        other[30] ^= 0x40;
        // The record first reads as valid, but never again once it has been programmed again.
        flash.flicker(case.offset, &[record, &other]);
        assert_eq!(known(&mut Journal::open(flash.clone())), case.after, "{:?}", case.deed);
        let mut bytes = flash.bytes();
        bytes[case.offset + 30] ^= 0x40;
        flash.set_bytes(&bytes);
        assert_eq!(known(&mut Journal::open(flash)), case.after, "{:?}", case.deed);
    }
}
