//! The experiments of Del Dottore et al. 2019 (Front. Robot. AI 6:45), done again: Tables 1 to 3 and Figures 4 to 8.
//!
//! | file | what |
//! |---|---|
//! | [`paper`] | the numbers that the paper prints |
//! | [`poses`] | random starts and goals |
//! | [`experiments`], [`slicing_rule`] | the growths: planned, sliced, laid, compared with the goal |
//! | [`statistics`] | means and tests |
//! | [`comparison`], [`table2`] | ours beside the paper's; `differences`, why they differ |
//! | [`tables`], [`summary`] | CSV files and JSON; the summary that is printed |
//! | [`figures`], [`page`] | the figures as SVG; one page of HTML with everything |
//!
//! Every random number comes from a stream that is named by the seed and by what it is drawn for, so that the same seed
//! gives the same bytes on any number of threads.

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

/// The seed where none is given: the year of the paper.
pub const SEED: u64 = 2019;
/// Tables that can be asked for.
pub const TABLES: RangeInclusive<u8> = 1..=3;
/// Figures that can be asked for.
pub const FIGURES: RangeInclusive<u8> = 4..=8;
/// How many repetitions can be asked for: a standard deviation needs two, and all growths stay in memory for the files.
pub const REPEATS: RangeInclusive<usize> = 2..=1000;

/// What is to be reproduced.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Request {
    /// Which tables.
    pub tables: Vec<u8>,
    /// Which figures.
    pub figures: Vec<u8>,
    /// Names all random streams.
    pub seed: u64,
    /// Growths in each group.
    pub repeat: usize,
    /// Growths at each level of noise.
    pub repeat_noise: usize,
}

impl Default for Request {
    /// Everything, as often as in the paper.
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

impl Request {
    /// Whether a table is asked for.
    #[must_use]
    pub fn has_table(&self, number: u8) -> bool {
        self.tables.contains(&number)
    }

    /// Whether a figure is asked for.
    #[must_use]
    pub fn has_figure(&self, number: u8) -> bool {
        self.figures.contains(&number)
    }

    /// Whether anything that is asked for takes growths of this robot, a place in [`paper::ROBOTS`].
    #[must_use]
    pub fn needs_robot(&self, robot: usize) -> bool {
        match robot {
            paper::A => self.has_table(2) || [4, 5, 6, 8].iter().any(|figure| self.has_figure(*figure)),
            paper::B | paper::C => self.has_figure(7) || self.has_figure(8),
            _ => self.has_table(2) || self.has_figure(8),
        }
    }

    /// Whether growths with noise along representative paths are asked for.
    #[must_use]
    pub fn needs_noise(&self) -> bool {
        self.has_figure(6)
    }
}

/// Everything that was asked for.
#[derive(Debug, Clone, PartialEq)]
pub struct Reproduction {
    /// What was asked.
    pub request: Request,
    /// What was grown.
    pub experiments: Experiments,
    /// Ours beside the paper's.
    pub comparison: Comparison,
}

/// A file of results.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ResultFile {
    /// Its name.
    pub name: String,
    /// What is in it.
    pub contents: String,
}

impl Reproduction {
    /// Does it, on `threads` threads. `at` is called with the pieces of work that are done, and with all of them.
    ///
    /// # Errors
    /// As [`experiments::run`].
    pub fn run(request: Request, threads: usize, at: impl FnMut(u64, u64)) -> Result<Self, ExperimentError> {
        let experiments = experiments::run(&request, threads, at)?;
        let comparison = Comparison::of(&experiments);
        Ok(Self { request, experiments, comparison })
    }

    /// All files: every number as CSV, the figures, and the page.
    ///
    /// # Errors
    /// Never yet seen: a number that cannot be written as CSV.
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
