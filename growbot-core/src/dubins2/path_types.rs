//! The six path types, built from the centres of their circles.

use core::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use super::planar_path::{PathType, PlanarPath, PlanarPose};
use crate::angle::wrap_positive;
use crate::trigonometry;

/// Max error at the goal, radii, that a path may have in order to avoid a full turn that rounding has caused, or in
/// order to exist at all. It is some thousand times the rounding of `f64` within some 60 radii.
const NEAR: f64 = 9e-13;
/// Max error at goals beyond some 60 radii, as a fraction of their distance, in place of [`NEAR`]. It grows with the
/// distance because the goal itself has fewer digits there.
const NEAR_AT_DISTANCE: f64 = 9e-13 / 64.0;
/// The tangent of pi/8, to three digits. It only selects one of two formulas that are both exact.
const TAN_PI_8: f64 = 0.414;

/// The goal, in the form that the path types use.
pub(super) struct PlanarGoal {
    x: f64,
    y: f64,
    /// Heading of the goal, between -pi and pi, radians.
    heading: f64,
    sine: f64,
    /// 1 - cos(heading), exact to the last digit even for tiny headings.
    versine: f64,
}

impl PlanarGoal {
    #[cfg_attr(not(target_os = "none"), inline(always))]
    pub(super) fn new(pose: &PlanarPose) -> Self {
        let heading = if pose.heading.abs() > TAU { wrap_positive(pose.heading) } else { pose.heading };
        let heading = if heading > PI { heading - TAU } else { heading };
        let heading = if heading < -PI { heading + TAU } else { heading };
        // The functions get a quarter of the heading. It is at most pi/4, so neither function has to reduce its
        // argument.
        let (sin_quarter, cos_quarter) = trigonometry::sin_cos_of_eighth(0.25 * heading);
        let sin_half = 2.0 * sin_quarter * cos_quarter;
        let cos_half = 1.0 - 2.0 * sin_quarter * sin_quarter;
        let (sine, versine) = (2.0 * sin_half * cos_half, 2.0 * sin_half * sin_half);
        Self { x: pose.x, y: pose.y, heading, sine, versine }
    }

    /// Returns the path of an arc, a line and an arc of which neither arc is longer than pi. `None` if such a path does
    /// not exist.
    ///
    /// If such a path exists, no path is shorter. From the start, and backwards from the goal, no path turns faster
    /// into the direction of the line, so no path advances further in that direction.
    #[cfg_attr(not(target_os = "none"), inline(always))]
    pub(super) fn by_short_arcs(&self) -> Option<PlanarPath> {
        let &Self { x, y, heading, sine, versine } = self;
        // The distance of the goal from the start, measured to the left of the goal's axis. `y` is the same distance to
        // the left of the start's axis.
        let y_at_goal = (y - x * sine) - y * versine;
        // At the border between path types, those with an outer tangent have priority, as in the search over all path
        // types.
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
        // A single arc counts as two halves of the arc.
        let short = (first <= PI) & (last <= PI) & (middle < f64::INFINITY) | outer & (middle == 0.0);
        if short { Some(PlanarPath { path_type, lengths }) } else { None }
    }

    /// Returns the tangents of LSL, RSR, LSR and RSL. The circles of LRL and RLR are those of LSL and RSR.
    #[cfg_attr(not(target_os = "none"), inline(always))]
    pub(super) fn tangents(&self) -> [Tangent; 4] {
        [self.tangent(true, true), self.tangent(false, true), self.tangent(true, false), self.tangent(false, false)]
    }

    /// Returns the tangent of one path type: LSL, RSR, LSR or RSL. For path types that begin to the right the plane is
    /// mirrored, so that they begin to the left.
    #[cfg_attr(not(target_os = "none"), inline(always))]
    fn tangent(&self, to_left: bool, outer: bool) -> Tangent {
        let mirror = 2.0 * f64::from(u8::from(to_left)) - 1.0;
        let (side, twist) = if outer { (1.0, 0.0) } else { (-1.0, 2.0) };
        let x = self.x - side * mirror * self.sine;
        let y = mirror * self.y - side * self.versine;
        // Square of the distance between the centres, (x, y - twist), minus the square of the twist, written without 4
        // - 4.
        let square = x * x - y * (2.0 * twist - y);
        let straight = libm::sqrt(if square < 0.0 { 0.0 } else { square });
        let y = y - twist;
        // The vector is rotated by the angle of (straight, twist).
        let (x, y) = if outer { (x, y) } else { (x * straight - twist * y, y * straight + twist * x) };
        Tangent { outer, x, y, square, straight, heading: wrap(mirror * self.heading) }
    }
}

