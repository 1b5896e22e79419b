//! The flash of the robot's description and that of the journal: 256 KiB each at the end of the flash chip from which
//! the firmware runs. Functions of the boot ROM erase and program them (data sheet of the RP2040, 2.8.3).
//!
//! While the flash is erased or programmed it cannot be read, and no code in it can run. This code therefore runs in
//! RAM, and so do the interrupts and all functions that they call, which continue. The main loop waits: 0.4 ms for a
//! page, 3 ms at most, and 0.5 s for a sector, which is erased between jobs only. A block of 32 KiB takes 120 ms of
//! that, 1.6 s at most (data sheet of the W25Q16JV, 9.6), which is less than the watchdog's timeout. A fault of the
//! processor finds no handler in this time. In that case the watchdog resets the board.

use embedded_storage::nor_flash::NorFlashErrorKind;

use crate::runtime::word_flash::{Word, WordFlash, WordNorFlash};

/// Length of a sector, bytes. `BLOCK_BYTES` is the length of a block that is erased at once, and `ERASE_BLOCK` the
/// command for it.
const SECTOR_BYTES: usize = 128 * 1024;
const BLOCK_BYTES: usize = 32 * 1024;
const ERASE_BLOCK: u32 = 0x52;
/// Length of a page, which is programmed at once, bytes. Cells that are programmed with a one do not change.
const PAGE_BYTES: usize = 256;
const PAGE_WORDS: usize = PAGE_BYTES / 4;
/// Address at which the flash chip is mapped.
const MAPPED: usize = 0x1000_0000;
/// Address of the 16-bit pointer to the boot ROM's table of functions. `ROM_SEARCH` is that of the pointer to the
/// function that searches the table.
const ROM_TABLE: *const u16 = 0x14 as *const u16;
const ROM_SEARCH: *const u16 = 0x18 as *const u16;

unsafe extern "C" {
    /// Beginning of the description's flash in the memory map. This symbol and the next ones mark the beginning and the
    /// end of the flash of description and journal. Only their addresses are used.
    static _description_start: u32;
    static _description_end: u32;
    static _journal_start: u32;
    static _journal_end: u32;
}

/// One of the two flash areas: that of the robot's description, or that of the journal.
pub type FlashPartition = WordNorFlash<Rp2040Flash>;

type Plain = unsafe extern "C" fn();
type Erase = unsafe extern "C" fn(offset: u32, bytes: usize, block: u32, command: u32);
type Program = unsafe extern "C" fn(offset: u32, data: *const u32, bytes: usize);

/// The functions of the boot ROM that change the flash.
#[derive(Clone, Copy)]
struct Rom {
    connect: Plain,
    exit_execution: Plain,
    erase: Erase,
    program: Program,
    flush: Plain,
}

/// A flash area, a copy of the second-stage loader in RAM, and the buffer of the page to be programmed.
pub struct Rp2040Flash {
    rom: Option<Rom>,
    loader: [u32; PAGE_WORDS],
    page: [u32; PAGE_WORDS],
    start: *const u32,
    bytes: usize,
}

/// Returns the address of a function of the boot ROM. `None` if the boot ROM has no function with this name.
fn search(name: [u8; 2]) -> Option<usize> {
    // SAFETY: the boot ROM has the addresses of its table and of a function of this type there.
    unsafe {
        let table = ROM_TABLE.read_volatile() as usize as *const u16;
        let function = ROM_SEARCH.read_volatile() as usize;
        if function == 0 {
            return None;
        }
        let function: extern "C" fn(*const u16, u32) -> usize = core::mem::transmute(function);
        let found = function(table, u32::from(u16::from_le_bytes(name)));
        (found != 0).then_some(found)
    }
}

impl Rom {
    fn find() -> Option<Self> {
        let [connect, exit_execution, erase, program, flush] =
            [search(*b"IF")?, search(*b"EX")?, search(*b"RE")?, search(*b"RP")?, search(*b"FC")?];
        // SAFETY: functions of these types, according to the data sheet's table.
        unsafe {
            Some(Rom {
                connect: core::mem::transmute::<usize, Plain>(connect),
                exit_execution: core::mem::transmute::<usize, Plain>(exit_execution),
                erase: core::mem::transmute::<usize, Erase>(erase),
                program: core::mem::transmute::<usize, Program>(program),
                flush: core::mem::transmute::<usize, Plain>(flush),
            })
        }
    }
}

