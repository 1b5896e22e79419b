//! The shortest path in a plane between two poses, of curvature at most 1 (Dubins 1957).
//!
//! Lengths are in units of the turning radius; the start is at the origin with heading 0; left is counter-clockwise.
//! A shortest path is one of six words, LSL, RSR, LSR, RSL, LRL, RLR, or a part of one (S, C, SC, CS, CC): a part is a
//! word with angles or lengths of 0.
//!
//! Each word is built from the centres of its circles (Shkel and Lumelsky 2001 classify the same words by their angles).
//! Square roots and arc cosines of values that rounding put past their edge are taken at the edge: there, the lengths
//! that follow are stationary, and the path still ends at the goal.
//!
//! What classic implementations get wrong is handled explicitly: where an angle is a rounding error short of a full turn,
//! or two circles coincide and the line between their centres has no direction, the word without that turn is tried and
//! taken if it ends at the goal.

use core::f64::consts::{FRAC_PI_2, PI, TAU};

use crate::angle::wrap_positive;

/// A pose in the plane: x, y in radii, heading in radians.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarPose {
    /// Forwards from the start, radii.
    pub x: f64,
    /// To the left of the start, radii.
    pub y: f64,
    /// Counter-clockwise from the start's, radians.
    pub heading: f64,
}

/// Which way a piece of a planar path goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// An arc, counter-clockwise.
    Left,
    /// An arc, clockwise.
    Right,
    /// A straight line.
    Straight,
}

use Direction::{Left, Right, Straight};

/// One of the six words.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Word {
    /// Left, straight, left.
    Lsl,
    /// Right, straight, right.
    Rsr,
    /// Left, straight, right.
    Lsr,
    /// Right, straight, left.
    Rsl,
    /// Left, right, left.
    Lrl,
    /// Right, left, right.
    Rlr,
}

impl Word {
    /// All words, in the order in which ties are decided.
    pub const ALL: [Self; 6] = [Self::Lsl, Self::Rsr, Self::Lsr, Self::Rsl, Self::Lrl, Self::Rlr];

    /// The three pieces.
    #[must_use]
    pub fn directions(self) -> [Direction; 3] {
        match self {
            Self::Lsl => [Left, Straight, Left],
            Self::Rsr => [Right, Straight, Right],
            Self::Lsr => [Left, Straight, Right],
            Self::Rsl => [Right, Straight, Left],
            Self::Lrl => [Left, Right, Left],
            Self::Rlr => [Right, Left, Right],
        }
    }
}

/// A path of one word. Pieces may have no length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarPath {
    /// The word.
    pub word: Word,
    /// Length of each piece, radii; for an arc that is its angle.
    pub lengths: [f64; 3],
}

impl PlanarPath {
    /// Length of the whole path, radii.
    #[must_use]
    pub fn length(&self) -> f64 {
        self.lengths.iter().sum()
    }

    /// The pieces that have a length, in order.
    pub fn pieces(&self) -> impl Iterator<Item = (Direction, f64)> + use<> {
        self.word.directions().into_iter().zip(self.lengths).filter(|(_, length)| *length > 0.0)
    }

    /// Where the path ends: the forward integration by which every doubtful word is checked.
    #[must_use]
    pub fn end(&self) -> PlanarPose {
        let mut at = PlanarPose { x: 0.0, y: 0.0, heading: 0.0 };
        for (direction, length) in self.pieces() {
            let (sin_before, cos_before) = libm::sincos(at.heading);
            match direction {
                Straight => {
                    at.x += length * cos_before;
                    at.y += length * sin_before;
                }
                Left | Right => {
                    let side = if direction == Left { 1.0 } else { -1.0 };
                    at.heading += side * length;
                    let (sin_after, cos_after) = libm::sincos(at.heading);
                    at.x += side * (sin_after - sin_before);
                    at.y -= side * (cos_after - cos_before);
                }
            }
        }
        at
    }

