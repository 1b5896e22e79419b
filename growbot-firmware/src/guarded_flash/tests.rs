//! Tests of flash that is changed only while the supply is high enough, alone and below a journal.

use std::cell::Cell;
use std::rc::Rc;

use growbot_core::layer_bytes::LayerBytes;

use super::*;
use crate::journal::{Journal, JournalError, LayerRecord};
use crate::testing::flash::Flash;

type Small = Flash<1024>;
const LAYER: LayerRecord =
    LayerRecord { as_built: [7; size_of::<LayerBytes>()], height_units: 1, residual_lean: [0; 2] };

type Supply = Rc<Cell<bool>>;

impl SupplyMonitor for Supply {
    fn is_enough(&self) -> bool {
        self.get()
    }
}

/// Returns a guarded view of `flash`, and the switch that sets whether its detector reports enough voltage.
fn below(flash: &Small, enough: bool) -> (GuardedFlash<Small, Supply>, Supply) {
    let supply = Rc::new(Cell::new(enough));
    (GuardedFlash::new(flash.clone(), Rc::clone(&supply)), supply)
}

#[test]
fn without_supply_flash_is_readable_but_not_written() {
    let flash = Small::new(2);
    let (mut supplied, supply) = below(&flash, true);
    assert_eq!(supplied.capacity(), 2048);
    supplied.write(8, &[1, 2, 3, 4]).unwrap();
    supply.set(false);
    let before = flash.bytes();
    assert_eq!(supplied.write(8, &[0; 4]), Err(NorFlashErrorKind::Other));
    assert_eq!(supplied.erase(0, 1024), Err(NorFlashErrorKind::Other));
    assert_eq!((flash.bytes(), flash.erasures()), (before, std::vec![0, 0]));
    let mut bytes = [0; 4];
    supplied.read(8, &mut bytes).unwrap();
    assert_eq!(bytes, [1, 2, 3, 4]);
    supply.set(true);
    supplied.erase(0, 1024).unwrap();
    assert_eq!((flash.bytes(), flash.erasures()), (std::vec![0xff; 2048], std::vec![1, 0]));
}

/// Returns flash with the journal of a job, of which a layer is laid.
fn flash_with_a_job() -> Small {
    let flash = Small::new(2);
    let mut journal = Journal::open(flash.clone());
    while journal.erase_step(4).unwrap() {}
    journal.begin_job(1, 2, 4).unwrap();
    journal.record_laid(0, &LAYER, true).unwrap();
    flash
}

#[test]
fn a_start_at_low_supply_writes_nothing_and_the_next_one_finds_the_job() {
    let flash = flash_with_a_job();
    // Power was lost while the last record was programmed. At too low a voltage the record reads as torn.
    let whole = flash.bytes();
    let mut torn = whole.clone();
    torn[32 * 2 + 8] ^= 0xf0;
    flash.set_bytes(&torn);
    let (supplied, _) = below(&flash, false);
    assert_eq!(Journal::open(supplied).job().map(|job| job.layers_laid), Some(0));
    assert_eq!(flash.bytes(), torn, "it has not been struck out");
    flash.set_bytes(&whole);
    let (supplied, supply) = below(&flash, true);
    let mut journal = Journal::open(supplied);
    assert_eq!(journal.job().map(|job| job.layers_laid), Some(1));
    // The journal returns an error for a record that it could not write.
    supply.set(false);
    assert_eq!(journal.record_laid(1, &LAYER, true), Err(JournalError::Flash));
    assert_eq!(journal.job(), None);
}

#[test]
fn a_repair_refused_at_a_start_is_made_before_the_next_record() {
    for is_valid in [false, true] {
        let flash = Small::new(2);
        let mut journal = Journal::open(flash.clone());
        while journal.erase_step(4).unwrap() {}
        journal.begin_job(1, 2, 4).unwrap();
        journal.record_laid(0, &LAYER, true).unwrap();
        // Power was lost while this record was programmed. Its cells read as torn or as valid until they are programmed
        // again.
        let mut torn = flash.bytes();
        let record = torn[32 * 2..32 * 3].to_vec();
        let mut mask = std::vec![0; 32];
        mask[8] = !record[8];
        torn[32 * 2 + 8] = 0xff;
        flash.weaken(32 * 2, &mask);
        flash.set_bytes(&torn);
        flash.read_weak_as(if is_valid { &record } else { &[0xff; 32] });
        let (supplied, supply) = below(&flash, false);
        let mut journal = Journal::open(supplied);
        let laid = u32::from(is_valid);
        assert_eq!(journal.job().map(|job| job.layers_laid), Some(laid));
        supply.set(true);
        journal.record_laid(laid, &LAYER, false).unwrap();
        // At the next start the cells read the other way, unless they were programmed again.
        flash.read_weak_as(if is_valid { &[0xff; 32] } else { &record });
        assert_eq!(Journal::open(flash).job().map(|job| job.layers_laid), Some(laid + 1), "valid: {is_valid}");
    }
}

/// Number of writes and erasures for which the supply is still too low.
struct Refusals(Rc<Cell<u32>>);

impl SupplyMonitor for Refusals {
    fn is_enough(&self) -> bool {
        let left = self.0.get();
        self.0.set(left.saturating_sub(1));
        left == 0
    }
}

#[test]
fn nothing_is_appended_after_a_repair_that_is_refused_again() {
    let flash = flash_with_a_job();
    let mut torn = flash.bytes();
    torn[32 * 2 + 8] ^= 0xf0;
    flash.set_bytes(&torn);
    let refusals = Rc::new(Cell::new(u32::MAX));
    let mut journal = Journal::open(GuardedFlash::new(flash.clone(), Refusals(Rc::clone(&refusals))));
    assert_eq!(journal.job().map(|job| job.layers_laid), Some(0));
    refusals.set(1);
    // A record beside one that may read as valid later would have the same count.
    assert_eq!(journal.record_laid(0, &LAYER, true), Err(JournalError::Flash));
    assert_eq!(refusals.get(), 0);
    assert_eq!(flash.bytes()[32 * 3..1024], [0xff; 1024 - 32 * 3]);
    assert_eq!(Journal::open(flash).job(), None);
}
