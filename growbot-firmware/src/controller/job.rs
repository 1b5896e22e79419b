//! The job: which plan, how far it has come, and the requests that change it.
//!
//! A layer is a transaction named by plan and index: accepted into the store, begun, and committed to the journal once
//! it is laid. Whatever happens in between, no index is laid twice and none is passed over, but where the operator says
//! so of a layer that was cut.

use growbot_core::layer::SECTORS;
use growbot_core::layer_bytes::{LayerBytes, decode_checked};
use growbot_core::link::message::{
    Amend, Begin, Cancel, InterruptedLayer, Laid, Layers, Measured, Message, Refusal, Resume, Silence, Start, State,
};
use heapless::Deque;

use super::{Controller, centi};
use crate::hal::{Board, Watchdog};
use crate::journal::{self, JobState, JournalError};
use crate::link;
use crate::safety::retained::UnderWay;
use crate::safety::transitions::Event;
use crate::stepping::{Handover, Material, Report};

/// Erasing a sector of the journal stops the processor for up to two seconds: only below this, degrees Celsius.
const COLD_C: f64 = 50.0;
/// Layers handed to the engine and not yet laid.
const MAX_GIVEN: usize = 3;
/// What the sensors said is kept for so many of the layers laid last.
const MAX_MEASURED: usize = 16;
/// What is kept through a reset about the layer under way is so old at most, s.
const RETAINED_AGE_S: f64 = 0.25;

/// The job: which plan, and how far it has come.
#[derive(Debug, Clone, Default)]
pub(super) struct Job {
    /// 0 for none.
    pub plan_id: u64,
    /// Layers of the plan.
    pub layers: u32,
    /// Layers laid.
    pub laid: u32,
    /// Layers handed to the engine.
    pub given: u32,
    /// Layers that the host has been told of.
    pub told: u32,
    /// The layer that was cut: how much of it was made.
    pub interrupted: Option<InterruptedLayer>,
    /// What to do when the host falls silent.
    pub silence: Silence,
    /// The journal has failed: the job cannot be taken up again.
    pub unwritten: bool,
    /// What the layers laid leave to those to come.
    pub carry: journal::Carry,
    /// What the layers handed over amount to.
    pub material: Material,
    /// What each of those handed over and not yet laid leaves to the next one.
    pub carries: Deque<journal::Laid, MAX_GIVEN>,
    /// What the sensors said after the layers laid last, by index.
    measured: Deque<(u32, Measured), MAX_MEASURED>,
}

impl Job {
    /// The layers handed over and not laid never will be: what comes next follows on those that were.
    pub fn forget_given(&mut self) {
        self.given = self.laid;
        self.carries.clear();
        self.material = Material::from(self.carry);
    }

    /// Keeps what the sensors said after a layer.
    fn keep_measured(&mut self, index: u32, measured: Measured) {
        if self.measured.is_full() {
            self.measured.pop_front();
        }
        // There is room now.
        let _ = self.measured.push_back((index, measured));
    }

    /// What the sensors said after a layer, if that is still known.
    fn measured(&self, index: u32) -> Option<Measured> {
        self.measured.iter().find(|(of, _)| *of == index).map(|(_, measured)| *measured)
    }
}

impl<B: Board> Controller<B> {
    pub(super) fn begin(&mut self, begin: &Begin) -> Result<Message, Refusal> {
        if begin.robot != self.robot.hash() {
            return Err(Refusal::OtherRobot { board: self.robot.hash() });
        }
        if begin.plan_id == 0 {
            return Err(Refusal::NotUnderstood);
        }
        self.check_event(Event::Begin)?;
        let repeated = (begin.plan_id, begin.layers) == (self.job.plan_id, self.job.layers);
        match self.state {
            // At rest it is the wish for another growth, of the same plan or not.
            State::Done | State::Stopped => {}
            State::Idle if repeated && self.job.laid == 0 && self.job.interrupted.is_none() => {
                return Ok(self.accepted());
            }
            State::Idle => {}
            _ if repeated => return Ok(self.accepted()),
            // Another job is under way.
            state => return Err(Refusal::WrongState { state }),
        }
        self.new_job(begin.plan_id, begin.layers)?;
        self.happens(Event::Begin);
        Ok(self.accepted())
    }

