//! What is wired where: the one table of the robot's pins.
//!
//! | signal | pin | kind | safe level |
//! |---|---|---|---|
//! | head STEP | PC6 | push-pull output | low |
//! | head DIR | PC7 | push-pull output | any |
//! | head EN | PC8 | push-pull output | off |
//! | feed STEP | PB12 | push-pull output | low |
//! | feed DIR | PB13 | push-pull output | any |
//! | feed EN | PB14 | push-pull output | off |
//! | drivers' fault outputs, joined | PC9 | input with pull-up | |
//! | heater power | PA6 | TIM3 channel 1, PWM | low |
//! | heater second switch | PA7 | push-pull output | low |
//! | fan | PB15 | TIM12 channel 2, PWM | low |
//! | thermistor | PC0 | ADC1 channel 10, analog | |
//! | supply voltage | PC1 | ADC1 channel 11, analog | |
//! | index sensor | PB6 | input with pull-up | |
//! | filament presence | PB5 | input with pull-up | |
//! | filament encoder | PB7 | input with pull-up | |
//! | emergency stop | PB8 | input with pull-up | |
//! | orientation sensor SCL | PB10 | open-drain output with pull-up | released |
//! | orientation sensor SDA | PB11 | open-drain output with pull-up | released |
//! | link, board to host | PA2 | USART2 TX | |
//! | link, host to board | PA3 | USART2 RX | |
//! | oscillator | PH0, PH1 | 8 MHz crystal | |
//! | debug probe | PA13, PA14 | SWD | |
//!
//! Which pins the published robots use is not known: this table is an assumption, for an STM32F405RG in its 64-pin package. PA15,
//! PB3 and PB4 are left alone, since they are JTAG's until software says otherwise. The levels of DIR, EN and the inputs are the robot
//! description's (`direction_high_is_positive`, `enable_low`, `active_low`, ...). What the board needs round the processor, first
//! of all resistors that hold everything off while its pins float, is in WIRING.md; a test holds the two tables equal.

use core::sync::atomic::{AtomicBool, Ordering};

use growbot_core::robot::RobotDescription;
use growbot_firmware::hal::Outputs;
use growbot_firmware::polarity::Polarized;
use stm32f4xx_hal::gpio::{Alternate, Analog, GpioExt, Input, Output, PinState, Pull};
use stm32f4xx_hal::gpio::{
    PA2, PA3, PA6, PA7, PB5, PB6, PB7, PB8, PB12, PB13, PB14, PB15, PC0, PC1, PC6, PC7, PC8, PC9,
};
use stm32f4xx_hal::pac;
use stm32f4xx_hal::rcc::Rcc;

use crate::tip_bus;

/// STEP of the head.
pub type HeadStep = PC6<Output>;
/// DIR of the head.
pub type HeadDirection = Polarized<PC7<Output>>;
/// EN of the head; high is energised.
pub type HeadEnable = Polarized<PC8<Output>>;
/// STEP of the feed.
pub type FeedStep = PB12<Output>;
/// DIR of the feed.
pub type FeedDirection = Polarized<PB13<Output>>;
/// EN of the feed; high is energised.
pub type FeedEnable = Polarized<PB14<Output>>;
/// The second switch in the heater's supply.
pub type HeaterEnable = PA7<Output>;
/// The index sensor.
pub type Index = Polarized<PB6<Input>>;
/// The encoder that the filament turns.
pub type FilamentMotion = PB7<Input>;
/// The emergency stop; high is pressed.
pub type EmergencyStop = Polarized<PB8<Input>>;
/// The filament's switch; high is filament.
pub type FilamentPresence = Polarized<PB5<Input>>;
/// The drivers' fault outputs; high is a fault.
pub type DriverFault = Polarized<PC9<Input>>;

/// Whether a low level enables the drivers: [`make_safe`] must know it whoever owns the pins.
static ENABLE_LOW: AtomicBool = AtomicBool::new(true);

