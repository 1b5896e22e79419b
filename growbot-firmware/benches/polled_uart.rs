//! Driver of UART0 for writing only, without interrupts.

use core::fmt;

use crate::registers::Register;

const BASE: usize = 0x4000_4000;
// SAFETY: the registers of UART0, which only this file uses.
const DATA: Register = unsafe { Register::at(BASE) };
// SAFETY: as above.
const STATE: Register = unsafe { Register::at(BASE + 0x04) };
// SAFETY: as above.
const CONTROL: Register = unsafe { Register::at(BASE + 0x08) };
// SAFETY: as above.
const BAUD_DIVIDER: Register = unsafe { Register::at(BASE + 0x10) };

const STATE_TRANSMIT_FULL: u32 = 1 << 0;
const CONTROL_TRANSMIT: u32 = 1 << 0;

/// The running UART0.
pub struct PolledUart(());

impl PolledUart {
    /// Starts the UART. It may be started again at any time.
    pub fn start() -> Self {
        // This is the min divider that the emulator accepts.
        BAUD_DIVIDER.write(16);
        CONTROL.write(CONTROL_TRANSMIT);
        PolledUart(())
    }
}

impl fmt::Write for PolledUart {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for byte in text.bytes() {
            while STATE.read() & STATE_TRANSMIT_FULL != 0 {}
            DATA.write(byte.into());
        }
        Ok(())
    }
}
