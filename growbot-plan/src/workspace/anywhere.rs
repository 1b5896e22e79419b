//! Length of the shortest body to a position, for any final direction, in closed form ([`growbot_core::to_point`]).

use growbot_core::to_position::planar;

/// Returns the length of the shortest body with this bend radius to a position. `axial` is the position's distance
/// from the start along the start's direction, and `lateral` is its distance from the line in that direction. All
/// lengths have the same unit.
pub fn shortest_to(axial: f64, lateral: f64, radius: f64) -> f64 {
    planar(axial / radius, lateral / radius).first().map_or(f64::INFINITY, |path| path.length() * radius)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn shortest_lengths_to_known_positions() {
        for (axial, lateral, length) in [
            (0.0, 0.0, 0.0),
            (500.0, 0.0, 500.0),
            (0.0, 200.0, 100.0 * PI),
            (100.0, 100.0, 50.0 * PI),
            (100.0, -100.0, 50.0 * PI),
            (-300.0, 200.0, 100.0 * PI + 300.0),
        ] {
            assert!((shortest_to(axial, lateral, 100.0) - length).abs() < 1e-9, "{axial}, {lateral}");
        }
    }
}
