//! The parameters of the refinement of an arc, in single and in double precision.

use super::closed_form::Nodes;

/// Parameters of the refinement of an arc in one precision.
pub(super) trait Precision: Nodes {
    /// Max number of steps of the refinement.
    const ROUNDS: usize;
    /// Max residual of an arc that counts as converged, radii and radians.
    const MISFIT: Self;
    /// Relative change of the numbers at the neck by which their derivatives are computed numerically.
    const DERIVATIVE_STEP: Self;
    /// True if another refinement follows. If so, the arc has no circles between its necks, because they would take too
    /// much time.
    const IS_ROUGH: bool;
    /// Initial damping of the Levenberg-Marquardt method.
    const DAMPING: Self;
    /// Max ratio of the square of the residual to its value three steps before. The refinement ends if the ratio is
    /// larger.
    const FALL: Self;
}

impl Precision for f32 {
    const ROUNDS: usize = 9;
    const MISFIT: Self = 3e-4;
    const DERIVATIVE_STEP: Self = 4e-3;
    const IS_ROUGH: bool = true;
    const DAMPING: Self = 1e-3;
    const FALL: Self = 0.5;
}

impl Precision for f64 {
    const ROUNDS: usize = 12;
    const MISFIT: Self = 1e-11;
    const DERIVATIVE_STEP: Self = 1e-5;
    const IS_ROUGH: bool = false;
    const DAMPING: Self = 1e-6;
    const FALL: Self = 1.0;
}
