//! The progress journal: a record in flash of the progress of a growth, so that the growth can be resumed at its layer
//! after a reset or a loss of power.
//!
//! Records of 32 bytes (`record`) are appended in a ring of two or more erase sectors:
//!
//! ```text
//! sector 0: | sector | job 7 | begun 0 | laid 0 | laid 1 | ... | laid 4091 |
//! sector 1: | sector | laid 4092 | ... | ended | job 8 | begun 0 | laid 0 | (blank) ...
//! ```
//!
//! - A record is valid as a whole or not at all, by its CRC. A record that was torn by a loss of power is skipped, and
//!   the next one is written to the next slot.
//! - Cells that lost their power while they were programmed may read differently at each start. The journal therefore
//!   fixes their content at each start: the last record is programmed again if it is valid, and struck out if not. The
//!   first blank slot may have been written to and read as blank. It is skipped, and struck out before anything is
//!   written after it.
//! - A record that is stored twice in a row counts once, because a slot that seemed to refuse a record may later read
//!   as if it had accepted it.
//! - Every record has the number of its job. The numbers of jobs never start again. The present job is the one with the
//!   max number of any record. If one of its records is missing, except for the last ones, the journal has no job.
//! - A sector is erased only between jobs, when the next job would not fit into the blank slots. The sector written
//!   longest ago is erased first. Its first record is struck out before the erasure and written again after it. Without
//!   that record the sector has no journal, even after an interrupted erasure.
//! - If a record cannot be written, the first record of the present job is struck out. A growth that cannot be resumed
//!   is better than one that is resumed at the wrong layer.

mod current_job;
mod record;
#[cfg(test)]
mod tests;

use embedded_storage::nor_flash::MultiwriteNorFlash;
use growbot_core::layer_bytes::LayerBytes;

pub use current_job::{Carry, JobState};
use current_job::{CurrentJob, Found};
pub use record::Laid;
use record::{BLANK, Kind, RECORD_BYTES, Record, RecordBytes, STRUCK, split};

/// Number of slots in which a record is tried before the flash counts as broken.
const ATTEMPTS: u32 = 3;
/// One part in this number of the area is reserved for records that are not layers: those of pauses and of amended
/// plans.
const SPARE_PART: u32 = 4;

/// The reason why a record is not in the journal, or why a sector was not erased.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JournalError {
    /// The journal is full. The caller must erase a sector, or grow without a journal.
    Full,
    /// The journal has no current job.
    NoJob,
    /// The record does not follow from the records before it.
    OutOfOrder,
    /// The sector contains a job that has not ended. The caller must end or forget it first.
    JobNotEnded,
    /// The flash refuses the operation, or reads back differently from what was written.
    Flash,
}

/// A layer of the present job that is laid.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LaidRecord {
    /// The layer as built.
    pub as_built: LayerBytes,
    /// The layer was interrupted and counts as laid.
    pub interrupted: bool,
}

/// The journal in one area of flash. It uses the whole area.
///
/// The slots of records are numbered through all sectors, without the first record of each sector.
pub struct Journal<F> {
    flash: F,
    /// Slot of the next record.
    next: u32,
    /// Number of blank slots from there on, around the ring.
    free: u32,
    /// Largest number of erasures in any sector's record.
    erasures: u32,
    /// Largest number of any job.
    jobs: u32,
    /// Slot that reads as blank, and may have been written to when power was lost.
    doubtful: Option<u32>,
    present: Option<CurrentJob>,
}

/// The last slot that is not blank, as far as the journal has been read.
#[derive(Clone, Copy)]
struct LastRecord {
    place: u32,
    bytes: RecordBytes,
}

impl<F: MultiwriteNorFlash> Journal<F> {
    /// Slots in a sector.
    const PLACES: u32 = {
        assert!(F::ERASE_SIZE >= 2 * RECORD_BYTES && F::ERASE_SIZE.is_multiple_of(RECORD_BYTES));
        assert!(RECORD_BYTES.is_multiple_of(F::WRITE_SIZE) && RECORD_BYTES.is_multiple_of(F::READ_SIZE));
        (F::ERASE_SIZE / RECORD_BYTES - 1) as u32
    };