/// All pins, each in its role and at its safe level.
pub struct Pins {
    /// STEP of the head.
    pub head_step: HeadStep,
    /// DIR of the head.
    pub head_direction: HeadDirection,
    /// EN of the head.
    pub head_enable: HeadEnable,
    /// STEP of the feed.
    pub feed_step: FeedStep,
    /// DIR of the feed.
    pub feed_direction: FeedDirection,
    /// EN of the feed.
    pub feed_enable: FeedEnable,
    /// Output of the heater's PWM.
    pub heater: PA6<Alternate<2>>,
    /// The second switch in the heater's supply.
    pub heater_enable: HeaterEnable,
    /// Output of the fan's PWM.
    pub fan: PB15<Alternate<9>>,
    /// Divider of the thermistor.
    pub thermistor: PC0<Analog>,
    /// Divider of the supply.
    pub supply: PC1<Analog>,
    /// The filament's switch.
    pub filament_presence: FilamentPresence,
    /// The drivers' fault outputs.
    pub driver_fault: DriverFault,
    /// SCL of the orientation sensor.
    pub orientation_clock: tip_bus::Clock,
    /// SDA of the orientation sensor.
    pub orientation_data: tip_bus::Data,
    /// Index sensor of the head.
    pub index: Index,
    /// The encoder that the filament turns.
    pub filament_motion: FilamentMotion,
    /// The emergency stop.
    pub emergency_stop: EmergencyStop,
    /// TX of the link.
    pub link_tx: PA2<Alternate<7>>,
    /// RX of the link.
    pub link_rx: PA3<Alternate<7>>,
}

impl Pins {
    /// Takes the ports and gives each pin its role. Outputs get their level before they become outputs.
    pub fn new(robot: &RobotDescription, a: pac::GPIOA, b: pac::GPIOB, c: pac::GPIOC, rcc: &mut Rcc) -> Self {
        let enable_low = robot.motion.enable_low;
        ENABLE_LOW.store(enable_low, Ordering::Relaxed);
        let off = PinState::from(enable_low);
        let head_backwards = !robot.head.direction_high_is_positive;
        let feed_backwards = !robot.feed.direction_high_is_forward;
        let sensors = &robot.sensors;
        // Those of sensors that the robot does not have are not asked, so any level will do.
        let active_low = |input: Option<growbot_core::robot::Input>| input.is_some_and(|input| input.active_low);
        let (a, b, c) = (a.split(rcc), b.split(rcc), c.split(rcc));
        Pins {
            head_step: c.pc6.into_push_pull_output_in_state(PinState::Low),
            head_direction: Polarized::new(c.pc7.into_push_pull_output_in_state(PinState::Low), head_backwards),
            head_enable: Polarized::new(c.pc8.into_push_pull_output_in_state(off), enable_low),
            feed_step: b.pb12.into_push_pull_output_in_state(PinState::Low),
            feed_direction: Polarized::new(b.pb13.into_push_pull_output_in_state(PinState::Low), feed_backwards),
            feed_enable: Polarized::new(b.pb14.into_push_pull_output_in_state(off), enable_low),
            heater: a.pa6.into_alternate(),
            heater_enable: a.pa7.into_push_pull_output_in_state(PinState::Low),
            fan: b.pb15.into_alternate(),
            thermistor: c.pc0.into_analog(),
            supply: c.pc1.into_analog(),
            filament_presence: Polarized::new(b.pb5.into_pull_up_input(), active_low(sensors.filament_presence)),
            driver_fault: Polarized::new(c.pc9.into_pull_up_input(), active_low(sensors.driver_fault)),
            orientation_clock: b.pb10.into_open_drain_output_in_state(PinState::High).internal_resistor(Pull::Up),
            orientation_data: b.pb11.into_open_drain_output_in_state(PinState::High).internal_resistor(Pull::Up),
            index: Polarized::new(b.pb6.into_pull_up_input(), robot.head.index_low_on_mark),
            filament_motion: b.pb7.into_pull_up_input(),
            emergency_stop: Polarized::new(b.pb8.into_pull_up_input(), active_low(sensors.emergency_stop)),
            link_tx: a.pa2.into_alternate(),
            link_rx: a.pa3.into_alternate(),
        }
    }
}

/// Heater, fan and both drivers, for the step interrupt.
pub struct TipOutputs;

impl Outputs for TipOutputs {
    fn make_safe(&mut self) {
        make_safe();
    }
}

/// Heater, fan and both drivers off, now, from any context, whoever owns the pins.
pub fn make_safe() {
    // SAFETY: `bsrr` sets and clears single pins in one write, so that no other pin's owner is disturbed.
    let (a, b, c) = unsafe { (&*pac::GPIOA::ptr(), &*pac::GPIOB::ptr(), &*pac::GPIOC::ptr()) };
    a.bsrr().write(|w| w.br7().set_bit());
    if ENABLE_LOW.load(Ordering::Relaxed) {
        c.bsrr().write(|w| w.bs8().set_bit());
        b.bsrr().write(|w| w.bs14().set_bit());
    } else {
        c.bsrr().write(|w| w.br8().set_bit());
        b.bsrr().write(|w| w.br14().set_bit());
    }
    crate::heater::off();
    crate::fan::off();
}
