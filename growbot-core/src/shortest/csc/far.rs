//! Goals so far away that the polynomial consists of rounding errors only. For such goals the direction of the path's
//! line is found by iteration.
//!
//! With the goal's position `p`, the directions `t0` at the start and `t1` at the goal, and the direction `u` of the
//! line, the line is the vector `p - tau (t0 + u) - sigma (u + t1)`. `tau` and `sigma` follow from `u`. Each iteration
//! reduces the error by a factor of about the distance.

use core::f64::consts::TAU;

use nalgebra::Vector3;

use super::{CscLine, CscSearch};
use crate::shortest::problem::any_perpendicular;

/// Distance beyond which a goal counts as far, radii. There are four paths to such a goal, and the direction of each
/// path's line hardly depends on its arcs.
pub(super) const FAR: f64 = 100.0;
/// Number of paths of arc, line and arc to a goal that is further than [`FAR`].
const PATHS: usize = 4;
/// Max number of iterations. Each iteration reduces the error by a factor of about the distance.
const MAX_ROUNDS: u32 = 12;

impl CscSearch<'_> {
    /// Finds the four paths to a goal further than [`FAR`], if fewer are known. Each of the two arcs of a path is
    /// shorter or longer than half a turn, which gives four combinations.
    #[inline(never)]
    pub(super) fn far(&mut self) {
        if self.problem.goal.norm() < FAR || self.paths.len() >= PATHS {
            return;
        }
        for (first_long, last_long) in [(false, false), (false, true), (true, false), (true, true)] {
            let line = self.far_line(first_long, last_long);
            self.keep(line.path());
        }
    }

    fn far_line(&self, first_long: bool, last_long: bool) -> CscLine {
        let (goal, direction, ahead) = (self.problem.goal, self.problem.direction, Vector3::z());
        // Distance of the corner from an end of its arc: `tan` of half the angle, negative beyond half a turn.
        let tangent = |from: &Vector3<f64>, to: &Vector3<f64>, long: bool| {
            let half = (to - from).norm() / (to + from).norm().max(f64::MIN_POSITIVE);
            if long { -half } else { half }
        };
        let mut u = goal.normalize();
        let (mut tau, mut way) = (0.0, goal);
        for _ in 0..MAX_ROUNDS {
            tau = tangent(&ahead, &u, first_long);
            let sigma = tangent(&u, &direction, last_long);
            way = goal - (ahead + u) * tau - (u + direction) * sigma;
            u = way.normalize();
        }
        let (cos, across) = (u.dot(&direction), direction - u * u.dot(&direction));
        let sin = across.norm();
        let towards = if sin > 1e-14 { across / sin } else { any_perpendicular(&u) };
        let angle = libm::atan2(sin, cos);
        let (towards, last_angle) = if last_long { (-towards, TAU - angle) } else { (towards, angle) };
        CscLine { u, tau, straight: way.norm(), towards, last_angle }
    }
}