/// Erases a block if `page` is null, otherwise programs a page. This function is in RAM, and all functions that it
/// calls are in RAM or in the boot ROM.
///
/// # Safety
///
/// The offset must be in a part of the flash that may be changed, and interrupts must not use the flash.
#[inline(never)]
#[unsafe(link_section = ".data.change")]
unsafe fn change(rom: &Rom, loader: *const u32, offset: u32, page: *const u32) {
    // SAFETY: the order of the data sheet. The loader, thumb code of 252 bytes, returns to its caller.
    unsafe {
        (rom.connect)();
        (rom.exit_execution)();
        if page.is_null() {
            (rom.erase)(offset, BLOCK_BYTES, BLOCK_BYTES as u32, ERASE_BLOCK);
        } else {
            (rom.program)(offset, page, PAGE_BYTES);
        }
        (rom.flush)();
        let restore: Plain = core::mem::transmute(loader.wrapping_byte_add(1));
        restore();
    }
}

impl Rp2040Flash {
    /// Returns the flash area of the robot's description.
    pub fn of_description() -> FlashPartition {
        WordNorFlash(Self::between(&raw const _description_start, &raw const _description_end))
    }

    /// Returns the flash area of the journal.
    pub fn of_journal() -> FlashPartition {
        WordNorFlash(Self::between(&raw const _journal_start, &raw const _journal_end))
    }

    fn between(start: *const u32, end: *const u32) -> Self {
        // SAFETY: the flash begins with the loader, which is only read.
        let loader =
            core::array::from_fn(|index| unsafe { (MAPPED as *const u32).wrapping_add(index).read_volatile() });
        let bytes = (end as usize).wrapping_sub(start as usize);
        Self { rom: Rom::find(), loader, page: [u32::MAX; PAGE_WORDS], start, bytes }
    }

    /// Returns the address of the byte at an offset of this flash area.
    fn address(&self, offset: usize) -> *const u32 {
        self.start.wrapping_byte_add(offset)
    }

    /// Erases the block at an offset of this flash area if `page` is `None`. Otherwise programs the page buffer there.
    fn change(&mut self, offset: usize, page: Option<()>) -> Result<(), NorFlashErrorKind> {
        let rom = self.rom.ok_or(NorFlashErrorKind::Other)?;
        if offset >= self.capacity() {
            return Err(NorFlashErrorKind::OutOfBounds);
        }
        let place = (self.address(offset) as usize).wrapping_sub(MAPPED) as u32;
        let page = page.map_or(core::ptr::null(), |()| self.page.as_ptr());
        crate::watchdog::feed();
        // SAFETY: within this part. All code and data that the interrupts need are in memory (`memory/pico.x`).
        unsafe { change(&rom, self.loader.as_ptr(), place, page) };
        Ok(())
    }

    /// Programs the content of the page buffer to an offset of this flash area, and clears the buffer.
    fn program_page(&mut self, offset: usize) -> Result<(), NorFlashErrorKind> {
        let done = self.change(offset, Some(()));
        self.page = [u32::MAX; PAGE_WORDS];
        done
    }
}

impl WordFlash for Rp2040Flash {
    const SECTOR_BYTES: usize = SECTOR_BYTES;

    fn capacity(&self) -> usize {
        self.bytes
    }

    fn read(&self, offset: usize) -> u32 {
        // SAFETY: an aligned word of this flash, of which Rust code owns nothing.
        unsafe { self.address(offset).read_volatile() }
    }

    fn erase(&mut self, sector: usize) -> Result<(), NorFlashErrorKind> {
        let from = sector.wrapping_mul(SECTOR_BYTES);
        (0..SECTOR_BYTES / BLOCK_BYTES).try_for_each(|block| self.change(from + block * BLOCK_BYTES, None))
    }

    fn program(&mut self, words: impl Iterator<Item = Word>) -> Result<(), NorFlashErrorKind> {
        let mut under_way = None;
        for Word { offset, value } in words {
            let page = offset - offset % PAGE_BYTES;
            if let Some(before) = under_way.filter(|before| *before != page) {
                self.program_page(before)?;
            }
            under_way = Some(page);
            if let Some(word) = self.page.get_mut(offset % PAGE_BYTES / 4) {
                *word = value;
            }
        }
        under_way.map_or(Ok(()), |page| self.program_page(page))
    }
}
