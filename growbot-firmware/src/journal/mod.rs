//! The progress journal: the progress of a growth, in flash, so that the growth can be resumed at its layer after a
//! reset or a loss of power.
//!
//! Records of 32 bytes (`record`) are appended in a ring of two or more erase sectors:
//!
//! ```text
//! sector 0: | sector | job 7 | begun 0 | laid 0 | laid 1 | ... | laid 4091 |
//! sector 1: | sector | laid 4092 | ... | ended | job 8 | begun 0 | laid 0 | (blank) ...
//! ```
//!
//! - A record counts as a whole or not at all, by its CRC. A record that was torn by a loss of power is passed over,
//!   and the next one goes to the next place.
//! - Cells that lost their power while they were programmed may read differently at each start. So a start settles what
//!   they say for good: the last record is programmed again if it reads as whole, and struck out if not. The first
//!   blank place may have been written to and read as blank. It is passed over, and struck out before anything is
//!   written after it.
//! - A record that is there twice in a row counts once, since a place that seemed not to accept it may read as if it
//!   had.
//! - Every record has the number of its job, and jobs are counted for ever. The present job is the one with the max
//!   number of any record. If one of its records is missing, except for the last ones, there is no job.
//! - A sector is erased only between jobs, when the next job would not fit into the blank places; the sector written
//!   longest ago is erased first. Its first record is struck out before and written anew after: without it the sector
//!   has no journal, even after an interrupted erasure.
//! - If a record cannot be written, the present job's own record is struck out: better no growth to resume than one to
//!   resume at the wrong layer.

mod present;
mod record;
#[cfg(test)]
mod tests;

use embedded_storage::nor_flash::MultiwriteNorFlash;
use growbot_core::layer_bytes::LayerBytes;

pub use present::{Carry, JobState};
use present::{Found, Present};
pub use record::Laid;
use record::{BLANK, Kind, RECORD_BYTES, Record, RecordBytes, STRUCK, split};

/// Number of places at which a record is tried before flash counts as broken.
const ATTEMPTS: u32 = 3;
/// The part of the area, one in this number, that is reserved for records that are not layers: those of pauses and of
/// amended plans.
const SPARE_PART: u32 = 4;

/// The reason why a record is not in the journal, or a sector not erased.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JournalError {
    /// There is no room: erase, or grow without a journal.
    Full,
    /// No job is under way.
    NoJob,
    /// The record does not follow from those before it.
    OutOfOrder,
    /// The sector has a job that has not ended: end it or forget it first.
    JobNotEnded,
    /// Flash refuses, or reads differently from what was written.
    Flash,
}

/// A layer of the present job that is laid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LaidRecord {
    /// The layer as built.
    pub as_built: LayerBytes,
    /// Whether it was interrupted, and counts as laid.
    pub interrupted: bool,
}

/// The journal in one area of flash, all of it.
///
/// Places of records are counted through the sectors, without the first one of each.
pub struct Journal<F> {
    flash: F,
    /// The place of the next record.
    next: u32,
    /// Blank places from there on, round the ring.
    free: u32,
    /// The max count of erasures.
    erasures: u32,
    /// The max number of a job.
    jobs: u32,
    /// A place that reads as blank, and may have been written to as power was lost.
    doubtful: Option<u32>,
    present: Option<Present>,
}

/// The last place that is not blank, as far as the journal has been read.
#[derive(Clone, Copy)]
struct Tail {
    place: u32,
    bytes: RecordBytes,
}

impl<F: MultiwriteNorFlash> Journal<F> {
    /// Places in a sector.
    const PLACES: u32 = {
        assert!(F::ERASE_SIZE >= 2 * RECORD_BYTES && F::ERASE_SIZE.is_multiple_of(RECORD_BYTES));
        assert!(RECORD_BYTES.is_multiple_of(F::WRITE_SIZE) && RECORD_BYTES.is_multiple_of(F::READ_SIZE));
        (F::ERASE_SIZE / RECORD_BYTES - 1) as u32
    };

