//! The seal of a firmware image: a CRC of all bytes that the image puts into flash. The board checks it at each start
//! before anything may heat.
//!
//! An image from the linker has no seal yet. It has [`SEAL_WORDS`] words under the name [`SYMBOL`], which contain
//! [`EMPTY`]. After linking, `growbot flash` and the emulator's port write the seal there:
//!
//! | word | content |
//! |---|---|
//! | 0 | [`NOT_SEALED`] or [`SEALED`] |
//! | 1 | CRC-32C of word 0, of the words from 2 on, and of the bytes in the parts, in this order |
//! | 2, 4, ... | address of a part of the image; no part includes the seal itself |
//! | 3, 5, ... | length of that part, bytes; 0 for an unused entry |
//!
//! If word 0 is neither [`NOT_SEALED`] nor [`SEALED`], the seal is damaged.

use crc::{CRC_32_ISCSI, Crc, NoTable};
use growbot_core::link::message::ImageCheck;

/// Name of the linker symbol at which an image contains its seal.
pub const SYMBOL: &str = "GROWBOT_IMAGE_SEAL";
/// Max number of parts (contiguous address ranges) of an image that a seal covers.
pub const PARTS: usize = 3;
/// Number of words of the seal.
pub const SEAL_WORDS: usize = 2 + 2 * PARTS;
/// The seal of an image, as words that are stored in little-endian order.
pub type Seal = [u32; SEAL_WORDS];
/// First word of the seal of an image that was never sealed.
pub const NOT_SEALED: u32 = 0x6E6F_7365;
/// First word of the seal of an image that is sealed.
pub const SEALED: u32 = 0x9153_A1E1;
/// Max number of bytes of an image that are checked. This number limits the duration of the check, so that a damaged
/// seal cannot block a board until the watchdog expires. 256 KiB take some 0.2 s at 168 MHz.
pub const MAX_BYTES: u32 = 256 * 1024;
/// The seal of an image that is not sealed, as the linker puts it into the image.
pub const EMPTY: Seal = {
    let mut seal = [0; SEAL_WORDS];
    seal[0] = NOT_SEALED;
    seal
};

/// CRC-32C algorithm that uses no table, because a table would save time but occupy flash.
static CRC: Crc<u32, NoTable> = Crc::<u32, NoTable>::new(&CRC_32_ISCSI);

/// Returns the address and the length in bytes of each part of an image.
pub fn parts(seal: &Seal) -> impl Iterator<Item = [u32; 2]> {
    let (pairs, _) = seal.as_chunks::<2>();
    pairs.iter().skip(1).copied()
}

/// Returns the CRC-32C of a sealed image. `byte` returns the byte of the image at an address, or `None` if the image
/// cannot have one there. The result is `None` if `byte` returns `None`, or if the image is longer than [`MAX_BYTES`].
pub fn crc_of(seal: &Seal, byte: impl Fn(u32) -> Option<u8>) -> Option<u32> {
    if parts(seal).fold(0_u32, |sum, [_, bytes]| sum.saturating_add(bytes)) > MAX_BYTES {
        return None;
    }
    let mut digest = CRC.digest();
    let [mark, _, parts_of_it @ ..] = seal;
    for word in [mark].into_iter().chain(parts_of_it) {
        digest.update(&word.to_le_bytes());
    }
    for [address, bytes] in parts(seal) {
        for offset in 0..bytes {
            digest.update(&[byte(address.wrapping_add(offset))?]);
        }
    }
    Some(digest.finalize())
}

/// Checks an image against its seal. `byte` returns the byte of the flash at an address, or `None` if the address is
/// not in flash.
pub fn check(seal: &Seal, byte: impl Fn(u32) -> Option<u8>) -> ImageCheck {
    let [mark, sealed, ..] = *seal;
    if *seal == EMPTY {
        return ImageCheck::Unsealed;
    }
    match crc_of(seal, byte) {
        Some(found) if mark == SEALED && found == sealed => ImageCheck::Valid { crc: sealed },
        found => ImageCheck::Corrupt { sealed, found: found.unwrap_or(sealed) },
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    const FLASH: u32 = 0x0800_0000;

    /// Returns an image of two parts and its seal.
    fn sealed() -> (Seal, Vec<u8>) {
        let bytes: Vec<u8> = (0..1024_u32).map(|index| (index * 7 + index / 256) as u8).collect();
        let mut seal = EMPTY;
        seal[0] = SEALED;
        seal[2..6].copy_from_slice(&[FLASH, 399, FLASH + 463, 100]);
        seal[1] = crc_of(&seal, |address| bytes.get((address - FLASH) as usize).copied()).unwrap();
        (seal, bytes)
    }

    fn checked(seal: &Seal, bytes: &[u8]) -> ImageCheck {
        check(seal, |address| bytes.get(address.checked_sub(FLASH)? as usize).copied())
    }

    #[test]
    fn a_sealed_image_is_intact_and_an_unsealed_one_is_detected() {
        let (seal, bytes) = sealed();
        assert_eq!(checked(&seal, &bytes), ImageCheck::Valid { crc: seal[1] });
        assert_eq!(checked(&EMPTY, &bytes), ImageCheck::Unsealed);
    }

    #[test]
    fn any_flipped_bit_of_the_image_is_detected() {
        let (seal, bytes) = sealed();
        for bit in 0..8 * bytes.len() {
            let mut flipped = bytes.clone();
            flipped[bit / 8] ^= 1 << (bit % 8);
            let at = FLASH + bit as u32 / 8;
            let covered = parts(&seal).any(|[from, bytes]| at.checked_sub(from).is_some_and(|offset| offset < bytes));
            assert_eq!(matches!(checked(&seal, &flipped), ImageCheck::Corrupt { .. }), covered, "bit {bit}");
        }
    }

    #[test]
    fn an_overlong_image_is_not_read() {
        for lengths in [[MAX_BYTES + 1, 0], [MAX_BYTES, 1], [u32::MAX, u32::MAX]] {
            let mut seal = sealed().0;
            (seal[3], seal[5]) = lengths.into();
            let found = check(&seal, |address| panic!("{address:08x} is read"));
            assert!(matches!(found, ImageCheck::Corrupt { .. }), "{found:?}");
        }
    }

    #[test]
    fn any_flipped_bit_of_the_seal_is_detected() {
        let bytes = sealed().1;
        for seal in [sealed().0, EMPTY] {
            for bit in 0..32 * SEAL_WORDS {
                let mut flipped = seal;
                flipped[bit / 32] ^= 1 << (bit % 32);
                let found = checked(&flipped, &bytes);
                assert!(matches!(found, ImageCheck::Corrupt { .. }), "bit {bit}: {found:?}");
            }
        }
    }
}
