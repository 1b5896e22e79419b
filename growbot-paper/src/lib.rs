//! Reproduction of Tables 1 to 3 and Figures 4 to 8 of Del Dottore et al. 2019 (Front. Robot. AI 6:45).
//!
//! | module | contents |
//! |---|---|
//! | `request`, `reproduction` | the tables and figures to reproduce; all results |
//! | [`paper`] | numbers that the paper prints |
//! | [`poses`] | random starts and goals |
//! | [`experiments`], [`slicing_rule`] | growths: planned, sliced, laid, compared with the goal |
//! | [`statistics`] | means and significance tests |
//! | [`comparison`], [`table2`] | comparison of our results with the paper's; `differences` explains them |
//! | `compared_values` | means that the paper quotes, with ours, and significance tests |
//! | [`tables`], [`summary`] | CSV files and JSON; the printed summary |
//! | `texts` | texts that several outputs share |
//! | [`figures`], [`page`] | figures as SVG; an HTML page with all results |
//!
//! Each random number comes from a stream that is named by the seed and by its purpose. So the same seed gives the same
//! bytes on any number of threads.
//!
//! This crate knows no ports, no boards and no command line: it plans, slices and grows with growbot-core and draws
//! with growbot-pictures.
#![forbid(unsafe_code)]

mod compared_values;
pub mod comparison;
mod differences;
pub mod experiments;
pub mod figures;
pub mod page;
pub mod paper;
pub mod poses;
mod reproduction;
mod request;
pub mod slicing_rule;
pub mod statistics;
pub mod summary;
pub mod table2;
pub mod tables;
mod texts;

pub use reproduction::{Reproduction, ResultFile};
pub use request::{FIGURES, REPEATS, ReproduceRequest, SEED, TABLES};

impl Reproduction {
    /// Returns all files: the numbers as CSV, the figures, and the page. The page states `command`, a command line that
    /// makes these files again.
    pub fn files(&self, command: &str) -> Vec<ResultFile> {
        let figures = figures::all(self);
        let mut files = tables::files(self);
        files.extend(
            figures.iter().map(|figure| ResultFile {
                name: format!("figure{}.svg", figure.number),
                contents: figure.svg.clone(),
            }),
        );
        files.push(ResultFile { name: "report.html".to_owned(), contents: page::html(self, &figures, command) });
        files
    }
}

#[cfg(test)]
mod tests;
