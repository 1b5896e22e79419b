//! Test of the journal in all states that losses of power can leave in a small flash.
//!
//! Power is lost at every word of every write and erasure, also while a start makes its repairs, up to three times in a
//! row. Flash is programmed word by word (STM32F405) or page by page (RP2040). Bits that were being programmed are
//! weak: they read in several ways, which may differ from reading to reading. Flash may refuse one write, or all writes
//! from one on until the next start. Each start must find the data from before or from after the interrupted journal
//! call, and later starts must find the same data.

use std::cell::RefCell;
use std::collections::HashSet;
use std::rc::Rc;

use embedded_storage::nor_flash::{
    ErrorType, MultiwriteNorFlash, NorFlash, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};

use super::*;

/// Number of record slots in a sector, without the sector's first record. No loss of power fills the journal.
const SLOTS: usize = 16;
const SECTOR_BYTES: usize = 32 * (SLOTS + 1);
const RECORD_WORDS: usize = 8;
/// Max number of losses of power during one sequence of calls.
const MAX_LOSSES: u8 = 3;

/// Functions that return the levels of weak bits. The argument is the number of earlier readings of the record since
/// the start.
const READINGS: [fn(u32) -> u32; 5] = [
    |_| u32::MAX,
    |_| 0,
    // The record is valid at the third reading only.
    |reading| if reading % 3 == 2 { 0 } else { u32::MAX },
    // The record is valid at the first reading only.
    |reading| if reading == 0 { 0 } else { u32::MAX },
    |_| 0xA5A5_A5A5,
];

/// The content of the simulated flash.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Cells {
    words: Vec<u32>,
    /// Weak bits, which read as 0 or 1. They are set in `words`.
    weak: Vec<u32>,
}

/// Events during one start of the journal and the calls after it.
#[derive(Debug, Clone, Copy)]
struct Events {
    /// Index of the function in [`READINGS`] that gives the levels of weak bits.
    reading: usize,
    /// Number of the step at which power is lost. `None` if it is not lost. A step programs a word or a page, or erases
    /// a sector.
    lost_at: Option<u32>,
    /// Numbers of the first and the last write or erasure that the flash refuses. `None` if it refuses none.
    refused: Option<(u32, u32)>,
}

#[derive(Debug)]
struct Model {
    cells: Cells,
    events: Events,
    programs_pages: bool,
    has_power: bool,
    steps: u32,
    operations: u32,
    readings: Vec<u32>,
}

/// Simulated flash with weak bits. All clones share their content.
#[derive(Debug, Clone)]
struct ModelFlash(Rc<RefCell<Model>>);

impl ModelFlash {
    fn new(cells: Cells, events: Events, programs_pages: bool) -> Self {
        let readings = std::vec![0; cells.words.len()];
        let model = Model { cells, events, programs_pages, has_power: true, steps: 0, operations: 0, readings };
        Self(Rc::new(RefCell::new(model)))
    }
}

impl Model {
    /// Counts a write or erasure. Returns an error if the flash refuses it or has lost power.
    fn count(&mut self) -> Result<(), NorFlashErrorKind> {
        self.operations += 1;
        let is_refused = self.is_refusing(self.operations - 1);
        if !self.has_power || is_refused { Err(NorFlashErrorKind::Other) } else { Ok(()) }
    }

    fn is_refusing(&self, operation: u32) -> bool {
        self.events.refused.is_some_and(|(first, last)| (first..=last).contains(&operation))
    }

    /// Counts a step. Returns an error if power is lost during it.
    fn step(&mut self) -> Result<(), NorFlashErrorKind> {
        self.has_power = self.events.lost_at != Some(self.steps);
        self.steps += 1;
        if self.has_power { Ok(()) } else { Err(NorFlashErrorKind::Other) }
    }
}

impl ErrorType for ModelFlash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for ModelFlash {
    const READ_SIZE: usize = 4;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        check_read(self, offset, bytes.len())?;
        let model = &mut *self.0.borrow_mut();
        if !model.has_power {
            return Err(NorFlashErrorKind::Other);
        }
        let first = offset as usize / 4;
        let weak_bits = READINGS[model.events.reading](model.readings[first]);
        model.readings[first] += 1;
        for (word, into) in (first..).zip(bytes.as_chunks_mut::<4>().0) {
            let Cells { words, weak } = &model.cells;
            *into = (words[word] & !weak[word] | weak[word] & weak_bits).to_le_bytes();
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        4 * self.0.borrow().cells.words.len()
    }
}

