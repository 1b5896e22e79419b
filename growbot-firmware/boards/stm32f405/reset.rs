//! Why the board started, which boot this is, and the ways to an orderly end.

use core::arch::naked_asm;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;

use cortex_m::peripheral::SCB;
use growbot_core::link::message::ResetCause;
use stm32f4xx_hal::pac;

use crate::image::crash::{self, Moment};

/// Three words that survive a reset: nothing loads or clears this section.
#[unsafe(link_section = ".uninit.reset_notes")]
static NOTES: Notes = Notes(UnsafeCell::new(MaybeUninit::uninit()));

struct Notes(UnsafeCell<MaybeUninit<[u32; 3]>>);

// SAFETY: only reached through `read` and `write`, each a single access of a whole word.
unsafe impl Sync for Notes {}

/// Word 0: how the last boot ended.
const END: usize = 0;
/// Word 1: the boot id.
const BOOT: usize = 1;
/// Word 2: the complement of word 1, which shows whether both are a former boot's or chance.
const CHECK: usize = 2;

const FAULTED: u32 = 0x6E0F_E502;
const SAGGED: u32 = 0x6E0F_E503;
const OVERFLOWED: u32 = 0x6E0F_E504;
const CLOCK_FAILED: u32 = 0x6E0F_E505;

impl Notes {
    fn word(&self, index: usize) -> *mut u32 {
        self.0.get().cast::<u32>().wrapping_add(index % 3)
    }

    fn read(&self, index: usize) -> u32 {
        // SAFETY: one of the three words; RAM may be read before it was written.
        unsafe { self.word(index).read_volatile() }
    }

    fn write(&self, index: usize, value: u32) {
        // SAFETY: one of the three words, which only this file uses.
        unsafe { self.word(index).write_volatile(value) }
    }
}

/// Reads and clears the flags of the last reset and the note of the last boot. Call it once.
pub fn read_and_clear_cause(rcc: &pac::RCC) -> ResetCause {
    let flags = rcc.csr().read();
    rcc.csr().modify(|_, w| w.rmvf().set_bit());
    let end = NOTES.read(END);
    NOTES.write(END, 0);
    // A power-on sets the brown-out flag too, and every cause the pin's.
    if flags.porrstf().bit_is_set() {
        ResetCause::PowerOn
    } else if flags.borrstf().bit_is_set() || end == SAGGED {
        ResetCause::BrownOut
    } else if flags.wdgrstf().bit_is_set() || flags.wwdgrstf().bit_is_set() {
        ResetCause::Watchdog
    } else if end == OVERFLOWED {
        ResetCause::StackOverflow
    } else if end == CLOCK_FAILED {
        ResetCause::ClockFailed
    } else if end == FAULTED {
        ResetCause::ProcessorFault
    } else {
        ResetCause::External
    }
}

/// A number that tells this boot from the ones before. Call it once.
///
/// It counts up while RAM has power. After a loss of power it starts anew at what the cells came up with, which
/// differs from board to board and, in part, from time to time.
pub fn next_boot_id() -> u32 {
    let (boot, check) = (NOTES.read(BOOT), NOTES.read(CHECK));
    let next = if boot == !check { boot.wrapping_add(1) } else { boot.rotate_left(16) ^ check };
    NOTES.write(BOOT, next);
    NOTES.write(CHECK, !next);
    next
}

fn end(note: u32) -> ! {
    cortex_m::interrupt::disable();
    crate::pins::make_safe();
    NOTES.write(END, note);
    SCB::sys_reset()
}

/// The processor's supply sags: everything off, and a new start.
pub fn end_by_brown_out() -> ! {
    end(SAGGED)
}

/// The handler of unexpected interrupts: they are as bad as a fault of the processor.
#[unsafe(naked)]
#[unsafe(export_name = "DefaultHandler")]
extern "C" fn default_handler() -> ! {
    naked_asm!("b HardFault")
}

/// The crystal has stopped: everything off, and a new start.
pub fn end_by_clock_failure() -> ! {
    end(CLOCK_FAILED)
}

/// The stack is full, or the processor faulted for another reason.
pub fn on_crash(cause: ResetCause, moment: &Moment) -> ! {
    cortex_m::interrupt::disable();
    crate::pins::make_safe();
    // First what is surest to succeed.
    let note = if cause == ResetCause::StackOverflow { OVERFLOWED } else { FAULTED };
    NOTES.write(END, note);
    crash::retain(cause, NOTES.read(BOOT), moment);
    end(note)
}
