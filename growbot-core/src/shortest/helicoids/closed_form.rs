//! Helicoidal arcs in closed form: positions on the curve, without integration along it.
//!
//! With `rho = |m|` and the constants `P = |p|` and `b = m . p`, `|m| + p . x' = 1` gives
//!
//! ```text
//! (rho rho')^2 = (rho - nu) (rho2 - rho) (rho^2 + alpha rho + beta)
//! ```
//!
//! where `nu` is the min of `rho`, at the neck, and `rho2` its max. The phase `psi` is 0 at the neck and pi at the max:
//! `rho = nu + (rho2 - nu) sin^2(psi/2)`. Length, height along `p` and the angle about `p` are integrals over `psi`.
//! They are computed by Gauss' formula, with nodes that are closer to each other near a narrow neck: `psi = kappa sinh
//! v`.
//!
//! All points are in the axes of `p`. The third axis points along `p`, and the distance of `m` from it is `sqrt(rho^2 -
//! b^2/P^2)`.

use core::f64::consts::PI;

use nalgebra::Vector3;

use crate::float::PortableFloat;

/// Number of nodes of Gauss' formula that are computed side by side.
const LANES: usize = 4;

/// A float type with the nodes of Gauss' integration formula that suffice for its precision.
pub(super) trait Nodes: PortableFloat {
    /// Nodes and weights of Gauss' formula on `[0, 1]`, in groups of [`LANES`].
    const NODES: &'static [([Self; LANES], [Self; LANES])];
    /// Max width, in the variable `v`, of a panel to which the formula is applied.
    const PANEL: Self;
}

impl Nodes for f64 {
    const PANEL: Self = 4.0;
    const NODES: &'static [([Self; LANES], [Self; LANES])] = &[
        (
            [0.0024063900014893447, 0.012635722014345263, 0.0308627239986336, 0.056792236497799464],
            [0.006170614899993667, 0.014265694314466906, 0.022138719408709838, 0.02964929245771833],
        ),
        (
            [0.08999900701304853, 0.12993790421072282, 0.17595317403151223, 0.22728926430558022],
            [0.036673240705540136, 0.04309508076597661, 0.04880932605205695, 0.05372213505798281],
        ),
        (
            [0.2831032461869774, 0.3424786601519183, 0.40444056626319186, 0.4679715535686972],
            [0.05775283402686281, 0.060835236463901675, 0.06291872817341419, 0.06396909767337612],
        ),
        (
            [0.5320284464313028, 0.5955594337368082, 0.6575213398480817, 0.7168967538130226],
            [0.06396909767337612, 0.06291872817341419, 0.060835236463901675, 0.05775283402686281],
        ),
        (
            [0.7727107356944198, 0.8240468259684878, 0.8700620957892772, 0.9100009929869515],
            [0.05372213505798281, 0.04880932605205695, 0.04309508076597661, 0.036673240705540136],
        ),
        (
            [0.9432077635022005, 0.9691372760013663, 0.9873642779856547, 0.9975936099985107],
            [0.02964929245771833, 0.022138719408709838, 0.014265694314466906, 0.006170614899993667],
        ),
    ];
}

impl Nodes for f32 {
    const PANEL: Self = 100.0;
    const NODES: &'static [([Self; LANES], [Self; LANES])] = &[
        (
            [0.009219683, 0.047_941_37, 0.115_048_66, 0.206_341_03],
            [0.023587668, 0.053_469_66, 0.080039164, 0.101_583_71],
        ),
        (
            [0.316_084_27, 0.437_383_3, 0.562_616_7, 0.683_915_73],
            [0.116_746_27, 0.124_573_52, 0.124_573_52, 0.116_746_27],
        ),
        ([0.793_659, 0.884_951_35, 0.952_058_6, 0.990_780_3], [0.101_583_71, 0.080039164, 0.053_469_66, 0.023587668]),
    ];
}

/// Max of [`ClosedFormCurve::kappa`].
const MAX_KAPPA: f64 = 2.0;
/// Max number of steps of Newton's method that computes the max of `|m|`.
const MAX_STEPS: u32 = 40;

