//! Cutting a path into layers.
//!
//! *Exact* slicing cuts a segment of length `S` and bend `beta` into `n` equal layers of height `S / n` and tilt
//! `beta / n`, with the least `n` that keeps every layer within the robot's limits
//! (`h <= min(nominal, R tilt_max, h_max / (1 + r_t / R))`, to 1e-9 of the limit): the sum of the layers is the path.
//!
//! *Whole* slicing is the paper's: a segment is cut into steps of one height, and the last step is laid whole, so that the
//! tip passes the end of the segment by up to a step. It is there to reproduce the paper's tables.

use core::iter::FusedIterator;

use crate::layer::Layer;
use crate::path::{Path, Segment};
use crate::robot::Robot;

/// How a path is cut into layers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Slicing {
    /// Equal layers that end exactly where the segment does.
    Exact,
    /// Whole steps of this height (mm), rounded up, as in the paper.
    Whole {
        /// Height of a step, mm.
        step: f64,
    },
}

/// Limits hold to this share of themselves, so that a segment of exactly `n` layers is not cut into `n + 1`.
pub const LIMIT_SLACK: f64 = 1e-9;

/// A layer and the segment it belongs to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlicedLayer {
    /// Index of the segment, from 0.
    pub segment: usize,
    /// The layer.
    pub layer: Layer,
}

/// The layers of a path, in order.
#[derive(Debug, Clone)]
pub struct Layers<'a> {
    segments: &'a [Segment],
    robot: &'a Robot,
    slicing: Slicing,
    /// Index of the segment that is being cut.
    segment: usize,
    /// What is left of it: how many layers, all alike.
    left: u64,
    layer: Layer,
}

/// The layers of a path on this robot.
///
/// ```
/// use growbot_core::{layer, path::{Path, Segment}, slicing::{Slicing, layers}};
/// # let file = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/growbot-a.toml"));
/// # let robot = growbot_core::robot::Robot::new(toml::from_str(file).unwrap()).unwrap();
/// let mut path = Path::new();
/// path.push(Segment::Arc { alpha: 1.0, bend: 0.5, length: 50.0 }).unwrap();
/// assert_eq!(layers(&path, &robot, Slicing::Exact).count(), 65);
/// let heights: f64 = layers(&path, &robot, Slicing::Exact).map(|sliced| sliced.layer.height).sum();
/// assert!((heights - 50.0).abs() < 1e-12);
/// ```
#[must_use]
pub fn layers<'a>(path: &'a Path, robot: &'a Robot, slicing: Slicing) -> Layers<'a> {
    let mut layers = Layers { segments: path.segments(), robot, slicing, segment: 0, left: 0, layer: Layer::default() };
    layers.cut_from(0);
    layers
}

/// Number of layers and the layer itself, for one segment.
fn cut(segment: &Segment, robot: &Robot, slicing: Slicing) -> (u64, Layer) {
    let length = segment.length();
    match slicing {
        Slicing::Exact => {
            let limit = robot.greatest_mean_height(segment.curvature());
            let n = libm::ceil(length / (limit * (1.0 + LIMIT_SLACK))).max(1.0);
            (n as u64, Layer { alpha: segment.alpha(), height: length / n, tilt: segment.bend() / n })
        }
        Slicing::Whole { step } => {
            let n = libm::ceil(length / step * (1.0 - LIMIT_SLACK)).max(1.0);
            (n as u64, Layer { alpha: segment.alpha(), height: step, tilt: segment.curvature() * step })
        }
    }
}

impl Layers<'_> {
    /// Cuts the first segment from this index on.
    fn cut_from(&mut self, segment: usize) {
        self.segment = segment;
        if let Some(next) = self.segments.get(segment) {
            (self.left, self.layer) = cut(next, self.robot, self.slicing);
        }
    }
}

impl Iterator for Layers<'_> {
    type Item = SlicedLayer;

    fn next(&mut self) -> Option<SlicedLayer> {
        if self.left == 0 {
            return None;
        }
        let sliced = SlicedLayer { segment: self.segment, layer: self.layer };
        self.left -= 1;
        if self.left == 0 {
            self.cut_from(self.segment + 1);
        }
        Some(sliced)
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let later = self.segments.iter().skip(self.segment + 1).map(|segment| cut(segment, self.robot, self.slicing).0);
        let all = self.left + later.sum::<u64>();
        usize::try_from(all).map_or((usize::MAX, None), |exact| (exact, Some(exact)))
    }
}

impl FusedIterator for Layers<'_> {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layer::grow;
    use crate::pose::Frame;
    use crate::testing::robot_a;
    use proptest::prelude::*;

    fn segment() -> impl Strategy<Value = Segment> {
        prop_oneof![
            (0.0..6.2, 1e-9..6.2, 98.2..1e4).prop_map(|(alpha, bend, radius)| Segment::Arc {
                alpha,
                bend,
                length: bend * radius
            }),
            (1e-7..5e3).prop_map(|length| Segment::Straight { length }),
        ]
    }

    proptest! {
        #[test]
        fn exact_layers_sum_to_the_path_and_keep_every_limit(segments in prop::collection::vec(segment(), 0..6)) {
            let robot = robot_a();
            let mut path = Path::new();
            for segment in segments {
                path.push(segment).unwrap();
            }
            let start = Frame::identity();
            let end = grow(&start, layers(&path, &robot, Slicing::Exact).map(|sliced| sliced.layer));
            let wanted = path.end(&start);
            prop_assert!((end.translation.vector - wanted.translation.vector).norm() < 1e-6);
            let limits = robot.description().layer;
            for SlicedLayer { layer, .. } in layers(&path, &robot, Slicing::Exact) {
                prop_assert!(robot.check_layer(&layer, LIMIT_SLACK * 1.001).is_ok(), "{layer:?}");
                prop_assert!(layer.height <= limits.height_mm * (1.0 + 1.001 * LIMIT_SLACK));
            }
        }

        #[test]
        fn the_number_of_layers_is_the_least(length in 0.1..100.0) {
            let robot = robot_a();
            let mut path = Path::new();
            path.push(Segment::Straight { length }).unwrap();
            let n = layers(&path, &robot, Slicing::Exact).count() as f64;
            prop_assert!(length / n <= 0.774 * (1.0 + 1e-8));
            prop_assert!(n == 1.0 || length / (n - 1.0) > 0.774);
        }

        #[test]
        fn size_hint_counts(segments in prop::collection::vec(segment(), 0..6)) {
            let robot = robot_a();
            let mut path = Path::new();
            for segment in segments {
                path.push(segment).unwrap();
            }
            let layers = layers(&path, &robot, Slicing::Exact);
            prop_assert_eq!(layers.size_hint().0, layers.count());
        }
    }

    #[test]
    fn a_segment_of_whole_layers_is_not_cut_once_more() {
        let mut path = Path::new();
        path.push(Segment::Straight { length: 0.774 * 10.0 }).unwrap();
        assert_eq!(layers(&path, &robot_a(), Slicing::Exact).count(), 10);
        assert_eq!(layers(&path, &robot_a(), Slicing::Whole { step: 0.774 }).count(), 10);
    }

    #[test]
    fn whole_steps_pass_the_end_by_less_than_a_step() {
        let mut path = Path::new();
        path.push(Segment::Arc { alpha: 0.0, bend: 1.0, length: 100.0 }).unwrap();
        let laid: f64 = layers(&path, &robot_a(), Slicing::Whole { step: 3.096 }).map(|s| s.layer.height).sum();
        assert!(laid > 100.0 && laid < 103.096);
    }
}
