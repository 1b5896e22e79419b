//! Mean, deviation, extremes and percentiles of any number of values, with memory that does not depend on their number.

use std::collections::BTreeMap;

use num_bigint::BigUint;
use serde::{Deserialize, Serialize};

/// Number of mantissa bits that determine the bin of a number: 128 bins from each power of two to the next, each 0.4 to
/// 0.8 % wide.
const MANTISSA_BITS: u32 = 7;
/// Number of mantissa bits of an `f64` that do not determine its bin.
const BELOW: u32 = f64::MANTISSA_DIGITS - 1 - MANTISSA_BITS;
/// Lower limit of the bins, 2^-64. Smaller values count as 0. Values above `GREATEST`, which is 2^32, count as
/// `GREATEST`.
const LEAST: f64 = f64::from_bits((1023 - 64) << 52);
const GREATEST: f64 = f64::from_bits((1023 + 32) << 52);

/// Statistics of values that are not negative. Sums are exact, so the result does not depend on the order of the values
/// or the grouping of merges ([`Statistics::merge`]).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Statistics {
    count: u64,
    /// Number of values that were infinite or NaN. If there are any, mean and deviation are NaN.
    not_finite: u64,
    /// Sum of the values, in units of 2^-1074.
    sum: BigUint,
    /// Sum of the squares of the values, in units of 2^-2148.
    squares: BigUint,
    min: f64,
    max: f64,
    /// Number of values in each bin that is not empty. The first bin is for values that count as 0.
    bins: BTreeMap<u16, u64>,
}

/// Binary exponent of the unit of the sums, which is the smallest positive `f64`, 2^-1074.
const UNIT: i32 = -1074;

impl Default for Statistics {
    fn default() -> Self {
        let (sum, squares) = (BigUint::ZERO, BigUint::ZERO);
        Self { count: 0, not_finite: 0, sum, squares, min: f64::MAX, max: 0.0, bins: BTreeMap::new() }
    }
}

fn bin_of(value: f64) -> u16 {
    if value < LEAST {
        return 0;
    }
    1 + ((value.min(GREATEST).to_bits() >> BELOW) - (LEAST.to_bits() >> BELOW)) as u16
}

/// Returns the middle of a bin.
fn middle_of(bin: u16) -> f64 {
    if bin == 0 {
        return 0.0;
    }
    let edge = |bin: u16| f64::from_bits((u64::from(bin) - 1 + (LEAST.to_bits() >> BELOW)) << BELOW);
    0.5 * (edge(bin) + edge(bin.saturating_add(1)))
}

/// Returns `(mantissa, shift)` of a finite number that is not negative. The number equals `mantissa * 2^(shift +
/// UNIT)`.
fn parts(value: f64) -> (u64, u64) {
    let bits = value.to_bits();
    let (exponent, fraction) = (bits >> 52, bits & ((1 << 52) - 1));
    if exponent == 0 { (fraction, 0) } else { (fraction | (1 << 52), exponent - 1) }
}

/// Returns `numerator / denominator * 2^exponent`, rounded to the nearest number. 0 if the denominator is 0.
fn quotient(numerator: &BigUint, denominator: &BigUint, exponent: i32) -> f64 {
    if *denominator == BigUint::ZERO {
        return 0.0;
    }
    // Scale to more bits than a number has.
    let more = (denominator.bits() + 64).saturating_sub(numerator.bits());
    let (scaled, more) = (numerator << more, i32::try_from(more).unwrap_or(i32::MAX));
    let whole = &scaled / denominator;
    let rest = &whole * denominator != scaled;
    let below = whole.bits().saturating_sub(64);
    let head = (&whole >> below).iter_u64_digits().next().unwrap_or(0);
    let sticky = rest || whole.trailing_zeros().is_some_and(|zeros| zeros < below);
    libm::scalbn((head | u64::from(sticky)) as f64, exponent - more + i32::try_from(below).unwrap_or(i32::MAX))
}

impl Statistics {
    /// Maximum relative error of a percentile.
    pub const RESOLUTION: f64 = 0.004;

    /// Adds a value.
    pub fn add(&mut self, value: f64) {
        self.count += 1;
        if value.is_finite() {
            let (mantissa, shift) = parts(value.max(0.0));
            self.sum += BigUint::from(mantissa) << shift;
            self.squares += BigUint::from(u128::from(mantissa) * u128::from(mantissa)) << (2 * shift);
        } else {
            self.not_finite += 1;
        }
        self.min = self.min.min(value);
        self.max = self.max.max(value);
        *self.bins.entry(bin_of(value)).or_default() += 1;
    }

