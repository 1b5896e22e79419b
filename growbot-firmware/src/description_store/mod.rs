//! Storage of the robot's description in flash. The host configures it, and it survives resets and losses of power.
//!
//! The flash has two slots, each of one erase sector or more. A description is written to the slot that does not
//! contain the newest one. Its bytes are written first and its header last, so that a loss of power at any byte leaves
//! either the old description or the new one. The header:
//!
//! | byte | content |
//! |---|---|
//! | 0 to 3 | `GBRD` |
//! | 4 to 7 | sequence number of the description: the newest one has the greatest number |
//! | 8 to 11 | length of the description, which follows the header, bytes |
//! | 12 to 15 | CRC-32C of bytes 0 to 11 and of the description |
//!
//! All numbers are little-endian. The description begins with the version of its encoding
//! ([`growbot_core::robot::ENCODING_VERSION`]).

#[cfg(test)]
mod tests;

use embedded_storage::nor_flash::MultiwriteNorFlash;
use growbot_core::link::frame;
use growbot_core::robot::{MAX_VERSIONED_LEN, Robot};

/// First word of a header: `GBRD`.
const MAGIC: u32 = u32::from_le_bytes(*b"GBRD");
/// Length of a header, bytes.
const HEADER_BYTES: usize = 16;
/// Length of the longest description, rounded up to whole 4-byte words, bytes.
const LONGEST: usize = MAX_VERSIONED_LEN.next_multiple_of(4);
/// Header of zeros, which marks a slot as invalid. It can overwrite any other header without an erasure, because flash
/// can always be programmed to zero.
const STRUCK: [u8; HEADER_BYTES] = [0; HEADER_BYTES];

/// Bytes of a description, padded to the max length.
type PaddedDescription = [u8; LONGEST];

/// Error: the description could not be written, or reads back differently. The previous description is still stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StoreError;

/// Content of the flash that stores the robot's description.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "it is taken apart where it is made")]
pub enum StoredDescription {
    /// No description was ever stored completely.
    Empty,
    /// The description is complete, but this firmware cannot decode it or cannot drive its robot. Another release
    /// stored it.
    Undecodable,
    /// The newest stored description is valid and describes this robot.
    Robot(Robot),
}

impl StoredDescription {
    /// Returns the robot. `None` if no valid description is stored.
    pub fn robot(self) -> Option<Robot> {
        match self {
            Self::Robot(robot) => Some(robot),
            Self::Empty | Self::Undecodable => None,
        }
    }
}

/// Slot and header of the newest description.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct NewestDescription {
    slot: u32,
    header: Header,
}

/// Header of a stored description, without its magic word and its CRC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Header {
    number: u32,
    length: u32,
}

impl Header {
    /// Encodes the header as bytes, with the CRC of the header and of `description`.
    fn to_bytes(self, description: &PaddedDescription) -> [u8; HEADER_BYTES] {
        let mut bytes = STRUCK;
        for (into, word) in bytes.as_chunks_mut::<4>().0.iter_mut().zip([MAGIC, self.number, self.length]) {
            *into = word.to_le_bytes();
        }
        let checksum = self.checksum(&bytes, description);
        if let Some((_, into)) = bytes.split_last_chunk_mut::<4>() {
            *into = checksum.to_le_bytes();
        }
        bytes
    }

    /// Returns the CRC-32C of the header's bytes, except the last four, which hold the CRC, and of the description.
    fn checksum(self, header: &[u8; HEADER_BYTES], description: &PaddedDescription) -> u32 {
        let mut covered = [0; HEADER_BYTES + LONGEST];
        let content = header.iter().take(HEADER_BYTES - 4).chain(description.iter().take(self.length as usize));
        let mut length = 0;
        for (into, byte) in covered.iter_mut().zip(content) {
            *into = *byte;
            length += 1;
        }
        frame::crc32c(covered.get(..length).unwrap_or_default())
    }
}

