//! The handover between controller and step interrupt: one pending move, one pending report, a halt, and the readings
//! of the interrupt.
//!
//! The interrupt checks `halt` first in every tick, and accepts a turn at the end of the one before. Sectors are handed
//! over and counted one by one, in two slots each, because copying a whole turn made the worst tick ten times as long.
//! If a turn ends before the previous report is removed, it ends at rest and its report waits.
//!
//! The interrupt reports the emergency stop, the edges of the filament's encoder, the index sensor, and the count of
//! ticks, which proves that it runs. At an emergency stop the engine releases the motors, switches heater and fan off
//! by itself (`hal::Outputs`), and refuses moves until the controller has halted.

use core::cell::Cell;
use core::sync::atomic::{AtomicU32, Ordering};

use critical_section::{CriticalSection, Mutex};
use growbot_core::layer::SECTORS;
use portable_atomic::AtomicBool;

use super::moves::{AxisMove, EngineFault, HomingMove, Move, Report, TurnReport};
use super::ramp::RampLimits;
use super::turn::{Sector, Turn};

/// A move as the engine accepts it, without its sectors, which it gets one after the other.
///
/// Here and in [`Done`] the numbers leave 0 for `None`. An empty [`Mailbox`] is therefore all zeros, and costs a board
/// no flash.
#[derive(Clone, Copy)]
#[repr(u8)]
pub(super) enum PendingMove {
    Home(HomingMove) = 1,
    Feed(AxisMove) = 2,
    Lay(TurnHeader) = 3,
    Rotate(AxisMove) = 4,
}

/// A turn without its sectors.
#[derive(Clone, Copy)]
pub(super) struct TurnHeader {
    /// Slot of the turn's sectors.
    slot: Slot,
    pub backwards: bool,
    pub ticks: u32,
    pub pace: RampLimits,
}

impl TurnHeader {
    pub const NONE: Self = Self { slot: Slot::A, backwards: false, ticks: 0, pace: RampLimits::FULL };
}

/// A report as the engine writes it, without the steps in each sector, which it has written one after the other.
#[derive(Clone, Copy)]
#[repr(u8)]
pub(super) enum PendingReport {
    Homed = 1,
    Fed = 2,
    Laid { slot: Slot, head: u32 } = 3,
    Alarm(EngineFault) = 4,
    Rotated = 5,
}

/// One of two slots. One turn can be laid while the next one waits, and its steps are counted while the turn before is
/// reported.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Slot {
    A,
    B,
}

impl Slot {
    pub fn other(self) -> Self {
        match self {
            Self::A => Self::B,
            Self::B => Self::A,
        }
    }
}

/// A value for each sector of two turns.
struct Slots<T>(Mutex<[[Cell<T>; SECTORS]; 2]>);

impl<T: Copy> Slots<T> {
    fn with<R>(&self, slot: Slot, sector: usize, act: impl FnOnce(&Cell<T>) -> R) -> Option<R> {
        critical_section::with(|cs| {
            let [a, b] = self.0.borrow(cs);
            let turn = match slot {
                Slot::A => a,
                Slot::B => b,
            };
            turn.get(sector).map(act)
        })
    }

    fn get(&self, slot: Slot, sector: usize) -> Option<T> {
        self.with(slot, sector, Cell::get)
    }

    fn set(&self, slot: Slot, sector: usize, value: T) {
        self.with(slot, sector, |cell| cell.set(value));
    }
}

/// Mailbox shared by the controller and the step interrupt. Every access is short and none waits. The data of a whole
/// turn is copied sector by sector, so that the interrupt stays short and the controller never delays it.
///
/// The flags save the interrupt a critical section in each tick. A flag and the data that it announces change in one
/// critical section, so that no tick can occur between the two changes.
pub struct Mailbox {
    task: Mutex<Cell<Option<PendingMove>>>,
    /// Sectors of the current turn, and of the pending one.
    sectors: Slots<Sector>,
    /// Slot of the current turn. The controller owns the other slot.
    laying: Mutex<Cell<Slot>>,
    done: Mutex<Cell<Option<PendingReport>>>,
    /// Feed steps of the current turn, and of the reported one.
    made: Slots<u32>,
    order_waits: AtomicBool,
    report_waits: AtomicBool,
    halt: AtomicBool,
    /// Rate at which the pending turn can be entered; 0 if no turn is pending.
    entry: AtomicU32,
    emergency_stop: AtomicBool,
    /// An emergency stop was received over the link, and the engine has not handled it yet.
    called: AtomicBool,
    /// Number of emergency stops received over the link.
    calls: AtomicU32,
    /// Number of finished sectors of the current turn.
    progress: AtomicU32,
    /// Feed steps and ticks of the current sector. The steps are 0 while no turn is laid.
    sector_feed: AtomicU32,
    sector_ticks: AtomicU32,
    on_index: AtomicBool,
    filament_pulses: AtomicU32,
    ticks: AtomicU32,
}

impl Default for Mailbox {
    fn default() -> Self {
        Self::new()
    }
}

