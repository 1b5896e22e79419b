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
//! - Cells that lost their power while they were programmed may read differently at each start, and at each reading. A
//!   slot is therefore read up to three times before it counts as invalid. The journal fixes the uncertain content at
//!   each start: the last record is programmed again if it is valid, and struck out (overwritten with zeros) if not.
//!   The first blank slot may have been written to and read as blank. It is skipped, and struck out before anything is
//!   written after it.
//! - The flash may refuse such a repair, because the supply is low. The repair is then tried again before anything is
//!   appended, because a record that reads differently later must be the last one.
//! - A record that is stored twice in a row counts once, because a slot that seemed to refuse a record may later read
//!   as if it had accepted it.
//! - Every record has the number of its job. The numbers of jobs never start again. The current job is the one with the
//!   greatest number of any record. If one of its records is missing, except for the last ones, the journal has no job.
//! - A sector is erased only between jobs, when the next job would not fit into the blank slots. The sector written
//!   longest ago is erased first. Its first record is struck out before the erasure and written again after it. A
//!   sector without that record does not belong to the journal, even after an interrupted erasure.
//! - If a record cannot be written, the first record of the current job is struck out. A growth that cannot be resumed
//!   is better than one that is resumed at the wrong layer. If the flash refuses that write too, each later record
//!   tries it again.

mod current_job;
mod record;
#[cfg(test)]
mod tests;

use embedded_storage::nor_flash::MultiwriteNorFlash;
use growbot_core::layer_bytes::LayerBytes;
use heapless::Vec;

use current_job::{CurrentJob, LookupHint};
pub use current_job::{JournalJob, RoundingCarry};
pub use record::LayerRecord;
use record::{BLANK, RECORD_BYTES, Record, RecordBytes, RecordKind, STRUCK, split};

/// Max number of slots in which the journal tries to write a record before the flash counts as broken.
const MAX_WRITE_ATTEMPTS: u32 = 3;
/// Max number of times that a slot is read. If no reading is a valid record, the slot counts as invalid.
const MAX_READS: u32 = 3;
/// Max number of sectors that the journal uses.
const MAX_SECTORS: usize = 4;
/// Max number of repairs that are pending because the flash has refused them: one for each sector, and one each for the
/// last record, the blank slot after the last record, and the first record of a job.
const MAX_REPAIRS: usize = MAX_SECTORS + 3;
/// Reciprocal of the share of the journal's slots that is reserved for records of pauses and of amended plans: a
/// quarter.
const SPARE_DIVISOR: u32 = 4;

/// The reason why a record is not in the journal, or why a sector was not erased.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JournalError {
    /// The journal is full. The caller must erase a sector, or grow without a journal.
    Full,
    /// The journal has no current job.
    NoJob,
    /// The record does not follow from the previous records of the job.
    OutOfOrder,
    /// The sector contains a job that has not ended. The caller must first end or forget that job.
    JobNotEnded,
    /// The flash refuses the operation, or reads back differently from what was written.
    Flash,
}

/// A laid layer of the current job, as the journal stores it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct StoredLayer {
    /// The layer as built.
    pub as_built: LayerBytes,
    /// True if the layer was interrupted and counts as laid.
    pub interrupted: bool,
}

/// The journal in one area of flash. It uses the whole area, up to `MAX_SECTORS` sectors.
///
/// The slots of records are numbered through all sectors, without the first record of each sector.
pub struct Journal<F> {
    flash: F,
    /// Number of the slot in which the next record will be written.
    next_slot: u32,
    /// Number of blank slots from `next_slot` on, counted around the ring of sectors.
    free_slots: u32,
    /// Largest count of erasures in the first record of any sector.
    erase_count: u32,
    /// Largest job number in the journal.
    last_job: u32,
    /// Repairs that must succeed before a record is appended. The journal makes the last one in the list first.
    repairs: Vec<Repair, MAX_REPAIRS>,
    /// The last record in the journal, if the flash refused to program it again. `None` otherwise.
    weak_tail: Option<LastRecord>,
    present: Option<CurrentJob>,
}

