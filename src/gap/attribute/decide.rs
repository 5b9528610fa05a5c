//! The verdict: gate, names, second effect, adequacy, in this order.

use nalgebra::DVector;
use rayon::prelude::*;

use super::ambiguity;
use super::blocks::Groups;
use super::evidence::Fit;
use super::library::Library;
use super::open_set::{features, remainder, score};
use super::pairs::{self, PairFit};
use super::trials::{by_effect, seen_of};
use super::whiten::expand;
use super::{Adequacy, Attribution, Attributor, BlockScore, Candidate, Gate, PairCandidate};
use crate::outcome::{Named, Outcome, Remainder};

/// Fewer known statistics than this say nothing.
const LEAST_STATISTICS: usize = 8;
/// Share of the gap that an effect must explain to be named beside a remainder.
const MOSTLY: f64 = 0.9;
/// Rivals whose distance is computed.
const RIVALS: usize = 8;
/// A second effect costs at least `log C(53, 2) - log 53` of choice.
const LEAST_PAIR_GAIN: f64 = 3.3;
/// Pairs that are reported.
const REPORTED_PAIRS: usize = 5;

/// A flight and what explains it.
struct Case<'a> {
    library: &'a Library,
    z: DVector<f64>,
    fits: Vec<Fit>,
    posterior: Vec<f64>,
}

impl Attributor {
    /// Judges one flight by `library` and `groups`, which leave out what the flight cannot say.
    pub(super) fn decide(
        &self,
        library: &Library,
        groups: &Groups,
        statistics: &[f64],
        unknown: Vec<String>,
    ) -> Attribution {
        let (settings, limits) = (&self.settings, &self.limits);
        let width = library.whitening.width();
        let z = library.flight(statistics).z;
        let fits = library.explain(&z, settings.survivors);
        let posterior = limits.calibration.posterior(&by_effect(&fits));
        let case = Case { library, z, fits, posterior };
        let gate = Gate {
            material: self.material(library, &case.z),
            ..limits.gate.gate(&seen_of(library, &case.z, &case.fits))
        };
        let mut result = Attribution {
            outcome: Outcome::NoMaterialGap,
            candidates: Vec::new(),
            pairs: Vec::new(),
            pair_limit: limits.pair_gain,
            blocks: self.blocks(groups, statistics),
            gate,
            adequacy: Adequacy { limit: limits.adequate, ..Adequacy::default() },
            used: width,
            unknown,
        };
        if width < LEAST_STATISTICS || case.fits.is_empty() {
            let why = format!("{width} statistics are known, at least {LEAST_STATISTICS} needed");
            result.outcome = Outcome::NotTestable { why };
            return result;
        }
        let alarm = result.gate.open();
        let pair = if alarm { self.second(&case, &mut result) } else { None };
        self.verdict(&case, alarm, pair, &mut result);
        result
    }

    /// Best pair, if it adds enough; all that were fitted go to the report.
    fn second(&self, case: &Case<'_>, result: &mut Attribution) -> Option<PairFit> {
        let found = pairs::search(case.library, &case.z, &case.fits, self.settings.polished);
        let top = case.fits.first().map_or(f64::NEG_INFINITY, |f| f.log_z);
        let width = case.library.whitening.width();
        result.pairs = found
            .iter()
            .take(REPORTED_PAIRS)
            .map(|p| PairCandidate {
                ids: p.effects.map(|e| self.id(e)),
                theta: [0, 1].map(|k| {
                    let space = case.library.effects.get(p.effects[k]).map(|s| &s.space);
                    space.map(|s| s.value(&p.units[k])).unwrap_or_default()
                }),
                gain: p.log_z - top,
                residual_score: score(p.left.squared, width),
            })
            .collect();
        let first = top - Library::null(&case.z);
        let limits = &self.limits;
        let inadequate = |left| {
            limits.judge.odds(&features(left, case.z.norm_squared(), width)) > limits.adequate
        };
        let alone = case.fits.first().map(|f| case.library.left(&case.z, f));
        found.into_iter().next().filter(|p| {
            let gain = p.log_z - top;
            // Much better than one effect, or good enough where one effect is not.
            gain > LEAST_PAIR_GAIN
                && (pairs::relative(gain, first) > limits.pair_gain
                    || alone.is_some_and(inadequate) && !inadequate(p.left))
        })
    }