    /// Reads the area, and settles what a loss of power has left in doubt. Anything that is no journal counts as flash
    /// to be erased, and nothing is written there.
    pub fn open(flash: F) -> Self {
        let mut journal = Self { flash, next: 0, free: 0, erasures: 0, jobs: 0, doubtful: None, present: None };
        let sectors = journal.sectors();
        let mut newest = sectors.saturating_sub(1);
        for sector in 0..sectors {
            if let Some(Record { content: [erasures, ..], .. }) = journal.sector_record(sector)
                && erasures >= journal.erasures
            {
                (newest, journal.erasures) = (sector, erasures);
            }
        }
        // The sector after the one erased last was written longest ago.
        let mut tail = None;
        for sector in (0..sectors).cycle().skip(newest as usize + 1).take(sectors as usize) {
            journal.read_sector(sector, &mut tail);
        }
        journal.settle(tail);
        journal
    }

    /// The job that was begun last, if all of it can be read.
    pub fn job(&self) -> Option<&JobState> {
        self.present.as_ref().map(|present| &present.state)
    }

    /// The max number of layers of a job: a quarter of the places is left for other records.
    pub fn capacity(&self) -> u32 {
        self.places() - self.places() / SPARE_PART
    }

    /// Whether a job of this number of layers cannot begin before something is erased.
    pub fn needs_erasing(&self, layers: u32) -> bool {
        self.free < layers.saturating_add(self.places() / SPARE_PART)
    }

    /// Erases one sector for a job of this number of layers, if it needs that. True while more is to be erased. It
    /// takes up to two seconds in which nothing else happens, so heater and steppers must be off and the nozzle cold.
    ///
    /// # Errors
    /// [`JournalError::JobNotEnded`] if the sector has such a job, which stays; [`JournalError::Flash`].
    pub fn erase_step(&mut self, layers: u32) -> Result<bool, JournalError> {
        if !self.can_erase(layers) {
            return Ok(false);
        }
        let sector = self.around(self.next + self.free) / Self::PLACES;
        if let Some(present) = &self.present
            && present.at / Self::PLACES == sector
        {
            if !present.state.ended {
                return Err(JournalError::JobNotEnded);
            }
            self.present = None;
        }
        let into = self.next % Self::PLACES;
        if sector == self.next / Self::PLACES && into > 0 {
            // All others are blank: the next record goes to the one that was erased first.
            self.free -= (Self::PLACES - into).min(self.free);
            self.next = self.around((sector + 1) * Self::PLACES);
        }
        if self.doubtful.is_some_and(|place| place / Self::PLACES == sector) {
            self.doubtful = None;
        }
        let from = sector * F::ERASE_SIZE as u32;
        let flash = |_| JournalError::Flash;
        self.flash.write(from, &STRUCK).map_err(flash)?;
        self.flash.erase(from, from + F::ERASE_SIZE as u32).map_err(flash)?;
        self.erasures = self.erasures.saturating_add(1);
        let record =
            Record { kind: Kind::Sector, count: 0, index: 0, job: self.jobs, content: [self.erasures, 0, 0, 0, 0] };
        if !self.write(from, &record.to_bytes()) {
            return Err(JournalError::Flash);
        }
        self.free += Self::PLACES;
        Ok(self.can_erase(layers))
    }

    /// Forgets the present job, so that its sectors can be erased. The job comes back with a reset unless a sector of
    /// it has been erased or another job begun.
    pub fn forget(&mut self) {
        self.present = None;
    }

    /// Records the beginning of a job. The job before it is over, even if this fails.
    ///
    /// # Errors
    /// [`JournalError::Full`] if something must be erased first, or the job has more layers than [`Journal::capacity`];
    /// [`JournalError::Flash`]. After an error there is no job that has not ended.
    pub fn begin(&mut self, plan_id: u64, robot: u64, layers: u32) -> Result<(), JournalError> {
        let ([a, b], [c, d]) = (split(plan_id), split(robot));
        let job = self.jobs.saturating_add(1);
        let record = Record { kind: Kind::Job, count: 0, index: 0, job, content: [a, b, c, d, layers] };
        let place = if self.needs_erasing(layers) { Err(JournalError::Full) } else { self.append(&record) };
        match place {
            // The job before goes with it: its number is lower.
            Ok(place) => self.apply(&record, place),
            Err(_) if self.present.as_ref().is_some_and(|present| !present.state.ended) => self.strike(),
            Err(_) => {}
        }
        place.map(|_| ())
    }

    /// Records the beginning of a layer: the first one, or the first one after a pause.
    ///
    /// # Errors
    /// As of [`Journal::committed`].
    pub fn begun(&mut self, index: u32) -> Result<(), JournalError> {
        self.put(Kind::Begun, index, [0; 5])
    }

