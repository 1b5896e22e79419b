//! A helicoidal arc seen from its neck, and its coarse integration.

use nalgebra::Vector3;

use crate::helicoid::{Helicoid, Walk};

/// Max step of the coarse integration, radii. Trial: with 0.3 there are 24 misses, with 0.075 as many as with 0.15.
const MAX_STEP: f64 = 0.15;

/// A point of a curve: position and direction.
#[derive(Debug, Clone, Copy)]
pub(super) struct Point {
    pub(super) position: Vector3<f64>,
    pub(super) direction: Vector3<f64>,
}

/// A curve in the frame of its neck: the neck is at the origin, the curve grows along z there, and `m` points along x.
#[derive(Debug, Clone, Copy)]
pub(super) struct Neck {
    /// `|m|`.
    pub(super) narrowness: f64,
    /// The component of `p` along `m`. The rest of `p` points along z and is `1 - |m|`.
    pub(super) twist: f64,
}

impl Neck {
    pub(super) fn curve(&self) -> Helicoid {
        Helicoid {
            m0: Vector3::new(self.narrowness, 0.0, 0.0),
            p: Vector3::new(self.twist, 0.0, 1.0 - self.narrowness),
        }
    }

    /// The axis about which the tip turns at a point.
    pub(super) fn axis(&self, point: &Point) -> Vector3<f64> {
        let m = self.curve().m(&point.position);
        m / m.norm().max(f64::MIN_POSITIVE)
    }

    /// One step: half of its length straight, then the whole turn, then the other half. `m` changes linearly within the
    /// step.
    pub(super) fn step(&self, point: &Point, length: f64) -> Point {
        let curve = self.curve();
        let middle = point.position + point.direction * (0.5 * length);
        let turn = mean_direction(&curve.m(&middle), &(curve.p.cross(&point.direction) * length)) * length;
        // The Cayley form of the rotation. The tangent of half the angle comes from its series.
        let half = turn * (0.5 + turn.norm_squared() * (1.0 / 24.0));
        let across = half.cross(&point.direction);
        let direction = point.direction + (across + half.cross(&across)) * (2.0 / (1.0 + half.norm_squared()));
        Point { position: middle + direction * (0.5 * length), direction }
    }

    /// Integrates from one distance behind the neck to a greater one. Steps are short where the neck is narrow.
    pub(super) fn walk(&self, mut point: Point, from: f64, to: f64) -> Point {
        // A power of 2: the steps stay the same when the narrowness changes a little.
        let width = f64::from_bits(libm::sqrt(self.narrowness).to_bits() & f64::INFINITY.to_bits());
        let mut at = from;
        while at < to {
            let step = MAX_STEP.min((0.5 * width).max(0.4 * at));
            // A remainder of less than half a step joins the last step.
            let step = if at + 1.5 * step > to { to - at } else { step };
            point = self.step(&point, step);
            at += step;
        }
        point
    }

    /// The points at two distances from the neck. Negative distances lie before it.
    pub(super) fn ends(&self, start: f64, end: f64, fine: bool, keep_alive: &mut dyn FnMut()) -> (Point, Point) {
        let neck = Point { position: Vector3::zeros(), direction: Vector3::z() };
        let (first, second) = (start.abs(), end.abs());
        let (near, far) = if first < second { (first, second) } else { (second, first) };
        let (at_near, at_far) = if fine {
            let mut walk = Walk::new(&self.curve());
            let here = |walk: &Walk| {
                let frame = walk.frame();
                Point { position: frame.translation.vector, direction: frame.rotation * Vector3::z() }
            };
            walk.advance_with_keep_alive(near, keep_alive);
            let at_near = here(&walk);
            walk.advance_with_keep_alive(far - near, keep_alive);
            (at_near, here(&walk))
        } else {
            let at_near = self.walk(neck, 0.0, near);
            (at_near, self.walk(at_near, near, far))
        };
        let (at_start, at_end) = if first < second { (at_near, at_far) } else { (at_far, at_near) };
        (before_if(start < 0.0, &at_start), before_if(end < 0.0, &at_end))
    }
}

/// The point itself, or (`before`) its mirror image before the neck.
pub(super) fn before_if(before: bool, point: &Point) -> Point {
    if !before {
        return *point;
    }
    let Point { position: x, direction: t } = point;
    Point { position: Vector3::new(-x.x, x.y, -x.z), direction: Vector3::new(t.x, -t.y, t.z) }
}

/// The mean of `v/|v|` for `v` from `middle - change/2` to `middle + change/2`.
fn mean_direction(middle: &Vector3<f64>, change: &Vector3<f64>) -> Vector3<f64> {
    let (square, change_square) = (middle.norm_squared(), change.norm_squared());
    if change_square < 0.05 * square {
        return middle / libm::sqrt(square);
    }
    // v = off + change u, with `off` perpendicular to `change`.
    let along = middle.dot(change) / change_square.max(f64::MIN_POSITIVE);
    let off = middle - change * along;
    let (from, to) = (along - 0.5, along + 0.5);
    let off_square = off.norm_squared();
    let norm = |u: f64| libm::sqrt(off_square + change_square * u * u);
    let (norm_from, norm_to) = (norm(from), norm(to));
    let size = libm::sqrt(change_square);
    // |change| u + |v|, without cancellation.
    let sum = |u: f64, norm: f64| if u >= 0.0 { size * u + norm } else { off_square / (norm - size * u) };
    let logarithm = if off_square > 1e-24 { libm::log(sum(to, norm_to) / sum(from, norm_from)) } else { 0.0 };
    change * ((norm_to - norm_from) / change_square) + off * (logarithm / size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn neck() -> impl Strategy<Value = Neck> {
        (0.05..2.0, -2.0..2.0).prop_map(|(narrowness, twist)| Neck { narrowness, twist })
    }

    fn vector() -> impl Strategy<Value = Vector3<f64>> {
        prop::array::uniform3(-1.0..1.0).prop_map(Vector3::from)
    }

    fn apart(a: &Point, b: &Point) -> f64 {
        (a.position - b.position).norm().max((a.direction - b.direction).norm())
    }

    proptest! {
        #[test]
        fn the_coarse_integration_agrees_with_the_fine_one(neck in neck(), start in -3.0..3.0, end in -3.0..3.0) {
            let ends = |fine| neck.ends(start, end, fine, &mut || ());
            let (coarse, fine) = (ends(false), ends(true));
            let apart = apart(&coarse.0, &fine.0).max(apart(&coarse.1, &fine.1));
            prop_assert!(apart < 0.02, "{apart} apart");
        }

        #[test]
        fn growth_from_before_the_neck_reaches_it(neck in neck(), before in 0.1..3.0_f64) {
            let (mut point, at_neck) = neck.ends(-before, 0.0, true, &mut || ());
            for _ in 0..10_000 {
                point = neck.step(&point, before / 10_000.0);
            }
            let apart = apart(&point, &at_neck);
            prop_assert!(apart < 1e-5, "{apart} apart");
        }

        #[test]
        fn the_mean_direction_is_that_of_many_samples(middle in vector(), change in vector()) {
            let samples = 4000_u32;
            let sum = (0..samples).fold(Vector3::zeros(), |sum, n| {
                sum + (middle + change * ((f64::from(n) + 0.5) / f64::from(samples) - 0.5)).normalize()
            });
            let apart = (mean_direction(&middle, &change) - sum / f64::from(samples)).norm();
            // Below 5 % of change the direction in the middle is taken for the mean.
            prop_assert!(apart < 5e-3, "{apart} apart");
        }
    }
}
