//! Reproduction of Tables 1 to 3 and Figures 4 to 8 of Del Dottore et al. 2019 (Front. Robot. AI 6:45).
//!
//! | module | contents |
//! |---|---|
//! | [`paper`] | numbers that the paper prints |
//! | [`poses`] | random starts and goals |
//! | [`experiments`], [`slicing_rule`] | growths: planned, sliced, laid, compared with the goal |
//! | [`statistics`] | means and significance tests |
//! | [`comparison`], [`table2`] | comparison of our results with the paper's; `differences` explains them |
//! | [`tables`], [`summary`] | CSV files and JSON; the printed summary |
//! | [`figures`], [`page`] | figures as SVG; an HTML page with all results |
//!
//! Each random number comes from a stream that is named by the seed and by its purpose. So the same seed gives the same
//! bytes on any number of threads.

pub mod comparison;
mod differences;
pub mod experiments;
pub mod figures;
pub mod page;
pub mod paper;
pub mod poses;
pub mod slicing_rule;
pub mod statistics;
pub mod summary;
pub mod table2;
pub mod tables;

use std::ops::RangeInclusive;

use comparison::Comparison;
use experiments::{ExperimentError, Experiments};

/// Default seed: the year of the paper.
pub const SEED: u64 = 2019;
/// Numbers of the tables that can be requested.
pub const TABLES: RangeInclusive<u8> = 1..=3;
/// Numbers of the figures that can be requested.
pub const FIGURES: RangeInclusive<u8> = 4..=8;
/// Numbers of repetitions that can be requested. A standard deviation needs two, and all growths stay in memory until
/// the files are written.
pub const REPEATS: RangeInclusive<usize> = 2..=1000;

/// Tables, figures and repetitions to reproduce.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReproduceRequest {
    /// Numbers of the tables.
    pub tables: Vec<u8>,
    /// Numbers of the figures.
    pub figures: Vec<u8>,
    /// Seed in the names of all random streams.
    pub seed: u64,
    /// Number of growths in each group.
    pub repeat: usize,
    /// Number of growths at each level of noise.
    pub repeat_noise: usize,
}

impl Default for ReproduceRequest {
    /// Returns a request for all tables and figures, with as many repetitions as in the paper.
    fn default() -> Self {
        Self {
            tables: TABLES.collect(),
            figures: FIGURES.collect(),
            seed: SEED,
            repeat: paper::REPEAT,
            repeat_noise: paper::REPEAT_NOISE,
        }
    }
}

impl ReproduceRequest {
    /// Returns true if a table is requested.
    #[must_use]
    pub fn has_table(&self, number: u8) -> bool {
        self.tables.contains(&number)
    }

    /// Returns true if a figure is requested.
    #[must_use]
    pub fn has_figure(&self, number: u8) -> bool {
        self.figures.contains(&number)
    }

    /// Returns true if the request needs growths of this robot, an index into [`paper::ROBOTS`].
    #[must_use]
    pub fn needs_robot(&self, robot: usize) -> bool {
        match robot {
            paper::ROBOT_A => self.has_table(2) || [4, 5, 6, 8].iter().any(|figure| self.has_figure(*figure)),
            paper::B | paper::C => self.has_figure(7) || self.has_figure(8),
            _ => self.has_table(2) || self.has_figure(8),
        }
    }

    /// Returns true if the request needs growths with noise along representative paths.
    #[must_use]
    pub fn needs_noise(&self) -> bool {
        self.has_figure(6)
    }
}

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

/// A file of results.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ResultFile {
    /// File name.
    pub name: String,
    /// Contents of the file.
    pub contents: String,
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

    /// Returns all files: the numbers as CSV, the figures, and the page.
    ///
    /// # Errors
    /// A number that cannot be written as CSV. This has never occurred.
    pub fn files(&self) -> Result<Vec<ResultFile>, csv::Error> {
        let figures = figures::all(self);
        let mut files = tables::files(self)?;
        files.extend(
            figures.iter().map(|figure| ResultFile {
                name: format!("figure{}.svg", figure.number),
                contents: figure.svg.clone(),
            }),
        );
        files.push(ResultFile { name: "report.html".to_owned(), contents: page::html(self, &figures) });
        Ok(files)
    }
}

#[cfg(test)]
mod tests;
