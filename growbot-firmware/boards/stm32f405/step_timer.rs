//! The timer of the step interrupt: TIM2, with 32 bits, so that every tick rate is exact to a clock of the timer.

use stm32f4xx_hal::pac;
use stm32f4xx_hal::rcc::{Enable, Rcc, Reset};

use crate::clock;

/// The running timer of the step interrupt.
pub struct StepTimer(pac::TIM2);

impl StepTimer {
    /// Starts the step interrupt at a rate that [`growbot_core::robot::Robot::check_for_board`] has accepted, Hz.
    pub fn start(timer: pac::TIM2, tick_hz: u32, rcc: &mut Rcc) -> Self {
        pac::TIM2::enable(rcc);
        pac::TIM2::reset(rcc);
        let period = clock::APB1_TIMER_HZ / tick_hz.max(1);
        timer.psc().write(|w| w.psc().set(0));
        timer.arr().write(|w| w.arr().set(period.saturating_sub(1)));
        timer.cnt().write(|w| w.cnt().set(0));
        timer.sr().write(|w| w.uif().clear());
        timer.dier().write(|w| w.uie().set_bit());
        timer.cr1().write(|w| w.cen().set_bit());
        StepTimer(timer)
    }

    /// Clears the flag of the step interrupt.
    pub fn acknowledge(&mut self) {
        self.0.sr().write(|w| w.uif().clear());
    }
}
