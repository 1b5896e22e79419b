//! Tests of the journal: on flash that loses power at every byte of a sequence of calls, on worn flash, and on random
//! flash.

mod capacity;
mod exhaustive;
mod losses;
mod order;
mod weak_cells;

use std::vec::Vec;

use super::*;
use crate::testing::flash::Flash;

/// Flash with small sectors. Two of them have 31 slots each. 15 slots are reserved, so that a job may have 47 layers.
type Small = Flash<1024>;
const SECTORS: usize = 2;

const ROBOT: u64 = 0xfeed_0123_4567_89ab;

/// A call of the journal's functions.
#[derive(Debug, Clone, Copy)]
enum Deed {
    Erase(u32),
    Begin(u64, u32),
    Begun,
    /// Records the next layer as laid. The value is `true` if the layer after it is begun at once.
    Commit(bool),
    Skip,
    Amend(u32, u64, u32),
    End,
}

/// All data of the journal about its job.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Known {
    state: JournalJob,
    carry: RoundingCarry,
    laid: Vec<StoredLayer>,
}

/// Returns a layer record whose content identifies the plan and the layer.
fn layer(plan_id: u64, index: u32) -> LayerRecord {
    let mut as_built = LayerBytes::default();
    as_built[..8].copy_from_slice(&(plan_id ^ u64::from(index) << 32).to_le_bytes());
    as_built[8..].copy_from_slice(&index.to_le_bytes());
    LayerRecord { as_built, height_units: 1 << 24 | index, residual_lean: [index as i16, -3 - index as i16] }
}

fn known<F: MultiwriteNorFlash>(journal: &mut Journal<F>) -> Option<Known> {
    let state = *journal.job()?;
    let laid = (0..state.layers_laid).map(|index| journal.layer(index).unwrap()).collect();
    assert_eq!(journal.layer(state.layers_laid), None);
    Some(Known { state, carry: journal.carry(), laid })
}

impl Deed {
    fn done<F: MultiwriteNorFlash>(self, journal: &mut Journal<F>) -> Result<(), JournalError> {
        let state = journal.job().copied();
        let next = || state.map_or((0, 0), |state| (state.plan_id, state.layers_laid));
        let ((plan_id, index), laid) = (next(), layer(next().0, next().1));
        match self {
            Deed::Erase(layers) => {
                while journal.erase_step(layers)? {}
                Ok(())
            }
            Deed::Begin(plan_id, layers) => journal.begin_job(plan_id, ROBOT, layers),
            Deed::Begun => journal.record_begun(index),
            Deed::Commit(next_begun) => journal.record_laid(index, &laid, next_begun),
            Deed::Skip => journal.record_skipped(index, &layer(!plan_id, index)),
            Deed::Amend(from, plan_id, layers) => journal.record_amended(from, plan_id, layers),
            Deed::End => journal.record_ended(),
        }
    }

    /// Returns the data that the journal must have about its job after this call. `before` is the data before it.
    fn after(self, before: Option<&Known>) -> Option<Known> {
        if let Deed::Begin(plan_id, layers) = self {
            let state = JournalJob {
                plan_id,
                robot: ROBOT,
                layer_count: layers,
                layers_laid: 0,
                layers_begun: 0,
                ended: false,
            };
            return Some(Known { state, carry: RoundingCarry::default(), laid: Vec::new() });
        }
        let mut known = before?.clone();
        let Known { state, carry, laid } = &mut known;
        let mut lay = |interrupted| {
            let plan_id = if interrupted { !state.plan_id } else { state.plan_id };
            let layer = layer(plan_id, state.layers_laid);
            laid.push(StoredLayer { as_built: layer.as_built, interrupted });
            carry.height_units += u64::from(layer.height_units);
            carry.residual_lean = layer.residual_lean;
            state.layers_laid += 1;
            state.layers_begun = state.layers_laid;
        };
        match self {
            Deed::Erase(_) | Deed::Begin(..) => {}
            Deed::Begun => state.layers_begun = state.layers_laid + 1,
            Deed::Commit(next_begun) => {
                lay(false);
                state.layers_begun += u32::from(next_begun);
            }
            Deed::Skip => lay(true),
            Deed::Amend(_, plan_id, layers) => {
                (state.plan_id, state.layer_count) = (plan_id, layers);
            }
            Deed::End => state.ended = true,
        }
        Some(known)
    }
}

/// Returns the calls of a job of 22 layers with every kind of record.
fn job(plan_id: u64) -> Vec<Deed> {
    let mut deeds = std::vec![Deed::Begin(plan_id, 20), Deed::Begun];
    deeds.extend([Deed::Commit(true); 9]);
    deeds.extend([Deed::Commit(false), Deed::Begun, Deed::Commit(true), Deed::Skip, Deed::Begun]);
    deeds.extend([Deed::Amend(14, plan_id + 100, 22), Deed::Commit(true)]);
    deeds.extend([Deed::Commit(true); 8]);
    deeds.extend([Deed::Commit(false), Deed::End]);
    deeds
}

/// Returns the calls of several jobs, with every kind of erasure: of new flash, of one sector, and of the sector in
/// which the last job ended.
fn story() -> Vec<Deed> {
    let mut deeds = std::vec![Deed::Erase(20)];
    deeds.extend(job(1));
    deeds.push(Deed::Erase(20));
    deeds.extend(job(2));
    deeds.push(Deed::Erase(47));
    deeds.extend(job(3));
    // This job is replaced by the next one before it ends.
    deeds.push(Deed::Erase(8));
    deeds.extend([Deed::Begin(4, 8), Deed::Begun, Deed::Commit(true), Deed::Begin(5, 3), Deed::Begun]);
    deeds.extend([Deed::Commit(true), Deed::Commit(true), Deed::Commit(false), Deed::End]);
    deeds
}

/// Makes a sequence of calls. Power is lost during a call when `losses` returns a value. Each time the journal must
/// then have its data from before the call or from after it. The sequence continues from that data.
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
            // An ended job is lost with its sector. A job that has not ended is lost when the next one begins.
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

/// Returns the max number of layers of a job that can begin now without an erasure.
fn room(journal: &Journal<Small>) -> u32 {
    (0..=64).rev().find(|layers| !journal.needs_erasing(*layers)).unwrap_or(0)
}
