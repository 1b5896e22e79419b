//! Where the controller and the step interrupt meet: one order waiting, one report waiting, a halt, and what the interrupt sees.

use core::cell::Cell;
use core::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use critical_section::{CriticalSection, Mutex};
use growbot_core::layer::SECTORS;

use super::turn::Turn;

/// What the engine is to do next.
#[expect(clippy::large_enum_variant, reason = "one of each exists, and there is no heap to box a turn on")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Find the index mark and stop at the tip's x axis.
    Home(Homing),
    /// Lay a layer. Given while the one before is laid, it follows without a stop.
    Lay(Turn),
    /// Move filament while the head stands.
    Feed(FeedMove),
}

/// How to find the index mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Homing {
    /// Ticks between two steps of the head, 2 at least.
    pub ticks_per_step: u32,
    /// Give up after so many steps without the leading edge of the mark.
    pub most_steps: u32,
    /// Steps from the leading edge to the tip's x axis.
    pub steps_to_zero: u32,
}

/// How to move filament: back where feeding ends for a while, and forward again before it goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FeedMove {
    /// Steps of the feed.
    pub steps: u32,
    /// Whether filament is pulled back.
    pub backwards: bool,
    /// Ticks between two steps, 2 at least.
    pub ticks_per_step: u32,
}

/// What the engine has done.
#[expect(clippy::large_enum_variant, reason = "one of each exists, and there is no heap to box a turn on")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Report {
    /// The head stands at the tip's x axis.
    Homed,
    /// A layer is laid.
    Laid(TurnReport),
    /// Filament is moved.
    Fed,
    /// Homing did not find the index mark; everything is off, as with all that follow.
    IndexNotFound,
    /// A turn has passed without the index mark.
    IndexMissing,
    /// The index sensor sees its mark for longer than the mark is wide.
    IndexStuck,
    /// The index mark came in another place.
    HeadStepsLost,
    /// Filament is fed and does not move.
    FilamentJam,
    /// A pin could not be read or written.
    Hardware,
}

/// The steps of a layer that were made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TurnReport {
    /// Steps of the head.
    pub head: u32,
    /// Steps of the feed in each sector, by angle, whichever way the head has turned.
    pub feed: [u32; SECTORS],
}

/// Shared by the controller and the step interrupt. Every access is short and none waits.
///
/// The flags spare the interrupt a critical section in each tick. A flag and what it stands for change in one critical section,
/// so that no tick falls between the two.
pub struct Handover {
    order: Mutex<Cell<Option<Order>>>,
    report: Mutex<Cell<Option<Report>>>,
    order_waits: AtomicBool,
    report_waits: AtomicBool,
    halt: AtomicBool,
    /// The rate at which the turn that waits can be entered; 0 where none waits.
    entry: AtomicU32,
    emergency_stop: AtomicBool,
    on_index: AtomicBool,
    filament_pulses: AtomicU32,
    ticks: AtomicU32,
}

impl Default for Handover {
    fn default() -> Self {
        Self::new()
    }
}

