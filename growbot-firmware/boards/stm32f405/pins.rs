//! The board's pins: a type for each signal of WIRING.md's table, named after the signal.
//!
//! The pins of the published robots are not known. This table is an assumption, for an STM32F405RG in its 64-pin
//! package. PA15, PB3 and PB4 are not used, because they are JTAG's until software changes that. The robot's
//! description defines the levels of DIR, EN and the inputs (`direction_high_is_positive`, `enable_low`, `active_low`,
//! ...). WIRING.md lists the parts that the board needs around the processor, above all resistors that keep everything
//! off while its pins float. A test compares its table with these types, and with the values that the image writes to
//! the ports.

use core::sync::atomic::{AtomicBool, Ordering};

use embedded_hal::digital;
use growbot_core::robot::{DigitalInput, RobotDescription};
use growbot_firmware::invertible_pin::InvertiblePin;
use stm32f4xx_hal::gpio::{Alternate, Analog, GpioExt, Input, OpenDrain, Output, PinState, Pull};
use stm32f4xx_hal::gpio::{
    PA2, PA3, PA7, PA8, PB5, PB6, PB7, PB8, PB10, PB11, PB12, PB13, PB14, PB15, PC0, PC1, PC6, PC7, PC8, PC9,
};
use stm32f4xx_hal::pac;
use stm32f4xx_hal::rcc::Rcc;

/// Signal `head STEP` of the table in WIRING.md.
pub type HeadStep = PC6<Output>;
/// Signal `head DIR` of the table in WIRING.md, with logical levels.
pub type HeadDirection = InvertiblePin<PC7<Output>>;
/// Signal `head EN` of the table in WIRING.md, with logical levels. High energises the motor.
pub type HeadEnable = InvertiblePin<PC8<Output>>;
/// Signal `feed STEP` of the table in WIRING.md.
pub type FeedStep = PB12<Output>;
/// Signal `feed DIR` of the table in WIRING.md, with logical levels.
pub type FeedDirection = InvertiblePin<PB13<Output>>;
/// Signal `feed EN` of the table in WIRING.md, with logical levels. High energises the motor.
pub type FeedEnable = InvertiblePin<PB14<Output>>;
/// Signal `drivers' fault outputs, joined` of the table in WIRING.md, with logical levels. High means a fault.
pub type DriverFault = InvertiblePin<PC9<Input>>;
/// Signal `heater power` of the table in WIRING.md.
pub type HeaterPower = PA8<Alternate<1>>;
/// Signal `heater second switch` of the table in WIRING.md.
pub type HeaterEnable = PA7<Output>;
/// Signal `fan` of the table in WIRING.md.
pub type FanPower = PB15<Alternate<9>>;
/// Signal `thermistor` of the table in WIRING.md.
pub type ThermistorInput = PC0<Analog>;
/// Signal `supply voltage` of the table in WIRING.md.
pub type SupplyInput = PC1<Analog>;
/// Signal `index sensor` of the table in WIRING.md, with logical levels. High means that the head is on the index mark.
pub type Index = InvertiblePin<PB6<Input>>;
/// Signal `filament presence` of the table in WIRING.md, with logical levels. High means that filament is present.
pub type FilamentPresence = InvertiblePin<PB5<Input>>;
/// Signal `filament encoder` of the table in WIRING.md.
pub type FilamentMotionPin = PB7<Input>;
/// Signal `emergency stop` of the table in WIRING.md, with logical levels. High means that it is pressed.
pub type EmergencyStop = InvertiblePin<PB8<Input>>;
/// Signal `orientation sensor SCL` of the table in WIRING.md.
pub type OrientationClock = PB10<Output<OpenDrain>>;
/// Signal `orientation sensor SDA` of the table in WIRING.md.
pub type OrientationData = PB11<Output<OpenDrain>>;
/// Signal `link, board to host` of the table in WIRING.md.
pub type LinkTx = PA2<Alternate<7>>;
/// Signal `link, host to board` of the table in WIRING.md.
pub type LinkRx = PA3<Alternate<7>>;

/// True if a low level at EN energises a motor. `outputs::make_safe`, which does not own the pins, reads this.
pub static ENABLE_LOW: AtomicBool = AtomicBool::new(true);