/// A write that makes the uncertain content of a slot, or of a sector's first record, definite.
#[derive(Clone, Copy)]
struct Repair {
    offset: u32,
    bytes: RecordBytes,
}

/// The last slot that is not blank among the slots that have been read.
#[derive(Clone, Copy)]
struct LastRecord {
    place: u32,
    bytes: RecordBytes,
    /// The decoded record. `None` if the bytes are not a valid record.
    record: Option<Record>,
}

impl<F: MultiwriteNorFlash> Journal<F> {
    /// Number of record slots in a sector. The sector's own first record is not counted.
    const SLOTS_PER_SECTOR: u32 = {
        assert!(F::ERASE_SIZE >= 2 * RECORD_BYTES && F::ERASE_SIZE.is_multiple_of(RECORD_BYTES));
        assert!(RECORD_BYTES.is_multiple_of(F::WRITE_SIZE) && RECORD_BYTES.is_multiple_of(F::READ_SIZE));
        (F::ERASE_SIZE / RECORD_BYTES - 1) as u32
    };

    /// Reads the journal, and fixes the content that a loss of power has left uncertain. Flash without a journal counts
    /// as flash that must be erased, and nothing is written to it.
    pub fn open(flash: F) -> Self {
        let mut journal = Self {
            flash,
            next_slot: 0,
            free_slots: 0,
            erase_count: 0,
            last_job: 0,
            repairs: Vec::new(),
            weak_tail: None,
            present: None,
        };
        // Each sector's record is read once, because a second reading may differ.
        let mut sectors: Vec<Option<Record>, MAX_SECTORS> = Vec::new();
        let mut newest = journal.sectors().saturating_sub(1) as usize;
        for sector in 0..journal.sectors() {
            let record = journal.sector_record(sector);
            if let Some(Record { content: [erasures, ..], .. }) = record
                && erasures >= journal.erase_count
            {
                (newest, journal.erase_count) = (sector as usize, erasures);
            }
            // The vector is not full, because there are at most `MAX_SECTORS`.
            let _ = sectors.push(record);
        }
        // The sector after the one erased last was written longest ago.
        let mut tail = None;
        for (sector, record) in (0..).zip(&sectors).cycle().skip(newest + 1).take(sectors.len()) {
            journal.read_sector(sector, *record, &mut tail);
        }
        journal.repair_tail(tail);
        journal
    }

    /// Returns the latest job. `None` if the journal has no job, or if some of its records cannot be read.
    pub fn job(&self) -> Option<&JournalJob> {
        self.present.as_ref().map(|present| &present.state)
    }

    /// Returns the max number of layers of a job. A quarter of the slots is reserved for other records.
    pub fn capacity(&self) -> u32 {
        self.places() - self.places() / SPARE_DIVISOR
    }

    /// Returns whether a sector must be erased before a job of this number of layers can begin.
    pub fn needs_erasing(&self, layers: u32) -> bool {
        self.free_slots < layers.saturating_add(self.places() / SPARE_DIVISOR)
    }

