//! The reference trajectory: the rest of the path as segments of constant curvature, bent so that they end at the goal.
//!
//! The path after a layer differs little from the path before it, so the segments are corrected and not searched for
//! again. Many corrections lead to the goal with no curvature above the max. The code selects the one with the smallest
//! deviation from the planned path: least squares of curvature and length, by the Gauss-Newton method. A path is
//! planned with a radius larger than R_min. Its correction may use radii down to R_min.

use heapless::Vec;
use nalgebra::{SMatrix, SVector, Vector2, Vector3};

use crate::kinematics::step;
use crate::path::Segment;
use crate::plan::GoalError;
use crate::pose::{Frame, Pose, angle_between, tip_direction};
use crate::trigonometry;

/// Max number of segments of a reference trajectory.
const MAX_PIECES: usize = 48;
/// Approximate number of segments of a new reference trajectory, before any of it has been laid.
const FIRST_PIECES: f64 = 40.0;
/// Number of segments below which the segments of a reference trajectory are divided, as long as they are longer than a
/// layer.
const MIN_PIECES: usize = 12;
/// Max number of Gauss-Newton steps for one correction.
const ROUNDS: usize = 5;
/// Max number of times that a step which increases the error is halved.
const HALVINGS: usize = 4;
/// Max number of steps of Newton's method on the dual, for one Gauss-Newton step.
const NEWTON_STEPS: usize = 20;
/// Number of constraints on the end of the path: three for its position, two for its direction.
const CONSTRAINTS: usize = 5;
/// Size of a correction, in radii and radians, that counts as small. After a smaller one, the error that remains is
/// about the square of the correction.
const NEARLY: f64 = 1e-3;
/// Standard deviations of position (radii) and direction (radians) that weight an error at the goal. Errors that are
/// smaller than these cause hardly any curvature.
const GOAL_DEVIATION: [f64; 2] = [2e-4, 1e-4];
/// Standard deviations that weight the deviation of a segment, one radius long, from the plan: of its curvature, in
/// inverse radii, and of its length, in radii.
const PIECE_DEVIATION: [f64; 2] = [0.2, 0.2];

/// The shape of a segment.
#[derive(Debug, Clone, Copy, PartialEq)]
struct PieceShape {
    /// Curvature as a vector, 1/mm. It points in the direction in which the tip bends, in the tip's frame.
    curvature: Vector2<f64>,
    /// Length, mm.
    length: f64,
}

/// Variances that weight the deviation of a segment from its planned shape.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Variances {
    /// Variance of the deviation of the curvature, 1/mm^2.
    curvature: f64,
    /// Variance of the deviation of the length, mm^2.
    length: f64,
}

/// A segment of constant curvature.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Piece {
    /// Curvature as a vector, 1/mm. It points in the direction in which the tip bends, in the tip's frame.
    curvature: Vector2<f64>,
    /// Length, mm.
    length: f64,
    /// Shape of the segment as planned, without corrections.
    planned: PieceShape,
}

impl Piece {
    fn new(curvature: Vector2<f64>, length: f64) -> Self {
        Self { curvature, length, planned: PieceShape { curvature, length } }
    }

    /// Returns the variances that weight the deviations of this segment from its planned shape. `radius` is the scale
    /// of lengths, mm.
    ///
    /// If the rest of the path is longer than necessary, the correction compresses it. Beyond a limit it buckles like a
    /// rod, because a bow costs less than shorter segments. With equal deviations of curvature and length, in radii,
    /// this limit is `4 pi^2 / L` for a rest of `L` radii, far beyond any excess length that occurs.
    fn variances(&self, radius: f64) -> Variances {
        let length = (self.planned.length / radius).max(f64::MIN_POSITIVE);
        let [curvature, along] = [PIECE_DEVIATION[0] / radius, PIECE_DEVIATION[1] * radius];
        Variances { curvature: curvature * curvature / length, length: along * along * length }
    }

    /// Returns the rest of the segment after its first `length` mm.
    fn without(self, length: f64) -> Self {
        let share = ((self.length - length) / self.length).max(0.0);
        let planned = PieceShape { length: self.planned.length * share, ..self.planned };
        Self { length: self.length * share, planned, ..self }
    }
}

/// The rest of a path as a reference trajectory.
#[derive(Debug, Clone, PartialEq)]
pub struct ReferenceTrajectory {
    pieces: Vec<Piece, MAX_PIECES>,
    /// Scale of lengths and curvatures, mm.
    radius: f64,
    /// Dual variables of the latest correction. They act like a force at the path's end that bends the segments to
    /// their present shapes.
    multipliers: Constraint,
}

