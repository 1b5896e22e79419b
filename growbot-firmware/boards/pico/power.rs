//! Power of heater and fan: PWM at 1.9 kHz, each of a slice of its own.

use core::convert::Infallible;

use embedded_hal::pwm::{ErrorType, SetDutyCycle};
use rp2040_pac as pac;

/// Slices of the heater's and the fan's pins.
const HEATER: usize = 4;
const FAN: usize = 5;
/// One period is this many clocks less one, so that a duty of `u16::MAX` never goes low.
const LAST_COUNT: u32 = u16::MAX as u32 - 1;
/// Clocked by the processor's clock itself: 1 in 4 bits after the point.
const UNDIVIDED: u32 = 1 << 4;
const ENABLE: u32 = 1;

/// A power stage at channel A of a slice.
pub struct Power<const SLICE: usize>(());

/// The heater's.
pub type Heater = Power<HEATER>;
/// The fan's.
pub type Fan = Power<FAN>;

fn slice(slice: usize) -> &'static pac::pwm::CH {
    // SAFETY: the slices of heater and fan are touched by this file only, and there are eight.
    unsafe { &*pac::PWM::ptr() }.ch(slice % 8)
}

impl<const SLICE: usize> Power<SLICE> {
    /// Starts the PWM at no power. The slice is as the reset has left it.
    pub fn start() -> Self {
        let slice = slice(SLICE);
        // SAFETY: values of whole registers that have no other owner.
        unsafe {
            slice.cc().write(|w| w.bits(0));
            slice.div().write(|w| w.bits(UNDIVIDED));
            slice.top().write(|w| w.bits(LAST_COUNT));
            slice.csr().write(|w| w.bits(ENABLE));
        }
        Power(())
    }
}

impl<const SLICE: usize> ErrorType for Power<SLICE> {
    type Error = Infallible;
}

impl<const SLICE: usize> SetDutyCycle for Power<SLICE> {
    fn max_duty_cycle(&self) -> u16 {
        u16::MAX
    }

    /// Acts from the end of the period, within 0.53 ms.
    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        // SAFETY: the level of channel A; B has no pin.
        slice(SLICE).cc().write(|w| unsafe { w.bits(u32::from(duty)) });
        Ok(())
    }
}

/// Switches heater and fan off within a period: the comparison is buffered, so the count is set to its end. Their
/// owners keep them.
pub fn off() {
    for number in [HEATER, FAN] {
        let slice = slice(number);
        // SAFETY: whole registers; no power is a value that their owner writes too.
        unsafe {
            slice.cc().write(|w| w.bits(0));
            slice.ctr().write(|w| w.bits(LAST_COUNT));
        }
    }
}