    /// Erases one sector, if a job of this number of layers needs an erasure. Returns `true` while more sectors must be
    /// erased. The erasure takes up to two seconds in which the controller does nothing else, so heater and steppers
    /// must be off and the nozzle cold.
    ///
    /// # Errors
    /// Returns [`JournalError::JobNotEnded`] if the sector contains a job that has not ended, and does not erase it.
    /// Returns [`JournalError::Flash`] if the flash refuses the erasure.
    pub fn erase_step(&mut self, layers: u32) -> Result<bool, JournalError> {
        if !self.can_erase(layers) {
            return Ok(false);
        }
        let sector = self.wrap(self.next_slot + self.free_slots) / Self::SLOTS_PER_SECTOR;
        if let Some(present) = &self.present
            && present.at / Self::SLOTS_PER_SECTOR == sector
        {
            if !present.state.ended {
                return Err(JournalError::JobNotEnded);
            }
            self.present = None;
        }
        let into = self.next_slot % Self::SLOTS_PER_SECTOR;
        if sector == self.next_slot / Self::SLOTS_PER_SECTOR && into > 0 {
            // All other slots are blank. The next record goes to the sector that was erased first.
            self.free_slots -= (Self::SLOTS_PER_SECTOR - into).min(self.free_slots);
            self.next_slot = self.wrap((sector + 1) * Self::SLOTS_PER_SECTOR);
        }
        let from = sector * F::ERASE_SIZE as u32;
        let flash = |_| JournalError::Flash;
        self.flash.write(from, &STRUCK).map_err(flash)?;
        let end = from + F::ERASE_SIZE as u32;
        self.flash.erase(from, end).map_err(flash)?;
        self.repairs.retain(|repair| !(from..end).contains(&repair.offset));
        self.weak_tail = self.weak_tail.filter(|tail| !(from..end).contains(&Self::offset(tail.place)));
        self.erase_count = self.erase_count.saturating_add(1);
        let record = Record {
            kind: RecordKind::Sector,
            count: 0,
            index: 0,
            job: self.last_job,
            content: [self.erase_count, 0, 0, 0, 0],
        };
        if !self.write(from, &record.to_bytes()) {
            return Err(JournalError::Flash);
        }
        self.free_slots += Self::SLOTS_PER_SECTOR;
        Ok(self.can_erase(layers))
    }

    /// Forgets the current job, so that its sectors can be erased. After a reset the journal finds the job again,
    /// unless one of its sectors has been erased or another job has begun.
    pub fn forget(&mut self) {
        self.present = None;
    }

    /// Records the beginning of a job. The previous job is over, even if the record cannot be written.
    ///
    /// # Errors
    /// Returns [`JournalError::Full`] if a sector must be erased first, or if the job has more layers than
    /// [`Journal::capacity`]. Otherwise returns [`JournalError::Flash`]. After an error the journal has no unfinished
    /// job.
    pub fn begin_job(&mut self, plan_id: u64, robot: u64, layers: u32) -> Result<(), JournalError> {
        let ([a, b], [c, d]) = (split(plan_id), split(robot));
        let job = self.last_job.saturating_add(1);
        let record = Record { kind: RecordKind::Job, count: 0, index: 0, job, content: [a, b, c, d, layers] };
        let place = if self.needs_erasing(layers) { Err(JournalError::Full) } else { self.append(&record) };
        match place {
            // The previous job is replaced by this record, because its number is lower.
            Ok(place) => self.apply(&record, place),
            Err(_) if self.present.as_ref().is_some_and(|present| !present.state.ended) => self.invalidate_job(),
            Err(_) => {}
        }
        place.map(|_| ())
    }

    /// Records the beginning of a layer: the first layer of a job, or the first layer after a pause.
    ///
    /// # Errors
    /// Returns the same errors as [`Journal::record_laid`].
    pub fn record_begun(&mut self, index: u32) -> Result<(), JournalError> {
        self.append_to_job(RecordKind::Begun, index, [0; 5])
    }

    /// Records that a layer is laid. `next_begun` is true if the next layer has begun at once.
    ///
    /// # Errors
    /// Returns [`JournalError::NoJob`], [`JournalError::OutOfOrder`] if the layer is not the next layer of the job,
    /// [`JournalError::Full`] or [`JournalError::Flash`]. After an error the job can no longer be resumed.
    pub fn record_laid(&mut self, index: u32, laid: &LayerRecord, next_begun: bool) -> Result<(), JournalError> {
        let kind = if next_begun { RecordKind::LaidNextBegun } else { RecordKind::Laid };
        self.append_to_job(kind, index, laid.to_content())
    }

