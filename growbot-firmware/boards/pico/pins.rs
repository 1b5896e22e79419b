//! The board's pins: the pin of each signal, from the robot's description.
//!
//! The description defines the levels of DIR, EN and the inputs. Until [`PicoPins::new`] configures a pin, it has a
//! weak pull-down. Heater, fan and drivers therefore need resistors that keep them off.

use core::convert::Infallible;
use core::sync::atomic::{AtomicU32, Ordering};

use embedded_hal::digital::{ErrorType, InputPin, OutputPin, PinState};
use growbot_core::robot::{BoardDescription, BoardKind, DigitalInput, PinOverrides, Signal};
use growbot_firmware::board_robot::BoardRobot;
use growbot_firmware::hal::Outputs;
use growbot_firmware::invertible_pin::InvertiblePin;
use rp2040_pac as pac;

/// Number that connects a pin to a UART (data sheet of the RP2040, table 2.19.2). The next constants are those of the
/// other functions of a pin.
const FUNCTION_UART: u32 = 2;
const FUNCTION_PWM: u32 = 4;
const FUNCTION_SIO: u32 = 5;
const FUNCTION_NONE: u32 = 31;
/// Settings of a digital pin's pad: input enabled, Schmitt trigger, 4 mA.
const PAD: u32 = 1 << 6 | 1 << 4 | 1 << 1;
const PULL_UP: u32 = 1 << 3;
const PULL_DOWN: u32 = 1 << 2;
/// Settings of an analog pin's pad: output disabled, everything else off.
const PAD_ANALOG: u32 = 1 << 7;

/// DIR pin of a stepper driver, with logical levels.
pub type Direction = InvertiblePin<Output>;
/// EN pin of a stepper driver, with logical levels. High energises the motor.
pub type Enable = InvertiblePin<Output>;
/// Input pin of a sensor, with logical levels.
pub type Sensor = InvertiblePin<Level>;

/// Pin on which UART0 sends to the host. `LINK_RX` is the pin on which it receives.
const LINK_TX: u8 = 0;
const LINK_RX: u8 = 1;
/// Pin on which UART1 sends to the stepper drivers. `DRIVERS_RX` is the pin on which it receives.
const DRIVERS_TX: u8 = 8;
const DRIVERS_RX: u8 = 9;

/// EN pins of the SKR Pico's drivers that no robot uses, at the terminals ZM and YM. High switches a driver off.
const UNUSED_ENABLES: [u8; 2] = [2, 7];

/// Pins that [`make_safe`] sets low, a bit for each pin. `SAFE_HIGH` contains the pins that it sets high. Both are 0
/// until the pins are configured.
static SAFE_LOW: AtomicU32 = AtomicU32::new(0);
static SAFE_HIGH: AtomicU32 = AtomicU32::new(0);

/// Returns the registers of the pins (SIO), which set and clear single pins in one write.
fn sio() -> &'static pac::sio::RegisterBlock {
    // SAFETY: only the pin's owner and `make_safe` write a pin's bit.
    unsafe { &*pac::SIO::ptr() }
}

fn set(pins: u32, high: bool) {
    if high {
        // SAFETY: sets the levels of pins.
        sio().gpio_out_set().write(|w| unsafe { w.bits(pins) });
    } else {
        // SAFETY: as above.
        sio().gpio_out_clr().write(|w| unsafe { w.bits(pins) });
    }
}

fn drive(pins: u32, on: bool) {
    if on {
        // SAFETY: makes pins outputs.
        sio().gpio_oe_set().write(|w| unsafe { w.bits(pins) });
    } else {
        // SAFETY: makes pins inputs.
        sio().gpio_oe_clr().write(|w| unsafe { w.bits(pins) });
    }
}

fn level(pins: u32) -> bool {
    sio().gpio_in().read().bits() & pins != 0
}

/// Returns the bit mask of a pin, or 0 if `pin` is `None`.
fn bit(pin: Option<u8>) -> u32 {
    pin.map_or(0, |pin| 1_u32.checked_shl(u32::from(pin)).unwrap_or(0))
}

/// Output pin, stored as its bit mask. With the mask 0 it has no effect.
pub struct Output(u32);

/// Input pin, stored as its bit mask. With the mask 0 it reads as low.
pub struct Level(u32);