    /// How far from the goal the path ends: the larger of distance (radii) and angle (radians).
    #[must_use]
    pub fn miss(&self, goal: &PlanarPose) -> f64 {
        let end = self.end();
        let turned = wrap_positive(end.heading - goal.heading);
        libm::hypot(end.x - goal.x, end.y - goal.y).max(turned.min(TAU - turned))
    }
}

/// An angle this close below a full turn may be a rounding error of none.
const NEAR_FULL_TURN: f64 = 1e-5;
/// A path arrives if it ends this close to the goal, in radii and radians, for goals within some 60 radii...
const ARRIVED: f64 = 1e-12;
/// ...and beyond that, where the goal itself has fewer digits, in proportion.
const ARRIVED_AT_DISTANCE: f64 = 1e-12 / 64.0;
/// A word must be shorter than the best so far by this to replace it, so that ties fall the same way everywhere.
const TIE: f64 = 1e-12;

/// The shortest path to a goal.
///
/// ```
/// use growbot_core::dubins2::{PlanarPose, Word, shortest};
/// let path = shortest(&PlanarPose { x: 10.0, y: 0.0, heading: 0.0 });
/// assert_eq!(path.length(), 10.0);
/// let behind = shortest(&PlanarPose { x: -1.0, y: 0.0, heading: 0.0 });
/// assert!(matches!(behind.word, Word::Lrl | Word::Rlr | Word::Lsl | Word::Rsr));
/// ```
#[must_use]
pub fn shortest(goal: &PlanarPose) -> PlanarPath {
    let goal = &PlanarPose { heading: wrap_positive(goal.heading), ..*goal };
    let (sin_half, cos_half) = libm::sincos(0.5 * goal.heading);
    let sine = 2.0 * sin_half * cos_half;
    let versine = 2.0 * sin_half * sin_half; // 1 - cos(heading), to its last digit even for tiny headings
    // From the start's left (right) centre to the goal's left (right) centre.
    let left_left = Offset::new(goal.x - sine, goal.y - versine);
    let right_right = Offset::new(goal.x + sine, goal.y + versine);
    let left_right = Offset::new(goal.x + sine, goal.y + versine - 2.0);
    let right_left = Offset::new(goal.x - sine, goal.y - versine + 2.0);

    let mut best = Best { goal, path: None };
    best.consider(outer(Word::Lsl, &left_left, goal.heading));
    best.consider(outer(Word::Rsr, &right_right, goal.heading));
    best.consider_some(inner(Word::Lsr, &left_right, goal.heading));
    best.consider_some(inner(Word::Rsl, &right_left, goal.heading));
    best.consider_some(three_arcs(Word::Lrl, &left_left, goal.heading));
    best.consider_some(three_arcs(Word::Rlr, &right_right, goal.heading));
    // LSL always exists, so there is always a path; it also stands in where nothing was considered.
    best.path.unwrap_or_else(|| outer(Word::Lsl, &left_left, goal.heading))
}

/// From one centre to another.
struct Offset {
    distance: f64,
    direction: f64,
}

impl Offset {
    fn new(x: f64, y: f64) -> Self {
        Self { distance: libm::sqrt(x * x + y * y), direction: libm::atan2(y, x) }
    }
}

/// LSL and RSR: along the outer tangent, parallel to the line between the centres.
fn outer(word: Word, centres: &Offset, heading: f64) -> PlanarPath {
    let side = if word == Word::Lsl { 1.0 } else { -1.0 };
    let first = wrap_positive(side * centres.direction);
    let last = wrap_positive(side * (heading - centres.direction));
    PlanarPath { word, lengths: [first, centres.distance, last] }
}

/// LSR and RSL: along the inner tangent, if the circles do not overlap.
fn inner(word: Word, centres: &Offset, heading: f64) -> Option<PlanarPath> {
    let straight_squared = centres.distance * centres.distance - 4.0;
    if straight_squared < -1e-9 {
        return None;
    }
    let straight = libm::sqrt(straight_squared.max(0.0));
    let side = if word == Word::Lsr { 1.0 } else { -1.0 };
    let along = centres.direction + side * libm::atan2(2.0, straight);
    Some(PlanarPath { word, lengths: [wrap_positive(side * along), straight, wrap_positive(side * (along - heading))] })
}

