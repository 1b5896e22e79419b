//! Measurement of the part of the stack that was ever used. Start-up paints the whole stack (fills it with a fixed
//! word), and words that still have the paint were never used.

use core::hint::black_box;

use cortex_m_rt::STACK_PAINT_VALUE;
use growbot_firmware::emulated_tip as table;

use crate::registers::Register;
use crate::runtime::stack;
use crate::tip;

/// Number of stack words that are checked in one round of the main loop.
const AT_ONCE: usize = 64;

/// Search of the stack, from the bottom upwards, for the first used word. It checks some words in each round of the
/// main loop.
#[derive(Default)]
pub struct StackMonitor {
    /// Number of painted words found so far from the bottom of the stack.
    painted: usize,
}

impl StackMonitor {
    /// Continues the search, and reports the number of unused bytes to the host whenever the search has found a used
    /// word. Crashes the board if the host requests a crash, as a test.
    pub fn look(&mut self) {
        if tip::wants_overflow() {
            black_box(overflow(0));
        }
        match tip::wanted_crash() {
            table::CRASH_BY_INSTRUCTION => undefined_instruction(),
            table::CRASH_BY_ACCESS => {
                black_box(access_in_vain());
            }
            table::CRASH_BY_HANGING => hang(),
            _ => {}
        }
        for _ in 0..AT_ONCE {
            // SAFETY: a word of the stack, which is only read. The paint ends below the stack pointer.
            if unsafe { Register::at(stack::bottom() + 4 * self.painted) }.read() != STACK_PAINT_VALUE {
                tip::publish_unused_stack(4 * self.painted as u32);
                self.painted = 0;
                return;
            }
            self.painted += 1;
        }
    }
}

/// Overflows the stack: calls itself without end, each time with a new stack frame.
#[expect(unconditional_recursion, reason = "it is to overflow the stack")]
#[inline(never)]
fn overflow(depth: u32) -> u32 {
    let frame = black_box([depth; 8]);
    overflow(black_box(depth + 1)) ^ black_box(frame)[0]
}

/// Executes an instruction that the processor does not have.
#[inline(never)]
fn undefined_instruction() {
    cortex_m::asm::udf();
}

/// Reads from an address without memory, so that the processor faults.
#[inline(never)]
fn access_in_vain() -> u32 {
    // SAFETY: the address has no memory, so that the processor faults, as intended.
    unsafe { Register::at(table::NOWHERE) }.read()
}

/// Hangs without feeding the watchdog, until the watchdog expires.
#[inline(never)]
fn hang() {
    loop {
        cortex_m::asm::nop();
    }
}
