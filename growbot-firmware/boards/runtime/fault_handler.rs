//! The handler of the processor's faults, of which an overflow of the stack is one.

use core::arch::naked_asm;

use growbot_core::link::message::ResetCause;

use super::crash::ExceptionContext;
use super::stack;

/// Number of free bytes of stack below which a fault of the processor is reported as a stack overflow. Any push, an
/// exception frame and the crash handler each need less.
const STACK_RESERVE_BYTES: usize = 512;

/// Handler of the processor's faults. The stack pointer may have any value. If too little of the stack is free, the
/// stack pointer is set to the top before any code uses the stack. Otherwise it is kept, so that the crash record
/// contains the content of the stack. Floating-point registers that the processor has not saved yet (FPCCR.LSPACT) are
/// dropped.
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
        // Skips the reset of the pointer if it is within the stack, with enough of it free.
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
        little = const STACK_RESERVE_BYTES,
        on_fault = sym on_fault,
    )
}

/// Handler of the faults of a processor of ARMv6-M, which has no floating-point registers and loads addresses from
/// beside the code.
#[cfg(feature = "pico")]
#[unsafe(naked)]
#[unsafe(export_name = "HardFault")]
extern "C" fn hard_fault() -> ! {
    naked_asm!(
        "mrs r0, msp",
        "mov r1, lr",
        "ldr r2, 3f",
        "ldr r3, 4f",
        // Skips the reset of the pointer if it is within the stack, with enough of it free.
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
        little = const STACK_RESERVE_BYTES,
        on_fault = sym on_fault,
    )
}

extern "C" fn on_fault(stack_pointer: usize, exc_return: u32) -> ! {
    let overflowed = stack_pointer < stack::bottom() + STACK_RESERVE_BYTES;
    let cause = if overflowed { ResetCause::StackOverflow } else { ResetCause::ProcessorFault };
    crate::reset::reset_on_crash(cause, &ExceptionContext { stack_pointer, exc_return })
}
