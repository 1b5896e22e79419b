//! The effects of a debug probe on a robot, and the settings by which the firmware limits them.
//!
//! A probe can halt the processor at any moment, and so can a vector catch that it has left set. The registers of
//! debugging are kept until the power is switched off, whatever is reset or unplugged. These measures keep the tip
//! safe:
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

/// All vector catches (VC_CORERESET, VC_MMERR to VC_HARDERR) of the register DEMCR.
const VECTOR_CATCHES: u32 = 0x7F1;

/// Debugging is on (C_DEBUGEN), in the register DHCSR.
const C_DEBUGEN: u32 = 1;

/// The timers and watchdogs that stop or continue in a halt.
pub struct DebugFreeze(pac::DBGMCU);

impl DebugFreeze {
    /// Applies the settings, and clears all vector catches.
    pub fn set_up(registers: pac::DBGMCU, debug: &mut DCB) -> Self {
        // SAFETY: clears bits that make the processor halt. The other bits are kept.
        unsafe { debug.demcr.modify(|bits| bits & !VECTOR_CATCHES) };
        let halts = Self(registers);
        halts.assert();
        halts
    }

    /// Applies the settings again. It writes whole registers, so that all settings of a probe are undone.
    pub fn assert(&self) {
        self.0.apb1_fz().write(|w| w.dbg_tim2_stop().set_bit());
        self.0.apb2_fz().write(|w| w.dbg_tim1_stop().set_bit());
    }
}

/// The debug port of the processor.
pub struct BoardDebugPort;

impl DebugPort for BoardDebugPort {
    fn is_on(&self) -> bool {
        // SAFETY: a read of this register has no effect. It reads the whole word, as the architecture requires
        // (`DCB::is_debugger_attached` reads a byte).
        unsafe { &*DCB::PTR }.dhcsr.read() & C_DEBUGEN != 0
    }
}
