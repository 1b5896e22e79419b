//! Flash that is read and programmed word by word, 32 bits each, with the traits of `embedded-storage`.

use embedded_storage::nor_flash::{
    ErrorType, MultiwriteNorFlash, NorFlash, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};

/// Flash area of a board that is read and programmed word by word: that of the journal or of the robot's description.
/// Offsets are in bytes, from the beginning of the area.
pub trait WordFlash {
    /// Length of a sector, bytes.
    const SECTOR_BYTES: usize;

    /// Returns the length of the flash area, bytes.
    fn capacity(&self) -> usize;

    /// Reads the word at an offset.
    fn read(&self, offset: usize) -> u32;

    /// Erases the sector with this index in the flash area.
    ///
    /// # Errors
    /// Returns an error if the sector cannot be erased.
    fn erase(&mut self, sector: usize) -> Result<(), NorFlashErrorKind>;

    /// Programs words. This may clear bits, and never sets any.
    ///
    /// # Errors
    /// Returns an error if a word cannot be programmed.
    fn program(&mut self, words: impl Iterator<Item = Word>) -> Result<(), NorFlashErrorKind>;
}

/// A word to be programmed: its offset in the flash area, bytes, and its value.
pub struct Word {
    pub offset: usize,
    pub value: u32,
}

/// Adapter that implements the traits of `embedded-storage` for a [`WordFlash`].
pub struct WordNorFlash<F>(pub F);

impl<F> ErrorType for WordNorFlash<F> {
    type Error = NorFlashErrorKind;
}

impl<F: WordFlash> ReadNorFlash for WordNorFlash<F> {
    const READ_SIZE: usize = 4;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        check_read(self, offset, bytes.len())?;
        for (offset, into) in (offset as usize..).step_by(4).zip(bytes.as_chunks_mut::<4>().0) {
            *into = self.0.read(offset).to_le_bytes();
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl<F: WordFlash> NorFlash for WordNorFlash<F> {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = F::SECTOR_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        check_erase(self, from, to)?;
        (from as usize / F::SECTOR_BYTES..to as usize / F::SECTOR_BYTES).try_for_each(|sector| self.0.erase(sector))
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        check_write(self, offset, bytes.len())?;
        let words = (offset as usize..).step_by(4).zip(bytes.as_chunks::<4>().0);
        self.0.program(words.map(|(offset, bytes)| Word { offset, value: u32::from_le_bytes(*bytes) }))
    }
}

impl<F: WordFlash> MultiwriteNorFlash for WordNorFlash<F> {}
