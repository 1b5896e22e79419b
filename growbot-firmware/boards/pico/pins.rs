//! The wiring: a type for each signal, which names its pin.
//!
//! The levels of DIR, EN and the inputs are the robot description's. A pin floats until [`Pins::new`] gives it its
//! role, so that heater, fan and drivers need resistors that keep them off.

use core::convert::Infallible;
use core::sync::atomic::{AtomicBool, Ordering};

use embedded_hal::digital::{ErrorType, InputPin, OutputPin};
use growbot_core::robot::{Input, RobotDescription};
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

/// Signal `head STEP`.
pub type HeadStep = Output<2>;
/// Signal `head DIR`.
pub type HeadDirection = Polarized<Output<3>>;
/// Signal `head EN`; high is energised.
pub type HeadEnable = Polarized<Output<4>>;
/// Signal `feed STEP`.
pub type FeedStep = Output<5>;
/// Signal `feed DIR`.
pub type FeedDirection = Polarized<Output<6>>;
/// Signal `feed EN`; high is energised.
pub type FeedEnable = Polarized<Output<7>>;
/// Pin of the heater's power: channel A of PWM slice 4.
const HEATER: usize = 8;
/// Signal `heater second switch`.
pub type HeaterEnable = Output<9>;
/// Pin of the fan: channel A of PWM slice 5.
const FAN: usize = 10;
/// Signal `drivers' fault outputs, joined`; high is a fault.
pub type DriverFault = Polarized<Level<11>>;
/// Signal `filament presence`; high is filament.
pub type FilamentPresence = Polarized<Level<12>>;
/// Signal `filament encoder`.
pub type FilamentMotion = Level<13>;
/// Signal `index sensor`; high is on the mark.
pub type Index = Polarized<Level<14>>;
/// Signal `emergency stop`; high is pressed.
pub type EmergencyStop = Polarized<Level<15>>;
/// Signal `orientation sensor SDA`.
pub type OrientationData = OpenDrain<16>;
/// Signal `orientation sensor SCL`.
pub type OrientationClock = OpenDrain<17>;
/// Pin of the thermistor: channel 0 of the ADC.
const THERMISTOR: usize = 26;
/// Pin of the supply's divider: channel 1 of the ADC.
const SUPPLY: usize = 27;
/// Pins of the link: UART0, to the host and from it.
const LINK_TX: usize = 0;
const LINK_RX: usize = 1;

/// Whether a low level enables the drivers: [`make_safe`] needs it without the pins.
static ENABLE_LOW: AtomicBool = AtomicBool::new(true);

/// The single-cycle block of the pins. Its registers set and clear single pins in one write.
fn sio() -> &'static pac::sio::RegisterBlock {
    // SAFETY: each pin's bit is written by the pin's owner and by `make_safe` only.
    unsafe { &*pac::SIO::ptr() }
}

fn set(pin: usize, high: bool) {
    let bit = 1_u32 << pin;
    if high {
        // SAFETY: sets the level of one pin.
        sio().gpio_out_set().write(|w| unsafe { w.bits(bit) });
    } else {
        // SAFETY: as above.
        sio().gpio_out_clr().write(|w| unsafe { w.bits(bit) });
    }
}

fn drive(pin: usize, on: bool) {
    let bit = 1_u32 << pin;
    if on {
        // SAFETY: makes one pin an output.
        sio().gpio_oe_set().write(|w| unsafe { w.bits(bit) });
    } else {
        // SAFETY: makes one pin an input.
        sio().gpio_oe_clr().write(|w| unsafe { w.bits(bit) });
    }
}

fn level(pin: usize) -> bool {
    sio().gpio_in().read().bits() & 1 << pin != 0
}

/// A pin that drives both levels.
pub struct Output<const PIN: usize>(());

/// A pin that is read.
pub struct Level<const PIN: usize>(());

/// A pin that drives low and is released for high.
pub struct OpenDrain<const PIN: usize>(());

impl<const PIN: usize> ErrorType for Output<PIN> {
    type Error = Infallible;
}

impl<const PIN: usize> OutputPin for Output<PIN> {
    fn set_low(&mut self) -> Result<(), Infallible> {
        set(PIN, false);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        set(PIN, true);
        Ok(())
    }
}

impl<const PIN: usize> ErrorType for Level<PIN> {
    type Error = Infallible;
}

impl<const PIN: usize> InputPin for Level<PIN> {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(level(PIN))
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(!level(PIN))
    }
}

impl<const PIN: usize> ErrorType for OpenDrain<PIN> {
    type Error = Infallible;
}

