//! The rest of the path: pieces of constant curvature from the tip to the goal, bent so that they end there.
//!
//! What is planned again after a layer is hardly ever far from what was planned before it. So the pieces are corrected,
//! not found anew: of all corrections that lead to the goal, the one that strays least from the path as it was planned
//! (the least squares of curvature and length, by Gauss and Newton), with no curvature above the max. A path is planned
//! with a radius over R_min, and corrected down to it.

use heapless::Vec;
use nalgebra::{SMatrix, SVector, Vector2, Vector3};

use crate::kinematics::step;
use crate::path::Segment;
use crate::pose::{Frame, Pose, angle_between, tip_direction};
use crate::trigonometry;

/// Max pieces.
const MAX_PIECES: usize = 48;
/// A path is first cut into about this many pieces.
const FIRST_PIECES: f64 = 40.0;
/// Min pieces, as long as each is longer than a layer.
const MIN_PIECES: usize = 12;
/// Corrections in a row.
const ROUNDS: usize = 5;
/// How often one that leads away from the goal is halved.
const HALVINGS: usize = 4;
/// Steps of Newton's method in one of them.
const NEWTON_STEPS: usize = 20;
/// Position (mm) and direction (radians): three, and two.
const CONSTRAINTS: usize = 5;
/// A correction of less than this, in radii and radians, leaves no more than its square.
const NEARLY: f64 = 1e-3;
/// A goal is not met better than this at any cost: deviations by which missing it is weighed, radii and radians.
const UNWEIGHED: [f64; 2] = [2e-4, 1e-4];
/// How far a piece as long as a radius may stray: the deviation of its curvature, in curvatures of the radius, and of
/// its length, in radii.
const FREEDOM: [f64; 2] = [0.2, 0.2];

/// A piece of constant curvature.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Piece {
    /// Where the tip bends to, in its own frame, with the curvature as its length, 1/mm.
    curvature: Vector2<f64>,
    /// mm.
    length: f64,
    /// Both as they were planned.
    planned: (Vector2<f64>, f64),
}

impl Piece {
    fn new(curvature: Vector2<f64>, length: f64) -> Self {
        Self { curvature, length, planned: (curvature, length) }
    }

    /// Variances of curvature (1/mm^2) and length (mm^2) with which straying is weighed, by the scale's units.
    fn freedom(&self, radius: f64) -> (f64, f64) {
        let length = (self.planned.1 / radius).max(f64::MIN_POSITIVE);
        (FREEDOM[0] * FREEDOM[0] / (length * radius), FREEDOM[1] * FREEDOM[1] * length * radius)
    }

    /// The rest of it.
    fn without(self, length: f64) -> Self {
        let share = ((self.length - length) / self.length).max(0.0);
        Self { length: self.length * share, planned: (self.planned.0, self.planned.1 * share), ..self }
    }
}

/// How far from the goal a reference ends.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Miss {
    /// mm.
    pub distance: f64,
    /// Radians.
    pub angle: f64,
}

/// The rest of a path.
#[derive(Debug, Clone, PartialEq)]
pub struct Reference {
    pieces: Vec<Piece, MAX_PIECES>,
    /// Scale of lengths and curvatures, mm.
    radius: f64,
    /// The pull on its end that bends it as it is.
    pull: Constraint,
}

impl Reference {
    /// The reference that a path of up to [`MAX_SEGMENTS`](crate::path::MAX_SEGMENTS) segments is.
    pub fn along(path: &[Segment], radius: f64) -> Self {
        let bend: f64 = path.iter().map(Segment::bend).sum();
        let length: f64 = path.iter().map(Segment::length).sum();
        // A piece is as long as a share of all length, or as bent as a share of all bends.
        let share = |segment: &Segment| {
            let of_bend = if bend > 0.0 { segment.bend() / bend } else { 0.0 };
            let of_length = if length > 0.0 { segment.length() / length } else { 0.0 };
            0.7 * of_bend + 0.3 * of_length
        };
        let mut pieces = Vec::new();
        for segment in path {
            let count = libm::ceil(FIRST_PIECES * share(segment)).max(1.0);
            for index in 0..count as usize {
                let piece = piece_of(segment, index as f64 / count, (index + 1) as f64 / count);
                // A path that a planner puts together has at most 46.
                let _ = pieces.push(piece);
            }
        }
        Self { pieces, radius, pull: Constraint::zeros() }
    }

