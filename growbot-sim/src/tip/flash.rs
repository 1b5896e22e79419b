//! Flash of a simulated board: two erase sectors as on the robot's board, whose content survives resets and losses of
//! power.
//!
//! A loss of power during a write leaves the current byte with some of its bits programmed. During an erasure it leaves
//! a mixture of the old content, noise, and erased bytes. Bits that were being programmed when power was lost may be
//! weak. A test sets the values of weak bits with which they are read, until they are programmed again
//! ([`Flash::weaken`]).
//!
//! (The firmware's own tests include this file too.)

use std::cell::RefCell;
use std::rc::Rc;
use std::vec::Vec;

use embedded_storage::nor_flash::{
    ErrorType, MultiwriteNorFlash, NorFlash, NorFlashErrorKind, ReadNorFlash, check_erase, check_read, check_write,
};

/// Size of an erase sector of the flash of the robot's board, bytes.
pub const SECTOR_BYTES: usize = 128 * 1024;

/// The flash of a simulated board. All clones share the same content. Writes have a granularity of one word.
#[derive(Debug, Clone)]
pub struct Flash<const SECTOR: usize = SECTOR_BYTES>(Rc<RefCell<Cells>>);

#[derive(Debug)]
struct Cells {
    bytes: Vec<u8>,
    erasures: Vec<u32>,
    /// Number of writes and erasures.
    writes: u64,
    /// Number of bytes that can still be written or erased before power is lost. `None` without a limit.
    bytes_left: Option<usize>,
    /// Seed of the noise that losses of power leave.
    seed: u64,
    /// Mask of the weak bits: the offset of its first byte in the flash, and its bytes.
    weak: (usize, Vec<u8>),
    /// Overridden results of the next reads that begin at an offset: this offset, and the bytes of each read in order.
    flicker: (usize, Vec<Vec<u8>>),
}

impl<const SECTOR: usize> Flash<SECTOR> {
    /// Creates a flash of this number of sectors, erased as it comes from the factory.
    pub fn new(sectors: usize) -> Self {
        let bytes = std::vec![0xff; sectors * SECTOR];
        Self(Rc::new(RefCell::new(Cells {
            bytes,
            erasures: std::vec![0; sectors],
            writes: 0,
            bytes_left: None,
            seed: 0,
            weak: (0, Vec::new()),
            flicker: (0, Vec::new()),
        })))
    }

    /// Loses power after `bytes` more bytes are written or erased. The seed determines the content that the interrupted
    /// write or erasure leaves.
    pub fn lose_power_after(&self, bytes: usize, seed: u64) {
        let mut cells = self.0.borrow_mut();
        (cells.bytes_left, cells.seed) = (Some(bytes), seed);
    }

    /// Reports whether power is lost. Without power, all operations of the flash return errors.
    pub fn has_lost_power(&self) -> bool {
        self.0.borrow().bytes_left == Some(0)
    }

    /// Restores power.
    pub fn power_up(&self) {
        self.0.borrow_mut().bytes_left = None;
    }

    /// Returns the number of erasures of each sector.
    pub fn erasures(&self) -> Vec<u32> {
        self.0.borrow().erasures.clone()
    }

    /// Returns the number of writes and erasures.
    pub fn writes(&self) -> u64 {
        self.0.borrow().writes
    }

    /// Returns the content of the whole flash.
    pub fn bytes(&self) -> Vec<u8> {
        self.0.borrow().bytes.clone()
    }

    /// Replaces the content of the whole flash.
    pub fn set_bytes(&self, bytes: &[u8]) {
        self.0.borrow_mut().bytes.copy_from_slice(bytes);
    }

    /// Makes the bits that are set in `mask` weak. The first byte of the mask applies to the byte of the flash at
    /// `offset`. All other bits are no longer weak.
    pub fn weaken(&self, offset: usize, mask: &[u8]) {
        self.0.borrow_mut().weak = (offset, mask.to_vec());
    }

    /// Makes the next reads that begin at this offset return these readings, one after the other.
    pub fn flicker(&self, offset: usize, readings: &[&[u8]]) {
        self.0.borrow_mut().flicker = (offset, readings.iter().map(|reading| reading.to_vec()).collect());
    }

    /// Sets the bits that are still weak to the corresponding bits of `reading`, which begins at the offset of the
    /// mask.
    pub fn read_weak_as(&self, reading: &[u8]) {
        let cells = &mut *self.0.borrow_mut();
        let (offset, mask) = &cells.weak;
        for ((byte, mask), reading) in cells.bytes[*offset..].iter_mut().zip(mask).zip(reading) {
            *byte = *byte & !mask | reading & mask;
        }
    }

    fn check_power(&self) -> Result<(), NorFlashErrorKind> {
        if self.has_lost_power() { Err(NorFlashErrorKind::Other) } else { Ok(()) }
    }
}

impl Cells {
    /// Subtracts `bytes` from the number of bytes that are processed before the loss of power. Returns the number of
    /// bytes that are processed, which is smaller if power is lost.
    fn spend(&mut self, bytes: usize) -> usize {
        let Some(left) = &mut self.bytes_left else { return bytes };
        let done = bytes.min(*left);
        *left -= done;
        done
    }

