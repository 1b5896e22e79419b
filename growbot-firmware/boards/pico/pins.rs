//! The wiring: the pin of each signal, from the robot's description.
//!
//! The description defines the levels of DIR, EN and the inputs. Until [`PicoPins::new`] configures a pin, it has a
//! weak pull-down. Heater, fan and drivers therefore need resistors that keep them off.

use core::convert::Infallible;
use core::sync::atomic::{AtomicU32, Ordering};

use embedded_hal::digital::{ErrorType, InputPin, OutputPin};
use growbot_core::robot::{BoardDescription, BoardKind, DigitalInput, PinOverrides, RobotDescription, Signal};
use growbot_firmware::hal::Outputs;
use growbot_firmware::invertible_pin::InvertiblePin;
use rp2040_pac as pac;

/// Functions of a pin (data sheet of the RP2040, table 2.19.2).
const FUNCTION_UART: u32 = 2;
const FUNCTION_PWM: u32 = 4;
const FUNCTION_SIO: u32 = 5;
const FUNCTION_NONE: u32 = 31;
/// Pad: input enabled, Schmitt trigger, 4 mA.
const PAD: u32 = 1 << 6 | 1 << 4 | 1 << 1;
const PULL_UP: u32 = 1 << 3;
const PULL_DOWN: u32 = 1 << 2;
/// Pad of an analog input: output disabled, all else off.
const PAD_ANALOG: u32 = 1 << 7;

/// DIR of a driver, with its logical level.
pub type Direction = InvertiblePin<Output>;
/// EN of a driver. High is energised.
pub type Enable = InvertiblePin<Output>;
/// A sensor's input, with its logical level.
pub type Sensor = InvertiblePin<Level>;

/// Pins of the link: UART0, to the host and from it.
const LINK_TX: u8 = 0;
const LINK_RX: u8 = 1;
/// Pins of the stepper drivers' line: UART1, to the drivers and from them.
const DRIVERS_TX: u8 = 8;
const DRIVERS_RX: u8 = 9;

/// EN of the SKR Pico's drivers that no robot uses, at ZM and YM. High is off.
const UNUSED_ENABLES: [u8; 2] = [2, 7];

/// Pins that [`make_safe`] sets low, and pins that it sets high: a bit for each pin. Both are 0 until the pins are
/// configured.
static SAFE_LOW: AtomicU32 = AtomicU32::new(0);
static SAFE_HIGH: AtomicU32 = AtomicU32::new(0);

/// Returns the single-cycle block of the pins. Its registers set and clear single pins in one write.
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

/// Returns the bit of a pin, and 0 without a pin.
fn bit(pin: Option<u8>) -> u32 {
    pin.map_or(0, |pin| 1_u32.checked_shl(u32::from(pin)).unwrap_or(0))
}

/// A pin that drives both levels, as its bit. Without a bit it does nothing.
pub struct Output(u32);

/// A pin that is read. Without a bit it is low.
pub struct Level(u32);

/// A pin that drives low and is released for high.
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

/// The peripherals that configure the pins.
struct PinMux {
    io: pac::IO_BANK0,
    pads: pac::PADS_BANK0,
}

impl PinMux {
    /// Sets a pin's pad and function. A pin that the processor does not have is ignored.
    fn give(&self, pin: Option<u8>, pad: u32, function: u32) {
        if let Some(pin) = pin.map(usize::from).filter(|pin| *pin < 30) {
            // SAFETY: a pad's pulls and drive, and a function of the data sheet's table.
            unsafe {
                self.pads.gpio(pin).write(|w| w.bits(pad));
                self.io.gpio(pin).gpio_ctrl().write(|w| w.bits(function));
            }
        }
    }

    /// Configures an output. Its level is set before it becomes an output.
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

/// All pins that have an owner, each configured and at its safe level, and the numbers of the pins that the ADC and the
/// PWM use.
pub struct PicoPins {
    /// STEP of the head.
    pub head_step: Output,
    /// DIR of the head.
    pub head_direction: Direction,
    /// EN of the head.
    pub head_enable: Enable,
    /// STEP of the feed.
    pub feed_step: Output,
    /// DIR of the feed.
    pub feed_direction: Direction,
    /// EN of the feed.
    pub feed_enable: Enable,
    /// Power of the heater.
    pub heater: Option<u8>,
    /// Second switch in the heater's supply.
    pub heater_enable: Output,
    /// Fan.
    pub fan: Option<u8>,
    /// Presence switch of the filament. High is filament.
    pub filament_presence: Sensor,
    /// Fault outputs of the drivers. High is a fault.
    pub driver_fault: Sensor,
    /// SCL of the orientation sensor.
    pub orientation_clock: OpenDrain,
    /// SDA of the orientation sensor.
    pub orientation_data: OpenDrain,
    /// Index sensor of the head. High is on the mark.
    pub index: Sensor,
    /// Encoder that the filament turns.
    pub filament_motion: Level,
    /// Emergency stop. High is pressed.
    pub emergency_stop: Sensor,
    /// Thermistor.
    pub thermistor: Option<u8>,
    /// Supply.
    pub supply: Option<u8>,
}

impl PicoPins {
    /// Configures each pin for the robot's board. Without a robot all pins except the link's stay in their state after
    /// the reset.
    pub fn new(robot: &RobotDescription, configured: bool, io: pac::IO_BANK0, pads: pac::PADS_BANK0) -> Self {
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
        let active_low = |input: Option<DigitalInput>| input.is_some_and(|input| input.active_low);
        let output = |signal, high| roles.output(pin(signal), high);
        let input = |signal| roles.input(pin(signal));
        PicoPins {
            head_step: output(Signal::HeadStep, false),
            head_direction: InvertiblePin::new(
                output(Signal::HeadDirection, false),
                !robot.head.direction_high_is_positive,
            ),
            head_enable: InvertiblePin::new(output(Signal::HeadEnable, enable_low), enable_low),
            feed_step: output(Signal::FeedStep, false),
            feed_direction: InvertiblePin::new(
                output(Signal::FeedDirection, false),
                !robot.feed.direction_high_is_forward,
            ),
            feed_enable: InvertiblePin::new(output(Signal::FeedEnable, enable_low), enable_low),
            heater: pin(Signal::Heater),
            heater_enable: output(Signal::HeaterEnable, false),
            fan: pin(Signal::Fan),
            filament_presence: InvertiblePin::new(
                input(Signal::FilamentPresence),
                active_low(sensors.filament_presence),
            ),
            driver_fault: InvertiblePin::new(input(Signal::DriverFault), active_low(sensors.driver_fault)),
            orientation_clock: roles.open_drain(pin(Signal::OrientationClock)),
            orientation_data: roles.open_drain(pin(Signal::OrientationData)),
            index: InvertiblePin::new(input(Signal::Index), robot.head.index_low_on_mark),
            filament_motion: input(Signal::FilamentMotion),
            emergency_stop: InvertiblePin::new(input(Signal::EmergencyStop), active_low(sensors.emergency_stop)),
            thermistor: pin(Signal::Thermistor),
            supply: pin(Signal::Supply),
        }
    }
}

/// Heater, fan and both drivers, for the step interrupt.
pub struct PicoOutputs;

impl Outputs for PicoOutputs {
    fn make_safe(&mut self) {
        make_safe();
    }
}

/// Switches heater, fan and both drivers off at once, from any context. Their owners keep the pins.
pub fn make_safe() {
    set(SAFE_LOW.load(Ordering::Relaxed), false);
    set(SAFE_HIGH.load(Ordering::Relaxed), true);
    crate::pwm::off();
}
