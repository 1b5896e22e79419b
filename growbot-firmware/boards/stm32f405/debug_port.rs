//! What a debug probe may do to a robot, and what the firmware undoes.
//!
//! A probe can halt the processor at any moment, and so can a vector catch that it has left behind: the registers of
//! debugging live until the power goes, whatever is reset or unplugged. What then keeps the tip safe:
//!
//! - The watchdog runs on (`DBG_IWDG_STOP` clear): a halted processor is reset, within 2 s, and in a reset every pin
//!   floats to where WIRING.md's resistors keep it. Probes set this bit (OpenOCD does); so it is cleared again with
//!   each feed.
//! - The heater's PWM is made by TIM1, an advanced timer. Where those are stopped with the processor (`DBG_TIM1_STOP`),
//!   their outputs are disabled as if MOE were cleared (reference manual RM0090, debug mode of TIM1 and TIM8), which
//!   here is low (see `heater.rs`). A general-purpose timer would stop with its output where it is, high for ever if
//!   so.
//! - The step timer stops too, so that no step is late by a halt. The fan's goes on: cooling does no harm.
//! - Vector catch is switched off at each start: a fault of the processor must reach its handler, which makes the tip
//!   safe.
//! - While debugging is on at all (`C_DEBUGEN`), the controller does not heat, unless the robot is a test bench.

use cortex_m::peripheral::DCB;
use growbot_firmware::hal::DebugPort;
use stm32f4xx_hal::pac;

/// All vector catches (VC_CORERESET, VC_MMERR to VC_HARDERR) of the register DEMCR.
const VECTOR_CATCHES: u32 = 0x7F1;

/// Debugging is on (C_DEBUGEN), in the register DHCSR.
const C_DEBUGEN: u32 = 1;

/// What runs on in a halt and what stops.
pub struct Halts(pac::DBGMCU);

impl Halts {
    /// Set up, and no vector catch left.
    pub fn set_up(registers: pac::DBGMCU, debug: &mut DCB) -> Self {
        // SAFETY: clears bits that make the processor halt; the others stay as they are.
        unsafe { debug.demcr.modify(|bits| bits & !VECTOR_CATCHES) };
        let halts = Self(registers);
        halts.assert();
        halts
    }

    /// Sets it up again: whole registers, so that everything that a probe has set is gone.
    pub fn assert(&self) {
        self.0.apb1_fz().write(|w| w.dbg_tim2_stop().set_bit());
        self.0.apb2_fz().write(|w| w.dbg_tim1_stop().set_bit());
    }
}

/// The processor's debugging.
pub struct BoardDebugPort;

impl DebugPort for BoardDebugPort {
    fn is_on(&self) -> bool {
        // SAFETY: reading this register has no effect. The whole word of it, as the architecture wants
        // (`DCB::is_debugger_attached` reads a byte).
        unsafe { &*DCB::PTR }.dhcsr.read() & C_DEBUGEN != 0
    }
}