    /// Returns a pseudorandom number.
    fn noise(&mut self) -> u64 {
        // This is the generator SplitMix64.
        self.seed = self.seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.seed ^ self.seed >> 30).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ mixed >> 31
    }
}

impl<const SECTOR: usize> ErrorType for Flash<SECTOR> {
    type Error = NorFlashErrorKind;
}

impl<const SECTOR: usize> ReadNorFlash for Flash<SECTOR> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        self.check_power()?;
        check_read(self, offset, bytes.len())?;
        let from = offset as usize;
        let cells = &mut *self.0.borrow_mut();
        bytes.copy_from_slice(&cells.bytes[from..from + bytes.len()]);
        let (at, readings) = &mut cells.flicker;
        if *at == from && !readings.is_empty() {
            for (byte, reading) in bytes.iter_mut().zip(readings.remove(0)) {
                *byte = reading;
            }
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.borrow().bytes.len()
    }
}

impl<const SECTOR: usize> NorFlash for Flash<SECTOR> {
    const WRITE_SIZE: usize = 4;
    const ERASE_SIZE: usize = SECTOR;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.check_power()?;
        check_erase(self, from, to)?;
        let cells = &mut *self.0.borrow_mut();
        cells.writes += 1;
        for sector in from as usize / SECTOR..to as usize / SECTOR {
            cells.erasures[sector] += 1;
            let done = cells.spend(SECTOR);
            for at in sector * SECTOR..(sector + 1) * SECTOR {
                let noise = if done < SECTOR { cells.noise() } else { 0 };
                match noise % 3 {
                    0 => cells.bytes[at] = 0xff,
                    1 => cells.bytes[at] = (noise >> 8) as u8,
                    _ => {}
                }
            }
            if done < SECTOR {
                return Err(NorFlashErrorKind::Other);
            }
        }
        Ok(())
    }

    /// Writes bytes. A byte that is not erased can only be set to zero, or to the same value again.
    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.check_power()?;
        check_write(self, offset, bytes.len())?;
        let from = offset as usize;
        let cells = &mut *self.0.borrow_mut();
        let mut cells_and_bytes = cells.bytes[from..from + bytes.len()].iter().zip(bytes);
        if !cells_and_bytes.all(|(cell, byte)| *cell == 0xff || *byte == 0 || byte == cell) {
            return Err(NorFlashErrorKind::Other);
        }
        cells.writes += 1;
        let done = cells.spend(bytes.len());
        let (offset, mask) = &mut cells.weak;
        for (at, byte) in (from..).zip(&bytes[..done]) {
            cells.bytes[at] &= byte;
            if let Some(mask) = at.checked_sub(*offset).and_then(|at| mask.get_mut(at)) {
                *mask &= byte;
            }
        }
        if let Some(byte) = bytes.get(done) {
            let noise = cells.noise() as u8;
            cells.bytes[from + done] &= byte | noise;
            return Err(NorFlashErrorKind::Other);
        }
        Ok(())
    }
}

impl<const SECTOR: usize> MultiwriteNorFlash for Flash<SECTOR> {}

#[cfg(test)]
mod tests {
    use super::*;

    type Small = Flash<64>;

    #[test]
    fn written_data_is_read_until_erased() {
        let mut flash = Small::new(2);
        flash.write(64, b"flash!!!").unwrap();
        flash.clone().write(64, &[0; 4]).unwrap();
        assert_eq!(flash.write(68, b"anew"), Err(NorFlashErrorKind::Other));
        let mut bytes = [0; 9];
        flash.read(64, &mut bytes).unwrap();
        assert_eq!(&bytes, b"\0\0\0\0h!!!\xff");
        flash.erase(64, 128).unwrap();
        assert_eq!(flash.bytes(), [0xff; 128]);
        assert_eq!((flash.erasures(), flash.writes()), (std::vec![0, 1], 3));
    }

    #[test]
    fn data_is_kept_without_power() {
        let mut flash = Small::new(2);
        flash.lose_power_after(6, 1);
        assert_eq!(flash.write(0, &[0; 8]), Err(NorFlashErrorKind::Other));
        assert!(flash.has_lost_power() && flash.read(0, &mut [0; 4]).is_err() && flash.erase(0, 64).is_err());
        flash.power_up();
        assert_eq!(flash.bytes()[..6], [0; 6]);
        assert_eq!(flash.bytes()[7..], [0xff; 121]);
    }

    #[test]
    fn an_interrupted_erase_leaves_mixed_content() {
        let mut flash = Small::new(2);
        flash.set_bytes(&[0x55; 128]);
        flash.lose_power_after(63, 1);
        flash.erase(0, 64).unwrap_err();
        let bytes = flash.bytes();
        assert!(bytes[..64].contains(&0x55) && bytes[..64].contains(&0xff));
        assert_eq!(bytes[64..], [0x55; 64]);
    }
}