    /// Forgets the job before and holds another, in the journal too.
    pub(super) fn new_job(&mut self, plan_id: u64, layers: u32) -> Result<(), Refusal> {
        let capacity = self.parts.journal.capacity();
        if layers > capacity {
            return Err(Refusal::PlanTooLong { layers, capacity });
        }
        self.make_room(layers)?;
        self.parts.journal.begin(plan_id, self.robot.hash(), layers).map_err(|_| Refusal::Journal)?;
        self.store_mut().restart(0);
        self.job = Job { plan_id, layers, ..Job::default() };
        Ok(())
    }

    /// Erases what the journal needs for a job. Everything is off. The nozzle must be cold too, since nothing is
    /// watched while it erases.
    fn make_room(&mut self, layers: u32) -> Result<(), Refusal> {
        while self.parts.journal.needs_erasing(layers) {
            if self.heater.temperature(self.now).is_none_or(|temperature| temperature >= COLD_C) {
                return Err(Refusal::Hot { below: centi(COLD_C) });
            }
            self.parts.watchdog.feed();
            // A new job is on its way: the one before may go.
            self.parts.journal.forget();
            self.parts.journal.erase_step(layers).map_err(|_| Refusal::Journal)?;
        }
        self.parts.watchdog.feed();
        Ok(())
    }

    pub(super) fn this_plan(&self, plan_id: u64) -> Result<(), Refusal> {
        if plan_id == 0 || plan_id != self.job.plan_id {
            return Err(Refusal::OtherPlan { board: self.job.plan_id });
        }
        Ok(())
    }

    pub(super) fn resume(&mut self, resume: &Resume) -> Result<Message, Refusal> {
        self.check_event(Event::Resume)?;
        self.this_plan(resume.plan_id)?;
        let laid = self.job.laid;
        if matches!(self.state, State::Idle | State::Stopped) {
            if resume.from == laid.saturating_add(1) && self.job.interrupted.is_some() {
                self.let_be()?;
            } else if resume.from != laid {
                return Err(Refusal::OutOfOrder { expected: laid });
            }
            self.job.forget_given();
            // It is laid again, on top of what there is of it.
            self.job.interrupted = None;
        }
        self.job.told = resume.known.min(self.job.laid);
        self.happens(Event::Resume);
        Ok(self.accepted())
    }

    /// What could not be written down cannot be taken up again, and is not done.
    fn in_journal(&mut self, written: Result<(), JournalError>) -> Result<(), Refusal> {
        written.map_err(|_| {
            self.job.unwritten = true;
            Refusal::Journal
        })
    }

    /// The layer that was cut counts as laid, as far as it was.
    fn let_be(&mut self) -> Result<(), Refusal> {
        let index = self.job.laid;
        let unknown =
            journal::Laid { as_built: LayerBytes::default(), height_units: 0, lean_owed: self.job.carry.lean_owed };
        let written = self.parts.journal.skipped(index, &unknown);
        self.in_journal(written)?;
        if self.store().get(index).is_some() {
            self.store_mut().drop_first();
        } else {
            self.store_mut().restart(index + 1);
        }
        self.job.laid += 1;
        self.job.interrupted = None;
        Ok(())
    }

    pub(super) fn hold_layers(&mut self, batch: &Layers) -> Result<Message, Refusal> {
        self.this_plan(batch.plan_id)?;
        self.check_event(Event::Layers)?;
        let expected = self.store().next_index();
        if batch.first > expected {
            return Err(Refusal::OutOfOrder { expected });
        }
        let already_held = (expected - batch.first) as usize;
        let new = batch.layers.get(already_held..).unwrap_or_default();
        self.check_layers(expected, new, self.job.layers)?;
        if new.len() > self.store().room() as usize {
            return Err(Refusal::Full);
        }
        for bytes in new {
            self.hold_layer(*bytes)?;
        }
        Ok(self.accepted())
    }

