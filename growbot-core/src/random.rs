//! Random numbers that are the same on every machine: SplitMix64 (Steele, Lea and Flood 2014).
//!
//! A list of numbers identifies a stream of random numbers, for example a seed, a source of error and the index of a
//! layer. So the random numbers of a layer do not depend on those drawn before. Threads, boards and simulated tips
//! agree on them without shared state.

use core::f64::consts::TAU;

use nalgebra::Vector3;

/// Difference between successive states of a stream.
const INCREMENT: u64 = 0x9e37_79b9_7f4a_7c15;

/// Returns the 64 random bits that a stream in this state gives.
pub const fn splitmix64(state: u64) -> u64 {
    let mut z = state.wrapping_add(INCREMENT);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// A generator of a stream of random numbers.
#[derive(Debug, Clone)]
pub struct Rng(u64);

impl Rng {
    /// Creates the stream that a list of numbers identifies. Streams of different lists are unrelated.
    pub fn new(names: &[u64]) -> Self {
        names.iter().fold(Self(0), |mut stream, name| {
            stream.0 ^= name.wrapping_mul(0xd1b5_4a32_d192_ed03);
            Self(stream.next_u64())
        })
    }

    /// Returns 64 random bits.
    pub fn next_u64(&mut self) -> u64 {
        let bits = splitmix64(self.0);
        self.0 = self.0.wrapping_add(INCREMENT);
        bits
    }

    /// Returns a random integer from 0 to `end`, exclusive.
    pub fn below(&mut self, end: u64) -> u64 {
        self.next_u64() % end
    }

    /// Returns a uniform random number in [0, 1).
    pub fn uniform(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Returns a uniform random number in [min, max).
    pub fn uniform_between(&mut self, min: f64, max: f64) -> f64 {
        min + (max - min) * self.uniform()
    }

    /// Returns a uniform random number in [-1, 1).
    pub fn uniform_symmetric(&mut self) -> f64 {
        2.0 * self.uniform() - 1.0
    }

    /// Returns a normally distributed random number of mean 0 and standard deviation 1 (Box and Muller 1958).
    pub fn normal(&mut self) -> f64 {
        libm::sqrt(-2.0 * libm::log(1.0 - self.uniform())) * libm::cos(TAU * self.uniform())
    }

    /// Returns a vector whose three coordinates are normally distributed, with mean 0 and standard deviation 1.
    pub fn normal_vector(&mut self) -> Vector3<f64> {
        Vector3::new(self.normal(), self.normal(), self.normal())
    }

    /// Returns a random unit vector, uniformly distributed on the sphere.
    pub fn direction(&mut self) -> Vector3<f64> {
        self.normal_vector().normalize()
    }
}
