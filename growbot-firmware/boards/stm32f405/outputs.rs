//! The outputs of the tip that must be off when anything is wrong.

use core::sync::atomic::Ordering;

use growbot_firmware::hal::Outputs;
use stm32f4xx_hal::pac;

use crate::pins::ENABLE_LOW;
use crate::{fan, heater};

/// All outputs of the tip (heater, fan and both stepper drivers), which the step interrupt switches off in an
/// emergency.
pub struct Stm32Outputs;

impl Outputs for Stm32Outputs {
    fn make_safe(&mut self) {
        make_safe();
    }
}

/// Switches heater, fan and both stepper drivers off at once, from any context. The pins stay with their owners.
pub fn make_safe() {
    // SAFETY: `bsrr` sets and clears single pins in one write, so that the owners of other pins are not disturbed.
    let (a, b, c) = unsafe { (&*pac::GPIOA::ptr(), &*pac::GPIOB::ptr(), &*pac::GPIOC::ptr()) };
    a.bsrr().write(|w| w.br7().set_bit());
    if ENABLE_LOW.load(Ordering::Relaxed) {
        c.bsrr().write(|w| w.bs8().set_bit());
        b.bsrr().write(|w| w.bs14().set_bit());
    } else {
        c.bsrr().write(|w| w.br8().set_bit());
        b.bsrr().write(|w| w.br14().set_bit());
    }
    heater::off();
    fan::off();
}
