//! What can break on a tip.

use std::mem::discriminant;

/// Something physical that is broken, from [`super::Tip::inject`] until [`super::Tip::mend`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TipFault {
    /// A wire of the thermistor is cut.
    ThermistorOpen,
    /// The wires of the thermistor touch.
    ThermistorShort,
    /// The ADC delivers no readings of the thermistor.
    ThermistorSilent,
    /// The ADC delivers the same number for ever.
    ThermistorFrozen,
    /// The thermistor's voltage stands still; the ADC's noise is on it as ever.
    ThermistorStuck,
    /// The thermistor has slipped out of its place: it follows the air near the nozzle.
    ThermistorDetached {
        /// Time constant with which it follows, s.
        tau_s: f64,
        /// Share (0 to 1) of the nozzle's warmth above its surroundings that it gets.
        share: f64,
    },
    /// A wire of the heater is cut: no power.
    HeaterOpen,
    /// The heater's power stage conducts by itself: full power whatever the duty, while the second switch is closed.
    PowerStageOn,
    /// The second switch in the heater's supply stays closed whatever its signal is.
    SecondSwitchClosed,
    /// A draught multiplies the nozzle's loss.
    Draught {
        /// The loss, as a multiple of what it is in still air.
        factor: f64,
    },
    /// The index sensor never sees its mark.
    IndexDead,
    /// The index sensor sees its mark everywhere.
    IndexStuck,
    /// The head's motor slips once: it does not follow this many steps.
    HeadLosesSteps {
        /// How many.
        steps: u32,
    },
    /// The head's motor runs ahead once, by this many steps.
    HeadGainsSteps {
        /// How many.
        steps: u32,
    },
    /// Something holds the head: it makes no step.
    HeadBlocked,
    /// The filament has come to its end.
    FilamentOut,
    /// The feed turns and the filament stands.
    FilamentJam,
    /// Both stepper drivers report a fault and let their motors stand.
    DriverFault,
    /// The supply has sunk to this voltage.
    SupplyLow {
        /// V.
        volts: f64,
    },
    /// The supply has risen to this voltage.
    SupplyHigh {
        /// V.
        volts: f64,
    },
    /// The supply sinks to this voltage and comes back by itself.
    SupplyDip {
        /// V.
        volts: f64,
        /// For how long, s.
        seconds: f64,
    },
    /// The emergency stop is pressed.
    EmergencyStop,
    /// The orientation sensor does not answer.
    OrientationSilent,
    /// The board's step interrupt has stopped. Not of the tip, which takes no notice; a simulated board does.
    StepInterruptStopped,
}

impl TipFault {
    /// One of each kind, with figures that suit the robots that come with growbot.
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

    /// The kind of fault, as a name.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::ThermistorOpen => "thermistor-open",
            Self::ThermistorShort => "thermistor-short",
            Self::ThermistorSilent => "thermistor-silent",
            Self::ThermistorFrozen => "thermistor-frozen",
            Self::ThermistorStuck => "thermistor-stuck",
            Self::ThermistorDetached { .. } => "thermistor-detached",
            Self::HeaterOpen => "heater-open",
            Self::PowerStageOn => "power-stage-on",
            Self::SecondSwitchClosed => "second-switch-closed",
            Self::Draught { .. } => "draught",
            Self::IndexDead => "index-dead",
            Self::IndexStuck => "index-stuck",
            Self::HeadLosesSteps { .. } => "head-loses-steps",
            Self::HeadGainsSteps { .. } => "head-gains-steps",
            Self::HeadBlocked => "head-blocked",
            Self::FilamentOut => "filament-out",
            Self::FilamentJam => "filament-jam",
            Self::DriverFault => "driver-fault",
            Self::SupplyLow { .. } => "supply-low",
            Self::SupplyHigh { .. } => "supply-high",
            Self::SupplyDip { .. } => "supply-dip",
            Self::EmergencyStop => "emergency-stop",
            Self::OrientationSilent => "orientation-silent",
            Self::StepInterruptStopped => "step-interrupt-stopped",
        }
    }
}

/// What is broken at present: of each kind one at most.
#[derive(Debug, Clone, Default)]
pub struct Faults(Vec<TipFault>);

impl Faults {
    /// Adds a fault; it replaces one of its kind.
    pub fn add(&mut self, fault: TipFault) {
        self.remove(fault);
        self.0.push(fault);
    }

    /// Removes the fault of this one's kind.
    pub fn remove(&mut self, fault: TipFault) {
        self.0.retain(|other| discriminant(other) != discriminant(&fault));
    }

    /// Whether there is exactly this fault.
    #[inline]
    #[must_use]
    pub fn has(&self, fault: TipFault) -> bool {
        !self.0.is_empty() && self.0.contains(&fault)
    }

    /// Each of them, in the order in which they came.
    pub fn iter(&self) -> impl Iterator<Item = TipFault> + '_ {
        self.0.iter().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_in_kebab_case_and_differ() {
        let mut names: Vec<_> = TipFault::ALL.iter().map(|fault| fault.name()).collect();
        assert!(names.iter().all(|name| name.chars().all(|letter| letter.is_ascii_lowercase() || letter == '-')));
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), TipFault::ALL.len());
    }

    #[test]
    fn of_each_kind_there_is_one_at_most() {
        let mut faults = Faults::default();
        faults.add(TipFault::Draught { factor: 2.0 });
        faults.add(TipFault::Draught { factor: 3.0 });
        faults.add(TipFault::HeaterOpen);
        assert_eq!(faults.iter().collect::<Vec<_>>(), [TipFault::Draught { factor: 3.0 }, TipFault::HeaterOpen]);
        faults.remove(TipFault::Draught { factor: 9.0 });
        assert!(!faults.has(TipFault::Draught { factor: 3.0 }) && faults.has(TipFault::HeaterOpen));
    }
}
