//! The direction of a motor.

/// Direction of a motor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MotorDirection {
    /// The feed pushes filament out, and the head turns counter-clockwise.
    #[default]
    Forward,
    /// The feed pulls filament back, and the head turns clockwise.
    Backward,
}

impl MotorDirection {
    /// Returns the direction of a distance or an angle with this sign. 0 is forward.
    pub fn of(distance: i32) -> Self {
        if distance < 0 { Self::Backward } else { Self::Forward }
    }

    /// Returns the opposite direction.
    pub fn opposite(self) -> Self {
        if self == Self::Forward { Self::Backward } else { Self::Forward }
    }
}
