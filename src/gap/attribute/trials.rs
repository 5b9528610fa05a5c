//! Limits from flights that taught nothing: the bank is split into folds, each is judged by what
//! the others teach (GAP.md 2.3: an in-sample limit gave 93 % false alarms, a split one 1.3 %).
//!
//! Held-out null flights give the gate and the ranks of the blocks. Held-out draws, as flights of the
//! airframe, give calibration, the limit of a second effect and the limit of adequacy. Pairs are
//! sums of two held-out draws.

use std::collections::BTreeMap;

use nalgebra::DVector;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::blocks::Groups;
use super::calibrate::{Calibration, Judged};
use super::evidence::Fit;
use super::gate::{Limit, Seen};
use super::library::{Library, Part};
use super::open_set::{Judge, features, score};
use super::pairs;
use super::surrogate::Surrogate;
use super::whiten::Whitening;
use super::{Settings, Teachers};
use crate::bank::Draw;
use crate::normal::{empirical_quantile, median};
use haltere_model::effects::Block;
use haltere_model::random::Stream;

/// Draws per effect that are judged, over all folds.
const JUDGED_DRAWS: usize = 16;
/// Of them, one in this many is searched for a second effect.
const PAIRED_ONE_IN: usize = 4;
/// Pairs that are judged, over all folds.
const JUDGED_PAIRS: usize = 80;
/// Pairs that are polished in a trial.
pub(super) const TRIAL_POLISHED: usize = 3;
/// Folds of the reference flights, and sessions in which each of them is judged.
const REFERENCE_FOLDS: usize = 4;

/// Everything a verdict is held against.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Limits {
    /// Is there a gap.
    pub gate: Limit,
    /// What a second effect must add, [`pairs::relative`].
    pub pair_gain: f64,
    /// Judge of explanations.
    pub judge: Judge,
    /// Largest odds of "not the cause" that a known effect reaches.
    pub adequate: f64,
    /// The same for two effects.
    pub adequate_pair: f64,
    /// Factor on the width of intervals, so that they cover as often as they say.
    pub widen: f64,
    /// Probabilities.
    pub calibration: Calibration,
    /// Scores of held-out null flights per block, rising.
    pub blocks: BTreeMap<Block, Vec<f64>>,
    /// Flights that the limits come from: nulls, singles, pairs.
    pub flights: [usize; 3],
}

struct Null {
    /// Normal score of the squared distance.
    distance: f64,
    /// Mean square along what effects do.
    along: f64,
    blocks: Vec<(Block, usize, f64)>,
}

struct Trial {
    judged: Judged,
    seen: Seen,
    /// What the best single leaves, and the best of the effects that are not the cause.
    single: [f64; 4],
    without: Option<[f64; 4]>,
    /// Evidence that the best pair adds, and what it leaves.
    pair: Option<(f64, [f64; 4])>,
    /// A flight with two effects.
    double: bool,
    /// Errors of the parameters of the right effect, in half widths of their interval.
    errors: Vec<f64>,
}

/// A flight whose effect is known.
struct Known {
    effect: usize,
    theta: Vec<f64>,
    statistics: Vec<f64>,
    search: bool,
    double: bool,
}

/// Banks with fewer flights with jitter are small: twice those of `--size small`, a half of the full ones (judgement) …
const FEW: usize = 120;
/// … and held out in this many parts: the most in which draws stay with their twins (`make_bank::FOLDS`).
const MOST_FOLDS: usize = 12;

/// In how many parts a bank is held out. What judges a flight that is held out has learned less than what judges the next
/// one: with 45 flights for 60 each of nine healthy flights was a gap by `--size small`, none of them where 55 are left to learn from.
fn folds(settings: &Settings, flights: usize) -> usize {
    if flights < FEW { settings.folds.max(MOST_FOLDS) } else { settings.folds.max(2) }
}

