//! Flash that is changed only while the processor's supply is enough for it.
//!
//! A word that is programmed at too low a voltage may read differently later, and what reads wrongly at such a voltage
//! is not to be settled for good (see [`crate::journal`]): a write or an erasure is refused before it begins, and flash
//! is as it was.

use embedded_storage::nor_flash::{ErrorType, MultiwriteNorFlash, NorFlash, NorFlashErrorKind, ReadNorFlash};

/// A detector of the processor's supply.
pub trait SupplyDetector {
    /// Whether it is enough to program flash at this moment.
    fn is_enough(&self) -> bool;
}

/// Flash with a detector of the supply.
pub struct Supplied<F, D> {
    flash: F,
    detector: D,
}

impl<F: NorFlash<Error = NorFlashErrorKind>, D: SupplyDetector> Supplied<F, D> {
    /// Flash that is changed only while the detector says that there is supply.
    pub fn new(flash: F, detector: D) -> Self {
        Self { flash, detector }
    }

    fn supplied(&mut self) -> Result<&mut F, NorFlashErrorKind> {
        if self.detector.is_enough() { Ok(&mut self.flash) } else { Err(NorFlashErrorKind::Other) }
    }
}

impl<F: ErrorType, D> ErrorType for Supplied<F, D> {
    type Error = F::Error;
}

impl<F: ReadNorFlash, D> ReadNorFlash for Supplied<F, D> {
    const READ_SIZE: usize = F::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), F::Error> {
        self.flash.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.flash.capacity()
    }
}

impl<F: NorFlash<Error = NorFlashErrorKind>, D: SupplyDetector> NorFlash for Supplied<F, D> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.supplied()?.erase(from, to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.supplied()?.write(offset, bytes)
    }
}

impl<F: MultiwriteNorFlash<Error = NorFlashErrorKind>, D: SupplyDetector> MultiwriteNorFlash for Supplied<F, D> {}

#[cfg(test)]
mod tests;
