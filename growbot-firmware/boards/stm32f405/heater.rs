//! PWM of the heater's power stage: TIM1 channel 1, at 1.28 kHz.
//!
//! TIM1 is an advanced timer. It is used because its output goes low without help of the processor: if the processor is
//! halted (`debug_port.rs`), and if the crystal stops (the clock security system triggers the break of TIM1). Both
//! clear MOE or have the same effect, and OSSI then drives the output to OIS1's level, which is low. After a break it
//! stays low until the board is reset.

use core::convert::Infallible;

use embedded_hal::pwm::{ErrorType, SetDutyCycle};
use stm32f4xx_hal::pac;
use stm32f4xx_hal::rcc::{Enable, Rcc};

use crate::pins::HeaterPower;

/// Last count of a PWM period. The period has `u16::MAX` clocks, so that a duty of `u16::MAX` never goes low.
const LAST_COUNT: u16 = u16::MAX - 1;
/// Divider of the timer's clock. The timers of the second bus (APB2) run at 168 MHz, and the divider reduces that to 84
/// MHz.
const PRESCALER: u16 = 2;

/// PWM output of the heater's power stage.
pub struct HeaterPwm {
    timer: pac::TIM1,
    _pin: HeaterPower,
}

impl HeaterPwm {
    /// Starts the PWM with a duty of zero. The timer must be in its state after the processor's reset.
    pub fn new(timer: pac::TIM1, pin: HeaterPower, rcc: &mut Rcc) -> Self {
        pac::TIM1::enable(rcc);
        timer.psc().write(|w| w.psc().set(PRESCALER - 1));
        timer.arr().write(|w| w.arr().set(LAST_COUNT));
        timer.ccr1().write(|w| w.ccr().set(0));
        // Loads the prescaler, which would otherwise act only from the end of the first period.
        timer.egr().write(|w| w.ug().update());
        // The compare value has no preload, so that `off` acts at once, not at the end of the period.
        timer.ccmr1_output().write(|w| w.oc1m().pwm_mode1());
        timer.ccer().write(|w| w.cc1e().set_bit());
        // CR2 stays 0, so that OIS1 is low. No pin is BKIN, so that input reads low and must count as active high.
        timer.bdtr().write(|w| w.ossi().idle_level().bkp().active_high().bke().enabled().moe().enabled());
        timer.cr1().write(|w| w.cen().set_bit());
        HeaterPwm { timer, _pin: pin }
    }
}

impl ErrorType for HeaterPwm {
    type Error = Infallible;
}

impl SetDutyCycle for HeaterPwm {
    fn max_duty_cycle(&self) -> u16 {
        u16::MAX
    }

    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        self.timer.ccr1().write(|w| w.ccr().set(duty));
        Ok(())
    }
}

/// Switches the heater off at once, from any context. The timer stays with its owner.
pub fn off() {
    // SAFETY: a single write of a whole register, which its owner also writes only as a whole.
    let timer = unsafe { &*pac::TIM1::ptr() };
    timer.ccr1().write(|w| w.ccr().set(0));
}