impl Handover {
    /// Nothing waits.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            order: Mutex::new(Cell::new(None)),
            report: Mutex::new(Cell::new(None)),
            order_waits: AtomicBool::new(false),
            report_waits: AtomicBool::new(false),
            halt: AtomicBool::new(false),
            entry: AtomicU32::new(0),
            emergency_stop: AtomicBool::new(false),
            on_index: AtomicBool::new(false),
            filament_pulses: AtomicU32::new(0),
            ticks: AtomicU32::new(0),
        }
    }

    /// Controller: whether an order can be given.
    #[must_use]
    pub fn takes_orders(&self) -> bool {
        !self.order_waits.load(Ordering::Acquire) && !self.halt.load(Ordering::Acquire) && !self.emergency_stop()
    }

    /// Controller: gives an order. One that still waits is replaced: only [`Handover::halt`] before makes that safe, since the
    /// engine may be braking for it.
    pub fn give(&self, order: Order) {
        let entry = if let Order::Lay(turn) = &order { turn.pace.entry } else { 0 };
        critical_section::with(|cs| {
            self.order.borrow(cs).set(Some(order));
            self.entry.store(entry, Ordering::Release);
            self.order_waits.store(true, Ordering::Release);
        });
    }

    /// Controller: takes the report.
    pub fn take_report(&self) -> Option<Report> {
        if !self.report_waits.load(Ordering::Acquire) {
            return None;
        }
        critical_section::with(|cs| {
            self.report_waits.store(false, Ordering::Release);
            self.report.borrow(cs).take()
        })
    }

    /// Controller: stops the steppers and lets go of them at the next tick. Orders and reports that wait are forgotten, and so
    /// is an emergency stop that is no longer pressed.
    pub fn halt(&self) {
        critical_section::with(|cs| {
            self.halt.store(true, Ordering::Release);
            self.report.borrow(cs).set(None);
            self.report_waits.store(false, Ordering::Release);
            self.forget(cs);
        });
    }

    /// Whether the emergency stop is pressed, or was pressed since the last [`Handover::halt`]. The engine has let go by itself and
    /// takes no orders.
    #[must_use]
    pub fn emergency_stop(&self) -> bool {
        self.emergency_stop.load(Ordering::Acquire)
    }

    /// Whether the index sensor sees its mark: looked at in each step of the head, and in each tick without an order.
    #[must_use]
    pub fn on_index(&self) -> bool {
        self.on_index.load(Ordering::Acquire)
    }

    /// Rising edges of the filament's encoder, wrapping.
    #[must_use]
    pub fn filament_pulses(&self) -> u32 {
        self.filament_pulses.load(Ordering::Acquire)
    }

    /// Ticks of the step interrupt, wrapping: the proof that it lives.
    #[must_use]
    pub fn ticks(&self) -> u32 {
        self.ticks.load(Ordering::Acquire)
    }

    /// Whether a report waits for the controller.
    #[must_use]
    pub fn report_waits(&self) -> bool {
        self.report_waits.load(Ordering::Acquire)
    }

    /// Engine: whether the controller wants a halt.
    pub(super) fn halt_waits(&self) -> bool {
        self.halt.load(Ordering::Acquire)
    }

    /// Engine: whether to halt now. Asking clears it.
    pub(super) fn take_halt(&self) -> bool {
        // A load first: a swap in each tick would cost more than the rest of an idle tick.
        self.halt_waits() && self.halt.swap(false, Ordering::AcqRel)
    }

    /// Engine: whether an order waits.
    pub(super) fn order_waits(&self) -> bool {
        self.order_waits.load(Ordering::Acquire)
    }

    /// Engine: the rate at which the next turn can follow this one, 0 if it must stop: where no turn waits, or the report of
    /// this one would find no room.
    pub(super) fn passing(&self) -> u32 {
        if self.report_waits() { 0 } else { self.entry.load(Ordering::Acquire) }
    }

    /// Engine: takes the order.
    pub(super) fn take_order(&self) -> Option<Order> {
        critical_section::with(|cs| {
            self.order_waits.store(false, Ordering::Release);
            self.entry.store(0, Ordering::Release);
            self.order.borrow(cs).take()
        })
    }

    /// Engine: refuses the order that waits.
    pub(super) fn refuse_order(&self) {
        critical_section::with(|cs| self.forget(cs));
    }

    fn forget(&self, cs: CriticalSection) {
        self.order_waits.store(false, Ordering::Release);
        self.entry.store(0, Ordering::Release);
        self.order.borrow(cs).set(None);
    }

    /// Engine: leaves a report.
    pub(super) fn report(&self, report: Report) {
        critical_section::with(|cs| {
            self.report.borrow(cs).set(Some(report));
            self.report_waits.store(true, Ordering::Release);
        });
    }

    pub(super) fn set_emergency_stop(&self, pressed: bool) {
        self.emergency_stop.store(pressed, Ordering::Release);
    }

    pub(super) fn set_on_index(&self, on: bool) {
        self.on_index.store(on, Ordering::Release);
    }

    pub(super) fn set_filament_pulses(&self, pulses: u32) {
        self.filament_pulses.store(pulses, Ordering::Release);
    }

    pub(super) fn set_ticks(&self, ticks: u32) {
        self.ticks.store(ticks, Ordering::Release);
    }
}
