//! The course of an arc: on its curve near the necks, and on circles between them.
//!
//! Away from a narrow neck the curve is nearly a circle, but it is sensitive there. A tip that comes from far away
//! passes the neck in a direction that depends on the last digits of its start. So the arc follows the curve only near
//! such a neck, and elsewhere the circles that touch the curve. The length increases by less than 1e-6 radii, because
//! the plane of the bend would turn by only 0.003 radians more and the excess is of second order.
//!
//! If `p` has a large component along `m`, the neck is long, but the curve is not sensitive, because the bend reverses.

use core::f64::consts::{PI, TAU};

use nalgebra::{Matrix3, Vector3};

use super::closed_form::{ClosedFormCurve, CurvePoint, Nodes};
use crate::float::PortableFloat;

/// `|m|` at the end of a neck is the sum of two terms: this multiple of its min, and the term of [`TWISTED`].
const NARROW: f64 = 300.0;
/// The other term of `|m|` at the end of a neck: this multiple of the square of the component of `p` along `m` at the
/// neck.
const TWISTED: f64 = 32.0;

/// A point of an arc in the axes of its curve.
#[derive(Debug, Clone, Copy)]
pub(super) struct HybridPoint<T: PortableFloat> {
    pub(super) position: Vector3<T>,
    pub(super) direction: Vector3<T>,
    /// The axis about which the tip turns, of any length.
    pub(super) axis: Vector3<T>,
    /// Length from the neck, radii.
    pub(super) length: T,
    /// `d length / d phase`.
    pub(super) rate: T,
}

impl<T: PortableFloat> HybridPoint<T> {
    pub(super) fn of(point: &CurvePoint<T>) -> Self {
        let CurvePoint { length, rate, .. } = *point;
        Self { position: point.position(), direction: point.direction(), axis: point.axis(), length, rate }
    }

    /// Returns the axis as a unit vector.
    pub(super) fn unit_axis(&self) -> Vector3<T> {
        self.axis / self.axis.norm_squared().root().max(T::literal(1e-30))
    }

    /// Returns the point after this length of a circle. The length may be negative.
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

    /// Returns the axis, the direction, and the direction perpendicular to both.
    fn axes(&self) -> Matrix3<T> {
        let axis = self.unit_axis();
        Matrix3::from_columns(&[axis, self.direction, axis.cross(&self.direction)])
    }

    /// Returns `other`, moved by the rigid motion that takes `from` to `self`.
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

/// The course of a curve with circles between its necks, by phase. At a neck the phases are those of the curve, and on
/// the circles they are proportional to the length.
#[derive(Debug, Clone)]
pub(super) struct HybridCurve<'a, T: PortableFloat> {
    curve: &'a ClosedFormCurve<T>,
    /// Phase at which the neck ends.
    near: T,
    /// Points at the ends of the neck.
    ends: [CurvePoint<T>; 2],
    /// Length of the circle from this neck to the next, radii. `rate` is its length for a unit of phase.
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

    /// Returns the point at a phase.
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

/// A segment of an arc.
#[derive(Debug, Clone, Copy)]
pub(super) enum Stretch {
    /// A part of the curve that begins at this point.
    Curve(CurvePoint<f64>),
    /// A circle.
    Circle,
}

impl HybridCurve<'_, f64> {
    /// Calls `add` for all segments between two phases. The arguments are the kind of the segment, the angle by which
    /// the axis has turned about the tip since the start, and the length.
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