    /// mm.
    pub fn length(&self) -> f64 {
        self.pieces.iter().map(|piece| piece.length).sum()
    }

    /// Removes this length from the beginning of the reference.
    pub fn advance(&mut self, mut length: f64) {
        while let Some(first) = self.pieces.first_mut() {
            if first.length > length {
                *first = first.without(length);
                break;
            }
            length -= first.length;
            self.pieces.remove(0);
        }
    }

    /// The reference of a tip that is turned by `roll` about its direction of growth (radians, counter-clockwise).
    pub fn roll(&mut self, roll: f64) {
        if roll == 0.0 {
            return;
        }
        let (sine, cosine) = trigonometry::sin_cos(roll);
        let back = |v: Vector2<f64>| Vector2::new(cosine * v.x + sine * v.y, cosine * v.y - sine * v.x);
        for piece in &mut self.pieces {
            piece.curvature = back(piece.curvature);
            piece.planned.0 = back(piece.planned.0);
        }
    }

    /// `base_from_tip` at the end of the reference.
    pub fn end(&self, base_from_tip: &Frame) -> Frame {
        self.pieces.iter().fold(*base_from_tip, |base_from_tip, piece| {
            let alpha = libm::atan2(-piece.curvature.y, -piece.curvature.x);
            base_from_tip * step(alpha, piece.curvature.norm() * piece.length, piece.length)
        })
    }

    /// The mean curvature over the first stretch of this length.
    pub fn curvature_over(&self, stretch: f64) -> Vector2<f64> {
        let (mut left, mut turned) = (stretch, Vector2::zeros());
        for piece in &self.pieces {
            let length = piece.length.min(left);
            turned += piece.curvature * length;
            left -= length;
            if left <= 0.0 {
                break;
            }
        }
        let covered = stretch - left;
        if covered > 0.0 { turned / covered } else { turned }
    }

    /// Bends the reference so that it leads from the tip to the goal, with no piece bent tighter than `max_curvature`
    /// (1/mm). How far from the goal it ends then. Where only few pieces are left they are cut, down to about
    /// `resolution`, mm.
    pub fn correct(&mut self, base_from_tip: &Frame, goal: &Pose, max_curvature: f64, resolution: f64) -> Miss {
        self.refine(resolution);
        let mut linear = Linear::default();
        linear.set(self, base_from_tip, goal, max_curvature);
        for _ in 0..ROUNDS {
            let (before, error) = (self.clone(), linear.weighed_error());
            linear.pull(self);
            linear.set(self, base_from_tip, goal, max_curvature);
            for _ in 0..HALVINGS {
                if linear.weighed_error() <= error.max(1.0) {
                    break;
                }
                self.back_halfway(&before);
                linear.set(self, base_from_tip, goal, max_curvature);
            }
            // What cannot be reached is not reached in more rounds.
            if linear.error.norm() < NEARLY * NEARLY || linear.weighed_error() > 0.99 * error {
                break;
            }
        }
        linear.miss
    }

    /// Half of the way back to how the pieces were before.
    fn back_halfway(&mut self, before: &Self) {
        for (piece, before) in self.pieces.iter_mut().zip(&before.pieces) {
            piece.curvature = (piece.curvature + before.curvature) * 0.5;
            piece.length = 0.5 * (piece.length + before.length);
        }
        self.pull = (self.pull + before.pull) * 0.5;
    }

    /// Cuts the longest pieces while there are few.
    fn refine(&mut self, resolution: f64) {
        while self.pieces.len() < MIN_PIECES {
            let longest = self.pieces.iter().enumerate().max_by(|a, b| a.1.length.total_cmp(&b.1.length));
            let Some((index, piece)) = longest.map(|(index, piece)| (index, *piece)) else { break };
            if piece.length < 2.0 * resolution {
                break;
            }
            let half = piece.without(0.5 * piece.length);
            self.pieces[index] = half;
            if self.pieces.insert(index, half).is_err() {
                break;
            }
        }
    }
}

