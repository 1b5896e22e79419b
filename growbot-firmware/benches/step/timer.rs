//! Counter of instructions, by TIMER0.

use core::hint::black_box;

use crate::registers::Register;

const BASE: usize = 0x4000_0000;
// SAFETY: the registers of TIMER0, which only this file uses.
const CONTROL: Register = unsafe { Register::at(BASE) };
// SAFETY: as above.
const VALUE: Register = unsafe { Register::at(BASE + 0x04) };
// SAFETY: as above.
const RELOAD: Register = unsafe { Register::at(BASE + 0x08) };

const CONTROL_ENABLE: u32 = 1 << 0;

/// Duration of a timer tick at 25 MHz, ns.
const NS_PER_TICK: u32 = 40;
/// Duration of an instruction with `-icount shift=10`, ns. An instruction takes 25.6 timer ticks, so that an error of
/// one tick does not matter.
const NS_PER_INSTRUCTION: u32 = 1 << 10;

/// The running timer that counts instructions.
pub struct Timer {
    /// Number of timer ticks that an empty measurement takes.
    nothing: u32,
}

impl Timer {
    /// Starts the timer. It wraps after 160 million instructions, which does not matter for short work.
    pub fn start() -> Self {
        RELOAD.write(u32::MAX);
        VALUE.write(u32::MAX);
        CONTROL.write(CONTROL_ENABLE);
        Timer { nothing: ticks(|| black_box(())) }
    }

    /// Returns the number of instructions of `work`, which must be short.
    pub fn instructions(&self, work: impl FnOnce()) -> u32 {
        let ns = ticks(work).saturating_sub(self.nothing).saturating_mul(NS_PER_TICK);
        (ns + NS_PER_INSTRUCTION / 2) / NS_PER_INSTRUCTION
    }
}

fn ticks(work: impl FnOnce()) -> u32 {
    let before = VALUE.read();
    work();
    // The timer counts downwards.
    before.wrapping_sub(VALUE.read())
}
