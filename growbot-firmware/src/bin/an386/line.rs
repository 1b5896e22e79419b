//! The line to the host: UART0, a byte queue in each direction.
//!
//! Both queues end in interrupts, so `main` never waits for the line.

use heapless::spsc::{Consumer, Producer, Queue};

use crate::interrupt_owned::InterruptOwned;
use crate::interrupts::{self, Interrupt};
use crate::registers::Register;
use crate::tip;

/// Bytes each queue can hold, plus one.
const QUEUE: usize = 4096;

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
/// Both directions on, both interrupts on.
const CONTROL_ALL: u32 = 0b1111;
const CLEAR_TRANSMIT: u32 = 1 << 0;
const CLEAR_RECEIVE: u32 = 1 << 1;

static RECEIVER: InterruptOwned<Producer<'static, u8>> = InterruptOwned::empty();
static TRANSMITTER: InterruptOwned<Consumer<'static, u8>> = InterruptOwned::empty();

/// `main`'s ends of the queues.
pub struct Line {
    /// Received bytes, oldest first.
    pub received: Consumer<'static, u8>,
    /// Bytes to send; call [`Line::send_queued`] after adding some.
    pub to_send: Producer<'static, u8>,
}

impl Line {
    /// Sets the UART up. Bytes flow once the interrupts are let through.
    pub fn start(
        received: &'static mut Queue<u8, QUEUE>,
        to_send: &'static mut Queue<u8, QUEUE>,
        clock_hz: u32,
    ) -> Self {
        let (receiver, received) = received.split();
        let (to_send, transmitter) = to_send.split();
        RECEIVER.give(receiver);
        TRANSMITTER.give(transmitter);
        // The emulator ignores the rate, but wants a divider of at least 16.
        BAUD_DIVIDER.write((clock_hz / 115_200).max(16));
        CONTROL.write(CONTROL_ALL);
        Line { received, to_send }
    }

    /// Has the transmit interrupt look at the queue.
    pub fn send_queued(&self) {
        interrupts::pend(Interrupt::LineTransmit);
    }
}

/// A place for [`Line::start`] to put its queues; `None` the second time.
pub fn queues() -> Option<(&'static mut Queue<u8, QUEUE>, &'static mut Queue<u8, QUEUE>)> {
    let received = cortex_m::singleton!(: Queue<u8, QUEUE> = Queue::new())?;
    let to_send = cortex_m::singleton!(: Queue<u8, QUEUE> = Queue::new())?;
    Some((received, to_send))
}

/// Takes what has been received. An emergency stop would be recognised here, ahead of everything that is queued.
pub fn on_receive() {
    // Cleared before the bytes are read: cleared afterwards, it would take the news of a byte that comes in between.
    INTERRUPT_CLEAR.write(CLEAR_RECEIVE);
    // SAFETY: only the receive interrupt calls this.
    unsafe {
        RECEIVER.with(|queue| {
            while STATE.read() & STATE_RECEIVE_FULL != 0 {
                let byte = (DATA.read() & 0xFF) as u8;
                if queue.enqueue(byte).is_err() {
                    tip::count_lost_byte();
                }
            }
        });
    }
}

/// Sends as much as the UART takes; it interrupts again when it can take more.
pub fn on_transmit() {
    INTERRUPT_CLEAR.write(CLEAR_TRANSMIT);
    // SAFETY: only the transmit interrupt calls this.
    unsafe {
        TRANSMITTER.with(|queue| {
            while STATE.read() & STATE_TRANSMIT_FULL == 0 {
                let Some(byte) = queue.dequeue() else { break };
                DATA.write(u32::from(byte));
            }
        });
    }
}
