//! A search that is complete at its resolution. It tries all sequences of arcs and lines of one length, whose bending
//! directions are spread evenly. Of the sequences that end in the same cell of positions and directions, only the
//! shortest so far is continued.
//!
//! The method follows Fu, Salzman and Alterovitz 2021 ("Toward certifiable motion planning for medical steerable
//! needles", RSS), with growbot's own shortest paths to the goal from every tip.

use std::cmp::Ordering;
use std::collections::{BinaryHeap, HashMap};
use std::f64::consts::TAU;

use growbot_core::trigonometry::sin_cos;
use nalgebra::Vector3;

use super::budget::BudgetTracker;
use super::problem::PlanningProblem;
use super::via_path::ViaPath;
use crate::centreline::{ArcSegment, TipPose, any_perpendicular, arc_and_line_to, length};
use crate::clearance::is_clear;

/// Weight of the remaining way relative to the way so far. With a weight above 1, ways that lead to the goal are tried
/// first.
const HEURISTIC_WEIGHT: f64 = 1.5;

/// Maximum number of nodes of a tree, which take some 500 MB with the queue.
const MAX_NODES: usize = 500_000;

/// Resolution of a search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SearchResolution {
    /// Length of an arc or line, mm.
    pub step: f64,
    /// Number of directions in which a tip may bend.
    pub bend_directions: u32,
    /// Side of a cell of positions, mm. Tips in the same cell are not distinguished.
    pub position: f64,
    /// Side of a cell of directions, radians. Tips in the same cell are not distinguished.
    pub direction: f64,
}

impl SearchResolution {
    /// Returns the resolution of a level. Each level is twice as fine as the previous one. Two bodies that bend to
    /// different sides for one step end in different cells.
    pub(super) fn of_level(problem: &PlanningProblem, level: usize) -> Self {
        let span = (problem.goal.position() - problem.start.position).norm();
        let coarsest = (0.4 * problem.radius).min(0.25 * span).max(0.01 * problem.radius);
        let step = coarsest / f64::from(1_u32 << level);
        let turn = step / problem.radius;
        Self { step, bend_directions: 8 + 4 * level as u32, position: 0.5 * step * turn, direction: 0.5 * turn }
    }
}

/// A node of the tree: a tip that has been reached, and the way from the previous node.
struct SearchNode {
    tip: TipPose,
    /// Index of the previous node. `edge` leads from the previous node to this node.
    parent: u32,
    edge: ArcSegment,
    cost_to_come: f64,
}

/// An arc or line from a node that has not been tried yet.
struct QueueEntry {
    rank: f64,
    /// Estimated length of a body over `edge` to the goal, mm.
    total: f64,
    number: u64,
    node: u32,
    edge: ArcSegment,
}

impl PartialEq for QueueEntry {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for QueueEntry {}

impl PartialOrd for QueueEntry {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl Ord for QueueEntry {
    fn cmp(&self, other: &Self) -> Ordering {
        // A heap returns the greatest element. That must be the lowest rank, and of equal ones the first.
        other.rank.total_cmp(&self.rank).then(other.number.cmp(&self.number))
    }
}

/// The search at one resolution.
pub(super) struct SearchTree {
    /// Resolution of the search.
    pub(super) resolution: SearchResolution,
    nodes: Vec<SearchNode>,
    queue: BinaryHeap<QueueEntry>,
    /// Length of the shortest way to each cell that was reached, mm.
    cells: HashMap<[i32; 6], f64>,
    pushed: u64,
}

impl SearchTree {
    pub(super) fn new(problem: &PlanningProblem, resolution: SearchResolution) -> Self {
        let way = ArcSegment::line(problem.start, 0.0);
        let root = SearchNode { tip: problem.start, parent: 0, edge: way, cost_to_come: 0.0 };
        let mut tree =
            Self { resolution, nodes: vec![root], queue: BinaryHeap::new(), cells: HashMap::new(), pushed: 0 };
        tree.expand(problem, 0, f64::INFINITY);
        tree
    }

    /// Returns true if all arcs and lines have been tried.
    pub(super) fn is_exhausted(&self) -> bool {
        self.queue.is_empty()
    }