    /// Reads the area, and fixes the content that a loss of power has left uncertain. Flash without a journal counts as
    /// flash to be erased, and nothing is written there.
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

    /// Returns the latest job. `None` if not all of it can be read.
    pub fn job(&self) -> Option<&JobState> {
        self.present.as_ref().map(|present| &present.state)
    }

    /// Returns the max number of layers of a job. A quarter of the slots is left for other records.
    pub fn capacity(&self) -> u32 {
        self.places() - self.places() / SPARE_PART
    }

    /// Returns whether a sector must be erased before a job of this number of layers can begin.
    pub fn needs_erasing(&self, layers: u32) -> bool {
        self.free < layers.saturating_add(self.places() / SPARE_PART)
    }

    /// Erases one sector for a job of this number of layers, if it needs that. Returns `true` while more sectors must
    /// be erased. The erasure takes up to two seconds in which the controller does nothing else, so heater and steppers
    /// must be off and the nozzle cold.
    ///
    /// # Errors
    /// Returns [`JournalError::JobNotEnded`] if the sector has such a job, which is kept, or [`JournalError::Flash`].
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
            // All other slots are blank. The next record goes to the sector that was erased first.
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

    /// Forgets the present job, so that its sectors can be erased. A reset restores the job unless a sector of it has
    /// been erased or another job has begun.
    pub fn forget(&mut self) {
        self.present = None;
    }

    /// Records the beginning of a job. The previous job is over, even if this fails.
    ///
    /// # Errors
    /// Returns [`JournalError::Full`] if a sector must be erased first, or if the job has more layers than
    /// [`Journal::capacity`]. Otherwise returns [`JournalError::Flash`]. After an error the journal has no unfinished
    /// job.
    pub fn begin(&mut self, plan_id: u64, robot: u64, layers: u32) -> Result<(), JournalError> {
        let ([a, b], [c, d]) = (split(plan_id), split(robot));
        let job = self.jobs.saturating_add(1);
        let record = Record { kind: Kind::Job, count: 0, index: 0, job, content: [a, b, c, d, layers] };
        let place = if self.needs_erasing(layers) { Err(JournalError::Full) } else { self.append(&record) };
        match place {
            // The previous job is replaced by this record, because its number is lower.
            Ok(place) => self.apply(&record, place),
            Err(_) if self.present.as_ref().is_some_and(|present| !present.state.ended) => self.strike(),
            Err(_) => {}
        }
        place.map(|_| ())
    }

    /// Records the beginning of a layer: the first one, or the first one after a pause.
    ///
    /// # Errors
    /// Returns the same errors as [`Journal::committed`].
    pub fn begun(&mut self, index: u32) -> Result<(), JournalError> {
        self.put(Kind::Begun, index, [0; 5])
    }

    /// Records that a layer is laid, and whether the next one has begun at once.
    ///
    /// # Errors
    /// Returns [`JournalError::NoJob`], [`JournalError::OutOfOrder`] if it is not the next layer of the job,
    /// [`JournalError::Full`] or [`JournalError::Flash`]. After an error the job can no longer be resumed.
    pub fn committed(&mut self, index: u32, laid: &Laid, next_begun: bool) -> Result<(), JournalError> {
        let kind = if next_begun { Kind::LaidNextBegun } else { Kind::Laid };
        self.put(kind, index, laid.to_content())
    }

    /// Records an interrupted layer that counts as laid, as far as it was made.
    ///
    /// # Errors
    /// Returns the same errors as [`Journal::committed`].
    pub fn skipped(&mut self, index: u32, laid: &Laid) -> Result<(), JournalError> {
        self.put(Kind::Interrupted, index, laid.to_content())
    }

    /// Records a new plan from a layer on.
    ///
    /// # Errors
    /// Returns the same errors as [`Journal::committed`], and [`JournalError::OutOfOrder`] also if that layer is laid
    /// already or beyond the job.
    pub fn amended(&mut self, from: u32, plan_id: u64, layers: u32) -> Result<(), JournalError> {
        let [a, b] = split(plan_id);
        self.put(Kind::Amended, from, [a, b, layers, 0, 0])
    }

