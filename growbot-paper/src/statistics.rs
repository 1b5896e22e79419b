//! Means, tests for a difference between groups, and tests for the equivalence of two means.

use statrs::distribution::{ChiSquared, ContinuousCDF, StudentsT};
use statrs::stats_tests::NaNPolicy;
use statrs::stats_tests::f_oneway::f_oneway;

/// Summary statistics of a sample.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct SampleSummary {
    /// Number of values.
    pub n: usize,
    /// Mean.
    pub mean: f64,
    /// Standard deviation with the divisor `n - 1`. 0 for a single value.
    pub sd: f64,
    /// Median.
    pub median: f64,
    /// 95th percentile, interpolated.
    pub p95: f64,
}

impl SampleSummary {
    /// Computes the statistics of these values, which can be in any order. All numbers are 0 without values.
    pub fn of(values: &[f64]) -> Self {
        let n = values.len();
        if n == 0 {
            return Self { n, mean: 0.0, sd: 0.0, median: 0.0, p95: 0.0 };
        }
        let mean = values.iter().sum::<f64>() / n as f64;
        let squares: f64 = values.iter().map(|value| (value - mean) * (value - mean)).sum();
        let sd = if n > 1 { libm::sqrt(squares / (n - 1) as f64) } else { 0.0 };
        let mut sorted = values.to_vec();
        sorted.sort_by(f64::total_cmp);
        Self { n, mean, sd, median: quantile(&sorted, 0.5), p95: quantile(&sorted, 0.95) }
    }
}

/// Returns the value below which this share of a sorted sample lies, interpolated.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let place = share * (sorted.len() - 1) as f64;
    let below = place as usize;
    let above = (below + 1).min(sorted.len() - 1);
    sorted[below] + (place - below as f64) * (sorted[above] - sorted[below])
}

/// Result of a test: its statistic, and the probability of one at least as large if the groups do not differ.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct TestResult {
    /// Statistic: H of Kruskal and Wallis, F, or t.
    pub statistic: f64,
    /// p-value.
    pub p: f64,
}

/// Significance level of all tests: the probability of a false finding.
pub const LEVEL: f64 = 0.05;

/// Comparison of two means, each with its standard deviation and number of values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeanComparison {
    /// Test of Welch 1947: t, and the two-sided p-value for equal means.
    pub welch: TestResult,
    /// Degrees of freedom of Welch and Satterthwaite.
    pub degrees_of_freedom: f64,
    /// p-value of [`Self::welch`], corrected by Holm for all comparisons of its family.
    pub p_holm: f64,
    /// p-value of two one-sided tests (Schuirmann 1987) for means that are further apart than the margin of
    /// equivalence.
    pub tost_p: f64,
    /// [`Self::tost_p`], corrected by Holm in its own family.
    pub tost_p_holm: f64,
}

impl MeanComparison {
    /// Compares two samples, given as n, mean and standard deviation, with a margin of equivalence. The p-values are
    /// not yet corrected. `None` if a sample has fewer than two values or neither has any spread.
    pub fn of(one: (usize, f64, f64), other: (usize, f64, f64), margin: f64) -> Option<Self> {
        let [a, b] = [one, other].map(|(n, _, sd)| sd * sd / n as f64);
        let error = libm::sqrt(a + b);
        if one.0 < 2 || other.0 < 2 || error == 0.0 {
            return None;
        }
        let degrees_of_freedom = (a + b) * (a + b) / (a * a / (one.0 - 1) as f64 + b * b / (other.0 - 1) as f64);
        let students = StudentsT::new(0.0, 1.0, degrees_of_freedom).ok()?;
        let difference = one.1 - other.1;
        let t = difference / error;
        let p = (2.0 * students.sf(t.abs())).min(1.0);
        let tost_p = students.sf((margin - difference.abs()) / error);
        Some(Self { welch: TestResult { statistic: t, p }, degrees_of_freedom, p_holm: p, tost_p, tost_p_holm: tost_p })
    }

