//! Noise that is the same in every run: a function of a seed, of the measured quantity, and of the time.

use growbot_core::random::splitmix64;

/// Returns noise of mean 0 and variance 1 on a channel at a tick. It is the sum of four uniform distributions, so its
/// magnitude is never above 3.5.
pub(super) fn noise(seed: u64, channel: u64, tick: u64) -> f64 {
    let bits = splitmix64(splitmix64(seed ^ (channel << 56)) ^ tick);
    let sum: f64 = (0..4).map(|part| (bits >> (16 * part) & 0xFFFF) as f64 / 65535.0 - 0.5).sum();
    sum * libm::sqrt(3.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_has_zero_mean_unit_variance_and_depends_on_all_inputs() {
        let samples: Vec<f64> = (0..100_000).map(|tick| noise(1, 0, tick)).collect();
        let mean = samples.iter().sum::<f64>() / 1e5;
        let variance = samples.iter().map(|sample| sample * sample).sum::<f64>() / 1e5;
        assert!(mean.abs() < 0.02 && (variance - 1.0).abs() < 0.02, "{mean} {variance}");
        assert_eq!(noise(1, 0, 7), noise(1, 0, 7));
        assert!(
            noise(1, 0, 7) != noise(2, 0, 7) && noise(1, 0, 7) != noise(1, 1, 7) && noise(1, 0, 7) != noise(1, 0, 8)
        );
    }
}
