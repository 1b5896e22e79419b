//! Ways to the goal: straight from a tip, or through via positions with the shortest arc and line between two of them.

use growbot_core::pose::Frame;
use growbot_core::shortest::{self, Candidates};
use nalgebra::{Matrix3, Rotation3, Translation3, Vector3};

use super::problem::{PlannerGoal, PlanningProblem};
use super::via_path::ViaPath;
use crate::centreline::{ArcSegment, TipPose, any_perpendicular, arc_and_line_to, arc_segments, length};

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
fn frame(tip: &TipPose) -> Frame {
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
