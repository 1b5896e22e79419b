//! Flash that is changed only while the supply of the processor is high enough.
//!
//! A word that is programmed at too low a voltage may read differently later, and flash may read wrongly at such a
//! voltage. The journal must not make decisions from such a reading permanent (see [`crate::journal`]). A write or an
//! erasure is therefore refused before it begins, and flash is unchanged.

use embedded_storage::nor_flash::{ErrorType, MultiwriteNorFlash, NorFlash, NorFlashErrorKind, ReadNorFlash};

/// Detector of the processor's supply voltage.
pub trait SupplyMonitor {
    /// Returns whether the voltage is high enough to program flash at this moment.
    fn is_enough(&self) -> bool;
}

/// Flash that refuses writes and erasures while the processor's supply voltage is too low.
pub struct GuardedFlash<F, D> {
    flash: F,
    detector: D,
}

impl<F: NorFlash<Error = NorFlashErrorKind>, D: SupplyMonitor> GuardedFlash<F, D> {
    /// Creates a flash that is changed only while the detector reports enough voltage.
    pub fn new(flash: F, detector: D) -> Self {
        Self { flash, detector }
    }

    fn supplied(&mut self) -> Result<&mut F, NorFlashErrorKind> {
        if self.detector.is_enough() { Ok(&mut self.flash) } else { Err(NorFlashErrorKind::Other) }
    }
}

impl<F: ErrorType, D> ErrorType for GuardedFlash<F, D> {
    type Error = F::Error;
}

impl<F: ReadNorFlash, D> ReadNorFlash for GuardedFlash<F, D> {
    const READ_SIZE: usize = F::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), F::Error> {
        self.flash.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.flash.capacity()
    }
}

impl<F: NorFlash<Error = NorFlashErrorKind>, D: SupplyMonitor> NorFlash for GuardedFlash<F, D> {
    const WRITE_SIZE: usize = F::WRITE_SIZE;
    const ERASE_SIZE: usize = F::ERASE_SIZE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.supplied()?.erase(from, to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.supplied()?.write(offset, bytes)
    }
}

impl<F: MultiwriteNorFlash<Error = NorFlashErrorKind>, D: SupplyMonitor> MultiwriteNorFlash for GuardedFlash<F, D> {}

#[cfg(test)]
mod tests;
