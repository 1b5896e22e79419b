//! Values that are compared: means that the paper quotes, with ours, and significance tests.

use growbot_core::plan::Planner;

use super::paper::MeanSd;
use super::statistics::TestResult;

/// A mean that the paper quotes.
#[derive(Debug, Clone, PartialEq)]
pub struct QuotedMean {
    /// Name of the quantity whose mean is quoted.
    pub what: &'static str,
    /// Mean and standard deviation that the paper quotes.
    pub paper: MeanSd,
    /// Number of significant decimals.
    pub decimals: usize,
    /// Means of our simulated growths, one for each slicing rule.
    pub ours: Vec<OurMean>,
    /// Reason for the difference between our means and the paper's.
    pub(super) why: &'static str,
}

/// A mean of our simulated growths, with its standard deviation.
#[derive(Debug, Clone, PartialEq)]
pub struct OurMean {
    /// Slicing rule of the paths.
    pub label: String,
    /// Mean.
    pub mean: f64,
    /// Standard deviation.
    pub sd: f64,
}

/// A significance test for a difference between groups, with the results of two methods.
#[derive(Debug, Clone, PartialEq)]
pub struct SignificanceTest {
    /// Description of the comparison.
    pub what: String,
    /// Slicing rule of the paths.
    pub slicing: String,
    /// Planner of the paths.
    pub planner: Planner,
    /// Number of groups.
    pub groups: usize,
    /// Number of values in all groups.
    pub n: usize,
    /// p-value of the paper. `None` if the paper does not quote one.
    pub paper: Option<f64>,
    /// Result of the test of Kruskal and Wallis, which compares mean ranks. `None` if the values do not permit the
    /// test.
    pub kruskal_wallis: Option<TestResult>,
    /// Result of the one-way analysis of variance, which compares means. `None` if the values do not permit the test.
    pub anova: Option<TestResult>,
}
