//! Random numbers of the generator: one stream per purpose, heavy-tailed laws.
//!
//! Laws are scaled to unit variance: Student-t with 5 degrees of freedom (Bailey's polar form,
//! Math. Comp. 62, 1994), Laplace, exponential with its mean removed where said.

use std::f64::consts::TAU;

use rand::{Rng, SeedableRng};
use rand_xoshiro::Xoshiro256StarStar;

/// Degrees of freedom of the heavy-tailed sensor noise.
const FREEDOM: f64 = 5.0;

/// A stream of random numbers.
#[derive(Debug, Clone)]
pub struct Noise(Xoshiro256StarStar);

impl Noise {
    /// The stream `name` of the flight `seed`: independent of every other stream.
    pub fn new(seed: u64, name: &str) -> Self {
        // A polynomial hash; `seed_from_u64` spreads what lies close.
        let start = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(17);
        let hash = name.bytes().fold(start, |hash, byte| {
            (hash.rotate_left(5) ^ u64::from(byte)).wrapping_mul(0x517c_c1b7_2722_0a95)
        });
        Self(Xoshiro256StarStar::seed_from_u64(hash))
    }

    /// Uniform in (0, 1).
    pub fn uniform(&mut self) -> f64 {
        ((self.0.next_u64() >> 11) as f64 + 0.5) * (1.0 / (1u64 << 53) as f64)
    }

    /// Uniform between two bounds.
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }

    /// A number below `n`.
    pub fn below(&mut self, n: usize) -> usize {
        ((self.uniform() * n as f64) as usize).min(n.saturating_sub(1))
    }

    /// +1 or -1.
    pub fn sign(&mut self) -> f64 {
        if self.uniform() < 0.5 { -1.0 } else { 1.0 }
    }

    /// Standard normal (Box-Muller).
    pub fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (TAU * self.uniform()).cos()
    }

    /// Student-t, unit variance.
    pub fn student(&mut self) -> f64 {
        let radius = (FREEDOM * (self.uniform().powf(-2.0 / FREEDOM) - 1.0)).sqrt();
        radius * (TAU * self.uniform()).cos() * ((FREEDOM - 2.0) / FREEDOM).sqrt()
    }

    /// Laplace, unit variance.
    pub fn laplace(&mut self) -> f64 {
        let u = self.uniform() - 0.5;
        -u.signum() * (1.0 - 2.0 * u.abs()).max(1e-300).ln() / std::f64::consts::SQRT_2
    }

    /// Exponential, mean 1.
    pub fn exponential(&mut self) -> f64 {
        -self.uniform().ln()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_laws_have_unit_variance_and_no_mean() {
        let mut rng = Noise::new(1, "test");
        for law in [Noise::normal, Noise::student, Noise::laplace] {
            let (mut sum, mut square, n) = (0.0, 0.0, 200_000);
            for _ in 0..n {
                let x = law(&mut rng);
                sum += x;
                square += x * x;
            }
            let n = f64::from(n);
            assert!((sum / n).abs() < 0.01 && (square / n - 1.0).abs() < 0.05, "{}", square / n);
        }
    }

    #[test]
    fn prop_streams_differ() {
        let first = |seed, name| Noise::new(seed, name).uniform();
        assert_ne!(first(1, "a"), first(1, "b"));
        assert_ne!(first(1, "a"), first(2, "a"));
        assert_eq!(first(1, "a"), first(1, "a"));
    }
}
