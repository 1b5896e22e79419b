//! Moves that the controller submits to the step engine, and reports of the step engine to the controller.

use growbot_core::layer::SECTORS;

use super::direction::MotorDirection;
use super::turn::Turn;

/// A move that the controller submits to the step engine.
#[expect(clippy::large_enum_variant, reason = "one of each exists, and there is no heap to box a turn on")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Move {
    /// Turns the head to the index mark and stops it at the tip's x axis.
    Home(HomingMove),
    /// Lays a layer. If the move is submitted while the previous layer is being laid, the layer follows without a stop.
    Lay(Turn),
    /// Moves filament while the head stands.
    Feed(AxisMove),
    /// Turns the head while filament stands.
    Rotate(AxisMove),
}

/// A move of the head that finds the index mark and stops at the tip's x axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HomingMove {
    /// Number of ticks between two steps of the head, at least 2.
    pub ticks_per_step: u32,
    /// Number of head steps without the leading edge of the index mark after which homing fails.
    pub max_steps: u32,
    /// Number of head steps from the leading edge of the index mark to the tip's x axis.
    pub steps_to_zero: u32,
}

/// A move of the feed alone or of the head alone. It pulls filament back for a pause, or pushes it forward again after
/// the pause, or it is a maintenance move.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AxisMove {
    /// Number of steps of the move.
    pub steps: u32,
    /// Direction of the motor.
    pub direction: MotorDirection,
    /// Number of ticks between two steps, at least 2.
    pub ticks_per_step: u32,
    /// True if filament is loaded, purged or unloaded. Its encoder pulses do not count as growth, and a forward move is
    /// monitored for a jam.
    pub changes_filament: bool,
}

/// A report of the step engine to the controller: the end of a move, or the reason why the engine has switched
/// everything off.
#[expect(clippy::large_enum_variant, reason = "one of each exists, and there is no heap to box a turn on")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Report {
    /// A homing move has ended: the head stands at the tip's x axis.
    Homed,
    /// A layer has been laid.
    Laid(TurnReport),
    /// A move of filament has ended.
    Fed,
    /// A rotation of the head has ended.
    Rotated,
    /// Homing did not find the index mark. The engine has switched everything off, as for all reports that follow.
    IndexNotFound,
    /// A whole turn of the head has passed without the index mark.
    IndexMissing,
    /// The index sensor has detected its mark for longer than the mark is wide.
    IndexStuck,
    /// The index mark was detected at a wrong position of the head.
    HeadStepsLost,
    /// The feed turns, but the filament does not move.
    FilamentJam,
    /// A pin could not be read or written.
    Hardware,
}

/// Numbers of steps that head and feed have made in the turn of a laid layer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TurnReport {
    /// Number of steps of the head in the whole turn.
    pub head: u32,
    /// Number of steps of the feed in each sector, in the order of increasing angles, also if the head has turned in
    /// reverse.
    pub feed: [u32; SECTORS],
}

/// The reason why the engine switches everything off.
///
/// The discriminants begin at 1, so that 0 can stand for `None` in the mailbox.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum EngineFault {
    /// A pin could not be read or written.
    Hardware = 1,
    IndexNotFound,
    IndexMissing,
    IndexStuck,
    HeadStepsLost,
    FilamentJam,
}

impl EngineFault {
    pub fn report(self) -> Report {
        match self {
            Self::Hardware => Report::Hardware,
            Self::IndexNotFound => Report::IndexNotFound,
            Self::IndexMissing => Report::IndexMissing,
            Self::IndexStuck => Report::IndexStuck,
            Self::HeadStepsLost => Report::HeadStepsLost,
            Self::FilamentJam => Report::FilamentJam,
        }
    }
}