/// A whole helicoidal curve in closed form. The unit of length is the radius.
#[derive(Debug, Clone, Copy)]
pub(super) struct ClosedFormCurve<T> {
    /// `nu`, the min of `|m|`.
    min: T,
    /// Difference between the max and the min of `|m|`, `rho2 - nu`.
    pub(super) swing: T,
    alpha: T,
    beta: T,
    /// `P`, the length of `p`.
    pub(super) force: T,
    /// `b / P`: the component of `m` along `p`.
    along: T,
    /// Difference `nu - b/P`, computed without cancellation.
    gap: T,
    /// `kappa`, the scale of the distance between nodes near the neck.
    kappa: T,
}

/// A point of a helicoidal curve, in the axes of `p`.
#[derive(Debug, Clone, Copy)]
pub(super) struct CurvePoint<T> {
    /// Length along the curve from the neck, radii.
    pub length: T,
    /// Derivative of the length with respect to the phase `psi`, radii per radian.
    pub rate: T,
    /// Angle about `p` from the neck, radians.
    pub angle: T,
    /// Position along `p`, from the neck, radii.
    pub height: T,
    /// Position along the axis perpendicular to `p` and `m`, radii.
    pub across: T,
    /// Direction of growth, as components along three axes: the part of `m` that is perpendicular to `p`, the axis
    /// perpendicular to `p` and `m`, and `p`.
    pub direction: [T; 3],
    /// The vector `m`, as components along the three axes of `direction`. The middle component is 0.
    pub m: [T; 3],
    /// Length of `m`.
    pub rho: T,
    /// Product of `|m|` and its rate of change along the curve, `rho rho'`.
    turning: T,
    /// Angle by which `w` has turned about the tip since the neck, radians.
    pub bend: T,
}

/// Factors of the integrands of length, height and angles, at one phase.
struct Integrand<T> {
    rho: T,
    /// Square of the distance of `m` from the third axis, `rho^2 - b^2/P^2`.
    off_axis: T,
    /// The square root `sqrt(rho^2 + alpha rho + beta)`.
    root: T,
}

impl<T: Nodes> ClosedFormCurve<T> {
    /// Creates the curve from two numbers at its neck: `min` is `|m|`, and `twist` is the component of `p` along `m`,
    /// at least 0.
    #[inline(never)]
    pub fn new(min: T, twist: T) -> Self {
        let [zero, one, two] = [0.0, 1.0, 2.0].map(T::literal);
        let square = twist * twist;
        let force = (square + (one - min) * (one - min)).root().max(T::literal(1e-12));
        // Newton's method, from above, for the only positive root of rho^3 - (2 - nu) rho^2 - tw^2 (rho + nu).
        let mut max = one + force;
        for _ in 0..MAX_STEPS {
            let value = ((max - two + min) * max - square) * max - square * min;
            let slope = (T::literal(3.0) * max - two * (two - min)) * max - square;
            let next = max - value / slope.max(T::literal(1e-12));
            if next < max {
                max = next;
            } else {
                break;
            }
        }
        let swing = max - min;
        let alpha = (min + max) * square / (max * max);
        let beta = min * square / max;
        let gap = min * (one - min) * (one - min) / (force * (force + twist));
        let discriminant = alpha * alpha - T::literal(4.0) * beta;
        let third = if discriminant > zero {
            two * beta / (alpha + discriminant.root()).max(T::literal(1e-30))
        } else {
            beta.root()
        };
        let kappa = if swing > T::literal(1e-9) {
            let share = gap.min(min + third) / swing;
            (two * share.root()).max(T::literal(1e-9)).min(T::literal(MAX_KAPPA))
        } else {
            T::literal(MAX_KAPPA)
        };
        Self { min, swing, alpha, beta, force, along: min * twist / force, gap, kappa }
    }

    /// Returns the phase of the end of the neck, at which the bend has made nearly all of its turn. There `|m|` is the
    /// sum of `narrow` times its min and `twisted` times the square of the component of `p` along `m` at the neck.
    pub fn end_of_neck(&self, narrow: T, twisted: T) -> T {
        let twist = self.along * self.force / self.min;
        let square = ((narrow - T::literal(1.0)) * self.min + twisted * twist * twist) / self.swing;
        // The sine of half the phase. It is so small here that a short series computes the arcsine.
        let sine = square.root().min(T::literal(0.5));
        T::literal(2.0) * sine * (T::literal(1.0) + sine * sine / T::literal(6.0))
    }

