//! Measurement of the cost of an emergency stop over the link: from the moment at which its last byte waits in the
//! UART, until heater and drivers are off.
//!
//! The UART's driver is that of the board, `boards/an386/uart.rs`. Its queue is always full, as if the main loop never
//! emptied it. The desktop sends emergency stops between noise until enough of them are measured.

use cortex_m::asm::isb;
use cortex_m::interrupt;
use growbot_firmware::emulated_tip as table;

use crate::interrupts;
use crate::registers::Register;
use crate::timer::Timer;
use crate::tip::word;
use crate::uart::Uart;

/// Frequency of the board's clock, Hz.
const CLOCK_HZ: u32 = 25_000_000;
/// Number of emergency stops that are measured.
const STOPS: u32 = 16;
/// Offsets of the output words that an emergency stop must set to 0.
const OUTPUTS: [usize; 5] =
    [table::HEATER_ENABLE, table::HEATER_DUTY, table::HEAD_ENABLE, table::FEED_ENABLE, table::FAN_DUTY];

// SAFETY: the state of UART0, which `uart` drives. A read changes nothing.
const UART_STATE: Register = unsafe { Register::at(0x4000_4004) };
const UART_STATE_RECEIVE_FULL: u32 = 1 << 1;

/// Returns the number of measured emergency stops, and the max number of instructions of one, including the entry and
/// the exit of its interrupt.
pub fn measure(timer: &Timer) -> Option<(u32, u32)> {
    let mut core = cortex_m::Peripherals::take()?;
    interrupt::disable();
    let uart = Uart::start(CLOCK_HZ);
    while uart.received.enqueue(0xA5).is_ok() {}
    interrupts::start(&mut core.NVIC);

    let (mut stops, mut max) = (0, 0);
    while stops < STOPS {
        while UART_STATE.read() & UART_STATE_RECEIVE_FULL == 0 {}
        for output in OUTPUTS {
            word(output).write(1);
        }
        // The queue is full, so that every byte from the UART counts as lost.
        let lost = word(table::LINK_BYTES_LOST).read();
        let instructions = timer.instructions(|| {
            // SAFETY: no other code than this measurement depends on masked interrupts.
            unsafe { interrupt::enable() };
            // The interrupt reads the byte here.
            isb();
            interrupt::disable();
        });
        // The desktop may have been so fast that the interrupt read earlier bytes together with the last one.
        let alone = word(table::LINK_BYTES_LOST).read().wrapping_sub(lost) == 1;
        if alone && OUTPUTS.iter().all(|output| word(*output).read() == 0) {
            stops += 1;
            max = instructions.max(max);
        }
    }
    Some((stops, max))
}
