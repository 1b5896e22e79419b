//! What a board can be doing, what can go wrong with it, and why it may have started: in bytes and in words.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// What the board is doing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum State {
    /// Nothing: heater and steppers are off.
    Idle,
    /// The nozzle warms up; nothing moves, since cold plastic may hold the nozzle.
    Heating,
    /// The head looks for its index mark.
    Homing,
    /// Layers are being laid.
    Growing,
    /// Between layers, hot, waiting for more of them.
    Hold,
    /// Every layer of the job is laid; heater and steppers are off.
    Done,
    /// Stopped on request; heater and steppers are off.
    Stopped,
    /// A fault is latched; heater and steppers are off until it is cleared.
    Fault,
}

impl State {
    /// The state in a word.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Heating => "heating",
            Self::Homing => "homing",
            Self::Growing => "growing",
            Self::Hold => "hold",
            Self::Done => "done",
            Self::Stopped => "stopped",
            Self::Fault => "fault",
        }
    }
}

/// What went wrong. Any of them switches heater and steppers off.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum Fault {
    /// The thermistor reads as if its wire were cut.
    ThermistorOpen,
    /// The thermistor reads as if its wires touched.
    ThermistorShort,
    /// There has been no temperature reading for half a second.
    ThermistorSilent,
    /// The nozzle is above the robot's greatest temperature.
    OverTemperature,
    /// The nozzle cooled below the least extrusion temperature while growing.
    UnderTemperature,
    /// The nozzle was not hot in time.
    HeatingTooSlow,
    /// The head turned further than a turn without passing its index mark.
    IndexNotFound,
    /// A layer asks for steps faster than the step interrupt makes them.
    StepRate,
    /// The board's own hardware refused a command.
    Hardware,
}

impl Fault {
    /// The fault as a code.
    #[must_use]
    pub const fn code(self) -> &'static str {
        match self {
            Self::ThermistorOpen => "thermistor-open",
            Self::ThermistorShort => "thermistor-short",
            Self::ThermistorSilent => "thermistor-silent",
            Self::OverTemperature => "over-temperature",
            Self::UnderTemperature => "under-temperature",
            Self::HeatingTooSlow => "heating-too-slow",
            Self::IndexNotFound => "index-not-found",
            Self::StepRate => "step-rate",
            Self::Hardware => "hardware",
        }
    }

    /// What happened and what to look at.
    #[must_use]
    pub const fn explanation(self) -> &'static str {
        match self {
            Self::ThermistorOpen => "the thermistor reads as if its wire were cut: check its connector",
            Self::ThermistorShort => "the thermistor reads as if its wires touched: check its insulation",
            Self::ThermistorSilent => "no temperature reading for half a second: check the board",
            Self::OverTemperature => {
                "the nozzle got hotter than heater.max_c: check the heater's switches and the thermistor's seat"
            }
            Self::UnderTemperature => {
                "the nozzle cooled below heater.extrusion_min_c while growing: check heater, fan and draught"
            }
            Self::HeatingTooSlow => {
                "the nozzle was not hot within heater.heating_timeout_s: check heater, supply and the thermistor's seat"
            }
            Self::IndexNotFound => {
                "the head turned one and a half turns without passing its index mark: check the sensor, the motor and its driver"
            }
            Self::StepRate => {
                "a layer asks for more than one step in two ticks: raise motion.tick_hz or lower the steps"
            }
            Self::Hardware => "a pin or the heater's output refused a command: check the board",
        }
    }
}

/// Why the board started.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum ResetCause {
    /// The supply came up.
    PowerOn,
    /// The supply sagged.
    BrownOut,
    /// The watchdog was not fed: the firmware had stopped.
    Watchdog,
    /// The firmware panicked.
    Panic,
    /// The processor faulted.
    ProcessorFault,
    /// The reset pin, a debug probe, or a reset that software asked for.
    External,
    /// The firmware used more stack than there is.
    StackOverflow,
}

impl ResetCause {
    /// The cause in words.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::PowerOn => "power on",
            Self::BrownOut => "brown-out",
            Self::Watchdog => "watchdog",
            Self::Panic => "panic",
            Self::ProcessorFault => "processor fault",
            Self::External => "reset from outside",
            Self::StackOverflow => "stack overflow",
        }
    }
}
