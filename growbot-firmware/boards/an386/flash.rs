//! Flash of the emulated board: words of the memory that it shares with the desktop, which survive its resets.

use embedded_storage::nor_flash::{
    ErrorType, MultiwriteNorFlash, NorFlash, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};
use growbot_firmware::emulated_tip as table;

use crate::tip::word;

/// The journal's flash: reads and writes by words.
pub struct BoardFlash(());

impl BoardFlash {
    /// The flash. Call it once.
    pub fn new() -> Self {
        Self(())
    }
}

impl ErrorType for BoardFlash {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for BoardFlash {
    const READ_SIZE: usize = 4;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        check_read(self, offset, bytes.len())?;
        let from = table::JOURNAL + offset as usize;
        for (address, into) in (from..).step_by(4).zip(bytes.as_chunks_mut::<4>().0) {
            *into = word(address).read().to_le_bytes();
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        table::JOURNAL_CAPACITY
    }
}

impl NorFlash for BoardFlash {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = table::JOURNAL_SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        check_erase(self, from, to)?;
        for offset in (from..to).step_by(4) {
            word(table::JOURNAL + offset as usize).write(u32::MAX);
        }
        Ok(())
    }

    /// Programming clears bits and never sets any.
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        check_write(self, offset, bytes.len())?;
        let from = table::JOURNAL + offset as usize;
        for (address, bytes) in (from..).step_by(4).zip(bytes.as_chunks::<4>().0) {
            let word = word(address);
            word.write(word.read() & u32::from_le_bytes(*bytes));
        }
        Ok(())
    }
}

impl MultiwriteNorFlash for BoardFlash {}
