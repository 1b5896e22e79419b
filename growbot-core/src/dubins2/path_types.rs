//! The six path types, built from the centres of their circles.

use core::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use super::{PathType, PlanarPath, PlanarPose};

use crate::angle::wrap_positive;
use crate::trigonometry;

/// A path may end this far from the goal, radii, where that spares it a turn or makes it exist: some thousand times the
/// rounding of `f64` within some 60 radii.
const NEAR: f64 = 9e-13;
/// That beyond some 60 radii, as a share of the distance: the goal itself has fewer digits there.
const NEAR_AT_DISTANCE: f64 = 9e-13 / 64.0;
/// The tangent of pi/8, to three digits: it only chooses between two formulas that are both exact.
const TAN_PI_8: f64 = 0.414;

/// The goal as the path types see it.
pub(super) struct Goal {
    x: f64,
    y: f64,
    /// Between -pi and pi.
    heading: f64,
    sine: f64,
    /// 1 - cos(heading), to its last digit even for tiny headings.
    versine: f64,
}

impl Goal {
    #[cfg_attr(not(target_os = "none"), inline(always))]
    pub(super) fn new(pose: &PlanarPose) -> Self {
        let heading = if pose.heading.abs() > TAU { wrap_positive(pose.heading) } else { pose.heading };
        let heading = if heading > PI { heading - TAU } else { heading };
        let heading = if heading < -PI { heading + TAU } else { heading };
        // From a quarter of the heading: at most pi/4, so that neither function has to reduce it.
        let (sin_quarter, cos_quarter) = trigonometry::sin_cos_of_eighth(0.25 * heading);
        let sin_half = 2.0 * sin_quarter * cos_quarter;
        let cos_half = 1.0 - 2.0 * sin_quarter * sin_quarter;
        let (sine, versine) = (2.0 * sin_half * cos_half, 2.0 * sin_half * sin_half);
        Self { x: pose.x, y: pose.y, heading, sine, versine }
    }

    /// The path of an arc, a line and an arc of which neither arc is longer than pi, if there is one.
    ///
    /// No path is shorter than that: from the start and back from the goal, none turns faster into the direction of the
    /// line, so none advances further in it.
    #[cfg_attr(not(target_os = "none"), inline(always))]
    pub(super) fn by_short_arcs(&self) -> Option<PlanarPath> {
        let &Self { x, y, heading, sine, versine } = self;
        // How far to the left of the goal's axis the goal is from the start, as `y` is to the left of the start's.
        let y_at_goal = (y - x * sine) - y * versine;
        // Where path types meet, those with an outer tangent go first, as they do among all.
        let near = 2.0 * nearness(x.abs() + y.abs());
        let left = (y >= versine - near) & (y_at_goal <= near - versine);
        let right = (-y >= versine - near) & (y_at_goal >= versine - near);
        let outer = left | right;
        let leftwards = if outer { heading + TAU >= TAU } else { y + y_at_goal >= 0.0 };
        let to_left = if left == right { leftwards } else { left };
        let (path_type, lengths) = if outer {
            let tangent = self.tangent(to_left, true);
            let path_type = if to_left { PathType::Lsl } else { PathType::Rsr };
            if tangent.straight < nearness(tangent.straight) {
                return Some(PlanarPath { path_type, lengths: [0.0, 0.0, tangent.heading] });
            }
            (path_type, tangent.path())
        } else {
            let tangent = self.tangent(to_left, false);
            if !tangent.has_short_arcs(if to_left { sine } else { -sine }, versine) {
                return None;
            }
            (if to_left { PathType::Lsr } else { PathType::Rsl }, tangent.path())
        };
        let [first, middle, last] = lengths;
        // A single arc is as good as two halves of it.
        let short = (first <= PI) & (last <= PI) & (middle < f64::INFINITY) | outer & (middle == 0.0);
        if short { Some(PlanarPath { path_type, lengths }) } else { None }
    }

    /// For LSL, RSR, LSR, RSL. LRL and RLR are between the same circles as LSL and RSR.
    #[cfg_attr(not(target_os = "none"), inline(always))]
    pub(super) fn tangents(&self) -> [Tangent; 4] {
        [self.tangent(true, true), self.tangent(false, true), self.tangent(true, false), self.tangent(false, false)]
    }

    /// For path types that begin to the right the plane is mirrored, so that they begin to the left.
    #[cfg_attr(not(target_os = "none"), inline(always))]
    fn tangent(&self, to_left: bool, outer: bool) -> Tangent {
        let mirror = 2.0 * f64::from(u8::from(to_left)) - 1.0;
        let (side, twist) = if outer { (1.0, 0.0) } else { (-1.0, 2.0) };
        let x = self.x - side * mirror * self.sine;
        let y = mirror * self.y - side * self.versine;
        // Of the distance between the centres, (x, y - twist), less the square of the twist: without 4 - 4.
        let square = x * x - y * (2.0 * twist - y);
        let straight = libm::sqrt(if square < 0.0 { 0.0 } else { square });
        let y = y - twist;
        // Turned by the angle of (straight, twist).
        let (x, y) = if outer { (x, y) } else { (x * straight - twist * y, y * straight + twist * x) };
        Tangent { outer, x, y, square, straight, heading: wrap(mirror * self.heading) }
    }
}

