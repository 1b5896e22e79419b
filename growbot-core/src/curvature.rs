//! The tightest bend of a robot, from its mechanics (Eq 7) and from its layers.
//!
//! Both are min radii of the centreline, mm; the larger one binds.

/// Min radius that the mechanics allow (Eq 7 of Del Dottore et al. 2019), mm:
/// `R_min = (L^2 - r_t^2 + r_r^2) / (2 (r_t - r_r))`.
///
/// - `tip_radius`, `r_t`: from the centreline to where material is laid.
/// - `inner_radius`, `r_r < r_t`: of the cylinder round the parts inside the tube.
/// - `inner_length`, `L`: from the deposition plane to the back end of those parts.
///
/// ```
/// let r_min = growbot_core::curvature::least_radius_of_geometry(22.0, 12.0, 48.0);
/// assert!((r_min - 98.2).abs() < 1e-12);
/// ```
#[must_use]
pub fn least_radius_of_geometry(tip_radius: f64, inner_radius: f64, inner_length: f64) -> f64 {
    let (t, r, l) = (tip_radius, inner_radius, inner_length);
    (l * l - t * t + r * r) / (2.0 * (t - r))
}

/// Min radius that the layers allow, mm: where the highest mean height that a bend of radius `R` permits,
/// [`greatest_mean_height`], leaves exactly the min height on the inner side, `h (1 - r_t / R) = height_min`.
///
/// Each of the three bounds on the mean height gives a radius of its own; the largest binds.
#[must_use]
pub fn least_radius_of_layers(tip_radius: f64, height: f64, height_min: f64, height_max: f64, tilt_max: f64) -> f64 {
    let by_mean_height = tip_radius / (1.0 - height_min / height);
    let by_tilt = tip_radius + height_min / tilt_max;
    let by_outer_height = tip_radius * (height_max + height_min) / (height_max - height_min);
    by_mean_height.max(by_tilt).max(by_outer_height)
}

/// The highest mean height of a layer on a bend of `curvature = 1 / R` (1/mm, 0 for straight), mm:
/// `min(height, R tilt_max, height_max / (1 + r_t / R))`.
#[must_use]
pub fn greatest_mean_height(tip_radius: f64, height: f64, height_max: f64, tilt_max: f64, curvature: f64) -> f64 {
    let by_outer_height = height_max / (1.0 + tip_radius * curvature);
    let by_mean_height = height.min(by_outer_height);
    // Written without a division by the curvature, so that straight is no special case.
    if by_mean_height * curvature <= tilt_max { by_mean_height } else { tilt_max / curvature }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::angle::radians;

    #[test]
    fn robot_a_bends_to_98_2_mm() {
        assert!((least_radius_of_geometry(22.0, 12.0, 48.0) - 98.2).abs() < 1e-12);
    }

    #[test]
    fn at_the_layer_radius_the_inner_side_is_exactly_the_least_height() {
        let (tip_radius, height, height_min, height_max, tilt_max) = (22.0, 0.774, 0.35, 0.95, radians(0.45));
        let radius = least_radius_of_layers(tip_radius, height, height_min, height_max, tilt_max);
        let mean = greatest_mean_height(tip_radius, height, height_max, tilt_max, 1.0 / radius);
        assert!((mean * (1.0 - tip_radius / radius) - height_min).abs() < 1e-12);
    }

    #[test]
    fn the_measured_limits_agree_with_the_mechanics_of_robot_a() {
        // 0.45 deg and 0.95 mm on the outer side were measured; the paper derives 97.9 mm from them.
        let mean = greatest_mean_height(22.0, 0.774, 0.95, radians(0.45), 1.0 / 98.2);
        assert!((mean - 98.2 * radians(0.45)).abs() < 1e-12, "{mean}");
        assert!((mean * (1.0 + 22.0 / 98.2) - 0.95).abs() < 0.01);
    }
}
