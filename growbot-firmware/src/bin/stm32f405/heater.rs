//! Heater power: TIM3 channel 1, PWM at 1.28 kHz.

use core::convert::Infallible;

use embedded_hal::pwm::{ErrorType, SetDutyCycle};
use stm32f4xx_hal::gpio::{Alternate, PA6};
use stm32f4xx_hal::pac;
use stm32f4xx_hal::rcc::{Enable, Rcc, Reset};

/// One period is this many clocks less one, so that a duty of `u16::MAX` never goes low.
const LAST_COUNT: u16 = u16::MAX - 1;

/// The heater's power stage.
pub struct Heater {
    timer: pac::TIM3,
    _pin: PA6<Alternate<2>>,
}

impl Heater {
    /// Starts the PWM at no power.
    pub fn new(timer: pac::TIM3, pin: PA6<Alternate<2>>, rcc: &mut Rcc) -> Self {
        pac::TIM3::enable(rcc);
        pac::TIM3::reset(rcc);
        timer.arr().write(|w| w.arr().set(LAST_COUNT));
        timer.ccr1().write(|w| w.ccr().set(0));
        // No preload of the compare value: `off` is to act at once, not at the end of the period.
        timer.ccmr1_output().write(|w| w.oc1m().pwm_mode1());
        timer.ccer().write(|w| w.cc1e().set_bit());
        timer.cr1().write(|w| w.cen().set_bit());
        Heater { timer, _pin: pin }
    }
}

impl ErrorType for Heater {
    type Error = Infallible;
}

impl SetDutyCycle for Heater {
    fn max_duty_cycle(&self) -> u16 {
        u16::MAX
    }

    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        self.timer.ccr1().write(|w| w.ccr().set(duty));
        Ok(())
    }
}

/// No power, now, whoever owns the heater.
pub fn off() {
    // SAFETY: a single write of a whole register that its owner only ever writes whole.
    let timer = unsafe { &*pac::TIM3::ptr() };
    timer.ccr1().write(|w| w.ccr().set(0));
}
