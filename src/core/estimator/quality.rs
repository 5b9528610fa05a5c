//! Quality of each anchor, learned in flight: a factor on the variance of what it says.
//!
//! Innovations of an anchor that are larger than stated raise its factor, smaller ones lower it, until their mean
//! square over their variance is one: `ln q ← ln q + (min(r², R) − 1) Δ/τ`, r the innovation in sigmas, Δ the mean
//! time between measurements of the anchor, τ the time of learning, s. In the logarithm, and with the same step for
//! each measurement, the mean of r² is one where the factor settles; with `q ← q (1 + …)` or with the time since the
//! last measurement as the step, bursts and pauses would count for more than what lies between them. Both
//! anchors of a pair learn from it; the one that is blocked is in both of its pairs and learns twice
//! as fast as its neighbours. The factor also scales how fast the anchor's bias wanders (`bias.rs`):
//! behind an obstacle both noise and bias grow. After the obstacle it sinks as it rose.
//!
//! What is stated of an innovation is what was learned. What a measurement weighs, and how far its bias wanders,
//! has a floor (`quality.least`): an anchor that is quiet for a moment is not believed for ever. Where the floor of the
//! room hides anchors that is the least that is learned, too: with their biases free whatever they say fits.

use super::bias::MOST_ANCHORS;
use super::config::Quality;

/// Squared innovation, in sigmas squared, beyond which it says no more.
const MOST_RATIO2: f64 = 25.0;
/// Longest step of learning, as a share of τ.
const LONGEST_STEP: f64 = 0.1;
/// Least factor that is learned: chosen, a tenth of the configured sigma, below which an innovation is the state's own
/// uncertainty alone and says nothing of the anchor.
const LEAST: f64 = 0.01;

/// Factors of the anchors, by their place in the survey.
#[derive(Debug, Clone, PartialEq)]
pub struct Qualities {
    /// As learned.
    learned: [f64; MOST_ANCHORS],
    /// As believed: never below `quality.least`.
    factors: [f64; MOST_ANCHORS],
}

impl Default for Qualities {
    fn default() -> Self {
        Self { learned: [1.0; MOST_ANCHORS], factors: [1.0; MOST_ANCHORS] }
    }
}

impl Qualities {
    /// Of an anchor, as believed: on the variance that it is fused with. 1 for those beyond the table.
    #[inline]
    pub fn of(&self, rank: usize) -> f64 {
        self.factors.get(rank).copied().unwrap_or(1.0)
    }

    /// Of an anchor, as learned: on the variance that is stated of its innovations.
    #[inline]
    pub fn stated(&self, rank: usize) -> f64 {
        self.learned.get(rank).copied().unwrap_or(1.0)
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

    /// Learns from a squared innovation in sigmas, as stated, of an anchor that is heard each `interval_s`.
    #[inline]
    pub fn learn(
        &mut self,
        config: &Quality,
        rank: usize,
        ratio2: f64,
        interval_s: f64,
        hidden: bool,
    ) {
        let Some((learned, factor)) = self.learned.get_mut(rank).zip(self.factors.get_mut(rank))
        else {
            return;
        };
        let step = (interval_s / config.time_s).clamp(0.0, LONGEST_STEP);
        let change = ((ratio2.min(MOST_RATIO2) - 1.0) * step).exp();
        let least = if hidden { config.least } else { LEAST };
        *learned = (*learned * change).clamp(least, config.most);
        *factor = learned.max(config.least);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_a_factor_settles_where_innovations_are_as_large_as_stated() {
        let config = Quality { learn: true, ..Quality::default() };
        // The true variance is 9 times the configured one, and a twenty-fifth of it: r² is 0 and twice its mean in turn.
        for true_factor in [9.0, 0.04] {
            let mut qualities = Qualities::default();
            let mut sum = 0.0;
            for i in 0..20_000 {
                let ratio2 = if i % 2 == 0 { 0.0 } else { 2.0 * true_factor / qualities.stated(3) };
                qualities.learn(&config, 3, ratio2, 0.01, false);
                sum += if i < 10_000 { 0.0 } else { ratio2 };
            }
            assert!((sum / 10_000.0 - 1.0).abs() < 1e-3, "{}", sum / 10_000.0);
            assert!((qualities.stated(3) / true_factor - 1.0).abs() < 0.1, "{qualities:?}");
            assert_eq!(qualities.of(3), qualities.stated(3).max(config.least));
            assert_eq!(qualities.of(2), 1.0);
            let before = qualities.clone();
            qualities.learn(&config, 99, 4.0, 0.01, false);
            assert_eq!(qualities, before);
        }
    }
}