    fn verdict(
        &self,
        case: &Case<'_>,
        alarm: bool,
        pair: Option<PairFit>,
        result: &mut Attribution,
    ) {
        let library = case.library;
        let width = library.whitening.width();
        let mut order: Vec<usize> = (0..case.fits.len()).collect();
        let posterior = |fit: &Fit| case.posterior.get(fit.effect).copied().unwrap_or(0.0);
        order.sort_by(|a, b| {
            let (a, b) = (&case.fits[*a], &case.fits[*b]);
            posterior(b).total_cmp(&posterior(a)).then(b.log_z.total_cmp(&a.log_z))
        });
        let Some(first) = order.first().map(|k| &case.fits[*k]) else { return };
        let rivals: Vec<usize> =
            order.iter().skip(1).take(RIVALS).map(|k| case.fits[*k].effect).collect();
        let merged = if alarm {
            ambiguity::merged(library, first, &rivals, &case.posterior)
        } else {
            Vec::new()
        };
        let null = Library::null(&case.z);
        result.candidates = order
            .par_iter()
            .map(|k| {
                let fit = &case.fits[*k];
                let named = self.named(library, fit, posterior(fit));
                let apart = merged.iter().find(|(e, _)| *e == fit.effect);
                Candidate {
                    id: named.id,
                    posterior: named.probability,
                    log_evidence: fit.log_z - null,
                    theta: named.theta,
                    theta_90: named.theta_90,
                    residual_score: score(library.left(&case.z, fit).squared, width),
                    distance: apart.map(|(_, d)| *d),
                }
            })
            .collect();
        let what = match &pair {
            Some(p) => p.left,
            None => library.left(&case.z, first),
        };
        let excess = case.z.norm_squared() - width as f64;
        let left = (what.squared - width as f64).max(0.0);
        let judged = features(what, case.z.norm_squared(), width);
        result.adequacy.score = self.limits.judge.odds(&judged);
        result.adequacy.residual = score(what.squared, width);
        result.adequacy.explained =
            if excess > 0.0 { (1.0 - left / excess).clamp(0.0, 1.0) } else { 1.0 };
        if !alarm {
            return;
        }
        let own = self.named(library, first, posterior(first));
        if pair.is_some() {
            result.adequacy.limit = self.limits.adequate_pair;
        }
        let adequate = result.adequacy.score <= result.adequacy.limit;
        result.outcome = match pair {
            Some(p) if adequate => Outcome::Several { effects: self.both(case, &p) },
            _ if !adequate => {
                let rest = self.rest(case, first, left, excess, &result.blocks);
                let mostly = result.adequacy.explained >= MOSTLY;
                if mostly && own.probability >= self.settings.sure {
                    Outcome::NamedWithRemainder { effect: own, remainder: rest }
                } else {
                    Outcome::NotInLibrary { remainder: rest }
                }
            }
            _ if own.probability >= self.settings.sure && merged.is_empty() => {
                Outcome::Named { effect: own }
            }
            _ => {
                let mut set = self.limits.calibration.set(&case.posterior);
                set.extend(merged.iter().map(|(e, _)| *e));
                let inside = order.iter().map(|k| &case.fits[*k]);
                let effects: Vec<Named> = inside
                    .filter(|f| set.contains(&f.effect))
                    .map(|f| self.named(library, f, posterior(f)))
                    .collect();
                match &effects[..] {
                    [only] => Outcome::Named { effect: only.clone() },
                    _ => Outcome::OneOf { effects },
                }
            }
        };
    }

    fn id(&self, effect: usize) -> String {
        self.bank.effects.get(effect).map(|e| e.id.clone()).unwrap_or_default()
    }