impl ReferenceTrajectory {
    /// Creates the reference trajectory of a path of up to [`MAX_SEGMENTS`](crate::path::MAX_SEGMENTS) segments.
    /// `radius` is the scale of lengths, mm.
    pub fn from_path(path: &[Segment], radius: f64) -> Self {
        let bend: f64 = path.iter().map(Segment::bend).sum();
        let length: f64 = path.iter().map(Segment::length).sum();
        // The fraction of the reference segments that a segment of the path gets, by its fractions of the bends and of
        // the length.
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
                // A path of a planner has at most 46 segments here.
                let _ = pieces.push(piece);
            }
        }
        Self { pieces, radius, multipliers: Constraint::zeros() }
    }

    /// Returns the length of the reference trajectory, mm.
    pub fn length(&self) -> f64 {
        self.pieces.iter().map(|piece| piece.length).sum()
    }

    /// Removes the first `length` mm of the reference trajectory.
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

    /// Changes the segments for a tip that is turned by `roll` about its direction of growth (radians,
    /// counter-clockwise), so that the curve in space stays the same.
    pub fn roll(&mut self, roll: f64) {
        if roll == 0.0 {
            return;
        }
        let (sine, cosine) = trigonometry::sin_cos(roll);
        let back = |v: Vector2<f64>| Vector2::new(cosine * v.x + sine * v.y, cosine * v.y - sine * v.x);
        for piece in &mut self.pieces {
            piece.curvature = back(piece.curvature);
            piece.planned.curvature = back(piece.planned.curvature);
        }
    }

    /// Returns the frame of the tip at the end of the reference trajectory, if it begins at this `base_from_tip`.
    pub fn end(&self, base_from_tip: &Frame) -> Frame {
        self.pieces.iter().fold(*base_from_tip, |base_from_tip, piece| {
            let alpha = libm::atan2(-piece.curvature.y, -piece.curvature.x);
            base_from_tip * step(alpha, piece.curvature.norm() * piece.length, piece.length)
        })
    }

    /// Returns the mean of the curvature vector over the first `stretch` mm of the reference trajectory, 1/mm.
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

    /// Bends the reference trajectory so that it leads from the tip to the goal, with no curvature above
    /// `max_curvature` (1/mm), and returns the error at the goal that remains. If few segments remain they are divided,
    /// down to a length of about `resolution` mm.
    pub fn correct(&mut self, base_from_tip: &Frame, goal: &Pose, max_curvature: f64, resolution: f64) -> GoalError {
        self.refine(resolution);
        let mut linear = Linear::default();
        linear.set(self, base_from_tip, goal, max_curvature);
        for _ in 0..ROUNDS {
            let (before, error) = (self.clone(), linear.weighted_error());
            linear.pull(self);
            linear.set(self, base_from_tip, goal, max_curvature);
            for _ in 0..HALVINGS {
                if linear.weighted_error() <= error.max(1.0) {
                    break;
                }
                self.back_halfway(&before);
                linear.set(self, base_from_tip, goal, max_curvature);
            }
            // Further Gauss-Newton steps would not reach a goal that is out of reach.
            if linear.error.norm() < NEARLY * NEARLY || linear.weighted_error() > 0.99 * error {
                break;
            }
        }
        linear.miss
    }

    /// Reverses half of the latest Gauss-Newton step. `before` is the trajectory before this step.
    fn back_halfway(&mut self, before: &Self) {
        for (piece, before) in self.pieces.iter_mut().zip(&before.pieces) {
            piece.curvature = (piece.curvature + before.curvature) * 0.5;
            piece.length = 0.5 * (piece.length + before.length);
        }
        self.multipliers = (self.multipliers + before.multipliers) * 0.5;
    }

    /// Divides the longest segments until there are at least [`MIN_PIECES`] segments, if they are long enough.
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

/// The end of a reference trajectory, linearised in the shapes of its segments.
#[derive(Default)]
struct Linear {
    /// Error of the end at the goal, in the frame of the end: position in radii, and angles about the y and the -x axis
    /// in radians.
    error: Constraint,
    /// Error at the goal that the linearisation predicts if all segments have their planned shapes.
    from_planned: Constraint,
    /// Derivatives of the end with respect to the shape of each segment, and the segment's limits, from the last
    /// segment to the first.
    columns: Vec<Columns, MAX_PIECES>,
    miss: GoalError,
}

