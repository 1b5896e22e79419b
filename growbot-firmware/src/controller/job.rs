//! The job: its plan, its progress, and the requests that change it.
//!
//! A layer is a transaction that is identified by the plan and the layer's index. It is accepted into the store, begun,
//! and committed to the journal once it is laid. No index is laid twice and none is skipped, unless the operator
//! decides so for an interrupted layer.

use growbot_core::layer::SECTORS;
use growbot_core::layer_bytes::{LayerBytes, decode_checked};
use growbot_core::link::message::{
    Amend, AppendLayers, BeginJob, Cancel, InterruptedLayer, LayerLaid, LayerReadings, Message, Refusal, Resume, Start,
    State,
};

use super::active_job::ActiveJob;
use super::{Controller, centi};
use crate::hal::{Board, Watchdog};
use crate::journal::{self, JournalError, JournalJob};
use crate::link;
use crate::safety::retained::ActiveWork;
use crate::safety::transitions::Event;
use crate::stepping::{Mailbox, Report};

/// Temperature that the nozzle must be below before flash is erased, degrees Celsius. Erasing stops the processor for
/// up to two seconds.
pub(super) const COLD_C: f64 = 50.0;
/// Max age of the current layer's progress in the memory that survives a reset, s.
const RETAINED_AGE_S: f64 = 0.25;

impl<B: Board> Controller<B> {
    pub(super) fn begin(&mut self, begin: &BeginJob) -> Result<Message, Refusal> {
        if begin.robot_hash != self.robot.hash() {
            return Err(Refusal::RobotMismatch { board: self.robot.hash() });
        }
        if begin.plan_id == 0 {
            return Err(Refusal::UnknownRequest);
        }
        self.check_event(Event::Begin)?;
        let repeated = (begin.plan_id, begin.layers) == (self.job.plan_id, self.job.layer_count);
        match self.state {
            // At rest the request starts another growth, of the same plan or of a new one.
            State::Done | State::Stopped => {}
            State::Idle if repeated && self.job.layers_laid == 0 && self.job.interrupted.is_none() => {
                return Ok(self.accepted());
            }
            State::Idle => {}
            _ if repeated => return Ok(self.accepted()),
            // Another job is in progress.
            state => return Err(Refusal::WrongState { state }),
        }
        self.new_job(begin.plan_id, begin.layers)?;
        self.apply_event(Event::Begin);
        Ok(self.accepted())
    }

    /// Starts a new job in place of the current one, in the journal too.
    pub(super) fn new_job(&mut self, plan_id: u64, layers: u32) -> Result<(), Refusal> {
        let capacity = self.parts.journal.capacity();
        if layers > capacity {
            return Err(Refusal::PlanTooLong { layers, capacity });
        }
        self.erase_journal_for(layers)?;
        self.parts.journal.begin_job(plan_id, self.robot.hash(), layers).map_err(|_| Refusal::JournalNotWritable)?;
        self.store_mut().restart(0);
        self.job = ActiveJob { plan_id, layer_count: layers, ..ActiveJob::default() };
        Ok(())
    }

    /// Erases as much of the journal as a job of `layers` layers needs. Call it only with everything off. The nozzle
    /// must be cold too, because nothing is monitored while the flash is erased.
    fn erase_journal_for(&mut self, layers: u32) -> Result<(), Refusal> {
        while self.parts.journal.needs_erasing(layers) {
            if self.heater.temperature(self.now_us).is_none_or(|temperature| temperature >= COLD_C) {
                return Err(Refusal::NozzleTooHot { below: centi(COLD_C) });
            }
            self.parts.watchdog.feed();
            // A new job is about to start, so the record of the previous one may be lost.
            self.parts.journal.forget();
            self.parts.journal.erase_step(layers).map_err(|_| Refusal::JournalNotWritable)?;
        }
        self.parts.watchdog.feed();
        Ok(())
    }

    pub(super) fn check_plan_id(&self, plan_id: u64) -> Result<(), Refusal> {
        if plan_id == 0 || plan_id != self.job.plan_id {
            return Err(Refusal::PlanMismatch { board: self.job.plan_id });
        }
        Ok(())
    }

