//! Seeds with a narrow neck for two arcs that overlap. Overlap means that the line between the arcs has a negative
//! length.
//!
//! At such a neck the bend turns from the plane of the first arc to that of the last within a very short length. Two
//! arcs would need to make this turn instantly. With `r = |m| / nu`, near the neck
//!
//! ```text
//! (r r')^2 nu = 2 r^2 (r - 1) + kappa^2 (r^2 - 1),   twist = kappa sqrt(nu)
//! ```
//!
//! By integration over `r` from 1 on, the bend turns by `psi(kappa)` in total. The bend of the helicoidal arc is longer
//! than that of two arcs by `2 c(kappa) sqrt(nu)`, which is the overlap:
//!
//! ```text
//! psi = 2 int (kappa / r^2) / sqrt(2 (r - 1) + kappa^2 (1 - 1/r^2)) dr
//! c = lim sqrt(2 r + kappa^2 - 2) - int_1^r dr / sqrt(2 (r - 1) + kappa^2 (1 - 1/r^2))
//! ```

use super::seed::Seed;
use crate::angle::wrap_signed;
use crate::shortest::csc::Csc;
use crate::trigonometry;

/// Min and max of the angle between the planes of the two arcs, radians. Other angles are clamped to this range,
/// because the formulas would lead to necks outside of the range of the search.
const ANGLES: (f64, f64) = (0.02, 3.138);

/// Returns `kappa` and `c` for an angle between two planes, with errors of up to 5 and 12 %
/// (`formulas_match_the_integrals`).
fn kappa_and_c(angle: f64) -> (f64, f64) {
    let tangent = trigonometry::tan(0.5 * angle.clamp(ANGLES.0, ANGLES.1));
    let kappa = 0.9 * tangent * libm::exp(-0.42 * libm::log(1.0 + 0.229 * tangent));
    (kappa, kappa * kappa / libm::sqrt(kappa * kappa + 1.44))
}

/// Returns a seed for a helicoidal arc close to a path whose arcs overlap.
pub(super) fn seed(path: &Csc) -> Seed<f64> {
    let turned = wrap_signed(path.last_bend_direction - path.first_bend_direction);
    let (kappa, c) = kappa_and_c(turned.abs());
    let overlap = -path.straight;
    let width = overlap / (2.0 * c);
    Seed {
        narrowness: (2.0 * libm::log(width)).clamp(-27.0, 1.0),
        twist: libm::log(kappa * width).clamp(-14.0, 2.0),
        mirrored: turned > 0.0,
        // Away from the neck the phase equals the length.
        start: -(path.first_angle - 0.5 * overlap).max(0.05),
        end: (path.last_angle - 0.5 * overlap).max(0.05),
        uses_circles: false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::PI;

    /// Computes `psi` and `c` by the midpoint rule over `u`, with `r = 1 + u^2` and `u = v^2 / (1 - v)`.
    fn integrals(kappa: f64) -> (f64, f64) {
        let steps = 400_000_u32;
        let (mut psi, mut c) = (0.0, kappa);
        for n in 0..steps {
            let v = (f64::from(n) + 0.5) / f64::from(steps);
            let u = v * v / (1.0 - v);
            let du = v * (2.0 - v) / ((1.0 - v) * (1.0 - v)) / f64::from(steps);
            let r = 1.0 + u * u;
            let per_root = 2.0 / libm::sqrt(2.0 + kappa * kappa * (r + 1.0) / (r * r));
            psi += 2.0 * kappa / (r * r) * per_root * du;
            c += (2.0 * u / libm::sqrt(2.0 * u * u + kappa * kappa) - per_root) * du;
        }
        (psi, c)
    }

    #[test]
    fn formulas_match_the_integrals() {
        for kappa in [0.02, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0] {
            let (psi, c) = integrals(kappa);
            assert!(psi < PI);
            let (by_formula, c_by_formula) = kappa_and_c(psi);
            assert!((by_formula / kappa - 1.0).abs() < 0.05, "{by_formula} for kappa {kappa}");
            assert!((c_by_formula / c - 1.0).abs() < 0.12, "{c_by_formula} for c {c} at kappa {kappa}");
        }
    }
}
