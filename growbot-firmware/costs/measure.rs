//! How many instructions and how much stack a piece of work takes.

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
/// Enabled, 32 bits, once every 256 ticks.
const SLOW_CONTROL_ENABLE: u32 = 1 << 7 | 1 << 1 | 0b10 << 2;

/// At 25 MHz.
const NS_PER_TICK: u64 = 40;
/// By `-icount shift=10`. An instruction is 25.6 ticks, so that a tick more or less is none.
const NS_PER_INSTRUCTION: u64 = 1 << 10;

/// The stack that is looked at, in words: half of it. Work that takes more shows as taking all of that.
const DEPTH: u32 = 32 * 1024 / 4;
/// What untouched stack holds.
const PATTERN: u32 = 0x5AC5_5AC5;

/// What a piece of work has taken.
pub struct Cost {
    /// Instructions, without the call itself.
    pub instructions: u64,
    /// Stack, in bytes, the call's frame included.
    pub stack: u32,
}

/// Does some work and says what it has taken.
pub fn measure(work: &mut dyn FnMut()) -> Cost {
    let (nothing, _) = ticks_and_stack(&mut || ());
    let (ticks, stack) = ticks_and_stack(work);
    let ns = ticks.saturating_sub(nothing) * NS_PER_TICK;
    Cost { instructions: (ns + NS_PER_INSTRUCTION / 2) / NS_PER_INSTRUCTION, stack }
}

#[inline(never)]
fn ticks_and_stack(work: &mut dyn FnMut()) -> (u64, u32) {
    // Seen by the optimiser as anything, so that it is a call and its frame lies below this one.
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
    // From the far end: the first word that is touched.
    let used = (1..=DEPTH).rev().find(|&word| below(top, word).read() != PATTERN).unwrap_or(0);
    // They count downwards. The timer wraps after 168 million instructions; the slow one says how often it has.
    let (ticks, roughly) =
        (u64::from(before.wrapping_sub(after)), 256 * u64::from(slow_before.wrapping_sub(slow_after)));
    (ticks + ((roughly.saturating_sub(ticks) + (1 << 31)) >> 32 << 32), 4 * used)
}

/// The word of the stack at a number of words below the stack pointer.
fn below(top: u32, words: u32) -> Register {
    // SAFETY: the stack pointer is a multiple of 4. What lies below it has no owner while nothing is called, and
    // interrupts are off. There are 64 KiB of stack, of
    // which this program has used next to nothing.
    unsafe { Register::at((top - 4 * words) as usize) }
}