    /// Adds the values of `other`. The result is the same, to the bit, in any order and grouping.
    pub fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.not_finite += other.not_finite;
        self.sum += &other.sum;
        self.squares += &other.squares;
        self.min = self.min.min(other.min);
        self.max = self.max.max(other.max);
        for (bin, more) in &other.bins {
            *self.bins.entry(*bin).or_default() += more;
        }
    }

    /// Returns the number of values.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Reports whether there are no values.
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Returns the mean, rounded once. 0 without values.
    pub fn mean(&self) -> f64 {
        if self.not_finite > 0 { f64::NAN } else { quotient(&self.sum, &self.count.into(), UNIT) }
    }

    /// Returns the standard deviation of the population of which the values are a sample. 0 for fewer than two values.
    pub fn deviation(&self) -> f64 {
        if self.not_finite > 0 {
            return f64::NAN;
        }
        if self.count < 2 {
            return 0.0;
        }
        // It is not negative, by the inequality of Cauchy and Schwarz.
        let spread = &self.squares * self.count - &self.sum * &self.sum;
        quotient(&spread, &(BigUint::from(self.count) * (self.count - 1)), 2 * UNIT).sqrt()
    }

    /// Returns the minimum value. 0 without values.
    pub fn min(&self) -> f64 {
        self.min.min(self.max)
    }

    /// Returns the maximum value. 0 without values.
    pub fn max(&self) -> f64 {
        self.max
    }

    /// Returns the value that this many percent of all values do not exceed, to [`Self::RESOLUTION`].
    pub fn percentile(&self, percent: f64) -> f64 {
        let rank = (percent / 100.0 * self.count as f64).ceil().max(1.0);
        let mut below = 0;
        let bin = self.bins.iter().find(|(_, count)| {
            below += *count;
            below as f64 >= rank
        });
        bin.map_or(0.0, |(bin, _)| middle_of(*bin)).clamp(self.min(), self.max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use growbot_core::random::Rng;
    use proptest::prelude::*;

    fn of(values: &[f64]) -> Statistics {
        let mut statistics = Statistics::default();
        values.iter().for_each(|value| statistics.add(*value));
        statistics
    }

    #[test]
    fn statistics_of_a_few_known_values() {
        let all = of(&[2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0]);
        assert_eq!((all.mean(), all.min(), all.max()), (5.0, 2.0, 9.0));
        assert!((all.deviation() - (32.0_f64 / 7.0).sqrt()).abs() < 1e-15);
        assert!((all.percentile(50.0) / 4.0 - 1.0).abs() <= Statistics::RESOLUTION);
        assert_eq!(all.percentile(100.0), 9.0);
        let one = of(&[0.3]);
        assert_eq!((one.mean(), one.deviation(), one.percentile(50.0), one.percentile(95.0)), (0.3, 0.0, 0.3, 0.3));
        let none = Statistics::default();
        assert_eq!((none.mean(), none.deviation(), none.min(), none.percentile(50.0)), (0.0, 0.0, 0.0, 0.0));
    }

    #[test]
    fn extreme_values_are_counted() {
        for value in [0.0, f64::MIN_POSITIVE, 1e-30, LEAST.next_down(), LEAST, 1.0, GREATEST, GREATEST.next_up(), 1e300]
        {
            let all = of(&[value, value, value]);
            assert_eq!((all.min(), all.max(), all.percentile(50.0)), (value, value, value));
        }
    }

    proptest! {
        #[test]
        fn percentiles_match_the_sorted_values(seed in 0_u64..1000, count in 1_usize..500, spread in 0.0_f64..3.0) {
            let mut random = Rng::new(&[seed]);
            let mut values: Vec<f64> = (0..count).map(|_| libm::exp(spread * random.normal())).collect();
            let all = of(&values);
            values.sort_by(f64::total_cmp);
            for percent in [1.0, 50.0, 95.0, 100.0] {
                let exact = values[((percent / 100.0 * count as f64).ceil() as usize).max(1) - 1];
                prop_assert!((all.percentile(percent) / exact - 1.0).abs() <= Statistics::RESOLUTION);
            }
            let mean = values.iter().sum::<f64>() / count as f64;
            prop_assert!((all.mean() / mean - 1.0).abs() < 1e-12);
        }
    }

    proptest! {
        #[test]
        fn order_and_grouping_do_not_matter(values in proptest::collection::vec(0.0..1e6, 0..60), cut in 0_usize..60) {
            let whole = of(&values);
            let (head, tail) = values.split_at(cut.min(values.len()));
            let (mut backwards, mut parts) = (values.clone(), of(tail));
            backwards.reverse();
            parts.merge(&of(head));
            prop_assert_eq!(&of(&backwards), &whole);
            prop_assert_eq!(&parts, &whole);
        }

        #[test]
        fn mean_and_deviation_are_rounded_once(values in proptest::collection::vec(0_u32..1 << 20, 2..60), exponent in -300..300) {
            let scale = libm::scalbn(1.0, exponent);
            let all = of(&values.iter().map(|value| f64::from(*value) * scale).collect::<Vec<_>>());
            let (sum, squares) = values.iter().fold((0_u128, 0_u128), |(sum, squares), value| {
                (sum + u128::from(*value), squares + u128::from(*value) * u128::from(*value))
            });
            let count = values.len() as u128;
            // Sums of so few values are whole numbers that an f64 can hold.
            prop_assert_eq!(all.mean(), sum as f64 / count as f64 * scale);
            let variance = (count * squares - sum * sum) as f64 / (count * (count - 1)) as f64;
            prop_assert_eq!(all.deviation(), (variance * scale * scale).sqrt());
        }
    }

    #[test]
    fn a_nan_value_makes_the_mean_nan() {
        let all = of(&[1.0, f64::NAN]);
        assert!(all.mean().is_nan() && all.deviation().is_nan());
        assert_eq!((all.count(), all.max()), (2, 1.0));
    }
}