/// The configured pins of all signals, each at its safe level.
pub struct Stm32Pins {
    /// STEP pin of the head's driver.
    pub head_step: HeadStep,
    /// DIR pin of the head's driver.
    pub head_direction: HeadDirection,
    /// EN pin of the head's driver.
    pub head_enable: HeadEnable,
    /// STEP pin of the feed's driver.
    pub feed_step: FeedStep,
    /// DIR pin of the feed's driver.
    pub feed_direction: FeedDirection,
    /// EN pin of the feed's driver.
    pub feed_enable: FeedEnable,
    /// Output of the heater's PWM.
    pub heater: HeaterPower,
    /// Second switch, in series with the heater's power stage.
    pub heater_enable: HeaterEnable,
    /// Output of the fan's PWM.
    pub fan: FanPower,
    /// Analog input of the thermistor's voltage divider.
    pub thermistor: ThermistorInput,
    /// Analog input of the supply's voltage divider.
    pub supply: SupplyInput,
    /// Presence switch of the filament.
    pub filament_presence: FilamentPresence,
    /// Joined fault outputs of the stepper drivers.
    pub driver_fault: DriverFault,
    /// SCL pin of the orientation sensor.
    pub orientation_clock: OrientationClock,
    /// SDA pin of the orientation sensor.
    pub orientation_data: OrientationData,
    /// Input of the head's index sensor.
    pub index: Index,
    /// Input of the encoder that the filament turns.
    pub filament_motion: FilamentMotionPin,
    /// Input of the emergency stop.
    pub emergency_stop: EmergencyStop,
    /// TX pin of the link's UART.
    pub link_tx: LinkTx,
    /// RX pin of the link's UART.
    pub link_rx: LinkRx,
}

impl Stm32Pins {
    /// Configures the pins for a robot and returns them. An output's level is set before it becomes an output.
    pub fn new(robot: &RobotDescription, a: pac::GPIOA, b: pac::GPIOB, c: pac::GPIOC, rcc: &mut Rcc) -> Self {
        let enable_low = robot.motion.enable_low;
        ENABLE_LOW.store(enable_low, Ordering::Relaxed);
        let off = PinState::from(enable_low);
        let on = digital::PinState::from(!enable_low);
        let head_positive = digital::PinState::from(robot.head.direction_high_is_positive);
        let feed_forward = digital::PinState::from(robot.feed.direction_high_is_forward);
        let sensors = &robot.sensors;
        // The inputs of sensors that the robot does not have are never read, so that any level is valid.
        let active = |input: Option<DigitalInput>| digital::PinState::from(input.is_none_or(|input| !input.active_low));
        let (a, b, c) = (a.split(rcc), b.split(rcc), c.split(rcc));
        Stm32Pins {
            head_step: c.pc6.into_push_pull_output_in_state(PinState::Low),
            head_direction: InvertiblePin::new(c.pc7.into_push_pull_output_in_state(PinState::Low), head_positive),
            head_enable: InvertiblePin::new(c.pc8.into_push_pull_output_in_state(off), on),
            feed_step: b.pb12.into_push_pull_output_in_state(PinState::Low),
            feed_direction: InvertiblePin::new(b.pb13.into_push_pull_output_in_state(PinState::Low), feed_forward),
            feed_enable: InvertiblePin::new(b.pb14.into_push_pull_output_in_state(off), on),
            // The processor's own pull-downs supplement those at the gate drivers, because the timers' outputs may be
            // off and a wire may break.
            heater: a.pa8.into_alternate().internal_resistor(Pull::Down),
            heater_enable: a.pa7.into_push_pull_output_in_state(PinState::Low).internal_resistor(Pull::Down),
            fan: b.pb15.into_alternate().internal_resistor(Pull::Down),
            thermistor: c.pc0.into_analog(),
            supply: c.pc1.into_analog(),
            filament_presence: InvertiblePin::new(b.pb5.into_pull_up_input(), active(sensors.filament_presence)),
            driver_fault: InvertiblePin::new(c.pc9.into_pull_up_input(), active(sensors.driver_fault)),
            orientation_clock: b.pb10.into_open_drain_output_in_state(PinState::High).internal_resistor(Pull::Up),
            orientation_data: b.pb11.into_open_drain_output_in_state(PinState::High).internal_resistor(Pull::Up),
            index: InvertiblePin::new(
                b.pb6.into_pull_up_input(),
                digital::PinState::from(!robot.head.index_low_on_mark),
            ),
            filament_motion: b.pb7.into_pull_up_input(),
            emergency_stop: InvertiblePin::new(b.pb8.into_pull_up_input(), active(sensors.emergency_stop)),
            link_tx: a.pa2.into_alternate(),
            // Without an adapter the line idles, instead of picking up bytes.
            link_rx: a.pa3.into_alternate().internal_resistor(Pull::Up),
        }
    }
}
