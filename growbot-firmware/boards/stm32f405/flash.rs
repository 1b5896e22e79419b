//! The flash of the robot's description (sectors 8 and 9 of the processor's own flash) and that of the journal (sectors
//! 10 and 11). Each sector has 128 KiB (reference manual RM0090, chapter 3).
//!
//! While flash is programmed or erased, neither data nor code can be read from it, so that the processor stalls. This
//! takes 16 us a word, 100 us at most, and up to 2 s a sector (data sheet DS8626, table "flash memory programming").
//! Interrupts are served between words. A function in RAM erases a sector. It feeds the watchdog while it waits, with
//! interrupts disabled, so that heater and steppers must be off. Programming of words needs a supply of 2.7 V, so the
//! flash is changed only while the detector of `brown_out.rs` reports enough voltage.
//!
//! (The flash of `stm32f4xx-hal` leaves panics in the firmware, writes bytes, and does not feed a watchdog.)

use core::ops::RangeInclusive;

use embedded_storage::nor_flash::NorFlashErrorKind;
use growbot_firmware::guarded_flash::GuardedFlash;
use stm32f4xx_hal::pac;

use crate::brown_out::PvdMonitor;
use crate::runtime::word_flash::{Word, WordFlash, WordNorFlash};

/// Numbers of the sectors that may be erased. The firmware is in the sectors before them.
const ERASABLE_SECTORS: RangeInclusive<usize> = 8..=11;
/// Length of a sector, bytes, for sector 5 and all later sectors.
const SECTOR_BYTES: usize = 128 * 1024;
/// Address of sector 5.
const SECTOR_5: usize = 0x0802_0000;

/// Keys that unlock the flash's control register. In any other order they lock it until the next reset.
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];
/// Bit of the flash's control register: starts an erasure (STRT).
const START: u32 = 1 << 16;
/// Bit of the flash's status register: a write or erasure is in progress (BSY).
const BUSY: u32 = 1 << 16;
/// Bits of the flash's status register: all errors (PGSERR, PGPERR, PGAERR, WRPERR, OPERR), which are cleared by
/// writing ones.
const ERRORS: u32 = 0xF2;
/// Address of the watchdog's key register. `FEED` is the key that feeds the watchdog.
const WATCHDOG_KEY: *mut u32 = 0x4000_3000 as *mut u32;
const FEED: u32 = 0xAAAA;
/// Number of checks of a running erasure after which the code stops feeding the watchdog, which then resets the board.
/// The checks take more than 3 s, with at least 12 clocks a check.
const MAX_LOOKS: u32 = 45_000_000;

unsafe extern "C" {
    /// Beginning of the description's flash in the memory map. This symbol and the next ones mark the beginning and the
    /// end of the flash of description and journal. Only their addresses are used.
    static _description_start: u32;
    static _description_end: u32;
    static _journal_start: u32;
    static _journal_end: u32;
}

/// Flash that is changed only while the processor's supply is high enough.
pub type SuppliedFlash = GuardedFlash<WordNorFlash<Stm32Flash>, PvdMonitor>;

/// One of the two flash areas: that of the robot's description, or that of the journal.
pub struct Stm32Flash {
    registers: pac::FLASH,
    start: *mut u32,
    bytes: usize,
}

// SAFETY: the address is one of flash, which is the same from every context.
unsafe impl Send for Stm32Flash {}

impl Stm32Flash {
    /// Returns the flash area of the robot's description, and that of the journal. The clocks must have been set up.
    pub fn parts(registers: pac::FLASH) -> [SuppliedFlash; 2] {
        // SAFETY: the controller alone uses both, one after the other.
        let other = unsafe { pac::FLASH::steal() };
        [
            Self::between(registers, &raw const _description_start, &raw const _description_end),
            Self::between(other, &raw const _journal_start, &raw const _journal_end),
        ]
    }

    fn between(registers: pac::FLASH, start: *const u32, end: *const u32) -> SuppliedFlash {
        let bytes = (end as usize).wrapping_sub(start as usize);
        SuppliedFlash::new(WordNorFlash(Self { registers, start: start.cast_mut(), bytes }), PvdMonitor)
    }

    /// Returns the address of the byte at an offset of this flash area.
    fn address(&self, offset: usize) -> *mut u32 {
        self.start.wrapping_byte_add(offset)
    }