    /// Records a layer that is laid. The next one may have been begun at once.
    ///
    /// # Errors
    /// [`JournalError::NoJob`]; [`JournalError::OutOfOrder`] if it is not the next layer of the job;
    /// [`JournalError::Full`] and [`JournalError::Flash`]. After an error there is no job to resume any more.
    pub fn committed(&mut self, index: u32, laid: &Laid, next_begun: bool) -> Result<(), JournalError> {
        let kind = if next_begun { Kind::LaidNextBegun } else { Kind::Laid };
        self.put(kind, index, laid.to_content())
    }

    /// Records an interrupted layer that counts as laid, as far as it was made.
    ///
    /// # Errors
    /// As of [`Journal::committed`].
    pub fn skipped(&mut self, index: u32, laid: &Laid) -> Result<(), JournalError> {
        self.put(Kind::Interrupted, index, laid.to_content())
    }

    /// Records another plan from a layer on.
    ///
    /// # Errors
    /// As of [`Journal::committed`]; [`JournalError::OutOfOrder`] also where that layer is laid already or beyond the
    /// job.
    pub fn amended(&mut self, from: u32, plan_id: u64, layers: u32) -> Result<(), JournalError> {
        let [a, b] = split(plan_id);
        self.put(Kind::Amended, from, [a, b, layers, 0, 0])
    }

    /// Records that the job is done or given up.
    ///
    /// # Errors
    /// As of [`Journal::committed`].
    pub fn ended(&mut self) -> Result<(), JournalError> {
        self.put(Kind::Ended, 0, [0; 5])
    }

    /// A layer of the present job. It is found quickly, and most quickly in order.
    pub fn laid(&mut self, index: u32) -> Option<LaidRecord> {
        let present = self.present.as_ref().filter(|present| index < present.state.laid)?;
        let (at, Found { layer: near, offset }) = (present.at, present.found);
        // There is at least a place for each layer in between.
        let first = index.checked_sub(near).map_or(index + 1, |layers| offset + layers);
        for offset in first..=self.places() {
            let place = self.around(at + offset);
            if place == self.next {
                break;
            }
            let Some(record) = self.record(place) else { continue };
            let interrupted = match record.kind {
                Kind::Laid | Kind::LaidNextBegun => false,
                Kind::Interrupted => true,
                _ => continue,
            };
            if record.job == self.jobs && record.index == index {
                if let Some(present) = &mut self.present {
                    present.found = Found { layer: index, offset };
                }
                return Some(LaidRecord { as_built: Laid::from_content(record.content).as_built, interrupted });
            }
        }
        None
    }

    /// The carry of the layers laid to those after them.
    pub fn carry(&self) -> Carry {
        self.present.as_ref().map_or_else(Carry::default, |present| present.carry)
    }

    fn sectors(&self) -> u32 {
        (self.flash.capacity() / F::ERASE_SIZE) as u32
    }

    /// Number of places in the area.
    fn places(&self) -> u32 {
        self.sectors() * Self::PLACES
    }

    /// A place, wrapped once round the ring.
    fn around(&self, place: u32) -> u32 {
        place.checked_sub(self.places()).unwrap_or(place)
    }

    fn can_erase(&self, layers: u32) -> bool {
        self.needs_erasing(layers) && self.free < self.places()
    }

    /// Byte offset of a place.
    fn offset(place: u32) -> u32 {
        (place + place / Self::PLACES + 1) * RECORD_BYTES as u32
    }

    fn read(&mut self, offset: u32) -> RecordBytes {
        let mut bytes = STRUCK;
        // A place that cannot be read is neither blank nor a record.
        if self.flash.read(offset, &mut bytes).is_ok() { bytes } else { STRUCK }
    }

    fn record(&mut self, place: u32) -> Option<Record> {
        Record::from_bytes(&self.read(Self::offset(place)))
    }

    /// The first record of a sector; none where the sector has no journal.
    fn sector_record(&mut self, sector: u32) -> Option<Record> {
        let bytes = self.read(sector * F::ERASE_SIZE as u32);
        Record::from_bytes(&bytes).filter(|record| record.kind == Kind::Sector)
    }

