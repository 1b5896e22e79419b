//! One field of a robot description, with the checks of its value.

use super::RobotError;

/// Max size of a part of a robot, mm.
pub(super) const MAX_SIZE: f64 = 1e4;
/// Min size of a part of a robot, mm.
pub(super) const MIN_SIZE: f64 = 1e-3;

/// Returns the text on a desktop, and an empty text on a board, which reports only the name of a field. This saves the
/// texts' flash.
#[inline(always)]
pub(super) const fn advice(text: &'static str) -> &'static str {
    if cfg!(target_os = "none") { "" } else { text }
}

/// A field of a robot description, as its name and its value. The methods check the value.
pub(super) struct CheckedField(pub &'static str, pub f64);

impl CheckedField {
    pub(super) fn between(&self, min: f64, max: f64, advice: &'static str) -> Result<(), RobotError> {
        let &Self(field, value) = self;
        if !value.is_finite() {
            return Err(RobotError::NotFinite { field, value });
        }
        if value < min {
            return Err(RobotError::TooSmall { field, value, limit: min, advice });
        }
        if value > max {
            return Err(RobotError::TooLarge { field, value, limit: max, advice });
        }
        Ok(())
    }

    pub(super) fn size(&self) -> Result<(), RobotError> {
        self.between(MIN_SIZE, MAX_SIZE, advice("give the size in mm, and check the unit"))
    }
}