/// Derivatives of the end with respect to one segment, and the limits of the segment.
struct Columns {
    /// Derivatives of the end with respect to the x and the y component of the curvature (1/mm).
    by_curvature: [Constraint; 2],
    /// Derivative of the end with respect to the length (mm).
    by_length: Constraint,
    /// Max curvature of the segment, 1/mm.
    max_curvature: f64,
    /// Variances that weight the deviation from the planned shape.
    variances: Variances,
    /// Shape of the segment as planned, without corrections.
    planned: PieceShape,
    /// Min length of the segment after one step, mm. The linearisation is valid for small steps only.
    min_length: f64,
    /// Max length of the segment after one step, mm.
    max_length: f64,
}

/// The dual function of the least-squares problem, at given multipliers: its value, slope and Hessian.
struct Dual {
    value: f64,
    slope: Constraint,
    hessian: SMatrix<f64, CONSTRAINTS, CONSTRAINTS>,
}

impl Columns {
    /// Returns the shape of the segment for the multipliers `pull`, and the curvature (1/mm) that it would have without
    /// the bound.
    fn give_way(&self, pull: &Constraint) -> (PieceShape, Vector2<f64>) {
        let [x, y] = self.by_curvature.map(|column| column.dot(pull));
        let unbounded = self.planned.curvature + Vector2::new(x, y) * self.variances.curvature;
        let tightness = unbounded.norm();
        let is_bounded = tightness > self.max_curvature;
        let curvature = if is_bounded { unbounded * (self.max_curvature / tightness) } else { unbounded };
        let length = self.planned.length + self.by_length.dot(pull) * self.variances.length;
        (PieceShape { curvature, length: length.clamp(self.min_length, self.max_length) }, unbounded)
    }

    /// Adds the contribution of this segment to the dual.
    fn add_to(&self, dual: &mut Dual, pull: &Constraint) {
        let (PieceShape { curvature, length }, unbounded) = self.give_way(pull);
        let [by_x, by_y] = &self.by_curvature;
        let (strayed, longer) = (curvature - self.planned.curvature, length - self.planned.length);
        let moved = by_x * strayed.x + by_y * strayed.y + self.by_length * longer;
        let cost = strayed.norm_squared() / self.variances.curvature + longer * longer / self.variances.length;
        dual.value += moved.dot(pull) - 0.5 * cost;
        dual.slope += moved;
        let tightness = unbounded.norm();
        if tightness > self.max_curvature {
            // A curvature at its bound changes only along the bound. The further the unbounded curvature exceeds the
            // bound, the smaller this change is.
            let across = (by_y * unbounded.x - by_x * unbounded.y) / tightness;
            dual.hessian += across * across.transpose() * (self.variances.curvature * self.max_curvature / tightness);
        } else {
            dual.hessian += (by_x * by_x.transpose() + by_y * by_y.transpose()) * self.variances.curvature;
        }
        if self.min_length < length && length < self.max_length {
            dual.hessian += self.by_length * self.by_length.transpose() * self.variances.length;
        }
    }
}