/// LRL and RLR, if the outer circles are near enough. The middle arc is longer than pi: with a shorter one it is never the shortest path.
fn three_arcs(word: Word, centres: &Offset, heading: f64) -> Option<PlanarPath> {
    let quarter = 0.25 * centres.distance;
    if quarter > 1.0 + 1e-9 {
        return None;
    }
    let base = libm::acos(quarter.min(1.0));
    let side = if word == Word::Lrl { 1.0 } else { -1.0 };
    // In the mirrored plane (for RLR) everything reads as for LRL: the middle centre lies at `direction + base`.
    let to_middle = side * centres.direction + base;
    let from_middle = side * centres.direction + PI - base;
    let first = wrap_positive(to_middle + FRAC_PI_2);
    let last = wrap_positive(side * heading - from_middle - FRAC_PI_2);
    Some(PlanarPath { word, lengths: [first, PI + 2.0 * base, last] })
}

/// The path without the arc at one end (index 0 or 2), which is a rounding error short of a full turn: what the arc falls
/// short of a full turn goes to the other end, so that the heading stays.
fn without_turn(path: PlanarPath, end: usize) -> PlanarPath {
    let other = 2 - end;
    let mut lengths = path.lengths;
    let missing = TAU - lengths[end];
    lengths[end] = 0.0;
    let same_side = path.word.directions()[0] == path.word.directions()[2];
    lengths[other] = (if same_side { lengths[other] - missing } else { lengths[other] + missing }).max(0.0);
    PlanarPath { lengths, ..path }
}

/// The best path so far.
struct Best<'a> {
    goal: &'a PlanarPose,
    path: Option<PlanarPath>,
}

