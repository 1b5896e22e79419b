//! The board's interrupts: numbers, priorities, and who answers them.
//!
//! There is no device crate for this board, so cortex-m-rt's vector table leads all of them to `DefaultHandler`.

use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;

/// The interrupts that are used.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum Interrupt {
    /// UART0 has received a byte.
    LineReceive = 0,
    /// UART0 can take another byte.
    LineTransmit = 1,
    /// TIMER0 has run out: a step tick.
    StepTick = 8,
}

// SAFETY: the numbers are those of the mps2-an386, each once, and never change.
unsafe impl InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self as u16
    }
}

/// Steps go before the line: a late byte waits in the UART, a late step is a fault in the printed layer.
const PRIORITIES: [(Interrupt, u8); 3] =
    [(Interrupt::StepTick, 0x20), (Interrupt::LineReceive, 0x40), (Interrupt::LineTransmit, 0x60)];

/// Lets the interrupts through. Whatever their handlers use must be in place.
pub fn start(nvic: &mut NVIC) {
    for (interrupt, priority) in PRIORITIES {
        // SAFETY: no code here is protected by a priority mask that this could undercut.
        unsafe { nvic.set_priority(interrupt, priority) };
        // SAFETY: the caller has put everything in place that the handlers use, and holds no critical section.
        unsafe { NVIC::unmask(interrupt) };
    }
}

/// Has the handler run as soon as its priority lets it.
pub fn pend(interrupt: Interrupt) {
    NVIC::pend(interrupt);
}

#[cortex_m_rt::exception]
unsafe fn DefaultHandler(number: i16) {
    match number {
        0 => crate::line::on_receive(),
        1 => crate::line::on_transmit(),
        8 => crate::step_timer::on_tick(),
        // None of the others is ever let through.
        _ => {}
    }
}
