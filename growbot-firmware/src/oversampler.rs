//! Oversampling: the mean of all ADC conversions of a period.

use crate::thermistor::is_out_of_range;

/// Mean of the ADC's conversions since the last call of [`Oversampler::pop_mean`].
///
/// Conversions at either end of the scale come only from a broken sensor. Such conversions are averaged separately from
/// valid conversions, because a mean of both kinds would be a temperature that does not exist.
#[derive(Debug, Clone, Copy, Default)]
pub struct Oversampler {
    sound: Sum,
    broken: Sum,
}

#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    sum: u32,
    count: u16,
}

impl Sum {
    fn add(&mut self, raw: u16) {
        if let (Some(sum), Some(count)) = (self.sum.checked_add(u32::from(raw)), self.count.checked_add(1)) {
            (self.sum, self.count) = (sum, count);
        }
    }

    fn mean(self) -> Option<f64> {
        (self.count > 0).then(|| f64::from(self.sum) / f64::from(self.count))
    }
}

impl Oversampler {
    /// Adds a conversion, 0 to 4095.
    pub fn add(&mut self, raw: u16) {
        if is_out_of_range(raw) { self.broken.add(raw) } else { self.sound.add(raw) }
    }

    /// Returns the mean of the conversions since the last call. `None` if there were none. The result is the mean of
    /// the valid conversions. If more conversions are at the ends of the scale than between them, it is the mean of
    /// those at the ends.
    pub fn pop_mean(&mut self) -> Option<f64> {
        let Self { sound, broken } = core::mem::take(self);
        if broken.count > sound.count { broken.mean() } else { sound.mean() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_covers_one_period() {
        let mut sampler = Oversampler::default();
        assert_eq!(sampler.pop_mean(), None);
        for raw in [1010, 1011, 1011, 1012] {
            sampler.add(raw);
        }
        assert_eq!(sampler.pop_mean(), Some(1011.0));
        assert_eq!(sampler.pop_mean(), None);
        for _ in 0..70_000 {
            sampler.add(4000);
        }
        assert_eq!(sampler.pop_mean(), Some(4000.0));
    }

    #[test]
    fn a_wire_break_within_a_period_is_not_read_as_cold() {
        let mut sampler = Oversampler::default();
        for raw in [600, 600, 600, 4095] {
            sampler.add(raw);
        }
        assert_eq!(sampler.pop_mean(), Some(600.0));
        // An equal number of conversions at the ends of the scale is too few.
        for raw in [4095, 600] {
            sampler.add(raw);
        }
        assert_eq!(sampler.pop_mean(), Some(600.0));
        for raw in [600, 4095, 4095] {
            sampler.add(raw);
        }
        assert_eq!(sampler.pop_mean(), Some(4095.0));
    }
}
