//! Sealing of firmware images. A seal consists of a CRC-32C and the address ranges that the CRC covers, and is stored
//! in the image. A board checks its flash against the seal when it starts (`growbot_firmware::image_seal`).

use std::path::Path;
use std::{fs, io};

use growbot_firmware::image_seal::{EMPTY, PARTS, SEAL_WORDS, SEALED, SYMBOL, Seal, crc_of};
use growbot_plan::atomic_file::{FileError, write_atomic};
use object::elf::{FileHeader32, PT_LOAD};
use object::read::elf::{ElfFile32, ProgramHeader};
use object::{Endianness, Object, ObjectSection, ObjectSymbol};

/// Error of sealing an image.
#[derive(Debug, thiserror::Error)]
pub enum SealError {
    /// The image cannot be read.
    #[error("cannot seal the firmware image {file}: {error}")]
    File {
        /// Path of the image file.
        file: String,
        /// Error of the operating system.
        error: io::Error,
    },
    /// The file is not an image of growbot's firmware, or the firmware is so old that it does not support seals.
    #[error(
        "{file} cannot be sealed: {error}; give the ELF image that `cargo build-stm32f405` or `cargo build-pico` makes"
    )]
    NoImage {
        /// Path of the image file.
        file: String,
        /// Reason why the file cannot be sealed.
        error: UnsealableError,
    },
    /// The image has a seal that does not match its content.
    #[error(
        "the firmware image {file} does not match its seal, so it was damaged or changed: build or download the image \
         again"
    )]
    Damaged {
        /// Path of the image file.
        file: String,
    },
    /// The sealed image cannot be written.
    #[error(transparent)]
    Output(#[from] FileError),
}

/// Reason why an image cannot be sealed.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum UnsealableError {
    /// The image is not a 32-bit ELF file.
    #[error("the file is not a 32-bit ELF file ({0})")]
    NoElf(#[from] object::Error),
    /// The image has no place for a seal.
    #[error("the file has no symbol {SYMBOL}")]
    NoSymbol,
    /// A segment of the image lies outside the file.
    #[error("a segment of the image lies outside the file")]
    SegmentOutsideFile,
    /// The place of the seal is not in a segment of the image.
    #[error("the seal is not in a segment of the image")]
    SealOutsideImage,
    /// A segment of the image is too long.
    #[error("a segment of the image is too long")]
    LongSegment,
    /// The image has more parts than a seal covers. The field is their number.
    #[error("the image has {0} parts, but a seal covers at most {PARTS}")]
    TooManyParts(usize),
    /// The parts of the image overlap.
    #[error("the parts of the image overlap")]
    Overlap,
    /// The seal lies outside the file.
    #[error("the seal lies outside the file")]
    SealOutsideFile,
}

/// A firmware image with its seal.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SealedImage {
    /// Bytes of the ELF file.
    pub bytes: Vec<u8>,
    /// CRC-32C of the image.
    pub crc: u32,
}

/// A part of an image: its address in flash, and its bytes.
type ImagePart<'a> = (u32, &'a [u8]);

/// Sorts address ranges (start, length in bytes), removes empty ones and joins adjacent ones.
fn joined(mut parts: Vec<(u32, u32)>) -> Vec<(u32, u32)> {
    parts.retain(|(_, bytes)| *bytes > 0);
    parts.sort_unstable();
    let mut joined: Vec<(u32, u32)> = Vec::new();
    for (address, bytes) in parts {
        match joined.last_mut() {
            Some((before, length)) if *before + *length == address => *length += bytes,
            _ => joined.push((address, bytes)),
        }
    }
    joined
}

