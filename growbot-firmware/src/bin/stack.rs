//! The stack: where it ends, how much of it was ever used, and what happens when it overflows.
//!
//! It lies where there is no memory below it (`memory/*.x`), so that an overflow faults before it harms anything.

use core::arch::naked_asm;

unsafe extern "C" {
    /// The linker's: the lowest word of the stack.
    static _stack_end: u32;
}

/// A fault that leaves less than this of the stack, or none, is an overflow: more than any one push, or the exception's own frame, takes.
const LITTLE: usize = 256;

/// Address of the lowest word of the stack.
pub fn bottom() -> usize {
    &raw const _stack_end as usize
}

/// The processor's faults come here. The stack pointer may point anywhere: the stack begins anew, before anything needs it, and what the
/// processor still owes to the old one (the floating-point registers, by FPCCR.LSPACT) is let go.
#[unsafe(naked)]
#[unsafe(export_name = "HardFault")]
extern "C" fn hard_fault() -> ! {
    naked_asm!(
        "mrs r0, msp",
        "movw r1, #:lower16:_stack_start",
        "movt r1, #:upper16:_stack_start",
        "msr msp, r1",
        "movw r1, #0xEF34",
        "movt r1, #0xE000",
        "ldr r2, [r1]",
        "bic r2, r2, #1",
        "str r2, [r1]",
        "b {on_fault}",
        on_fault = sym on_fault,
    )
}

extern "C" fn on_fault(stack_pointer: usize) -> ! {
    if stack_pointer < bottom() + LITTLE { crate::reset::on_stack_overflow() } else { crate::reset::on_fault() }
}