impl Best<'_> {
    fn consider_some(&mut self, path: Option<PlanarPath>) {
        if let Some(path) = path {
            self.consider(path);
        }
    }

    /// Takes a path if it is shorter, and its forms without turns that may be rounding errors if they arrive.
    fn consider(&mut self, path: PlanarPath) {
        let [first, middle, last] = path.lengths;
        let straight = path.word.directions()[1] == Straight;
        if straight && middle < NEAR_FULL_TURN {
            // Coinciding circles: the line between the centres has no direction, and one arc may make the whole turn.
            let whole =
                wrap_positive(if matches!(path.word, Word::Lsl | Word::Rsr) { first + last } else { first - last });
            self.take_if_it_arrives(PlanarPath { lengths: [whole, 0.0, 0.0], ..path });
            self.take_if_it_arrives(PlanarPath { lengths: [0.0; 3], ..path });
        }
        let full = |angle: f64| angle > TAU - NEAR_FULL_TURN;
        if full(first) {
            self.take_if_it_arrives(without_turn(path, 0));
        }
        if full(last) {
            self.take_if_it_arrives(without_turn(path, 2));
        }
        if full(first) && full(last) {
            self.take_if_it_arrives(PlanarPath { lengths: [0.0, middle, 0.0], ..path });
        }
        if !straight && full(middle) {
            let whole = wrap_positive(first + last);
            self.take_if_it_arrives(PlanarPath { lengths: [whole, 0.0, 0.0], ..path });
            self.take_if_it_arrives(PlanarPath { lengths: [0.0; 3], ..path });
        }
        self.take(path);
    }

    fn take_if_it_arrives(&mut self, path: PlanarPath) {
        let tolerance = ARRIVED.max(ARRIVED_AT_DISTANCE * libm::hypot(self.goal.x, self.goal.y));
        if path.miss(self.goal) <= tolerance {
            self.take(path);
        }
    }

    fn take(&mut self, path: PlanarPath) {
        if self.path.is_none_or(|best| path.length() < best.length() - TIE) {
            self.path = Some(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A path laid out by hand, and where it ends.
    fn laid(word: Word, lengths: [f64; 3]) -> (PlanarPose, f64) {
        let path = PlanarPath { word, lengths };
        (path.end(), path.length())
    }

    fn assert_arrives(goal: &PlanarPose) -> PlanarPath {
        let path = shortest(goal);
        assert!(
            path.miss(goal) < 1e-12 * (1.0 + libm::hypot(goal.x, goal.y)),
            "{goal:?}: {path:?} misses by {}",
            path.miss(goal)
        );
        path
    }

    fn word() -> impl Strategy<Value = Word> {
        (0_usize..6).prop_map(|i| Word::ALL[i])
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(20_000))]

        #[test]
        fn every_goal_is_reached(x in -40.0..40.0, y in -40.0..40.0, heading in -7.0..7.0) {
            assert_arrives(&PlanarPose { x, y, heading });
        }

        #[test]
        fn no_path_is_longer_than_one_laid_out_by_hand(
            word in word(),
            first in 0.0..TAU,
            middle in 0.0..TAU,
            last in 0.0..TAU,
        ) {
            let (goal, length) = laid(word, [first, middle, last]);
            prop_assert!(assert_arrives(&goal).length() <= length + 1e-9);
        }

        #[test]
        fn pure_arcs_have_no_extra_turn(angle in 0.0..TAU, left in any::<bool>()) {
            let (goal, length) = laid(if left { Word::Lsl } else { Word::Rsr }, [angle, 0.0, 0.0]);
            prop_assert!(assert_arrives(&goal).length() <= length + 1e-9);
        }

        #[test]
        fn tangent_arcs_have_no_extra_turn(first in 0.0..TAU, last in 0.0..TAU, left in any::<bool>()) {
            let (goal, length) = laid(if left { Word::Lsr } else { Word::Rsl }, [first, 0.0, last]);
            prop_assert!(assert_arrives(&goal).length() <= length + 1e-9);
        }

        #[test]
        fn an_arc_and_a_line_have_no_extra_turn(angle in 0.0..TAU, line in 0.0..40.0, left in any::<bool>(), arc_first in any::<bool>()) {
            let lengths = if arc_first { [angle, line, 0.0] } else { [0.0, line, angle] };
            let (goal, length) = laid(if left { Word::Lsl } else { Word::Rsr }, lengths);
            prop_assert!(assert_arrives(&goal).length() <= length + 1e-9);
        }

        #[test]
        fn tiny_steps_are_tiny(exponent in -12.0..-3.0, share in 0.0..1.0, word in word()) {
            let size = libm::pow(10.0, exponent);
            let (goal, length) = laid(word, [size * share, size * (1.0 - share), size * share * share]);
            prop_assert!(assert_arrives(&goal).length() <= length + 1e-9);
        }
    }

    #[test]
    fn start_is_goal() {
        for heading in [0.0, TAU, -TAU, -1e-17] {
            assert_eq!(shortest(&PlanarPose { x: 0.0, y: 0.0, heading }).length(), 0.0);
        }
    }

    #[test]
    fn turning_round_on_the_spot_takes_three_arcs() {
        let path = assert_arrives(&PlanarPose { x: 0.0, y: 0.0, heading: PI });
        // pi/3 + 5 pi/3 + pi/3: the classic turn about.
        assert!((path.length() - 7.0 * PI / 3.0).abs() < 1e-12, "{path:?}");
    }

    #[test]
    fn goals_at_the_edges_of_the_words_are_reached() {
        for distance in [2.0, 4.0, 4.0 - 1e-16, 4.0 + 1e-15, 2.0 - 1e-13, 1e-300] {
            for heading in [0.0, PI, FRAC_PI_2, -FRAC_PI_2] {
                for angle in [0.0, FRAC_PI_2, PI, 1.0] {
                    let (y, x) = libm::sincos(angle);
                    assert_arrives(&PlanarPose { x: distance * x, y: distance * y, heading });
                }
            }
        }
    }
}
