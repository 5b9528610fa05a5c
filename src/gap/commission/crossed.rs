//! Cross-validation of a commissioned simulator: how near it is, block by block, to accepted flights that it was not fitted to.

use serde::Serialize;

use super::solve::Posterior;
use super::{Hand, Linear, TRIAL_FLIGHTS, seeds};
use crate::shrink::{compressed, scales};
use crate::statistics::{specs, statistics_of};
use crate::trace::Trace;
use haltere_model::effects::Block;

/// Folds that accepted flights are dealt into.
const FOLDS: usize = 4;
/// Flights with benign jitter that say what healthy vehicles differ by.
const BENIGN_FLIGHTS: usize = 40;
/// Flights of a cross-validation.
pub const FLIGHTS: usize = 2 * (2 + FOLDS) * TRIAL_FLIGHTS + BENIGN_FLIGHTS;
/// Share of healthy vehicles within the limit.
const WITHIN: f64 = 0.95;

/// How near the simulator is to held-out flights: mean squared difference of a flight to the simulator's mean, in what healthy
/// vehicles differ by. A flight of a healthy vehicle has about 1.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Nearness {
    /// Block, or `all`.
    pub block: &'static str,
    /// With the vehicle file as it was.
    pub before: f64,
    /// As commissioned without these flights.
    pub after: f64,
    /// 95 % of healthy vehicles of the simulator are nearer than this.
    pub limit: f64,
    /// Of one accepted flight to the mean of others: what no simulator goes below.
    pub own: f64,
}

/// By block and over all.
pub struct Judged {
    pub blocks: Vec<Nearness>,
    pub whole: Nearness,
}

/// Judges. Statistics are those of the nominal chain of the file, which no flight has been fitted to.
pub fn judge(hand: &Hand<'_>, line: &Linear, found: &Posterior, accepted: &[&Trace]) -> Judged {
    let file = &hand.scene.vehicle;
    let nominal = hand.nominal(file);
    let real: Vec<Vec<f64>> =
        accepted.iter().filter_map(|trace| statistics_of(trace, &nominal).ok()).collect();
    let vehicle = hand.moved(&found.at);
    let benign = hand.rows(&vehicle, &nominal, &seeds(BENIGN_FLIGHTS), true);
    let mut sigmas = scales(&benign);
    for (sigma, spec) in sigmas.iter_mut().zip(specs()) {
        *sigma = sigma.hypot(spec.resolution);
    }
    let own = seeds(2 * TRIAL_FLIGHTS);
    let before = means(&hand.rows(file, &nominal, &own, false));
    let after_all = means(&hand.rows(&vehicle, &nominal, &own, false));
    let shown: Vec<usize> = (0..hand.constants.len()).filter(|k| found.shows(*k)).collect();
    let folds = FOLDS.min(real.len());
    // Held-out flight, the simulator without it, the other flights without it.
    let mut held_out: Vec<(&Vec<f64>, Vec<f64>, Vec<f64>)> = Vec::new();
    for fold in 0..folds {
        let in_fold = |k: usize| k % folds == fold;
        let at = line.evidence_without(in_fold).solve_for(&shown).at;
        let after = means(&hand.rows(&hand.moved(&at), &nominal, &own, false));
        let others: Vec<Vec<f64>> = real
            .iter()
            .enumerate()
            .filter(|(k, _)| !in_fold(*k))
            .map(|(_, row)| row.clone())
            .collect();
        let others = means(&others);
        let left_out = real.iter().enumerate().filter(|(k, _)| in_fold(*k));
        held_out.extend(left_out.map(|(_, row)| (row, after.clone(), others.clone())));
    }
    let nearness = |block: &'static str, is_of: &dyn Fn(usize) -> bool| {
        let places: Vec<usize> = (0..specs().len()).filter(|j| is_of(*j)).collect();
        let far = |row: &[f64], from: &[f64]| apart(row, from, &sigmas, &places);
        let mut healthy: Vec<f64> = benign.iter().map(|row| far(row, &after_all)).collect();
        healthy.sort_by(f64::total_cmp);
        let place = ((WITHIN * healthy.len() as f64) as usize).min(healthy.len().saturating_sub(1));
        Nearness {
            block,
            before: mean(held_out.iter().map(|(row, ..)| far(row, &before))),
            after: mean(held_out.iter().map(|(row, after, _)| far(row, after))),
            limit: healthy.get(place).copied().unwrap_or(f64::NAN),
            own: mean(held_out.iter().map(|(row, _, others)| far(row, others))),
        }
    };
    let causes = Block::CHAIN.into_iter().filter(|block| !block.is_consequence());
    let blocks: Vec<Nearness> = causes
        .map(|block| nearness(block.name(), &|j| specs()[j].block == block))
        .filter(|nearness| nearness.after.is_finite())
        .collect();
    Judged { blocks, whole: nearness("all", &|j| !specs()[j].block.is_consequence()) }
}

/// Mean squared difference over these statistics, in their sigmas; what sticks out far is compressed.
fn apart(row: &[f64], from: &[f64], sigmas: &[f64], places: &[usize]) -> f64 {
    mean(places.iter().map(|j| compressed((row[*j] - from[*j]) / sigmas[*j]).powi(2)))
}

fn means(rows: &[Vec<f64>]) -> Vec<f64> {
    (0..specs().len()).map(|j| mean(rows.iter().map(|row| row[j]))).collect()
}

/// Of what is known.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) =
        values.filter(|v| v.is_finite()).fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / count
}
