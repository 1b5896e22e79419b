//! The UART of the link, UART0 at 115200 baud, with a byte queue in each direction.

use growbot_core::link::emergency_stop::EmergencyStopDetector;
use growbot_firmware::byte_queue::ByteQueue;
use rp2040_pac as pac;
use rp2040_pac::interrupt;

use crate::clock::PROCESSOR_HZ;
use crate::interrupt_cell::InterruptCell;
use crate::mailbox::MAILBOX;
use crate::pins;

/// Byte queue of one direction of the link.
pub type LinkQueue = ByteQueue<4096>;

/// Bytes that the UART has received, oldest first.
pub static RECEIVED: LinkQueue = LinkQueue::new();
/// Bytes that the UART is to send, oldest first. Call [`send_queued`] after adding some.
pub static TO_SEND: LinkQueue = LinkQueue::new();

const BAUD: u32 = 115_200;
/// Frame format of the UART: 8 bits, no parity, one stop bit, without the FIFOs, so that each byte causes an interrupt.
const FRAME: u32 = 0b11 << 5;
/// Bits of the control register that enable the UART in both directions.
const ON: u32 = 1 | 1 << 8 | 1 << 9;
const RECEIVE_EMPTY: u32 = 1 << 4;
const TRANSMIT_FULL: u32 = 1 << 5;
const RECEIVE_INTERRUPT: u32 = 1 << 4;
const TRANSMIT_INTERRUPT: u32 = 1 << 5;

/// Detector of an emergency stop in the received bytes.
static ESTOP_DETECTOR: InterruptCell<EmergencyStopDetector> = InterruptCell::empty();

/// Initialises the UART. Bytes are transferred once the interrupts are enabled.
pub fn start(uart: &pac::UART0) {
    ESTOP_DETECTOR.init(EmergencyStopDetector::new());
    // With sixteenfold oversampling, the divider in 64ths is 4 times clock over rate, rounded.
    let divider = (4 * PROCESSOR_HZ + BAUD / 2) / BAUD;
    // SAFETY: values within the registers' ranges.
    unsafe {
        uart.uartibrd().write(|w| w.bits(divider / 64));
        uart.uartfbrd().write(|w| w.bits(divider % 64));
        uart.uartlcr_h().write(|w| w.bits(FRAME));
        uart.uartimsc().write(|w| w.bits(RECEIVE_INTERRUPT));
        uart.uartcr().write(|w| w.bits(ON));
    }
}

/// Starts to send the queued bytes: pends the UART's interrupt, which reads the queue.
pub fn send_queued() {
    cortex_m::peripheral::NVIC::pend(pac::Interrupt::UART0_IRQ);
}

/// Gives the detector a received byte, and switches everything off at once if the byte ends an emergency stop.
pub fn check_for_emergency_stop(detector: &mut EmergencyStopDetector, byte: u8) {
    if detector.push(byte) {
        // This comes first, so that no step in between energises a motor again.
        MAILBOX.request_emergency_stop();
        pins::make_safe();
    }
}

/// Sends as many queued bytes as the UART accepts. The UART interrupts again when it can accept more.
fn send(uart: &pac::uart0::RegisterBlock) {
    let mut waits = RECEIVE_INTERRUPT | TRANSMIT_INTERRUPT;
    while uart.uartfr().read().bits() & TRANSMIT_FULL == 0 {
        let Some(byte) = TO_SEND.dequeue() else {
            waits = RECEIVE_INTERRUPT;
            break;
        };
        // SAFETY: a byte to be sent.
        uart.uartdr().write(|w| unsafe { w.bits(u32::from(byte)) });
    }
    // SAFETY: the interrupts that this handler serves.
    uart.uartimsc().write(|w| unsafe { w.bits(waits) });
}

#[interrupt]
fn UART0_IRQ() {
    // SAFETY: once the interrupts are enabled, only this handler accesses the UART.
    let uart = unsafe { &*pac::UART0::ptr() };
    // SAFETY: clears flags. Bytes that are still there are read below.
    uart.uarticr().write(|w| unsafe { w.bits(RECEIVE_INTERRUPT | TRANSMIT_INTERRUPT) });
    while uart.uartfr().read().bits() & RECEIVE_EMPTY == 0 {
        let byte = (uart.uartdr().read().bits() & 0xFF) as u8;
        // SAFETY: only this interrupt calls this.
        unsafe { ESTOP_DETECTOR.with(|detector| check_for_emergency_stop(detector, byte)) };
        // A byte is lost if the queue is full, which the CRC of its frame shows.
        let _ = RECEIVED.enqueue(byte);
    }
    send(uart);
}