/// Open-drain pin, stored as its bit mask: it drives low, and is released for high.
pub struct OpenDrain(u32);

impl ErrorType for Output {
    type Error = Infallible;
}

impl ErrorType for Level {
    type Error = Infallible;
}

impl ErrorType for OpenDrain {
    type Error = Infallible;
}

impl OutputPin for Output {
    fn set_low(&mut self) -> Result<(), Infallible> {
        set(self.0, false);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        set(self.0, true);
        Ok(())
    }
}

impl InputPin for Level {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(level(self.0))
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(!level(self.0))
    }
}

impl OutputPin for OpenDrain {
    fn set_low(&mut self) -> Result<(), Infallible> {
        drive(self.0, true);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        drive(self.0, false);
        Ok(())
    }
}

impl InputPin for OpenDrain {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(level(self.0))
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(!level(self.0))
    }
}

/// The peripherals that configure pads and functions of the pins.
struct PinMux {
    io: pac::IO_BANK0,
    pads: pac::PADS_BANK0,
}

impl PinMux {
    /// Sets the pad and the function of a pin. Does nothing for a pin that the processor does not have.
    fn give(&self, pin: Option<u8>, pad: u32, function: u32) {
        if let Some(pin) = pin.map(usize::from).filter(|pin| *pin < 30) {
            // SAFETY: a pad's pulls and drive, and a function of the data sheet's table.
            unsafe {
                self.pads.gpio(pin).write(|w| w.bits(pad));
                self.io.gpio(pin).gpio_ctrl().write(|w| w.bits(function));
            }
        }
    }

    /// Configures a pin as an output. Its level is set before it becomes an output.
    fn output(&self, pin: Option<u8>, high: bool) -> Output {
        set(bit(pin), high);
        drive(bit(pin), true);
        self.give(pin, PAD | if high { PULL_UP } else { PULL_DOWN }, FUNCTION_SIO);
        Output(bit(pin))
    }

    fn input(&self, pin: Option<u8>) -> Level {
        drive(bit(pin), false);
        self.give(pin, PAD | PULL_UP, FUNCTION_SIO);
        Level(bit(pin))
    }

    fn open_drain(&self, pin: Option<u8>) -> OpenDrain {
        drive(bit(pin), false);
        set(bit(pin), false);
        self.give(pin, PAD | PULL_UP, FUNCTION_SIO);
        OpenDrain(bit(pin))
    }
}

/// The configured pins of all signals, each at its safe level, and the numbers of the pins that the ADC and the PWM
/// use.
pub struct PicoPins {
    /// STEP pin of the head's driver.
    pub head_step: Output,
    /// DIR pin of the head's driver.
    pub head_direction: Direction,
    /// EN pin of the head's driver.
    pub head_enable: Enable,
    /// STEP pin of the feed's driver.
    pub feed_step: Output,
    /// DIR pin of the feed's driver.
    pub feed_direction: Direction,
    /// EN pin of the feed's driver.
    pub feed_enable: Enable,
    /// Number of the pin of the heater's power stage. `None` if the board is not configured.
    pub heater: Option<u8>,
    /// Second switch, in series with the heater's power stage.
    pub heater_enable: Output,
    /// Number of the pin of the fan. `None` if the board is not configured.
    pub fan: Option<u8>,
    /// Presence switch of the filament. High means that filament is present.
    pub filament_presence: Sensor,
    /// Fault outputs of the stepper drivers. High means a fault.
    pub driver_fault: Sensor,
    /// SCL pin of the orientation sensor.
    pub orientation_clock: OpenDrain,
    /// SDA pin of the orientation sensor.
    pub orientation_data: OpenDrain,
    /// Index sensor of the head. High means that the head is on the index mark.
    pub index: Sensor,
    /// Input of the encoder that the filament turns.
    pub filament_motion: Level,
    /// Input of the emergency stop. High means that it is pressed.
    pub emergency_stop: Sensor,
    /// Number of the thermistor's pin. `None` if the board is not configured.
    pub thermistor: Option<u8>,
    /// Number of the pin that measures the supply voltage. `None` if the supply is not measured.
    pub supply: Option<u8>,
}