type Constraint = SVector<f64, CONSTRAINTS>;

/// How the end of a reference moves with its pieces.
#[derive(Default)]
struct Linear {
    /// From the end to the goal, in the end's frame: radii, and radians about its y and -x axes.
    error: Constraint,
    /// The same, had no piece strayed from what was planned.
    from_planned: Constraint,
    /// For each piece, from the last to the first.
    columns: Vec<Columns, MAX_PIECES>,
    miss: Miss,
}

/// How the end of a reference moves with a piece: by its curvature's x and y (1/mm) and its length (mm); and how far
/// that may stray.
struct Columns {
    by_curvature: [Constraint; 2],
    by_length: Constraint,
    /// Max curvature, 1/mm.
    max_curvature: f64,
    /// Variances: 1/mm^2 and mm^2.
    freedom: (f64, f64),
    planned: (Vector2<f64>, f64),
    /// No piece is made much longer or shorter at once: what is far from straight is not to be trusted.
    lengths: (f64, f64),
}

/// The dual at a pull: its value, slope and Hessian.
struct Dual {
    value: f64,
    slope: Constraint,
    hessian: SMatrix<f64, CONSTRAINTS, CONSTRAINTS>,
}

impl Columns {
    /// The curvature and the length that a pull gives the piece; and the curvature that it would have without a bound.
    fn give_way(&self, pull: &Constraint) -> (Vector2<f64>, f64, Vector2<f64>) {
        let [x, y] = self.by_curvature.map(|column| column.dot(pull));
        let wanted = self.planned.0 + Vector2::new(x, y) * self.freedom.0;
        let tightness = wanted.norm();
        let curvature = if tightness > self.max_curvature { wanted * (self.max_curvature / tightness) } else { wanted };
        let length = self.planned.1 + self.by_length.dot(pull) * self.freedom.1;
        (curvature, length.clamp(self.lengths.0, self.lengths.1), wanted)
    }

    fn add_to(&self, dual: &mut Dual, pull: &Constraint) {
        let (curvature, length, wanted) = self.give_way(pull);
        let [by_x, by_y] = &self.by_curvature;
        let (strayed, longer) = (curvature - self.planned.0, length - self.planned.1);
        let moved = by_x * strayed.x + by_y * strayed.y + self.by_length * longer;
        let cost = strayed.norm_squared() / self.freedom.0 + longer * longer / self.freedom.1;
        dual.value += moved.dot(pull) - 0.5 * cost;
        dual.slope += moved;
        let tightness = wanted.norm();
        if tightness > self.max_curvature {
            // Along the bound only, and the less the further it is pulled beyond.
            let across = (by_y * wanted.x - by_x * wanted.y) / tightness;
            dual.hessian += across * across.transpose() * (self.freedom.0 * self.max_curvature / tightness);
        } else {
            dual.hessian += (by_x * by_x.transpose() + by_y * by_y.transpose()) * self.freedom.0;
        }
        if self.lengths.0 < length && length < self.lengths.1 {
            dual.hessian += self.by_length * self.by_length.transpose() * self.freedom.1;
        }
    }
}

