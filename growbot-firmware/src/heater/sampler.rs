//! Oversampling: the mean of all conversions of a period.

use crate::thermistor::broken;

/// Adds up conversions of the converter.
///
/// A wire that breaks in the midst of a period must not make a temperature between the one before and the end of the scale.
/// So readings of a broken sensor are left out of the mean, unless there are no others.
#[derive(Debug, Clone, Copy, Default)]
pub struct Sampler {
    sum: u32,
    count: u16,
    /// The latest reading at an end of the scale.
    at_end: Option<u16>,
}

impl Sampler {
    /// Takes a conversion, 0 to 4095.
    pub fn take(&mut self, raw: u16) {
        if broken(f64::from(raw)).is_some() {
            self.at_end = Some(raw);
        } else if let (Some(sum), Some(count)) = (self.sum.checked_add(u32::from(raw)), self.count.checked_add(1)) {
            (self.sum, self.count) = (sum, count);
        }
    }

    /// The mean of those taken since it was last asked for; none where there were none.
    pub fn mean(&mut self) -> Option<f64> {
        let Self { sum, count, at_end } = core::mem::take(self);
        if count > 0 { Some(f64::from(sum) / f64::from(count)) } else { at_end.map(f64::from) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_of_one_period() {
        let mut sampler = Sampler::default();
        assert_eq!(sampler.mean(), None);
        for raw in [1010, 1011, 1011, 1012] {
            sampler.take(raw);
        }
        assert_eq!(sampler.mean(), Some(1011.0));
        assert_eq!(sampler.mean(), None);
        for _ in 0..70_000 {
            sampler.take(4000);
        }
        assert_eq!(sampler.mean(), Some(4000.0));
    }

    #[test]
    fn a_wire_that_breaks_within_a_period_is_no_cold_nozzle() {
        let mut sampler = Sampler::default();
        for raw in [600, 600, 600, 4095] {
            sampler.take(raw);
        }
        assert_eq!(sampler.mean(), Some(600.0));
        for raw in [600, 4095, 4095] {
            sampler.take(raw);
        }
        assert_eq!(sampler.mean(), Some(4095.0));
    }
}
