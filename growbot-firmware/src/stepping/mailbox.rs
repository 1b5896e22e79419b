//! The mailbox between the controller and the step interrupt. It contains one pending move, reports, a halt request,
//! and the values that the interrupt measures.
//!
//! The interrupt checks `halt` first in every tick, and accepts a turn at the end of the previous turn. Sectors are
//! handed over and counted one by one, in two slots each, because copying a whole turn made the worst tick ten times as
//! long.
//!
//! No report is lost. The reports of two ended moves can wait for the controller, and an alarm in addition. If a turn
//! ends while the report of the previous move still waits, it ends at rest, and no move begins until the controller has
//! removed a report. After a halt the interrupt changes neither reports nor progress, so the controller reads both
//! after it ([`Mailbox::halt`]).
//!
//! The interrupt reports the emergency stop, the edges of the filament's encoder, the index sensor, and the count of
//! ticks, which proves that it runs. At an emergency stop the engine releases the motors, switches heater and fan off
//! by itself (`hal::Outputs`), and refuses moves until the controller has halted.

use core::cell::Cell;
#[cfg(not(test))]
use core::sync::atomic::AtomicU32;
use core::sync::atomic::Ordering;

#[cfg(not(test))]
use critical_section as exclusive;
use critical_section::{CriticalSection, Mutex};
use growbot_core::layer::SECTORS;
#[cfg(not(test))]
use portable_atomic::AtomicBool;

// In tests the step interrupt can occur before each access.
#[cfg(test)]
use crate::testing::preemption::{self as exclusive, AtomicBool, AtomicU32};

use super::direction::MotorDirection;
use super::moves::{AxisMove, EngineFault, HomingMove, Move, Report, TurnReport};
use super::ramp::RampLimits;
use super::turn::{Sector, Turn};

/// A move as the engine accepts it. It does not contain the sectors of a turn, which the engine reads one by one from
/// the mailbox.
///
/// The discriminants here and in [`PendingReport`] begin at 1, so that 0 can stand for `None`. An empty [`Mailbox`] is
/// therefore all zeros, and costs a board no flash.
#[derive(Clone, Copy)]
#[repr(u8)]
pub(super) enum PendingMove {
    Home(HomingMove) = 1,
    Feed(AxisMove) = 2,
    Lay(TurnHeader) = 3,
    Rotate(AxisMove) = 4,
}

/// Header of a turn: all its data except the sectors.
#[derive(Clone, Copy)]
pub(super) struct TurnHeader {
    /// Slot of the mailbox that contains the sectors of this turn.
    slot: Slot,
    pub direction: MotorDirection,
    pub ticks: u32,
    pub pace: RampLimits,
}

impl TurnHeader {
    pub const NONE: Self = Self { slot: Slot::A, direction: MotorDirection::Forward, ticks: 0, pace: RampLimits::FULL };
}

/// The report of an ended move as the engine writes it. It does not contain the feed steps of each sector, which the
/// engine has already written one by one to the mailbox.
#[derive(Clone, Copy)]
#[repr(u8)]
pub(super) enum PendingReport {
    Homed = 1,
    Fed = 2,
    Laid { slot: Slot, head: u32 } = 3,
    Rotated = 4,
}

/// Max number of reports of ended moves that wait for the controller. It is two, because the steps of two turns are
/// counted in two slots.
const MAX_REPORTS: u32 = 2;

/// Reports that the controller has not yet removed.
#[derive(Clone, Copy)]
struct Reports {
    /// Reports of ended moves, the oldest first.
    ended: [Option<PendingReport>; MAX_REPORTS as usize],
    /// The first alarm that the controller has not yet removed.
    alarm: Option<EngineFault>,
}

impl Reports {
    const NONE: Self = Self { ended: [None; MAX_REPORTS as usize], alarm: None };
}

/// One of two slots for the data of turns. One turn can be laid while the next turn waits, and the steps of a turn are
/// counted while the previous turn is reported.
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

/// A value for each sector of two turns, in two slots.
struct Slots<T>(Mutex<[[Cell<T>; SECTORS]; 2]>);

