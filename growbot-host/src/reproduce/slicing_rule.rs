//! How the paths of the experiments are sliced into layers.

use growbot_core::path::Path;
use growbot_core::robot::Robot;
use growbot_core::slicing::Slicing;

use super::paper;

/// How a path is sliced into layers. The paper gives two values of the step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SlicingRule {
    /// Whole steps, rounded up, of the `g t = 0.3096` cm of the text. It is said of Table 1's robots only.
    Text,
    /// Whole steps, rounded up, of `g dt` by Tables 1 and 3.
    Table,
    /// Whole steps of half the table's: of a single latch of robot C. A guess: it comes near the paper's results.
    Half,
    /// Whole steps of a tenth of the table's: for robot B, as if a centimetre had been taken for a millimetre. A guess
    /// likewise.
    Tenth,
    /// Exact slicing: equal layers that end where the segment does.
    Exact,
}

/// How much longer the text's step is than Table 1's: 0.3096 cm over 0.0774 cm.
const TEXT_OVER_TABLE: f64 = 4.0;

impl SlicingRule {
    /// The rules that make sense for a robot of this index.
    #[must_use]
    pub fn of_robot(robot: usize) -> &'static [Self] {
        match robot {
            paper::B => &[Self::Table, Self::Tenth, Self::Exact],
            paper::C => &[Self::Table, Self::Half, Self::Exact],
            _ => &[Self::Text, Self::Table, Self::Exact],
        }
    }

    /// What the paper seems to have simulated a robot of this index with.
    #[must_use]
    pub fn of_paper(robot: usize) -> Self {
        if matches!(robot, paper::B | paper::C) { Self::Table } else { Self::Text }
    }

    /// Height of a whole step, mm; none where layers end with the segment.
    #[must_use]
    pub fn step(self, robot: &Robot) -> Option<f64> {
        let table = robot.description().layer.height_mm;
        match self {
            Self::Text => Some(TEXT_OVER_TABLE * table),
            Self::Table => Some(table),
            Self::Half => Some(0.5 * table),
            Self::Tenth => Some(0.1 * table),
            Self::Exact => None,
        }
    }

    /// The segments that are given whole steps. The waypoint of a two-plane path is where two circles touch, and by
    /// rounding every other path has a straight of 3e-8 radii between them: whether it is there must not decide whether
    /// a step is.
    pub(super) fn stepped(self, robot: &Robot, path: &Path) -> Path {
        let rounding = 1e-6 * robot.description().planning_radius_mm;
        path.filtered(|segment| self == Self::Exact || segment.length() > rounding)
    }

    pub(super) fn slicing(self, robot: &Robot) -> Slicing {
        self.step(robot).map_or(Slicing::Exact, |step| Slicing::Whole { step })
    }

    /// In files and results.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Text => "whole-text",
            Self::Table => "whole-table",
            Self::Half => "whole-half",
            Self::Tenth => "whole-tenth",
            Self::Exact => "exact",
        }
    }

    /// As a person reads it, for a robot of this name.
    #[must_use]
    pub fn label(self, robot: &Robot) -> String {
        self.step(robot).map_or_else(
            || "exact slicing".to_owned(),
            |step| format!("whole steps of {} mm", libm::round(step * 1e6) / 1e6),
        )
    }
}
