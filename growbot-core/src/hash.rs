//! The hash that identifies robots, plans and firmware images: CRC-64/XZ.
//!
//! The hash detects mistakes. It does not protect against an attacker.

use crc::{CRC_64_XZ, Crc, Digest};

/// The implementation of the CRC. On the desktop a table of 1 or 2 kB saves time. Boards compute the CRC without a
/// table, to save memory.
#[cfg(not(target_os = "none"))]
pub(crate) type CrcTable = crc::Table<1>;
#[cfg(target_os = "none")]
pub(crate) type CrcTable = crc::NoTable;

static CRC: Crc<u64, CrcTable> = Crc::<u64, CrcTable>::new(&CRC_64_XZ);

/// Computation of a CRC-64/XZ over bytes that are added in parts.
pub struct Hasher(Digest<'static, u64, CrcTable>);

impl Default for Hasher {
    fn default() -> Self {
        Self(CRC.digest())
    }
}

impl Hasher {
    /// Returns the hash of these bytes.
    pub fn hash(bytes: &[u8]) -> u64 {
        CRC.checksum(bytes)
    }

    /// Adds bytes to the hash.
    pub fn write_bytes(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    /// Adds a number to the hash, as its eight little-endian bytes.
    pub fn write_f64(&mut self, value: f64) {
        self.write_bytes(&value.to_le_bytes());
    }

    /// Returns the hash of all bytes added.
    pub fn finish(self) -> u64 {
        self.0.finalize()
    }
}
