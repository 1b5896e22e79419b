//! The wiring: the pin of each signal, as the robot's description says.
//!
//! The levels of DIR, EN and the inputs are the robot description's. A pin has a weak pull-down until
//! [`Pins::new`] gives it its role, so that heater, fan and drivers need resistors that keep them off.

use core::convert::Infallible;
use core::sync::atomic::{AtomicU32, Ordering};

use embedded_hal::digital::{ErrorType, InputPin, OutputPin};
use growbot_core::robot::{Board, BoardKind, Input, PinNumbers, RobotDescription, Signal};
use growbot_firmware::hal::Outputs;
use growbot_firmware::polarity::Polarized;
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

/// Level of a driver's DIR.
pub type Direction = Polarized<Output>;
/// Level of a driver's EN; high is energised.
pub type Enable = Polarized<Output>;
/// A sensor's level.
pub type Sensor = Polarized<Level>;

/// Pins of the link: UART0, to the host and from it.
const LINK_TX: u8 = 0;
const LINK_RX: u8 = 1;
/// Pins of the stepper drivers' line: UART1, to the drivers and from them.
const DRIVERS_TX: u8 = 8;
const DRIVERS_RX: u8 = 9;

/// EN of the SKR Pico's drivers that no robot uses, at ZM and YM; off is high.
const UNUSED_ENABLES: [u8; 2] = [2, 7];

/// What [`make_safe`] sets low, and what it sets high: a bit for each pin. None until the pins have their roles.
static SAFE_LOW: AtomicU32 = AtomicU32::new(0);
static SAFE_HIGH: AtomicU32 = AtomicU32::new(0);

/// The single-cycle block of the pins. Its registers set and clear single pins in one write.
fn sio() -> &'static pac::sio::RegisterBlock {
    // SAFETY: each pin's bit is written by the pin's owner and by `make_safe` only.
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

/// The bit of a pin; no bit where there is none.
fn bit(pin: Option<u8>) -> u32 {
    pin.map_or(0, |pin| 1_u32.checked_shl(u32::from(pin)).unwrap_or(0))
}

/// A pin that drives both levels: its bit. Without a bit it does nothing.
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

/// The peripherals that give pins their roles.
struct Roles {
    io: pac::IO_BANK0,
    pads: pac::PADS_BANK0,
}

impl Roles {
    /// A pin's pad and function. A pin that the processor does not have is left alone.
    fn give(&self, pin: Option<u8>, pad: u32, function: u32) {
        if let Some(pin) = pin.map(usize::from).filter(|pin| *pin < 30) {
            // SAFETY: a pad's pulls and drive, and a function of the data sheet's table.
            unsafe {
                self.pads.gpio(pin).write(|w| w.bits(pad));
                self.io.gpio(pin).gpio_ctrl().write(|w| w.bits(function));
            }
        }
    }

    /// An output, which gets its level before it becomes one.
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

/// All pins that have an owner, each in its role and at its safe level; and the numbers of those whose owners are the
/// converter and the PWM.
pub struct Pins {
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
    /// The heater's power.
    pub heater: Option<u8>,
    /// The second switch in the heater's supply.
    pub heater_enable: Output,
    /// The fan.
    pub fan: Option<u8>,
    /// The filament's switch; high is filament.
    pub filament_presence: Sensor,
    /// The drivers' fault outputs; high is a fault.
    pub driver_fault: Sensor,
    /// SCL of the orientation sensor.
    pub orientation_clock: OpenDrain,
    /// SDA of the orientation sensor.
    pub orientation_data: OpenDrain,
    /// Index sensor of the head; high is on the mark.
    pub index: Sensor,
    /// The encoder that the filament turns.
    pub filament_motion: Level,
    /// The emergency stop; high is pressed.
    pub emergency_stop: Sensor,
    /// The thermistor.
    pub thermistor: Option<u8>,
    /// The supply.
    pub supply: Option<u8>,
}

impl Pins {
    /// Gives each pin its role: those of the robot's board. Without a robot all but the link's stay as the reset has
    /// left them.
    pub fn new(robot: &RobotDescription, configured: bool, io: pac::IO_BANK0, pads: pac::PADS_BANK0) -> Self {
        let roles = Roles { io, pads };
        roles.give(Some(LINK_TX), PAD, FUNCTION_UART);
        // Without an adapter the line idles, instead of picking up bytes.
        roles.give(Some(LINK_RX), PAD | PULL_UP, FUNCTION_UART);
        let board = robot.board.unwrap_or(Board { kind: BoardKind::Pico, pins: PinNumbers::default() });
        if configured && board.kind.has_drivers() {
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
        // Those of sensors that the robot does not have are not asked, so any level will do.
        let active_low = |input: Option<Input>| input.is_some_and(|input| input.active_low);
        let output = |signal, high| roles.output(pin(signal), high);
        let input = |signal| roles.input(pin(signal));
        Pins {
            head_step: output(Signal::HeadStep, false),
            head_direction: Polarized::new(
                output(Signal::HeadDirection, false),
                !robot.head.direction_high_is_positive,
            ),
            head_enable: Polarized::new(output(Signal::HeadEnable, enable_low), enable_low),
            feed_step: output(Signal::FeedStep, false),
            feed_direction: Polarized::new(output(Signal::FeedDirection, false), !robot.feed.direction_high_is_forward),
            feed_enable: Polarized::new(output(Signal::FeedEnable, enable_low), enable_low),
            heater: pin(Signal::Heater),
            heater_enable: output(Signal::HeaterEnable, false),
            fan: pin(Signal::Fan),
            filament_presence: Polarized::new(input(Signal::FilamentPresence), active_low(sensors.filament_presence)),
            driver_fault: Polarized::new(input(Signal::DriverFault), active_low(sensors.driver_fault)),
            orientation_clock: roles.open_drain(pin(Signal::OrientationClock)),
            orientation_data: roles.open_drain(pin(Signal::OrientationData)),
            index: Polarized::new(input(Signal::Index), robot.head.index_low_on_mark),
            filament_motion: input(Signal::FilamentMotion),
            emergency_stop: Polarized::new(input(Signal::EmergencyStop), active_low(sensors.emergency_stop)),
            thermistor: pin(Signal::Thermistor),
            supply: pin(Signal::Supply),
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

/// Heater, fan and both drivers off at once, from any context. Their owners keep the pins.
pub fn make_safe() {
    set(SAFE_LOW.load(Ordering::Relaxed), false);
    set(SAFE_HIGH.load(Ordering::Relaxed), true);
    crate::power::off();
}
