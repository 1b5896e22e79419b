//! The kinds of controller boards, their signals, and the pins of these signals.
//!
//! | board | source |
//! |---|---|
//! | `stm32f405` | pins fixed by its firmware |
//! | `pico` | RP2040 data sheet, 1.4.3 (functions of the pins); Pico data sheet, 2.1 (pins on the board's edge) |
//! | `skr-pico` | the terminals as printed on the BTT SKR Pico V1.0 |

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};
use strum::{Display, IntoStaticStr, VariantArray};

/// A kind of controller board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema, Display, IntoStaticStr)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum BoardKind {
    /// A board with an STM32F405, whose pins are fixed.
    Stm32f405,
    /// A Raspberry Pi Pico, to which the user connects drivers and switches.
    Pico,
    /// A BTT SKR Pico, with four TMC2209 stepper drivers.
    SkrPico,
}

/// The controller board and its pins. If a robot file does not contain this table, the board that runs the firmware
/// uses its default pins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields)]
pub struct BoardDescription {
    /// Kind of the board. A board of another kind refuses the robot description.
    pub kind: BoardKind,
    /// Pins of signals that are not at the default pin of the board's kind.
    #[serde(default)]
    pub pins: PinOverrides,
}

/// Numbers of GPIO pins, 0 to 29, for signals that are not at the default pin of the board's kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[cfg_attr(feature = "schema", derive(schemars::JsonSchema))]
#[serde(deny_unknown_fields, default)]
pub struct PinOverrides {
    /// GPIO pin for STEP of the head's stepper driver.
    pub head_step: Option<u8>,
    /// GPIO pin for DIR of the head's stepper driver.
    pub head_direction: Option<u8>,
    /// GPIO pin for EN of the head's stepper driver.
    pub head_enable: Option<u8>,
    /// GPIO pin for STEP of the feed's stepper driver.
    pub feed_step: Option<u8>,
    /// GPIO pin for DIR of the feed's stepper driver.
    pub feed_direction: Option<u8>,
    /// GPIO pin for EN of the feed's stepper driver.
    pub feed_enable: Option<u8>,
    /// GPIO pin of the PWM output that sets the power of the heater.
    pub heater: Option<u8>,
    /// GPIO pin of the output that closes the second switch in the supply of the heater.
    pub heater_enable: Option<u8>,
    /// GPIO pin of the PWM output for the fan.
    pub fan: Option<u8>,
    /// GPIO pin of the input for the fault outputs of the stepper drivers, which are joined on one wire.
    pub driver_fault: Option<u8>,
    /// GPIO pin of the input for the switch that detects filament.
    pub filament_presence: Option<u8>,
    /// GPIO pin of the input for the encoder that the filament turns.
    pub filament_motion: Option<u8>,
    /// GPIO pin of the input for the head's index sensor.
    pub index: Option<u8>,
    /// GPIO pin of the input for the emergency-stop button.
    pub emergency_stop: Option<u8>,
    /// GPIO pin for SDA (I2C data) of the orientation sensor.
    pub orientation_data: Option<u8>,
    /// GPIO pin for SCL (I2C clock) of the orientation sensor.
    pub orientation_clock: Option<u8>,
    /// GPIO pin of the input for the voltage divider of the thermistor, one of the ADC pins 26 to 29.
    pub thermistor: Option<u8>,
    /// GPIO pin of the input for the voltage divider of the supply, one of the ADC pins 26 to 29.
    pub supply: Option<u8>,
}

