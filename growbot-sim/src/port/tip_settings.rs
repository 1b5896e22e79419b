//! Settings of the simulated tip behind a port.

use growbot_core::simulation::ErrorModel;

use crate::tip::TipModel;

/// Settings of a simulated tip.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TipSettings {
    /// Errors of the layers that the tip lays, and of its measurements.
    pub imperfection: ErrorModel,
    /// Speed of the tip's time as a multiple of real time, above 0. If `None`, time passes as fast as it is computed.
    /// Used only for the port `sim`.
    pub pace: Option<f64>,
}

impl TipSettings {
    pub(crate) fn apply(&self, tip: &mut TipModel) {
        tip.disturb(&self.imperfection);
    }
}