    /// Returns true if the means differ at [`LEVEL`], after the correction.
    pub fn differs(&self) -> bool {
        self.p_holm < LEVEL
    }

    /// Returns true if the means are equivalent at [`LEVEL`], after the correction: they are not further apart than
    /// the margin.
    pub fn is_equivalent(&self) -> bool {
        self.tost_p_holm < LEVEL
    }
}

/// Returns the p-values of one family, corrected by Holm 1979. The probability of any false finding then stays at the
/// level.
pub fn holm(p_values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..p_values.len()).collect();
    order.sort_by(|a, b| p_values[*a].total_cmp(&p_values[*b]));
    let mut corrected = vec![0.0; p_values.len()];
    let mut at_least: f64 = 0.0;
    for (place, index) in order.into_iter().enumerate() {
        at_least = at_least.max(((p_values.len() - place) as f64 * p_values[index]).min(1.0));
        corrected[index] = at_least;
    }
    corrected
}

/// Tests by Kruskal and Wallis 1952 whether the mean ranks of groups differ. H is corrected for ties, and the p-value
/// follows from the chi-squared distribution. `None` for fewer than two groups, an empty group, or only ties.
pub fn kruskal_wallis(groups: &[&[f64]]) -> Option<TestResult> {
    if groups.len() < 2 || groups.iter().any(|group| group.is_empty()) {
        return None;
    }
    let mut values: Vec<(f64, usize)> =
        groups.iter().enumerate().flat_map(|(group, values)| values.iter().map(move |value| (*value, group))).collect();
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let n = values.len() as f64;
    let (mut rank_sums, mut ties, mut before) = (vec![0.0; groups.len()], 0.0, 0.0);
    for tied in values.chunk_by(|a, b| a.0 == b.0) {
        let count = tied.len() as f64;
        for (_, group) in tied {
            rank_sums[*group] += before + 0.5 * (count + 1.0);
        }
        ties += count * count * count - count;
        before += count;
    }
    let correction = 1.0 - ties / (n * n * n - n);
    if correction <= 0.0 {
        return None;
    }
    let squares: f64 = rank_sums.iter().zip(groups).map(|(sum, group)| sum * sum / group.len() as f64).sum();
    let h = (12.0 / (n * (n + 1.0)) * squares - 3.0 * (n + 1.0)) / correction;
    let chi_squared = ChiSquared::new((groups.len() - 1) as f64).ok()?;
    Some(TestResult { statistic: h, p: chi_squared.sf(h.max(0.0)) })
}

