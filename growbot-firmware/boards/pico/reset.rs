//! The cause of the board's start, the boot identifier, and orderly resets.

use core::arch::naked_asm;
use core::cell::UnsafeCell;
use core::mem::MaybeUninit;

use growbot_core::link::message::ResetCause;
use rp2040_pac as pac;

use crate::runtime::crash::{self, ExceptionContext};

/// Notes for the next boot: three words that survive a reset, because no code loads or clears this section.
#[unsafe(link_section = ".uninit.reset_notes")]
static NOTES: Rp2040ResetNotes = Rp2040ResetNotes(UnsafeCell::new(MaybeUninit::uninit()));

struct Rp2040ResetNotes(UnsafeCell<MaybeUninit<[u32; 3]>>);

// SAFETY: accessed only through `read` and `write`, each a single access of a whole word.
unsafe impl Sync for Rp2040ResetNotes {}

/// Index of the note that records how the last boot ended.
const END: usize = 0;
/// Index of the note that contains the boot identifier.
const BOOT: usize = 1;
/// Index of the note that contains the complement of the boot identifier. It shows whether both words are from an
/// earlier boot or random.
const CHECK: usize = 2;

const FAULTED: u32 = 0x6E0F_E502;
const OVERFLOWED: u32 = 0x6E0F_E504;
const CLOCK_FAILED: u32 = 0x6E0F_E505;

impl Rp2040ResetNotes {
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

/// Flag of the reset register: the power was switched on, or the detector of the core's supply has caused a reset.
const HAD_POWER_ON: u32 = 1 << 8;
/// Bit of the watchdog's reason register: the watchdog was not fed in time. Any other bit means that the firmware
/// requested a reset.
const TIMED_OUT: u32 = 1;

/// Returns the cause of the board's start, from the flags of the last reset and the note of the last boot. Call it
/// once, because it clears the note.
pub fn read_and_clear_cause(device: &pac::Peripherals) -> ResetCause {
    let reason = device.WATCHDOG.reason().read().bits();
    let power_on = device.VREG_AND_CHIP_RESET.chip_reset().read().bits() & HAD_POWER_ON != 0;
    let end = NOTES.read(END);
    NOTES.write(END, 0);
    // The flag of the power stays set over resets by the watchdog.
    if reason & TIMED_OUT != 0 {
        ResetCause::Watchdog
    } else if reason != 0 && end == OVERFLOWED {
        ResetCause::StackOverflow
    } else if reason != 0 && end == CLOCK_FAILED {
        ResetCause::ClockFailed
    } else if reason != 0 && end == FAULTED {
        ResetCause::ProcessorFault
    } else if reason == 0 && power_on {
        ResetCause::PowerOn
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

/// Resets the whole board except its oscillators. A reset of the processor alone would leave its outputs unchanged.
pub fn restart() -> ! {
    // SAFETY: the bit that triggers the watchdog's reset.
    unsafe { (*pac::WATCHDOG::ptr()).ctrl().write(|w| w.bits(1 << 31)) };
    loop {
        cortex_m::asm::nop();
    }
}

/// Switches everything off and resets the board after the crystal has stopped. The next start then waits for the
/// crystal. The function does not use the flash, which may be busy (`memory/pico.x`).
#[inline(never)] // It is not inlined into the step interrupt, which seldom needs it.
pub fn reset_on_clock_failure() -> ! {
    cortex_m::interrupt::disable();
    crate::pins::make_safe();
    NOTES.write(END, CLOCK_FAILED);
    restart()
}

/// Handler of unexpected interrupts. They are treated like a fault of the processor.
#[unsafe(naked)]
#[unsafe(export_name = "DefaultHandler")]
extern "C" fn default_handler() -> ! {
    naked_asm!("ldr r0, 1f", "bx r0", ".balign 4", "1: .word HardFault")
}

/// Makes the outputs safe, records the crash and resets the board. Called after a stack overflow or another fault of
/// the processor.
pub fn reset_on_crash(cause: ResetCause, moment: &ExceptionContext) -> ! {
    cortex_m::interrupt::disable();
    crate::pins::make_safe();
    // The step that is most certain to succeed comes first.
    let note = if cause == ResetCause::StackOverflow { OVERFLOWED } else { FAULTED };
    NOTES.write(END, note);
    crash::retain(cause, NOTES.read(BOOT), moment);
    restart()
}
