//! A record of the journal: 32 bytes that are valid as a whole or not at all.
//!
//! | byte | content |
//! |---|---|
//! | 0 | [`RecordKind`] in the low four bits; in the high four bits the number of the job's earlier records, modulo 16
//! |
//! | 1 to 3 | index of a layer, 24 bits; 0 if the record is not about a layer |
//! | 4 to 7 | number of the job; the numbers never start again |
//! | 8 to 27 | content, by the kind |
//! | 28 to 31 | CRC-32C of bytes 0 to 27 |
//!
//! All numbers are little-endian.

use growbot_core::layer_bytes::LayerBytes;
use growbot_core::link::frame;
use strum::VariantArray;

/// Length of a record, bytes.
pub(super) const RECORD_BYTES: usize = 32;

/// Max value of [`Record::count`], after which the count starts again at 0.
pub(super) const LAST_COUNT: u32 = 15;
/// Max index of a layer that fits into a record, 24 bits.
pub(super) const LAST_INDEX: u32 = (1 << 24) - 1;

/// Bytes of a record, as stored in flash.
pub(super) type RecordBytes = [u8; RECORD_BYTES];

/// Content of a slot in which nothing has been written since it was erased.
pub(super) const BLANK: RecordBytes = [0xff; RECORD_BYTES];
/// Content of a slot that was struck out. It can overwrite any record, because flash can always be programmed to zero.
/// Its CRC is wrong, so it is not a valid record.
pub(super) const STRUCK: RecordBytes = [0; RECORD_BYTES];

/// The kind of a record: the low four bits of its first byte.
#[derive(Debug, Clone, Copy, PartialEq, Eq, VariantArray)]
#[repr(u8)]
pub(super) enum RecordKind {
    /// The first record of a sector. It contains the total number of erasures in the journal, including the erasure of
    /// this sector. Its job number is that of the last job that began before the erasure.
    Sector,
    /// The beginning of a job: plan id, hash of the robot's description, and number of layers.
    Job,
    /// The beginning of a layer.
    Begun,
    /// A layer is laid, and the next layer has not begun.
    Laid,
    /// A layer is laid, and the next layer has begun at once.
    LaidNextBegun,
    /// A layer that was interrupted and counts as laid.
    Interrupted,
    /// A new plan replaces the rest of the job from a layer on: its plan id and its number of layers.
    Amended,
    /// The end of a job that is done or cancelled.
    Ended,
}

/// A laid layer, as the journal records it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LayerRecord {
    /// The layer as built.
    pub as_built: LayerBytes,
    /// Planned height of the layer, units of [`growbot_core::layer_bytes`].
    pub height_units: u32,
    /// Lean that the laid layers lack because of rounding, in the caller's units. The next layers must add it.
    pub residual_lean: [i16; 2],
}

/// A decoded record of the journal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Record {
    pub kind: RecordKind,
    /// Number of earlier records of the same job: 0 to [`LAST_COUNT`], then from 0 again.
    pub count: u32,
    /// Index of the layer that the record is about, 24 bits.
    pub index: u32,
    pub job: u32,
    pub content: [u32; 5],
}

impl Record {
    pub fn to_bytes(self) -> RecordBytes {
        let [a, b, c, d, e] = self.content;
        let words = [self.index << 8 | self.count << 4 | self.kind as u32, self.job, a, b, c, d, e, 0];
        let mut bytes = STRUCK;
        for (into, word) in bytes.as_chunks_mut::<4>().0.iter_mut().zip(words) {
            *into = word.to_le_bytes();
        }
        if let Some((content, checksum)) = bytes.split_last_chunk_mut::<4>() {
            *checksum = frame::crc32c(content).to_le_bytes();
        }
        bytes
    }

    /// Decodes a record. `None` if the bytes are not a valid record.
    pub fn from_bytes(bytes: &RecordBytes) -> Option<Self> {
        let (content, checksum) = bytes.split_last_chunk::<4>()?;
        if frame::crc32c(content).to_le_bytes() != *checksum {
            return None;
        }
        let mut words = [0; 8];
        for (word, from) in words.iter_mut().zip(bytes.as_chunks::<4>().0) {
            *word = u32::from_le_bytes(*from);
        }
        let [first, job, a, b, c, d, e, _] = words;
        let kind = *RecordKind::VARIANTS.get((first & 15) as usize)?;
        Some(Self { kind, count: first >> 4 & LAST_COUNT, index: first >> 8, job, content: [a, b, c, d, e] })
    }
}

impl LayerRecord {
    pub(super) fn to_content(self) -> [u32; 5] {
        let [x, y] = self.residual_lean;
        let [a, b, c, d, e, f, g, h, i, j, k, l] = self.as_built;
        [
            u32::from_le_bytes([a, b, c, d]),
            u32::from_le_bytes([e, f, g, h]),
            u32::from_le_bytes([i, j, k, l]),
            self.height_units,
            u32::from(x as u16) | u32::from(y as u16) << 16,
        ]
    }

    pub(super) fn from_content([a, b, c, height_units, lean]: [u32; 5]) -> Self {
        let mut as_built = LayerBytes::default();
        for (into, word) in as_built.as_chunks_mut::<4>().0.iter_mut().zip([a, b, c]) {
            *into = word.to_le_bytes();
        }
        Self { as_built, height_units, residual_lean: lean_owed(lean) }
    }
}

/// Unpacks the residual lean (see [`LayerRecord::residual_lean`]) from the last word of a layer record's content.
pub(super) const fn lean_owed(lean: u32) -> [i16; 2] {
    [lean as i16, (lean >> 16) as i16]
}

/// Splits a 64-bit number into its low and its high 32-bit word.
pub(super) const fn split(number: u64) -> [u32; 2] {
    [number as u32, (number >> 32) as u32]
}

/// Joins a low and a high 32-bit word to a 64-bit number.
pub(super) const fn join(low: u32, high: u32) -> u64 {
    low as u64 | (high as u64) << 32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn record() -> impl Strategy<Value = Record> {
        (0..RecordKind::VARIANTS.len(), 0..=LAST_COUNT, 0..=LAST_INDEX, any::<u32>(), any::<[u32; 5]>()).prop_map(
            |(kind, count, index, job, content)| Record {
                kind: RecordKind::VARIANTS[kind],
                count,
                index,
                job,
                content,
            },
        )
    }

    proptest! {
        #[test]
        fn a_record_round_trips(record in record()) {
            prop_assert_eq!(Record::from_bytes(&record.to_bytes()), Some(record));
        }

        #[test]
        fn up_to_five_flipped_bits_are_detected(
            record in record(),
            bits in prop::collection::btree_set(0_usize..256, 1..=5),
        ) {
            let mut bytes = record.to_bytes();
            for bit in bits {
                bytes[bit / 8] ^= 1 << (bit % 8);
            }
            prop_assert_eq!(Record::from_bytes(&bytes), None);
        }

        #[test]
        fn a_layer_record_round_trips(
            as_built in any::<LayerBytes>(),
            height_units in any::<u32>(),
            lean_owed in any::<[i16; 2]>(),
        ) {
            let laid = LayerRecord { as_built, height_units, residual_lean: lean_owed };
            prop_assert_eq!(LayerRecord::from_content(laid.to_content()), laid);
        }
    }

    #[test]
    fn blank_slots_and_struck_records_decode_to_none() {
        assert_eq!(Record::from_bytes(&BLANK), None);
        assert_eq!(Record::from_bytes(&STRUCK), None);
    }
}
