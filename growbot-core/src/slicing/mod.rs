//! Slicing of a path into layers.
//!
//! *Exact* slicing divides a segment of length `S` and bend `beta` into `n` equal layers of height `S / n` and tilt
//! `beta / n`. `n` is the min number that keeps every layer within the robot's limits (`h <= min(nominal, R tilt_max,
//! h_max / (1 + r_t / R))`, to 1e-9 of the limit). The sum of the layers is the path.
//!
//! A helicoidal arc is sliced in the same way, and the angle of deposition changes from layer to layer (`helicoid.rs`).
//!
//! *Whole* slicing is that of the paper. A segment is divided into steps of one height, and the last step is laid
//! whole, so that the tip passes the end of the segment by up to a step. It serves to reproduce the paper's tables.

use core::iter::FusedIterator;

use heapless::Vec;

use crate::angle::wrap_positive;
use crate::layer::Layer;
use crate::path::Segment;
use crate::robot::Robot;

mod helicoid;

use helicoid::{EqualLayers, HelicoidLayers, MAX_TOGETHER};

/// Method of slicing a path into layers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Slicing {
    /// Divides each segment into equal layers that end exactly at the end of the segment.
    Exact,
    /// Divides each segment into whole steps of one height, whose number is rounded up, as in the paper.
    Whole {
        /// Height of a step, mm.
        step: f64,
    },
}

/// Fraction by which a layer may exceed a limit of the robot, so that rounding does not divide a segment of exactly `n`
/// layers into `n + 1`.
pub const LIMIT_SLACK: f64 = 1e-9;

/// Max number of times that a helicoidal arc is sliced again, into more layers, because one of its layers exceeds a
/// limit of the robot.
const MORE_LAYERS: u32 = 5;

/// A layer, and the segment of the path to which it belongs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlicedLayer {
    /// Index of the segment in the path, counted from 0.
    pub segment: usize,
    /// Alpha, height and tilt of the layer.
    pub layer: Layer,
}

/// Iterator over the layers of a path, in order.
#[derive(Debug, Clone)]
pub struct SlicedLayers<'a> {
    segments: &'a [Segment],
    robot: &'a Robot,
    slicing: Slicing,
    /// Index of the segment that is being sliced.
    segment: usize,
    /// Number of the remaining layers of the current segment. `cut` produces these layers.
    left: u64,
    cut: Slices<'a>,
    /// Roll of the tip relative to the path, radians, caused by the layers of helicoidal arcs.
    roll: f64,
    /// The first helicoidal arcs, sliced beforehand. Fitting their layers takes long, and every clone can use the
    /// result.
    fitted: Vec<PreslicedArc<'a>, MAX_FITTED>,
}

/// A helicoidal arc that has been sliced beforehand.
#[derive(Debug, Clone)]
struct PreslicedArc<'a> {
    /// Index of the first segment of the arc.
    segment: usize,
    count: u64,
    cut: Slices<'a>,
    /// Roll of the tip after the arc, radians.
    roll: f64,
}

/// Max number of helicoidal arcs that are sliced beforehand. A path from pose to pose has at most one.
const MAX_FITTED: usize = 1;

/// The sequence of the layers of one segment, or of several helicoidal segments.
#[derive(Debug, Clone)]
#[expect(clippy::large_enum_variant, reason = "there is no heap to put the larger one on")]
enum Slices<'a> {
    /// Equal layers. The value is one of them.
    Uniform(Layer),
    /// The layers of a helicoidal arc of this radius, mm.
    Helicoid(HelicoidLayers<'a>, f64),
}

impl Slices<'_> {
    /// Returns the roll of the tip relative to the path after all layers, radians.
    fn roll(&self, keep_alive: &mut dyn FnMut()) -> f64 {
        match self {
            Self::Uniform(_) => 0.0,
            Self::Helicoid(layers, _) => layers.roll(keep_alive),
        }
    }

    /// Returns the number of segments of the path that these layers cover.
    fn segments(&self) -> usize {
        match self {
            Self::Uniform(_) => 1,
            Self::Helicoid(layers, _) => layers.segments(),
        }
    }
}

