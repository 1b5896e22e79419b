//! States of the heater's two switches.

/// States of the heater's two switches.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeaterOutput {
    /// Duty of the power stage, 0 to 1.
    pub duty: f64,
    /// True if the second switch, in series with the power stage, is closed.
    pub enable: bool,
}

impl HeaterOutput {
    /// Output with both switches open.
    pub const OFF: Self = Self { duty: 0.0, enable: false };
    pub(super) const SECOND_SWITCH_ALONE: Self = Self { duty: 0.0, enable: true };
    pub(super) const POWER_STAGE_ALONE: Self = Self { duty: 1.0, enable: false };
}