/// Store of the robot's description in the two slots of a flash.
pub struct DescriptionStore<F> {
    flash: F,
    newest: Option<NewestDescription>,
}

impl<F: MultiwriteNorFlash> DescriptionStore<F> {
    /// Opens the store and finds the newest description. The flash must have at least two sectors.
    pub fn open(flash: F) -> Self {
        let mut descriptions = Self { flash, newest: None };
        for slot in 0..2 {
            let found = descriptions.read(slot).map(|(header, _)| NewestDescription { slot, header });
            let newer = |found: &NewestDescription| {
                descriptions.newest.is_none_or(|known| found.header.number > known.header.number)
            };
            if let Some(newest) = found.filter(newer) {
                descriptions.newest = Some(newest);
            }
        }
        descriptions
    }

    /// Reads and decodes the newest description.
    pub fn newest(&mut self) -> StoredDescription {
        let read = self.newest.and_then(|newest| self.read(newest.slot));
        let Some((header, bytes)) = read else { return StoredDescription::Empty };
        let robot = bytes.get(..header.length as usize).map(Robot::decode_for_board);
        robot.and_then(Result::ok).map_or(StoredDescription::Undecodable, StoredDescription::Robot)
    }

    /// Stores a robot's description. This erases a slot of the flash, which takes up to two seconds in which the
    /// controller does nothing else. Heater and steppers must therefore be off and the nozzle cold.
    ///
    /// # Errors
    /// Returns [`StoreError`] if the description could not be written or reads back differently.
    #[inline(never)]
    pub fn store(&mut self, robot: &Robot) -> Result<(), StoreError> {
        let mut bytes: PaddedDescription = [0xff; LONGEST];
        let length = robot.encode_for_board(&mut bytes).map_err(|_| StoreError)?.len();
        let (slot, number) = match self.newest {
            Some(newest) => (1 - newest.slot.min(1), newest.header.number.saturating_add(1)),
            None => (0, 1),
        };
        let newest = NewestDescription { slot, header: Header { number, length: length as u32 } };
        if self.write(newest, &bytes).is_err() || self.read(slot) != Some((newest.header, bytes)) {
            // Its cells may read as a valid description later.
            let _ = self.flash.write(self.start(slot), &STRUCK);
            return Err(StoreError);
        }
        self.newest = Some(newest);
        Ok(())
    }

    fn write(&mut self, newest: NewestDescription, bytes: &PaddedDescription) -> Result<(), F::Error> {
        let start = self.start(newest.slot);
        self.flash.erase(start, self.start(newest.slot + 1))?;
        self.flash.write(start + HEADER_BYTES as u32, bytes)?;
        self.flash.write(start, &newest.header.to_bytes(bytes))
    }

    /// Returns the header and the bytes of the description in a slot. `None` if the slot does not contain a complete
    /// description.
    #[inline(never)]
    fn read(&mut self, slot: u32) -> Option<(Header, PaddedDescription)> {
        let start = self.start(slot);
        let (mut header, mut bytes) = (STRUCK, [0; LONGEST]);
        self.flash.read(start, &mut header).ok()?;
        self.flash.read(start + HEADER_BYTES as u32, &mut bytes).ok()?;
        let mut words = [0; HEADER_BYTES / 4];
        for (word, from) in words.iter_mut().zip(header.as_chunks::<4>().0) {
            *word = u32::from_le_bytes(*from);
        }
        let [magic, number, length, checksum] = words;
        let found = Header { number, length };
        let is_whole = magic == MAGIC && length as usize <= LONGEST && found.checksum(&header, &bytes) == checksum;
        is_whole.then_some((found, bytes))
    }

    /// Returns the address in the flash at which a slot begins, bytes.
    fn start(&self, slot: u32) -> u32 {
        slot * (self.flash.capacity() / F::ERASE_SIZE / 2 * F::ERASE_SIZE) as u32
    }
}