impl NorFlash for ModelFlash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        check_erase(self, from, to)?;
        let model = &mut *self.0.borrow_mut();
        model.count()?;
        let done = model.step();
        let words = from as usize / 4..to as usize / 4;
        model.cells.words[words.clone()].fill(u32::MAX);
        model.cells.weak[words].fill(if done.is_ok() { 0 } else { u32::MAX });
        done
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        check_write(self, offset, bytes.len())?;
        let model = &mut *self.0.borrow_mut();
        model.count()?;
        let words: Vec<_> = (offset as usize / 4..).zip(bytes.as_chunks::<4>().0).collect();
        for step in words.chunks(if model.programs_pages { RECORD_WORDS } else { 1 }) {
            let done = model.step();
            for (word, value) in step {
                let value = u32::from_le_bytes(**value);
                if done.is_ok() {
                    model.cells.words[*word] &= value;
                    model.cells.weak[*word] &= value;
                } else {
                    model.cells.weak[*word] |= model.cells.words[*word] & !value;
                }
            }
            done?;
        }
        Ok(())
    }
}

impl MultiwriteNorFlash for ModelFlash {}

/// State of the search: the content of the flash after a loss of power, and the data that the next start may find in
/// it.
#[derive(Debug, Clone, PartialEq, Eq, Hash)]
struct Node {
    cells: Cells,
    /// Number of journal calls that have returned before the loss of power.
    done: usize,
    /// Data that the journal may have. The next start must find one of them. `None` means no job.
    expected: Vec<Option<Known>>,
    /// Data of the job before the current one. The journal finds that job again if the only record of the current job
    /// is struck out.
    previous: Option<Known>,
    losses: u8,
    was_refused: bool,
}

struct Search {
    story: Vec<Deed>,
    programs_pages: bool,
    /// All nodes that the search has found so far, each once.
    nodes: HashSet<Node>,
    open: Vec<Node>,
    runs: u64,
}

/// Result of a start and of the journal calls after the start.
struct Run {
    node: Node,
    steps: u32,
    operations: u32,
}

impl Search {
    /// Starts the journal from a node and makes the remaining calls, until power is lost or all calls are made.
    fn run(&self, from: &Node, events: Events) -> Run {
        let flash = ModelFlash::new(from.cells.clone(), events, self.programs_pages);
        let mut journal = Journal::open(flash.clone());
        let mut node = from.clone();
        self.carry_on(&mut journal, &flash, from, &mut node, events);
        let model = flash.0.borrow();
        // An erasure with nothing to erase leaves a weak record as it is.
        let is_as_before = node.done <= from.done + 1 || journal.weak_tail.is_some();
        if model.has_power && model.is_refusing(model.operations) && is_as_before {
            // Nothing was appended and nothing could be repaired, so the next start may read the weak bits differently.
            node.done = from.done;
            node.expected = [from.expected.clone(), node.expected].concat();
        }
        node.cells = model.cells.clone();
        node.losses += u8::from(!model.has_power);
        node.was_refused |= events.refused.is_some();
        Run { node, steps: model.steps, operations: model.operations }
    }

    fn carry_on(
        &self,
        journal: &mut Journal<ModelFlash>,
        flash: &ModelFlash,
        from: &Node,
        node: &mut Node,
        events: Events,
    ) {
        let has_power = || flash.0.borrow().has_power;
        let refuses = || flash.0.borrow().is_refusing(flash.0.borrow().operations);
        if !has_power() {
            return;
        }
        let mut before = known_among(journal, &from.expected);
        let what = || std::format!("{events:?} from {:x?}, call {} after {:?}", from.cells, from.done, from.expected);
        assert!(from.expected.contains(&before), "{before:?} was found: {}", what());
        // The interrupted call was complete.
        let interrupted = self.story.get(node.done).filter(|deed| !matches!(deed, Deed::Erase(_)));
        if let (Some(deed), [first, ..]) = (interrupted, &from.expected[..])
            && from.expected.len() > 1
            && before.is_some()
            && before == deed.after(first.as_ref())
        {
            if matches!(deed, Deed::Begin(..)) {
                node.previous.clone_from(first);
            }
            node.done += 1;
        }
        while let Some(deed) = self.story.get(node.done).copied() {
            let is_record = !matches!(deed, Deed::Erase(_) | Deed::Begin(..));
            if is_record && before.as_ref().is_none_or(|known| known.state.ended) {
                // The job is lost, so its other calls are, too.
                node.done += 1;
                continue;
            }
            if let Deed::Begin(_, layers) = deed
                && journal.needs_erasing(layers)
            {
                // Restarts have used slots since the erasure. The controller erases before each job.
                let erasure = node.done.checked_sub(1).filter(|last| matches!(self.story[*last], Deed::Erase(_)));
                node.done = erasure.unwrap_or(self.story.len());
                continue;
            }
            let after = deed.after(before.as_ref());
            let result = deed.done(journal);
            let unended = before.as_ref().is_some_and(|known| !known.state.ended);
            let may_be_gone = matches!(deed, Deed::Erase(_)) && !unended || matches!(deed, Deed::Begin(..)) && unended;
            node.expected = std::vec![before.clone(), after.clone()];
            if may_be_gone || result.is_err() && has_power() {
                node.expected.extend([None, node.previous.clone()]);
            }
            if !has_power() {
                return;
            }
            if let Err(error) = result {
                assert!(events.refused.is_some() && error != JournalError::Full, "{deed:?}: {error:?}: {}", what());
                before = known_among(journal, &node.expected);
                assert!(before.is_none() || !is_record, "{deed:?} failed, and the job goes on: {}", what());
                // The growth continues, and another layer begins.
                let again = journal.record_begun(0);
                if !has_power() || refuses() {
                    return;
                }
                assert!(again.is_err() || !is_record, "{}", what());
                if is_record {
                    node.expected = std::vec![None, node.previous.clone()];
                    node.done = self.story.len();
                    return;
                }
                before = known_among(journal, &node.expected);
                node.done += usize::from(before.is_none());
                node.expected = std::vec![before.clone()];
                continue;
            }
            before = if may_be_gone && journal.job().is_none() { None } else { after };
            assert_eq!(journal.job(), before.as_ref().map(|known| &known.state), "{deed:?}: {}", what());
            if matches!(deed, Deed::Begin(..)) {
                node.previous = node.expected[0].clone();
            }
            node.done += 1;
            node.expected = std::vec![before.clone()];
        }
        node.expected = std::vec![before];
    }

