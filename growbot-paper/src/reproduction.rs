//! All results of a request, and the files that hold them.

use super::comparison::Comparison;
use super::experiments::{self, ExperimentError, Experiments};
use super::request::ReproduceRequest;

/// All results of a request.
#[derive(Debug, Clone, PartialEq)]
pub struct Reproduction {
    /// The request.
    pub request: ReproduceRequest,
    /// Growths of the experiments.
    pub experiments: Experiments,
    /// Comparison of our results with the paper's.
    pub comparison: Comparison,
}

impl Reproduction {
    /// Runs the request on `threads` threads. `at` receives the number of finished tasks and the number of all tasks.
    ///
    /// # Errors
    /// Errors of [`experiments::run`].
    pub fn run(request: ReproduceRequest, threads: usize, at: impl FnMut(u64, u64)) -> Result<Self, ExperimentError> {
        let experiments = experiments::run(&request, threads, at)?;
        let comparison = Comparison::of(&experiments);
        Ok(Self { request, experiments, comparison })
    }
}

/// A file of results.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ResultFile {
    /// File name.
    pub name: String,
    /// Contents of the file.
    pub contents: String,
}
