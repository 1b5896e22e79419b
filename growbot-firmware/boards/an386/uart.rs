//! The UART of the link, UART0, with a byte queue in each direction.
//!
//! Interrupts move the bytes between the UART and the queues, so that `main` never waits for the UART.

use growbot_core::link::emergency_stop::EmergencyStopDetector;
use growbot_firmware::byte_queue::ByteQueue;

use crate::interrupt_cell::InterruptCell;
use crate::interrupts::{self, Interrupt};
use crate::mailbox::MAILBOX;
use crate::registers::Register;
use crate::tip;

const BASE: usize = 0x4000_4000;
// SAFETY: the registers of UART0, which only this file uses.
const DATA: Register = unsafe { Register::at(BASE) };
// SAFETY: as above.
const STATE: Register = unsafe { Register::at(BASE + 0x04) };
// SAFETY: as above.
const CONTROL: Register = unsafe { Register::at(BASE + 0x08) };
// SAFETY: as above.
const INTERRUPT_CLEAR: Register = unsafe { Register::at(BASE + 0x0C) };
// SAFETY: as above.
const BAUD_DIVIDER: Register = unsafe { Register::at(BASE + 0x10) };

const STATE_TRANSMIT_FULL: u32 = 1 << 0;
const STATE_RECEIVE_FULL: u32 = 1 << 1;
/// Bits of the control register that enable both directions and both interrupts.
const CONTROL_ALL: u32 = 0b1111;
const CLEAR_TRANSMIT: u32 = 1 << 0;
const CLEAR_RECEIVE: u32 = 1 << 1;

static RECEIVED: ByteQueue<4096> = ByteQueue::new();
static TO_SEND: ByteQueue<4096> = ByteQueue::new();

/// The byte queues of the link, as `main` uses them.
pub struct Uart {
    /// Received bytes, oldest first.
    pub received: &'static ByteQueue<4096>,
    /// Bytes to send, oldest first. Call [`Uart::send_queued`] after adding some.
    pub to_send: &'static ByteQueue<4096>,
}

impl Uart {
    /// Initialises the UART. Bytes are transferred once the interrupts are enabled.
    pub fn start(clock_hz: u32) -> Self {
        // The emulator ignores the rate, but requires a divider of at least 16.
        BAUD_DIVIDER.write((clock_hz / 115_200).max(16));
        ESTOP_DETECTOR.init(EmergencyStopDetector::new());
        CONTROL.write(CONTROL_ALL);
        Uart { received: &RECEIVED, to_send: &TO_SEND }
    }

    /// Starts to send the queued bytes: pends the transmit interrupt, which reads the queue.
    pub fn send_queued(&self) {
        interrupts::pend(Interrupt::UartTransmit);
    }
}

/// Detector of an emergency stop in the received bytes.
static ESTOP_DETECTOR: InterruptCell<EmergencyStopDetector> = InterruptCell::empty();

/// Handles the receive interrupt: moves the received bytes to the queue. An emergency stop is carried out here, ahead
/// of all queued bytes.
pub fn on_receive() {
    // The flag is cleared before the bytes are read. If it were cleared afterwards, a byte that arrives in between
    // would be lost.
    INTERRUPT_CLEAR.write(CLEAR_RECEIVE);
    while STATE.read() & STATE_RECEIVE_FULL != 0 {
        let byte = (DATA.read() & 0xFF) as u8;
        // SAFETY: only the receive interrupt calls this.
        unsafe { ESTOP_DETECTOR.with(|watch| handle_emergency_stop(watch.push(byte))) };
        if RECEIVED.enqueue(byte).is_err() {
            tip::count_lost_byte();
        }
    }
}

/// Switches everything off at once if an emergency stop has arrived.
fn handle_emergency_stop(emergency_stop: bool) {
    if emergency_stop {
        // This comes first, so that no step in between energises a motor again.
        MAILBOX.request_emergency_stop();
        tip::make_safe();
    }
}

/// Handles the transmit interrupt: sends as many queued bytes as the UART accepts. The UART interrupts again when it
/// can accept more.
pub fn on_transmit() {
    INTERRUPT_CLEAR.write(CLEAR_TRANSMIT);
    while STATE.read() & STATE_TRANSMIT_FULL == 0 {
        let Some(byte) = TO_SEND.dequeue() else { break };
        DATA.write(u32::from(byte));
    }
}
