//! A job: the layers of a path in the form that the board receives, and the hashes that identify them.

use crate::hash::Hasher;
use crate::layer_bytes::{LayerBytes, LayerEncoder};
use crate::path::Segment;
use crate::robot::Robot;
use crate::slicing::{SlicedLayers, Slicing, layers_with_keep_alive};

/// Iterator over the layers of a path as bytes, in order.
#[derive(Debug, Clone)]
pub struct JobLayers<'a> {
    layers: SlicedLayers<'a>,
    encoder: LayerEncoder,
    robot: &'a Robot,
}

/// Max number of layers of a job. The journal of each of the three kinds of board can store that many.
pub const MAX_JOB_LAYERS: u32 = 6143;

/// Returns an iterator over the layers of a path as bytes, sliced with [`Slicing::Exact`].
pub fn job_layers<'a>(path: &'a [Segment], robot: &'a Robot) -> JobLayers<'a> {
    job_layers_with_keep_alive(path, robot, &mut || ())
}

/// Like [`job_layers`], but calls `keep_alive` as [`layers_with_keep_alive`] does, so that a board can feed its
/// watchdog.
pub fn job_layers_with_keep_alive<'a>(
    path: &'a [Segment],
    robot: &'a Robot,
    keep_alive: &mut dyn FnMut(),
) -> JobLayers<'a> {
    JobLayers {
        layers: layers_with_keep_alive(path, robot, Slicing::Exact, keep_alive),
        encoder: LayerEncoder::default(),
        robot,
    }
}

impl Iterator for JobLayers<'_> {
    type Item = LayerBytes;

    fn next(&mut self) -> Option<LayerBytes> {
        self.layers.next().map(|sliced| self.encoder.encode_clamped(&sliced.layer, self.robot.tip_radius()))
    }

    fn size_hint(&self) -> (usize, Option<usize>) {
        self.layers.size_hint()
    }
}

/// The hashes and the number of a job's layers. The hashes identify the job, and they prove that host and board have
/// computed the same layers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct JobSummary {
    /// Identifier of the job on the link: the hash of the robot's hash and of the bytes of all layers. It is never 0,
    /// because 0 stands for the absence of a job.
    pub plan_id: u64,
    /// Hash of alpha, height and tilt of all layers as `f64`, before they are rounded to bytes.
    pub exact_hash: u64,
    /// Number of layers.
    pub layers: u32,
}

impl JobLayers<'_> {
    /// Returns the hashes and the number of these layers.
    pub fn summary(&self) -> JobSummary {
        self.summary_with_keep_alive(&mut || ())
    }

    /// Like [`JobLayers::summary`], but calls `keep_alive` for each layer so that a board can feed its watchdog.
    pub fn summary_with_keep_alive(&self, keep_alive: &mut dyn FnMut()) -> JobSummary {
        let (mut name, mut exact) = (PlanIdHasher::new(self.robot), Hasher::default());
        let mut encoder = self.encoder.clone();
        let mut count = 0;
        for sliced in self.layers.clone() {
            keep_alive();
            name.layer(&encoder.encode_clamped(&sliced.layer, self.robot.tip_radius()));
            exact.write_f64(sliced.layer.alpha);
            exact.write_f64(sliced.layer.height);
            exact.write_f64(sliced.layer.tilt);
            count += 1;
        }
        JobSummary { plan_id: name.finish(), exact_hash: exact.finish(), layers: count }
    }
}

/// Hasher that computes the identifier of a job: the hash of the robot's hash and of the bytes of all layers.
struct PlanIdHasher(Hasher);

impl PlanIdHasher {
    fn new(robot: &Robot) -> Self {
        let mut hasher = Hasher::default();
        hasher.write_bytes(&robot.hash().to_le_bytes());
        Self(hasher)
    }

    fn layer(&mut self, layer: &LayerBytes) {
        self.0.write_bytes(layer);
    }

    /// Returns the identifier of the job. It is never 0, because 0 stands for the absence of a job.
    fn finish(self) -> u64 {
        self.0.finish().max(1)
    }
}

/// Returns the identifier of the job that consists of these layers ([`JobSummary::plan_id`]).
pub fn plan_id(robot: &Robot, layers: &[LayerBytes]) -> u64 {
    let mut name = PlanIdHasher::new(robot);
    layers.iter().for_each(|layer| name.layer(layer));
    name.finish()
}

/// Returns the hashes and the number of a path's layers.
pub fn summarize(path: &[Segment], robot: &Robot) -> JobSummary {
    job_layers(path, robot).summary()
}
