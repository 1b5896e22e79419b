//! The robot's description in flash: what a host has configured, kept over resets and losses of power.
//!
//! There are two slots, each of an erase sector or more. A description is written to the slot that does not have the
//! newest one, its bytes first and its header last, so that a loss of power at any byte leaves the old description or
//! the new one. The header:
//!
//! | byte | content |
//! |---|---|
//! | 0 to 3 | `GBRD` |
//! | 4 to 7 | number of the description: the newest one has the max |
//! | 8 to 11 | bytes of the description, which follow the header |
//! | 12 to 15 | CRC-32C of bytes 0 to 11 and of the description |
//!
//! All numbers are little-endian. The description begins with the version of its encoding
//! ([`growbot_core::robot::ENCODING_VERSION`]).

#[cfg(test)]
mod tests;

use embedded_storage::nor_flash::MultiwriteNorFlash;
use growbot_core::link::frame;
use growbot_core::robot::{LONGEST_VERSIONED, Robot};

/// What a header begins with: `GBRD`.
const MAGIC: u32 = u32::from_le_bytes(*b"GBRD");
/// Bytes of a header.
const HEADER_BYTES: usize = 16;
/// The longest description, filled up to whole words.
const LONGEST: usize = LONGEST_VERSIONED.next_multiple_of(4);
/// A header that was struck out: flash can always be programmed to zero.
const STRUCK: [u8; HEADER_BYTES] = [0; HEADER_BYTES];

/// The bytes of a description, of which only the first ones may count.
type Padded = [u8; LONGEST];

/// The description could not be written, or reads differently. The one before is still there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NotStored;

/// What the flash has.
#[derive(Debug, Clone, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "it is taken apart where it is made")]
pub enum Stored {
    /// No description was ever stored whole.
    Nothing,
    /// A whole one that this firmware cannot read, or not drive: another release's.
    Unreadable,
    /// One.
    Robot(Robot),
}

impl Stored {
    /// The robot, if there is one.
    #[must_use]
    pub fn robot(self) -> Option<Robot> {
        match self {
            Self::Robot(robot) => Some(robot),
            Self::Nothing | Self::Unreadable => None,
        }
    }
}

/// The slot of the newest description.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Newest {
    slot: u32,
    header: Header,
}

/// A header without its CRC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Header {
    number: u32,
    length: u32,
}

impl Header {
    /// The header's bytes, for a description of at least its length.
    fn to_bytes(self, description: &Padded) -> [u8; HEADER_BYTES] {
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

    /// CRC of a header's bytes, without those of the CRC, and of a description.
    fn checksum(self, header: &[u8; HEADER_BYTES], description: &Padded) -> u32 {
        let mut covered = [0; HEADER_BYTES + LONGEST];
        let content = header.iter().take(HEADER_BYTES - 4).chain(description.iter().take(self.length as usize));
        let mut length = 0;
        for (into, byte) in covered.iter_mut().zip(content) {
            *into = *byte;
            length += 1;
        }
        frame::checksum(covered.get(..length).unwrap_or_default())
    }
}

/// The two slots of a flash.
pub struct Descriptions<F> {
    flash: F,
    newest: Option<Newest>,
}

impl<F: MultiwriteNorFlash> Descriptions<F> {
    /// Finds the newest description. The flash has two sectors or more.
    pub fn open(flash: F) -> Self {
        let mut descriptions = Self { flash, newest: None };
        for slot in 0..2 {
            let found = descriptions.read(slot).map(|(header, _)| Newest { slot, header });
            let newer =
                |found: &Newest| descriptions.newest.is_none_or(|known| found.header.number > known.header.number);
            if let Some(newest) = found.filter(newer) {
                descriptions.newest = Some(newest);
            }
        }
        descriptions
    }

    /// The newest description.
    pub fn newest(&mut self) -> Stored {
        let read = self.newest.and_then(|newest| self.read(newest.slot));
        let Some((header, bytes)) = read else { return Stored::Nothing };
        let robot = bytes.get(..header.length as usize).map(Robot::decode_for_board);
        robot.and_then(Result::ok).map_or(Stored::Unreadable, Stored::Robot)
    }

    /// Stores a robot's description. It erases a slot, which takes up to two seconds in which nothing else happens: so
    /// heater and steppers must be off and the nozzle cold.
    ///
    /// # Errors
    /// [`NotStored`].
    #[inline(never)]
    pub fn store(&mut self, robot: &Robot) -> Result<(), NotStored> {
        let mut bytes: Padded = [0xff; LONGEST];
        let length = robot.encode_for_board(&mut bytes).map_err(|_| NotStored)?.len();
        let (slot, number) = match self.newest {
            Some(newest) => (1 - newest.slot.min(1), newest.header.number.saturating_add(1)),
            None => (0, 1),
        };
        let newest = Newest { slot, header: Header { number, length: length as u32 } };
        if self.write(newest, &bytes).is_err() || self.read(slot) != Some((newest.header, bytes)) {
            // It may read as whole later.
            let _ = self.flash.write(self.start(slot), &STRUCK);
            return Err(NotStored);
        }
        self.newest = Some(newest);
        Ok(())
    }

    fn write(&mut self, newest: Newest, bytes: &Padded) -> Result<(), F::Error> {
        let start = self.start(newest.slot);
        self.flash.erase(start, self.start(newest.slot + 1))?;
        self.flash.write(start + HEADER_BYTES as u32, bytes)?;
        self.flash.write(start, &newest.header.to_bytes(bytes))
    }

    /// The description in a slot; none where it has no whole one.
    #[inline(never)]
    fn read(&mut self, slot: u32) -> Option<(Header, Padded)> {
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

    /// Where a slot begins.
    fn start(&self, slot: u32) -> u32 {
        slot * (self.flash.capacity() / F::ERASE_SIZE / 2 * F::ERASE_SIZE) as u32
    }
}
