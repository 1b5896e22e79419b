//! The stack: where it ends, and what happens when it overflows or the processor faults otherwise.
//!
//! It lies where there is no memory below it (`memory/*.x`), so that an overflow faults before it harms anything.

use core::arch::naked_asm;

use growbot_core::link::message::ResetCause;

use super::crash::Moment;

unsafe extern "C" {
    /// The linker's: the lowest word of the stack.
    static _stack_end: u32;
    /// The linker's: the end of the stack, above its highest word.
    static _stack_start: u32;
}

/// A fault that leaves less of the stack than this is an overflow, bytes. No push, no exception's frame and nothing
/// that follows here takes as much.
const LITTLE: usize = 512;

/// Address of the lowest word of the stack.
pub fn bottom() -> usize {
    &raw const _stack_end as usize
}

/// Address of the end of the stack.
pub fn top() -> usize {
    &raw const _stack_start as usize
}

/// The handler of the processor's faults. The stack pointer may point anywhere. If it leaves too little of the stack,
/// it is set to the top before anything uses the stack. Else it stays, so that the crash record can have what was on
/// the stack. The floating-point registers that the processor has not saved yet (FPCCR.LSPACT) are dropped.
#[cfg(not(feature = "pico"))]
#[unsafe(naked)]
#[unsafe(export_name = "HardFault")]
extern "C" fn hard_fault() -> ! {
    naked_asm!(
        "mrs r0, msp",
        "mov r1, lr",
        "movw r2, #:lower16:_stack_end",
        "movt r2, #:upper16:_stack_end",
        "movw r3, #:lower16:_stack_start",
        "movt r3, #:upper16:_stack_start",
        "add r2, r2, {little}",
        // Within the stack, and with enough of it left.
        "cmp r0, r2",
        "blo 1f",
        "cmp r0, r3",
        "bls 2f",
        "1: msr msp, r3",
        "2: movw r2, #0xEF34",
        "movt r2, #0xE000",
        "ldr r3, [r2]",
        "bic r3, r3, #1",
        "str r3, [r2]",
        "b {on_fault}",
        little = const LITTLE,
        on_fault = sym on_fault,
    )
}

/// The same for a processor of ARMv6-M, which has no floating-point registers and loads addresses from beside the code.
#[cfg(feature = "pico")]
#[unsafe(naked)]
#[unsafe(export_name = "HardFault")]
extern "C" fn hard_fault() -> ! {
    naked_asm!(
        "mrs r0, msp",
        "mov r1, lr",
        "ldr r2, 3f",
        "ldr r3, 4f",
        // Within the stack, and with enough of it left.
        "cmp r0, r2",
        "blo 1f",
        "cmp r0, r3",
        "bls 2f",
        "1: msr msp, r3",
        "2: ldr r2, 5f",
        "bx r2",
        ".balign 4",
        "3: .word _stack_end + {little}",
        "4: .word _stack_start",
        "5: .word {on_fault}",
        little = const LITTLE,
        on_fault = sym on_fault,
    )
}

extern "C" fn on_fault(stack_pointer: usize, exc_return: u32) -> ! {
    let overflowed = stack_pointer < bottom() + LITTLE;
    let cause = if overflowed { ResetCause::StackOverflow } else { ResetCause::ProcessorFault };
    crate::reset::on_crash(cause, &Moment { stack_pointer, exc_return })
}