/// Cross-fits. `allowed`: statistics that may be used.
pub(super) fn limits(
    teachers: &Teachers<'_>,
    settings: &Settings,
    allowed: impl Fn(usize) -> bool + Copy + Sync,
) -> Limits {
    let folds = folds(settings, teachers.bank.jitter.len());
    let (mut nulls, mut trials) = (Vec::new(), Vec::new());
    for fold in 0..folds {
        let part = Part { held_out: Some((fold, folds)) };
        let library = teachers.library(part, allowed, settings);
        let groups = teachers.groups(&library);
        let judged = teachers.held_out_nulls(part);
        nulls.par_extend(judged.par_iter().map(|s| null(&library, &groups, &teachers.placed(s))));
        let known = flights(teachers, part, settings.law);
        trials.par_extend(known.par_iter().map(|k| trial(&library, settings, k)));
    }
    // Held-out flights of the airframe itself know better than the bank.
    let (judged, known) = match teachers.calibration {
        [] => (reference_distances(teachers, settings, allowed), teachers.references.len()),
        flights => {
            let all = Part { held_out: None };
            let rows = teachers.reference_rows();
            let whitening = teachers.whitening(all, &rows, allowed, settings);
            (flights.iter().map(|s| distance(&whitening, s)).collect(), flights.len())
        }
    };
    let of_bank: Vec<f64> = nulls.iter().map(|n| n.distance).collect();
    // The middle one: of 60 flights of one vehicle two made the mean three times as large.
    let louder = median(nulls.iter().map(|n| n.along));
    // Two ways to raise an alarm share the allowance.
    let gate = Limit::new(&of_bank, &judged, known, louder, settings.false_alarm / 2.0);
    let seen: Vec<&Trial> = trials.iter().filter(|t| gate.gate(&t.seen).open()).collect();
    let named: Vec<Judged> = seen.iter().filter(|t| !t.double).map(|t| t.judged.clone()).collect();
    let calibration = Calibration::new(&named);
    let single_gains =
        seen.iter().filter(|t| !t.double).filter_map(|t| t.pair.map(|(gain, _)| gain));
    let second = 1.0 - settings.false_second;
    let pair_gain = empirical_quantile(single_gains, second);
    let enough = 1.0 - settings.false_rejection;
    let singles = || seen.iter().filter(|t| !t.double);
    let known: Vec<_> = singles().map(|t| t.single).collect();
    let strange: Vec<_> = singles().filter_map(|t| t.without).collect();
    let judge = Judge::new(&known, &strange);
    let adequate = empirical_quantile(known.iter().map(|f| judge.odds(f)), enough);
    let two = seen.iter().filter(|t| t.double).filter_map(|t| t.pair);
    let scores = two.filter(|(gain, _)| *gain > pair_gain).map(|(_, left)| judge.odds(&left));
    let adequate_pair = empirical_quantile(scores, enough).max(adequate);
    let errors = seen.iter().flat_map(|t| t.errors.iter().copied());
    let widen = empirical_quantile(errors, 0.9).clamp(1.0, MOST_WIDENED);
    let mut blocks: BTreeMap<Block, Vec<f64>> = BTreeMap::new();
    for (block, _, value) in nulls.iter().flat_map(|n| &n.blocks) {
        blocks.entry(*block).or_default().push(*value);
    }
    for values in blocks.values_mut() {
        values.sort_by(f64::total_cmp);
    }
    let doubles = trials.iter().filter(|t| t.double).count();
    let flights = [nulls.len(), trials.len() - doubles, doubles];
    Limits { gate, pair_gain, judge, adequate, adequate_pair, widen, calibration, blocks, flights }
}

/// Intervals that need more than this are not worth widening: the surrogate is wrong.
const MOST_WIDENED: f64 = 5.0;
/// Least half width that an error is divided by, of the range.
const LEAST_HALF_WIDTH: f64 = 0.01;

fn null(library: &Library, groups: &Groups, statistics: &[f64]) -> Null {
    let z = library.flight(statistics);
    let along = |effect: &Surrogate| effect.q.column_iter().next().map(|q| q.dot(&z).powi(2));
    let squares: Vec<f64> = library.effects.iter().filter_map(along).collect();
    Null {
        distance: score(z.norm_squared(), z.len()),
        along: squares.iter().sum::<f64>() / squares.len().max(1) as f64,
        blocks: groups.scores(statistics),
    }
}

/// Normal score of the squared distance.
fn distance(whitening: &Whitening, statistics: &[f64]) -> f64 {
    score(whitening.flight(statistics).norm_squared(), whitening.width())
}

/// What the gate sees of a flight by whitened numbers.
pub(super) fn seen_of(library: &Library, z: &DVector<f64>) -> Seen {
    let distance = score(z.norm_squared(), library.whitening.width());
    Seen { evidence: library.evidence(z), distance }
}

