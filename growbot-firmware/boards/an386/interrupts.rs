//! The board's interrupts: numbers and priorities. Their handlers are in `vectors.rs`.

use cortex_m::interrupt::InterruptNumber;
use cortex_m::peripheral::NVIC;

/// The interrupts that the firmware uses, with their numbers.
#[derive(Clone, Copy, PartialEq, Eq)]
#[repr(u16)]
pub enum Interrupt {
    /// UART0 has received a byte.
    UartReceive = 0,
    /// UART0 can accept another byte to send.
    UartTransmit = 1,
    /// TIMER0 has run out: a step tick.
    StepTick = 8,
}

// SAFETY: the numbers are those of the mps2-an386, each once, and never change.
unsafe impl InterruptNumber for Interrupt {
    fn number(self) -> u16 {
        self as u16
    }
}

/// Priorities of the interrupts. The step tick has priority over the UART: a late byte waits in the UART, but a late
/// step is a defect in the printed layer.
const PRIORITIES: [(Interrupt, u8); 3] =
    [(Interrupt::StepTick, 0x20), (Interrupt::UartReceive, 0x40), (Interrupt::UartTransmit, 0x60)];

/// Enables the interrupts. All data that their handlers use must be initialised.
pub fn start(nvic: &mut NVIC) {
    for (interrupt, priority) in PRIORITIES {
        // SAFETY: no code here depends on a priority mask that this could weaken.
        unsafe { nvic.set_priority(interrupt, priority) };
        // SAFETY: the caller has initialised the data of the handlers, and is in no critical section.
        unsafe { NVIC::unmask(interrupt) };
    }
}

/// Pends an interrupt. Its handler runs as soon as its priority allows.
pub fn pend(interrupt: Interrupt) {
    NVIC::pend(interrupt);
}
