//! The serial line of the stepper drivers: UART1 at pins 8 and 9, which a resistor on the board joins to one wire.
//!
//! The line uses no interrupt. The UART's FIFOs of 32 bytes hold a whole exchange until the controller reads it. A
//! response therefore also waits there while the flash is written to.

use growbot_firmware::tmc2209::{BAUD, SingleWireUart};
use rp2040_pac as pac;

use crate::clock::PROCESSOR_HZ;

/// Frame format of the UART: 8 bits, no parity, one stop bit, with the FIFOs.
const FRAME: u32 = 0b11 << 5 | 1 << 4;
/// Bits of the control register that enable the UART in both directions.
const ON: u32 = 1 | 1 << 8 | 1 << 9;
const RECEIVE_EMPTY: u32 = 1 << 4;
const TRANSMIT_EMPTY: u32 = 1 << 7;

/// The serial line of the stepper drivers: UART1.
pub struct TmcUart(pac::UART1);

impl TmcUart {
    /// Initialises the UART. Its pins must have been configured.
    pub fn start(uart: pac::UART1) -> Self {
        // With sixteenfold oversampling, the divider in 64ths is 4 times clock over rate, rounded.
        let divider = (4 * PROCESSOR_HZ + BAUD / 2) / BAUD;
        // SAFETY: values within the registers' ranges.
        unsafe {
            uart.uartibrd().write(|w| w.bits(divider / 64));
            uart.uartfbrd().write(|w| w.bits(divider % 64));
            uart.uartlcr_h().write(|w| w.bits(FRAME));
            uart.uartcr().write(|w| w.bits(ON));
        }
        Self(uart)
    }

    fn has(&self, flag: u32) -> bool {
        self.0.uartfr().read().bits() & flag != 0
    }
}

impl SingleWireUart for TmcUart {
    fn send(&mut self, bytes: &[u8]) -> bool {
        let has_room = self.has(TRANSMIT_EMPTY);
        if has_room {
            for byte in bytes {
                // SAFETY: a byte to be sent.
                self.0.uartdr().write(|w| unsafe { w.bits(u32::from(*byte)) });
            }
        }
        has_room
    }

    fn receive(&mut self) -> Option<u8> {
        let received = !self.has(RECEIVE_EMPTY);
        received.then(|| (self.0.uartdr().read().bits() & 0xFF) as u8)
    }
}
