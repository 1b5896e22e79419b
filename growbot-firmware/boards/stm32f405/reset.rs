//! The cause of the board's start, the boot identifier, and orderly resets.

use core::arch::naked_asm;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;

use cortex_m::peripheral::SCB;
use growbot_core::link::message::ResetCause;
use stm32f4xx_hal::pac;

use crate::runtime::crash::{self, ExceptionContext};

/// Notes for the next boot: three words that survive a reset, because no code loads or clears this section.
#[unsafe(link_section = ".uninit.reset_notes")]
static NOTES: Stm32ResetNotes = Stm32ResetNotes(UnsafeCell::new(MaybeUninit::uninit()));

struct Stm32ResetNotes(UnsafeCell<MaybeUninit<[u32; 3]>>);

// SAFETY: accessed only through `read` and `write`, each a single access of a whole word.
unsafe impl Sync for Stm32ResetNotes {}

/// Index of the note that records how the last boot ended.
const END: usize = 0;
/// Index of the note that contains the boot identifier.
const BOOT: usize = 1;
/// Index of the note that contains the complement of the boot identifier. It shows whether both words are from an
/// earlier boot or random.
const CHECK: usize = 2;

const FAULTED: u32 = 0x6E0F_E502;
const SAGGED: u32 = 0x6E0F_E503;
const OVERFLOWED: u32 = 0x6E0F_E504;
const CLOCK_FAILED: u32 = 0x6E0F_E505;

impl Stm32ResetNotes {
    fn word(&self, index: usize) -> *mut u32 {
        self.0.get().cast::<u32>().wrapping_add(index % 3)
    }

    fn read(&self, index: usize) -> u32 {
        // SAFETY: one of the three words. RAM may be read before it was written.
        unsafe { self.word(index).read_volatile() }
    }

    fn write(&self, index: usize, value: u32) {
        // SAFETY: one of the three words, which only this file uses.
        unsafe { self.word(index).write_volatile(value) }
    }
}

/// Returns the cause of the board's start, from the flags of the last reset and the note of the last boot. Call it
/// once, because it clears both.
pub fn read_and_clear_cause(rcc: &pac::RCC) -> ResetCause {
    let flags = rcc.csr().read();
    rcc.csr().modify(|_, w| w.rmvf().set_bit());
    let end = NOTES.read(END);
    NOTES.write(END, 0);
    // A power-on also sets the brown-out flag, and every cause sets the pin's flag.
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

/// Returns a boot identifier that differs from those of earlier boots. Call it once.
///
/// The identifier counts up while RAM has power. After a loss of power it starts from the random content of the cells,
/// which differs from board to board and, in part, from time to time.
pub fn next_boot_id() -> u32 {
    let (boot, check) = (NOTES.read(BOOT), NOTES.read(CHECK));
    let next = if boot == !check { boot.wrapping_add(1) } else { boot.rotate_left(16) ^ check };
    NOTES.write(BOOT, next);
    NOTES.write(CHECK, !next);
    next
}

fn end(note: u32) -> ! {
    cortex_m::interrupt::disable();
    crate::outputs::make_safe();
    NOTES.write(END, note);
    SCB::sys_reset()
}

/// Switches everything off and resets the board, because the processor's supply sags.
pub fn reset_on_brown_out() -> ! {
    end(SAGGED)
}

/// Handler of unexpected interrupts. They are treated like a fault of the processor.
#[unsafe(naked)]
#[unsafe(export_name = "DefaultHandler")]
extern "C" fn default_handler() -> ! {
    naked_asm!("b HardFault")
}

/// Switches everything off and resets the board, because the crystal has stopped.
pub fn reset_on_clock_failure() -> ! {
    end(CLOCK_FAILED)
}

/// Makes the outputs safe, records the crash and resets the board. Called after a stack overflow or another fault of
/// the processor.
pub fn reset_on_crash(cause: ResetCause, moment: &ExceptionContext) -> ! {
    cortex_m::interrupt::disable();
    crate::outputs::make_safe();
    // The step that is most certain to succeed comes first.
    let note = if cause == ResetCause::StackOverflow { OVERFLOWED } else { FAULTED };
    NOTES.write(END, note);
    crash::retain(cause, NOTES.read(BOOT), moment);
    end(note)
}