    /// Records that an interrupted layer counts as laid. `laid` is the layer as far as it was made, or a default value
    /// if that is not known.
    ///
    /// # Errors
    /// Returns the same errors as [`Journal::record_laid`].
    pub fn record_skipped(&mut self, index: u32, laid: &LayerRecord) -> Result<(), JournalError> {
        self.append_to_job(RecordKind::Interrupted, index, laid.to_content())
    }

    /// Records that a new plan replaces the rest of the job, from the layer with the index `from` on.
    ///
    /// # Errors
    /// Returns the same errors as [`Journal::record_laid`], and also [`JournalError::OutOfOrder`] if the first layer of
    /// the new plan is laid already or beyond the job.
    pub fn record_amended(&mut self, from: u32, plan_id: u64, layers: u32) -> Result<(), JournalError> {
        let [a, b] = split(plan_id);
        self.append_to_job(RecordKind::Amended, from, [a, b, layers, 0, 0])
    }

    /// Records that the job is done or cancelled.
    ///
    /// # Errors
    /// Returns the same errors as [`Journal::record_laid`].
    pub fn record_ended(&mut self) -> Result<(), JournalError> {
        self.append_to_job(RecordKind::Ended, 0, [0; 5])
    }

    /// Returns a laid layer of the current job. `None` if the layer is not laid or its record cannot be read. The
    /// search is fastest if the layers are read in their order.
    pub fn layer(&mut self, index: u32) -> Option<StoredLayer> {
        let present = self.present.as_ref().filter(|present| index < present.state.layers_laid)?;
        let (at, LookupHint { layer: near, offset }) = (present.at, present.found);
        // There is at least one slot for each layer in between.
        let first = index.checked_sub(near).map_or(index + 1, |layers| offset + layers);
        for offset in first..=self.places() {
            let place = self.wrap(at + offset);
            if place == self.next_slot {
                break;
            }
            let Some(record) = self.record(place) else { continue };
            let interrupted = match record.kind {
                RecordKind::Laid | RecordKind::LaidNextBegun => false,
                RecordKind::Interrupted => true,
                _ => continue,
            };
            if record.job == self.last_job && record.index == index {
                if let Some(present) = &mut self.present {
                    present.found = LookupHint { layer: index, offset };
                }
                return Some(StoredLayer { as_built: LayerRecord::from_content(record.content).as_built, interrupted });
            }
        }
        None
    }

    /// Returns the rounding errors that the laid layers carry over to the next layers.
    pub fn carry(&self) -> RoundingCarry {
        self.present.as_ref().map_or_else(RoundingCarry::default, |present| present.carry)
    }

    fn sectors(&self) -> u32 {
        (self.flash.capacity() / F::ERASE_SIZE).min(MAX_SECTORS) as u32
    }

    /// Returns the number of record slots in the journal.
    fn places(&self) -> u32 {
        self.sectors() * Self::SLOTS_PER_SECTOR
    }

    /// Returns the number of a slot, wrapped around the ring of sectors. `place` must be less than two rounds.
    fn wrap(&self, place: u32) -> u32 {
        place.checked_sub(self.places()).unwrap_or(place)
    }

    fn can_erase(&self, layers: u32) -> bool {
        self.needs_erasing(layers) && self.free_slots < self.places()
    }

    /// Returns the byte offset in flash of a slot.
    fn offset(place: u32) -> u32 {
        (place + place / Self::SLOTS_PER_SECTOR + 1) * RECORD_BYTES as u32
    }

    fn read(&mut self, offset: u32) -> RecordBytes {
        let mut bytes = STRUCK;
        // A slot that cannot be read is neither blank nor a record.
        if self.flash.read(offset, &mut bytes).is_ok() { bytes } else { STRUCK }
    }

