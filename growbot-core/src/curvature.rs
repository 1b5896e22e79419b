//! The tightest bend of a robot, from the packaging limit (Eq 7) and from the limits of its layers.
//!
//! Both limits give a min radius of the centreline, mm. The larger of the two is R_min.

/// Returns the min radius by the packaging limit (Eq 7 of Del Dottore et al. 2019), mm: `(L^2 - r_t^2 + r_r^2) / (2
/// (r_t - r_r))`. On a tighter bend the stiff parts inside the tube would touch it.
///
/// - `tip_radius`, `r_t`: distance from the centreline to where material is laid, mm.
/// - `inner_radius`, `r_r < r_t`: radius of the cylinder round the parts inside the tube, mm.
/// - `inner_length`, `L`: distance from the deposition plane to the back end of the parts inside the tube, mm.
///
/// ```
/// let r_min = growbot_core::curvature::min_radius_by_packaging(22.0, 12.0, 48.0);
/// assert!((r_min - 98.2).abs() < 1e-12);
/// ```
pub fn min_radius_by_packaging(tip_radius: f64, inner_radius: f64, inner_length: f64) -> f64 {
    let (t, r, l) = (tip_radius, inner_radius, inner_length);
    (l * l - t * t + r * r) / (2.0 * (t - r))
}

/// Returns the min radius by the limits of a layer, mm. At this radius `R` the max mean height, [`max_mean_height`],
/// leaves exactly the min height on the inner side: `h (1 - r_t / R) = height_min`. Lengths are in mm, `tilt_max` in
/// radians.
///
/// Each of the three bounds in [`max_mean_height`] gives a radius. The largest of these radii is the limit.
pub fn min_radius_by_layers(tip_radius: f64, height: f64, height_min: f64, height_max: f64, tilt_max: f64) -> f64 {
    let by_mean_height = tip_radius / (1.0 - height_min / height);
    let by_tilt = tip_radius + height_min / tilt_max;
    let by_outer_height = tip_radius * (height_max + height_min) / (height_max - height_min);
    by_mean_height.max(by_tilt).max(by_outer_height)
}

/// Returns the max mean height of a layer on a bend of `curvature = 1 / R` (1/mm, 0 for a straight line), mm:
/// `min(height, R tilt_max, height_max / (1 + r_t / R))`. Lengths are in mm, `tilt_max` in radians.
pub fn max_mean_height(tip_radius: f64, height: f64, height_max: f64, tilt_max: f64, curvature: f64) -> f64 {
    let by_outer_height = height_max / (1.0 + tip_radius * curvature);
    let by_mean_height = height.min(by_outer_height);
    // This form does not divide by a curvature of 0, so a straight line needs no special case.
    if by_mean_height * curvature <= tilt_max { by_mean_height } else { tilt_max / curvature }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::radians;

    #[test]
    fn min_radius_of_robot_a_is_98_2_mm() {
        assert!((min_radius_by_packaging(22.0, 12.0, 48.0) - 98.2).abs() < 1e-12);
    }

    #[test]
    fn inner_side_has_the_min_height_at_the_layer_radius() {
        let (tip_radius, height, height_min, height_max, tilt_max) = (22.0, 0.774, 0.35, 0.95, radians(0.45));
        let radius = min_radius_by_layers(tip_radius, height, height_min, height_max, tilt_max);
        let mean = max_mean_height(tip_radius, height, height_max, tilt_max, 1.0 / radius);
        assert!((mean * (1.0 - tip_radius / radius) - height_min).abs() < 1e-12);
    }

    #[test]
    fn the_measured_limits_agree_with_the_packaging_limit_of_robot_a() {
        // The robot's measured limits are 0.45 deg and 0.95 mm on the outer side. The paper derives 97.9 mm from them.
        let mean = max_mean_height(22.0, 0.774, 0.95, radians(0.45), 1.0 / 98.2);
        assert!((mean - 98.2 * radians(0.45)).abs() < 1e-12, "{mean}");
        assert!((mean * (1.0 + 22.0 / 98.2) - 0.95).abs() < 0.01);
    }
}