fn trial(library: &Library, settings: &Settings, known: &Known) -> Trial {
    let z = library.flight(&known.statistics);
    // The best, and the best of the others; what may be one of a pair only where pairs are searched.
    let fits = library.explain(&z, if known.search { settings.survivors } else { 2 });
    let width = library.whitening.width();
    let best = fits.first();
    let whole = z.norm_squared();
    let leaves = |f: &Fit| features(library.left(&z, f), whole, width);
    let single = best.map_or([0.0; 4], leaves);
    let without = fits.iter().find(|f| f.effect != known.effect).filter(|_| !known.double);
    let top = pairs::best_single(&fits);
    let pair =
        known.search.then(|| pairs::search(library, &z, &fits, TRIAL_POLISHED)).and_then(|p| {
            let first = p.first()?;
            let gain = pairs::relative(first.log_z - top, top - Library::null(&z));
            Some((gain, features(first.left, whole, width)))
        });
    let right = fits.iter().find(|f| f.effect == known.effect && f.is_searched());
    let errors = match (right, library.effects.get(known.effect)) {
        (Some(fit), Some(s)) if !known.double => s
            .space
            .to_unit(&known.theta)
            .iter()
            .enumerate()
            .map(|(k, truth)| {
                let [low, high] = fit.interval(k, 1.0);
                let best = fit.unit.get(k).copied().unwrap_or(0.5);
                let half = if *truth > best { high - best } else { best - low };
                (truth - best).abs() / half.max(LEAST_HALF_WIDTH)
            })
            .collect(),
        _ => Vec::new(),
    };
    Trial {
        judged: Judged { evidence: library.likeness(&z), truth: known.effect },
        seen: seen_of(library, &z),
        single,
        without: without.map(leaves),
        pair,
        double: known.double,
        errors,
    }
}

/// Held-out flights with one and with two effects.
///
/// Each is flown by another law of its effect, off by `law`: flights by the library's own law are
/// explained so well that the judge would call every other vehicle's effect unknown.
fn flights(teachers: &Teachers<'_>, part: Part, law: f64) -> Vec<Known> {
    let folds = part.held_out.map_or(1, |(_, folds)| folds);
    let mut rng = Stream::new(part.held_out.map_or(0, |(fold, _)| fold as u64), "another law");
    let mut flown = |draws: &[&Draw]| -> Vec<f64> {
        let mut flight = draws.first().map_or_else(Vec::new, |draw| teachers.without_effect(draw));
        for draw in draws {
            let effect = teachers.effect(draw, law, &mut rng);
            flight.iter_mut().zip(effect).for_each(|(v, off)| *v += off);
        }
        flight
    };
    let held: Vec<Vec<&Draw>> = teachers
        .bank
        .effects
        .iter()
        .map(|e| {
            let out = e.draws.iter().enumerate().filter(|(i, _)| !part.teaches(*i));
            out.map(|(_, d)| d).collect()
        })
        .collect();
    let mut known = Vec::new();
    for (effect, draws) in held.iter().enumerate() {
        for (k, draw) in draws.iter().take(JUDGED_DRAWS.div_ceil(folds)).enumerate() {
            known.push(Known {
                effect,
                theta: draw.theta.clone(),
                statistics: flown(&[draw]),
                search: (k + effect).is_multiple_of(PAIRED_ONE_IN),
                double: false,
            });
        }
    }
    let effects = held.len();
    for k in 0..if effects > 1 { JUDGED_PAIRS.div_ceil(folds) } else { 0 } {
        // Walks through the effects with steps that meet all combinations of blocks.
        let a = (k * STRIDE) % effects;
        let b = (a + 1 + (k * k + k / effects) % (effects - 1)) % effects;
        let pick = |e: usize| held[e].get(k % held[e].len().max(1));
        if let (Some(x), Some(y)) = (pick(a), pick(b)) {
            known.push(Known {
                effect: a,
                theta: x.theta.clone(),
                statistics: flown(&[x, y]),
                search: true,
                double: true,
            });
        }
    }
    known
}

/// Prime to any likely number of effects.
const STRIDE: usize = 37;

/// Reference flights, each fold judged with the others as reference, in hours that the bank did not teach: in those that it did the limit
/// let 17 of 93 healthy flights of another simulator raise an alarm, and so 4.
fn reference_distances(
    teachers: &Teachers<'_>,
    settings: &Settings,
    allowed: impl Fn(usize) -> bool + Copy + Sync,
) -> Vec<f64> {
    let folds = REFERENCE_FOLDS.min(teachers.references.len());
    let mut found = Vec::new();
    for fold in 0..folds {
        let side = |held: bool| -> Vec<&[f64]> {
            let rows = teachers.references.iter().enumerate();
            rows.filter(|(i, _)| (i % folds == fold) == held).map(|(_, r)| r.as_slice()).collect()
        };
        let part = Part { held_out: Some((fold, MOST_FOLDS)) };
        let whitening = teachers.whitening(part, &side(false), allowed, settings);
        // Flights of several hours are moved once, by the constants that they share.
        let turns = if teachers.hours.one > 0.0 { REFERENCE_FOLDS } else { 1 };
        let held: Vec<Vec<f64>> = (0..turns)
            .flat_map(|turn| side(true).into_iter().enumerate().map(move |(k, row)| (turn, k, row)))
            .map(|(turn, k, row)| teachers.elsewhen(row, part, turn + turns * k))
            .collect();
        found.extend(held.iter().map(|s| distance(&whitening, s)));
    }
    found
}
