//! The handlers of the board's interrupts.
//!
//! This board has no device crate, so cortex-m-rt's vector table leads all interrupts to `DefaultHandler`.

use crate::interrupts::Interrupt;
use crate::{step_timer, uart};

const RECEIVE: i16 = Interrupt::UartReceive as i16;
const TRANSMIT: i16 = Interrupt::UartTransmit as i16;
const STEP_TICK: i16 = Interrupt::StepTick as i16;

#[cortex_m_rt::exception]
unsafe fn DefaultHandler(number: i16) {
    match number {
        RECEIVE => uart::on_receive(),
        TRANSMIT => uart::on_transmit(),
        STEP_TICK => step_timer::on_tick(),
        // No other interrupt is enabled.
        _ => {}
    }
}