/// Tests by one-way analysis of variance whether the means of groups differ. `None` if the groups have no variance to
/// compare with.
pub fn anova(groups: &[&[f64]]) -> Option<TestResult> {
    let samples = groups.iter().map(|group| group.to_vec()).collect();
    let (statistic, p) = f_oneway(samples, NaNPolicy::Error).ok()?;
    (statistic.is_finite() && p.is_finite()).then_some(TestResult { statistic, p })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sample_summary_has_the_expected_values() {
        let summary = SampleSummary::of(&[4.0, 1.0, 3.0, 2.0]);
        assert_eq!((summary.n, summary.mean, summary.median), (4, 2.5, 2.5));
        assert!((summary.sd - libm::sqrt(5.0 / 3.0)).abs() < 1e-15 && (summary.p95 - 3.85).abs() < 1e-12);
        assert_eq!(SampleSummary::of(&[7.0]), SampleSummary { n: 1, mean: 7.0, sd: 0.0, median: 7.0, p95: 7.0 });
        assert_eq!(SampleSummary::of(&[]).n, 0);
    }

    /// The expected values come from scipy 1.16.3: `stats.ttest_ind_from_stats(equal_var=False)`, and `stats.t.sf` of
    /// the margin minus the difference, divided by the standard error.
    #[test]
    fn welch_and_tost_match_scipy() {
        for (one, other, margin, [t, df, p, tost_p]) in [
            (
                (50, 0.0044, 0.0017),
                (50, 0.0025, 0.001),
                0.001,
                [6.811_830_024_129_71, 79.284_107_312_796_05, 1.684_089_691_089_491_8e-9, 0.999_089_311_573_856_6],
            ),
            (
                (7, 3.1, 1.2),
                (12, 2.5, 0.4),
                1.5,
                [1.281_982_160_901_455_7, 6.787_430_597_676_48, 0.241_897_211_149_052_83, 0.048_606_689_077_614_47],
            ),
            (
                (3, 1.0, 0.5),
                (4, 1.01, 0.6),
                1.0,
                [-0.024_019_223_070_763_093, 4.867_686_768_676_869, 0.981_790_689_770_371_9, 0.032_356_783_850_148_81],
            ),
        ] {
            let tests = MeanComparison::of(one, other, margin).unwrap();
            let found = [tests.welch.statistic, tests.degrees_of_freedom, tests.welch.p, tests.tost_p];
            for (found, scipy) in found.into_iter().zip([t, df, p, tost_p]) {
                assert!((found / scipy - 1.0).abs() < 1e-9, "{found} is {scipy} in scipy");
            }
        }
        assert_eq!(MeanComparison::of((1, 1.0, 0.0), (50, 1.0, 0.1), 0.1), None);
        assert_eq!(MeanComparison::of((50, 1.0, 0.0), (50, 1.0, 0.0), 0.1), None);
    }

    /// The expected values come from R: `p.adjust(c(0.01, 0.04, 0.03, 0.005), "holm")`.
    #[test]
    fn holm_correction_matches_r() {
        let corrected = holm(&[0.01, 0.04, 0.03, 0.005]);
        assert!(
            corrected.iter().zip([0.03, 0.06, 0.06, 0.02]).all(|(found, r)| (found - r).abs() < 1e-15),
            "{corrected:?}"
        );
        assert_eq!((holm(&[0.9, 0.8]), holm(&[])), (vec![1.0, 1.0], vec![]));
    }

    /// The example is from Hollander and Wolfe 1973, p. 116, as in the documentation of R's `kruskal.test`: H =
    /// 0.77143, 2 degrees of freedom, p = 0.68.
    #[test]
    fn kruskal_wallis_matches_r() {
        let test =
            kruskal_wallis(&[&[2.9, 3.0, 2.5, 2.6, 3.2], &[3.8, 2.7, 4.0, 2.4], &[2.8, 3.4, 3.7, 2.2, 2.0]]).unwrap();
        assert!((test.statistic - 0.771_43).abs() < 1e-5 && (test.p - 0.68).abs() < 1e-3, "{test:?}");
    }

    /// The expected values come from scipy.stats.kruskal([1, 1, 1], [2, 2, 2], [2, 2]): H = 7.0, p =
    /// 0.0301973834223185.
    #[test]
    fn ties_are_corrected_for() {
        let test = kruskal_wallis(&[&[1.0, 1.0, 1.0], &[2.0, 2.0, 2.0], &[2.0, 2.0]]).unwrap();
        assert!((test.statistic - 7.0).abs() < 1e-12 && (test.p - 0.030_197_383_422_318_5).abs() < 1e-12, "{test:?}");
        assert_eq!(kruskal_wallis(&[&[1.0, 1.0], &[1.0]]), None);
        assert_eq!(kruskal_wallis(&[&[1.0], &[]]), None);
    }

    /// The example is from https://en.wikipedia.org/wiki/One-way_analysis_of_variance: F = 9.3, p = 0.002.
    #[test]
    fn anova_matches_a_textbook_example() {
        let groups: [&[f64]; 3] =
            [&[6.0, 8.0, 4.0, 5.0, 3.0, 4.0], &[8.0, 12.0, 9.0, 11.0, 6.0, 8.0], &[13.0, 9.0, 11.0, 8.0, 7.0, 12.0]];
        let test = anova(&groups).unwrap();
        assert!((test.statistic - 9.264_7).abs() < 1e-3 && (test.p - 0.002_4).abs() < 1e-4, "{test:?}");
        assert_eq!(anova(&[&[1.0, 1.0], &[1.0, 1.0]]), None);
    }
}