    /// Returns the factors of the integrands at a phase. The argument is half of the phase, which is at most pi.
    fn integrand(&self, half: T) -> Integrand<T> {
        let sine = half.sine_of_quarter();
        let above = self.swing * sine * sine;
        let rho = self.min + above;
        let root = ((rho + self.alpha) * rho + self.beta).root();
        let off_axis = (above + self.gap) * (rho + self.along);
        Integrand { rho, off_axis, root }
    }

    /// Returns the integrals, from the neck to a phase of at most pi, of `ds`, `(1 - rho) ds`, `(1 - rho) / (rho^2 -
    /// b^2/P^2) ds` and `ds / rho^2`. Length, height, angle about `p` and angle of the bend are multiples of them.
    #[inline(never)]
    fn integrals(&self, phase: T) -> [T; 4] {
        let [zero, half, one] = [0.0, 0.5, 1.0].map(T::literal);
        let ratio = phase / self.kappa;
        let v = (ratio + (ratio * ratio + one).root()).logarithm();
        let mut sums = [[zero; LANES]; 4];
        let mut panels = one;
        while v > panels * T::PANEL {
            panels += one;
        }
        let width = v / panels;
        let mut from = zero;
        while from < v - half * width {
            for (places, weights) in T::NODES {
                self.add_nodes(&mut sums, from, width, places, weights);
            }
            from += width;
        }
        let total = sums.map(|[a, b, c, d]| (a + b) + (c + d));
        let scale = half * self.kappa * width;
        total.map(|sum| sum * scale)
    }

    /// Adds the values of the integrands at [`LANES`] nodes of a panel to the sums. Each lane has its own sums, for
    /// processors that compute several lanes at once.
    fn add_nodes(&self, sums: &mut [[T; LANES]; 4], from: T, width: T, places: &[T; LANES], weights: &[T; LANES]) {
        let one = T::literal(1.0);
        let quarter_kappa = T::literal(0.25) * self.kappa;
        let (mut share, mut halves) = (*weights, *places);
        for (share, half) in share.iter_mut().zip(&mut halves) {
            let exponential = (from + width * *half).exponential();
            let inverse = one / exponential;
            *half = quarter_kappa * (exponential - inverse);
            *share *= exponential + inverse;
        }
        for lane in 0..LANES {
            let Integrand { rho, off_axis, root } = self.integrand(halves[lane]);
            // One division serves all integrands.
            let share = share[lane] / (root * rho * off_axis);
            let by_angle = share * rho * rho;
            let by_length = by_angle * off_axis;
            sums[0][lane] += by_length;
            sums[1][lane] += by_length * (one - rho);
            sums[2][lane] += by_angle * (one - rho);
            sums[3][lane] += share * off_axis;
        }
    }

    /// Returns the points of the curve at two phases. Phases before the neck are negative.
    #[inline(never)]
    pub fn points(&self, phases: [T; 2]) -> [CurvePoint<T>; 2] {
        let pi = T::literal(PI);
        let is_far = phases.iter().any(|phase| phase.abs() > pi);
        let to_max = if is_far { self.integrals(pi) } else { [T::literal(0.0); 4] };
        phases.map(|phase| self.point(phase, &to_max))
    }

    /// Returns the vector `p` at a point, as components along three axes: `w = m / |m|`, the axis perpendicular to `w`
    /// and the direction of growth, and the direction of growth.
    pub fn p(&self, point: &CurvePoint<T>) -> [T; 3] {
        [self.along * self.force / point.rho, point.turning / point.rho, T::literal(1.0) - point.rho]
    }

