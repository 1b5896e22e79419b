//! The inputs of the simulated nozzle.

/// Inputs of the nozzle, which are constant until they are set again.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct NozzleInputs {
    /// Power of the heater, W.
    pub power_w: f64,
    /// Heat loss to the surroundings, W/K.
    pub loss_w_per_k: f64,
    /// Time constant of the thermistor, s.
    pub lag_s: f64,
    /// Fraction of the block's temperature above the surroundings that the thermistor measures, 0 to 1.
    pub share: f64,
}