/// The tangent from a circle of the start to one of the goal.
pub(super) struct Tangent {
    /// Which of the two: the outer one, of LSL, or the inner one, of LSR.
    pub(super) outer: bool,
    /// A vector in its direction.
    pub(super) x: f64,
    /// The other component of that.
    pub(super) y: f64,
    /// The square of its length: below 0 if there is no such tangent, or by rounding.
    pub(super) square: f64,
    /// Its length. For the outer one that is also the distance between the centres.
    pub(super) straight: f64,
    /// The goal's heading, in [0, 2 pi).
    pub(super) heading: f64,
}

/// The lengths of the pieces of one of [`PathType::ALL`]: infinite if there is no such path.
#[cfg_attr(not(target_os = "none"), inline(always))]
pub(super) fn lengths(tangents: &[Tangent; 4], path_type: PathType) -> [f64; 3] {
    let index = path_type as usize;
    let along = tangents[index & 3].path();
    if index < tangents.len() { along } else { three_arcs(along) }
}

impl Tangent {
    /// Whether LSR may have two arcs of at most pi, from sine and versine of the goal's heading.
    fn has_short_arcs(&self, sine: f64, versine: f64) -> bool {
        let &Self { x, y, .. } = self;
        (y >= 0.0) & ((y - x * sine) - y * versine >= 0.0)
    }

    /// LSL or LSR.
    ///
    /// The arcs of LSL come to the heading, or a turn more if the line's direction is not between those of start and
    /// goal. Where rounding may have put it there, it is turned back; the path then ends off the goal by as much as the
    /// line's end moves. The arcs of LSR need none of that: where one of them vanishes the path is a part of LSL or RSR.
    #[cfg_attr(not(target_os = "none"), inline(always))]
    fn path(&self) -> [f64; 3] {
        let &Self { outer, x, y, square, straight, heading } = self;
        if !outer {
            // Circles that overlap less than that touch.
            let straight = if square < -4.0 * NEAR { f64::INFINITY } else { straight };
            let first = direction(x, y);
            return [first, straight, wrap(first - heading)];
        }
        let near = nearness(straight);
        let straight = if straight < near { 0.0 } else { straight };
        let first = direction(x, y);
        let first = if (TAU - first) * straight < near { 0.0 } else { first };
        let last = heading - first;
        let back = if last < 0.0 { last } else { 0.0 };
        let back = if -back * straight < near { back } else { 0.0 };
        [first + back, straight, wrap(last - back)]
    }
}

/// LRL, between the same circles as LSL, if they are near enough. The middle arc is longer than pi: with a shorter one
/// it is never the shortest path.
///
/// The centres are a triangle with sides 4 cos(base), 2 and 2. Its angle `base` and a quarter turn are what the outer arcs
/// turn further than those of LSL.
fn three_arcs([first, distance, last]: [f64; 3]) -> [f64; 3] {
    let square = (4.0 - distance) * (4.0 + distance);
    // Circles that are apart less than that touch.
    if square < -8.0 * NEAR {
        return [f64::INFINITY; 3];
    }
    let height = libm::sqrt(if square < 0.0 { 0.0 } else { square });
    let further = FRAC_PI_2 + 2.0 * octant(height, 4.0 + distance);
    let turned = |angle: f64| {
        let angle = angle + further;
        if angle >= TAU { angle - TAU } else { angle }
    };
    [turned(first), 2.0 * further, turned(last)]
}

/// How far off, at a distance, still counts as there.
fn nearness(distance: f64) -> f64 {
    let far = NEAR_AT_DISTANCE * distance;
    if far > NEAR { far } else { NEAR }
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

/// The direction of a vector in [0, 2 pi): an arc tangent of two arguments without branches that depend on these.
#[cfg_attr(not(target_os = "none"), inline(always))]
fn direction(x: f64, y: f64) -> f64 {
    let (along, across) = (x.abs(), y.abs());
    let steep = across > along;
    let (less, more) = if steep { (along, across) } else { (across, along) };
    let (from, sign) = OCTANTS[usize::from(steep) | usize::from(x < 0.0) << 1 | usize::from(y < 0.0) << 2];
    let angle = from + sign * octant(less, more);
    if angle >= TAU { 0.0 } else { angle }
}

/// The arc tangent of `less / more`. A vector in the upper half of the octant is turned by an eighth of a turn, so that
/// the arc tangent's argument is small.
#[cfg_attr(not(target_os = "none"), inline(always))]
fn octant(less: f64, more: f64) -> f64 {
    let upper = f64::from(u8::from(less > TAN_PI_8 * more));
    let (less, more) = (less - upper * more, more + upper * less);
    // The zero vector has no direction; any will do.
    upper * FRAC_PI_4 + trigonometry::atan_of_sixteenth(less / (more + f64::MIN_POSITIVE))
}

/// Wraps an angle between -2 pi and 2 pi to [0, 2 pi).
fn wrap(angle: f64) -> f64 {
    let wrapped = if angle < 0.0 { angle + TAU } else { angle };
    if wrapped >= TAU { 0.0 } else { wrapped }
}