    fn add(&mut self, node: Node) {
        if self.nodes.insert(node.clone()) {
            self.open.push(node);
        }
    }

    /// Runs every start with every event, from every node that the search finds.
    fn search(&mut self) {
        while let Some(node) = self.open.pop() {
            for reading in 0..READINGS.len() {
                let whole = self.explore(&node, Events { reading, lost_at: None, refused: None });
                if node.losses < MAX_LOSSES {
                    for step in 0..whole.steps {
                        self.explore(&node, Events { reading, lost_at: Some(step), refused: None });
                    }
                }
                if !node.was_refused {
                    for first in 0..whole.operations {
                        for last in [first, u32::MAX] {
                            self.explore(&node, Events { reading, lost_at: None, refused: Some((first, last)) });
                        }
                    }
                }
            }
        }
    }

    fn explore(&mut self, node: &Node, events: Events) -> Run {
        self.runs += 1;
        let run = self.run(node, events);
        self.add(run.node.clone());
        run
    }
}

/// Returns all data of the journal about its job. While the last record is weak and the flash refuses to program it
/// again, the layer of that record may be unreadable. The layer is then taken from the expected data.
fn known_among(journal: &mut Journal<ModelFlash>, expected: &[Option<Known>]) -> Option<Known> {
    if journal.weak_tail.is_none() {
        return known(journal);
    }
    let (state, carry) = (*journal.job()?, journal.carry());
    let is_same = |known: &&Known| (known.state, known.carry) == (state, carry);
    expected.iter().flatten().find(is_same).cloned().or(Some(Known { state, carry, laid: Vec::new() }))
}

/// Returns 22 journal calls, which contain every kind of record and erasure.
fn calls() -> Vec<Deed> {
    let laid = Deed::Commit(false);
    let mut calls = std::vec![Deed::Erase(3), Deed::Begin(1, 3), Deed::Begun, Deed::Commit(true), laid];
    calls.extend([Deed::Begun, laid, Deed::End]);
    calls.extend([Deed::Erase(2), Deed::Begin(2, 2), Deed::Begun, Deed::Skip, Deed::Amend(1, 102, 2)]);
    calls.extend([Deed::Begun, laid, Deed::End]);
    calls.extend([Deed::Erase(3), Deed::Begin(3, 3), Deed::Begun, Deed::Begin(4, 1), laid, Deed::End]);
    calls
}

/// Returns the first node of the search: a flash whose oldest sector must be erased at the first call.
fn worn() -> Node {
    let new = Cells { words: std::vec![u32::MAX; 2 * SECTOR_BYTES / 4], weak: std::vec![0; 2 * SECTOR_BYTES / 4] };
    let flash = ModelFlash::new(new, Events { reading: 0, lost_at: None, refused: None }, false);
    let mut journal = Journal::open(flash.clone());
    let job = [Deed::Begin(9, 1), Deed::Begun, Deed::Commit(false), Deed::End];
    while flash.0.borrow().operations < 60 || !journal.needs_erasing(3) {
        for deed in [&[Deed::Erase(1)][..], &job].concat() {
            deed.done(&mut journal).unwrap();
        }
    }
    let cells = flash.0.borrow().cells.clone();
    Node { cells, done: 0, expected: std::vec![known(&mut journal)], previous: None, losses: 0, was_refused: false }
}

#[test]
fn every_loss_of_power_and_refused_write_leaves_the_old_or_the_new_data() {
    let deeds = crate::testing::number_from_environment("GROWBOT_JOURNAL_CALLS", 5) as usize;
    for programs_pages in [false, true] {
        let story = calls().into_iter().take(deeds).collect();
        let mut search = Search { story, programs_pages, nodes: HashSet::new(), open: Vec::new(), runs: 0 };
        search.add(worn());
        search.search();
        let unit = if programs_pages { "pages" } else { "words" };
        std::println!("{unit}, {deeds} calls: {} states, {} starts", search.nodes.len(), search.runs);
        assert!(search.nodes.len() > 1000, "{} states", search.nodes.len());
    }
}