    /// Reads a slot, or a sector's first record, up to [`MAX_READS`] times until it is a valid record. Returns the
    /// bytes and the decoded record. A slot that reads as blank the first time counts as blank.
    fn look(&mut self, offset: u32) -> (RecordBytes, Option<Record>) {
        let mut bytes = self.read(offset);
        if bytes == BLANK {
            return (bytes, None);
        }
        let mut reads = 1;
        loop {
            match Record::from_bytes(&bytes) {
                None if reads < MAX_READS => (reads, bytes) = (reads + 1, self.read(offset)),
                None => return (STRUCK, None),
                record => return (bytes, record),
            }
        }
    }

    fn record(&mut self, place: u32) -> Option<Record> {
        self.look(Self::offset(place)).1
    }

    /// Returns the first record of a sector. `None` if the sector does not belong to the journal.
    fn sector_record(&mut self, sector: u32) -> Option<Record> {
        self.look(sector * F::ERASE_SIZE as u32).1.filter(|record| record.kind == RecordKind::Sector)
    }

    /// Reads a sector's records and finds the blank slots of the ring. Applies every record except for the last one,
    /// which is stored in `tail`.
    fn read_sector(&mut self, sector: u32, own: Option<Record>, tail: &mut Option<LastRecord>) {
        let first = sector * Self::SLOTS_PER_SECTOR;
        let Some(own) = own else {
            (self.next_slot, self.free_slots) = (self.wrap(first + Self::SLOTS_PER_SECTOR), 0);
            return;
        };
        self.apply(&own, first);
        let mut blank = true;
        for place in first..first + Self::SLOTS_PER_SECTOR {
            let (bytes, record) = self.look(Self::offset(place));
            if bytes == BLANK {
                self.free_slots += 1;
                continue;
            }
            (self.next_slot, self.free_slots) = (self.wrap(place + 1), 0);
            blank = false;
            if let Some(LastRecord { place, record: Some(record), .. }) =
                tail.replace(LastRecord { place, bytes, record })
            {
                self.apply(&record, place);
            }
        }
        if blank {
            // Power may have been lost while the first record of this sector was written.
            self.repair(Repair { offset: sector * F::ERASE_SIZE as u32, bytes: own.to_bytes() });
        }
    }

    /// Programs the last record again, or strikes its slot out if it is not valid, and selects the slot for the next
    /// record.
    fn repair_tail(&mut self, tail: Option<LastRecord>) {
        if self.free_slots > 0 {
            // This blank slot is struck out before the next record is appended. A start without a new record therefore
            // uses no slot.
            self.postpone(Repair { offset: Self::offset(self.next_slot), bytes: STRUCK });
            (self.next_slot, self.free_slots) = (self.wrap(self.next_slot + 1), self.free_slots - 1);
        }
        let Some(tail) = tail else { return };
        let Some(record) = tail.record else { return self.invalidate_slot(tail.place) };
        self.apply(&record, tail.place);
        if !self.write(Self::offset(tail.place), &tail.bytes) && record.job == self.last_job {
            self.weak_tail = Some(tail);
            // If the flash refuses the repair, the journal tries it again before the next record.
            let _ = self.finish_repairs();
        }
    }

    /// Makes a repair, or postpones it if the flash refuses it.
    fn repair(&mut self, repair: Repair) {
        if !self.is_repaired(&repair) {
            self.postpone(repair);
        }
    }

    fn postpone(&mut self, repair: Repair) {
        // The vector is not full: see `MAX_REPAIRS`.
        let _ = self.repairs.push(repair);
    }

    /// Makes a repair and returns whether it has succeeded. The write of zeros to a slot needs no check: its CRC is
    /// wrong as soon as some bits are cleared, so a cell that stays set does no harm.
    fn is_repaired(&mut self, Repair { offset, bytes }: &Repair) -> bool {
        self.flash.write(*offset, bytes).is_ok() && (*bytes == STRUCK || self.read(*offset) == *bytes)
    }

