//! Atomics and critical sections for tests in which the step interrupt occurs just before an access to them.
//!
//! Each access of the main program is a point at which the interrupt can occur, counted from 1. A critical section is
//! one point, because no interrupt occurs within it.

use core::cell::{Cell, RefCell};
use core::sync::atomic::Ordering;
use std::boxed::Box;
use std::vec::Vec;

use critical_section::CriticalSection;

#[derive(Default)]
struct Preemption {
    /// Numbers of the points at which the interrupt occurs.
    points: Vec<usize>,
    /// Number of points passed so far.
    passed: usize,
    /// Function that runs as the interrupt. `None` while no test preempts, and during the interrupt itself.
    interrupt: Option<Box<dyn FnMut()>>,
    /// True within a critical section.
    masked: bool,
}

std::thread_local! {
    /// True while a test preempts. Otherwise an access costs little more than that of a plain atomic.
    static IS_ACTIVE: Cell<bool> = const { Cell::new(false) };
    static PREEMPTION: RefCell<Preemption> = RefCell::default();
}

/// Runs `work`, and runs `interrupt` at each of the points in it. Returns the number of points that `work` has passed.
pub fn preempt(points: &[usize], interrupt: impl FnMut() + 'static, work: impl FnOnce()) -> usize {
    PREEMPTION.with_borrow_mut(|preemption| {
        *preemption =
            Preemption { points: points.to_vec(), interrupt: Some(Box::new(interrupt)), ..Preemption::default() };
    });
    IS_ACTIVE.set(true);
    work();
    IS_ACTIVE.set(false);
    PREEMPTION.take().passed
}

#[inline]
fn point() {
    if IS_ACTIVE.get() {
        pass_point();
    }
}

fn pass_point() {
    let interrupt = PREEMPTION.with_borrow_mut(|preemption| {
        if preemption.masked || preemption.interrupt.is_none() {
            return None;
        }
        preemption.passed += 1;
        if preemption.points.contains(&preemption.passed) { preemption.interrupt.take() } else { None }
    });
    if let Some(mut interrupt) = interrupt {
        interrupt();
        PREEMPTION.with_borrow_mut(|preemption| preemption.interrupt = Some(interrupt));
    }
}

/// Runs `work` in a critical section, as `critical_section::with` does, with a point before it.
pub fn with<R>(work: impl FnOnce(CriticalSection) -> R) -> R {
    if !IS_ACTIVE.get() {
        return critical_section::with(work);
    }
    point();
    let before = PREEMPTION.with_borrow_mut(|preemption| core::mem::replace(&mut preemption.masked, true));
    let result = critical_section::with(work);
    PREEMPTION.with_borrow_mut(|preemption| preemption.masked = before);
    result
}

macro_rules! atomic {
    ($name:ident, $value:ty) => {
        /// Wrapper of the atomic of the same name, with a point before each access.
        pub struct $name(core::sync::atomic::$name);

        impl $name {
            pub const fn new(value: $value) -> Self {
                Self(core::sync::atomic::$name::new(value))
            }

            pub fn load(&self, order: Ordering) -> $value {
                point();
                self.0.load(order)
            }

            pub fn store(&self, value: $value, order: Ordering) {
                point();
                self.0.store(value, order);
            }
        }
    };
}

atomic!(AtomicBool, bool);
atomic!(AtomicU32, u32);

impl AtomicBool {
    pub fn swap(&self, value: bool, order: Ordering) -> bool {
        point();
        self.0.swap(value, order)
    }
}