/// A signal of the board, which has a pin: a wire to a driver, a heater, a fan, a sensor or a button.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Display, IntoStaticStr, VariantArray)]
#[strum(serialize_all = "snake_case")]
pub enum Signal {
    /// STEP input of the head's stepper driver.
    HeadStep,
    /// DIR input of the head's stepper driver.
    HeadDirection,
    /// EN input of the head's stepper driver.
    HeadEnable,
    /// STEP input of the feed's stepper driver.
    FeedStep,
    /// DIR input of the feed's stepper driver.
    FeedDirection,
    /// EN input of the feed's stepper driver.
    FeedEnable,
    /// PWM output that sets the power of the heater.
    Heater,
    /// Output that closes the second switch in the supply of the heater.
    HeaterEnable,
    /// PWM output for the fan.
    Fan,
    /// Input for the fault outputs of the stepper drivers, which are joined on one wire.
    DriverFault,
    /// Input for the switch that detects filament.
    FilamentPresence,
    /// Input for the encoder that the filament turns.
    FilamentMotion,
    /// Input for the head's index sensor.
    Index,
    /// Input for the emergency-stop button.
    EmergencyStop,
    /// SDA (I2C data) of the orientation sensor.
    OrientationData,
    /// SCL (I2C clock) of the orientation sensor.
    OrientationClock,
    /// Analog input for the voltage divider of the thermistor.
    Thermistor,
    /// Analog input for the voltage divider of the supply.
    Supply,
}

impl Signal {
    /// All signals.
    pub const ALL: [Self; 18] = *Self::VARIANTS.as_array().unwrap();

    /// Returns the name of the signal in the table `[board.pins]` of a robot file.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Reports whether the signal is an input of a stepper driver (STEP, DIR or EN).
    fn is_motor_signal(self) -> bool {
        matches!(
            self,
            Self::HeadStep
                | Self::HeadDirection
                | Self::HeadEnable
                | Self::FeedStep
                | Self::FeedDirection
                | Self::FeedEnable
        )
    }

    pub(super) fn is_analog(self) -> bool {
        matches!(self, Self::Thermistor | Self::Supply)
    }
}

impl PinOverrides {
    /// Returns the pin that is set for a signal. `None` if the signal has the default pin of the board.
    pub fn get(&self, signal: Signal) -> Option<u8> {
        match signal {
            Signal::HeadStep => self.head_step,
            Signal::HeadDirection => self.head_direction,
            Signal::HeadEnable => self.head_enable,
            Signal::FeedStep => self.feed_step,
            Signal::FeedDirection => self.feed_direction,
            Signal::FeedEnable => self.feed_enable,
            Signal::Heater => self.heater,
            Signal::HeaterEnable => self.heater_enable,
            Signal::Fan => self.fan,
            Signal::DriverFault => self.driver_fault,
            Signal::FilamentPresence => self.filament_presence,
            Signal::FilamentMotion => self.filament_motion,
            Signal::Index => self.index,
            Signal::EmergencyStop => self.emergency_stop,
            Signal::OrientationData => self.orientation_data,
            Signal::OrientationClock => self.orientation_clock,
            Signal::Thermistor => self.thermistor,
            Signal::Supply => self.supply,
        }
    }
}

impl BoardKind {
    /// Returns the name of the kind in a robot file.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Returns the default GPIO pin of a signal. `None` if this kind has no pin for the signal, or if its pins are not
    /// those of an RP2040.
    pub fn pin(self, signal: Signal) -> Option<u8> {
        match self {
            Self::Stm32f405 => None,
            Self::Pico => Some(pico_pin(signal)),
            Self::SkrPico => skr_pico_place(signal).map(|(pin, _)| pin),
        }
    }

    /// Returns the label of a signal's default terminal, as printed on the board. `None` if this kind has no terminal
    /// for the signal.
    pub fn terminal(self, signal: Signal) -> Option<&'static str> {
        match self {
            Self::Stm32f405 => Some(stm32f405_pin(signal)),
            Self::Pico => GP.get(usize::from(pico_pin(signal))).copied(),
            Self::SkrPico => skr_pico_place(signal).map(|(_, terminal)| terminal),
        }
    }

    /// Returns the purpose for which the board itself uses a pin. `None` if the pin is free for a signal.
    pub(super) fn reserved(self, pin: u8) -> Option<&'static str> {
        match (self, pin) {
            (_, 0 | 1) => Some("the link's UART"),
            (Self::Pico, 23) => Some("the board's converter of the supply"),
            (Self::Pico, 24) => Some("the board's sense of USB power"),
            (Self::Pico, 25) => Some("the board's lamp"),
            (Self::Pico, 29) => Some("the board's sense of its own supply"),
            (Self::SkrPico, 2 | 7) => Some("the enable of a stepper driver that is held off"),
            (Self::SkrPico, 8 | 9) => Some("the line to the stepper drivers"),
            _ => None,
        }
    }

    /// Reports whether the description cannot change the pin of a signal on this kind of board. On an `stm32f405` all
    /// pins are fixed. On an `skr-pico` the pins of the soldered stepper drivers are fixed, because each driver has its
    /// own address.
    pub(super) fn has_fixed_pin(self, signal: Signal) -> bool {
        match self {
            Self::Stm32f405 => true,
            Self::Pico => false,
            Self::SkrPico => signal.is_motor_signal(),
        }
    }

    /// Reports whether the board has soldered TMC2209 stepper drivers that the firmware configures.
    pub fn has_onboard_drivers(self) -> bool {
        matches!(self, Self::SkrPico)
    }
}

