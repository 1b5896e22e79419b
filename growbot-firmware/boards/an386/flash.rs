//! Flash of the emulated board: words of the memory that the board shares with the desktop. They survive resets of the
//! board.

use embedded_storage::nor_flash::NorFlashErrorKind;
use growbot_firmware::emulated_tip as table;

use crate::runtime::word_flash::{Word, WordFlash, WordNorFlash};
use crate::tip::word;

/// One of the two emulated flash areas: that of the robot's description, or that of the journal.
pub type SharedMemoryPartition = WordNorFlash<SharedWords>;

/// Words of the shared memory that emulate a flash area.
pub struct SharedWords {
    start: usize,
}

impl SharedWords {
    /// Returns the flash area of the robot's description, and that of the journal. Call it once.
    pub fn parts() -> [SharedMemoryPartition; 2] {
        [table::DESCRIPTION_FLASH, table::JOURNAL_FLASH].map(|start| WordNorFlash(Self { start }))
    }
}

impl WordFlash for SharedWords {
    const SECTOR_BYTES: usize = table::FLASH_SECTOR_BYTES;

    fn capacity(&self) -> usize {
        table::FLASH_AREA_BYTES
    }

    fn read(&self, offset: usize) -> u32 {
        word(self.start + offset).read()
    }

    fn erase(&mut self, sector: usize) -> Result<(), NorFlashErrorKind> {
        for offset in (0..Self::SECTOR_BYTES).step_by(4) {
            word(self.start + sector * Self::SECTOR_BYTES + offset).write(u32::MAX);
        }
        Ok(())
    }

    fn program(&mut self, words: impl Iterator<Item = Word>) -> Result<(), NorFlashErrorKind> {
        for Word { offset, value } in words {
            let cells = word(self.start + offset);
            cells.write(cells.read() & value);
        }
        Ok(())
    }
}