impl Linear {
    /// Computes the error of the end of `reference` at `goal`, and the derivatives of the end with respect to the
    /// curvature and the length of each segment.
    fn set(&mut self, reference: &ReferenceTrajectory, base_from_tip: &Frame, goal: &Pose, max_curvature: f64) {
        let constraint = |moved: Vector3<f64>, turned: Vector3<f64>| {
            let moved = moved / reference.radius;
            Constraint::new(moved.x, moved.y, moved.z, turned.y, -turned.x)
        };
        // A turn about a point moves the end, which is in the origin of its own frame.
        let turning = |axis: Vector3<f64>, end_from: &Frame| {
            let turned = end_from.rotation * axis;
            constraint(end_from.translation.vector.cross(&turned), turned)
        };
        // The loop goes from the last segment to the first, in the frame of the path's end.
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
            let strayed = piece.curvature - piece.planned.curvature;
            from_planned += by_x * strayed.x + by_y * strayed.y + by_length * (piece.length - piece.planned.length);
            let _ = self.columns.push(Columns {
                by_curvature: [by_x, by_y],
                by_length,
                max_curvature,
                variances: piece.variances(reference.radius),
                planned: piece.planned,
                min_length: 0.5 * piece.length,
                max_length: 2.0 * piece.length,
            });
        }
        let base_from_end = base_from_tip * end_from_tip.inverse();
        let to_goal = base_from_end.inverse_transform_point(&goal.position().into()).coords;
        let direction = base_from_end.inverse_transform_vector(&goal.direction());
        let angle = angle_between(&Vector3::z(), &direction);
        // For a goal behind the end the sine is too small, so the angle is the error.
        let about = Vector3::z().cross(&direction).try_normalize(1e-12).unwrap_or_else(Vector3::zeros);
        let error = constraint(to_goal, about * angle);
        (self.error, self.from_planned) = (error, from_planned + error);
        self.miss = GoalError { distance: to_goal.norm(), angle };
    }

    /// Returns the norm of the error at the goal in units of [`GOAL_DEVIATION`].
    fn weighted_error(&self) -> f64 {
        self.error.component_div(&Constraint::from_fn(|row, _| GOAL_DEVIATION[row / 3])).norm()
    }

    /// Makes one Gauss-Newton step. It gives the segments the shapes that deviate least from the plan, respect the
    /// bounds and lead to the goal in the linearised problem.
    ///
    /// The least-squares problem has five constraints, and a bound for each segment. Its dual is convex, with five
    /// unknowns and no bound. The unknowns are a pull on the end of the reference trajectory, to which each segment
    /// responds independently. Newton's method with Armijo's step rule finds the pull (Nocedal and Wright 2006,
    /// chapters 3 and 17).
    fn pull(&self, reference: &mut ReferenceTrajectory) {
        let mut at = self.dual(&reference.multipliers);
        for _ in 0..NEWTON_STEPS {
            let step = at.hessian.cholesky().map(|cholesky| cholesky.solve(&at.slope));
            let Some(step) = step.filter(|step| step.norm().is_finite()) else { break };
            let decrease = step.dot(&at.slope);
            let (mut share, mut next) = (1.0, self.dual(&(reference.multipliers - step)));
            while next.value > at.value - 1e-4 * share * decrease && share > 1e-3 {
                share *= 0.5;
                next = self.dual(&(reference.multipliers - step * share));
            }
            if !next.value.is_finite() {
                break;
            }
            reference.multipliers -= step * share;
            at = next;
            if at.slope.norm() < NEARLY * NEARLY {
                break;
            }
        }
        for (piece, columns) in reference.pieces.iter_mut().rev().zip(&self.columns) {
            (PieceShape { curvature: piece.curvature, length: piece.length }, _) =
                columns.give_way(&reference.multipliers);
        }
    }

    /// Returns value, gradient and Hessian of the dual function at the multipliers `pull`.
    fn dual(&self, pull: &Constraint) -> Dual {
        let weight = Constraint::from_fn(|row, _| GOAL_DEVIATION[row / 3] * GOAL_DEVIATION[row / 3]);
        let weighted = weight.component_mul(pull);
        let mut dual = Dual {
            value: 0.5 * weighted.dot(pull) - self.from_planned.dot(pull),
            slope: weighted - self.from_planned,
            hessian: SMatrix::from_diagonal(&weight),
        };
        for columns in &self.columns {
            columns.add_to(&mut dual, pull);
        }
        dual
    }
}

/// Returns the segment of a reference trajectory for a part of a segment of the path. `from` and `to` are fractions of
/// the length of the path's segment.
fn piece_of(segment: &Segment, from: f64, to: f64) -> Piece {
    let length = segment.length() * (to - from);
    let curvature = match *segment {
        Segment::Straight { .. } => Vector2::zeros(),
        Segment::Arc { alpha, .. } => towards(alpha + core::f64::consts::PI) * segment.curvature(),
        Segment::Helicoid { curve, radius, length: whole } => {
            let start_from = |share: f64| curve.frame_after(share * whole / radius);
            let turned = start_from(from).rotation.inverse() * start_from(to).rotation;
            // The axis of the turn is (-y, x) of the direction in which the segment bends.
            let axis = turned.scaled_axis();
            Vector2::new(axis.y, -axis.x) / length
        }
    };
    Piece::new(curvature, length)
}

