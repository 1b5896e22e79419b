//! The shortest body to a position whose tip may point anywhere: in closed form.
//!
//! Such a path lies in the plane of the start's direction and the position, and is an arc and a line, or, for positions
//! within the tightest circle that starts there, two arcs (Bui, Boissonnat, Soueres and Laumond 1994, "Shortest path
//! synthesis for Dubins non-holonomic robot", ICRA).

use growbot_core::angle::wrap_positive;

/// Length of the shortest body of this bend radius to a position: at this axial and lateral distance from its
/// line. Lengths in any one unit.
#[must_use]
pub fn shortest_to(axial: f64, lateral: f64, radius: f64) -> f64 {
    let (axial, lateral) = (axial / radius, lateral.abs() / radius);
    [lateral, -lateral]
        .into_iter()
        .flat_map(|lateral| {
            [arc_and_line(axial, lateral), two_arcs(axial, lateral, 1.0), two_arcs(axial, lateral, -1.0)]
        })
        .fold(f64::INFINITY, f64::min)
        * radius
}

/// Turning towards positive `lateral`, then straight on; infinite for positions within the circle. Lengths in radii.
fn arc_and_line(axial: f64, lateral: f64) -> f64 {
    let (x, y) = (lateral - 1.0, axial);
    let beyond = x * x + y * y - 1.0;
    if beyond < -ROUNDING {
        return f64::INFINITY;
    }
    let line = libm::sqrt(beyond.max(0.0));
    let turn = std::f64::consts::PI - libm::atan2(y, x) - libm::atan2(line, 1.0);
    nearly_none(turn) + line
}

/// Turning away from positive `lateral`, then towards it on a second circle that touches the first; infinite where
/// there is no such circle through the position. Lengths in radii.
fn two_arcs(axial: f64, lateral: f64, side: f64) -> f64 {
    // The first circle is round (-1, 0), the second one's centre lies 2 from there and 1 from the position.
    let (x, y) = (lateral + 1.0, axial);
    let distance = libm::hypot(x, y);
    let cosine = (3.0 + distance * distance) / (4.0 * distance);
    if cosine > 1.0 + ROUNDING {
        return f64::INFINITY;
    }
    let first = libm::atan2(y, x) + side * libm::acos(cosine.min(1.0));
    let (sin, cos) = libm::sincos(first);
    let second = first + std::f64::consts::PI - libm::atan2(y - 2.0 * sin, x - 2.0 * cos);
    nearly_none(first) + nearly_none(second)
}

/// What rounding may do to lengths in radii.
const ROUNDING: f64 = 1e-12;

/// An angle in `[0, 2 pi)`; a rounding error below a full turn is no turn.
fn nearly_none(angle: f64) -> f64 {
    let angle = wrap_positive(angle);
    if angle > std::f64::consts::TAU - 1e-9 { 0.0 } else { angle }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    /// The shortest of many paths of two pieces, tried one by one.
    fn by_trying(axial: f64, lateral: f64) -> f64 {
        let n = 20_000;
        let mut best = f64::INFINITY;
        for i in 0..n {
            let turn = 2.0 * PI * f64::from(i) / f64::from(n);
            let (sin, cos) = libm::sincos(turn);
            for side in [1.0, -1.0] {
                // The position seen from the tip after a turn towards `side`.
                let (x, y) = (side * lateral - (1.0 - cos), axial - sin);
                let (across, on) = (x * cos - y * sin, x * sin + y * cos);
                if across.abs() < 2e-3 && on >= 0.0 {
                    best = best.min(turn + on);
                }
                // On a circle that turns back.
                let off = (across + 1.0) * (across + 1.0) + on * on - 1.0;
                if off.abs() < 4e-3 {
                    let back = libm::atan2(on, 1.0 + across);
                    best = best.min(turn + if back < 0.0 { back + 2.0 * PI } else { back });
                }
            }
        }
        best
    }

    #[test]
    fn well_known_positions() {
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

    #[test]
    fn no_path_of_two_pieces_is_shorter() {
        for i in -15..=15 {
            for j in 0..=15 {
                let (axial, lateral) = (f64::from(i) * 0.2 + 0.013, f64::from(j) * 0.2 + 0.007);
                let (found, tried) = (shortest_to(axial, lateral, 1.0), by_trying(axial, lateral));
                assert!((found - tried).abs() < 0.1, "{axial}, {lateral}: {found}, and by trying {tried}");
            }
        }
    }
}
