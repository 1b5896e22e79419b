//! Protection against a debug probe: the effects that a probe has on a robot, and the settings by which the firmware
//! limits them.
//!
//! A probe can halt the processor at any moment, and so can a vector catch that a probe has left set. The debug
//! registers keep their content until the power is switched off, even if the processor is reset or the probe is
//! unplugged. These measures keep the tip safe:
//!
//! - The watchdog keeps counting (`DBG_IWDG_STOP` clear). A halted processor is therefore reset, within 2 s, and in a
//!   reset every pin floats to the level of WIRING.md's resistors. Probes set this bit (OpenOCD does), so it is cleared
//!   again with each feed.
//! - The heater's PWM is made by TIM1, an advanced timer. If those are stopped with the processor (`DBG_TIM1_STOP`),
//!   their outputs are disabled as if MOE were cleared (reference manual RM0090, debug mode of TIM1 and TIM8), which
//!   here is low (see `heater.rs`). A general-purpose timer would stop with its output unchanged, which might be high.
//! - The step timer stops too, so that a halt makes no step late. The fan's timer continues, because cooling is
//!   harmless.
//! - Vector catch is switched off at each start. A fault of the processor must reach its handler, which makes the tip
//!   safe.
//! - While debugging is enabled at all (`C_DEBUGEN`), the controller does not heat, unless the robot is a test bench.

use cortex_m::peripheral::DCB;
use growbot_firmware::hal::DebugPort;
use stm32f4xx_hal::pac;

/// Bits of all vector catches in the register DEMCR (VC_CORERESET, VC_MMERR to VC_HARDERR).
const VECTOR_CATCHES: u32 = 0x7F1;

/// Bit C_DEBUGEN in the register DHCSR: debugging is enabled.
const C_DEBUGEN: u32 = 1;

/// Settings of the timers and watchdogs that stop or continue while a debug probe halts the processor.
pub struct DebugFreeze(pac::DBGMCU);

impl DebugFreeze {
    /// Writes the settings, and clears all vector catches.
    pub fn set_up(registers: pac::DBGMCU, debug: &mut DCB) -> Self {
        // SAFETY: clears bits that make the processor halt. The other bits are kept.
        unsafe { debug.demcr.modify(|bits| bits & !VECTOR_CATCHES) };
        let halts = Self(registers);
        halts.assert();
        halts
    }

    /// Writes the settings again. It writes whole registers, so that all settings of a probe are undone.
    pub fn assert(&self) {
        self.0.apb1_fz().write(|w| w.dbg_tim2_stop().set_bit());
        self.0.apb2_fz().write(|w| w.dbg_tim1_stop().set_bit());
    }
}

/// The debug port of the processor, whose state the firmware can read.
pub struct BoardDebugPort;

impl DebugPort for BoardDebugPort {
    fn is_on(&self) -> bool {
        // SAFETY: a read of this register has no effect. It reads the whole word, as the architecture requires
        // (`DCB::is_debugger_attached` reads a byte).
        unsafe { &*DCB::PTR }.dhcsr.read() & C_DEBUGEN != 0
    }
}