    /// Calls `work` with the flash's control register unlocked. Returns an error if the work fails.
    fn unlocked(&mut self, work: impl FnOnce(&pac::FLASH) -> bool) -> Result<(), NorFlashErrorKind> {
        let registers = &self.registers;
        for key in KEYS {
            // SAFETY: the keys of the reference manual.
            registers.keyr().write(|w| unsafe { w.key().bits(key) });
        }
        // SAFETY: clears earlier errors.
        registers.sr().write(|w| unsafe { w.bits(ERRORS) });
        let is_done = registers.cr().read().lock().bit_is_clear() && work(registers);
        // All other bits are cleared.
        registers.cr().write(|w| w.lock().set_bit());
        // The data cache may have old content. It can be reset while it is off.
        registers.acr().modify(|_, w| w.dcen().clear_bit());
        registers.acr().modify(|_, w| w.dcrst().set_bit());
        registers.acr().modify(|_, w| w.dcrst().clear_bit().dcen().set_bit());
        if is_done { Ok(()) } else { Err(NorFlashErrorKind::Other) }
    }
}

/// Returns whether the last write or erasure has ended without an error. Call it only after its end.
fn went_well(registers: &pac::FLASH) -> bool {
    registers.sr().read().bits() & ERRORS == 0
}

/// Programs the word at an address. Returns whether this succeeded.
fn program(registers: &pac::FLASH, address: *mut u32, word: u32) -> bool {
    // SAFETY: an aligned word of this flash, of which Rust code owns nothing.
    unsafe { address.write_volatile(word) };
    cortex_m::asm::dsb();
    while registers.sr().read().bits() & BUSY != 0 {}
    went_well(registers)
}

/// Starts the erasure that the flash's control register describes, and waits for its end. The function is in RAM, and
/// all functions that it calls are inlined.
///
/// # Safety
///
/// The control register must be unlocked and must select the sector.
#[inline(never)]
#[unsafe(link_section = ".data.erase")]
unsafe fn erase(status: *const u32, control: *mut u32, start: u32) {
    // SAFETY: registers of the flash, and of the watchdog, which may be fed at any time.
    unsafe {
        control.write_volatile(start);
        // The write may not have arrived when the status is read. The status would then show that the erasure is over.
        // (`cortex_m::asm::dsb` is not used, because it might not be inlined.)
        core::arch::asm!("dsb", options(nostack, preserves_flags));
        let mut looks = 0;
        while status.read_volatile() & BUSY != 0 {
            if looks < MAX_LOOKS {
                looks += 1;
                WATCHDOG_KEY.write_volatile(FEED);
            }
        }
    }
}

impl WordFlash for Stm32Flash {
    const SECTOR_BYTES: usize = SECTOR_BYTES;

    fn capacity(&self) -> usize {
        self.bytes
    }

    fn read(&self, offset: usize) -> u32 {
        // SAFETY: an aligned word of this flash, of which Rust code owns nothing.
        unsafe { self.address(offset).read_volatile() }
    }

    fn erase(&mut self, sector: usize) -> Result<(), NorFlashErrorKind> {
        let number = (self.address(sector * SECTOR_BYTES) as usize).wrapping_sub(SECTOR_5) / SECTOR_BYTES + 5;
        if !ERASABLE_SECTORS.contains(&number) {
            return Err(NorFlashErrorKind::OutOfBounds);
        }
        self.unlocked(|registers| {
            // SAFETY: a sector that may be erased.
            registers.cr().modify(|_, w| unsafe { w.ser().set_bit().psize().psize32().snb().bits(number as u8) });
            let start = registers.cr().read().bits() | START;
            cortex_m::interrupt::free(|_| {
                // SAFETY: the control register is unlocked and selects the sector.
                unsafe { erase(registers.sr().as_ptr(), registers.cr().as_ptr(), start) }
            });
            went_well(registers)
        })
    }

    fn program(&mut self, mut words: impl Iterator<Item = Word>) -> Result<(), NorFlashErrorKind> {
        let start = self.start;
        self.unlocked(|registers| {
            registers.cr().modify(|_, w| w.pg().set_bit().psize().psize32());
            words.all(|Word { offset, value }| program(registers, start.wrapping_byte_add(offset), value))
        })
    }
}
