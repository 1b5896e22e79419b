//! Clearance of the wall of a body from itself.
//!
//! Every body is near itself along its own length. Only a point where one part of the body passes another part counts.
//! Such a point is a local minimum of the distance between two points of the centreline that are more than `pi D / 2`
//! apart along it (see [`growbot_plan::self_collision`]).

use std::f64::consts::FRAC_PI_2;

use growbot_core::layer_bytes::LayerBytes;
use growbot_core::pose::Frame;
use nalgebra::Vector3;

use super::centreline::{points_along, thinned};

/// Greatest number of points of the body that are examined, without the first. A body of 1 m has about one point per
/// millimetre.
const MAX_POINTS: usize = 1500;

/// Returns the least distance (mm) between two walls where one part of a tube passes another part. `diameter` is that
/// of the tube, mm, positive. The result is negative if the walls overlap, and `None` if no part of the body passes
/// another. Because only some points of the centreline are examined, the result for a body of `L` mm may be too great
/// by about `(L / 1500)^2 / D` mm, where `D` is the diameter.
pub fn self_clearance(start: &Frame, layers: &[LayerBytes], diameter: f64) -> Option<f64> {
    let points = thinned(&points_along(start, layers), MAX_POINTS);
    nearest_pass(&points, FRAC_PI_2 * diameter).map(|distance| distance - diameter)
}

/// Returns the least local minimum of the distance between two points of a line that are more than `neighbourhood`
/// apart along the line. Each point is given with its length along the line, mm.
fn nearest_pass(points: &[(Vector3<f64>, f64)], neighbourhood: f64) -> Option<f64> {
    let between = |a: usize, b: usize| Some((points.get(a)?.0 - points.get(b)?.0).norm());
    let mut nearest: Option<f64> = None;
    for (i, (point, at)) in points.iter().enumerate() {
        let beyond = points.partition_point(|(_, length)| *length <= at + neighbourhood);
        for (j, (other, _)) in points.iter().enumerate().skip(beyond) {
            let distance = (other - point).norm();
            if nearest.is_some_and(|nearest| distance >= nearest) {
                continue;
            }
            let around =
                [between(i, j + 1), between(i + 1, j), between(i, j - 1), i.checked_sub(1).and_then(|i| between(i, j))];
            if around.iter().flatten().all(|near| distance <= *near) {
                nearest = Some(distance);
            }
        }
    }
    nearest
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use growbot_core::layer::Layer;
    use growbot_core::layer_bytes::LayerEncoder;

    use super::*;

    /// Returns the layers of an arc of this radius through `turn` radians, followed by a straight line.
    fn bent(radius: f64, turn: f64, straight: f64) -> Vec<LayerBytes> {
        let mut encoder = LayerEncoder::default();
        let round = (radius * turn) as usize;
        let arc = Layer { alpha: 0.0, height: 1.0, tilt: 1.0 / radius };
        let line = Layer { height: 1.0, ..Layer::default() };
        let layers = std::iter::repeat_n(arc, round).chain(std::iter::repeat_n(line, straight as usize));
        layers.map(|layer| encoder.encode(&layer)).collect()
    }

    #[test]
    fn only_stretches_passing_each_other_count() {
        let start = Frame::identity();
        assert_eq!(self_clearance(&start, &bent(100.0, 0.0, 1000.0), 50.0), None);
        assert_eq!(self_clearance(&start, &bent(100.0, 1.5, 300.0), 50.0), None);
        assert_eq!(self_clearance(&start, &[], 50.0), None);
    }

    #[test]
    fn a_gap_is_measured_from_wall_to_wall() {
        let start = Frame::identity();
        // A circle of 0.9 turns passes its own start. The gap is the chord of the missing tenth minus the diameter.
        let gap = self_clearance(&start, &bent(100.0, 0.9 * TAU, 0.0), 50.0).unwrap();
        let chord = 2.0 * 100.0 * libm::sin(0.05 * TAU);
        assert!((gap - (chord - 50.0)).abs() < 1.5, "{gap}, {chord}");
        let ring = self_clearance(&start, &bent(100.0, TAU, 100.0), 50.0).unwrap();
        assert!((ring + 50.0).abs() < 1.5, "{ring}");
    }
}
