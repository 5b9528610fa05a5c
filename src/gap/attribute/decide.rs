//! The verdict: gate, names, second effect, adequacy, in this order.

use nalgebra::DVector;
use rayon::prelude::*;

use super::blocks::Groups;
use super::evidence::Fit;
use super::foretold::foretold;
use super::library::Library;
use super::open_set::{features, remainder, score};
use super::pairs::{self, PairFit};
use super::trials::seen_of;
use super::whiten::expand;
use super::{Adequacy, Attribution, Attributor, BlockScore, Candidate, Gate, PairCandidate};
use crate::outcome::{Named, Outcome, Remainder};

/// Fewer known statistics than this say nothing.
const LEAST_STATISTICS: usize = 8;
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
        let z = library.flight(statistics);
        let fits = library.explain(&z, settings.survivors);
        let seen = seen_of(library, &z);
        let posterior = limits.calibration.posterior(&library.likeness(&z));
        let case = Case { library, z, fits, posterior };
        let gate = Gate { material: self.material(library, &case.z), ..limits.gate.gate(&seen) };
        let mut result = Attribution {
            outcome: Outcome::NoMaterialGap,
            candidates: Vec::new(),
            pairs: Vec::new(),
            pair_limit: limits.pair_gain,
            blocks: self.blocks(groups, statistics),
            gate,
            adequacy: Adequacy {
                limit: limits.adequate,
                foretold_limit: settings.foretold,
                ..Adequacy::default()
            },
            remainder: Remainder::default(),
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
        let top = pairs::best_single(&case.fits);
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
        let null = Library::null(&case.z);
        let first = top - null;
        let limits = &self.limits;
        let inadequate = |left| {
            limits.judge.odds(&features(left, case.z.norm_squared(), width)) > limits.adequate
        };
        // Two pairs as likely as one another are no answer: one effect, or none, is named.
        let evidence: Vec<f64> = found.iter().map(|p| p.log_z - null).collect();
        let sure = limits.calibration.share_of_first(&evidence) >= self.settings.costs.alone();
        let alone = case.fits.first().map(|f| case.library.left(&case.z, f));
        found.into_iter().next().filter(|p| {
            let gain = p.log_z - top;
            // Much better than one effect, or good enough where one effect is not.
            gain > LEAST_PAIR_GAIN
                && (pairs::relative(gain, first) > limits.pair_gain
                    || alone.is_some_and(inadequate) && !inadequate(p.left))
                && sure
                && self.each_foretells(case, p)
        })
    }

    /// Whether each of two effects foretells what the other leaves.
    fn each_foretells(&self, case: &Case<'_>, pair: &PairFit) -> bool {
        [0, 1].into_iter().all(|k| {
            let [own, other] = [k, 1 - k].map(|k| case.library.effects.get(pair.effects[k]));
            let Some((own, other)) = own.zip(other) else { return false };
            let rest = &case.z - other.mean(&other.coordinates(&pair.units[1 - k]));
            foretold(own, &rest) >= self.settings.foretold
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
        let null = Library::null(&case.z);
        result.candidates = order
            .par_iter()
            .map(|k| {
                let fit = &case.fits[*k];
                let named = self.named(library, fit, posterior(fit));
                let left = library.left(&case.z, fit).squared;
                Candidate {
                    id: named.id,
                    posterior: named.probability,
                    log_evidence: fit.log_z - null,
                    theta: named.theta,
                    theta_90: named.theta_90,
                    explained: explained(left, &case.z),
                    residual_score: score(left, width),
                }
            })
            .collect();
        let what = match &pair {
            Some(p) => p.left,
            None => library.left(&case.z, first),
        };
        let judged = features(what, case.z.norm_squared(), width);
        let adequacy = &mut result.adequacy;
        adequacy.score = self.limits.judge.odds(&judged);
        adequacy.residual = score(what.squared, width);
        adequacy.explained = explained(what.squared, &case.z);
        if !alarm {
            return;
        }
        if pair.is_some() {
            adequacy.limit = self.limits.adequate_pair;
        }
        adequacy.foretold =
            library.effects.get(first.effect).map_or(0.0, |effect| foretold(effect, &case.z));
        let foretells = adequacy.foretold >= adequacy.foretold_limit;
        // Where no more than noise is left, and the effect foretells the gap, nothing speaks of another cause.
        let leaves_nothing = adequacy.explained >= 1.0 && foretells;
        let adequate = adequacy.score <= adequacy.limit || (leaves_nothing && pair.is_none());
        let own = self.named(library, first, posterior(first));
        // What may have no size is no name, however improbable all others are.
        let space = library.effects.get(first.effect).map(|s| &s.space);
        let sized = !space.is_some_and(|space| space.holds_off(&own.theta_90));
        let costs = self.settings.costs;
        let names = costs.names(order.iter().map(|k| posterior(&case.fits[*k])));
        let sure = own.probability >= costs.alone() && names == 1 && sized;
        // Against a limit of our own world the name of what foretells the gap must be surer.
        let surer = sure && own.probability >= 1.0 - costs.beside();
        let believed = foretells && (adequate || surer);
        let residual = match &pair {
            Some(p) => p.residual.clone(),
            None => library.residual(&case.z, first),
        };
        let share = 1.0 - adequacy.explained;
        result.remainder = remainder(library, &residual, share, &self.bank.names, &self.blocks);
        let rest = || result.remainder.clone();
        result.outcome = match pair {
            Some(p) if adequate => Outcome::Several { effects: self.both(case, &p) },
            _ if !believed => Outcome::NotInLibrary { remainder: rest() },
            _ if sure && adequate => Outcome::Named { effect: own },
            // What the simulator lacks of this vehicle is left by its true cause too.
            _ if sure => Outcome::NamedWithRemainder { effect: own, remainder: rest() },
            _ => {
                // At least two: one alone is not sure.
                let named = order.iter().map(|k| &case.fits[*k]).take(names.max(2));
                let effects = named.map(|f| self.named(library, f, posterior(f))).collect();
                // However many: what is explained is not missing from the library.
                Outcome::OneOf { effects }
            }
        };
    }

    pub(super) fn id(&self, effect: usize) -> String {
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

/// Share of the excess of the squared distance of `z` that is not left.
pub(super) fn explained(left: f64, z: &DVector<f64>) -> f64 {
    let width = z.len() as f64;
    let excess = z.norm_squared() - width;
    if excess > 0.0 { (1.0 - (left - width).max(0.0) / excess).clamp(0.0, 1.0) } else { 1.0 }
}
