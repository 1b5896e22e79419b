//! Kind of a robot: real or simulated.

/// Kind of a robot.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RobotKind {
    /// A robot that grows a body.
    Real,
    /// A robot whose tip is computed. Texts about it say so.
    Simulated,
}

impl RobotKind {
    /// Reports whether the robot is simulated.
    pub fn is_simulated(self) -> bool {
        self == Self::Simulated
    }

    /// Returns the word that precedes "robot" or "board" in messages about a simulated robot. It is empty for a real
    /// one.
    pub fn prefix(self) -> &'static str {
        if self.is_simulated() { "simulated " } else { "" }
    }

    /// Returns the remark after the name of a simulated robot. It is empty for a real one.
    pub fn suffix(self) -> &'static str {
        if self.is_simulated() { ", simulated" } else { "" }
    }
}

impl From<bool> for RobotKind {
    /// Returns the kind of a robot that a file or a message describes as simulated or not.
    fn from(is_simulated: bool) -> Self {
        if is_simulated { Self::Simulated } else { Self::Real }
    }
}
