//! Power of heater and fan: PWM at 1.9 kHz, each with a slice of its own.

use core::convert::Infallible;
use core::sync::atomic::{AtomicU32, Ordering};

use embedded_hal::pwm::{ErrorType, SetDutyCycle};
use growbot_core::robot::pwm_slice;
use rp2040_pac as pac;

/// Slice of each power stage, for [`off`]; [`NONE`] before it is started.
static STAGES: [AtomicU32; 2] = [AtomicU32::new(NONE), AtomicU32::new(NONE)];
const NONE: u32 = u32::MAX;
/// Last count of a period, which has `u16::MAX` clocks, so that a duty of `u16::MAX` never goes low.
const LAST_COUNT: u32 = u16::MAX as u32 - 1;
/// Divider of the processor's clock: 1, with 4 bits after the point.
const UNDIVIDED: u32 = 1 << 4;
const ENABLE: u32 = 1;

/// A power stage: heater or fan. The other channel of its slice has no pin.
pub struct PwmOutput(Option<Channel>);

/// A channel of a PWM slice.
#[derive(Clone, Copy)]
struct Channel {
    slice: usize,
    /// Bits by which the channel's level is shifted: 16 for B, at odd pins.
    shift: u32,
}

fn slice(slice: usize) -> &'static pac::pwm::CH {
    // SAFETY: only this file accesses the slices of heater and fan, and there are eight.
    unsafe { &*pac::PWM::ptr() }.ch(slice % 8)
}

impl PwmOutput {
    /// Starts the PWM of a pin with a duty of zero. The slice is in its state after the reset. Without a pin the duty
    /// has no effect.
    pub fn start(pin: Option<u8>) -> Self {
        let Some(pin) = pin else { return Self(None) };
        let number = pwm_slice(pin);
        if let Some(free) = STAGES.iter().find(|stage| stage.load(Ordering::Relaxed) == NONE) {
            free.store(u32::from(number), Ordering::Relaxed);
        }
        let slice = slice(usize::from(number));
        // SAFETY: values of whole registers that have no other owner.
        unsafe {
            slice.cc().write(|w| w.bits(0));
            slice.div().write(|w| w.bits(UNDIVIDED));
            slice.top().write(|w| w.bits(LAST_COUNT));
            slice.csr().write(|w| w.bits(ENABLE));
        }
        Self(Some(Channel { slice: usize::from(number), shift: u32::from(pin % 2) * 16 }))
    }
}

impl ErrorType for PwmOutput {
    type Error = Infallible;
}

impl SetDutyCycle for PwmOutput {
    fn max_duty_cycle(&self) -> u16 {
        u16::MAX
    }

    /// Sets the duty, which acts from the end of the period, within 0.53 ms.
    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        if let Some(Channel { slice: number, shift }) = self.0 {
            // SAFETY: the level of one channel. The other channel has no pin.
            slice(number).cc().write(|w| unsafe { w.bits(u32::from(duty) << shift) });
        }
        Ok(())
    }
}

/// Switches heater and fan off within a period. The comparison is buffered, so the count is set to its end. Their
/// owners keep them.
pub fn off() {
    for stage in &STAGES {
        let number = stage.load(Ordering::Relaxed);
        if number == NONE {
            continue;
        }
        let slice = slice(number as usize);
        // SAFETY: whole registers. Their owner writes the same value for no power.
        unsafe {
            slice.cc().write(|w| w.bits(0));
            slice.ctr().write(|w| w.bits(LAST_COUNT));
        }
    }
}