    pub(super) fn resume(&mut self, resume: &Resume) -> Result<Message, Refusal> {
        self.check_event(Event::Resume)?;
        self.check_plan_id(resume.plan_id)?;
        let laid = self.job.layers_laid;
        if matches!(self.state, State::Idle | State::Stopped) {
            if resume.start_layer == laid.saturating_add(1) && self.job.interrupted.is_some() {
                self.skip_interrupted()?;
            } else if resume.start_layer != laid {
                return Err(Refusal::OutOfOrder { expected: laid });
            }
            self.job.forget_given();
            // The layer is laid again, on top of its finished part.
            self.job.interrupted = None;
        }
        self.job.layers_reported = resume.reported_layers.min(self.job.layers_laid);
        self.apply_event(Event::Resume);
        Ok(self.accepted())
    }

    /// Converts a failed write to the journal to a refusal of the request, and marks the job as not resumable.
    fn journal_result(&mut self, written: Result<(), JournalError>) -> Result<(), Refusal> {
        written.map_err(|_| {
            self.job.journal_failed = true;
            Refusal::JournalNotWritable
        })
    }

    /// Counts the interrupted layer as laid, although only a part of it was made. The job then resumes with the next
    /// layer.
    fn skip_interrupted(&mut self) -> Result<(), Refusal> {
        let index = self.job.layers_laid;
        let unknown = journal::LayerRecord {
            as_built: LayerBytes::default(),
            height_units: 0,
            residual_lean: self.job.carry.residual_lean,
        };
        let written = self.parts.journal.record_skipped(index, &unknown);
        self.journal_result(written)?;
        if self.store().get(index).is_some() {
            self.store_mut().drop_first();
        } else {
            self.store_mut().restart(index + 1);
        }
        self.job.layers_laid += 1;
        self.job.interrupted = None;
        Ok(())
    }

    pub(super) fn store_layers(&mut self, batch: &AppendLayers) -> Result<Message, Refusal> {
        self.check_plan_id(batch.plan_id)?;
        self.check_event(Event::Layers)?;
        let expected = self.store().next_index();
        if batch.first > expected {
            return Err(Refusal::OutOfOrder { expected });
        }
        let already_stored = (expected - batch.first) as usize;
        let new = batch.layers.get(already_stored..).unwrap_or_default();
        self.check_layers(expected, new, self.job.layer_count)?;
        if new.len() > self.store().room() as usize {
            return Err(Refusal::LayerStoreFull);
        }
        for bytes in new {
            self.store_layer(*bytes)?;
        }
        Ok(self.accepted())
    }

    /// Checks all layers of a batch before the first one is stored, because a batch is stored as a whole or not at all.
    fn check_layers(&self, first: u32, batch: &[LayerBytes], end: u32) -> Result<(), Refusal> {
        for (index, bytes) in (first..end).zip(batch) {
            self.check_layer(index, bytes)?;
        }
        if batch.len() > end.saturating_sub(first) as usize {
            return Err(Refusal::LayerOutOfLimits { index: end });
        }
        Ok(())
    }

    /// Refuses a layer that the robot cannot lay. The limits of the robot are part of the board's configuration, so
    /// that no layer from a host can exceed them.
    pub(super) fn check_layer(&self, index: u32, bytes: &LayerBytes) -> Result<(), Refusal> {
        decode_checked(bytes, &self.robot).map(|_| ()).map_err(|_| Refusal::LayerOutOfLimits { index })
    }

    /// Stores a layer. Refuses it if the layer store is full.
    pub(super) fn store_layer(&mut self, bytes: LayerBytes) -> Result<(), Refusal> {
        if self.store_mut().push(bytes) { Ok(()) } else { Err(Refusal::LayerStoreFull) }
    }

