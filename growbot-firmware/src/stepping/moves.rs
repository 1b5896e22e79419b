//! Moves from the controller to the engine, and reports of the engine.

use growbot_core::layer::SECTORS;

use super::turn::Turn;

/// A move for the engine.
#[expect(clippy::large_enum_variant, reason = "one of each exists, and there is no heap to box a turn on")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Move {
    /// Finds the index mark and stops at the tip's x axis.
    Home(HomingMove),
    /// Lays a layer. If it is submitted while the one before is laid, it follows without a stop.
    Lay(Turn),
    /// Moves filament while the head stands.
    Feed(AxisMove),
    /// Turns the head while filament stands.
    Rotate(AxisMove),
}

/// A move that finds the index mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HomingMove {
    /// Ticks between two steps of the head, at least 2.
    pub ticks_per_step: u32,
    /// Number of steps without the leading edge of the mark after which homing fails.
    pub max_steps: u32,
    /// Steps from the leading edge to the tip's x axis.
    pub steps_to_zero: u32,
}

/// A move of one axis. It pulls filament back when feeding pauses, and forward again before feeding continues, or it is
/// a move of maintenance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct AxisMove {
    /// Number of steps.
    pub steps: u32,
    /// Filament is pulled back, or the head turned in reverse.
    pub backwards: bool,
    /// Ticks between two steps, at least 2.
    pub ticks_per_step: u32,
    /// Filament is loaded, purged or unloaded. Its pulses do not count as growth, and a forward move is monitored for a
    /// jam.
    pub changes_filament: bool,
}

/// A report of the engine.
#[expect(clippy::large_enum_variant, reason = "one of each exists, and there is no heap to box a turn on")]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Report {
    /// The head stands at the tip's x axis.
    Homed,
    /// A layer is laid.
    Laid(TurnReport),
    /// Filament is moved.
    Fed,
    /// The head is turned.
    Rotated,
    /// Homing did not find the index mark. Everything is off, as for all reports below.
    IndexNotFound,
    /// A turn has passed without the index mark.
    IndexMissing,
    /// The index sensor detects its mark for longer than the mark is wide.
    IndexStuck,
    /// The index mark was detected at another position.
    HeadStepsLost,
    /// Filament is fed and does not move.
    FilamentJam,
    /// A pin could not be read or written.
    Hardware,
}

/// The steps of a layer that were made.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TurnReport {
    /// Steps of the head.
    pub head: u32,
    /// Steps of the feed in each sector, by angle, whichever way the head has turned.
    pub feed: [u32; SECTORS],
}

/// The reason why the engine switches everything off.
///
/// The numbers leave 0 for `None`, as in the mailbox.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum EngineFault {
    /// A pin failed.
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
