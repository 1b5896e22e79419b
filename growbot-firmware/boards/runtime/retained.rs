//! Retained memory of a board: RAM that survives a reset, because no code loads or clears it.

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::sync::atomic::Ordering;

use growbot_firmware::hal::RetainedMemory;
use growbot_firmware::safety::retained::{COPY_BYTES, RETAINED_BYTES};
use portable_atomic::AtomicBool;

#[unsafe(link_section = ".uninit.retained")]
static WORDS: RetainedWordsCell = RetainedWordsCell(UnsafeCell::new(MaybeUninit::uninit()));

struct RetainedWordsCell(UnsafeCell<MaybeUninit<[u32; RETAINED_BYTES / 4]>>);

// SAFETY: accessed only through the single `RetainedRam`.
unsafe impl Sync for RetainedWordsCell {}

/// The retained memory of a board. There is only one value of this type.
pub struct RetainedRam(());

impl RetainedRam {
    /// Returns the retained memory. `None` if it was already taken.
    pub fn take() -> Option<Self> {
        static TAKEN: AtomicBool = AtomicBool::new(false);
        (!TAKEN.swap(true, Ordering::Relaxed)).then_some(Self(()))
    }

    /// Returns the address of a word of the retained memory. An index beyond the memory is mapped to one inside.
    fn word(&self, index: usize) -> *mut u32 {
        WORDS.0.get().cast::<u32>().wrapping_add(index % (RETAINED_BYTES / 4))
    }
}

impl RetainedMemory for RetainedRam {
    fn read(&mut self) -> [u8; RETAINED_BYTES] {
        let mut bytes = [0; RETAINED_BYTES];
        for (index, into) in bytes.as_chunks_mut::<4>().0.iter_mut().enumerate() {
            // SAFETY: an aligned word of the array. RAM may be read before it was written.
            *into = unsafe { self.word(index).read_volatile() }.to_le_bytes();
        }
        bytes
    }

    /// Writes a copy with all interrupts disabled, so that an interrupt that resets the board never leaves it
    /// half-written. Any other reset leaves at least the other copy whole.
    fn write(&mut self, copy: usize, bytes: &[u8; COPY_BYTES]) {
        cortex_m::interrupt::free(|_| {
            for (index, from) in bytes.as_chunks::<4>().0.iter().enumerate() {
                // SAFETY: an aligned word of the array, which only this value accesses.
                unsafe { self.word(copy * (COPY_BYTES / 4) + index).write_volatile(u32::from_le_bytes(*from)) }
            }
        });
        // The last word is in the memory before the next action: a write of the other copy, or power for the heater.
        cortex_m::asm::dsb();
    }
}
