//! Bodies that lead from the start through some via positions to the goal, with the shortest arc and line between two
//! of them.
//!
//! An arc and a line to a position have a closed form that takes 0.1 us. A body is therefore described by the positions
//! that it passes, and shortening it is a search over few numbers.

use growbot_core::pose::Frame;
use growbot_core::shortest::{self, Candidates};
use nalgebra::{Matrix3, Rotation3, Translation3, Vector3};

use super::{PlannerGoal, PlanningProblem};
use crate::centreline::{ArcSegment, TipPose, any_perpendicular, arc_and_line_to, arc_segments, length};

/// A body that leads to the goal, and the via positions through which it leads.
#[derive(Debug, Clone, PartialEq)]
pub struct ViaPath {
    /// Via positions: the positions through which the body leads, in their order, mm.
    pub via: Vec<Vector3<f64>>,
    /// Arcs and lines of the body.
    pub segments: Vec<ArcSegment>,
    /// Length of the body, mm.
    pub length: f64,
}

impl PlanningProblem<'_> {
    /// Returns the shortest body through these via positions to the goal, if it is shorter than `below` (mm).
    pub(super) fn chain(&self, via: &[Vector3<f64>], below: f64) -> Option<ViaPath> {
        let mut tip = self.start;
        let mut segments = Vec::with_capacity(2 * via.len() + 3);
        let mut so_far = 0.0;
        for (index, position) in via.iter().enumerate() {
            let [arc, line] = arc_and_line_to(&tip, position, self.radius)?;
            so_far += arc.length + line.length;
            let next = via.get(index + 1).copied().unwrap_or_else(|| self.goal.position());
            // The rest is at least as long as the straight line.
            if so_far + (next - position).norm() - self.tolerance() > below {
                return None;
            }
            tip = line.end();
            segments.extend([arc, line]);
        }
        if !via.last().is_some_and(|last| self.is_at_goal(last)) {
            segments.extend(self.shortest_to_goal(&tip)?);
        }
        let length = length(&segments);
        (length < below).then(|| ViaPath { via: via.to_vec(), segments, length })
    }

    /// Returns the maximum distance from the goal's position at which a body may end, mm.
    pub(super) fn tolerance(&self) -> f64 {
        match self.goal {
            PlannerGoal::Position { tolerance, .. } => tolerance,
            PlannerGoal::Pose(_) => 0.0,
        }
    }

    /// Reports whether a body that ends at this position has arrived within the tolerance of the goal.
    pub(super) fn is_at_goal(&self, position: &Vector3<f64>) -> bool {
        let tolerance = self.tolerance();
        tolerance > 0.0 && (position - self.goal.position()).norm() <= tolerance
    }

    /// Returns the shortest way from a tip to the goal.
    pub(super) fn shortest_to_goal(&self, tip: &TipPose) -> Option<Vec<ArcSegment>> {
        match self.goal {
            PlannerGoal::Position { at, tolerance } => {
                let mut way = arc_and_line_to(tip, &at, self.radius)?.to_vec();
                cut(&mut way, tolerance);
                Some(way)
            }
            PlannerGoal::Pose(_) => self.ways_to_goal(tip).into_iter().next(),
        }
    }

    /// Returns all ways from a tip to the goal that have the form of a shortest path, shortest first.
    pub(super) fn ways_to_goal(&self, tip: &TipPose) -> Vec<Vec<ArcSegment>> {
        let PlannerGoal::Pose(goal) = self.goal else { return self.shortest_to_goal(tip).into_iter().collect() };
        let base_from_tip = frame(tip);
        let tip_from_base = base_from_tip.rotation.inverse();
        let offset = tip_from_base * ((goal.position - tip.position) / self.radius);
        let problem = shortest::PathProblem::new(&offset, &(tip_from_base * goal.direction));
        let mut found = Candidates::new();
        shortest::candidates(&problem, 0.0, &mut found, &mut || ());
        let ways =
            found.iter().filter_map(|candidate| arc_segments(&candidate.path(self.radius).ok()?, &base_from_tip));
        ways.collect()
    }
}

/// Returns a frame of this tip, with any roll.
pub(super) fn frame(tip: &TipPose) -> Frame {
    let x = any_perpendicular(&tip.direction);
    let axes = Matrix3::from_columns(&[x, tip.direction.cross(&x), tip.direction]);
    Frame::from_parts(Translation3::from(tip.position), Rotation3::from_matrix_unchecked(axes))
}

/// Removes this length (mm) from the end of a way.
fn cut(way: &mut Vec<ArcSegment>, mut length: f64) {
    while let Some(last) = way.last_mut() {
        if last.length > length {
            last.length -= length;
            return;
        }
        length -= last.length;
        way.pop();
    }
}