    /// Replaces the layers of the job from an index on. If one of the new layers is refused, no layer is replaced.
    pub(super) fn amend(&mut self, amend: &Amend) -> Result<Message, Refusal> {
        self.check_event(Event::Amend)?;
        if amend.new_plan_id == 0 {
            return Err(Refusal::UnknownRequest);
        }
        if amend.new_plan_id == self.job.plan_id {
            return Ok(self.accepted());
        }
        self.check_plan_id(amend.plan_id)?;
        if amend.first_replaced < self.job.layers_begun {
            return Err(Refusal::LayerAlreadyBegun { first: self.job.layers_begun });
        }
        let expected = self.store().next_index();
        if amend.first_replaced > expected {
            return Err(Refusal::OutOfOrder { expected });
        }
        let capacity = self.parts.journal.capacity();
        if amend.layers > capacity {
            return Err(Refusal::PlanTooLong { layers: amend.layers, capacity });
        }
        // At least one layer must remain, because otherwise nothing would end the job.
        if amend.layers <= self.job.layers_laid || amend.layers < amend.first_replaced {
            return Err(Refusal::LayerOutOfLimits { index: amend.layers });
        }
        self.check_layers(amend.first_replaced, &amend.first_layers, amend.layers)?;
        let room = self.store().room() + (expected - amend.first_replaced);
        if amend.first_layers.len() > room as usize {
            return Err(Refusal::LayerStoreFull);
        }
        let written = self.parts.journal.record_amended(amend.first_replaced, amend.new_plan_id, amend.layers);
        self.journal_result(written)?;
        self.store_mut().truncate(amend.first_replaced);
        for bytes in &amend.first_layers {
            self.store_layer(*bytes)?;
        }
        (self.job.plan_id, self.job.layer_count) = (amend.new_plan_id, amend.layers);
        Ok(self.accepted())
    }

    pub(super) fn start(&mut self, start: &Start) -> Result<Message, Refusal> {
        self.check_plan_id(start.plan_id)?;
        self.check_event(Event::Start)?;
        if start.is_continuation && !self.pause_cause().allows_continuation(self.state) {
            return Err(Refusal::WrongState { state: self.state });
        }
        if self.state == State::Idle && self.job.interrupted.is_some() {
            // A host must decide with `Resume` how the interrupted layer is handled.
            return Err(Refusal::OutOfOrder { expected: self.job.layers_laid });
        }
        if self.may_be_halted() {
            return Err(Refusal::DebugProbe);
        }
        let is_at_rest = matches!(self.state, State::Idle | State::Parked | State::Paused);
        let is_unloaded = self.motion.behind() > self.retract_steps();
        if is_at_rest && (!self.has_filament() || is_unloaded) {
            return Err(Refusal::NoFilament);
        }
        if self.motion.is_maintenance_active() {
            return Err(Refusal::StillMoving);
        }
        self.set_pause(None);
        self.job.silence = start.on_host_silence;
        match self.state {
            State::Idle if self.job.layers_laid == self.job.layer_count => {
                self.end_job();
                self.apply_event(Event::Finished);
            }
            State::Idle | State::Parked => {
                self.heater.switch_on(self.robot.description().heater.target_c, self.now_us);
                self.apply_event(Event::Start);
            }
            // The request is a repetition, or ends a pause.
            _ => {}
        }
        Ok(self.accepted())
    }

    /// Cancels the job. A repeated request changes nothing.
    pub(super) fn cancel(&mut self, cancel: &Cancel, handover: &Mailbox) -> Result<Message, Refusal> {
        self.check_event(Event::Cancel)?;
        if self.job.plan_id != 0 {
            self.check_plan_id(cancel.plan_id)?;
        }
        self.abort_layer(handover);
        self.end_job();
        self.store_mut().restart(0);
        self.job = ActiveJob::default();
        self.apply_event(Event::Cancel);
        Ok(self.accepted())
    }

    /// Records in the journal that the job has ended, unless that is already recorded.
    pub(super) fn end_job(&mut self) {
        if self.parts.journal.job().is_some_and(|job| !job.ended) {
            self.job.journal_failed |= self.parts.journal.record_ended().is_err();
        }
    }

    /// Switches everything off. If a layer was in progress it becomes the interrupted layer, and its progress is
    /// recorded.
    pub(super) fn abort_layer(&mut self, handover: &Mailbox) {
        // From here on the engine makes no step, so that its reports and its progress are final.
        self.switch_outputs_off(handover);
        while let Some(report) = handover.pop_ended_move() {
            // The head is homed again before the next layer.
            if report != Report::Homed {
                self.handle_ended_move(report, handover);
            }
        }
        let sectors = handover.take_sectors_done();
        self.switch_off(handover);
        if self.job.layers_begun > self.job.layers_laid {
            self.job.interrupted = sectors.map(|sectors| {
                let min = sectors.min(SECTORS as u32 - 1) as u8;
                InterruptedLayer { min, max: min + 1 }
            });
            self.job.forget_given();
        }
    }