    /// Makes the repairs that the flash has refused before. The repair of the last record comes first, because no
    /// record may follow that record while it may read differently.
    fn settle(&mut self) -> Result<(), JournalError> {
        if let Some(LastRecord { place, bytes, .. }) = self.weak_tail
            && self.write(Self::offset(place), &bytes)
        {
            self.weak_tail = None;
        }
        self.finish_repairs()
    }

    fn finish_repairs(&mut self) -> Result<(), JournalError> {
        while let Some(repair) = self.repairs.last().copied() {
            if !self.is_repaired(&repair) {
                return Err(JournalError::Flash);
            }
            self.repairs.pop();
        }
        if let Some(LastRecord { place, bytes, .. }) = self.weak_tail {
            // The cells of this slot are weak, so the record goes to another one.
            let copy = self.write_next(&bytes)?;
            self.weak_tail = None;
            self.invalidate_slot(place);
            if let Some(present) = self.present.as_mut().filter(|present| present.at == place) {
                present.at = copy;
            }
        }
        Ok(())
    }

    /// Strikes a slot out: overwrites it with zeros, so that it never reads as a record again.
    #[inline(never)]
    fn invalidate_slot(&mut self, place: u32) {
        self.repair(Repair { offset: Self::offset(place), bytes: STRUCK });
    }

    /// Writes a record and reads it back. Returns `false` if the bytes differ.
    #[inline(never)]
    fn write(&mut self, offset: u32, bytes: &RecordBytes) -> bool {
        self.flash.write(offset, bytes).is_ok() && self.read(offset) == *bytes
    }

    /// Appends a record of the current job.
    fn append_to_job(&mut self, kind: RecordKind, index: u32, content: [u32; 5]) -> Result<(), JournalError> {
        let Some(present) = self.present.as_mut().filter(|present| !present.state.ended) else {
            // The record of a job that failed may still wait to be struck out.
            let _ = self.settle();
            return Err(JournalError::NoJob);
        };
        let record = Record { kind, count: present.count, index, job: self.last_job, content };
        let written = if present.apply(&record) { self.append(&record) } else { Err(JournalError::OutOfOrder) };
        if written.is_err() {
            self.invalidate_job();
        }
        written.map(|_| ())
    }

    /// Writes a record to the next slot, or to a later slot if that fails, and returns the number of the slot.
    fn append(&mut self, record: &Record) -> Result<u32, JournalError> {
        self.settle()?;
        self.write_next(&record.to_bytes())
    }

    fn write_next(&mut self, bytes: &RecordBytes) -> Result<u32, JournalError> {
        for _ in 0..MAX_WRITE_ATTEMPTS {
            let place = self.next_slot;
            self.free_slots = self.free_slots.checked_sub(1).ok_or(JournalError::Full)?;
            self.next_slot = self.wrap(place + 1);
            if self.write(Self::offset(place), bytes) {
                return Ok(place);
            }
            // The slot may later read as a valid record, beside the copy that counts.
            self.invalidate_slot(place);
            if !self.repairs.is_empty() {
                break;
            }
        }
        Err(JournalError::Flash)
    }

    /// Strikes out the first record of the current job, so that the job cannot be resumed.
    fn invalidate_job(&mut self) {
        if let Some(present) = self.present.take() {
            self.invalidate_slot(present.at);
        }
    }

    /// Applies a record to the journal's state. The caller passes the records in the order in which they were written.
    fn apply(&mut self, record: &Record, at: u32) {
        if record.job > self.last_job {
            (self.last_job, self.present) = (record.job, None);
        }
        if record.job < self.last_job {
            return;
        }
        if self.present.as_ref().is_some_and(|present| present.latest == *record) {
            return;
        }
        if let (RecordKind::Job, [a, b, c, d, layers]) = (record.kind, record.content) {
            self.present = Some(CurrentJob::new(record, at, [a, b, c, d, layers]));
        } else if record.kind != RecordKind::Sector
            && self.present.as_mut().is_some_and(|present| !present.apply(record))
        {
            self.present = None;
        }
    }
}
