//! The six path types, built from the centres of their circles.

use core::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use super::{PathType, PlanarPath, PlanarPose, TIE};

use crate::angle::wrap_positive;
use crate::trigonometry;

/// An angle this close below a full turn may be a rounding error of none, and circles this near each other may
/// coincide. The tests `..._have_no_extra_turn` bound it from below; what is tried in vain only costs time.
const NEAR_FULL_TURN: f64 = 1e-5;
/// Max error of a path at the goal, radii and radians, for goals within some 60 radii: some thousand times the
/// rounding of `f64`.
pub(super) const ARRIVED: f64 = 1e-12;
/// Max error beyond some 60 radii, as a share of the distance: the goal itself has fewer digits there.
pub(super) const ARRIVED_AT_DISTANCE: f64 = 1e-12 / 64.0;
/// A square below 0 by no more than this may be so by rounding. The path type is tried then, and taken if it ends
/// at the goal; the test `goals_at_the_edges_of_the_path_types_are_reached` bounds this.
const EDGE: f64 = 1e-9;
/// The tangent of pi/8, to three digits: it only chooses between two formulas that are both exact.
const TAN_PI_8: f64 = 0.414;

/// The goal as the path types see it.
///
/// Path types that begin to the right are seen in the mirrored plane, where they begin to the left.
pub(super) struct Goal<'a> {
    pose: &'a PlanarPose,
    /// For LSL, RSR, LSR, RSL. LRL and RLR are between the same circles as LSL and RSR.
    pub(super) tangents: [Tangent; 4],
}

/// The tangent from a circle of the start to one of the goal.
pub(super) struct Tangent {
    /// Which of the two tangents: 1 for the outer one, of LSL, -1 for the inner one, of LSR.
    pub(super) side: f64,
    /// A vector in its direction. For the outer one: from one centre to the other.
    pub(super) x: f64,
    /// The other component of that.
    pub(super) y: f64,
    /// The square of its length, before rounding below 0 is mended: if it is below 0 there is no such tangent.
    pub(super) square: f64,
    /// Its length. For the outer one that is also the distance between the centres.
    pub(super) straight: f64,
    /// The goal's heading, in [0, 2 pi).
    pub(super) heading: f64,
}

impl<'a> Goal<'a> {
    pub(super) fn new(pose: &'a PlanarPose) -> Self {
        let heading = if pose.heading.abs() > TAU { wrap_positive(pose.heading) } else { pose.heading };
        let heading = if heading > PI { heading - TAU } else { heading };
        let heading = if heading < -PI { heading + TAU } else { heading };
        // From a quarter of the heading: at most pi/4, so that neither function has to reduce it.
        let (sin_quarter, cos_quarter) = trigonometry::sin_cos(0.25 * heading);
        let sin_half = 2.0 * sin_quarter * cos_quarter;
        let cos_half = 1.0 - 2.0 * sin_quarter * sin_quarter;
        let sine = 2.0 * sin_half * cos_half;
        let versine = 2.0 * sin_half * sin_half; // 1 - cos(heading), to its last digit even for tiny headings
        let (left, right) = (wrap(heading), wrap(-heading));
        let tangents = [
            Tangent::outer(pose.x - sine, pose.y - versine, left),
            Tangent::outer(pose.x + sine, -pose.y - versine, right),
            Tangent::inner(pose.x + sine, pose.y + versine - 2.0, left),
            Tangent::inner(pose.x - sine, -pose.y + versine - 2.0, right),
        ];
        Self { pose, tangents }
    }

    /// The shortest of a path type and its parts, if there is one that leads to the goal.
    #[cfg_attr(not(target_os = "none"), inline(always))]
    pub(super) fn build(&self, path_type: PathType) -> Option<PlanarPath> {
        // In the order of the path types: after the four with a tangent come the two between the first two pairs of
        // circles.
        let index = path_type as usize;
        let between = &self.tangents[index & 3];
        let built = if index < 4 { between.straight() } else { between.three_arcs() };
        let path = PlanarPath { path_type, lengths: built.lengths };
        if built.doubtful { self.build_doubtful(path, between, built.square) } else { Some(path) }
    }

    /// [`Self::build`], where rounding may have added a turn, or a path type may seem to exist that does not.
    #[cold]
    fn build_doubtful(&self, path: PlanarPath, between: &Tangent, square: f64) -> Option<PlanarPath> {
        let [first, middle, last] = path.lengths;
        let mut shortest = Shortest { goal: self.pose, path_type: path.path_type, path: None };
        if matches!(path.path_type, PathType::Lsl | PathType::Rsr) && middle < NEAR_FULL_TURN {
            // The line between the centres has no direction, and one arc may make the whole turn.
            shortest.offer_if_it_arrives([0.0; 3]);
            shortest.offer_if_it_arrives([between.heading, 0.0, 0.0]);
        }
        // What an arc falls short of a full turn goes to the arc at the other end, so that the heading stays.
        let same_side = !matches!(path.path_type, PathType::Lsr | PathType::Rsl);
        let other = |angle: f64, dropped: f64| {
            let missing = TAU - dropped;
            (if same_side { angle - missing } else { angle + missing }).max(0.0)
        };
        let (drop_first, drop_last) = (first > TAU - NEAR_FULL_TURN, last > TAU - NEAR_FULL_TURN);
        if drop_first && drop_last {
            shortest.offer_if_it_arrives([0.0, middle, 0.0]);
        }
        if drop_first {
            shortest.offer_if_it_arrives([0.0, middle, other(last, first)]);
        }
        if drop_last {
            shortest.offer_if_it_arrives([other(first, last), middle, 0.0]);
        }
        if square >= 0.0 {
            shortest.offer(path.lengths);
        } else if square >= -EDGE {
            shortest.offer_if_it_arrives(path.lengths);
        }
        shortest.path
    }
}

