//! Orderly resets of the board. Each first makes the outputs safe, then stores a note of the cause for the next boot,
//! then resets the board.

use core::arch::naked_asm;
use core::mem::MaybeUninit;

use cortex_m::peripheral::SCB;
use growbot_core::link::message::ResetCause;
use growbot_firmware::emulated_tip;

use crate::registers::Register;
use crate::runtime::crash::{self, ExceptionContext};
use crate::tip::{self, Boot};

/// Note of the cause of a reset. It survives the reset, because no code loads or clears this section.
#[unsafe(link_section = ".uninit.reset_note")]
static NOTE: NoteCell = NoteCell(core::cell::UnsafeCell::new(MaybeUninit::uninit()));

struct NoteCell(core::cell::UnsafeCell<MaybeUninit<u32>>);

// SAFETY: accessed only through `note`, which reads and writes it as a whole.
unsafe impl Sync for NoteCell {}

/// Mark of a valid note, which random memory is unlikely to contain. The low byte of a note is a `RESET_*` of
/// `emulated_tip`.
const NOTE_MARK: u32 = 0x6E0F_E500;
const FAULTED: u32 = emulated_tip::RESET_FAULT;
const OVERFLOWED: u32 = emulated_tip::RESET_STACK_OVERFLOW;

fn note() -> Register {
    // SAFETY: an aligned word that only the reads and writes of this file access.
    unsafe { Register::at(NOTE.0.get() as usize) }
}

/// Returns the cause of the board's start, as a `RESET_*` of `emulated_tip`. Call it once, because it clears the note.
pub fn read_and_clear_cause(boot: Boot) -> u32 {
    let left = note().read();
    note().write(0);
    if boot == Boot::Cold {
        emulated_tip::RESET_POWER_ON
    } else if left & !0xFF == NOTE_MARK {
        left & 0xFF
    } else {
        emulated_tip::RESET_EXTERNAL
    }
}

/// Converts a `RESET_*` of `emulated_tip` to the reset cause that the link's messages contain.
pub fn named(cause: u32) -> ResetCause {
    match cause {
        emulated_tip::RESET_POWER_ON => ResetCause::PowerOn,
        emulated_tip::RESET_WATCHDOG => ResetCause::Watchdog,
        emulated_tip::RESET_FAULT => ResetCause::ProcessorFault,
        emulated_tip::RESET_STACK_OVERFLOW => ResetCause::StackOverflow,
        _ => ResetCause::External,
    }
}

/// Makes the outputs safe, records the crash and resets the board. Called after a stack overflow or another fault of
/// the processor.
pub fn reset_on_crash(cause: ResetCause, moment: &ExceptionContext) -> ! {
    cortex_m::interrupt::disable();
    tip::make_safe();
    // The step that is most certain to succeed comes first.
    note().write(NOTE_MARK | if cause == ResetCause::StackOverflow { OVERFLOWED } else { FAULTED });
    crash::retain(cause, tip::boot_id(), moment);
    SCB::sys_reset()
}

/// Handler of the non-maskable interrupt: the first expiry of the watchdog.
#[unsafe(naked)]
#[unsafe(export_name = "NonMaskableInt")]
extern "C" fn non_maskable() -> ! {
    naked_asm!("mrs r0, msp", "mov r1, lr", "b {on_expiry}", on_expiry = sym on_expiry)
}

/// Makes the outputs safe and records the crash after the first expiry of the watchdog. The interrupt stays pending, so
/// that the second expiry resets the board even if this function could not do its work.
extern "C" fn on_expiry(stack_pointer: usize, exc_return: u32) -> ! {
    tip::make_safe();
    note().write(NOTE_MARK | emulated_tip::RESET_WATCHDOG);
    crash::retain(ResetCause::Watchdog, tip::boot_id(), &ExceptionContext { stack_pointer, exc_return });
    loop {
        cortex_m::asm::nop();
    }
}