    fn named(&self, library: &Library, fit: &Fit, probability: f64) -> Named {
        let (theta, theta_90) = match library.effects.get(fit.effect) {
            None => (Vec::new(), Vec::new()),
            Some(s) => {
                let ends: Vec<[f64; 2]> =
                    (0..s.space.len()).map(|k| fit.interval(k, self.limits.widen)).collect();
                let side =
                    |i: usize| s.space.value(&ends.iter().map(|e| e[i]).collect::<Vec<f64>>());
                let (low, high) = (side(0), side(1));
                let both = low.into_iter().zip(high).map(|(a, b)| [a, b]).collect();
                (s.space.value(&fit.unit), both)
            }
        };
        Named { id: self.id(fit.effect), probability, theta, theta_90 }
    }

    /// Both effects of a pair, each with its share of the evidence among pairs that hold it.
    fn both(&self, case: &Case<'_>, pair: &PairFit) -> Vec<Named> {
        [0, 1]
            .map(|k| {
                let effect = pair.effects[k];
                let space = case.library.effects.get(effect).map(|s| &s.space);
                let theta = space.map(|s| s.value(&pair.units[k])).unwrap_or_default();
                // Given the other effect: what the flight says about this one.
                let other = case.library.effects.get(pair.effects[1 - k]);
                let own = case.library.effects.get(effect);
                let interval = own.zip(other).map(|(own, other)| {
                    let rest = &case.z - other.mean(&other.coordinates(&pair.units[1 - k]));
                    super::evidence::Sufficient::new(own, &rest).fit(effect)
                });
                let theta_90 = interval
                    .map(|fit| self.named(case.library, &fit, 0.0).theta_90)
                    .unwrap_or_default();
                let probability = 1.0 - self.settings.false_second;
                Named { id: self.id(effect), probability, theta, theta_90 }
            })
            .to_vec()
    }

    fn rest(
        &self,
        case: &Case<'_>,
        fit: &Fit,
        left: f64,
        gap: f64,
        blocks: &[BlockScore],
    ) -> Remainder {
        let mean = case.library.effects.get(fit.effect).map(|s| s.mean(&fit.h));
        let residual = mean.map_or_else(|| case.z.clone(), |m| &case.z - m);
        let block = blocks.first().map(|b| b.block.clone()).unwrap_or_default();
        remainder(case.library, &residual, left, gap, &self.bank.names, block)
    }

    fn blocks(&self, groups: &Groups, statistics: &[f64]) -> Vec<BlockScore> {
        let mut scores: Vec<(bool, BlockScore)> = groups
            .scores(statistics)
            .into_iter()
            .map(|(block, count, score)| {
                let nulls = self.limits.blocks.get(&block).map_or(&[][..], Vec::as_slice);
                let n = nulls.len() as f64;
                let mean = nulls.iter().sum::<f64>() / n.max(1.0);
                let variance =
                    nulls.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
                let above = nulls.iter().filter(|v| **v >= score).count();
                let score = BlockScore {
                    block: block.name().to_string(),
                    statistics: count,
                    score,
                    // A score has a sigma of one where the covariance holds. Fewer in the simulator, where a clock is
                    // exact, makes nothing of a real one loud.
                    sigma: (score - mean) / variance.sqrt().max(1.0),
                    p_value: (above as f64 + 1.0) / (n + 1.0),
                };
                (block.is_consequence(), score)
            })
            .collect();
        scores.sort_by(|(a_follows, a), (b_follows, b)| {
            a_follows.cmp(b_follows).then(b.sigma.total_cmp(&a.sigma))
        });
        scores.into_iter().map(|(_, score)| score).collect()
    }

    /// Whether any statistic differs from the null by more than what matters.
    fn material(&self, library: &Library, z: &DVector<f64>) -> bool {
        if self.settings.material.is_empty() {
            return true;
        }
        let u = library.whitening.undo(z);
        let standard = &library.whitening.standard;
        u.iter().enumerate().any(|(k, v)| {
            let least = standard.columns.get(k).and_then(|j| self.settings.material.get(*j));
            least.is_some_and(|least| expand(*v).abs() * standard.scale(k) >= *least)
        })
    }
}
