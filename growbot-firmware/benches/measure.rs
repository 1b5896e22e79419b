//! Measurement of the instructions and the stack of a piece of work.

use core::hint::black_box;

use cortex_m::register::msp;

use crate::registers::Register;

const BASE: usize = 0x4000_0000;
// SAFETY: the registers of TIMER0, which only this file uses.
const CONTROL: Register = unsafe { Register::at(BASE) };
// SAFETY: as above.
const VALUE: Register = unsafe { Register::at(BASE + 0x04) };
// SAFETY: as above.
const RELOAD: Register = unsafe { Register::at(BASE + 0x08) };

const SLOW_BASE: usize = 0x4000_2000;
// SAFETY: the registers of the first of the dual timers, which only this file uses.
const SLOW_LOAD: Register = unsafe { Register::at(SLOW_BASE) };
// SAFETY: as above.
const SLOW_VALUE: Register = unsafe { Register::at(SLOW_BASE + 0x04) };
// SAFETY: as above.
const SLOW_CONTROL: Register = unsafe { Register::at(SLOW_BASE + 0x08) };

const CONTROL_ENABLE: u32 = 1 << 0;
/// Value of the slow timer's control register: enabled, 32 bits, one count every 256 ticks.
const SLOW_CONTROL_ENABLE: u32 = 1 << 7 | 1 << 1 | 0b10 << 2;

/// Duration of a timer tick at 25 MHz, ns.
const NS_PER_TICK: u64 = 40;
/// Duration of an instruction with `-icount shift=10`, ns. An instruction takes 25.6 timer ticks, so that an error of
/// one tick does not matter.
const NS_PER_INSTRUCTION: u64 = 1 << 10;

/// Number of words of the stack that are measured, which is half of the stack. Work that uses more is reported as if it
/// used all of that half.
const DEPTH: u32 = 32 * 1024 / 4;
/// Value of the stack words that were not used.
const PATTERN: u32 = 0x5AC5_5AC5;

/// Cost of a piece of work.
pub struct Cost {
    /// Number of instructions, without the call itself.
    pub instructions: u64,
    /// Used stack, bytes, including the call's frame.
    pub stack: u32,
}

/// Calls `work` and returns its cost.
pub fn measure(work: &mut dyn FnMut()) -> Cost {
    let (nothing, _) = ticks_and_stack(&mut || ());
    let (ticks, stack) = ticks_and_stack(work);
    let ns = ticks.saturating_sub(nothing) * NS_PER_TICK;
    Cost { instructions: (ns + NS_PER_INSTRUCTION / 2) / NS_PER_INSTRUCTION, stack }
}

#[inline(never)]
fn ticks_and_stack(work: &mut dyn FnMut()) -> (u64, u32) {
    // The optimiser cannot see through this, so that the work is a call and its frame lies below this one.
    let work = black_box(work);
    RELOAD.write(u32::MAX);
    VALUE.write(u32::MAX);
    CONTROL.write(CONTROL_ENABLE);
    SLOW_CONTROL.write(SLOW_CONTROL_ENABLE);
    SLOW_LOAD.write(u32::MAX);
    let top = msp::read();
    for word in 1..=DEPTH {
        below(top, word).write(PATTERN);
    }
    let (slow_before, before) = (SLOW_VALUE.read(), VALUE.read());
    work();
    let (after, slow_after) = (VALUE.read(), SLOW_VALUE.read());
    // The search starts at the far end and finds the first word that was used.
    let used = (1..=DEPTH).rev().find(|&word| below(top, word).read() != PATTERN).unwrap_or(0);
    // The timers count downwards. The fast one wraps after 168 million instructions, and the slow one shows how often
    // it has.
    let (ticks, roughly) =
        (u64::from(before.wrapping_sub(after)), 256 * u64::from(slow_before.wrapping_sub(slow_after)));
    (ticks + ((roughly.saturating_sub(ticks) + (1 << 31)) >> 32 << 32), 4 * used)
}

/// Returns the stack word at this number of words below `top`, the stack pointer.
fn below(top: u32, words: u32) -> Register {
    // SAFETY: the stack pointer is a multiple of 4. The memory below it has no owner while no function is called, and
    // interrupts are off. There are 64 KiB of stack, of which this program has used almost nothing.
    unsafe { Register::at((top - 4 * words) as usize) }
}
