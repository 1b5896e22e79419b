//! The UART of the link, USART2 at 115200 baud, with a byte queue in each direction.

use growbot_core::link::emergency_stop::EmergencyStopDetector;
use growbot_firmware::byte_queue::ByteQueue;
use growbot_firmware::stepping::Mailbox;
use stm32f4xx_hal::pac;
use stm32f4xx_hal::rcc::{Enable, Rcc, Reset};

use crate::pins::{LinkRx, LinkTx};
use crate::{clock, outputs};

/// Byte queue of one direction of the link.
pub type UartQueue = ByteQueue<4096>;

/// Bytes that the UART has received, oldest first.
pub static RECEIVED: UartQueue = UartQueue::new();
/// Bytes that the UART is to send, oldest first. Pend the interrupt of USART2 after adding some.
pub static TO_SEND: UartQueue = UartQueue::new();

const BAUD: u32 = 115_200;

/// The part of the link's UART that its interrupt uses.
pub struct LinkUart {
    usart: pac::USART2,
    /// Detector of an emergency stop in the received bytes.
    watch: EmergencyStopDetector,
    lost: u32,
    _pins: (LinkTx, LinkRx),
}

impl LinkUart {
    /// Initialises the USART: 8 bits, no parity, one stop bit, an interrupt for each received byte.
    pub fn start(usart: pac::USART2, pins: (LinkTx, LinkRx), rcc: &mut Rcc) -> Self {
        pac::USART2::enable(rcc);
        pac::USART2::reset(rcc);
        // With sixteenfold oversampling, the register has the divider in sixteenths, which is clock over rate, rounded.
        let divider = (clock::APB1_HZ + BAUD / 2) / BAUD;
        // SAFETY: any 16-bit divider is valid. At 42 MHz it is 365, 0.1 % off the rate.
        usart.brr().write(|w| unsafe { w.bits((divider & 0xFFFF) as u16) });
        usart.cr1().write(|w| w.ue().set_bit().te().set_bit().re().set_bit().rxneie().set_bit());
        LinkUart { usart, watch: EmergencyStopDetector::new(), lost: 0, _pins: pins }
    }

    /// Handles the USART's interrupt, which the main loop also pends once it has queued bytes. An emergency stop is
    /// carried out here, ahead of all queued bytes.
    pub fn on_interrupt(&mut self, handover: &Mailbox) {
        loop {
            let status = self.usart.sr().read();
            if !status.rxne().bit_is_set() && !status.ore().bit_is_set() {
                break;
            }
            // A read of the data after the status clears both flags.
            let byte = (self.usart.dr().read().bits() & 0xFF) as u8;
            if status.ore().bit_is_set() {
                self.lost = self.lost.wrapping_add(1);
            }
            if status.rxne().bit_is_set() && self.watch.push(byte) {
                // This comes first, so that no step in between energises a motor again.
                handover.request_emergency_stop();
                outputs::make_safe();
            }
            if status.rxne().bit_is_set() && RECEIVED.enqueue(byte).is_err() {
                self.lost = self.lost.wrapping_add(1);
            }
        }
        if self.usart.sr().read().txe().bit_is_set() {
            match TO_SEND.dequeue() {
                Some(byte) => {
                    self.usart.dr().write(|w| w.dr().set(u16::from(byte)));
                    self.usart.cr1().modify(|_, w| w.txeie().set_bit());
                }
                None => {
                    self.usart.cr1().modify(|_, w| w.txeie().clear_bit());
                }
            }
        }
    }
}
