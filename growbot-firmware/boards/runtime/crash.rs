//! The record of the latest crash, in RAM that is not cleared at start-up. The handler of the processor's faults writes
//! it, and the next start reads it.

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;

use growbot_core::link::crash::{CrashWords, cause_code};
use growbot_core::link::message::ResetCause;
use growbot_firmware::safety::crash::{MemoryLayout, RETAINED_WORDS, decode, encode};

use super::{seal, stack};

/// Words of the crash record, which survive a reset, because no code loads or clears this section.
#[unsafe(link_section = ".uninit.crash")]
static WORDS: CrashWordsCell = CrashWordsCell(UnsafeCell::new(MaybeUninit::uninit()));

struct CrashWordsCell(UnsafeCell<MaybeUninit<[u32; RETAINED_WORDS]>>);

unsafe extern "C" {
    /// Linker symbol at the beginning of the program's code in flash. `__etext` is at its end. Only their addresses are
    /// used.
    static __stext: u32;
    static __etext: u32;
}

// SAFETY: accessed only word by word, at the start of the board and by the handler that ends the program.
unsafe impl Sync for CrashWordsCell {}

/// Register ICSR of the system control block: interrupt control and state (ARMv7-M, B3.2). The next constants are the
/// registers of the fault status and of the fault addresses.
const ICSR: *const u32 = 0xE000_ED04 as *const u32;
#[cfg(not(feature = "pico"))]
const CFSR: *const u32 = 0xE000_ED28 as *const u32;
#[cfg(not(feature = "pico"))]
const HFSR: *const u32 = 0xE000_ED2C as *const u32;
#[cfg(not(feature = "pico"))]
const MMFAR: *const u32 = 0xE000_ED34 as *const u32;
#[cfg(not(feature = "pico"))]
const BFAR: *const u32 = 0xE000_ED38 as *const u32;

/// Values of two registers at the entry of an exception handler.
pub struct ExceptionContext {
    /// The stack pointer.
    pub stack_pointer: usize,
    /// The link register, which contains EXC_RETURN.
    pub exc_return: u32,
}

fn word(index: usize) -> *mut u32 {
    WORDS.0.get().cast::<u32>().wrapping_add(index % RETAINED_WORDS)
}

/// Returns the word of the stack at an address, or 0 if the address is outside of the stack.
fn stack_word(address: u32) -> u32 {
    let at = address as usize;
    let within = at >= stack::bottom() && at < stack::top() && at.is_multiple_of(4);
    // SAFETY: an aligned word of the stack, which is memory from its bottom to its top. It is only read.
    if within { unsafe { (at as *const u32).read_volatile() } } else { 0 }
}

/// Returns the registers with which the processor describes a fault: CFSR, HFSR, MMFAR and BFAR.
#[cfg(not(feature = "pico"))]
fn fault_registers() -> [u32; 4] {
    // SAFETY: every Cortex-M4 has these registers, and they may be read at any time.
    [CFSR, HFSR, MMFAR, BFAR].map(|register| unsafe { register.read_volatile() })
}

/// Returns zeros, because a processor of ARMv6-M has no registers that describe a fault.
#[cfg(feature = "pico")]
fn fault_registers() -> [u32; 4] {
    [0; 4]
}

/// Writes the crash record, with the present state of the processor. The handler of an exception that does not return
/// calls this.
#[inline(never)]
pub fn retain(cause: ResetCause, boot_id: u32, moment: &ExceptionContext) {
    // SAFETY: every Cortex-M has this register, and it may be read at any time.
    let icsr = unsafe { ICSR.read_volatile() };
    let [cfsr, hfsr, mmfar, bfar] = fault_registers();
    let what = cause_code(cause) | (icsr & 0x1FF) << 16;
    let sp = moment.stack_pointer as u32;
    let head = [what, boot_id, seal::stated(), sp, moment.exc_return, cfsr, hfsr, mmfar, bfar];
    let places = MemoryLayout {
        stack: stack::bottom() as u32..stack::top() as u32,
        code: &raw const __stext as u32..&raw const __etext as u32,
    };
    for (index, value) in encode(&head, &places, stack_word).into_iter().enumerate() {
        // SAFETY: one of the words. No other code runs, because this is the handler of an exception that ends the
        // program.
        unsafe { word(index).write_volatile(value) }
    }
    cortex_m::asm::dsb();
}

/// Returns the latest crash from the crash record. `None` if the memory has no valid record.
pub fn latest() -> Option<CrashWords> {
    // SAFETY: aligned words. RAM may be read before it was written.
    decode(&core::array::from_fn(|index| unsafe { word(index).read_volatile() }))
}
