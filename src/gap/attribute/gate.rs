//! Is there a gap at all: two scores of a flight, each against what healthy flights reach.
//!
//! ```text
//! effect = log (1/n) Σ_e Z_e / Z_0 > l log(1/a),   l = max(1, median_i (1/n) Σ_e (q_e·z_i)²)
//! ```
//! Z_e: evidence of effect e of n, as likely as one another, the mean of its likelihood over its draws, and Z_0 that of none; a: share of
//! healthy flights that may raise an alarm. Over flights without an effect the mean of Z_e / Z_0 is one at most, as nothing is fitted to
//! them, so that no more than a share a exceeds 1/a (Markov's inequality). That holds where the scatter of healthy flights is known. It is
//! not quite: held-out ones, z_i whitened, are l times as loud in square along q_e, the main direction of an effect, and log Z_e / Z_0 grows
//! with that square; so its limit does (judgement, by that; not a bound).
//!
//! `distance`: normal score of the squared whitened distance, for what no effect of the library explains. Few flights of the airframe are
//! less far from their own than others will be: its limit is a prediction limit of that many flights, in hours that differ as other hours
//! do (`scatter`).

use serde::{Deserialize, Serialize};

use super::Gate;
use crate::normal::{empirical_quantile, log_mean_exp, median, prediction_factor};

/// What the gate sees of one flight.
#[derive(Debug, Clone)]
pub(super) struct Seen {
    /// Log evidence of every effect over "no effect", in the order of the bank.
    pub evidence: Vec<f64>,
    /// Normal score of the squared distance.
    pub distance: f64,
}

/// Fewer flights of the airframe give no limit.
const LEAST_JUDGED: usize = 8;

/// The limits.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Limit {
    distance: f64,
    effect: f64,
}

impl Limit {
    /// `bank`, `airframe`: distances of flights without an effect that taught nothing; those of the airframe stem from `few` flights.
    /// `louder`: `l` above. `share`: of healthy flights that each score may raise an alarm for.
    pub fn new(bank: &[f64], airframe: &[f64], few: usize, louder: f64, share: f64) -> Self {
        let distance = match few {
            0..LEAST_JUDGED => empirical_quantile(bank.iter().copied(), 1.0 - share),
            _ => skewed(airframe, 1.0 - share, few),
        };
        Self { distance, effect: -share.ln() * louder.max(1.0) }
    }

    /// A flight held against the limits; what of it matters is not looked at.
    pub fn gate(&self, flight: &Seen) -> Gate {
        Gate {
            distance: flight.distance,
            distance_limit: self.distance,
            effect: log_mean_exp(&flight.evidence),
            effect_limit: self.effect,
            material: true,
        }
    }
}

impl Gate {
    /// Whether there is a gap.
    pub fn open(&self) -> bool {
        self.material && (self.distance > self.distance_limit || self.effect > self.effect_limit)
    }
}

/// Prediction limit from the median and the root mean square above it: the largest of many reaches further up than down. All of the upper
/// half counts: a single quantile of twenty flights let a fifth of other healthy flights raise an alarm.
fn skewed(values: &[f64], share: f64, few: usize) -> f64 {
    let middle = median(values.iter().copied());
    let above = || values.iter().filter(|v| **v > middle).map(|v| (v - middle).powi(2));
    let upper = (above().sum::<f64>() / above().count().max(1) as f64).sqrt();
    middle + prediction_factor(share, few) * upper
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_model::random::Stream;

    /// Evidence of effects of known sizes over none, each along a number of its own whose scatter is taken for one and is `sigma`, where
    /// the flight has one of them or none.
    fn seen(rng: &mut Stream, sizes: &[f64], there: Option<usize>, sigma: f64) -> Seen {
        let mut of = |(k, size): (usize, &f64)| {
            let number = sigma * rng.normal() + if there == Some(k) { *size } else { 0.0 };
            size * number - 0.5 * size * size
        };
        let evidence = sizes.iter().enumerate().map(&mut of).collect();
        Seen { evidence, distance: rng.normal() }
    }

    #[test]
    fn prop_evidence_raises_no_more_alarms_than_are_allowed_and_sees_small_and_large_effects() {
        let mut rng = Stream::new(8, "gate");
        let sizes: Vec<f64> = (0..40).map(|e| 0.5 + 0.25 * f64::from(e)).collect();
        for louder in [1.0, 2.0] {
            let limit = Limit::new(&[0.0], &[], 0, louder, 0.02);
            let mut opened = |there: Option<usize>| {
                let gate = limit.gate(&seen(&mut rng, &sizes, there, louder.sqrt()));
                gate.effect > gate.effect_limit
            };
            let alarms = (0..5000).filter(|_| opened(None)).count();
            assert!(alarms < 100, "{alarms} of 5000 at {louder}");
            // Seven sigma are seen whatever else the library holds.
            let small = (0..100).filter(|_| opened(Some(26))).count();
            let large = (0..100).filter(|_| opened(Some(39))).count();
            assert!(small > 80 && large == 100, "{small} {large} at {louder}");
        }
    }

    /// In-sample limits of a few flights let 19 % of other healthy flights raise an alarm.
    #[test]
    fn bug_a_few_flights_do_not_make_a_narrow_gate() {
        let mut rng = Stream::new(9, "gate");
        let (mut alarms, mut flights) = (0, 0);
        for _ in 0..100 {
            let few: Vec<f64> = (0..16).map(|_| rng.normal()).collect();
            let limit = Limit::new(&[], &few, few.len(), 1.0, 0.01);
            flights += 100;
            alarms +=
                (0..100).filter(|_| limit.gate(&seen(&mut rng, &[], None, 1.0)).open()).count();
        }
        assert!(alarms * 100 < flights * 4, "{alarms} of {flights}");
    }

    #[test]
    fn prop_without_flights_only_evidence_opens() {
        let limit = Limit::new(&[], &[], 0, 1.0, 0.01);
        let gate = |evidence: f64| limit.gate(&Seen { evidence: vec![evidence], distance: 1e6 });
        assert!(!gate(4.5).open() && gate(4.7).open());
    }
}