impl<T: Copy> Slots<T> {
    fn with<R>(&self, slot: Slot, sector: usize, act: impl FnOnce(&Cell<T>) -> R) -> Option<R> {
        exclusive::with(|cs| {
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
    /// Sectors of the current turn and of the pending turn.
    sectors: Slots<Sector>,
    /// Slot of the turn that is being laid. The controller may write to the other slot.
    laying: Mutex<Cell<Slot>>,
    reports: Mutex<Cell<Reports>>,
    /// Number of feed steps made in each sector of the current turn, and of the turn that is being reported.
    made: Slots<u32>,
    order_waits: AtomicBool,
    /// Number of reports of ended moves that the controller has not yet removed.
    ended: AtomicU32,
    alarm_waits: AtomicBool,
    halt: AtomicBool,
    /// Rate at which the pending turn can be entered, units of 2^-24; 0 if no turn is pending.
    entry: AtomicU32,
    emergency_stop: AtomicBool,
    /// True if an emergency stop was received over the link, and the engine has not handled it yet.
    called: AtomicBool,
    /// Number of emergency stops received over the link.
    calls: AtomicU32,
    /// Number of times that the emergency stop was pressed.
    presses: AtomicU32,
    /// Number of finished sectors of the current turn, plus 1; 0 if the latest turn has ended.
    progress: AtomicU32,
    /// Number of feed steps of the current sector; 0 while no turn is laid. `sector_ticks` is its number of ticks.
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
    /// Creates an empty mailbox.
    pub const fn new() -> Self {
        Self {
            task: Mutex::new(Cell::new(None)),
            sectors: Slots(Mutex::new(
                [const { [const { Cell::new(Sector { ticks: 0, head_steps: 0, feed_steps: 0 }) }; SECTORS] }; 2],
            )),
            laying: Mutex::new(Cell::new(Slot::A)),
            reports: Mutex::new(Cell::new(Reports::NONE)),
            made: Slots(Mutex::new([const { [const { Cell::new(0) }; SECTORS] }; 2])),
            order_waits: AtomicBool::new(false),
            ended: AtomicU32::new(0),
            alarm_waits: AtomicBool::new(false),
            halt: AtomicBool::new(false),
            entry: AtomicU32::new(0),
            emergency_stop: AtomicBool::new(false),
            called: AtomicBool::new(false),
            calls: AtomicU32::new(0),
            presses: AtomicU32::new(0),
            progress: AtomicU32::new(0),
            sector_feed: AtomicU32::new(0),
            sector_ticks: AtomicU32::new(0),
            on_index: AtomicBool::new(false),
            filament_pulses: AtomicU32::new(0),
            ticks: AtomicU32::new(0),
        }
    }

    /// Returns whether a move can be submitted (controller side).
    pub fn can_accept_move(&self) -> bool {
        !self.has_move() && !self.is_halt_requested() && !self.has_alarm() && !self.is_emergency_stopped()
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
                let slot = exclusive::with(|cs| self.laying.borrow(cs).get()).other();
                for (index, sector) in turn.sectors.into_iter().enumerate() {
                    self.sectors.set(slot, index, sector);
                }
                let Turn { direction, ticks, pace, .. } = turn;
                (PendingMove::Lay(TurnHeader { slot, direction, ticks, pace }), pace.entry_rate)
            }
        };
        exclusive::with(|cs| {
            self.task.borrow(cs).set(Some(task));
            self.entry.store(entry, Ordering::Release);
            self.order_waits.store(true, Ordering::Release);
        });
    }

    /// Removes and returns the next report (controller side). The reports of ended moves come first, oldest first, and
    /// then the alarm. `None` if no report is pending.
    pub fn pop_report(&self) -> Option<Report> {
        if let Some(ended) = self.pop_ended_move() {
            return Some(ended);
        }
        if !self.has_alarm() {
            return None;
        }
        exclusive::with(|cs| {
            let mut reports = self.reports.borrow(cs).get();
            let alarm = reports.alarm.take();
            self.reports.borrow(cs).set(reports);
            self.alarm_waits.store(false, Ordering::Release);
            alarm.map(EngineFault::report)
        })
    }

    /// Removes and returns the oldest report of an ended move (controller side). `None` if no such report is pending.
    pub fn pop_ended_move(&self) -> Option<Report> {
        if self.ended.load(Ordering::Acquire) == 0 {
            return None;
        }
        let [oldest, _] = exclusive::with(|cs| self.reports.borrow(cs).get()).ended;
        let report = match oldest? {
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
        };
        // The report is removed only after its steps are read, so that no other turn is counted in its slot meanwhile.
        exclusive::with(|cs| {
            let mut reports = self.reports.borrow(cs).get();
            let [_, next] = reports.ended;
            reports.ended = [next, None];
            self.reports.borrow(cs).set(reports);
            self.ended.store(u32::from(next.is_some()), Ordering::Release);
        });
        Some(report)
    }

    /// Requests a halt (controller side). The engine stops the steppers and switches their drivers off at the next
    /// tick. The pending move is dropped, and so is an emergency stop that has been released. Reports and progress
    /// stay, and no longer change.
    pub fn halt(&self) {
        exclusive::with(|cs| {
            self.halt.store(true, Ordering::Release);
            self.forget(cs);
        });
    }

    /// Drops the reports of ended moves (controller side). An alarm is kept.
    pub fn discard_ended_moves(&self) {
        while self.pop_ended_move().is_some() {}
    }

    /// Returns whether the emergency stop is pressed, or was pressed since the last [`Mailbox::halt`]. The engine has
    /// then released the motors by itself and accepts no moves.
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
    pub fn link_emergency_stops(&self) -> u32 {
        self.calls.load(Ordering::Acquire)
    }

    /// Returns the number of times that the emergency stop was pressed, wrapping. Even a very short press counts.
    pub fn emergency_stop_presses(&self) -> u32 {
        self.presses.load(Ordering::Acquire)
    }

    /// Returns the number of finished sectors of the current turn. `None` if no turn has begun since the latest one
    /// ended.
    pub fn sectors_done(&self) -> Option<u32> {
        self.progress.load(Ordering::Acquire).checked_sub(1)
    }

    /// Returns the number of finished sectors of the current turn, as [`Mailbox::sectors_done`] does, and records that
    /// no turn is being laid (controller side). Call it after [`Mailbox::halt`].
    pub fn take_sectors_done(&self) -> Option<u32> {
        let sectors = self.sectors_done();
        self.end_progress();
        sectors
    }

    /// Returns the present feed rate of the current layer, feed steps a tick; 0 if no layer is laid.
    pub fn feed_steps_per_tick(&self) -> f64 {
        // Both values must belong to one sector, so the step interrupt must not run between the reads.
        let (steps, ticks) =
            exclusive::with(|_| (self.sector_feed.load(Ordering::Acquire), self.sector_ticks.load(Ordering::Acquire)));
        f64::from(steps) / f64::from(ticks.max(1))
    }

    /// Returns whether the index sensor detects its mark. The engine reads the sensor in each step of the head, and in
    /// each tick without a move.
    pub fn on_index(&self) -> bool {
        self.on_index.load(Ordering::Acquire)
    }

    /// Returns the number of pulses of the filament's encoder: forward pulses minus reverse pulses, wrapping.
    pub fn filament_pulses(&self) -> u32 {
        self.filament_pulses.load(Ordering::Acquire)
    }

    /// Returns the number of ticks of the step interrupt, wrapping. A change proves that the interrupt runs.
    pub fn ticks(&self) -> u32 {
        self.ticks.load(Ordering::Acquire)
    }

    /// Returns whether a report is pending for the controller.
    #[inline]
    pub fn has_report(&self) -> bool {
        self.ended.load(Ordering::Acquire) > 0 || self.has_alarm()
    }

    #[inline]
    fn has_alarm(&self) -> bool {
        self.alarm_waits.load(Ordering::Acquire)
    }

    /// Returns whether a move can begin (engine side): a move is pending, and the mailbox has room for its report.
    #[inline]
    pub(super) fn can_begin_move(&self) -> bool {
        self.has_move() && self.ended.load(Ordering::Acquire) < MAX_REPORTS
    }

    /// Returns whether the controller requests a halt (engine side).
    #[inline]
    pub(super) fn is_halt_requested(&self) -> bool {
        self.halt.load(Ordering::Acquire)
    }

    /// Returns whether the controller requests a halt, and clears the request (engine side).
    #[inline]
    pub(super) fn take_halt_request(&self) -> bool {
        // A load comes before the swap, because a swap in each tick would cost more than the rest of an idle tick.
        self.is_halt_requested() && self.halt.swap(false, Ordering::AcqRel)
    }

    /// Returns whether a move is pending (engine side).
    #[inline]
    pub(super) fn has_move(&self) -> bool {
        self.order_waits.load(Ordering::Acquire)
    }

    /// Returns the rate at which the pending turn can follow the current turn, units of 2^-24 (engine side). The rate
    /// is 0 if the engine must stop, because no turn is pending, or because the report of the previous turn still waits
    /// for the controller.
    #[inline]
    pub(super) fn next_entry_rate(&self) -> u32 {
        if self.ended.load(Ordering::Acquire) > 0 { 0 } else { self.entry.load(Ordering::Acquire) }
    }

    /// Removes and returns the pending move (engine side). `None` if no move is pending.
    pub(super) fn take_move(&self) -> Option<PendingMove> {
        exclusive::with(|cs| {
            let task = self.task.borrow(cs).get();
            self.forget(cs);
            if let Some(PendingMove::Lay(outline)) = &task {
                self.laying.borrow(cs).set(outline.slot);
            }
            task
        })
    }

    /// Returns a sector of a turn (engine side). `None` if the turn has no sector with this index.
    pub(super) fn sector(&self, turn: &TurnHeader, index: usize) -> Option<Sector> {
        self.sectors.get(turn.slot, index)
    }

    /// Drops the pending move.
    pub(super) fn discard_move(&self) {
        exclusive::with(|cs| self.forget(cs));
    }

    fn forget(&self, cs: CriticalSection) {
        self.order_waits.store(false, Ordering::Release);
        self.entry.store(0, Ordering::Release);
        self.task.borrow(cs).set(None);
    }

    /// Stores the number of feed steps made in a sector (engine side).
    pub(super) fn store_feed_steps(&self, slot: Slot, sector: usize, steps: u32) {
        self.made.set(slot, sector, steps);
    }

    /// Stores the report of an ended move (engine side). The mailbox has room for it, because a move begins only if
    /// [`Mailbox::can_begin_move`] returns true.
    pub(super) fn post_report(&self, report: PendingReport) {
        exclusive::with(|cs| {
            let mut reports = self.reports.borrow(cs).get();
            let ended = match reports.ended {
                [None, _] => [Some(report), None],
                [oldest, _] => [oldest, Some(report)],
            };
            reports.ended = ended;
            self.reports.borrow(cs).set(reports);
            self.ended.store(ended.iter().flatten().count() as u32, Ordering::Release);
        });
    }

    /// Stores an alarm (engine side). Until the controller removes an alarm, only the first one is kept.
    pub(super) fn post_alarm(&self, alarm: EngineFault) {
        exclusive::with(|cs| {
            let mut reports = self.reports.borrow(cs).get();
            reports.alarm.get_or_insert(alarm);
            self.reports.borrow(cs).set(reports);
            self.alarm_waits.store(true, Ordering::Release);
        });
    }

    #[inline]
    pub(super) fn is_link_stop_pending(&self) -> bool {
        self.called.load(Ordering::Acquire)
    }

    /// Returns whether an emergency stop was received over the link, and clears the flag for it (engine side).
    #[inline]
    pub(super) fn take_link_stop(&self) -> bool {
        self.is_link_stop_pending() && self.called.swap(false, Ordering::AcqRel)
    }

    pub(super) fn set_progress(&self, sectors: usize) {
        self.progress.store(sectors as u32 + 1, Ordering::Release);
    }

    /// Records that no turn is being laid.
    pub(super) fn end_progress(&self) {
        self.progress.store(0, Ordering::Release);
    }

    /// Publishes the feed steps and ticks of the sector that begins (engine side). The value is [`Sector::default`]
    /// once no layer is laid.
    pub(super) fn set_sector(&self, sector: &Sector) {
        self.sector_feed.store(sector.feed_steps, Ordering::Release);
        self.sector_ticks.store(sector.ticks, Ordering::Release);
    }

    pub(super) fn set_emergency_stop(&self, pressed: bool) {
        self.emergency_stop.store(pressed, Ordering::Release);
    }

    /// Latches the emergency stop, and counts it if no emergency stop was latched before (engine side).
    pub(super) fn latch_emergency_stop(&self) {
        if !self.is_emergency_stopped() {
            self.presses.store(self.emergency_stop_presses().wrapping_add(1), Ordering::Release);
        }
        self.set_emergency_stop(true);
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
