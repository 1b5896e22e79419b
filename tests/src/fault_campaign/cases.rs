//! Which fault comes when, and what is right to make of it.

use growbot_core::link::message::Fault;
use growbot_sim::tip::TipFault;

/// When a fault comes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Onset {
    /// It is there when the board starts.
    Boot,
    /// While the nozzle warms up.
    Heating,
    /// In the first layer.
    FirstLayer,
    /// In the third layer.
    MidLayer,
    /// While the robot waits for layers, hot.
    Pause,
    /// While the nozzle cools to standby.
    Cooling,
}

impl Onset {
    /// All of them, in the order of a growth.
    pub const ALL: [Self; 6] =
        [Self::Boot, Self::Heating, Self::FirstLayer, Self::MidLayer, Self::Pause, Self::Cooling];

    /// In a word or two.
    #[must_use]
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

    /// Whether the head has its zero already.
    const fn is_homed(self) -> bool {
        !matches!(self, Self::Boot | Self::Heating)
    }
}

/// What is right to make of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Right {
    /// Any of these codes.
    Codes(&'static [Fault]),
    /// The state emergency stop.
    EmergencyStop,
    /// It does no harm on its own, and the growth continues to its end. The next one is not begun: any of these codes.
    AtNextStart(&'static [Fault]),
    /// It does no harm on its own, and the growth continues to its end.
    Continues,
    /// Any of these codes, or a pause if the layer was finished before.
    CodesOrPause(&'static [Fault]),
    /// The growth is refused: nothing is heated.
    Refused,
    /// The growth stays in its pause, in which the nozzle is held at standby.
    StaysPaused,
}

/// A fault and when it comes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Case {
    /// What breaks.
    pub fault: TipFault,
    /// When.
    pub onset: Onset,
}

impl Case {
    /// All of them.
    #[must_use]
    pub fn all() -> Vec<Self> {
        TipFault::ALL
            .into_iter()
            .flat_map(|fault| Onset::ALL.into_iter().map(move |onset| Self { fault, onset }))
            .collect()
    }

    /// What is right to make of it.
    #[must_use]
    pub fn right(&self) -> Right {
        use Fault as F;
        use TipFault as T;
        let cold = !self.onset.is_homed();
        Right::Codes(match self.fault {
            T::ThermistorOpen => &[F::ThermistorOpen],
            T::ThermistorShort => &[F::ThermistorShort],
            T::ThermistorSilent => &[F::ThermistorSilent],
            // While it warms up, a reading that stands still is first of all one that does not rise.
            T::ThermistorFrozen if cold => &[F::ThermistorFrozen, F::HeatingTooSlow],
            T::ThermistorFrozen => &[F::ThermistorFrozen],
            // It follows nothing: what shows first depends on what the nozzle does. One that has cooled holds its
            // filament.
            T::ThermistorStuck => &[
                F::FilamentJam,
                F::ThermistorFrozen,
                F::HeaterEnergy,
                F::HeatingTooSlow,
                F::TemperatureDrop,
                F::HeaterStuckOn,
                F::ThermistorDetached,
            ],
            // From the board's side a cold sensor and a cold nozzle are the same.
            T::ThermistorDetached { .. } if cold => &[F::HeatingTooSlow, F::ThermistorDetached],
            T::ThermistorDetached { .. } => &[F::ThermistorDetached, F::TemperatureDrop],
            T::HeaterOpen | T::Draught { .. } if cold => &[F::HeatingTooSlow],
            T::HeaterOpen => &[F::TemperatureDrop, F::HeatingTooSlow],
            // A nozzle that it has cooled within seconds holds its filament.
            T::Draught { .. } => &[F::TemperatureDrop, F::HeatingTooSlow, F::ThermistorDetached, F::FilamentJam],
            T::PowerStageOn => &[F::HeaterStuckOn],
            T::IndexDead if cold => &[F::IndexNotFound],
            T::IndexDead => &[F::IndexMissing],
            T::IndexStuck => &[F::IndexStuck],
            // Homing finds the zero all the same.
            T::HeadLosesSteps { .. } | T::HeadGainsSteps { .. } if cold => return Right::Continues,
            T::HeadLosesSteps { .. } => &[F::HeadStepsLost],
            // It may jump over the whole mark.
            T::HeadGainsSteps { .. } => &[F::HeadStepsLost, F::IndexMissing],
            // It may be held on its mark or off it.
            T::HeadBlocked if cold => &[F::IndexNotFound, F::IndexStuck],
            T::HeadBlocked => &[F::IndexMissing, F::IndexStuck, F::HeadStepsLost],
            // A robot that has none is not begun with. Before the first layer it is a fault; from then on the robot would finish its layer and wait for a spool,
            // but this filament stands at once.
            T::FilamentOut if self.onset == Onset::Boot => return Right::Refused,
            T::FilamentOut if cold => &[F::FilamentOut],
            // A pause is where filament is changed.
            T::FilamentOut if matches!(self.onset, Onset::Pause | Onset::Cooling) => return Right::StaysPaused,
            T::FilamentOut => return Right::CodesOrPause(&[F::FilamentOut, F::FilamentJam]),
            T::FilamentJam => &[F::FilamentJam],
            T::DriverFault => &[F::DriverFault],
            T::SupplyLow { .. } | T::SupplyDip { .. } => &[F::SupplyLow],
            T::SupplyHigh { .. } => &[F::SupplyHigh],
            T::StepInterruptStopped => &[F::StepsStalled],
            T::EmergencyStop => return Right::EmergencyStop,
            // The second switch matters only once the power stage has failed as well.
            T::SecondSwitchClosed if self.onset == Onset::Boot => &[F::HeaterSwitchWelded],
            T::SecondSwitchClosed => return Right::AtNextStart(&[F::HeaterSwitchWelded]),
            // The orientation is not used for safety.
            T::OrientationSilent => return Right::Continues,
        })
    }
}