/// Returns a copy of an ELF image with a new seal, which replaces any seal in the image. Sealing an unchanged image
/// again results in an identical seal.
///
/// # Errors
/// [`UnsealableError`].
pub fn seal(image: &[u8]) -> Result<SealedImage, UnsealableError> {
    let file: ElfFile32 = ElfFile32::parse(image)?;
    let symbol = file.symbols().find(|symbol| symbol.name() == Ok(SYMBOL));
    let place = symbol.ok_or(UnsealableError::NoSymbol)?.address() as u32;
    let loaded = |header: &<FileHeader32<Endianness> as object::read::elf::FileHeader>::ProgramHeader| {
        let endian = file.endian();
        (header.p_type(endian) == PT_LOAD && header.p_filesz(endian) > 0)
            .then(|| Some((header.p_paddr(endian), header.data(endian, image).ok()?, header.p_offset(endian))))
    };
    let segments: Option<Vec<(u32, &[u8], u32)>> = file.elf_program_headers().iter().filter_map(loaded).collect();
    let segments = segments.ok_or(UnsealableError::SegmentOutsideFile)?;

    // The address range of the seal itself, which the CRC does not cover.
    let seal_bytes = 4 * SEAL_WORDS as u32;
    let end = place.wrapping_add(seal_bytes);
    let holder = segments.iter().find(|(address, bytes, _)| {
        place >= *address && u64::from(place) + u64::from(seal_bytes) <= u64::from(*address) + bytes.len() as u64
    });
    let &(holder_address, _, holder_offset) = holder.ok_or(UnsealableError::SealOutsideImage)?;
    let mut parts: Vec<(u32, u32)> = Vec::new();
    for &(address, bytes, _) in &segments {
        let length = u32::try_from(bytes.len()).map_err(|_| UnsealableError::LongSegment)?;
        if address == holder_address {
            parts.extend([(address, place - address), (end, (address + length).saturating_sub(end))]);
        } else {
            parts.push((address, length));
        }
    }
    let parts = joined(parts);
    if parts.len() > PARTS {
        return Err(UnsealableError::TooManyParts(parts.len()));
    }

    let contents: Vec<ImagePart> = segments.iter().map(|(address, bytes, _)| (*address, *bytes)).collect();
    let byte = |address: u32| {
        contents.iter().find_map(|(from, bytes)| bytes.get(address.checked_sub(*from)? as usize).copied())
    };
    let mut words: Seal = EMPTY;
    words[0] = SEALED;
    for (into, (address, bytes)) in words[2..].as_chunks_mut::<2>().0.iter_mut().zip(parts) {
        *into = [address, bytes];
    }
    let crc = crc_of(&words, byte).ok_or(UnsealableError::Overlap)?;
    words[1] = crc;

    let at = holder_offset as usize + (place - holder_address) as usize;
    let mut bytes = image.to_vec();
    let into = bytes.get_mut(at..at + 4 * SEAL_WORDS).ok_or(UnsealableError::SealOutsideFile)?;
    for (into, word) in into.as_chunks_mut::<4>().0.iter_mut().zip(words) {
        *into = word.to_le_bytes();
    }
    Ok(SealedImage { bytes, crc })
}

/// Reports whether an image has a seal, valid or not.
pub fn is_sealed(image: &[u8]) -> bool {
    let seal_of = || {
        let file: ElfFile32 = ElfFile32::parse(image).ok()?;
        let place = file.symbols().find(|symbol| symbol.name() == Ok(SYMBOL))?.address();
        let section = file.sections().find(|it| (it.address()..it.address() + it.size()).contains(&place))?;
        Some(section.data_range(place, 4 * SEAL_WORDS as u64).ok()?? == EMPTY.map(u32::to_le_bytes).as_flattened())
    };
    seal_of() == Some(false)
}

/// Seals an image file in place, and returns its CRC-32C. If the file is already sealed, the seal is only checked.
///
/// # Errors
/// [`SealError`].
pub fn seal_in_place(path: &Path) -> Result<u32, SealError> {
    let file = path.display().to_string();
    let image = fs::read(path).map_err(|error| SealError::File { file: file.clone(), error })?;
    let SealedImage { bytes, crc } = seal(&image).map_err(|error| SealError::NoImage { file: file.clone(), error })?;
    if is_sealed(&image) {
        return if bytes == image { Ok(crc) } else { Err(SealError::Damaged { file }) };
    }
    write_atomic(path, &bytes)?;
    Ok(crc)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_that_are_not_images_are_refused() {
        let mut header = b"\x7fELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec();
        header.extend([2, 0, 40, 0, 1, 0, 0, 0]);
        header.resize(52, 0);
        assert!(matches!(seal(b"no image"), Err(UnsealableError::NoElf(_))));
        assert_eq!(seal(&header), Err(UnsealableError::NoSymbol));
        let file = tempfile::NamedTempFile::new().unwrap();
        let error = seal_in_place(file.path()).unwrap_err();
        assert!(matches!(error, SealError::NoImage { error: UnsealableError::NoElf(_), .. }), "{error}");
    }
}