/// Returns the layers that this robot lays for a path, in the order of the path. Heights are in mm, angles in radians.
/// ```
/// use growbot_core::{layer, path::Segment, slicing::{Slicing, layers}};
/// # let file = include_str!(concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/growbot-a.toml"));
/// # let robot = growbot_core::robot::Robot::new(toml::from_str(file).unwrap()).unwrap();
/// let path = [Segment::Arc { alpha: 1.0, bend: 0.5, length: 50.0 }];
/// assert_eq!(layers(&path, &robot, Slicing::Exact).count(), 65);
/// let heights: f64 = layers(&path, &robot, Slicing::Exact).map(|sliced| sliced.layer.height).sum();
/// assert!((heights - 50.0).abs() < 1e-12);
/// ```
pub fn layers<'a>(path: &'a [Segment], robot: &'a Robot, slicing: Slicing) -> SlicedLayers<'a> {
    layers_with_keep_alive(path, robot, slicing, &mut || ())
}

/// Like [`layers()`], but calls `keep_alive` for each layer so that a board can feed its watchdog. Fitting the layers
/// of a helicoidal arc takes seconds on a microcontroller.
pub fn layers_with_keep_alive<'a>(
    path: &'a [Segment],
    robot: &'a Robot,
    slicing: Slicing,
    keep_alive: &mut dyn FnMut(),
) -> SlicedLayers<'a> {
    let none = Slices::Uniform(Layer::default());
    let mut layers =
        SlicedLayers { segments: path, robot, slicing, segment: 0, left: 0, cut: none, roll: 0.0, fitted: Vec::new() };
    if slicing == Slicing::Exact {
        layers.preslice(keep_alive);
    }
    layers.slice_from(0);
    layers
}

/// Returns the smallest integer that is not below a number. (It uses `floor`, which the firmware's image contains
/// anyway.)
fn ceil(value: f64) -> f64 {
    -libm::floor(-value)
}

/// Returns the min number of equal layers into which a segment of this length must be divided so that no layer is
/// higher than the limit. Both are in mm.
fn min_count(length: f64, limit: f64) -> f64 {
    ceil(length / (limit * (1.0 + LIMIT_SLACK))).max(1.0)
}

/// Returns the number of layers of the first of these segments, and the layers. If the path begins with helicoidal
/// segments, returns the layers of all of them.
fn slice<'a>(
    segments: &'a [Segment],
    robot: &Robot,
    slicing: Slicing,
    keep_alive: &mut dyn FnMut(),
) -> (u64, Slices<'a>) {
    let Some(segment) = segments.first() else { return (0, Slices::Uniform(Layer::default())) };
    let length = segment.length();
    let limit = robot.max_mean_height(segment.curvature());
    let count = match slicing {
        Slicing::Exact => min_count(length, limit),
        Slicing::Whole { step } => ceil(length / step * (1.0 - LIMIT_SLACK)).max(1.0),
    };
    let height = match slicing {
        Slicing::Exact => length / count,
        Slicing::Whole { step } => step,
    };
    let alike = |alpha, tilt| Slices::Uniform(Layer { alpha, height, tilt });
    match (*segment, slicing) {
        (Segment::Arc { alpha, bend, .. }, Slicing::Exact) => (count as u64, alike(alpha, bend / count)),
        (Segment::Arc { alpha, .. }, Slicing::Whole { .. }) => {
            (count as u64, alike(alpha, segment.curvature() * height))
        }
        (Segment::Straight { .. }, _) => (count as u64, alike(0.0, 0.0)),
        (Segment::Helicoid { radius, .. }, Slicing::Exact) => {
            slice_helicoids(helicoids(segments, radius), robot, radius, keep_alive)
        }
        (Segment::Helicoid { radius, .. }, Slicing::Whole { .. }) => {
            let mut layers = Vec::new();
            let _ = layers.push(EqualLayers { tilt: height / radius, count: count as u32 });
            (
                count as u64,
                Slices::Helicoid(HelicoidLayers::steps(segments.get(..1).unwrap_or_default(), layers), radius),
            )
        }
    }
}

/// Returns the helicoidal segments of this radius at the beginning of `segments`, up to the number that are corrected
/// together.
fn helicoids(segments: &[Segment], radius: f64) -> &[Segment] {
    let is_like = |segment: &&Segment| matches!(segment, Segment::Helicoid { radius: other, .. } if *other == radius);
    let count = segments.iter().take(MAX_TOGETHER).take_while(is_like).count();
    segments.get(..count).unwrap_or_default()
}

