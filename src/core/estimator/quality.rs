//! Quality of each anchor, learned in flight: a factor on the variance of what it says.
//!
//! Innovations of an anchor that are larger than stated raise its factor, smaller ones lower it,
//! until their mean square over their variance is one: `q ← q (1 + (min(r², R) − 1) Δ/τ)`, r the
//! innovation in sigmas, Δ the time since the anchor was last heard, τ the time of learning, s. Both
//! anchors of a pair learn from it; the one that is blocked is in both of its pairs and learns twice
//! as fast as its neighbours. The factor also scales how fast the anchor's bias wanders (`bias.rs`):
//! behind an obstacle both noise and bias grow. After the obstacle it sinks as it rose.

use super::bias::MOST_ANCHORS;
use super::config::Quality;

/// Squared innovation, in sigmas squared, beyond which it says no more.
const MOST_RATIO2: f64 = 25.0;
/// Longest step of learning, as a share of τ.
const LONGEST_STEP: f64 = 0.1;

/// Factors of the anchors, by their place in the survey.
#[derive(Debug, Clone, PartialEq)]
pub struct Qualities {
    factors: [f64; MOST_ANCHORS],
}

impl Default for Qualities {
    fn default() -> Self {
        Self { factors: [1.0; MOST_ANCHORS] }
    }
}

impl Qualities {
    /// Of an anchor; 1 for those beyond the table.
    #[inline]
    pub fn of(&self, rank: usize) -> f64 {
        self.factors.get(rank).copied().unwrap_or(1.0)
    }

    /// All of them.
    #[inline]
    pub fn factors(&self) -> &[f64] {
        &self.factors
    }

    /// Share of the first `anchors` whose factor is beyond `factor`.
    #[inline]
    pub fn share_beyond(&self, factor: f64, anchors: usize) -> f64 {
        let known = self.factors.get(..anchors).unwrap_or(&self.factors);
        known.iter().filter(|f| **f > factor).count() as f64 / known.len().max(1) as f64
    }

    /// Learns from a squared innovation in sigmas; `since_s` since the anchor was last heard.
    #[inline]
    pub fn learn(&mut self, config: &Quality, rank: usize, ratio2: f64, since_s: f64) {
        let Some(factor) = self.factors.get_mut(rank) else { return };
        let step = (since_s / config.time_s).clamp(0.0, LONGEST_STEP);
        let change = 1.0 + (ratio2.min(MOST_RATIO2) - 1.0) * step;
        *factor = (*factor * change).clamp(config.least, config.most);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_factor_settles_where_innovations_are_as_large_as_stated() {
        let config = Quality { learn: true, ..Quality::default() };
        let mut qualities = Qualities::default();
        // The true variance is 9 times the stated one: r² is 9/q on average, 0 and 18/q in turn.
        for i in 0..20_000 {
            let ratio2 = if i % 2 == 0 { 0.0 } else { 18.0 / qualities.of(3) };
            qualities.learn(&config, 3, ratio2, 0.01);
        }
        assert!((qualities.of(3) / 9.0 - 1.0).abs() < 0.1, "{}", qualities.of(3));
        assert_eq!(qualities.of(2), 1.0);
        qualities.learn(&config, 99, 4.0, 0.01);
        assert_eq!(qualities.of(99), 1.0);
    }
}
