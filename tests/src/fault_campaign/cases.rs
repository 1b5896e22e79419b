//! The faults of the campaign, their onsets, and the expected reactions.

use growbot_core::link::message::Fault;
use growbot_sim::tip::TipFault;

/// Time at which a fault begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Onset {
    /// The fault is present when the board starts.
    Boot,
    /// The fault begins while the nozzle warms up.
    Heating,
    /// The fault begins in the first layer.
    FirstLayer,
    /// The fault begins in the third layer.
    MidLayer,
    /// The fault begins while the robot waits for layers with a hot nozzle.
    Pause,
    /// The fault begins while the nozzle cools to standby.
    Cooling,
}

impl Onset {
    /// All onsets, in the order of a growth.
    pub const ALL: [Self; 6] =
        [Self::Boot, Self::Heating, Self::FirstLayer, Self::MidLayer, Self::Pause, Self::Cooling];

    /// Returns the name of the onset in tables.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Boot => "boot",
            Self::Heating => "heating",
            Self::FirstLayer => "first layer",
            Self::MidLayer => "mid layer",
            Self::Pause => "pause",
            Self::Cooling => "cooling",
        }
    }

    /// Returns true if the head has been homed before this onset.
    const fn is_homed(self) -> bool {
        !matches!(self, Self::Boot | Self::Heating)
    }
}

/// Expected reaction to a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Expected {
    /// A fault with any of these codes.
    Codes(&'static [Fault]),
    /// The state emergency stop.
    EmergencyStop,
    /// The fault does no harm by itself, and the growth continues to its end. The next growth ends with any of these
    /// codes.
    AtNextStart(&'static [Fault]),
    /// The fault does no harm by itself, and the growth continues to its end.
    Continues,
    /// A fault with any of these codes, or a pause if the layer was finished before.
    CodesOrPause(&'static [Fault]),
    /// The board refuses the growth and heats nothing.
    Refused,
    /// The growth stays paused, with the nozzle at its standby temperature.
    StaysPaused,
}

/// A fault and its onset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Case {
    /// The fault.
    pub fault: TipFault,
    /// Time at which the fault begins.
    pub onset: Onset,
}

impl Case {
    /// Returns every combination of a fault and an onset.
    pub fn all() -> Vec<Self> {
        TipFault::ALL
            .into_iter()
            .flat_map(|fault| Onset::ALL.into_iter().map(move |onset| Self { fault, onset }))
            .collect()
    }

    /// Returns the expected reaction.
    pub fn expected(&self) -> Expected {
        use Fault as F;
        use TipFault as T;
        let cold = !self.onset.is_homed();
        Expected::Codes(match self.fault {
            T::ThermistorOpen => &[F::ThermistorOpen],
            T::ThermistorShort => &[F::ThermistorShort],
            T::ThermistorSilent => &[F::ThermistorSilent],
            // During warm-up, a frozen reading may first be noticed because it does not rise.
            T::ThermistorFrozen if cold => &[F::ThermistorFrozen, F::HeatingTooSlow],
            T::ThermistorFrozen => &[F::ThermistorFrozen],
            // The reading follows nothing, so the first symptom depends on the nozzle. A nozzle that has cooled blocks
            // the filament.
            T::ThermistorStuck => &[
                F::FilamentJam,
                F::ThermistorFrozen,
                F::HeaterEnergy,
                F::HeatingTooSlow,
                F::TemperatureDrop,
                F::HeaterStuckOn,
                F::ThermistorDetached,
            ],
            // For the board, a cold sensor and a cold nozzle look the same.
            T::ThermistorDetached { .. } if cold => &[F::HeatingTooSlow, F::ThermistorDetached],
            T::ThermistorDetached { .. } => &[F::ThermistorDetached, F::TemperatureDrop],
            T::HeaterOpen | T::Draught { .. } if cold => &[F::HeatingTooSlow],
            T::HeaterOpen => &[F::TemperatureDrop, F::HeatingTooSlow],
            // The draught can cool the nozzle within seconds, and a cold nozzle blocks the filament.
            T::Draught { .. } => &[F::TemperatureDrop, F::HeatingTooSlow, F::ThermistorDetached, F::FilamentJam],
            T::PowerStageOn => &[F::HeaterStuckOn],
            T::IndexDead if cold => &[F::IndexNotFound],
            T::IndexDead => &[F::IndexMissing],
            T::IndexStuck => &[F::IndexStuck],
            // Homing finds the zero nevertheless.
            T::HeadLosesSteps { .. } | T::HeadGainsSteps { .. } if cold => return Expected::Continues,
            T::HeadLosesSteps { .. } => &[F::HeadStepsLost],
            // The head may skip the whole mark.
            T::HeadGainsSteps { .. } => &[F::HeadStepsLost, F::IndexMissing],
            // The head may be blocked on its mark or off it.
            T::HeadBlocked if cold => &[F::IndexNotFound, F::IndexStuck],
            T::HeadBlocked => &[F::IndexMissing, F::IndexStuck, F::HeadStepsLost],
            // A growth without filament is not begun. Before the first layer, missing filament is a fault. Later a
            // robot finishes its layer and waits for a spool, but here the filament stops at once.
            T::FilamentOut if self.onset == Onset::Boot => return Expected::Refused,
            T::FilamentOut if cold => &[F::FilamentOut],
            // Filament is changed in pauses.
            T::FilamentOut if matches!(self.onset, Onset::Pause | Onset::Cooling) => return Expected::StaysPaused,
            T::FilamentOut => return Expected::CodesOrPause(&[F::FilamentOut, F::FilamentJam]),
            T::FilamentJam => &[F::FilamentJam],
            T::DriverFault => &[F::DriverFault],
            T::SupplyLow { .. } | T::SupplyDip { .. } => &[F::SupplyLow],
            T::SupplyHigh { .. } => &[F::SupplyHigh],
            T::StepInterruptStopped => &[F::StepsStalled],
            T::EmergencyStop => return Expected::EmergencyStop,
            // The second switch matters only once the power stage has failed as well.
            T::SecondSwitchClosed if self.onset == Onset::Boot => &[F::HeaterSwitchWelded],
            T::SecondSwitchClosed => return Expected::AtNextStart(&[F::HeaterSwitchWelded]),
            // The orientation is not used for safety.
            T::OrientationSilent => return Expected::Continues,
        })
    }
}