    /// All are checked before any is taken: a batch is held as a whole or not at all.
    fn check_layers(&self, first: u32, batch: &[LayerBytes], end: u32) -> Result<(), Refusal> {
        for (index, bytes) in (first..end).zip(batch) {
            self.check_layer(index, bytes)?;
        }
        if batch.len() > end.saturating_sub(first) as usize {
            return Err(Refusal::BadLayer { index: end });
        }
        Ok(())
    }

    /// Whether a layer can be laid. The robot's limits are the board's own: nothing that a host sends lifts them.
    pub(super) fn check_layer(&self, index: u32, bytes: &LayerBytes) -> Result<(), Refusal> {
        decode_checked(bytes, &self.robot).map(|_| ()).map_err(|_| Refusal::BadLayer { index })
    }

    /// Takes a layer into the store.
    pub(super) fn hold_layer(&mut self, bytes: LayerBytes) -> Result<(), Refusal> {
        if self.store_mut().push(bytes) { Ok(()) } else { Err(Refusal::Full) }
    }

    /// Replaces the layers from an index on, all or none.
    pub(super) fn amend(&mut self, amend: &Amend) -> Result<Message, Refusal> {
        self.check_event(Event::Amend)?;
        if amend.amended == 0 {
            return Err(Refusal::NotUnderstood);
        }
        if amend.amended == self.job.plan_id {
            return Ok(self.accepted());
        }
        self.this_plan(amend.plan_id)?;
        if amend.from < self.job.given {
            return Err(Refusal::Begun { first: self.job.given });
        }
        let expected = self.store().next_index();
        if amend.from > expected {
            return Err(Refusal::OutOfOrder { expected });
        }
        let capacity = self.parts.journal.capacity();
        if amend.layers > capacity {
            return Err(Refusal::PlanTooLong { layers: amend.layers, capacity });
        }
        // Something must be left to lay, or nothing would ever end it.
        if amend.layers <= self.job.laid || amend.layers < amend.from {
            return Err(Refusal::BadLayer { index: amend.layers });
        }
        self.check_layers(amend.from, &amend.first_layers, amend.layers)?;
        let room = self.store().room() + (expected - amend.from);
        if amend.first_layers.len() > room as usize {
            return Err(Refusal::Full);
        }
        let written = self.parts.journal.amended(amend.from, amend.amended, amend.layers);
        self.in_journal(written)?;
        self.store_mut().truncate(amend.from);
        for bytes in &amend.first_layers {
            self.hold_layer(*bytes)?;
        }
        (self.job.plan_id, self.job.layers) = (amend.amended, amend.layers);
        Ok(self.accepted())
    }

    pub(super) fn start(&mut self, start: &Start) -> Result<Message, Refusal> {
        self.this_plan(start.plan_id)?;
        self.check_event(Event::Start)?;
        if self.state == State::Idle && self.job.interrupted.is_some() {
            // What becomes of the layer that was cut is for a host to say, by `Resume`.
            return Err(Refusal::OutOfOrder { expected: self.job.laid });
        }
        if self.may_be_halted() {
            return Err(Refusal::DebugProbe);
        }
        self.go_on_holding(None);
        self.job.silence = start.silence;
        match self.state {
            State::Idle if self.job.laid == self.job.layers => {
                self.end_job();
                self.happens(Event::Finished);
            }
            State::Idle | State::Parked => {
                self.heater.switch_on(self.robot.description().heater.target_c, self.now);
                self.happens(Event::Start);
            }
            // Repeated, or the end of a hold.
            _ => {}
        }
        Ok(self.accepted())
    }

    /// Gives the job up. Repeating it changes nothing.
    pub(super) fn cancel(&mut self, cancel: &Cancel, handover: &Handover) -> Result<Message, Refusal> {
        self.check_event(Event::Cancel)?;
        if self.job.plan_id != 0 {
            self.this_plan(cancel.plan_id)?;
        }
        self.cut_off(handover);
        self.end_job();
        self.store_mut().restart(0);
        self.job = Job::default();
        self.happens(Event::Cancel);
        Ok(self.accepted())
    }

