//! The vector table, which the processor reads at each interrupt. It is in RAM, because the flash cannot be read while
//! it is written to.

use core::cell::UnsafeCell;

use rp2040_pac as pac;

/// Number of vectors: the exceptions of the processor and the interrupts of its peripherals.
const VECTORS: usize = 16 + 32;

/// Vector table, aligned as the processor requires.
#[repr(C, align(256))]
struct Table(UnsafeCell<[u32; VECTORS]>);

// SAFETY: written once, before the interrupts are enabled. After that only the processor reads it.
unsafe impl Sync for Table {}

static TABLE: Table = Table(UnsafeCell::new([0; VECTORS]));

/// Copies the vector table of the image to RAM and makes the processor use the copy. Call it once, before the
/// interrupts are enabled.
pub fn relocate_to_ram() {
    // SAFETY: the processor's own peripheral, which points to the table of the image.
    unsafe {
        let block = &*pac::PPB::ptr();
        let from = block.vtor().read().bits() as *const u32;
        let to = TABLE.0.get().cast::<u32>();
        for index in 0..VECTORS {
            to.wrapping_add(index).write_volatile(from.wrapping_add(index).read_volatile());
        }
        cortex_m::asm::dsb();
        block.vtor().write(|w| w.bits(to as u32));
        cortex_m::asm::dsb();
    }
}