impl<const PIN: usize> OutputPin for OpenDrain<PIN> {
    fn set_low(&mut self) -> Result<(), Infallible> {
        drive(PIN, true);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        drive(PIN, false);
        Ok(())
    }
}

impl<const PIN: usize> InputPin for OpenDrain<PIN> {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(level(PIN))
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(!level(PIN))
    }
}

/// The peripherals that give pins their roles.
struct Roles {
    io: pac::IO_BANK0,
    pads: pac::PADS_BANK0,
}

impl Roles {
    /// A pin's pad and function. A pin that the processor does not have is left alone.
    fn give(&self, pin: usize, pad: u32, function: u32) {
        if pin < 30 {
            // SAFETY: a pad's pulls and drive, and a function of the data sheet's table.
            unsafe {
                self.pads.gpio(pin).write(|w| w.bits(pad));
                self.io.gpio(pin).gpio_ctrl().write(|w| w.bits(function));
            }
        }
    }

    /// An output, which gets its level before it becomes one.
    fn output<const PIN: usize>(&self, high: bool) -> Output<PIN> {
        set(PIN, high);
        drive(PIN, true);
        self.give(PIN, PAD | if high { PULL_UP } else { PULL_DOWN }, FUNCTION_SIO);
        Output(())
    }

    fn input<const PIN: usize>(&self) -> Level<PIN> {
        drive(PIN, false);
        self.give(PIN, PAD | PULL_UP, FUNCTION_SIO);
        Level(())
    }

    fn open_drain<const PIN: usize>(&self) -> OpenDrain<PIN> {
        drive(PIN, false);
        set(PIN, false);
        self.give(PIN, PAD | PULL_UP, FUNCTION_SIO);
        OpenDrain(())
    }
}

/// All pins that have an owner, each in its role and at its safe level.
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
    /// The second switch in the heater's supply.
    pub heater_enable: HeaterEnable,
    /// The filament's switch.
    pub filament_presence: FilamentPresence,
    /// The drivers' fault outputs.
    pub driver_fault: DriverFault,
    /// SCL of the orientation sensor.
    pub orientation_clock: OrientationClock,
    /// SDA of the orientation sensor.
    pub orientation_data: OrientationData,
    /// Index sensor of the head.
    pub index: Index,
    /// The encoder that the filament turns.
    pub filament_motion: FilamentMotion,
    /// The emergency stop.
    pub emergency_stop: EmergencyStop,
}

impl Pins {
    /// Gives each pin its role.
    pub fn new(robot: &RobotDescription, io: pac::IO_BANK0, pads: pac::PADS_BANK0) -> Self {
        let roles = Roles { io, pads };
        let enable_low = robot.motion.enable_low;
        ENABLE_LOW.store(enable_low, Ordering::Relaxed);
        roles.give(HEATER, PAD | PULL_DOWN, FUNCTION_PWM);
        roles.give(FAN, PAD | PULL_DOWN, FUNCTION_PWM);
        roles.give(THERMISTOR, PAD_ANALOG, FUNCTION_NONE);
        roles.give(SUPPLY, PAD_ANALOG, FUNCTION_NONE);
        roles.give(LINK_TX, PAD, FUNCTION_UART);
        // Without an adapter the line idles, instead of picking up bytes.
        roles.give(LINK_RX, PAD | PULL_UP, FUNCTION_UART);
        let sensors = &robot.sensors;
        // Those of sensors that the robot does not have are not asked, so any level will do.
        let active_low = |input: Option<Input>| input.is_some_and(|input| input.active_low);
        Pins {
            head_step: roles.output(false),
            head_direction: Polarized::new(roles.output(false), !robot.head.direction_high_is_positive),
            head_enable: Polarized::new(roles.output(enable_low), enable_low),
            feed_step: roles.output(false),
            feed_direction: Polarized::new(roles.output(false), !robot.feed.direction_high_is_forward),
            feed_enable: Polarized::new(roles.output(enable_low), enable_low),
            heater_enable: roles.output(false),
            filament_presence: Polarized::new(roles.input(), active_low(sensors.filament_presence)),
            driver_fault: Polarized::new(roles.input(), active_low(sensors.driver_fault)),
            orientation_clock: roles.open_drain(),
            orientation_data: roles.open_drain(),
            index: Polarized::new(roles.input(), robot.head.index_low_on_mark),
            filament_motion: roles.input(),
            emergency_stop: Polarized::new(roles.input(), active_low(sensors.emergency_stop)),
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
    let off = ENABLE_LOW.load(Ordering::Relaxed);
    set(9, false);
    set(4, off);
    set(7, off);
    crate::power::off();
}
