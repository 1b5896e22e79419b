//! A value that one interrupt handler owns.

use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicBool, Ordering};

/// Cell that `main` fills once. From then on a single interrupt handler uses the value, without a lock.
pub struct InterruptCell<T> {
    given: AtomicBool,
    value: UnsafeCell<Option<T>>,
}

// SAFETY: only `init` and `with` access the value. `init` does so before `given` is true. `with` does so after that,
// and its caller guarantees that only one handler calls it. There is therefore never more than one access at a time.
unsafe impl<T: Send> Sync for InterruptCell<T> {}

impl<T> InterruptCell<T> {
    /// Creates an empty cell.
    pub const fn empty() -> Self {
        InterruptCell { given: AtomicBool::new(false), value: UnsafeCell::new(None) }
    }

    /// Stores the value for the interrupt handler. Only `main` may call this. A second value is dropped.
    pub fn init(&self, value: T) {
        if self.given.load(Ordering::Acquire) {
            return;
        }
        // SAFETY: `main` is the only caller, and the handler does not access the value before `given` is true.
        unsafe { *self.value.get() = Some(value) };
        self.given.store(true, Ordering::Release);
    }

    /// Calls `use_it` with the value. Does nothing before [`InterruptCell::init`] has stored a value.
    ///
    /// # Safety
    ///
    /// Only one interrupt handler may call this, and not again from within `use_it`.
    pub unsafe fn with(&self, use_it: impl FnOnce(&mut T)) {
        if !self.given.load(Ordering::Acquire) {
            return;
        }
        // SAFETY: the caller is the only one (see above), and a handler does not interrupt itself.
        if let Some(value) = unsafe { (*self.value.get()).as_mut() } {
            use_it(value);
        }
    }
}