/// Labels of the GPIO pins as printed on a Pico.
const GP: [&str; 30] = [
    "GP0", "GP1", "GP2", "GP3", "GP4", "GP5", "GP6", "GP7", "GP8", "GP9", "GP10", "GP11", "GP12", "GP13", "GP14",
    "GP15", "GP16", "GP17", "GP18", "GP19", "GP20", "GP21", "GP22", "GP23", "GP24", "GP25", "GP26", "GP27", "GP28",
    "GP29",
];

fn pico_pin(signal: Signal) -> u8 {
    match signal {
        Signal::HeadStep => 2,
        Signal::HeadDirection => 3,
        Signal::HeadEnable => 4,
        Signal::FeedStep => 5,
        Signal::FeedDirection => 6,
        Signal::FeedEnable => 7,
        Signal::Heater => 8,
        Signal::HeaterEnable => 9,
        Signal::Fan => 10,
        Signal::DriverFault => 11,
        Signal::FilamentPresence => 12,
        Signal::FilamentMotion => 13,
        Signal::Index => 14,
        Signal::EmergencyStop => 15,
        Signal::OrientationData => 16,
        Signal::OrientationClock => 17,
        Signal::Thermistor => 26,
        Signal::Supply => 27,
    }
}

/// Returns the pin and the label of the terminal of a signal on an SKR Pico. `None` for `DriverFault`, because the
/// drivers report faults over their UART, and for `Supply`, because the board does not measure it.
fn skr_pico_place(signal: Signal) -> Option<(u8, &'static str)> {
    Some(match signal {
        Signal::HeadStep => (11, "XM"),
        Signal::HeadDirection => (10, "XM"),
        Signal::HeadEnable => (12, "XM"),
        Signal::FeedStep => (14, "EM"),
        Signal::FeedDirection => (13, "EM"),
        Signal::FeedEnable => (15, "EM"),
        Signal::Heater => (23, "HE"),
        Signal::HeaterEnable => (21, "HB"),
        Signal::Fan => (17, "FAN1"),
        Signal::FilamentPresence => (16, "E0-STOP"),
        Signal::FilamentMotion => (25, "Z-STOP"),
        Signal::Index => (4, "X-STOP"),
        Signal::EmergencyStop => (3, "Y-STOP"),
        Signal::OrientationData => (29, "SERVOS"),
        Signal::OrientationClock => (22, "PROBE"),
        Signal::Thermistor => (27, "TH0"),
        Signal::DriverFault | Signal::Supply => return None,
    })
}

fn stm32f405_pin(signal: Signal) -> &'static str {
    match signal {
        Signal::HeadStep => "PC6",
        Signal::HeadDirection => "PC7",
        Signal::HeadEnable => "PC8",
        Signal::FeedStep => "PB12",
        Signal::FeedDirection => "PB13",
        Signal::FeedEnable => "PB14",
        Signal::Heater => "PA8",
        Signal::HeaterEnable => "PA7",
        Signal::Fan => "PB15",
        Signal::DriverFault => "PC9",
        Signal::FilamentPresence => "PB5",
        Signal::FilamentMotion => "PB7",
        Signal::Index => "PB6",
        Signal::EmergencyStop => "PB8",
        Signal::OrientationData => "PB11",
        Signal::OrientationClock => "PB10",
        Signal::Thermistor => "PC0",
        Signal::Supply => "PC1",
    }
}
