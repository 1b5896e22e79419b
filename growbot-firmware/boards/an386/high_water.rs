//! How much of the stack was ever used. Start-up paints all of it; what is still painted was not.

use core::hint::black_box;

use cortex_m_rt::STACK_PAINT_VALUE;
use growbot_firmware::emulated_tip as table;

use crate::image::stack;
use crate::registers::Register;
use crate::tip;

/// Words that are looked at in one round of the main loop.
const AT_ONCE: usize = 64;

/// Looks from the bottom of the stack upwards for the first word that was used, a little in each round.
#[derive(Default)]
pub struct HighWater {
    /// Words of paint found so far.
    painted: usize,
}

impl HighWater {
    /// Looks on, and tells the host whenever the end of the paint is found.
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
            // SAFETY: a word of the stack: the paint ends below where the stack pointer is. It is only read.
            if unsafe { Register::at(stack::bottom() + 4 * self.painted) }.read() != STACK_PAINT_VALUE {
                tip::publish_unused_stack(4 * self.painted as u32);
                self.painted = 0;
                return;
            }
            self.painted += 1;
        }
    }
}

/// Calls itself without end, each time with a frame of its own.
#[expect(unconditional_recursion, reason = "it is to overflow the stack")]
#[inline(never)]
fn overflow(depth: u32) -> u32 {
    let frame = black_box([depth; 8]);
    overflow(black_box(depth + 1)) ^ black_box(frame)[0]
}

/// Runs an instruction that the processor does not know.
#[inline(never)]
fn undefined_instruction() {
    cortex_m::asm::udf();
}

/// Reads from an address without memory.
#[inline(never)]
fn access_in_vain() -> u32 {
    // SAFETY: nothing is there: the processor faults, which is what is wanted.
    unsafe { Register::at(table::NOWHERE) }.read()
}

/// Hangs, so that the watchdog expires.
#[inline(never)]
fn hang() {
    loop {
        cortex_m::asm::nop();
    }
}
