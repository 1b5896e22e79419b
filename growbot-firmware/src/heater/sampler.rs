//! Oversampling: the mean of all conversions of a period.

/// Adds up conversions of the converter.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sampler {
    sum: u32,
    count: u16,
}

impl Sampler {
    /// Takes a conversion, 0 to 4095.
    pub fn take(&mut self, raw: u16) {
        if let (Some(sum), Some(count)) = (self.sum.checked_add(u32::from(raw)), self.count.checked_add(1)) {
            (self.sum, self.count) = (sum, count);
        }
    }

    /// The mean of those taken since it was last asked for; none where there were none.
    pub fn mean(&mut self) -> Option<f64> {
        let Self { sum, count } = core::mem::take(self);
        (count > 0).then(|| f64::from(sum) / f64::from(count))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_of_one_period() {
        let mut sampler = Sampler::default();
        assert_eq!(sampler.mean(), None);
        [10, 11, 11, 12].map(|raw| sampler.take(raw));
        assert_eq!(sampler.mean(), Some(11.0));
        assert_eq!(sampler.mean(), None);
        for _ in 0..70_000 {
            sampler.take(4095);
        }
        assert_eq!(sampler.mean(), Some(4095.0));
    }
}