fn slice_helicoids<'a>(
    segments: &'a [Segment],
    robot: &Robot,
    radius: f64,
    keep_alive: &mut dyn FnMut(),
) -> (u64, Slices<'a>) {
    let limit = robot.max_mean_height(1.0 / radius);
    let mut more = 0;
    loop {
        let mut equal = Vec::new();
        for segment in segments {
            let min_count = min_count(segment.length(), limit);
            let count = min_count + f64::from(more) * (1.0 + libm::floor(min_count / 400.0));
            // The list has space for all segments that are sliced together.
            let _ = equal.push(EqualLayers { tilt: segment.length() / radius / count, count: count as u32 });
        }
        let layers = HelicoidLayers::exact(segments, equal, keep_alive);
        let steepest = layers.steepest(radius, keep_alive);
        let fits = steepest.height <= limit * (1.0 + LIMIT_SLACK) && robot.check_layer(&steepest, LIMIT_SLACK).is_ok();
        if fits || more == MORE_LAYERS {
            return (layers.count(), Slices::Helicoid(layers, radius));
        }
        // The correction makes a layer exceed a limit slightly. With more layers, all are lower.
        more += 1;
    }
}

impl<'a> SlicedLayers<'a> {
    /// Slices the first helicoidal arcs of the path beforehand, up to [`MAX_FITTED`].
    fn preslice(&mut self, keep_alive: &mut dyn FnMut()) {
        let mut roll = 0.0;
        let mut segment = 0;
        while segment < self.segments.len() {
            let (count, cut) = self.cut_from(segment, keep_alive);
            let segments = cut.segments();
            if let Slices::Helicoid(..) = cut {
                roll += cut.roll(keep_alive);
                if self.fitted.push(PreslicedArc { segment, count, cut, roll }).is_err() {
                    return;
                }
            }
            segment += segments;
        }
    }

    fn fitted(&self, segment: usize) -> Option<&PreslicedArc<'a>> {
        self.fitted.iter().find(|fitted| fitted.segment == segment)
    }

    /// Slices the segment of this index, and the helicoidal segments that are sliced with it. Returns the number of
    /// layers, and the layers.
    fn cut_from(&self, segment: usize, keep_alive: &mut dyn FnMut()) -> (u64, Slices<'a>) {
        slice(self.segments.get(segment..).unwrap_or_default(), self.robot, self.slicing, keep_alive)
    }

    /// Continues the iteration with the layers of the segment of this index, and of the segments that are sliced with
    /// it.
    fn slice_from(&mut self, segment: usize) {
        self.segment = segment;
        (self.left, self.cut) = match self.fitted(segment) {
            Some(PreslicedArc { count, cut, .. }) => (*count, cut.clone()),
            None => self.cut_from(segment, &mut || ()),
        };
    }

    fn next_segment(&mut self) {
        let next = self.segment + self.cut.segments();
        self.roll = match self.fitted(self.segment) {
            Some(fitted) => fitted.roll,
            None if self.slicing == Slicing::Exact && next < self.segments.len() => {
                self.roll + self.cut.roll(&mut || ())
            }
            None => self.roll,
        };
        self.slice_from(next);
    }
}

impl Iterator for SlicedLayers<'_> {
    type Item = SlicedLayer;

    fn next(&mut self) -> Option<SlicedLayer> {
        if self.left == 0 {
            return None;
        }
        let (index, layer) = match &mut self.cut {
            Slices::Uniform(layer) => (0, *layer),
            Slices::Helicoid(layers, radius) => layers.next(*radius),
        };
        // In a layer without tilt, alpha has no meaning.
        let alpha = if layer.tilt > 0.0 { wrap_positive(layer.alpha - self.roll) } else { layer.alpha };
        let sliced = SlicedLayer { segment: self.segment + index, layer: Layer { alpha, ..layer } };
        self.left -= 1;
        if self.left == 0 {
            self.next_segment();
        }
        Some(sliced)
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        let mut all = self.left;
        let mut segment = self.segment + self.cut.segments();
        while segment < self.segments.len() {
            let (count, segments) = match self.fitted(segment) {
                Some(fitted) => (fitted.count, fitted.cut.segments()),
                None => {
                    let (count, cut) = self.cut_from(segment, &mut || ());
                    (count, cut.segments())
                }
            };
            all += count;
            segment += segments;
        }
        usize::try_from(all).map_or((usize::MAX, None), |exact| (exact, Some(exact)))
    }
}

