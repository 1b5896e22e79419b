//! Sealing of firmware images. A seal consists of a CRC-32C and the address ranges that the CRC covers, and is stored
//! in the image. A board checks its flash against the seal when it starts (`growbot_firmware::image_seal`).

use std::fs;
use std::io;
use std::path::Path;

use growbot_client::atomic_file::{FileError, write_atomic};
use growbot_firmware::image_seal::{EMPTY, PARTS, SEAL_WORDS, SEALED, SYMBOL, Seal, crc_of};
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
        "{file} cannot be sealed: {reason}; give the ELF image that `cargo build-stm32f405` or `cargo build-pico` makes"
    )]
    NoImage {
        /// Path of the image file.
        file: String,
        /// Reason why the file cannot be sealed.
        reason: String,
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
/// A message with the reason why the image cannot be sealed.
pub fn seal(image: &[u8]) -> Result<SealedImage, String> {
    let file: ElfFile32 =
        ElfFile32::parse(image).map_err(|error| format!("the file is not a 32-bit ELF file ({error})"))?;
    let symbol = file.symbols().find(|symbol| symbol.name() == Ok(SYMBOL));
    let place = symbol.ok_or_else(|| format!("the file has no symbol {SYMBOL}"))?.address() as u32;
    let loaded = |header: &<FileHeader32<Endianness> as object::read::elf::FileHeader>::ProgramHeader| {
        let endian = file.endian();
        (header.p_type(endian) == PT_LOAD && header.p_filesz(endian) > 0)
            .then(|| Some((header.p_paddr(endian), header.data(endian, image).ok()?, header.p_offset(endian))))
    };
    let segments: Option<Vec<(u32, &[u8], u32)>> = file.elf_program_headers().iter().filter_map(loaded).collect();
    let segments = segments.ok_or("a segment of the image lies outside the file")?;

    // The address range of the seal itself, which the CRC does not cover.
    let seal_bytes = 4 * SEAL_WORDS as u32;
    let end = place.wrapping_add(seal_bytes);
    let holder = segments.iter().find(|(address, bytes, _)| {
        place >= *address && u64::from(place) + u64::from(seal_bytes) <= u64::from(*address) + bytes.len() as u64
    });
    let &(holder_address, _, holder_offset) = holder.ok_or("the seal is not in a segment of the image")?;
    let mut parts: Vec<(u32, u32)> = Vec::new();
    for &(address, bytes, _) in &segments {
        let length = u32::try_from(bytes.len()).map_err(|_| "a segment of the image is too long")?;
        if address == holder_address {
            parts.extend([(address, place - address), (end, (address + length).saturating_sub(end))]);
        } else {
            parts.push((address, length));
        }
    }
    let parts = joined(parts);
    if parts.len() > PARTS {
        return Err(format!("the image has {} parts, but a seal covers at most {PARTS}", parts.len()));
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
    let crc = crc_of(&words, byte).ok_or("the parts of the image overlap")?;
    words[1] = crc;

    let at = holder_offset as usize + (place - holder_address) as usize;
    let mut bytes = image.to_vec();
    let into = bytes.get_mut(at..at + 4 * SEAL_WORDS).ok_or("the seal lies outside the file")?;
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
    let SealedImage { bytes, crc } =
        seal(&image).map_err(|reason| SealError::NoImage { file: file.clone(), reason })?;
    if is_sealed(&image) {
        return if bytes == image { Ok(crc) } else { Err(SealError::Damaged { file }) };
    }
    write_atomic(path, &bytes)?;
    Ok(crc)
}
