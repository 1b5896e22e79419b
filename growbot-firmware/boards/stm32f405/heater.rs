//! Heater power: TIM1 channel 1, PWM at 1.28 kHz.
//!
//! An advanced timer, because its output goes low without the processor: where the processor is halted
//! (`debug_port.rs`), and where the crystal stops (the clock security system is a break of TIM1). Either clears MOE or
//! acts as if, and OSSI then drives the output to OIS1's level, which is low. After a break it stays so until the board
//! is reset.

use core::convert::Infallible;

use embedded_hal::pwm::{ErrorType, SetDutyCycle};
use stm32f4xx_hal::pac;
use stm32f4xx_hal::rcc::{Enable, Rcc};

use crate::pins::HeaterPower;

/// One period is this many clocks less one, so that a duty of `u16::MAX` never goes low.
const LAST_COUNT: u16 = u16::MAX - 1;
/// The timers of the second bus (APB2) run at 168 MHz; this makes 84.
const PRESCALER: u16 = 2;

/// The heater's power stage.
pub struct Heater {
    timer: pac::TIM1,
    _pin: HeaterPower,
}

impl Heater {
    /// Starts the PWM at no power. The timer is as the processor's reset has left it.
    pub fn new(timer: pac::TIM1, pin: HeaterPower, rcc: &mut Rcc) -> Self {
        pac::TIM1::enable(rcc);
        timer.psc().write(|w| w.psc().set(PRESCALER - 1));
        timer.arr().write(|w| w.arr().set(LAST_COUNT));
        timer.ccr1().write(|w| w.ccr().set(0));
        // Loads the prescaler, which would act from the end of the first period only.
        timer.egr().write(|w| w.ug().update());
        // No preload of the compare value: `off` is to act at once, not at the end of the period.
        timer.ccmr1_output().write(|w| w.oc1m().pwm_mode1());
        timer.ccer().write(|w| w.cc1e().set_bit());
        // CR2 stays 0: OIS1 is low. No pin is BKIN, so that input reads low: it must count as active high.
        timer.bdtr().write(|w| w.ossi().idle_level().bkp().active_high().bke().enabled().moe().enabled());
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

/// Switches the heater off at once. Its owner keeps it.
pub fn off() {
    // SAFETY: a single write of a whole register that its owner only ever writes whole.
    let timer = unsafe { &*pac::TIM1::ptr() };
    timer.ccr1().write(|w| w.ccr().set(0));
}