    /// Restores the job from the journal after a start of the board. The layer store does not contain the job's layers
    /// after a start. `is_memory_lost` is true if the retained state is unknown.
    pub(super) fn restore_job(&mut self, is_memory_lost: bool) {
        let robot = self.robot.hash();
        // A finished job is restored too, because the host may not have acknowledged its last layers.
        let is_known = |job: &&JournalJob| job.robot == robot && (!job.ended || job.layers_laid == job.layer_count);
        let Some(known) = self.parts.journal.job().filter(is_known).copied() else { return };
        let interrupted = (known.layers_begun > known.layers_laid).then(|| match self.retained.under_way {
            // The retained progress counts only for the layer that was current then. In a later state, for example in
            // maintenance, no layer was current.
            Some(ActiveWork { plan_id, layers_laid: laid, layers_begun: begun, sectors_done: sectors, .. })
                if (plan_id, laid) == (known.plan_id, known.layers_laid) && begun > laid =>
            {
                let since = RETAINED_AGE_S / self.robot.description().layer.period_s * SECTORS as f64;
                let max = (f64::from(sectors) + 1.0 + since).min(SECTORS as f64) as u8;
                InterruptedLayer { min: sectors, max }
            }
            _ => InterruptedLayer { min: 0, max: SECTORS as u8 },
        });
        self.job = ActiveJob {
            plan_id: known.plan_id,
            layer_count: known.layer_count,
            layers_laid: known.layers_laid,
            interrupted,
            ..ActiveJob::default()
        };
        self.store_mut().restart(known.layers_laid);
        self.job.carry = self.parts.journal.carry();
        self.job.forget_given();
        // Without the retained state, a robot between two layers is assumed to have been paused, with filament pulled
        // back.
        let laid = self.job.layers_laid;
        if is_memory_lost && self.job.interrupted.is_none() && laid > 0 && laid < self.job.layer_count {
            self.motion.set_retracted_steps(self.retract_steps());
        }
    }

    /// Records in the journal that a layer is begun, before the step engine receives the layer. If the previous layer
    /// is still being laid, nothing is recorded now: the later record of that layer also states that this layer was
    /// begun.
    pub(super) fn note_begun(&mut self) {
        if self.job.layers_begun == self.job.layers_laid {
            self.job.journal_failed |= self.parts.journal.record_begun(self.job.layers_begun).is_err();
        }
        self.job.interrupted = None;
    }

    /// Counts the oldest layer in progress as laid: keeps its sensor readings, removes it from the layer store and
    /// records it in the journal.
    pub(super) fn commit(&mut self, as_built: LayerBytes, measured: LayerReadings) {
        let index = self.job.layers_laid;
        self.job.layers_laid += 1;
        self.job.store_measured(index, measured);
        self.parts.store.drop_first();
        let Some(left) = self.job.carries.pop_front() else { return };
        let layer = journal::LayerRecord { as_built, ..left };
        self.job.carry.height_units += u64::from(layer.height_units);
        self.job.carry.residual_lean = layer.residual_lean;
        let next_begun = self.job.layers_begun > self.job.layers_laid;
        self.job.journal_failed |= self.parts.journal.record_laid(index, &layer, next_begun).is_err();
    }

    /// Reports the laid layers that have not been reported to the host yet, as long as the link's queue has room for
    /// them.
    pub(super) fn report_layers(&mut self) {
        while self.job.layers_reported < self.job.layers_laid && self.link.has_room_for_layer() {
            let index = self.job.layers_reported;
            let as_built = self.parts.journal.layer(index).filter(|laid| !laid.interrupted).map(|laid| laid.as_built);
            let measured = self.job.measured(index);
            self.link.push_event(link::HostEvent::Laid(LayerLaid {
                plan_id: self.job.plan_id,
                index,
                as_built,
                readings: measured,
            }));
            self.job.layers_reported += 1;
        }
    }
}
