//! Seeded noise for the coverage tests: what our logs hold, made here because `fit` never sees `model`.

use rand::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use rand_xoshiro::Xoshiro256PlusPlus;

/// Random numbers of one data set.
pub struct Stream(Xoshiro256PlusPlus);

impl Stream {
    /// The stream `name` of the set `seed`.
    pub fn new(seed: u64, name: &str) -> Self {
        let mix = name.bytes().fold(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15), |hash, b| {
            (hash ^ u64::from(b)).wrapping_mul(0x0100_0000_01b3)
        });
        let mut rng = Xoshiro256PlusPlus::seed_from_u64(mix);
        let _ = rng.next_u64();
        Self(rng)
    }

    /// Standard normal.
    pub fn normal(&mut self) -> f64 {
        StandardNormal.sample(&mut self.0)
    }
}

/// First-order Gauss-Markov process, stationary from the first value on.
pub struct Markov {
    value: f64,
    keep: f64,
    kick: f64,
}

impl Markov {
    /// Stationary sigma, correlation time, time between steps.
    pub fn new(std: f64, tau_s: f64, dt_s: f64, rng: &mut Stream) -> Self {
        let keep = (-dt_s / tau_s).exp();
        Self { value: std * rng.normal(), keep, kick: std * (1.0 - keep * keep).sqrt() }
    }

    /// The next value.
    pub fn step(&mut self, rng: &mut Stream) -> f64 {
        self.value = self.value * self.keep + self.kick * rng.normal();
        self.value
    }
}

/// Noise of a log: lasting, white, and swinging.
pub struct Log {
    slow: Markov,
    white: f64,
    swing: [f64; 2],
    poles: [f64; 2],
    kick: f64,
}

impl Log {
    pub fn new(std: f64, tau_s: f64, white: f64, dt_s: f64, rng: &mut Stream) -> Self {
        Self {
            slow: Markov::new(std, tau_s, dt_s, rng),
            white,
            swing: [0.0; 2],
            poles: [0.0; 2],
            kick: 0.0,
        }
    }

    /// Adds a resonance of the loops: period in s, damping 0.4.
    pub fn swinging(mut self, std: f64, period_s: f64, dt_s: f64) -> Self {
        let omega = 2.0 * std::f64::consts::PI / period_s;
        let damp = (-0.4 * omega * dt_s).exp();
        self.poles = [2.0 * damp * (0.917 * omega * dt_s).cos(), -damp * damp];
        let [a, b] = self.poles;
        // Stationary variance of a second-order autoregression.
        let gain = (1.0 - b) / ((1.0 + b) * ((1.0 - b).powi(2) - a * a));
        self.kick = std / gain.sqrt();
        self
    }

    pub fn step(&mut self, rng: &mut Stream) -> f64 {
        let next = self.poles[0] * self.swing[0]
            + self.poles[1] * self.swing[1]
            + self.kick * rng.normal();
        self.swing = [next, self.swing[0]];
        self.slow.step(rng) + self.white * rng.normal() + next
    }
}
