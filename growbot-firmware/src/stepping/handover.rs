//! Where the controller and the step interrupt meet: one order waiting, one report waiting, and a halt.

use core::cell::Cell;
use core::sync::atomic::{AtomicBool, Ordering};

use critical_section::Mutex;
use growbot_core::layer::SECTORS;

use super::turn::Turn;

/// What the engine is to do next.
#[expect(clippy::large_enum_variant, reason = "one of each exists, and there is no heap to box a turn on")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Order {
    /// Find the index mark and stop at the tip's x axis.
    Home(Homing),
    /// Lay a layer.
    Lay(Turn),
    /// x
    Feed(FeedMove),
}

/// x
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FeedMove {
    /// x
    pub steps: u32,
    /// x
    pub backwards: bool,
    /// x
    pub ticks_per_step: u32,
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

/// What the engine has done.
#[expect(clippy::large_enum_variant, reason = "one of each exists, and there is no heap to box a turn on")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Report {
    /// The head stands at the tip's x axis.
    Homed,
    /// The index mark was not found.
    IndexNotFound,
    /// x
    IndexMissing,
    /// x
    IndexStuck,
    /// x
    HeadStepsLost,
    /// x
    FilamentJam,
    /// x
    Fed,
    /// A layer is laid.
    Laid(TurnReport),
    /// A pin could not be read or written; everything is off.
    Hardware,
}

/// The steps of a layer that were made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TurnReport {
    /// Steps of the head.
    pub head: u32,
    /// Steps of the feed in each sector.
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
    pub(super) ticks: core::sync::atomic::AtomicU32,
}

impl Default for Handover {
    fn default() -> Self {
        Self::new()
    }
}

impl Handover {
    /// x
    pub fn emergency_stop(&self) -> bool {
        false
    }
    /// x
    pub fn on_index(&self) -> bool {
        false
    }
    /// x
    pub fn filament_pulses(&self) -> u32 {
        0
    }
    /// x
    pub fn ticks(&self) -> u32 {
        self.ticks.load(Ordering::Relaxed)
    }

    /// Nothing waits.
    #[must_use]
    pub const fn new() -> Self {
        Self {
            order: Mutex::new(Cell::new(None)),
            report: Mutex::new(Cell::new(None)),
            order_waits: AtomicBool::new(false),
            report_waits: AtomicBool::new(false),
            halt: AtomicBool::new(false),
            ticks: core::sync::atomic::AtomicU32::new(0),
        }
    }

    /// Controller: whether an order can be given.
    #[must_use]
    pub fn takes_orders(&self) -> bool {
        !self.order_waits.load(Ordering::Acquire) && !self.halt.load(Ordering::Acquire)
    }

    /// Controller: gives an order; one that still waits is replaced.
    pub fn give(&self, order: Order) {
        critical_section::with(|cs| {
            self.order.borrow(cs).set(Some(order));
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

    /// Controller: stops the steppers and lets go of them at the next tick. Orders and reports that wait are forgotten.
    pub fn halt(&self) {
        critical_section::with(|cs| {
            self.halt.store(true, Ordering::Release);
            self.order.borrow(cs).take();
            self.report.borrow(cs).take();
            self.order_waits.store(false, Ordering::Release);
            self.report_waits.store(false, Ordering::Release);
        });
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

    /// Engine: whether an order waits and its report would find room.
    #[must_use]
    pub fn order_is_ready(&self) -> bool {
        self.order_waits.load(Ordering::Acquire) && !self.report_waits.load(Ordering::Acquire)
    }

    /// Whether a report waits for the controller.
    #[must_use]
    pub fn report_waits(&self) -> bool {
        self.report_waits.load(Ordering::Acquire)
    }

    /// Engine: takes the order.
    pub(super) fn take_order(&self) -> Option<Order> {
        critical_section::with(|cs| {
            self.order_waits.store(false, Ordering::Release);
            self.order.borrow(cs).take()
        })
    }

    /// Engine: leaves a report.
    pub(super) fn report(&self, report: Report) {
        critical_section::with(|cs| {
            self.report.borrow(cs).set(Some(report));
            self.report_waits.store(true, Ordering::Release);
        });
    }
}