impl Linear {
    fn set(&mut self, reference: &Reference, base_from_tip: &Frame, goal: &Pose, max_curvature: f64) {
        let constraint = |moved: Vector3<f64>, turned: Vector3<f64>| {
            let moved = moved / reference.radius;
            Constraint::new(moved.x, moved.y, moved.z, turned.y, -turned.x)
        };
        // What turns about a point moves the end, which lies in the origin of its own frame.
        let turning = |axis: Vector3<f64>, end_from: &Frame| {
            let turned = end_from.rotation * axis;
            constraint(end_from.translation.vector.cross(&turned), turned)
        };
        // From the end backwards, in the end's frame.
        self.columns.clear();
        let mut from_planned = Constraint::zeros();
        let mut end_from_tip = Frame::identity();
        for piece in reference.pieces.iter().rev() {
            let longer = turning(Vector3::new(-piece.curvature.y, piece.curvature.x, 0.0), &end_from_tip);
            let by_length = longer + constraint(tip_direction(&end_from_tip), Vector3::zeros());
            let bend = piece.curvature.norm() * piece.length;
            let alpha = libm::atan2(-piece.curvature.y, -piece.curvature.x);
            let back = step(alpha, 0.5 * bend, 0.5 * piece.length).inverse();
            let end_from_middle = end_from_tip * back;
            end_from_tip = end_from_middle * back;
            let by_x = turning(Vector3::y() * piece.length, &end_from_middle);
            let by_y = turning(-Vector3::x() * piece.length, &end_from_middle);
            let strayed = piece.curvature - piece.planned.0;
            from_planned += by_x * strayed.x + by_y * strayed.y + by_length * (piece.length - piece.planned.1);
            let _ = self.columns.push(Columns {
                by_curvature: [by_x, by_y],
                by_length,
                max_curvature,
                freedom: piece.freedom(reference.radius),
                planned: piece.planned,
                lengths: (0.5 * piece.length, 2.0 * piece.length),
            });
        }
        let base_from_end = base_from_tip * end_from_tip.inverse();
        let to_goal = base_from_end.inverse_transform_point(&goal.position().into()).coords;
        let direction = base_from_end.inverse_transform_vector(&goal.direction());
        let angle = angle_between(&Vector3::z(), &direction);
        // Of a goal that lies behind, the sine says too little.
        let about = Vector3::z().cross(&direction).try_normalize(1e-12).unwrap_or_else(Vector3::zeros);
        let error = constraint(to_goal, about * angle);
        (self.error, self.from_planned) = (error, from_planned + error);
        self.miss = Miss { distance: to_goal.norm(), angle };
    }

    /// The error in units of what is not weighed.
    fn weighed_error(&self) -> f64 {
        self.error.component_div(&Constraint::from_fn(|row, _| UNWEIGHED[row / 3])).norm()
    }

    /// Moves the pieces to where they stray least, none of them bent too tightly, and lead to the goal as far as
    /// straight lines tell.
    ///
    /// The least squares have five constraints and a bound for each piece; so their dual has five unknowns and no
    /// bound, and is convex: a pull on the end of the reference, to which each piece gives way by itself as far as it
    /// can. Newton's method with Armijo's step rule finds it (Nocedal and Wright 2006, chapters 3 and 17).
    fn pull(&self, reference: &mut Reference) {
        let mut at = self.dual(&reference.pull);
        for _ in 0..NEWTON_STEPS {
            let Some(step) = at.hessian.cholesky().map(|cholesky| cholesky.solve(&at.slope)) else { break };
            let decrease = step.dot(&at.slope);
            let (mut share, mut next) = (1.0, self.dual(&(reference.pull - step)));
            while next.value > at.value - 1e-4 * share * decrease && share > 1e-3 {
                share *= 0.5;
                next = self.dual(&(reference.pull - step * share));
            }
            reference.pull -= step * share;
            at = next;
            if at.slope.norm() < NEARLY * NEARLY {
                break;
            }
        }
        for (piece, columns) in reference.pieces.iter_mut().rev().zip(&self.columns) {
            (piece.curvature, piece.length, _) = columns.give_way(&reference.pull);
        }
    }

    fn dual(&self, pull: &Constraint) -> Dual {
        let weight = Constraint::from_fn(|row, _| UNWEIGHED[row / 3] * UNWEIGHED[row / 3]);
        let held = weight.component_mul(pull);
        let mut dual = Dual {
            value: 0.5 * held.dot(pull) - self.from_planned.dot(pull),
            slope: held - self.from_planned,
            hessian: SMatrix::from_diagonal(&weight),
        };
        for columns in &self.columns {
            columns.add_to(&mut dual, pull);
        }
        dual
    }
}

/// A part of a segment, from one share of its length to another, as a piece.
fn piece_of(segment: &Segment, from: f64, to: f64) -> Piece {
    let length = segment.length() * (to - from);
    let curvature = match *segment {
        Segment::Straight { .. } => Vector2::zeros(),
        Segment::Arc { alpha, .. } => towards(alpha + core::f64::consts::PI) * segment.curvature(),
        Segment::Helicoid { curve, radius, length: whole } => {
            let start_from = |share: f64| curve.frame_after(share * whole / radius);
            let turned = start_from(from).rotation.inverse() * start_from(to).rotation;
            // Turned about (-y, x) of where it bends to.
            let axis = turned.scaled_axis();
            Vector2::new(axis.y, -axis.x) / length
        }
    };
    Piece::new(curvature, length)
}

