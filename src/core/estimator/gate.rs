//! Gate of the TDOA aid: weight of a measurement, and doubt in the filter itself.
//!
//! A gate that only rejects locks itself out: once the estimate is off, every good measurement
//! looks wild. So the share of rejected measurements is watched over the last [`WINDOW`]; when most
//! of them, from several anchors, do not fit, it is the filter that is doubted. The answer
//! escalates: widen the covariance, widen it more, find the position anew. Nothing here rejects
//! for ever.

use super::config::{GateConfig, Tail};

/// Measurements over which the share is taken: 0.3 s of TDoA2, 0.5 s of TDoA3.
pub const WINDOW: u32 = u128::BITS;
/// Anchors that must disagree before the filter is doubted: one blocked anchor spoils the pairs
/// with its two neighbours on the ring, which are three.
const LEAST_ANCHORS: u32 = 4;
/// Share below which trust is restored.
const TRUST_FRAC: f64 = 0.2;

/// Variance factor of a measurement whose squared innovation is `ratio2` times its variance.
///
/// Huber: influence grows to `k` sigma and stays. Student-t with ν degrees of freedom:
/// `(ν + ratio²)/(ν + 1)`, never below 1.
#[inline]
pub fn tail_factor(tail: Tail, tail_sigma: f64, ratio2: f64) -> f64 {
    match tail {
        Tail::Gaussian => 1.0,
        Tail::Huber => (ratio2.sqrt() / tail_sigma).max(1.0),
        Tail::StudentT => {
            let freedom = tail_sigma * tail_sigma;
            ((freedom + ratio2) / (freedom + 1.0)).max(1.0)
        }
    }
}

/// What to do about a filter that is doubted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Remedy {
    /// Add this much to the uncertainty of position and velocity.
    Widen,
    /// Widen more.
    WidenMore,
    /// Find the position from the recent measurements.
    Relocate,
}

/// Memory of the gate.
#[derive(Debug, Clone, Default)]
pub struct Doubt {
    /// Newest outcome in the lowest bit, 1 is beyond the gate.
    outcomes: u128,
    seen: u32,
    /// Anchors (by rank, modulo 64) that were beyond the gate since the window began.
    anchors: u64,
    level: u8,
    /// Times a remedy was used.
    pub remedies: u64,
}

impl Doubt {
    /// Notes an outcome; ranks are the places of the two anchors in the survey.
    #[inline]
    pub fn note(&mut self, beyond: bool, rank_a: usize, rank_b: usize) {
        self.outcomes = (self.outcomes << 1) | u128::from(beyond);
        self.seen = (self.seen + 1).min(WINDOW);
        if beyond {
            self.anchors |= (1 << (rank_a % 64)) | (1 << (rank_b % 64));
        }
        if self.outcomes == 0 {
            self.anchors = 0;
        }
    }

    /// Share of recent measurements beyond the gate.
    #[inline]
    pub fn share(&self) -> f64 {
        if self.seen == 0 {
            0.0
        } else {
            f64::from(self.outcomes.count_ones()) / f64::from(self.seen)
        }
    }

    /// Whether a remedy is being tried.
    pub fn is_active(&self) -> bool {
        self.level > 0
    }

    /// What to do now, if anything. Starts a new window when it says something.
    #[inline]
    pub fn remedy(&mut self, config: &GateConfig) -> Option<Remedy> {
        if !config.recover || self.seen < WINDOW / 2 {
            return None;
        }
        let share = self.share();
        if share < TRUST_FRAC && self.seen == WINDOW {
            self.level = 0;
        }
        if share < config.doubt_frac || self.anchors.count_ones() < LEAST_ANCHORS {
            return None;
        }
        self.restart_window();
        self.remedies += 1;
        self.level = (self.level + 1).min(3);
        Some(match self.level {
            1 => Remedy::Widen,
            2 => Remedy::WidenMore,
            _ => Remedy::Relocate,
        })
    }

    /// Whether everything is fused with a heavy tail instead of rejected: the last stage.
    pub fn open(&self) -> bool {
        self.level >= 2
    }

    /// Forgets the outcomes, keeps the stage.
    pub fn restart_window(&mut self) {
        self.outcomes = 0;
        self.seen = 0;
        self.anchors = 0;
    }

    /// Forgets everything: a new start.
    pub fn clear(&mut self) {
        *self = Self { remedies: self.remedies, ..Self::default() };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_tails_never_raise_a_weight_and_keep_some() {
        for tail in [Tail::Gaussian, Tail::Huber, Tail::StudentT] {
            for i in 0..200 {
                let ratio = f64::from(i) * 0.5;
                let factor = tail_factor(tail, 2.0, ratio * ratio);
                assert!(factor >= 1.0 && factor.is_finite());
            }
        }
        // Influence ratio/factor: Huber saturates at its tail.
        assert!((50.0 / tail_factor(Tail::Huber, 2.0, 2500.0) - 2.0).abs() < 1e-12);
    }

    #[test]
    fn prop_one_blocked_anchor_is_not_a_wrong_filter() {
        let mut doubt = Doubt::default();
        let config = GateConfig::default();
        for i in 0..10_000usize {
            let (a, b) = (i % 3, (i + 1) % 3);
            doubt.note(true, a, b);
            assert_eq!(doubt.remedy(&config), None);
        }
    }

    #[test]
    fn prop_doubt_escalates_and_ends() {
        let mut doubt = Doubt::default();
        let config = GateConfig::default();
        let mut said = vec![];
        for i in 0..400usize {
            doubt.note(true, i % 8, (i + 1) % 8);
            said.extend(doubt.remedy(&config));
        }
        assert_eq!(said[..3], [Remedy::Widen, Remedy::WidenMore, Remedy::Relocate]);
        assert!(doubt.open());
        for i in 0..200usize {
            doubt.note(false, i % 8, (i + 1) % 8);
            assert_eq!(doubt.remedy(&config), None);
        }
        assert!(!doubt.is_active());
    }
}
