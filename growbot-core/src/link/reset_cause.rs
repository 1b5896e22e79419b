//! The causes of a board's start, with their names.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// Cause of a board's start.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum ResetCause {
    /// The supply was switched on.
    PowerOn,
    /// The supply voltage dropped.
    BrownOut,
    /// The watchdog was not fed because the firmware had stopped.
    Watchdog,
    /// The processor faulted.
    ProcessorFault,
    /// The board was reset by its reset pin, by a debug probe, or by its own software.
    External,
    /// The firmware used more stack than is available.
    StackOverflow,
    /// The crystal of the board's clock stopped.
    ClockFailed,
}

impl ResetCause {
    /// All causes.
    pub const ALL: [Self; 7] = [
        Self::PowerOn,
        Self::BrownOut,
        Self::Watchdog,
        Self::ProcessorFault,
        Self::External,
        Self::StackOverflow,
        Self::ClockFailed,
    ];

    /// Returns the name of the cause, as programs print it.
    pub const fn name(self) -> &'static str {
        match self {
            Self::PowerOn => "power on",
            Self::BrownOut => "brown-out",
            Self::Watchdog => "watchdog",
            Self::ProcessorFault => "processor fault",
            Self::External => "reset from outside",
            Self::StackOverflow => "stack overflow",
            Self::ClockFailed => "clock failure",
        }
    }
}
