//! Firmware images as UF2 files, which a Raspberry Pi Pico accepts by drag and drop. The Pico appears as a USB drive,
//! and writes the files that are copied to the drive into its flash (<https://github.com/microsoft/uf2>).
//!
//! A UF2 file consists of blocks of 512 bytes, each with 256 bytes of the image and their address.

use object::Endianness;
use object::elf::{FileHeader32, PT_LOAD};
use object::read::elf::{ElfFile32, ProgramHeader};

/// Size of a block of a UF2 file, bytes.
const BLOCK: usize = 512;
/// Number of bytes of the image in a UF2 block: a page of flash.
const PAYLOAD: usize = 256;
/// Number of bytes that are erased at once: a sector of flash.
const SECTOR: u32 = 4096;
/// Magic numbers of a UF2 block: the two words at its start, and the word at its end.
const MAGIC: [u32; 3] = [0x0A32_4655, 0x9E5D_5157, 0x0AB1_6F30];
/// Reason why an image cannot be written to the flash of an RP2040, or why a UF2 file is not valid.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Uf2Error {
    /// The image is not a 32-bit ELF file.
    #[error("the file is not a 32-bit ELF file ({0})")]
    NoElf(#[from] object::Error),
    /// A segment of the image lies outside the file.
    #[error("a segment of the image lies outside the file")]
    SegmentOutsideFile,
    /// A part of the image belongs to this address, which is not in the flash of an RP2040.
    #[error("a part of the image belongs to address {0:#010x}, which is not in the flash of an RP2040")]
    OutsideFlash(u32),
    /// The image has no bytes for flash.
    #[error("the file contains nothing to write to flash")]
    Empty,
    /// The length of the UF2 file, in bytes, is not that of whole blocks.
    #[error("the file has {0} bytes, which is not a multiple of {BLOCK}")]
    Length(usize),
    /// A block of the UF2 file is damaged, or belongs to another processor.
    #[error("block {block} of {blocks} of the file is damaged, or not for an RP2040")]
    Block {
        /// Number of the block, from 0.
        block: usize,
        /// Number of blocks of the file.
        blocks: usize,
    },
}

/// Flag of a UF2 block that states the family of its processor.
const HAS_FAMILY: u32 = 0x2000;
/// Number of the processor family RP2040 in UF2 files.
const RP2040: u32 = 0xE48B_FF56;
/// Address range at which the flash of an RP2040 is mapped: 16 MiB.
const FLASH: std::ops::Range<u32> = 0x1000_0000..0x1100_0000;

/// Returns the UF2 file of an ELF image for the RP2040.
///
/// # Errors
/// [`Uf2Error`] if the image is not one for the RP2040.
pub fn of_image(image: &[u8]) -> Result<Vec<u8>, Uf2Error> {
    let pages = pages_of(image)?;
    let mut file = Vec::with_capacity(pages.len() * BLOCK);
    for (number, (address, page)) in pages.iter().enumerate() {
        let [first, second, last] = MAGIC;
        let head = [first, second, HAS_FAMILY, *address, PAYLOAD as u32, number as u32, pages.len() as u32, RP2040];
        file.extend(head.iter().flat_map(|word| word.to_le_bytes()));
        file.extend(page);
        file.resize((number + 1) * BLOCK - 4, 0);
        file.extend(last.to_le_bytes());
    }
    Ok(file)
}

/// Returns true if a file begins like a UF2 file.
pub fn is_uf2(file: &[u8]) -> bool {
    file.starts_with(&MAGIC[0].to_le_bytes())
}

