//! A value that belongs to one interrupt handler.

use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicBool, Ordering};

/// `main` fills it once. From then on a single interrupt handler uses it, without a lock.
pub struct InterruptOwned<T> {
    given: AtomicBool,
    value: UnsafeCell<Option<T>>,
}

// SAFETY: only `give` and `with` reach the value. `give` does so before `given` is true. `with` does so after, and its
// caller promises that one handler calls it. So there is never more than one access at a time.
unsafe impl<T: Send> Sync for InterruptOwned<T> {}

impl<T> InterruptOwned<T> {
    /// Nothing yet.
    pub const fn empty() -> Self {
        InterruptOwned { given: AtomicBool::new(false), value: UnsafeCell::new(None) }
    }

    /// Hands the value over to the handler. Called by `main`; a second value is dropped.
    pub fn give(&self, value: T) {
        if self.given.load(Ordering::Acquire) {
            return;
        }
        // SAFETY: `main` is the only caller and the handler doesn't look before `given` is true.
        unsafe { *self.value.get() = Some(value) };
        self.given.store(true, Ordering::Release);
    }

    /// Uses the value, once it is there.
    ///
    /// # Safety
    ///
    /// Called by one interrupt handler only, and not again from within `use_it`.
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