    /// Returns the point of the curve at a phase. `to_max` holds the integrals from the neck to the max of `|m|`.
    fn point(&self, phase: T, to_max: &[T; 4]) -> CurvePoint<T> {
        let [zero, one, two] = [0.0, 1.0, 2.0].map(T::literal);
        let pi = T::literal(PI);
        let (halves, rest) = if phase > pi {
            (two, phase - two * pi)
        } else if phase < -pi {
            (-two, phase + two * pi)
        } else {
            (zero, phase)
        };
        let [length, height, angle, bend] = self.integrals(rest.abs()).map(|sum| if rest < zero { -sum } else { sum });
        let [full_length, full_height, full_angle, full_bend] = to_max.map(|sum| halves * sum);
        let Integrand { rho, off_axis, root } = self.integrand(T::literal(0.5) * rest);
        let turning = T::literal(0.5) * self.swing * rest.sine_cosine().0 * root;
        let radius = off_axis.root().max(T::literal(1e-30));
        let per_radius = one / (radius * self.force);
        CurvePoint {
            length: length + full_length,
            rate: rho / root,
            angle: -self.along * (angle + full_angle),
            height: (height + full_height) / self.force,
            across: -radius / self.force,
            direction: [-self.along * (one - rho) * per_radius, -turning * per_radius, (one - rho) / self.force],
            m: [radius, zero, self.along],
            rho,
            turning,
            bend: -self.along * self.force * (bend + full_bend),
        }
    }
}

impl<T: PortableFloat> CurvePoint<T> {
    /// Converts components along the three axes of the field `direction` to the axes of the curve.
    fn turned(angle: T, [along_m, across, along_p]: [T; 3]) -> Vector3<T> {
        let (sin, cos) = angle.sine_cosine();
        Vector3::new(cos * along_m - sin * across, sin * along_m + cos * across, along_p)
    }

    pub fn position(&self) -> Vector3<T> {
        Self::turned(self.angle, [T::literal(0.0), self.across, self.height])
    }

    pub fn direction(&self) -> Vector3<T> {
        Self::turned(self.angle, self.direction)
    }

    pub fn axis(&self) -> Vector3<T> {
        Self::turned(self.angle, self.m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::helicoid::{Helicoid, HelicoidIntegrator};
    use proptest::prelude::*;

    /// Generates the logarithms of the two numbers at the neck, and a phase.
    fn curve() -> impl Strategy<Value = (f64, f64, f64)> {
        (-9.0..1.2, -4.0..1.9, 0.02..8.0).prop_filter("the neck is the max", |(min, twist, _)| {
            let min = libm::exp(*min);
            libm::exp(2.0 * twist) > min * (min - 1.0)
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        #[test]
        fn points_match_the_integration((min, twist, phase) in curve()) {
            let (min, twist) = (libm::exp(min), libm::exp(twist));
            let curve = ClosedFormCurve::<f64>::new(min, twist);
            let [neck, point] = curve.points([0.0, phase]);
            prop_assume!(point.length < 8.0);
            let along = neck.direction();
            let axis = neck.axis().normalize();
            let neck_axes = nalgebra::Matrix3::from_columns(&[axis.cross(&along), axis, along]);
            let mut walk = HelicoidIntegrator::new(&Helicoid {
                m0: neck_axes.tr_mul(&neck.axis()),
                p: neck_axes.tr_mul(&Vector3::new(0.0, 0.0, curve.force)),
            });
            walk.advance(point.length);
            let frame = walk.frame();
            let position = neck_axes.tr_mul(&(point.position() - neck.position()));
            let direction = neck_axes.tr_mul(&point.direction());
            let off = (frame.translation.vector - position).norm();
            prop_assert!(off < 1e-9, "{off:e} radii off");
            let off = (frame.rotation * Vector3::z() - direction).norm();
            prop_assert!(off < 1e-9, "{off:e} radians off");
            // `m` must have turned about the tip by the same angle.
            let axis = frame.rotation.inverse() * (neck_axes.tr_mul(&point.axis()) / point.rho);
            let turned = crate::angle::wrap_signed(libm::atan2(axis.y, axis.x) - 0.5 * PI - point.bend);
            prop_assert!(turned.abs() < 1e-7, "the bend is {turned:e} off");
        }

        #[test]
        fn single_precision_matches_double_precision((min, twist, phase) in curve()) {
            let [_, point] = ClosedFormCurve::<f64>::new(libm::exp(min), libm::exp(twist)).points([0.0, phase]);
            let rough = ClosedFormCurve::<f32>::new(libm::exp(min) as f32, libm::exp(twist) as f32);
            let [_, rough] = rough.points([0.0, phase as f32]);
            prop_assume!(point.length < 8.0);
            let off = (point.position() - rough.position().map(f64::from)).norm();
            prop_assert!(off < 0.01, "{off:e} radii off");
        }
    }
}
