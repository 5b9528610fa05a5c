//! How much the range biases wander in this room, learned in flight: a factor on the variance of each.
//!
//! What a filter has found of a normal state and what it does not know of it add up to what there is:
//! `E[ŵ²] + P = V` with V the stated variance of w. So for each anchor
//!
//! ```text
//! λ ← λ (1 + (min(ŵ² / (V − P), R) − 1) Δ/τ),   V = λ q σ²
//! ```
//!
//! settles where the biases that are found are as large as it is said that they are, from above as from below:
//! with V too small ŵ is small, but V − P is smaller. One that hardly shows (V − P near zero) says little and
//! moves λ little. Where an anchor is blocked q goes up within a second (`quality.rs`); λ is the slow one, of the
//! room and the vehicle.
//!
//! **Symbols.** ŵ wandering part of a bias (`bias.rs`), m; P its variance, m²; q the anchor's quality, σ its
//! sigma as configured, m; R the most that a ratio says; Δ step, τ time of learning, s. **Source.** Covariance
//! matching as in Mehra, "Approaches to adaptive filtering", IEEE Trans. Automatic Control 17(5), 1972, on a
//! state instead of the innovation. **Left out.** That the identity is one of the optimal filter: noise of the
//! measurements that is stated too large makes λ too small.

use super::bias::{Biases, MOST_ANCHORS, Wander};
use super::config::AnchorBias;

/// Longest step of learning, as a share of τ: chosen, so that a pause is not a lesson.
const LONGEST_STEP: f64 = 0.02;
/// Most that a ratio says: chosen, two sigma; what is beyond is an obstacle's, and quick (`quality.rs`).
const MOST_RATIO: f64 = 4.0;
/// Bounds of a factor: a third of the configured sigma (0.04 m of wandering in the stillest layout of the recordings
/// where their README has 0.15 m in another), and twice it.
const LEAST: f64 = 0.1;
const MOST: f64 = 4.0;

/// The factors, by the anchors' place in the survey.
#[derive(Debug, Clone, PartialEq)]
pub struct BiasLevel {
    factors: [f64; MOST_ANCHORS],
}

impl Default for BiasLevel {
    fn default() -> Self {
        Self { factors: [1.0; MOST_ANCHORS] }
    }
}

impl BiasLevel {
    /// On the variance of what wanders.
    #[inline]
    pub fn factors(&self) -> [f64; MOST_ANCHORS] {
        self.factors
    }

    /// Learns from the biases after a step. Not where the floor hides anchors: that is no wandering.
    #[inline]
    pub fn learn(&mut self, biases: &Biases, config: &AnchorBias, step: &Wander<'_>) {
        if config.level_s == 0.0 || step.hidden_std_m.is_some() {
            return;
        }
        let share = (step.dt_s / config.level_s).min(LONGEST_STEP);
        for (anchor, factor) in self.factors.iter_mut().enumerate() {
            let Some((found_m2, stated_m2)) = biases.wandering_m2(config, step, anchor) else {
                continue;
            };
            let ratio = (found_m2 / stated_m2).min(MOST_RATIO);
            *factor = (*factor * (1.0 + (ratio - 1.0) * share)).clamp(LEAST, MOST);
        }
    }
}
