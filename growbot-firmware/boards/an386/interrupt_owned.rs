//! A value that belongs to one interrupt handler.

use core::cell::UnsafeCell;
use core::sync::atomic::{AtomicBool, Ordering};

/// Is filled once by `main`, and from then on used by a single interrupt handler without any lock.
pub struct InterruptOwned<T> {
    given: AtomicBool,
    value: UnsafeCell<Option<T>>,
}

// SAFETY: the value is reached in two ways only: `give`, which does so before `given` is true, and `with`, which does
// so after, from the one handler that its caller has promised. So there is never more than one at a time.
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
