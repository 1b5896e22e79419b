//! Means, and whether groups differ by more than chance.

use statrs::distribution::{ChiSquared, ContinuousCDF};
use statrs::stats_tests::NaNPolicy;
use statrs::stats_tests::f_oneway::f_oneway;

/// A sample in a few numbers.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Summary {
    /// How many values.
    pub n: usize,
    /// Mean.
    pub mean: f64,
    /// Standard deviation, by `n - 1`; 0 for a single value.
    pub sd: f64,
    /// Median.
    pub median: f64,
    /// 95th percentile, interpolated.
    pub p95: f64,
}

impl Summary {
    /// Of these values, in any order. All numbers are 0 where there are none.
    #[must_use]
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

/// The value below which this share of a sorted sample lies, interpolated.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let place = share * (sorted.len() - 1) as f64;
    let below = place as usize;
    let above = (below + 1).min(sorted.len() - 1);
    sorted[below] + (place - below as f64) * (sorted[above] - sorted[below])
}

/// What a test says: its statistic, and the chance of one as large where the groups do not differ.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Test {
    /// H of Kruskal and Wallis, or F.
    pub statistic: f64,
    /// The p-value.
    pub p: f64,
}

/// Kruskal and Wallis 1952: whether the mean ranks of groups differ; H is corrected for ties, and p by chi squared.
/// None where there are fewer than two groups, an empty one, or nothing but ties.
#[must_use]
pub fn kruskal_wallis(groups: &[&[f64]]) -> Option<Test> {
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
    Some(Test { statistic: h, p: chi_squared.sf(h.max(0.0)) })
}

/// One-way analysis of variance: whether the means of groups differ. None where the groups have no variance to compare
/// with.
#[must_use]
pub fn anova(groups: &[&[f64]]) -> Option<Test> {
    let samples = groups.iter().map(|group| group.to_vec()).collect();
    let (statistic, p) = f_oneway(samples, NaNPolicy::Error).ok()?;
    (statistic.is_finite() && p.is_finite()).then_some(Test { statistic, p })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_in_a_few_numbers() {
        let summary = Summary::of(&[4.0, 1.0, 3.0, 2.0]);
        assert_eq!((summary.n, summary.mean, summary.median), (4, 2.5, 2.5));
        assert!((summary.sd - libm::sqrt(5.0 / 3.0)).abs() < 1e-15 && (summary.p95 - 3.85).abs() < 1e-12);
        assert_eq!(Summary::of(&[7.0]), Summary { n: 1, mean: 7.0, sd: 0.0, median: 7.0, p95: 7.0 });
        assert_eq!(Summary::of(&[]).n, 0);
    }

    /// Hollander and Wolfe 1973, p. 116, as in the documentation of R's `kruskal.test`: H = 0.77143, 2 degrees of
    /// freedom, p = 0.68.
    #[test]
    fn kruskal_and_wallis_as_in_r() {
        let test =
            kruskal_wallis(&[&[2.9, 3.0, 2.5, 2.6, 3.2], &[3.8, 2.7, 4.0, 2.4], &[2.8, 3.4, 3.7, 2.2, 2.0]]).unwrap();
        assert!((test.statistic - 0.771_43).abs() < 1e-5 && (test.p - 0.68).abs() < 1e-3, "{test:?}");
    }

    /// scipy.stats.kruskal([1, 1, 1], [2, 2, 2], [2, 2]): H = 7.0, p = 0.0301973834223185.
    #[test]
    fn ties_are_corrected_for() {
        let test = kruskal_wallis(&[&[1.0, 1.0, 1.0], &[2.0, 2.0, 2.0], &[2.0, 2.0]]).unwrap();
        assert!((test.statistic - 7.0).abs() < 1e-12 && (test.p - 0.030_197_383_422_318_5).abs() < 1e-12, "{test:?}");
        assert_eq!(kruskal_wallis(&[&[1.0, 1.0], &[1.0]]), None);
        assert_eq!(kruskal_wallis(&[&[1.0], &[]]), None);
    }

    /// The table of https://en.wikipedia.org/wiki/One-way_analysis_of_variance: F = 9.3, p = 0.002.
    #[test]
    fn analysis_of_variance_of_the_textbook() {
        let groups: [&[f64]; 3] =
            [&[6.0, 8.0, 4.0, 5.0, 3.0, 4.0], &[8.0, 12.0, 9.0, 11.0, 6.0, 8.0], &[13.0, 9.0, 11.0, 8.0, 7.0, 12.0]];
        let test = anova(&groups).unwrap();
        assert!((test.statistic - 9.264_7).abs() < 1e-3 && (test.p - 0.002_4).abs() < 1e-4, "{test:?}");
        assert_eq!(anova(&[&[1.0, 1.0], &[1.0, 1.0]]), None);
    }
}