    /// Records that the job is done or cancelled.
    ///
    /// # Errors
    /// Returns the same errors as [`Journal::committed`].
    pub fn ended(&mut self) -> Result<(), JournalError> {
        self.put(Kind::Ended, 0, [0; 5])
    }

    /// Returns a layer of the present job. The search is fast, and fastest in the order of the layers.
    pub fn layer(&mut self, index: u32) -> Option<LaidRecord> {
        let present = self.present.as_ref().filter(|present| index < present.state.laid)?;
        let (at, Found { layer: near, offset }) = (present.at, present.found);
        // There is at least one slot for each layer in between.
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

    /// Returns the carry from the laid layers to the next ones.
    pub fn carry(&self) -> Carry {
        self.present.as_ref().map_or_else(Carry::default, |present| present.carry)
    }

    fn sectors(&self) -> u32 {
        (self.flash.capacity() / F::ERASE_SIZE) as u32
    }

    /// Returns the number of slots in the area.
    fn places(&self) -> u32 {
        self.sectors() * Self::PLACES
    }

    /// Returns a slot, wrapped once around the ring.
    fn around(&self, place: u32) -> u32 {
        place.checked_sub(self.places()).unwrap_or(place)
    }

    fn can_erase(&self, layers: u32) -> bool {
        self.needs_erasing(layers) && self.free < self.places()
    }

    /// Returns the byte offset of a slot.
    fn offset(place: u32) -> u32 {
        (place + place / Self::PLACES + 1) * RECORD_BYTES as u32
    }

    fn read(&mut self, offset: u32) -> RecordBytes {
        let mut bytes = STRUCK;
        // A slot that cannot be read is neither blank nor a record.
        if self.flash.read(offset, &mut bytes).is_ok() { bytes } else { STRUCK }
    }

    fn record(&mut self, place: u32) -> Option<Record> {
        Record::from_bytes(&self.read(Self::offset(place)))
    }

    /// Returns the first record of a sector. `None` if the sector has no journal.
    fn sector_record(&mut self, sector: u32) -> Option<Record> {
        let bytes = self.read(sector * F::ERASE_SIZE as u32);
        Record::from_bytes(&bytes).filter(|record| record.kind == Kind::Sector)
    }

    /// Reads a sector's records except for the last one, which becomes the tail, and finds the blank part of the ring.
    fn read_sector(&mut self, sector: u32, tail: &mut Option<LastRecord>) {
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
            if let Some(LastRecord { place, bytes }) = tail.replace(LastRecord { place, bytes })
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

    /// Decides whether the last record is valid, and in which slot the next one goes.
    fn settle(&mut self, tail: Option<LastRecord>) {
        if self.free > 0 {
            self.doubtful = Some(self.next);
            (self.next, self.free) = (self.around(self.next + 1), self.free - 1);
        }
        let Some(LastRecord { place, mut bytes }) = tail else { return };
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
                    // The cells of this slot are weak. The record is now in another slot.
                    self.strike_out(place);
                    if let Some(present) = self.present.as_mut().filter(|present| present.at == place) {
                        present.at = copy;
                    }
                }
            }
            None => self.strike_out(place),
        }
    }

    /// Strikes a slot out, so that it never reads as a record again.
    #[inline(never)]
    fn strike_out(&mut self, place: u32) {
        // If the flash refuses even this, there is nothing else to try.
        let _ = self.flash.write(Self::offset(place), &STRUCK);
    }

    /// Writes a record and reads it back. Returns `false` if it reads differently.
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

    /// Writes a record to the next slot, or to one of those after it, and returns the slot.
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
            // The slot may later read as a valid record, beside the copy that counts.
            self.strike_out(place);
        }
        Err(JournalError::Flash)
    }

    /// Strikes out the first record of the present job.
    fn strike(&mut self) {
        if let Some(present) = self.present.take() {
            self.strike_out(present.at);
        }
    }

    /// Applies a record. The caller passes the records in the order in which they were written.
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
            self.present = Some(CurrentJob::new(record, at, [a, b, c, d, layers]));
        } else if record.kind != Kind::Sector && self.present.as_mut().is_some_and(|present| !present.apply(record)) {
            self.present = None;
        }
    }
}