    /// Continues the search until the number of distance queries reaches `until`, or a path shorter than `below` (mm)
    /// is found, which is returned.
    pub(super) fn advance(
        &mut self,
        problem: &PlanningProblem,
        meter: &mut BudgetTracker,
        until: u64,
        below: f64,
    ) -> Option<ViaPath> {
        while !meter.check_exhausted_or_at(until) && self.nodes.len() < MAX_NODES {
            let next = self.queue.pop()?;
            meter.work.0 += 1;
            if next.total >= below {
                continue;
            }
            let end = next.edge.end();
            let (cell, gone) = (self.cell(&end), self.nodes.get(next.node as usize)?.cost_to_come + next.edge.length);
            // A blocked way does not reserve its cell.
            if self.cells.get(&cell).is_some_and(|before| *before <= gone)
                || !is_clear(problem.scene, &next.edge, &problem.required_clearance, &mut meter.work)
            {
                continue;
            }
            self.cells.insert(cell, gone);
            let index = self.nodes.len();
            self.nodes.push(SearchNode { tip: end, parent: next.node, edge: next.edge, cost_to_come: gone });
            if let Some(found) = self.connect(problem, index, below, meter) {
                return Some(found);
            }
            self.expand(problem, index, below);
        }
        None
    }

    /// Returns the cell of a tip. The search does not distinguish two tips in one cell.
    fn cell(&self, tip: &TipPose) -> [i32; 6] {
        let at = |value: f64, size: f64| (value / size).floor() as i32;
        let (p, d) = (tip.position, tip.direction);
        let SearchResolution { position, direction, .. } = self.resolution;
        [
            at(p.x, position),
            at(p.y, position),
            at(p.z, position),
            at(d.x, direction),
            at(d.y, direction),
            at(d.z, direction),
        ]
    }

    /// Returns a body over the node `index` to the goal, if it is clear and shorter than `below` (mm).
    fn connect(
        &self,
        problem: &PlanningProblem,
        index: usize,
        below: f64,
        meter: &mut BudgetTracker,
    ) -> Option<ViaPath> {
        let node = self.nodes.get(index)?;
        for way in problem.ways_to_goal(&node.tip) {
            let is_clear =
                |part: &ArcSegment| is_clear(problem.scene, part, &problem.required_clearance, &mut meter.work);
            if node.cost_to_come + length(&way) < below && way.iter().all(is_clear) {
                let found = self.chain(index, way);
                if (problem.accept)(&found) {
                    return Some(found);
                }
            }
        }
        None
    }

    /// Returns the body from the start to the node `index`, followed by `way`.
    fn chain(&self, index: usize, way: Vec<ArcSegment>) -> ViaPath {
        let (mut stretches, mut via, mut at) = (Vec::new(), Vec::new(), index);
        while at > 0
            && let Some(node) = self.nodes.get(at)
        {
            stretches.push(node.edge);
            via.push(node.tip.position);
            at = node.parent as usize;
        }
        stretches.reverse();
        via.reverse();
        stretches.extend(way);
        ViaPath { via, length: length(&stretches), segments: stretches }
    }

    /// Adds the arcs and lines that lead on from the node `index` to the queue, if a body over them can be shorter than
    /// `below` (mm).
    fn expand(&mut self, problem: &PlanningProblem, index: usize, below: f64) {
        let Some(node) = self.nodes.get(index) else { return };
        let (tip, gone) = (node.tip, node.cost_to_come);
        let SearchResolution { step, bend_directions: rolls, .. } = self.resolution;
        let x = any_perpendicular(&tip.direction);
        let y = tip.direction.cross(&x);
        let line = ArcSegment::line(tip, step);
        let arcs = (0..rolls).map(|roll| {
            let (sin, cos) = sin_cos(TAU * f64::from(roll) / f64::from(rolls));
            ArcSegment { from: tip, towards: x * cos + y * sin, curvature: 1.0 / problem.radius, length: step }
        });
        for way in std::iter::once(line).chain(arcs) {
            let left = cost_to_go(problem, &way.end());
            let total = gone + step + left;
            if total < below && total < problem.max_length {
                self.pushed += 1;
                let rank = gone + step + HEURISTIC_WEIGHT * left;
                self.queue.push(QueueEntry { rank, total, number: self.pushed, node: index as u32, edge: way });
            }
        }
    }
}

/// Returns an estimate of the length of the way to the goal, mm. The direction of the goal is ignored.
fn cost_to_go(problem: &PlanningProblem, tip: &TipPose) -> f64 {
    let goal: Vector3<f64> = problem.goal.position();
    match arc_and_line_to(tip, &goal, problem.radius) {
        Some([arc, line]) => (arc.length + line.length - problem.tolerance()).max(0.0),
        None => (goal - tip.position).norm() + 2.0 * problem.radius,
    }
}
