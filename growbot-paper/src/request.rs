//! The tables, figures and repetitions to reproduce.

use std::ops::RangeInclusive;

use super::paper;

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
    pub fn has_table(&self, number: u8) -> bool {
        self.tables.contains(&number)
    }

    /// Returns true if a figure is requested.
    pub fn has_figure(&self, number: u8) -> bool {
        self.figures.contains(&number)
    }

    /// Returns true if the request needs growths of this robot, an index into [`paper::ROBOTS`].
    pub fn needs_robot(&self, robot: usize) -> bool {
        match robot {
            paper::ROBOT_A => self.has_table(2) || [4, 5, 6, 8].iter().any(|figure| self.has_figure(*figure)),
            paper::B | paper::C => self.has_figure(7) || self.has_figure(8),
            _ => self.has_table(2) || self.has_figure(8),
        }
    }

    /// Returns true if the request needs growths with noise along representative paths.
    pub fn needs_noise(&self) -> bool {
        self.has_figure(6)
    }
}
