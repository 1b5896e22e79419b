//! Mean, deviation, extremes and percentiles of any number of values, in a memory that does not grow with them.

/// Bits of a number's mantissa that tell its bin: 128 bins from each power of two to the next, each 0.4 to 0.8 % wide.
const MANTISSA_BITS: u32 = 7;
/// Bits of an `f64` below those.
const BELOW: u32 = f64::MANTISSA_DIGITS - 1 - MANTISSA_BITS;
/// What is smaller is taken for 0, and what is larger for this: 2^-64 and 2^32.
const LEAST: f64 = f64::from_bits((1023 - 64) << 52);
const GREATEST: f64 = f64::from_bits((1023 + 32) << 52);

/// The statistics of values that are not negative. The order in which they are added decides the last digits of mean
/// and deviation.
#[derive(Debug, Clone, PartialEq)]
pub struct Statistics {
    count: u64,
    mean: f64,
    /// Sum of the squared differences from the mean.
    squares: f64,
    min: f64,
    max: f64,
    /// How many values lie in each bin; the first one is for what counts as 0.
    bins: Box<[u64]>,
}

impl Default for Statistics {
    fn default() -> Self {
        let bins = vec![0; bin_of(GREATEST) + 1].into();
        Self { count: 0, mean: 0.0, squares: 0.0, min: f64::INFINITY, max: 0.0, bins }
    }
}

fn bin_of(value: f64) -> usize {
    if value < LEAST {
        return 0;
    }
    1 + ((value.min(GREATEST).to_bits() >> BELOW) - (LEAST.to_bits() >> BELOW)) as usize
}

/// The middle of a bin.
fn middle_of(bin: usize) -> f64 {
    if bin == 0 {
        return 0.0;
    }
    let edge = |bin: usize| f64::from_bits((bin as u64 - 1 + (LEAST.to_bits() >> BELOW)) << BELOW);
    0.5 * (edge(bin) + edge(bin + 1))
}

impl Statistics {
    /// How far off a percentile may be, a share of it.
    pub const RESOLUTION: f64 = 0.004;

    /// Takes in a further value (Welford 1962).
    pub fn add(&mut self, value: f64) {
        self.count += 1;
        let off = value - self.mean;
        self.mean += off / self.count as f64;
        self.squares += off * (value - self.mean);
        self.min = self.min.min(value);
        self.max = self.max.max(value);
        if let Some(bin) = self.bins.get_mut(bin_of(value)) {
            *bin += 1;
        }
    }

    /// Whether there is no value.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// The mean; 0 of no values.
    #[must_use]
    pub fn mean(&self) -> f64 {
        self.mean
    }

    /// The standard deviation of the population that the values are a sample of; 0 of fewer than two.
    #[must_use]
    pub fn deviation(&self) -> f64 {
        if self.count < 2 { 0.0 } else { (self.squares / (self.count - 1) as f64).sqrt() }
    }

    /// The min value.
    #[must_use]
    pub fn min(&self) -> f64 {
        self.min.min(self.max)
    }

    /// The max value.
    #[must_use]
    pub fn max(&self) -> f64 {
        self.max
    }

    /// The value that this many percent of all values do not pass, to [`Self::RESOLUTION`].
    #[must_use]
    pub fn percentile(&self, percent: f64) -> f64 {
        let rank = (percent / 100.0 * self.count as f64).ceil().max(1.0);
        let mut below = 0;
        let bin = self.bins.iter().position(|count| {
            below += count;
            below as f64 >= rank
        });
        bin.map_or(0.0, middle_of).clamp(self.min(), self.max)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use growbot_core::random::Random;
    use proptest::prelude::*;

    fn of(values: &[f64]) -> Statistics {
        let mut statistics = Statistics::default();
        values.iter().for_each(|value| statistics.add(*value));
        statistics
    }

    #[test]
    fn a_few_values_by_hand() {
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
    fn nothing_is_too_small_or_too_large_to_be_counted() {
        for value in [0.0, f64::MIN_POSITIVE, 1e-30, LEAST.next_down(), LEAST, 1.0, GREATEST, GREATEST.next_up(), 1e300]
        {
            let all = of(&[value, value, value]);
            assert_eq!((all.min(), all.max(), all.percentile(50.0)), (value, value, value));
        }
    }

    proptest! {
        #[test]
        fn percentiles_are_those_of_the_sorted_values(seed in 0_u64..1000, count in 1_usize..500, spread in 0.0_f64..3.0) {
            let mut random = Random::new(&[seed]);
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
}
