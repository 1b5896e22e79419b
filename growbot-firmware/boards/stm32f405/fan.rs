//! The fan: TIM12 channel 2, PWM at 1.28 kHz. It has a timer of its own, so that it cannot disturb the heater.

use core::convert::Infallible;

use embedded_hal::pwm::{ErrorType, SetDutyCycle};
use stm32f4xx_hal::pac;
use stm32f4xx_hal::rcc::{Enable, Rcc, Reset};

use crate::pins::FanPower;

/// Last count of a PWM period. The period has `u16::MAX` clocks, so that a duty of `u16::MAX` never goes low.
const LAST_COUNT: u16 = u16::MAX - 1;

/// PWM output of the fan.
pub struct FanPwm {
    timer: pac::TIM12,
    _pin: FanPower,
}

impl FanPwm {
    /// Starts the PWM with a duty of zero.
    pub fn new(timer: pac::TIM12, pin: FanPower, rcc: &mut Rcc) -> Self {
        pac::TIM12::enable(rcc);
        pac::TIM12::reset(rcc);
        timer.arr().write(|w| w.arr().set(LAST_COUNT));
        timer.ccr2().write(|w| w.ccr().set(0));
        // The compare value has no preload, so that a duty acts at once.
        timer.ccmr1_output().write(|w| w.oc2m().pwm_mode1());
        timer.ccer().write(|w| w.cc2e().set_bit());
        timer.cr1().write(|w| w.cen().set_bit());
        FanPwm { timer, _pin: pin }
    }
}

impl ErrorType for FanPwm {
    type Error = Infallible;
}

impl SetDutyCycle for FanPwm {
    fn max_duty_cycle(&self) -> u16 {
        u16::MAX
    }

    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        self.timer.ccr2().write(|w| w.ccr().set(duty));
        Ok(())
    }
}

/// Switches the fan off at once, from any context. The timer stays with its owner.
pub fn off() {
    // SAFETY: a single write of a whole register, which its owner also writes only as a whole.
    let timer = unsafe { &*pac::TIM12::ptr() };
    timer.ccr2().write(|w| w.ccr().set(0));
}
