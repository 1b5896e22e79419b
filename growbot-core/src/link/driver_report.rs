//! Problems that stepper drivers report over their UART.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};
use strum::{EnumString, IntoStaticStr, VariantArray};

/// A stepper motor of the tip.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum Motor {
    /// The motor that turns the head.
    Head,
    /// The motor that pushes filament.
    Feed,
}

impl Motor {
    /// Returns the motor's name, as programs print it.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Problem of a stepper driver.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema, EnumString, IntoStaticStr, VariantArray,
)]
#[strum(serialize_all = "kebab-case")]
pub enum DriverProblem {
    /// The driver does not respond.
    Silent,
    /// The driver responds, but does not accept the settings that the board writes.
    NotConfigured,
    /// The driver restarted while its motor was in use, and has lost its current and microstep settings.
    Reset,
    /// The voltage of the driver's charge pump is too low.
    Undervoltage,
    /// The driver is hot: its temperature is close to that at which it shuts down.
    Hot,
    /// The driver is too hot and has switched its motor off.
    OverTemperature,
    /// A wire of the motor touches ground.
    ShortToGround,
    /// A wire of the motor touches the supply or another wire.
    ShortToSupply,
    /// The driver has switched its motor off, but its flags no longer show why.
    ShutDown,
    /// A wire of the motor is not connected.
    OpenLoad,
    /// The motor does not turn although it receives steps.
    Stall,
}

impl DriverProblem {
    /// All problems that a driver can report.
    pub const ALL: [Self; 11] = *Self::VARIANTS.as_array().unwrap();

    /// Returns the code of the problem, as programs print it.
    pub fn code(self) -> &'static str {
        self.into()
    }

    /// Returns a description of the problem and its remedy.
    pub const fn explanation(self) -> &'static str {
        match self {
            Self::Silent => {
                "does not respond: check the motors' supply, without which the driver is off, and that the motor is \
                 connected"
            }
            Self::NotConfigured => {
                "does not accept its configuration: check the UART wire of the stepper drivers for noise"
            }
            Self::Reset => "restarted while its motor was in use: check the motors' supply and its wires",
            Self::Undervoltage => "has too little voltage at its charge pump: check the motors' supply",
            Self::Hot => "is nearly too hot: cool the driver, or lower the motor's current",
            Self::OverTemperature => {
                "is too hot and has switched itself off: cool the driver, or lower the motor's current"
            }
            Self::ShortToGround => "detects a motor wire shorted to ground: check the motor's wires",
            Self::ShortToSupply => {
                "detects a motor wire shorted to the supply or another wire: check the motor's wires"
            }
            Self::ShutDown => "has switched itself off: check its temperature and the motor's wires",
            Self::OpenLoad => "detects an open motor wire: check the motor's connector",
            Self::Stall => "detects a motor stall: remove what blocks the motor, or lower stall_threshold",
        }
    }
}

/// Report of a problem of one stepper driver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct DriverReport {
    /// Motor that the driver drives.
    pub motor: Motor,
    /// Problem of the driver.
    pub problem: DriverProblem,
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn every_problem_has_a_unique_code_explanation_and_remedy() {
        let codes = BTreeSet::from(DriverProblem::ALL.map(DriverProblem::code));
        let explanations = BTreeSet::from(DriverProblem::ALL.map(DriverProblem::explanation));
        assert_eq!((codes.len(), explanations.len()), (DriverProblem::ALL.len(), DriverProblem::ALL.len()));
        for explanation in explanations {
            let (what, remedy) = explanation.split_once(": ").unwrap_or_default();
            assert!(what.len() > 5 && remedy.len() > 10, "{explanation}");
        }
    }
}