/// A tangent from a circle of the start to a circle of the goal. If the path type begins to the right, the plane is
/// mirrored. Lengths are in radii.
pub(super) struct Tangent {
    /// True for the outer tangent, the line of LSL. False for the inner tangent, the line of LSR.
    pub(super) outer: bool,
    /// x component of a vector in the direction of the tangent.
    pub(super) x: f64,
    /// y component of the vector in the direction of the tangent.
    pub(super) y: f64,
    /// Square of the tangent's length. It is below 0 if the tangent does not exist, or by rounding.
    pub(super) square: f64,
    /// Length of the tangent. For the outer tangent it is also the distance between the centres.
    pub(super) straight: f64,
    /// The goal's heading, in [0, 2 pi).
    pub(super) heading: f64,
}

/// Returns the lengths of the three segments of a path type, radii. They are infinite if a path of this type does not
/// exist.
#[cfg_attr(not(target_os = "none"), inline(always))]
pub(super) fn lengths(tangents: &[Tangent; 4], path_type: PathType) -> [f64; 3] {
    let index = path_type as usize;
    let along = tangents[index & 3].path();
    if index < tangents.len() { along } else { three_arcs(along) }
}

impl Tangent {
    /// Reports whether the path LSR of this tangent may have two arcs of at most pi. The arguments are the sine and the
    /// versine of the goal's heading.
    fn has_short_arcs(&self, sine: f64, versine: f64) -> bool {
        let &Self { x, y, .. } = self;
        (y >= 0.0) & ((y - x * sine) - y * versine >= 0.0)
    }

    /// Returns the lengths of the segments of LSL or LSR, radii.
    ///
    /// The arcs of LSL add up to the heading, or to a turn more if the line's direction is not between those of start
    /// and goal. If rounding may have caused the extra turn, the line is turned back. The error of the path at the goal
    /// is then the distance by which the line's end moves. The arcs of LSR need no such correction: if one of them
    /// vanishes, the path is a part of LSL or RSR.
    #[cfg_attr(not(target_os = "none"), inline(always))]
    fn path(&self) -> [f64; 3] {
        let &Self { outer, x, y, square, straight, heading } = self;
        if !outer {
            // Circles that overlap by less than this count as touching.
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

/// Returns the lengths of the segments of LRL from those of LSL, because its first and its last circle are the same.
/// The lengths are infinite if the circles are too far apart. The middle arc is longer than pi, because with a shorter
/// one LRL is never the shortest path.
///
/// The centres form a triangle with sides 4 cos(base), 2 and 2. Each outer arc turns further than that of LSL, by the
/// triangle's angle `base` plus a quarter turn.
fn three_arcs([first, distance, last]: [f64; 3]) -> [f64; 3] {
    let square = (4.0 - distance) * (4.0 + distance);
    // Circles that are apart by less than this count as touching.
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

/// Returns the max error (radii) with which a goal at this distance (radii) still counts as reached.
fn nearness(distance: f64) -> f64 {
    let far = NEAR_AT_DISTANCE * distance;
    if far > NEAR { far } else { NEAR }
}

/// Base angle and sign for each octant of a vector. The index is the sum of 1 if the vector is steep, 2 if it points
/// backwards and 4 if it points downwards. The angle in the octant is added to the base angle with this sign.
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

/// Returns the direction of a vector in [0, 2 pi), by an arc tangent of two arguments without branches that depend on
/// them.
#[cfg_attr(not(target_os = "none"), inline(always))]
fn direction(x: f64, y: f64) -> f64 {
    let (along, across) = (x.abs(), y.abs());
    let steep = across > along;
    let (less, more) = if steep { (along, across) } else { (across, along) };
    let (from, sign) = OCTANTS[usize::from(steep) | usize::from(x < 0.0) << 1 | usize::from(y < 0.0) << 2];
    let angle = from + sign * octant(less, more);
    if angle >= TAU { 0.0 } else { angle }
}

/// Returns the arc tangent of `less / more`. A vector in the upper half of the octant is rotated by an eighth of a
/// turn, so that the argument of the arc tangent is small.
#[cfg_attr(not(target_os = "none"), inline(always))]
fn octant(less: f64, more: f64) -> f64 {
    let upper = f64::from(u8::from(less > TAN_PI_8 * more));
    let (less, more) = (less - upper * more, more + upper * less);
    // The zero vector has no direction, so any value will do.
    upper * FRAC_PI_4 + trigonometry::atan_of_sixteenth(less / (more + f64::MIN_POSITIVE))
}

/// Wraps an angle between -2 pi and 2 pi to [0, 2 pi), radians.
fn wrap(angle: f64) -> f64 {
    let wrapped = if angle < 0.0 { angle + TAU } else { angle };
    if wrapped >= TAU { 0.0 } else { wrapped }
}
