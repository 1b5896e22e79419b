//! Random numbers that are the same on every machine: SplitMix64 (Steele, Lea and Flood 2014).
//!
//! A stream is named by a list of numbers, such as a seed, a source of error and the index of a layer. So the numbers
//! of a layer do not depend on those drawn before, and threads, boards and simulated tips agree on them without shared
//! state.

use core::f64::consts::TAU;

use nalgebra::Vector3;

/// The difference between the states of a stream.
const INCREMENT: u64 = 0x9e37_79b9_7f4a_7c15;

/// The output of a stream in this state: 64 random bits.
#[must_use]
pub const fn scramble(state: u64) -> u64 {
    let mut z = state.wrapping_add(INCREMENT);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A stream of random numbers.
#[derive(Debug, Clone)]
pub struct Random(u64);

impl Random {
    /// The stream that these numbers name; any two differing lists name unrelated streams.
    #[must_use]
    pub fn new(names: &[u64]) -> Self {
        names.iter().fold(Self(0), |mut stream, name| {
            stream.0 ^= name.wrapping_mul(0xd1b5_4a32_d192_ed03);
            Self(stream.bits())
        })
    }

    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        let bits = scramble(self.0);
        self.0 = self.0.wrapping_add(INCREMENT);
        bits
    }

    /// A whole number from 0 to `end`, without it.
    pub fn below(&mut self, end: u64) -> u64 {
        self.bits() % end
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in [min, max).
    pub fn between(&mut self, min: f64, max: f64) -> f64 {
        min + (max - min) * self.unit()
    }

    /// Uniform in [-1, 1).
    pub fn even(&mut self) -> f64 {
        2.0 * self.unit() - 1.0
    }

    /// Of mean 0 and standard deviation 1 (Box and Muller 1958).
    pub fn normal(&mut self) -> f64 {
        libm::sqrt(-2.0 * libm::log(1.0 - self.unit())) * libm::cos(TAU * self.unit())
    }

    /// A vector whose three coordinates are each [`Self::normal`].
    pub fn normal_vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }

    /// A direction, uniform on the sphere.
    pub fn direction(&mut self) -> Vector3<f64> {
        self.normal_vector().normalize()
    }
}
