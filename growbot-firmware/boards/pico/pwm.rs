//! Power of heater and fan: PWM at 1.9 kHz. Heater and fan each have a PWM slice of their own.

use core::convert::Infallible;
use core::sync::atomic::{AtomicU32, Ordering};

use embedded_hal::pwm::{ErrorType, SetDutyCycle};
use growbot_core::robot::pwm_slice;
use rp2040_pac as pac;

/// Numbers of the PWM slices of heater and fan, for [`off`]; [`NONE`] before a slice is started.
static STAGES: [AtomicU32; 2] = [AtomicU32::new(NONE), AtomicU32::new(NONE)];
const NONE: u32 = u32::MAX;
/// Last count of a PWM period. The period has `u16::MAX` clocks, so that a duty of `u16::MAX` never goes low.
const LAST_COUNT: u32 = u16::MAX as u32 - 1;
/// Value of the clock divider for a division by 1: the value has 4 fractional bits.
const UNDIVIDED: u32 = 1 << 4;
const ENABLE: u32 = 1;

/// PWM of the heater's power stage or of the fan. `None` without a pin. The other channel of its slice has no pin.
pub struct PwmOutput(Option<Channel>);

/// A channel of a PWM slice that drives a pin.
#[derive(Clone, Copy)]
struct Channel {
    slice: usize,
    /// Number of bits by which the channel's level is shifted in the register: 16 for channel B, at odd pins, and 0 for
    /// A.
    shift: u32,
}

fn slice(slice: usize) -> &'static pac::pwm::CH {
    // SAFETY: only this file accesses the slices of heater and fan, and there are eight.
    unsafe { &*pac::PWM::ptr() }.ch(slice % 8)
}

impl PwmOutput {
    /// Starts the PWM of a pin with a duty of zero. The slice must be in its state after the reset. If `pin` is `None`
    /// the duty has no effect.
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

    /// Sets the duty. The change takes effect at the end of the PWM period, within 0.53 ms.
    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        if let Some(Channel { slice: number, shift }) = self.0 {
            // SAFETY: the level of one channel. The other channel has no pin.
            slice(number).cc().write(|w| unsafe { w.bits(u32::from(duty) << shift) });
        }
        Ok(())
    }
}

/// Switches heater and fan off within a PWM period. The comparison value is buffered until the period ends, so the
/// count is set to its end. The channels stay with their owners.
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