    /// The journal need not remember the job any more.
    pub(super) fn end_job(&mut self) {
        if self.parts.journal.job().is_some_and(|job| !job.ended) {
            self.job.unwritten |= self.parts.journal.ended().is_err();
        }
    }

    /// Everything off; a layer that was under way is cut, and how much of it was made is known.
    pub(super) fn cut_off(&mut self, handover: &Handover) {
        // A layer whose report waits is laid.
        if self.job.given > self.job.laid
            && let Some(Report::Laid(turn)) = handover.take_report()
        {
            self.count(&turn, handover);
        }
        let sectors = handover.progress();
        self.switch_off(handover);
        if self.job.given > self.job.laid {
            let min = sectors.min(SECTORS as u32 - 1) as u8;
            self.job.interrupted = Some(InterruptedLayer { min, max: min + 1 });
            self.job.forget_given();
        }
    }

    /// After a start of the board: the job that the journal knows, with nothing of it in the store.
    pub(super) fn restore_job(&mut self) {
        let robot = self.robot.hash();
        // One that is done is known too: its host may not have heard of its last layers.
        let is_known = |job: &&JobState| job.robot == robot && (!job.ended || job.laid == job.layers);
        let Some(known) = self.parts.journal.job().filter(is_known).copied() else { return };
        let cut = (known.begun > known.laid).then(|| match self.retained.under_way {
            Some(UnderWay { plan_id, laid, sectors, .. }) if (plan_id, laid) == (known.plan_id, known.laid) => {
                let since = RETAINED_AGE_S / self.robot.description().layer.period_s * SECTORS as f64;
                let max = (f64::from(sectors) + 1.0 + since).min(SECTORS as f64) as u8;
                InterruptedLayer { min: sectors, max }
            }
            _ => InterruptedLayer { min: 0, max: SECTORS as u8 },
        });
        self.job =
            Job { plan_id: known.plan_id, layers: known.layers, laid: known.laid, interrupted, ..Job::default() };
        self.store_mut().restart(known.laid);
        self.job.carry = self.parts.journal.carry();
        self.job.forget_given();
        // Between layers it held, and filament was pulled back.
        self.motion.assume_retracted(self.job.laid > 0 && self.job.interrupted.is_none());
    }

    /// The layer that is about to be handed to the engine is begun, as far as the journal is concerned. One that
    /// follows another without a pause is written down with that one.
    pub(super) fn note_begun(&mut self) {
        if self.job.given == self.job.laid {
            self.job.unwritten |= self.parts.journal.begun(self.job.given).is_err();
        }
        self.job.interrupted = None;
    }

    /// A layer is laid: the journal knows before anybody else.
    pub(super) fn commit(&mut self, as_built: LayerBytes, measured: Measured) {
        let index = self.job.laid;
        self.job.laid += 1;
        self.job.keep_measured(index, measured);
        self.parts.store.drop_first();
        let Some(left) = self.job.carries.pop_front() else { return };
        let layer = journal::Laid { as_built, ..left };
        self.job.carry.height_units += u64::from(layer.height_units);
        self.job.carry.lean_owed = layer.lean_owed;
        let next_begun = self.job.given > self.job.laid;
        self.job.unwritten |= self.parts.journal.committed(index, &layer, next_begun).is_err();
    }

    /// Tells the host of layers that it has not heard of, out of the journal.
    pub(super) fn tell_layers(&mut self) {
        while self.job.told < self.job.laid && self.link.takes_layers() {
            let index = self.job.told;
            let as_built = self.parts.journal.laid(index).filter(|laid| !laid.cut).map(|laid| laid.as_built);
            let measured = self.job.measured(index);
            self.link.tell(link::Event::Laid(Laid { plan_id: self.job.plan_id, index, as_built, measured }));
            self.job.told += 1;
        }
    }
}