impl FusedIterator for SlicedLayers<'_> {}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;
    use crate::helicoid::Helicoid;
    use crate::layer::grow;
    use crate::path::end;
    use crate::pose::Frame;
    use crate::testing::robot_a;

    fn segment() -> impl Strategy<Value = Segment> {
        prop_oneof![
            (0.0..6.2, 1e-9..6.2, 98.2..1e4).prop_map(|(alpha, bend, radius)| Segment::Arc {
                alpha,
                bend,
                length: bend * radius
            }),
            (1e-7..5e3).prop_map(|length| Segment::Straight { length }),
            helicoid(),
        ]
    }

    fn helicoid() -> impl Strategy<Value = Segment> {
        (0.0..6.2, -2.0..0.0, -1.0..1.0, -1.0..1.0, 0.1..1.0, 98.2..500.0, 0.01..7.0).prop_map(
            |(angle, exponent, x, y, along, radius, bend): (f64, f64, f64, f64, f64, f64, f64)| {
                let size = libm::pow(10.0, exponent);
                let (axis, side) = (
                    Vector3::new(libm::cos(angle), libm::sin(angle), 0.0),
                    Vector3::new(-libm::sin(angle), libm::cos(angle), 0.0),
                );
                let p = axis * along + side * x + Vector3::z() * y;
                Segment::Helicoid { curve: Helicoid { m0: axis * size, p }, radius, length: bend * radius }
            },
        )
    }

    proptest! {
        #[test]
        fn exact_layers_add_up_to_the_path_within_all_limits(segments in prop::collection::vec(segment(), 0..6)) {
            let robot = robot_a();
            let path = segments;
            let start = Frame::identity();
            let tip = grow(&start, layers(&path, &robot, Slicing::Exact).map(|sliced| sliced.layer));
            let target = end(&path, &start);
            prop_assert!((tip.translation.vector - target.translation.vector).norm() < 1e-6);
            let limits = robot.description().layer;
            for SlicedLayer { layer, .. } in layers(&path, &robot, Slicing::Exact) {
                prop_assert!(robot.check_layer(&layer, LIMIT_SLACK * 1.001).is_ok(), "{layer:?}");
                prop_assert!(layer.height <= limits.height_mm * (1.0 + 1.001 * LIMIT_SLACK));
            }
        }

        #[test]
        fn layer_count_is_minimal(length in 0.1..100.0) {
            let robot = robot_a();
            let path = [Segment::Straight { length }];
            let n = layers(&path, &robot, Slicing::Exact).count() as f64;
            prop_assert!(length / n <= 0.774 * (1.0 + 1e-8));
            prop_assert!(n == 1.0 || length / (n - 1.0) > 0.774);
        }

        #[test]
        fn size_hint_is_exact(segments in prop::collection::vec(segment(), 0..6)) {
            let robot = robot_a();
            let layers = layers(&segments, &robot, Slicing::Exact);
            prop_assert_eq!(layers.size_hint().0, layers.count());
        }
    }

    #[test]
    fn a_segment_of_whole_layers_gets_no_extra_layer() {
        let path = [Segment::Straight { length: 0.774 * 10.0 }];
        assert_eq!(layers(&path, &robot_a(), Slicing::Exact).count(), 10);
        assert_eq!(layers(&path, &robot_a(), Slicing::Whole { step: 0.774 }).count(), 10);
    }

    #[test]
    fn whole_steps_overshoot_by_less_than_one_step() {
        let path = [Segment::Arc { alpha: 0.0, bend: 1.0, length: 100.0 }];
        let laid: f64 = layers(&path, &robot_a(), Slicing::Whole { step: 3.096 }).map(|s| s.layer.height).sum();
        assert!(laid > 100.0 && laid < 103.096);
    }
}