/// Returns the unit vector in the direction of this angle, radians.
fn towards(angle: f64) -> Vector2<f64> {
    let (sine, cosine) = trigonometry::sin_cos(angle);
    Vector2::new(cosine, sine)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::end;
    use crate::plan::{Planner, plan};
    use crate::random::Rng;
    use crate::testing::robot_a;
    use std::vec::Vec as List;

    fn pose(random: &mut Rng, distance: f64) -> Pose {
        let (position, direction) = (random.direction() * distance, random.direction());
        Pose::new(position, libm::atan2(direction.y, direction.x), libm::asin(direction.z)).unwrap()
    }

    /// Returns random starts, goals and paths, with helicoidal arcs among the close goals.
    fn problems() -> List<(Pose, Pose, List<Segment>)> {
        let robot = robot_a();
        (0..40)
            .map(|seed| {
                let mut random = Rng::new(&[seed]);
                let distance = if seed < 10 { 150.0 } else { random.uniform_between(400.0, 1500.0) };
                let (start, goal) = (pose(&mut random, 0.0), pose(&mut random, distance));
                let path = plan(&robot, &start, &goal, 100.0, Planner::Shortest).unwrap().path;
                (start, goal, path.to_vec())
            })
            .collect()
    }

    #[test]
    fn a_reference_follows_the_path() {
        for (start, _, path) in problems() {
            let reference = ReferenceTrajectory::from_path(&path, 100.0);
            let planned = end(&path, &start.frame());
            let helicoid = path.iter().any(|segment| matches!(segment, Segment::Helicoid { .. }));
            let off = (reference.end(&start.frame()).translation.vector - planned.translation.vector).norm();
            assert!(off < if helicoid { 1.0 } else { 1e-9 }, "{off} mm, {path:?}");
        }
    }

    #[test]
    fn a_deviating_tip_is_corrected_within_the_max_curvature() {
        let max_curvature = 1.0 / 98.2;
        let mut missed = 0;
        for (seed, (start, goal, path)) in (0..).zip(problems()) {
            let mut random = Rng::new(&[seed, 1]);
            let mut off = start.frame();
            off.translation.vector += random.normal_vector();
            off.rotation = super::super::estimator::rotation(&(random.normal_vector() * 0.01)) * off.rotation;
            let mut reference = ReferenceTrajectory::from_path(&path, 100.0);
            let miss = reference.correct(&off, &goal, max_curvature, 0.774);
            assert!(reference.pieces.iter().all(|piece| piece.curvature.norm() <= max_curvature * (1.0 + 1e-12)));
            let end = reference.end(&off);
            assert!(((end.translation.vector - goal.position()).norm() - miss.distance).abs() < 1e-9);
            missed += u32::from(miss.distance > 0.1 || miss.angle > 0.002);
        }
        // Paths of three bends without a line allow no correction.
        assert!(missed <= 4, "{missed} of 40");
    }

    #[test]
    fn paths_up_to_a_kilometre_are_corrected_and_longer_ones_stay_finite() {
        for length in [1e3, 1e4, 1e5, 2e5, 1e6, 1e7] {
            let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
            let goal = Pose::from_degrees([0.0, 0.0, length, 0.0, 90.0]).unwrap();
            let mut random = Rng::new(&[7]);
            let mut reference = ReferenceTrajectory::from_path(&[Segment::Straight { length }], 100.0);
            for _ in 0..50 {
                let mut off = start.frame();
                off.translation.vector += random.normal_vector() * 3.0;
                off.rotation = super::super::estimator::rotation(&(random.normal_vector() * 0.01)) * off.rotation;
                let miss = reference.correct(&off, &goal, 0.01, 0.774);
                assert!(reference.length().is_finite(), "{length} mm: {miss:?}");
                // Poses may be up to 10 km apart, but the five numbers of the dual have too few digits for that.
                assert!(length > 1e6 || miss.distance < 1e-3 * length, "{length} mm: {miss:?}");
            }
        }
    }

    #[test]
    fn an_unreachable_goal_is_approached() {
        let path = [Segment::Straight { length: 10.0 }];
        let start = Pose::from_degrees([0.0, 0.0, 0.0, 0.0, 90.0]).unwrap();
        let goal = Pose::from_degrees([5.0, 0.0, 10.0, 0.0, 90.0]).unwrap();
        let mut reference = ReferenceTrajectory::from_path(&path, 100.0);
        let miss = reference.correct(&start.frame(), &goal, 0.01, 0.774);
        assert!((4.0..5.0).contains(&miss.distance) && miss.angle < 0.05, "{miss:?}");
        assert!((5.0..20.0).contains(&reference.length()));
    }

    #[test]
    fn advancing_removes_length_from_the_start() {
        let path = [Segment::Straight { length: 10.0 }, Segment::Arc { alpha: 0.0, bend: 0.5, length: 50.0 }];
        let mut reference = ReferenceTrajectory::from_path(&path, 100.0);
        reference.advance(30.0);
        assert!((reference.length() - 30.0).abs() < 1e-12);
        assert!((reference.curvature_over(5.0).norm() - 0.01).abs() < 1e-15);
        reference.advance(100.0);
        assert_eq!(reference.length(), 0.0);
    }
}