impl PicoPins {
    /// Configures the pins for the robot's board. If the board is not configured, all pins except those of the link
    /// stay in their state after the reset.
    pub fn new(board_robot: &BoardRobot, io: pac::IO_BANK0, pads: pac::PADS_BANK0) -> Self {
        let BoardRobot { ref robot, configured } = *board_robot;
        let robot = robot.description();
        let roles = PinMux { io, pads };
        roles.give(Some(LINK_TX), PAD, FUNCTION_UART);
        // Without an adapter the line idles, instead of picking up bytes.
        roles.give(Some(LINK_RX), PAD | PULL_UP, FUNCTION_UART);
        let board = robot.board.unwrap_or(BoardDescription { kind: BoardKind::Pico, pins: PinOverrides::default() });
        if configured && board.kind.has_onboard_drivers() {
            roles.give(Some(DRIVERS_TX), PAD, FUNCTION_UART);
            roles.give(Some(DRIVERS_RX), PAD | PULL_UP, FUNCTION_UART);
            for enable in UNUSED_ENABLES {
                roles.output(Some(enable), true);
            }
        }
        let pin = |signal: Signal| board.pin(signal).filter(|_| configured && signal.is_used(robot));
        let enable_low = robot.motion.enable_low;
        let on = PinState::from(!enable_low);
        let enables = bit(pin(Signal::HeadEnable)) | bit(pin(Signal::FeedEnable));
        SAFE_LOW.store(bit(pin(Signal::HeaterEnable)) | if enable_low { 0 } else { enables }, Ordering::Relaxed);
        SAFE_HIGH.store(if enable_low { enables } else { 0 }, Ordering::Relaxed);
        for signal in [Signal::Heater, Signal::Fan] {
            roles.give(pin(signal), PAD | PULL_DOWN, FUNCTION_PWM);
        }
        for signal in [Signal::Thermistor, Signal::Supply] {
            roles.give(pin(signal), PAD_ANALOG, FUNCTION_NONE);
        }
        let sensors = &robot.sensors;
        // The inputs of sensors that the robot does not have are never read, so that any level is valid.
        let active = |input: Option<DigitalInput>| PinState::from(input.is_none_or(|input| !input.active_low));
        let output = |signal, high| roles.output(pin(signal), high);
        let input = |signal| roles.input(pin(signal));
        PicoPins {
            head_step: output(Signal::HeadStep, false),
            head_direction: InvertiblePin::new(
                output(Signal::HeadDirection, false),
                PinState::from(robot.head.direction_high_is_positive),
            ),
            head_enable: InvertiblePin::new(output(Signal::HeadEnable, enable_low), on),
            feed_step: output(Signal::FeedStep, false),
            feed_direction: InvertiblePin::new(
                output(Signal::FeedDirection, false),
                PinState::from(robot.feed.direction_high_is_forward),
            ),
            feed_enable: InvertiblePin::new(output(Signal::FeedEnable, enable_low), on),
            heater: pin(Signal::Heater),
            heater_enable: output(Signal::HeaterEnable, false),
            fan: pin(Signal::Fan),
            filament_presence: InvertiblePin::new(input(Signal::FilamentPresence), active(sensors.filament_presence)),
            driver_fault: InvertiblePin::new(input(Signal::DriverFault), active(sensors.driver_fault)),
            orientation_clock: roles.open_drain(pin(Signal::OrientationClock)),
            orientation_data: roles.open_drain(pin(Signal::OrientationData)),
            index: InvertiblePin::new(input(Signal::Index), PinState::from(!robot.head.index_low_on_mark)),
            filament_motion: input(Signal::FilamentMotion),
            emergency_stop: InvertiblePin::new(input(Signal::EmergencyStop), active(sensors.emergency_stop)),
            thermistor: pin(Signal::Thermistor),
            supply: pin(Signal::Supply),
        }
    }
}

/// All outputs of the tip (heater, fan and both stepper drivers), which the step interrupt switches off in an
/// emergency.
pub struct PicoOutputs;

impl Outputs for PicoOutputs {
    fn make_safe(&mut self) {
        make_safe();
    }
}

/// Switches heater, fan and both stepper drivers off at once, from any context. The pins stay with their owners.
pub fn make_safe() {
    set(SAFE_LOW.load(Ordering::Relaxed), false);
    set(SAFE_HIGH.load(Ordering::Relaxed), true);
    crate::pwm::off();
}
