//! Physical faults of a tip.

use std::mem::discriminant;

use strum::IntoStaticStr;

/// A physical fault, active from [`super::TipModel::inject`] until [`super::TipModel::clear_fault`].
#[derive(Debug, Clone, Copy, PartialEq, IntoStaticStr)]
#[strum(serialize_all = "kebab-case")]
pub enum TipFault {
    /// A wire of the thermistor is cut.
    ThermistorOpen,
    /// The wires of the thermistor touch.
    ThermistorShort,
    /// The ADC delivers no readings of the thermistor.
    ThermistorSilent,
    /// The ADC delivers the same reading of the thermistor until the fault is cleared.
    ThermistorFrozen,
    /// The thermistor's voltage stays constant, but still has the ADC's noise.
    ThermistorStuck,
    /// The thermistor has slipped out of the nozzle and follows the temperature of the air near it.
    ThermistorDetached {
        /// Time constant with which the thermistor follows, s.
        tau_s: f64,
        /// Fraction (0 to 1) of the nozzle's temperature above the surroundings that the thermistor measures.
        share: f64,
    },
    /// A wire of the heater is cut: no power.
    HeaterOpen,
    /// The heater's power stage conducts permanently: full power whatever the duty, while the second switch is closed.
    PowerStageOn,
    /// The second switch in the heater's supply stays closed whatever its signal is.
    SecondSwitchClosed,
    /// A draught multiplies the nozzle's heat loss.
    Draught {
        /// Factor by which the nozzle's heat loss is multiplied.
        factor: f64,
    },
    /// The index sensor never detects its mark.
    IndexDead,
    /// The index sensor detects its mark everywhere.
    IndexStuck,
    /// The head's motor slips once and misses some steps.
    HeadLosesSteps {
        /// Number of steps that the head misses or makes in addition.
        steps: u32,
    },
    /// The head's motor runs ahead once by some steps.
    HeadGainsSteps {
        /// Number of steps that the head misses or makes in addition.
        steps: u32,
    },
    /// The head is blocked and makes no step.
    HeadBlocked,
    /// The filament has come to its end.
    FilamentOut,
    /// The feed turns, but the filament does not move.
    FilamentJam,
    /// Both stepper drivers report a fault and do not move their motors.
    DriverFault,
    /// The supply has dropped.
    SupplyLow {
        /// Voltage of the supply while the fault is active, V.
        volts: f64,
    },
    /// The supply has risen.
    SupplyHigh {
        /// Voltage of the supply while the fault is active, V.
        volts: f64,
    },
    /// The supply drops and recovers by itself.
    SupplyDip {
        /// Voltage of the supply while the fault is active, V.
        volts: f64,
        /// Duration of the dip, s.
        seconds: f64,
    },
    /// The emergency stop is pressed.
    EmergencyStop,
    /// The orientation sensor does not respond.
    OrientationSilent,
    /// The board's step interrupt has stopped. The tip ignores this fault, but a simulated board does not.
    StepInterruptStopped,
}

impl TipFault {
    /// One fault of each kind, with values that suit the robots that come with growbot.
    pub const ALL: [Self; 24] = [
        Self::ThermistorOpen,
        Self::ThermistorShort,
        Self::ThermistorSilent,
        Self::ThermistorFrozen,
        Self::ThermistorStuck,
        Self::ThermistorDetached { tau_s: 10.0, share: 0.2 },
        Self::HeaterOpen,
        Self::PowerStageOn,
        Self::SecondSwitchClosed,
        Self::Draught { factor: 8.0 },
        Self::IndexDead,
        Self::IndexStuck,
        Self::HeadLosesSteps { steps: 64 },
        Self::HeadGainsSteps { steps: 64 },
        Self::HeadBlocked,
        Self::FilamentOut,
        Self::FilamentJam,
        Self::DriverFault,
        Self::SupplyLow { volts: 9.0 },
        Self::SupplyHigh { volts: 15.0 },
        Self::SupplyDip { volts: 9.0, seconds: 1.0 },
        Self::EmergencyStop,
        Self::OrientationSilent,
        Self::StepInterruptStopped,
    ];

    /// Returns the name of the kind of fault.
    pub fn name(self) -> &'static str {
        self.into()
    }
}

/// Active faults, at most one of each kind.
#[derive(Debug, Clone, Default)]
pub struct Faults(Vec<TipFault>);

impl Faults {
    /// Adds a fault. The fault replaces an active fault of the same kind.
    pub fn add(&mut self, fault: TipFault) {
        self.remove(fault);
        self.0.push(fault);
    }

    /// Removes the active fault of the same kind as `fault`.
    pub fn remove(&mut self, fault: TipFault) {
        self.0.retain(|other| discriminant(other) != discriminant(&fault));
    }

    /// Returns true if exactly this fault, with the same values, is active.
    #[inline]
    pub fn has(&self, fault: TipFault) -> bool {
        !self.0.is_empty() && self.0.contains(&fault)
    }

    /// Returns the active faults in the order in which they were added.
    pub fn iter(&self) -> impl Iterator<Item = TipFault> + '_ {
        self.0.iter().copied()
    }
}

/// Constant readings of a thermistor that no longer follows the temperature, because of a fault.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct StuckReading {
    /// Reading of the ADC at the beginning of the fault.
    pub number: u16,
    /// Voltage of the thermistor at the beginning of the fault, in counts of the ADC before noise and rounding.
    pub counts: f64,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn at_most_one_fault_of_each_kind_is_kept() {
        let mut faults = Faults::default();
        faults.add(TipFault::Draught { factor: 2.0 });
        faults.add(TipFault::Draught { factor: 3.0 });
        faults.add(TipFault::HeaterOpen);
        assert_eq!(faults.iter().collect::<Vec<_>>(), [TipFault::Draught { factor: 3.0 }, TipFault::HeaterOpen]);
        faults.remove(TipFault::Draught { factor: 9.0 });
        assert!(!faults.has(TipFault::Draught { factor: 3.0 }) && faults.has(TipFault::HeaterOpen));
    }
}
