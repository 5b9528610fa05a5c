//! Seeds: one stream of random numbers per effect.

use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

/// FNV-1a offset basis and prime, 64 bit (draft-eastlake-fnv).
const FNV_BASIS: u64 = 0xcbf2_9ce4_8422_2325;
const FNV_PRIME: u64 = 0x0000_0100_0000_01b3;

/// Random numbers of one effect: depends on the seed of the flight and the name of the stream
/// alone, so every other effect keeps its draws when this one is switched.
#[derive(Debug, Clone)]
pub struct Stream(Xoshiro256PlusPlus);

impl Stream {
    /// The stream `name` of the flight `seed`.
    pub fn new(seed: u64, name: &str) -> Self {
        let mut hash = FNV_BASIS;
        for byte in seed.to_le_bytes().into_iter().chain(name.bytes()) {
            hash = (hash ^ u64::from(byte)).wrapping_mul(FNV_PRIME);
        }
        // `seed_from_u64` runs SplitMix64, which spreads close hashes.
        Self(Xoshiro256PlusPlus::seed_from_u64(hash))
    }

    /// Standard normal.
    #[inline]
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }

    /// Uniform in [0, 1).
    #[inline]
    pub fn uniform(&mut self) -> f64 {
        // 53 random bits, the width of the mantissa.
        (self.0.next_u64() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Uniform in [low, high).
    #[inline]
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.uniform()
    }
}

/// First-order Gauss-Markov process, discretised exactly:
/// `x' = x e^(-dt/τ) + σ √(1 - e^(-2dt/τ)) n`, stationary from the first value on.
#[derive(Debug, Clone)]
pub struct Markov {
    value: f64,
    keep: f64,
    kick: f64,
}

impl Markov {
    /// `std`: stationary sigma; `tau_s`: correlation time; `dt_s`: time between calls of `step`.
    pub fn new(std: f64, tau_s: f64, dt_s: f64, rng: &mut Stream) -> Self {
        let keep = (-dt_s / tau_s).exp();
        let value = std * rng.normal();
        Self { value, keep, kick: std * (1.0 - keep * keep).sqrt() }
    }

    /// Next value.
    #[inline]
    pub fn step(&mut self, rng: &mut Stream) -> f64 {
        self.value = self.keep * self.value + self.kick * rng.normal();
        self.value
    }

    /// Last value.
    pub fn value(&self) -> f64 {
        self.value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_streams_depend_on_seed_and_name_alone() {
        let draw = |seed, name| {
            let mut s = Stream::new(seed, name);
            [s.uniform(), s.normal(), s.between(2.0, 3.0)]
        };
        assert_eq!(draw(1, "A7"), draw(1, "A7"));
        assert_ne!(draw(1, "A7"), draw(1, "A6"));
        assert_ne!(draw(1, "A7"), draw(2, "A7"));
    }

    #[test]
    fn prop_markov_has_its_sigma_and_its_correlation_time() {
        let mut rng = Stream::new(3, "test");
        let (tau_s, dt_s, n) = (0.5, 0.01, 200_000);
        let mut m = Markov::new(2.0, tau_s, dt_s, &mut rng);
        let x: Vec<f64> = (0..n).map(|_| m.step(&mut rng)).collect();
        let var = x.iter().map(|v| v * v).sum::<f64>() / f64::from(n);
        let lag = 50; // one correlation time
        let cov = x.iter().zip(&x[lag..]).map(|(a, b)| a * b).sum::<f64>() / f64::from(n);
        // 200 000 samples are some 2000 independent ones: 5 % is three sigma of the variance.
        assert!((var.sqrt() - 2.0).abs() < 0.1, "{}", var.sqrt());
        assert!((cov / var - (-1.0f64).exp()).abs() < 0.08, "{}", cov / var);
    }
}
