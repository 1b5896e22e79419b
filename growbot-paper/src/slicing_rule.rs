//! Slicing rules: how the paths of the experiments are sliced into layers.

use growbot_core::path::Path;
use growbot_core::robot::Robot;
use growbot_core::slicing::Slicing;

use super::paper;

/// Rule for slicing a path into layers. The paper gives two values of the step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum SlicingRule {
    /// Whole steps, rounded up, of the text's `g t = 0.3096` cm. The text gives it for the robots of Table 1 only.
    Text,
    /// Whole steps, rounded up, of `g dt` from Tables 1 and 3.
    Table,
    /// Whole steps of half the height in Table 3, for robot C, whose latches have that distance. This is a guess that
    /// comes near the paper's results.
    Half,
    /// Whole steps of a tenth of the height in Table 3, for robot B, as if a centimetre had been taken for a
    /// millimetre. This is a guess that comes near the paper's results.
    Tenth,
    /// Exact slicing: equal layers that end where the segment ends.
    Exact,
}

/// Ratio of the text's step to that of Table 1: 0.3096 cm over 0.0774 cm.
const TEXT_OVER_TABLE: f64 = 4.0;

impl SlicingRule {
    /// Returns the rules by which the paths of the robot with this index are sliced in the experiments.
    pub fn of_robot(robot: usize) -> &'static [Self] {
        match robot {
            paper::B => &[Self::Table, Self::Tenth, Self::Exact],
            paper::C => &[Self::Table, Self::Half, Self::Exact],
            _ => &[Self::Text, Self::Table, Self::Exact],
        }
    }

    /// Returns the rule that the paper seems to have used for a robot with this index.
    pub fn of_paper(robot: usize) -> Self {
        if matches!(robot, paper::B | paper::C) { Self::Table } else { Self::Text }
    }

    /// Returns the height of a whole step, mm. `None` if layers end with the segment.
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

    /// Returns the path to slice. For whole steps, straight segments that are only rounding errors are removed,
    /// because each would add a whole step. In every other two-plane path, rounding puts a straight of 3e-8 radii
    /// between the arcs that meet at the waypoint.
    pub(super) fn stepped(self, robot: &Robot, path: &Path) -> Path {
        let rounding = 1e-6 * robot.description().planning_radius_mm;
        path.filtered(|segment| self == Self::Exact || segment.length() > rounding)
    }

    pub(super) fn slicing(self, robot: &Robot) -> Slicing {
        self.step(robot).map_or(Slicing::Exact, |step| Slicing::Whole { step })
    }

    /// Returns the name of the rule in files and results.
    pub fn name(self) -> &'static str {
        match self {
            Self::Text => "whole-text",
            Self::Table => "whole-table",
            Self::Half => "whole-half",
            Self::Tenth => "whole-tenth",
            Self::Exact => "exact",
        }
    }

    /// Returns the label of the rule for users, with the step of this robot.
    pub fn label(self, robot: &Robot) -> String {
        self.step(robot).map_or_else(
            || "exact slicing".to_owned(),
            |step| format!("whole steps of {} mm", libm::round(step * 1e6) / 1e6),
        )
    }
}
