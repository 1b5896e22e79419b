//! Arcs with narrow necks. Such an arc follows its helicoidal curve near the necks, and circles between them.
//!
//! Away from a narrow neck the curve is nearly a circle, but its course is sensitive. A tip that comes from far away
//! passes the neck in a direction that depends on the last digits of its start. So the arc follows the curve only near
//! a narrow neck. Elsewhere it follows the circles that touch the curve. The length increases by less than 1e-6 radii,
//! because the plane of the bend would turn by only 0.003 radians more and the excess is of second order.
//!
//! If `p` has a large component along `m`, the neck is long, but the curve is not sensitive, because the bend reverses.

use core::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, Vector3};

use super::closed_form::{ClosedFormCurve, CurvePoint, Nodes};
use crate::float::PortableFloat;

/// First of two terms whose sum is `|m|` at the end of a neck, as a multiple of the min of `|m|`. The second term is
/// [`TWISTED`].
const NARROW: f64 = 300.0;
/// Second of two terms whose sum is `|m|` at the end of a neck, as a multiple of the square of the component of `p`
/// along `m` at the neck. The first term is [`NARROW`].
const TWISTED: f64 = 32.0;

/// A point of an arc, in the axes of the arc's curve. Lengths are in radii.
#[derive(Debug, Clone, Copy)]
pub(super) struct HybridPoint<T: PortableFloat> {
    pub(super) position: Vector3<T>,
    pub(super) direction: Vector3<T>,
    /// The axis about which the tip turns, of any length.
    pub(super) axis: Vector3<T>,
    /// Length along the arc from the neck, radii.
    pub(super) length: T,
    /// Derivative of the length with respect to the phase, radii per radian.
    pub(super) rate: T,
}

impl<T: PortableFloat> HybridPoint<T> {
    pub(super) fn of(point: &CurvePoint<T>) -> Self {
        let CurvePoint { length, rate, .. } = *point;
        Self { position: point.position(), direction: point.direction(), axis: point.axis(), length, rate }
    }

    /// Returns the axis about which the tip turns, as a unit vector.
    pub(super) fn unit_axis(&self) -> Vector3<T> {
        self.axis / self.axis.norm_squared().root().max(T::literal(1e-30))
    }

    /// Returns the point after this length (radii) of the circle that touches the arc here. The length may be negative.
    fn on_circle(&self, length: T, rate: T) -> Self {
        let (sin, cos) = length.sine_cosine();
        let half = (T::literal(0.5) * length).sine_cosine().0;
        let beside = self.unit_axis().cross(&self.direction);
        Self {
            position: self.position + self.direction * sin + beside * (T::literal(2.0) * half * half),
            direction: self.direction * cos + beside * sin,
            axis: self.axis,
            length: self.length + length,
            rate,
        }
    }

    /// Returns three unit vectors as the columns of a matrix: the axis about which the tip turns, the direction of
    /// growth, and the vector perpendicular to both.
    fn axes(&self) -> Matrix3<T> {
        let axis = self.unit_axis();
        Matrix3::from_columns(&[axis, self.direction, axis.cross(&self.direction)])
    }

    /// Returns the point `other` after the rigid motion that moves the point `from` to this point.
    fn moved(&self, from: &Self, other: &Self) -> Self {
        let turn = self.axes() * from.axes().transpose();
        Self {
            position: self.position + turn * (other.position - from.position),
            direction: turn * other.direction,
            axis: turn * other.axis,
            length: self.length + other.length - from.length,
            rate: other.rate,
        }
    }
}

/// A curve whose parts between the necks are replaced by circles. At a neck the phase of a point is that of the curve,
/// and on a circle it is proportional to the length.
#[derive(Debug, Clone)]
pub(super) struct HybridCurve<'a, T: PortableFloat> {
    curve: &'a ClosedFormCurve<T>,
    /// Phase at which the neck ends, radians. The neck begins at the negative of this phase.
    near: T,
    /// Points at the beginning and at the end of the neck.
    ends: [CurvePoint<T>; 2],
    /// Length of the circle from this neck to the next one, radii. `rate` is the length of circle for one radian of
    /// phase.
    between: T,
    rate: T,
}

impl<'a, T: Nodes> HybridCurve<'a, T> {
    pub(super) fn new(curve: &'a ClosedFormCurve<T>) -> Self {
        let near = curve.end_of_neck(T::literal(NARROW), T::literal(TWISTED));
        let ends = curve.points([-near, near]);
        let [max, _] = curve.points([T::literal(PI); 2]);
        let between = T::literal(2.0) * (max.length - ends[1].length);
        Self { curve, near, ends, between, rate: between / (T::literal(TAU) - T::literal(2.0) * near) }
    }

