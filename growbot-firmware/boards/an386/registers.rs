//! A 32-bit word of a peripheral or of the emulated tip.

/// A 32-bit word that is always read and written as a whole, in the order of the program.
#[derive(Clone, Copy)]
pub struct Register(*mut u32);

impl Register {
    /// Returns the register at an address.
    ///
    /// # Safety
    ///
    /// The address must be a multiple of 4. Reading or writing it at any time must not affect memory that Rust code
    /// owns.
    pub const unsafe fn at(address: usize) -> Self {
        Register(address as *mut u32)
    }

    /// Reads the word.
    pub fn read(self) -> u32 {
        // SAFETY: the caller of `at` guarantees that the address may be read at any time.
        unsafe { self.0.read_volatile() }
    }

    /// Writes the word.
    pub fn write(self, value: u32) {
        // SAFETY: the caller of `at` guarantees that the address may be written at any time.
        unsafe { self.0.write_volatile(value) }
    }
}