    /// Reads a sector's records except for the last one, which becomes the tail, and finds where the ring is free.
    fn read_sector(&mut self, sector: u32, tail: &mut Option<Tail>) {
        let first = sector * Self::PLACES;
        let Some(own) = self.sector_record(sector) else {
            (self.next, self.free) = (self.around(first + Self::PLACES), 0);
            return;
        };
        self.apply(&own, first);
        let mut blank = true;
        for place in first..first + Self::PLACES {
            let bytes = self.read(Self::offset(place));
            if bytes == BLANK {
                self.free += 1;
                continue;
            }
            (self.next, self.free) = (self.around(place + 1), 0);
            blank = false;
            if let Some(Tail { place, bytes }) = tail.replace(Tail { place, bytes })
                && let Some(record) = Record::from_bytes(&bytes)
            {
                self.apply(&record, place);
            }
        }
        if blank {
            // Power may have been lost while this record was written.
            let _ = self.write(sector * F::ERASE_SIZE as u32, &own.to_bytes());
        }
    }

    /// Settles what the last record is, and where the next one goes.
    fn settle(&mut self, tail: Option<Tail>) {
        if self.free > 0 {
            self.doubtful = Some(self.next);
            (self.next, self.free) = (self.around(self.next + 1), self.free - 1);
        }
        let Some(Tail { place, mut bytes }) = tail else { return };
        let mut looks = 1;
        let record = loop {
            match Record::from_bytes(&bytes) {
                None if looks < ATTEMPTS => (looks, bytes) = (looks + 1, self.read(Self::offset(place))),
                found => break found,
            }
        };
        match record {
            Some(record) => {
                self.apply(&record, place);
                if !self.write(Self::offset(place), &bytes)
                    && record.job == self.jobs
                    && let Ok(copy) = self.append(&record)
                {
                    // These cells are weak: others have the record now.
                    self.strike_out(place);
                    if let Some(present) = self.present.as_mut().filter(|present| present.at == place) {
                        present.at = copy;
                    }
                }
            }
            None => self.strike_out(place),
        }
    }

    /// Strikes a place out, so that it never reads as a record again.
    #[inline(never)]
    fn strike_out(&mut self, place: u32) {
        // If flash refuses even this, nothing is left to be tried.
        let _ = self.flash.write(Self::offset(place), &STRUCK);
    }

    /// Writes a record, and reads it back. False if it is not there.
    #[inline(never)]
    fn write(&mut self, offset: u32, bytes: &RecordBytes) -> bool {
        self.flash.write(offset, bytes).is_ok() && self.read(offset) == *bytes
    }

    /// Writes a record of the present job.
    fn put(&mut self, kind: Kind, index: u32, content: [u32; 5]) -> Result<(), JournalError> {
        let Some(present) = self.present.as_mut().filter(|present| !present.state.ended) else {
            return Err(JournalError::NoJob);
        };
        let record = Record { kind, count: present.count, index, job: self.jobs, content };
        let written = if present.apply(&record) { self.append(&record) } else { Err(JournalError::OutOfOrder) };
        if written.is_err() {
            self.strike();
        }
        written.map(|_| ())
    }

    /// Writes a record to the next place, or to one of those after it, and returns the place.
    fn append(&mut self, record: &Record) -> Result<u32, JournalError> {
        let bytes = record.to_bytes();
        for _ in 0..ATTEMPTS {
            let place = self.next;
            self.free = self.free.checked_sub(1).ok_or(JournalError::Full)?;
            self.next = self.around(place + 1);
            if let Some(place) = self.doubtful.take() {
                self.strike_out(place);
            }
            if self.write(Self::offset(place), &bytes) {
                return Ok(place);
            }
            // It may read as whole later, beside the copy that counts.
            self.strike_out(place);
        }
        Err(JournalError::Flash)
    }

    /// Strikes out the present job's own record.
    fn strike(&mut self) {
        if let Some(present) = self.present.take() {
            self.strike_out(present.at);
        }
    }

    /// Applies a record. They come in the order in which they were written.
    fn apply(&mut self, record: &Record, at: u32) {
        if record.job > self.jobs {
            (self.jobs, self.present) = (record.job, None);
        }
        if record.job < self.jobs {
            return;
        }
        if self.present.as_ref().is_some_and(|present| present.latest == *record) {
            return;
        }
        if let (Kind::Job, [a, b, c, d, layers]) = (record.kind, record.content) {
            self.present = Some(Present::new(record, at, [a, b, c, d, layers]));
        } else if record.kind != Kind::Sector && self.present.as_mut().is_some_and(|present| !present.apply(record)) {
            self.present = None;
        }
    }
}
