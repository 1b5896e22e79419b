//! An arc of a curve, with the numbers that the search varies.

use core::f64::consts::PI;

use nalgebra::Vector5;

use super::closed_form::ClosedFormCurve;
use super::hybrid_curve::{HybridCurve, HybridPoint};
use super::precision::Precision;

/// Logarithms of `|m|` and of the component of `p` along `m`, both at the neck, below which the parts of a curve
/// between its necks are replaced by circles.
const CIRCLES: (f64, f64) = (-11.0, -4.0);
/// Max distance beyond the limits [`CIRCLES`] to which a refinement may lead.
const ACROSS: f64 = 2.0;
/// Min of the logarithm of `|m|` at the neck.
const NARROWEST: f64 = -30.0;

/// An arc that leads nearly to the goal. It is the start of a refinement, or its result.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Seed<T> {
    /// Logarithm of `|m|` at the neck.
    pub(super) narrowness: T,
    /// Logarithm of the absolute value of the component of `p` along `m` at the neck.
    pub(super) twist: T,
    /// True if the twist is negative, so that the curve is mirrored.
    pub(super) mirrored: bool,
    /// Phase at which the arc begins, radians from the neck.
    pub(super) start: T,
    /// Phase at which the arc ends, radians from the neck.
    pub(super) end: T,
    /// True if the arc consists of circles between very narrow necks (`hybrid_curve.rs`).
    pub(super) uses_circles: bool,
}

impl<T: Precision> Seed<T> {
    pub(super) fn curve(&self) -> ClosedFormCurve<T> {
        ClosedFormCurve::new(self.narrowness.exponential(), self.twist.exponential())
    }

    /// Returns the derivative of the twist with respect to the narrowness while the refinement changes the narrowness.
    /// Near a very narrow neck the arc depends on the ratio of the twist to the square root of `|m|`, and hardly on
    /// `|m|` itself. Without this term the two would be nearly the same unknown.
    pub(super) fn twist_by_narrowness(&self) -> T {
        T::literal(if self.uses_circles { 0.5 } else { 0.0 })
    }

    /// Returns the norm of a step of the refinement. The change of a very narrow neck's narrowness is weighted by its
    /// effect on the lengths.
    pub(super) fn size(&self, step: &Vector5<T>) -> T {
        let mut step = *step;
        if self.uses_circles {
            step[0] *= (T::literal(0.5) * self.narrowness).exponential();
        }
        step.norm_squared().root()
    }

    /// Returns the start and the end of the arc, in the axes of its curve.
    pub(super) fn ends(&self, curve: &ClosedFormCurve<T>) -> [HybridPoint<T>; 2] {
        let phases = [self.start, self.end];
        if self.uses_circles && !T::IS_ROUGH {
            let course = HybridCurve::new(curve);
            phases.map(|phase| course.point(phase))
        } else {
            curve.points(phases).map(|point| HybridPoint::of(&point))
        }
    }

    pub(super) fn in_range(&self) -> bool {
        let within = |value: T, min: f64, max: f64| value > T::literal(min) && value < T::literal(max);
        let (narrow, twisted) = CIRCLES;
        let suits = if self.uses_circles {
            self.narrowness < T::literal(narrow + ACROSS) && self.twist < T::literal(twisted + 0.25 * ACROSS)
        } else {
            T::IS_ROUGH || self.narrowness > T::literal(narrow - ACROSS) || self.twist > T::literal(twisted - ACROSS)
        };
        suits
            && within(self.narrowness, NARROWEST, 3.0)
            && within(self.twist, -16.0, 4.0)
            && within(self.start, -9.0, 9.0)
            && within(self.end, -9.0, 9.0)
            && self.start < self.end
    }
}

impl Seed<f32> {
    pub(super) fn precise(&self) -> Seed<f64> {
        let Self { narrowness, twist, mirrored, start, end, uses_circles: with_circles } = *self;
        let (narrowness, twist) = (narrowness.into(), twist.into());
        Seed { narrowness, twist, mirrored, start: start.into(), end: end.into(), uses_circles: with_circles }
    }
}

impl Seed<f64> {
    /// Reports whether the phases of the arc are counted from a neck. The refinement may lead to phases that are
    /// counted from the max of `|m|`, where the closed form is not precise.
    pub(super) fn is_seen_from_neck(&self) -> bool {
        self.curve().swing >= 0.0
    }

    /// Returns this arc with its phases counted from a neck.
    #[inline(never)]
    pub(super) fn seen_from_neck(&self) -> Self {
        let swing = self.curve().swing;
        if swing >= 0.0 {
            return *self;
        }
        // `m . p` is constant along the curve, and the phase is shifted by half a turn.
        let min = libm::log(libm::exp(self.narrowness) + swing);
        let shift = if self.start + self.end < 0.0 { PI } else { -PI };
        let twist = self.twist + self.narrowness - min;
        Self { narrowness: min, twist, start: self.start + shift, end: self.end + shift, ..*self }
    }

    /// Returns this arc with circles between its necks, if the necks are very narrow. Otherwise returns the arc
    /// unchanged.
    #[inline(never)]
    pub(super) fn with_circles(&self) -> Self {
        if self.narrowness >= CIRCLES.0 || self.twist >= CIRCLES.1 {
            return *self;
        }
        let curve = self.curve();
        let [start, end] = curve.points([self.start, self.end]).map(|point| point.length);
        self.between_lengths(&curve, start, end)
    }

    /// Returns the arc with circles between its necks that begins and ends at these lengths (radii), counted along the
    /// curve from the neck.
    fn between_lengths(&self, curve: &ClosedFormCurve<f64>, start: f64, end: f64) -> Self {
        let course = HybridCurve::new(curve);
        Self { start: course.phase_after(start), end: course.phase_after(end), uses_circles: true, ..*self }
    }

    pub(super) fn rough(&self) -> Seed<f32> {
        let Self { narrowness, twist, mirrored, start, end, uses_circles: with_circles } = *self;
        let (narrowness, twist) = (narrowness as f32, twist as f32);
        Seed { narrowness, twist, mirrored, start: start as f32, end: end as f32, uses_circles: with_circles }
    }
}
