//! The known part of a body: as built, layer by layer, and as planned.

use std::iter::once;

use growbot_core::layer::{Layer, grow};
use growbot_core::pose::{Frame, Pose};

use crate::plan_deviation::centreline;

/// Maximum number of consecutive layers whose reports may be lost, if the plan of the job.
const MAX_UNREPORTED: usize = 65_536;

/// Coordinates of a point: x, y, z, mm.
pub type BodyPoint = [f64; 3];

/// The body of one job, as planned and as built so far.
pub struct TrackedBody {
    plan_id: u64,
    planned: Vec<Layer>,
    planned_points: Vec<BodyPoint>,
    /// Index of the first layer whose report was received. Earlier layers are not known.
    first: u32,
    built: Vec<Layer>,
    points: Vec<BodyPoint>,
    tip: Frame,
    unreported: u32,
}

impl TrackedBody {
    /// Creates a body without layers, which begins at [`Pose::UPRIGHT`]. `planned` is empty if the console does not know
    /// the plan.
    pub fn new(plan_id: u64, planned: Vec<Layer>) -> Self {
        let tip = Pose::UPRIGHT.frame();
        let planned_points = centreline(&tip, planned.iter().copied()).into_iter().map(Into::into).collect();
        Self {
            plan_id,
            planned,
            planned_points,
            first: 0,
            built: Vec::new(),
            points: vec![point(&tip)],
            tip,
            unreported: 0,
        }
    }

    /// Starts the same job again from its beginning.
    pub fn begin_again(&mut self) {
        *self = Self::new(self.plan_id, std::mem::take(&mut self.planned));
    }

    /// Adds a reported layer. Earlier layers whose reports were lost are assumed to be as planned, or, without a
    /// plan, to be even layers of height `full` (mm).
    pub fn add_layer(&mut self, index: u32, layer: Layer, full: f64) {
        let known = self.planned.len().max(self.built.len().saturating_add(MAX_UNREPORTED));
        let is_far = !self.built.is_empty() && (index.saturating_sub(self.first) as usize) > known;
        if is_far || index == u32::MAX {
            // No board can have laid that many layers since, so the index is ignored.
            return;
        }
        if self.built.is_empty() {
            self.first = index;
        }
        while self.next() < index {
            let planned = self.planned.get(self.next() as usize).copied();
            self.put(planned.unwrap_or(Layer { height: full, ..Layer::default() }));
            self.unreported += 1;
        }
        if self.next() == index {
            self.put(layer);
        }
    }

    fn put(&mut self, layer: Layer) {
        self.tip = grow(&self.tip, once(layer));
        self.built.push(layer);
        self.points.push(point(&self.tip));
    }

    /// Returns the identifier of the job's plan.
    pub fn plan_id(&self) -> u64 {
        self.plan_id
    }

    /// Returns the index of the next expected layer.
    pub fn next(&self) -> u32 {
        self.first.saturating_add(self.built.len() as u32)
    }

    /// Returns the index of the first known layer.
    pub fn first(&self) -> u32 {
        self.first
    }

    /// Returns the number of layers whose reports were lost.
    pub fn unreported(&self) -> u32 {
        self.unreported
    }

    /// Returns the layers as built, from the first known one.
    pub fn built(&self) -> &[Layer] {
        &self.built
    }

    /// Returns the positions of the tip before the first known layer, and after each layer.
    pub fn points(&self) -> &[BodyPoint] {
        &self.points
    }

    /// Returns the planned positions of the tip before the first layer, and after each layer. Without a known plan,
    /// only the first position is returned.
    pub fn planned_points(&self) -> &[BodyPoint] {
        &self.planned_points
    }

    /// Returns the present pose of the tip.
    pub fn tip(&self) -> Pose {
        Pose::from_frame(&self.tip)
    }
}

fn point(frame: &Frame) -> BodyPoint {
    frame.translation.vector.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn even(height: f64) -> Layer {
        Layer { height, ..Layer::default() }
    }

    #[test]
    fn layers_are_added_once_despite_repeated_reports() {
        let mut body = TrackedBody::new(1, Vec::new());
        body.add_layer(0, even(0.7), 0.774);
        body.add_layer(1, even(0.8), 0.774);
        body.add_layer(1, even(0.8), 0.774);
        assert_eq!((body.built().len(), body.next(), body.unreported()), (2, 2, 0));
        assert!((body.tip().position().z - 1.5).abs() < 1e-12);
    }

    #[test]
    fn impossible_layer_indices_are_ignored() {
        let mut body = TrackedBody::new(1, Vec::new());
        body.add_layer(u32::MAX, even(0.7), 0.774);
        assert_eq!((body.built().len(), body.next()), (0, 0));
        body.add_layer(0, even(0.7), 0.774);
        for far in [u32::MAX, u32::MAX - 1, 1 << 20] {
            body.add_layer(far, even(0.7), 0.774);
        }
        assert_eq!((body.built().len(), body.unreported()), (1, 0));
        let mut body = TrackedBody::new(1, Vec::new());
        for index in [u32::MAX - 2, u32::MAX - 1, u32::MAX] {
            body.add_layer(index, even(0.7), 0.774);
        }
        assert_eq!(body.next(), u32::MAX);
    }

    #[test]
    fn a_lost_report_counts_as_the_planned_or_a_full_layer() {
        let mut body = TrackedBody::new(1, vec![even(0.5); 3]);
        body.add_layer(0, even(0.7), 0.774);
        body.add_layer(2, even(0.7), 0.774);
        body.add_layer(4, even(0.7), 0.774);
        assert_eq!(body.unreported(), 2);
        assert!((body.tip().position().z - (3.0 * 0.7 + 0.5 + 0.774)).abs() < 1e-12);
        assert!((body.planned_points()[3][2] - 1.5).abs() < 1e-12);
    }

    #[test]
    fn tracking_may_start_at_a_later_layer() {
        let mut body = TrackedBody::new(1, Vec::new());
        body.add_layer(100, even(0.7), 0.774);
        assert_eq!((body.first(), body.next(), body.built().len()), (100, 101, 1));
    }
}
