//! The hash of growbot: CRC-64/XZ, which distinguishes machines, plans and images.
//!
//! It guards against mix-ups, not against malice.

use crc::{CRC_64_XZ, Crc, Digest};

/// The implementation of the CRC. A table of 1 or 2 kB saves time on the desktop; boards save the room.
#[cfg(not(target_os = "none"))]
pub(crate) type CrcTable = crc::Table<1>;
#[cfg(target_os = "none")]
pub(crate) type CrcTable = crc::NoTable;

static CRC: Crc<u64, CrcTable> = Crc::<u64, CrcTable>::new(&CRC_64_XZ);

/// A CRC-64/XZ under way.
pub struct Hasher(Digest<'static, u64, CrcTable>);

impl Default for Hasher {
    fn default() -> Self {
        Self(CRC.digest())
    }
}

impl Hasher {
    /// The hash of some bytes.
    #[must_use]
    pub fn of(bytes: &[u8]) -> u64 {
        CRC.checksum(bytes)
    }

    /// Adds bytes.
    pub fn bytes(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    /// Adds a number, as its eight little-endian bytes.
    pub fn f64(&mut self, value: f64) {
        self.bytes(&value.to_le_bytes());
    }

    /// The hash of all that was added.
    #[must_use]
    pub fn finish(self) -> u64 {
        self.0.finalize()
    }
}
