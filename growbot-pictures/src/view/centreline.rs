//! The centreline of a body, as points.

use std::iter::once;

use growbot_core::layer_bytes::{LayerBytes, decode};
use growbot_core::pose::Frame;
use growbot_plan::plan_deviation::centreline;
use nalgebra::Vector3;

/// Greatest number of points of a line next to a body, without the first.
const MAX_POLYLINE_POINTS: usize = 500;

/// Returns the positions of the tip, at the start and after each layer, mm.
pub fn points(start: &Frame, layers: &[LayerBytes]) -> Vec<Vector3<f64>> {
    centreline(start, layers.iter().map(decode))
}

/// Returns the positions of the tip, at the start and after each layer, each with the length of the body there, mm.
pub fn points_along(start: &Frame, layers: &[LayerBytes]) -> Vec<(Vector3<f64>, f64)> {
    let mut length = 0.0;
    let lengths = layers.iter().map(|layer| {
        length += decode(layer).height;
        length
    });
    points(start, layers).into_iter().zip(once(0.0).chain(lengths)).collect()
}

/// Returns the first and the last point, with some of those between them: at most `max` points after the first.
pub fn thinned<T: Copy>(points: &[T], max: usize) -> Vec<T> {
    let stride = points.len().saturating_sub(1).div_ceil(max).max(1);
    let (first, rest) = points.split_at(points.len().min(1));
    first.iter().chain(rest.chunks(stride).filter_map(<[T]>::last)).copied().collect()
}

/// Returns the points of a line next to a body.
pub fn polyline(points: &[Vector3<f64>]) -> Vec<Vector3<f64>> {
    thinned(points, MAX_POLYLINE_POINTS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_ends_of_a_thinned_line_stay() {
        let all: Vec<usize> = (0..=1000).collect();
        assert_eq!(thinned(&all, 3), [0, 334, 668, 1000]);
        assert_eq!(thinned(&all, 1000), all);
        assert_eq!((thinned(&all[..1], 3), thinned(&all[..0], 3)), (vec![0], vec![]));
    }
}