/// Checks that a UF2 file is complete and for the RP2040. The addresses of its blocks must be consecutive.
///
/// # Errors
/// [`Uf2Error::Length`] or [`Uf2Error::Block`].
pub fn check(file: &[u8]) -> Result<(), Uf2Error> {
    let (blocks, rest) = file.as_chunks::<BLOCK>();
    if blocks.is_empty() || !rest.is_empty() {
        return Err(Uf2Error::Length(file.len()));
    }
    let mut begin = FLASH.start;
    for (number, block) in blocks.iter().enumerate() {
        let (words, _) = block.as_chunks::<4>();
        let word = |at: usize| words.get(at).copied().map_or(0, u32::from_le_bytes);
        if number == 0 {
            begin = word(3);
        }
        let address = begin.wrapping_add(number as u32 * PAYLOAD as u32);
        let [first, second, last] = MAGIC;
        let head = [first, second, HAS_FAMILY, address, PAYLOAD as u32, number as u32, blocks.len() as u32, RP2040];
        if !FLASH.contains(&address) || !(0..).zip(head).all(|(at, is)| word(at) == is) || word(BLOCK / 4 - 1) != last {
            return Err(Uf2Error::Block { block: number, blocks: blocks.len() });
        }
    }
    Ok(())
}

/// Returns the pages of flash from the start of the sector where an image begins to the image's end, with their
/// addresses. Bytes that do not belong to the image are 0. The boot ROM derives from a block's number whether its
/// sector is erased already, so all pages in this range are returned.
fn pages_of(image: &[u8]) -> Result<Vec<(u32, [u8; PAYLOAD])>, Uf2Error> {
    let file: ElfFile32 = ElfFile32::parse(image)?;
    let mut pages: std::collections::BTreeMap<u32, [u8; PAYLOAD]> = std::collections::BTreeMap::new();
    for header in file.elf_program_headers() {
        let endian: Endianness = file.endian();
        let header: &<FileHeader32<Endianness> as object::read::elf::FileHeader>::ProgramHeader = header;
        if header.p_type(endian) != PT_LOAD || header.p_filesz(endian) == 0 {
            continue;
        }
        let bytes = header.data(endian, image).map_err(|()| Uf2Error::SegmentOutsideFile)?;
        let from = header.p_paddr(endian);
        let end = u64::from(from) + bytes.len() as u64;
        if !FLASH.contains(&from) || end > u64::from(FLASH.end) {
            return Err(Uf2Error::OutsideFlash(from));
        }
        for (address, byte) in (from..).zip(bytes) {
            let at = address % PAYLOAD as u32;
            let page = pages.entry(address - at).or_insert([0; PAYLOAD]);
            if let Some(into) = page.get_mut(at as usize) {
                *into = *byte;
            }
        }
    }
    let (Some(first), Some(last)) = (pages.keys().next(), pages.keys().next_back()) else {
        return Err(Uf2Error::Empty);
    };
    let all = (first - first % SECTOR..=*last).step_by(PAYLOAD);
    Ok(all.map(|address| (address, pages.get(&address).copied().unwrap_or([0; PAYLOAD]))).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns an ELF file with one segment.
    fn elf(address: u32, bytes: &[u8]) -> Vec<u8> {
        elf_of(&[(address, bytes)])
    }

    /// Returns an ELF file with these segments.
    fn elf_of(segments: &[(u32, &[u8])]) -> Vec<u8> {
        let header = 52_u32;
        let mut data = header + 32 * segments.len() as u32;
        let mut file = b"\x7fELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec();
        file.extend([2, 0, 40, 0]);
        for word in [1, 0, header, 0, 0] {
            file.extend(u32::to_le_bytes(word));
        }
        for half in [52_u16, 32, segments.len() as u16, 0, 0, 0] {
            file.extend(half.to_le_bytes());
        }
        for (address, bytes) in segments {
            let length = bytes.len() as u32;
            for word in [1, data, *address, *address, length, length, 5, 4] {
                file.extend(u32::to_le_bytes(word));
            }
            data += length;
        }
        segments.iter().for_each(|(_, bytes)| file.extend(*bytes));
        file
    }

    fn word(block: &[u8], at: usize) -> u32 {
        u32::from_le_bytes(block[at..at + 4].try_into().unwrap())
    }

    #[test]
    fn every_byte_is_stored_at_its_address() {
        let image: Vec<u8> = (0..1000_u32).map(|at| (at * 7 + 1) as u8).collect();
        let from = 0x1000_0080;
        let file = of_image(&elf(from, &image)).unwrap();
        // 0x80 bytes of the first page do not belong to the image.
        assert_eq!(file.len(), 5 * BLOCK);
        let mut flash = vec![0_u8; 2048];
        for (number, block) in file.chunks(BLOCK).enumerate() {
            let fixed =
                [(0, 0x0A32_4655), (4, 0x9E5D_5157), (8, 0x2000), (16, 256), (28, 0xE48B_FF56), (508, 0x0AB1_6F30)];
            assert!(fixed.iter().all(|(at, value)| word(block, *at) == *value), "block {number}");
            assert_eq!((word(block, 20), word(block, 24)), (number as u32, 5));
            let address = word(block, 12);
            assert_eq!(address % 256, 0);
            let at = (address - 0x1000_0000) as usize;
            flash[at..at + 256].copy_from_slice(&block[32..288]);
        }
        assert_eq!(flash[0x80..0x80 + 1000], image);
        assert!(flash[..0x80].iter().chain(&flash[0x80 + 1000..]).all(|byte| *byte == 0));
    }

    #[test]
    fn gaps_are_filled_with_zeros() {
        // The first sector is empty up to its third page. Between the segments are ten pages.
        let file = of_image(&elf_of(&[(0x1000_2200, &[1; 256]), (0x1000_2d10, &[2; 8])])).unwrap();
        let blocks: Vec<&[u8]> = file.chunks(BLOCK).collect();
        assert_eq!(blocks.len(), 14);
        for (number, block) in blocks.iter().enumerate() {
            let address = 0x1000_2000 + number as u32 * 256;
            assert_eq!((word(block, 12), word(block, 20), word(block, 24)), (address, number as u32, 14));
            let sum: u32 = block[32..288].iter().map(|byte| u32::from(*byte)).sum();
            assert_eq!(sum, [(2, 256), (13, 16)].into_iter().find(|(at, _)| *at == number).map_or(0, |(_, sum)| sum));
        }
    }

    #[test]
    fn a_file_is_checked_block_by_block() {
        let file = of_image(&elf(0x1000_0000, &[1; 2000])).unwrap();
        assert!(is_uf2(&file) && !is_uf2(&elf(0x1000_0000, &[1; 8])));
        assert_eq!(check(&file), Ok(()));
        let refused = |file: &[u8], part: &str| {
            let error = check(file).unwrap_err();
            assert!(error.to_string().contains(part), "{part}: {error}");
        };
        refused(&[], "0 bytes");
        refused(&file[..file.len() - 1], "not a multiple");
        // A file that is cut off, or lacks its beginning, has other numbers than its blocks state.
        refused(&file[..file.len() - BLOCK], "block 0 of 7");
        refused(&file[BLOCK..], "block 0 of 7");
        for at in [0, 4, 8, 12, 16, 20, 24, 28, 508] {
            let mut changed = file.clone();
            changed[3 * BLOCK + at] ^= 0x20;
            refused(&changed, "block 3 of 8");
        }
        refused(&of_image(&elf(0x1000_0000, &[1; 8])).unwrap().repeat(2), "block 0 of 2");
        let mut elsewhere = file;
        elsewhere[15] = 0x20;
        refused(&elsewhere, "block 0 of 8");
    }

    #[test]
    fn images_for_other_chips_are_refused() {
        for (image, part) in [
            (b"no image".to_vec(), "not a 32-bit ELF"),
            (elf(0x0800_0000, &[1; 8]), "0x08000000, which is not in the flash"),
            (elf(0x10FF_FFFC, &[1; 8]), "not in the flash"),
            (elf(0x1000_0000, &[]), "nothing to write"),
        ] {
            let error = of_image(&image).unwrap_err();
            assert!(error.to_string().contains(part), "{part}: {error}");
        }
        let mut cut = elf(0x1000_0000, &[1; 64]);
        cut.truncate(100);
        assert_eq!(of_image(&cut), Err(Uf2Error::SegmentOutsideFile));
    }
}
