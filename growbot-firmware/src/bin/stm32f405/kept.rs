//! Memory that survives a reset: 128 bytes that nothing loads or clears.

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::{AtomicBool, Ordering};

use growbot_firmware::hal::KeptMemory;
use growbot_firmware::safety::kept::KEPT_BYTES;

#[unsafe(link_section = ".uninit.kept")]
static BYTES: Bytes = Bytes(UnsafeCell::new(MaybeUninit::uninit()));

struct Bytes(UnsafeCell<MaybeUninit<[u8; KEPT_BYTES]>>);

// SAFETY: only reached through the one `BoardMemory` there is.
unsafe impl Sync for Bytes {}

/// The memory.
pub struct BoardMemory(());

impl BoardMemory {
    /// The memory; none where somebody has it already.
    pub fn take() -> Option<Self> {
        static TAKEN: AtomicBool = AtomicBool::new(false);
        (!TAKEN.swap(true, Ordering::Relaxed)).then_some(Self(()))
    }

    fn first(&self) -> *mut u8 {
        BYTES.0.get().cast()
    }
}

impl KeptMemory for BoardMemory {
    fn read(&mut self) -> [u8; KEPT_BYTES] {
        // SAFETY: within the array; RAM may be read before it was written, whatever it holds.
        core::array::from_fn(|index| unsafe { self.first().wrapping_add(index).read_volatile() })
    }

    /// Not interrupted, so that no interrupt that resets the board finds half of it.
    fn write(&mut self, bytes: &[u8; KEPT_BYTES]) {
        cortex_m::interrupt::free(|_| {
            for (index, byte) in bytes.iter().enumerate() {
                // SAFETY: within the array, which has as many bytes, and which only this value reaches.
                unsafe { self.first().wrapping_add(index).write_volatile(*byte) }
            }
        });
    }
}