impl Mailbox {
    /// Creates an empty handover.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            task: Mutex::new(Cell::new(None)),
            sectors: Slots(Mutex::new(
                [const { [const { Cell::new(Sector { ticks: 0, head_steps: 0, feed_steps: 0 }) }; SECTORS] }; 2],
            )),
            laying: Mutex::new(Cell::new(Slot::A)),
            done: Mutex::new(Cell::new(None)),
            made: Slots(Mutex::new([const { [const { Cell::new(0) }; SECTORS] }; 2])),
            order_waits: AtomicBool::new(false),
            report_waits: AtomicBool::new(false),
            halt: AtomicBool::new(false),
            entry: AtomicU32::new(0),
            emergency_stop: AtomicBool::new(false),
            called: AtomicBool::new(false),
            calls: AtomicU32::new(0),
            progress: AtomicU32::new(0),
            sector_feed: AtomicU32::new(0),
            sector_ticks: AtomicU32::new(0),
            on_index: AtomicBool::new(false),
            filament_pulses: AtomicU32::new(0),
            ticks: AtomicU32::new(0),
        }
    }

    /// Returns whether a move can be submitted (controller side).
    #[must_use]
    pub fn can_accept_move(&self) -> bool {
        !self.order_waits.load(Ordering::Acquire) && !self.halt.load(Ordering::Acquire) && !self.is_emergency_stopped()
    }

    /// Submits the next move (controller side). A pending move is replaced. That is safe only after [`Mailbox::halt`],
    /// because the engine may already be braking for the pending move.
    pub fn submit(&self, order: Move) {
        self.discard_move();
        let (task, entry) = match order {
            Move::Home(homing) => (PendingMove::Home(homing), 0),
            Move::Feed(feed) => (PendingMove::Feed(feed), 0),
            Move::Rotate(rotate) => (PendingMove::Rotate(rotate), 0),
            Move::Lay(turn) => {
                let slot = critical_section::with(|cs| self.laying.borrow(cs).get()).other();
                for (index, sector) in turn.sectors.into_iter().enumerate() {
                    self.sectors.set(slot, index, sector);
                }
                let Turn { reverse: backwards, ticks, pace, .. } = turn;
                (PendingMove::Lay(TurnHeader { slot, backwards, ticks, pace }), pace.entry_rate)
            }
        };
        critical_section::with(|cs| {
            self.task.borrow(cs).set(Some(task));
            self.entry.store(entry, Ordering::Release);
            self.order_waits.store(true, Ordering::Release);
        });
    }

    /// Removes and returns the report (controller side).
    pub fn pop_report(&self) -> Option<Report> {
        if !self.report_waits.load(Ordering::Acquire) {
            return None;
        }
        let done = critical_section::with(|cs| self.done.borrow(cs).take());
        let report = done.map(|done| match done {
            PendingReport::Homed => Report::Homed,
            PendingReport::Fed => Report::Fed,
            PendingReport::Rotated => Report::Rotated,
            PendingReport::Laid { slot, head } => {
                let mut feed = [0; SECTORS];
                for (index, steps) in feed.iter_mut().enumerate() {
                    *steps = self.made.get(slot, index).unwrap_or_default();
                }
                Report::Laid(TurnReport { head, feed })
            }
            PendingReport::Alarm(alarm) => alarm.report(),
        });
        critical_section::with(|cs| {
            // An alarm may have been written in the meantime.
            let alarm = self.done.borrow(cs).get();
            self.report_waits.store(alarm.is_some(), Ordering::Release);
        });
        report
    }

    /// Stops the steppers and switches their drivers off at the next tick (controller side). Pending moves and reports
    /// are dropped, and so is an emergency stop that has been released.
    pub fn halt(&self) {
        critical_section::with(|cs| {
            self.halt.store(true, Ordering::Release);
            self.done.borrow(cs).set(None);
            self.report_waits.store(false, Ordering::Release);
            self.forget(cs);
        });
    }

    /// Returns whether the emergency stop is pressed, or was pressed since the last [`Mailbox::halt`]. The engine has
    /// then released the motors by itself and accepts no moves.
    #[must_use]
    #[inline]
    pub fn is_emergency_stopped(&self) -> bool {
        self.emergency_stop.load(Ordering::Acquire)
    }

    /// Reports an emergency stop that was received over the link (from the UART's interrupt). The engine releases the
    /// motors at its next tick, as if the input were pressed for a moment.
    pub fn request_emergency_stop(&self) {
        self.emergency_stop.store(true, Ordering::Release);
        self.called.store(true, Ordering::Release);
        // Only one interrupt writes this count.
        self.calls.store(self.link_emergency_stops().wrapping_add(1), Ordering::Release);
    }

    /// Returns the number of emergency stops received over the link, wrapping.
    #[must_use]
    pub fn link_emergency_stops(&self) -> u32 {
        self.calls.load(Ordering::Acquire)
    }

    /// Returns the number of finished sectors of the latest turn.
    #[must_use]
    pub fn sectors_done(&self) -> u32 {
        self.progress.load(Ordering::Acquire)
    }

    /// Returns the present feed rate of the current layer, steps a tick; 0 if no layer is laid.
    #[must_use]
    pub fn feed_steps_per_tick(&self) -> f64 {
        // Both values must belong to one sector, so the step interrupt must not run between the reads.
        let (steps, ticks) = critical_section::with(|_| {
            (self.sector_feed.load(Ordering::Acquire), self.sector_ticks.load(Ordering::Acquire))
        });
        f64::from(steps) / f64::from(ticks.max(1))
    }

    /// Returns whether the index sensor detects its mark. It is read in each step of the head, and in each tick without
    /// a move.
    #[must_use]
    pub fn on_index(&self) -> bool {
        self.on_index.load(Ordering::Acquire)
    }

    /// Returns the pulses of the filament's encoder: those forward minus those in reverse, wrapping.
    #[must_use]
    pub fn filament_pulses(&self) -> u32 {
        self.filament_pulses.load(Ordering::Acquire)
    }

    /// Returns the ticks of the step interrupt, wrapping. They prove that the interrupt runs.
    #[must_use]
    pub fn ticks(&self) -> u32 {
        self.ticks.load(Ordering::Acquire)
    }

    /// Returns whether a report is pending for the controller.
    #[must_use]
    #[inline]
    pub fn has_report(&self) -> bool {
        self.report_waits.load(Ordering::Acquire)
    }

    /// Returns whether the controller requests a halt (engine side).
    #[inline]
    pub(super) fn is_halt_requested(&self) -> bool {
        self.halt.load(Ordering::Acquire)
    }

    /// Returns whether to halt now, and clears the request (engine side).
    #[inline]
    pub(super) fn take_halt_request(&self) -> bool {
        // The load comes first, because a swap in each tick would cost more than the rest of an idle tick.
        self.is_halt_requested() && self.halt.swap(false, Ordering::AcqRel)
    }

    /// Returns whether a move is pending (engine side).
    #[inline]
    pub(super) fn has_move(&self) -> bool {
        self.order_waits.load(Ordering::Acquire)
    }

    /// Returns the rate at which the next turn can follow this one (engine side). It is 0 if the engine must stop,
    /// because no turn is pending or the report of this turn would have to wait.
    #[inline]
    pub(super) fn next_entry_rate(&self) -> u32 {
        if self.has_report() { 0 } else { self.entry.load(Ordering::Acquire) }
    }

    /// Accepts the pending move (engine side).
    pub(super) fn take_move(&self) -> Option<PendingMove> {
        critical_section::with(|cs| {
            let task = self.task.borrow(cs).get();
            self.forget(cs);
            if let Some(PendingMove::Lay(outline)) = &task {
                self.laying.borrow(cs).set(outline.slot);
            }
            task
        })
    }

    /// Returns a sector of the current turn (engine side).
    pub(super) fn sector(&self, turn: &TurnHeader, index: usize) -> Option<Sector> {
        self.sectors.get(turn.slot, index)
    }

    /// Drops the pending move.
    pub(super) fn discard_move(&self) {
        critical_section::with(|cs| self.forget(cs));
    }

    fn forget(&self, cs: CriticalSection) {
        self.order_waits.store(false, Ordering::Release);
        self.entry.store(0, Ordering::Release);
        self.task.borrow(cs).set(None);
    }

    /// Writes the feed steps of a sector (engine side).
    pub(super) fn store_feed_steps(&self, slot: Slot, sector: usize, steps: u32) {
        self.made.set(slot, sector, steps);
    }

    /// Writes a report (engine side).
    pub(super) fn post_report(&self, done: PendingReport) {
        critical_section::with(|cs| {
            self.done.borrow(cs).set(Some(done));
            self.report_waits.store(true, Ordering::Release);
        });
    }

    #[inline]
    pub(super) fn is_link_stop_pending(&self) -> bool {
        self.called.load(Ordering::Acquire)
    }

    /// Returns whether an emergency stop was received over the link, and clears it (engine side).
    #[inline]
    pub(super) fn take_link_stop(&self) -> bool {
        self.is_link_stop_pending() && self.called.swap(false, Ordering::AcqRel)
    }

    pub(super) fn set_progress(&self, sectors: usize) {
        self.progress.store(sectors as u32, Ordering::Release);
    }

    /// Publishes the feed of the sector that begins (engine side). The value is [`Sector::default`] once no layer is
    /// laid.
    pub(super) fn set_sector(&self, sector: &Sector) {
        self.sector_feed.store(sector.feed_steps, Ordering::Release);
        self.sector_ticks.store(sector.ticks, Ordering::Release);
    }

    pub(super) fn set_emergency_stop(&self, pressed: bool) {
        self.emergency_stop.store(pressed, Ordering::Release);
    }

    #[inline]
    pub(super) fn set_on_index(&self, on: bool) {
        self.on_index.store(on, Ordering::Release);
    }

    #[inline]
    pub(super) fn set_filament_pulses(&self, pulses: u32) {
        self.filament_pulses.store(pulses, Ordering::Release);
    }

    #[inline]
    pub(super) fn set_ticks(&self, ticks: u32) {
        self.ticks.store(ticks, Ordering::Release);
    }
}