    fn on_curve(&self, phase: T) -> HybridPoint<T> {
        HybridPoint::of(&self.curve.points([phase; 2])[0])
    }

    /// Returns the point of the arc at a phase.
    pub(super) fn point(&self, phase: T) -> HybridPoint<T> {
        let [before, after] = self.ends.each_ref().map(HybridPoint::of);
        let forward = phase >= T::literal(0.0);
        let (side, enter, leave) =
            if forward { (T::literal(1.0), before, after) } else { (T::literal(-1.0), after, before) };
        let (one, turn) = (T::literal(1.0), T::literal(TAU));
        let beyond = side * phase - self.near;
        if beyond <= T::literal(0.0) {
            return self.on_curve(phase);
        }
        if beyond <= turn - T::literal(2.0) * self.near {
            return leave.on_circle(side * beyond * self.rate, self.rate);
        }
        let entry = leave.on_circle(side * self.between, one);
        let beyond = beyond - turn;
        if beyond <= T::literal(0.0) {
            return entry.moved(&enter, &self.on_curve(phase - side * turn));
        }
        entry.moved(&enter, &leave).on_circle(side * beyond, one)
    }

    /// Returns the approximate phase at this arc length from the neck (the point where `m` is shortest). Length and
    /// phase are negative before it.
    pub(super) fn phase_after(&self, length: T) -> T {
        let side = if length < T::literal(0.0) { T::literal(-1.0) } else { T::literal(1.0) };
        let neck = self.ends[1].length;
        let at_neck = |length: T| length * self.near / neck;
        let beyond = side * length - neck;
        if beyond <= T::literal(0.0) {
            return at_neck(length);
        }
        if beyond <= self.between {
            return side * (self.near + beyond / self.rate);
        }
        let from_next = beyond - self.between - neck;
        side * (T::literal(TAU) + if from_next <= neck { at_neck(from_next) } else { self.near + from_next - neck })
    }
}

/// Kind of a segment of an arc.
#[derive(Debug, Clone, Copy)]
pub(super) enum Stretch {
    /// A part of the helicoidal curve that begins at this point.
    Curve(CurvePoint<f64>),
    /// A part of a circle.
    Circle,
}

impl HybridCurve<'_, f64> {
    /// Calls `add` for each segment between two phases, in order. Its arguments are the kind of the segment, the angle
    /// (radians) by which the axis has turned about the tip between the start and the segment, and the length of the
    /// segment (radii).
    pub(super) fn stretches(&self, start: f64, end: f64, add: &mut dyn FnMut(Stretch, f64, f64)) {
        let [before, after] = &self.ends;
        let mut turned = 0.0;
        let mut from = start;
        for neck in [-TAU, 0.0, TAU] {
            let [enter, leave] = [neck - self.near, neck + self.near];
            if from < enter.min(end) {
                let to = enter.min(end);
                add(Stretch::Circle, turned, self.point(to).length - self.point(from).length);
                from = to;
            }
            if from < leave.min(end) {
                let to = leave.min(end);
                // At its ends, the neck agrees exactly with the circles.
                let at = |phase: f64| match phase {
                    _ if phase <= enter => *before,
                    _ if phase >= leave => *after,
                    _ => self.curve.points([phase - neck; 2])[0],
                };
                let [first, last] = [at(from), at(to)];
                add(Stretch::Curve(first), turned, last.length - first.length);
                turned += last.bend - first.bend;
                from = to;
            }
        }
        if from < end {
            add(Stretch::Circle, turned, self.point(end).length - self.point(from).length);
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::shortest::helicoids::seed::Seed;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        #[test]
        fn fitted_circles_are_close_to_the_curve(
            narrowness in -13.0..-11.0_f64, ratio in -1.0..5.0_f64, start in -8.0..0.1, length in 0.2..8.0,
        ) {
            let twist = (0.5 * narrowness + ratio).min(1.5_f64);
            let seed = Seed { narrowness, twist, mirrored: false, start, end: start + length, uses_circles: false };
            let (near, curve) = (seed.with_circles(), seed.curve());
            for (point, near) in seed.ends(&curve).iter().zip(near.ends(&curve)) {
                prop_assume!(point.length.abs() < 8.0);
                let off = (point.position - near.position).norm();
                prop_assert!(off < 0.02, "{off} radii off");
            }
        }
    }
}
