//! Levenberg and Marquardt's method: from a start to a nearby zero of some residuals.

use nalgebra::{SMatrix, SVector};

/// Number of steps within which the residual must have halved. Otherwise the search is given up.
const PATIENCE: usize = 8;

/// Returns the parameters, found from `start`, at which the norm of the residual is below `tolerance`. `None` if the
/// search is given up.
///
/// `residual` may reject parameters by `None`. Such a step is not taken. `jacobian` gets a point and the residual
/// there.
pub fn solve<const PARAMETERS: usize, const RESIDUALS: usize>(
    start: SVector<f64, PARAMETERS>,
    tolerance: f64,
    residual: impl Fn(&SVector<f64, PARAMETERS>) -> Option<SVector<f64, RESIDUALS>>,
    jacobian: impl Fn(&SVector<f64, PARAMETERS>, &SVector<f64, RESIDUALS>) -> Option<SMatrix<f64, RESIDUALS, PARAMETERS>>,
) -> Option<SVector<f64, PARAMETERS>> {
    let mut at = start;
    let mut miss = residual(&at)?;
    let mut damping = 1e-2;
    let mut miss_before = f64::INFINITY;
    for step in 0.. {
        if miss.norm() < tolerance {
            return Some(at);
        }
        if step % PATIENCE == 0 {
            if miss.norm() > 0.5 * miss_before {
                return None;
            }
            miss_before = miss.norm();
        }
        let slopes = jacobian(&at, &miss)?;
        let normal = slopes.transpose() * slopes;
        let descent = slopes.transpose() * miss;
        loop {
            let mut damped = normal;
            (0..PARAMETERS).for_each(|index| damped[(index, index)] += damping * (normal[(index, index)] + 1e-15));
            let next = at - damped.cholesky()?.solve(&descent);
            match residual(&next) {
                Some(next_miss) if next_miss.norm() < miss.norm() => {
                    (at, miss) = (next, next_miss);
                    damping = (damping * 0.1).max(1e-12);
                    break;
                }
                _ => damping *= 8.0,
            }
            if damping > 1e4 {
                return None;
            }
        }
    }
    None
}

/// Returns the derivatives of residuals by forward differences of this size.
pub fn differences<const PARAMETERS: usize, const RESIDUALS: usize>(
    at: &SVector<f64, PARAMETERS>,
    there: &SVector<f64, RESIDUALS>,
    size: f64,
    residual: impl Fn(&SVector<f64, PARAMETERS>) -> Option<SVector<f64, RESIDUALS>>,
) -> Option<SMatrix<f64, RESIDUALS, PARAMETERS>> {
    let mut slopes = SMatrix::<f64, RESIDUALS, PARAMETERS>::zeros();
    for parameter in 0..PARAMETERS {
        let mut beside = *at;
        beside[parameter] += size;
        slopes.set_column(parameter, &((residual(&beside)? - there) / size));
    }
    Some(slopes)
}