fn towards(angle: f64) -> Vector2<f64> {
    let (sine, cosine) = trigonometry::sin_cos(angle);
    Vector2::new(cosine, sine)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::end;
    use crate::plan::{Planner, plan};
    use crate::random::Random;
    use crate::testing::robot_a;
    use std::vec::Vec as List;

    fn pose(random: &mut Random, distance: f64) -> Pose {
        let (position, direction) = (random.direction() * distance, random.direction());
        Pose::new(position, libm::atan2(direction.y, direction.x), libm::asin(direction.z)).unwrap()
    }

    /// Start, goal and path, at random; helicoidal arcs among the near ones.
    fn problems() -> List<(Pose, Pose, List<Segment>)> {
        let robot = robot_a();
        (0..40)
            .map(|seed| {
                let mut random = Random::new(&[seed]);
                let distance = if seed < 10 { 150.0 } else { random.between(400.0, 1500.0) };
                let (start, goal) = (pose(&mut random, 0.0), pose(&mut random, distance));
                let path = plan(&robot, &start, &goal, 100.0, Planner::Shortest).unwrap().path;
                (start, goal, path.to_vec())
            })
            .collect()
    }

    #[test]
    fn a_reference_is_the_path() {
        for (start, _, path) in problems() {
            let reference = Reference::along(&path, 100.0);
            let planned = end(&path, &start.frame());
            let helicoid = path.iter().any(|segment| matches!(segment, Segment::Helicoid { .. }));
            let off = (reference.end(&start.frame()).translation.vector - planned.translation.vector).norm();
            assert!(off < if helicoid { 1.0 } else { 1e-9 }, "{off} mm, {path:?}");
        }
    }

    #[test]
    fn a_tip_that_is_off_is_led_to_the_goal_within_the_greatest_curvature() {
        let max_curvature = 1.0 / 98.2;
        let mut missed = 0;
        for (seed, (start, goal, path)) in (0..).zip(problems()) {
            let mut random = Random::new(&[seed, 1]);
            let mut off = start.frame();
            off.translation.vector += random.normal_vector();
            off.rotation = super::super::estimator::rotation(&(random.normal_vector() * 0.01)) * off.rotation;
            let mut reference = Reference::along(&path, 100.0);
            let miss = reference.correct(&off, &goal, max_curvature, 0.774);
            assert!(reference.pieces.iter().all(|piece| piece.curvature.norm() <= max_curvature * (1.0 + 1e-12)));
            let end = reference.end(&off);
            assert!(((end.translation.vector - goal.position()).norm() - miss.distance).abs() < 1e-9);
            missed += u32::from(miss.distance > 0.1 || miss.angle > 0.002);
        }
        // Paths of three bends without a line have nothing to give.
        assert!(missed <= 4, "{missed} of 40");
    }

    #[test]
    fn what_cannot_be_reached_is_approached() {
        let path = [Segment::Straight { length: 10.0 }];
        let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
        let goal = Pose::from_degrees([5.0, 0.0, 10.0, 0.0, 90.0]).unwrap();
        let mut reference = Reference::along(&path, 100.0);
        let miss = reference.correct(&start.frame(), &goal, 0.01, 0.774);
        assert!((4.0..5.0).contains(&miss.distance) && miss.angle < 0.05, "{miss:?}");
        assert!((5.0..20.0).contains(&reference.length()));
    }

    #[test]
    fn advancing_removes_length_from_the_beginning() {
        let path = [Segment::Straight { length: 10.0 }, Segment::Arc { alpha: 0.0, bend: 0.5, length: 50.0 }];
        let mut reference = Reference::along(&path, 100.0);
        reference.advance(30.0);
        assert!((reference.length() - 30.0).abs() < 1e-12);
        assert!((reference.curvature_over(5.0).norm() - 0.01).abs() < 1e-15);
        reference.advance(100.0);
        assert_eq!(reference.length(), 0.0);
    }
}