/// What the formula of a path type gives.
struct Built {
    lengths: [f64; 3],
    /// Of the root: if it is below 0 there is no such path type, or rounding has put it there.
    square: f64,
    /// Whether rounding may be of consequence.
    doubtful: bool,
}

impl Tangent {
    /// The outer one of two circles, whose centres are (x, y) apart: parallel to the line between these.
    #[cfg_attr(not(target_os = "none"), inline(always))]
    fn outer(x: f64, y: f64, heading: f64) -> Self {
        let square = x * x + y * y;
        Self { side: 1.0, x, y, square, straight: libm::sqrt(square), heading }
    }

    /// The inner one: that line, turned by the angle of (straight, 2).
    #[cfg_attr(not(target_os = "none"), inline(always))]
    fn inner(x: f64, y: f64, heading: f64) -> Self {
        let square = x * x + y * y - 4.0;
        let straight = libm::sqrt(if square > 0.0 { square } else { 0.0 });
        Self { side: -1.0, x: x * straight - 2.0 * y, y: y * straight + 2.0 * x, square, straight, heading }
    }

    /// LSL or LSR.
    #[cfg_attr(not(target_os = "none"), inline(always))]
    fn straight(&self) -> Built {
        let first = direction(self.x, self.y);
        let last = wrap(self.side * (self.heading - first));
        let doubtful =
            (self.straight < NEAR_FULL_TURN) | (first > TAU - NEAR_FULL_TURN) | (last > TAU - NEAR_FULL_TURN);
        Built { lengths: [first, self.straight, last], square: self.square, doubtful }
    }

    /// LRL, if the circles are near enough. The middle arc is longer than pi: with a shorter one it is never the
    /// shortest path.
    ///
    /// The middle centre is 2 from both others. It lies in the direction of the line between them, turned by the angle
    /// `base` of (distance, height); the first arc ends a quarter turn further.
    fn three_arcs(&self) -> Built {
        let &Self { x, y, heading, straight: distance, .. } = self;
        let square = (4.0 - distance) * (4.0 + distance);
        let height = libm::sqrt(if square > 0.0 { square } else { 0.0 });
        let base = direction(distance, height);
        let first = direction(-(x * height + y * distance), x * distance - y * height);
        let last = wrap(wrap(heading - first) + (2.0 * base - PI));
        let doubtful = (square < 0.0) | (first > TAU - NEAR_FULL_TURN) | (last > TAU - NEAR_FULL_TURN);
        Built { lengths: [first, PI + 2.0 * base, last], square, doubtful }
    }
}

/// For a vector that is steep (1), points backwards (2), points downwards (4): from where its angle counts, and which
/// way.
const OCTANTS: [(f64, f64); 8] = [
    (0.0, 1.0),
    (FRAC_PI_2, -1.0),
    (PI, -1.0),
    (FRAC_PI_2, 1.0),
    (TAU, -1.0),
    (PI + FRAC_PI_2, 1.0),
    (PI, 1.0),
    (PI + FRAC_PI_2, -1.0),
];

/// The direction of a vector in [0, 2 pi).
///
/// This is an arc tangent of two arguments without branches that depend on these: a vector in the upper half of an
/// octant is turned by an eighth of a turn, so that `atan` always gets an argument that it need not reduce.
#[cfg_attr(not(target_os = "none"), inline(always))]
fn direction(x: f64, y: f64) -> f64 {
    let (along, across) = (x.abs(), y.abs());
    let steep = across > along;
    let (less, more) = if steep { (along, across) } else { (across, along) };
    let upper = if less > TAN_PI_8 * more { 1.0 } else { 0.0 };
    let (less, more) = (less - upper * more, more + upper * less);
    // The zero vector has no direction; any will do.
    let octant = upper * FRAC_PI_4 + libm::atan(if more > 0.0 { less / more } else { 0.0 });
    let (from, sign) = OCTANTS[usize::from(steep) | usize::from(x < 0.0) << 1 | usize::from(y < 0.0) << 2];
    let angle = from + sign * octant;
    if angle >= TAU { 0.0 } else { angle }
}

/// Wraps an angle between -2 pi and 2 pi to [0, 2 pi).
fn wrap(angle: f64) -> f64 {
    let wrapped = if angle < 0.0 { angle + TAU } else { angle };
    if wrapped >= TAU { 0.0 } else { wrapped }
}

/// The shortest so far of a path type and its parts.
struct Shortest<'a> {
    goal: &'a PlanarPose,
    path_type: PathType,
    path: Option<PlanarPath>,
}

impl Shortest<'_> {
    /// Integrating it forwards is what costs, so that comes last.
    fn offer_if_it_arrives(&mut self, lengths: [f64; 3]) {
        let path = PlanarPath { path_type: self.path_type, lengths };
        let tolerance = || ARRIVED.max(ARRIVED_AT_DISTANCE * trigonometry::hypot(self.goal.x, self.goal.y));
        if self.is_shorter(&path) && path.miss(self.goal) <= tolerance() {
            self.path = Some(path);
        }
    }

    fn offer(&mut self, lengths: [f64; 3]) {
        let path = PlanarPath { path_type: self.path_type, lengths };
        if self.is_shorter(&path) {
            self.path = Some(path);
        }
    }

    fn is_shorter(&self, path: &PlanarPath) -> bool {
        self.path.is_none_or(|shortest| path.length() < shortest.length() - TIE)
    }
}
