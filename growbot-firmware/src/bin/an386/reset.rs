//! Ways to an orderly end: each first makes the tip safe, then leaves a note for the next boot, then resets.

use core::mem::MaybeUninit;

use cortex_m::peripheral::SCB;
use cortex_m_rt::exception;
use growbot_core::link::message::ResetCause;
use growbot_firmware::emulated_tip;

use crate::registers::Register;
use crate::tip;

/// Survives a reset: nothing loads or clears this section.
#[unsafe(link_section = ".uninit.reset_note")]
static NOTE: NoteCell = NoteCell(core::cell::UnsafeCell::new(MaybeUninit::uninit()));

struct NoteCell(core::cell::UnsafeCell<MaybeUninit<u32>>);

// SAFETY: only reached through `note`, which reads and writes it whole.
unsafe impl Sync for NoteCell {}

/// Makes a note that is there by chance unlikely; the low byte is a `RESET_*` of the tip's table.
const NOTE_MARK: u32 = 0x6E0F_E500;

fn note() -> Register {
    // SAFETY: an aligned word that nothing but this file's reads and writes reaches.
    unsafe { Register::at(NOTE.0.get() as usize) }
}

/// Why the board started, as a `RESET_*` of the tip's table. Call it once: it takes the note away.
pub fn take_cause(first_boot: bool) -> u32 {
    let left = note().read();
    note().write(0);
    if first_boot {
        emulated_tip::RESET_POWER_ON
    } else if left & !0xFF == NOTE_MARK {
        left & 0xFF
    } else {
        emulated_tip::RESET_EXTERNAL
    }
}

/// A `RESET_*` of the tip's table as the link names it.
pub fn named(cause: u32) -> ResetCause {
    match cause {
        emulated_tip::RESET_POWER_ON => ResetCause::PowerOn,
        emulated_tip::RESET_WATCHDOG => ResetCause::Watchdog,
        emulated_tip::RESET_FAULT => ResetCause::ProcessorFault,
        emulated_tip::RESET_STACK_OVERFLOW => ResetCause::StackOverflow,
        _ => ResetCause::External,
    }
}

fn end(cause: u32) -> ! {
    cortex_m::interrupt::disable();
    tip::make_safe();
    note().write(NOTE_MARK | cause);
    SCB::sys_reset()
}

/// The stack is full.
pub fn on_stack_overflow() -> ! {
    end(emulated_tip::RESET_STACK_OVERFLOW)
}

/// The processor faulted for another reason.
pub fn on_fault() -> ! {
    end(emulated_tip::RESET_FAULT)
}

/// The watchdog's first expiry. It is left pending, so that the second one resets the board even if this handler could not.
#[exception]
unsafe fn NonMaskableInt() {
    tip::make_safe();
    note().write(NOTE_MARK | emulated_tip::RESET_WATCHDOG);
    loop {
        cortex_m::asm::nop();
    }
}
