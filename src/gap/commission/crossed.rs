//! Cross-validation of a commissioned simulator: how near it is, block by block, to accepted flights that it was not fitted to.

use serde::Serialize;

use super::solve::Posterior;
use super::{Hand, Linear, TRIAL_FLIGHTS, seeds};
use crate::flight::statistics::{specs, statistics_of};
use crate::flight::trace::Trace;
use crate::normal::student_quantile;
use crate::shrink::{compressed, mean, scales};
use haltere_model::Vehicle;
use haltere_model::effects::Block;

/// Flights with benign jitter that say what healthy vehicles differ by.
pub const BENIGN_FLIGHTS: usize = 40;
/// Share of healthy vehicles within the limit.
const WITHIN: f64 = 0.95;
/// How often a simulator that is right is called wrong by what the vehicle's own flights differ by, over all blocks (the usual level).
const FALSE_ALARM: f64 = 0.05;

/// Flights of a cross-validation of so many accepted ones.
pub fn flights(accepted: usize) -> usize {
    BENIGN_FLIGHTS + (2 + accepted) * TRIAL_FLIGHTS
}

/// How near the simulator is to held-out flights: mean squared difference of a flight to the simulator's mean, in what healthy
/// vehicles differ by. A flight of a healthy vehicle has about 1.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Nearness {
    /// Block, or `all`.
    pub block: &'static str,
    /// With the vehicle file as it was.
    pub before: f64,
    /// As commissioned without the flight.
    pub after: f64,
    /// 95 % of healthy vehicles of the simulator are nearer than this.
    pub healthy: f64,
    /// Of one accepted flight to the mean of others: what no simulator goes below.
    pub own: f64,
    /// What a simulator of this vehicle keeps: the larger of `healthy` and of what `own` may be by chance.
    pub limit: f64,
}

impl Nearness {
    /// Whether a simulator of this vehicle may be so far from its flights.
    pub fn holds(&self) -> bool {
        self.after <= self.limit
    }
}

/// By block and over all.
pub struct Judged {
    pub blocks: Vec<Nearness>,
    pub whole: Nearness,
}

/// An accepted flight beside simulator and vehicle, neither of which has seen it.
struct HeldOut<'a> {
    row: &'a [f64],
    before: &'a [f64],
    after: Vec<f64>,
    others: Vec<f64>,
}

/// Judges. Statistics are those of the nominal chain of the file, which no flight has been fitted to.
pub fn judge(hand: &Hand<'_>, line: &Linear, found: &Posterior, accepted: &[&Trace]) -> Judged {
    let file = &hand.scene.vehicle;
    let nominal = hand.nominal(file);
    let real: Vec<Vec<f64>> =
        accepted.iter().filter_map(|trace| statistics_of(trace, &nominal).ok()).collect();
    let vehicle = hand.moved(&found.at);
    let benign = hand.rows(&vehicle, &nominal, &seeds(BENIGN_FLIGHTS), true);
    // As few as accepted flights are: a mean of either is known alike.
    let few = seeds(TRIAL_FLIGHTS);
    let flown = |vehicle: &Vehicle| means(&hand.rows(vehicle, &nominal, &few, false));
    let (before, after_all) = (flown(file), flown(&vehicle));
    let shown: Vec<usize> = (0..hand.constants.len()).filter(|k| found.shows(*k)).collect();
    let without = |left_out: usize| {
        let at = line.evidence_without(|k| k == left_out).solve_for(&shown).at;
        flown(&hand.moved(&at))
    };
    nearness(&real, &before, without, &benign, &after_all)
}

/// The same of a simulator as it is: `seeds` are its flights, `benign` those with jitter.
pub fn judge_as_is(seeds: &[Vec<f64>], benign: &[Vec<f64>], accepted: &[Vec<f64>]) -> Judged {
    let simulator = means(seeds);
    nearness(accepted, &simulator, |_| simulator.clone(), benign, &simulator)
}

/// `before`: mean of the simulator that all flights are beside; `after`: of the one that has not seen the flight of this number;
/// `middle`: mean of the one whose flights with jitter are `benign`.
fn nearness(
    real: &[Vec<f64>],
    before: &[f64],
    after: impl Fn(usize) -> Vec<f64>,
    benign: &[Vec<f64>],
    middle: &[f64],
) -> Judged {
    let mut sigmas = scales(benign);
    for (sigma, spec) in sigmas.iter_mut().zip(specs()) {
        *sigma = sigma.hypot(spec.resolution);
    }
    let held_out: Vec<HeldOut<'_>> = real
        .iter()
        .enumerate()
        .map(|(k, row)| {
            let others = means(&[&real[..k], &real[k + 1..]].concat());
            HeldOut { row, before, after: after(k), others }
        })
        .collect();
    let nearness = |block: &'static str, of: usize, is_of: &dyn Fn(usize) -> bool| {
        let places: Vec<usize> =
            (0..specs().len()).filter(|j| is_of(*j) && !specs()[*j].relative).collect();
        let far = |row: &[f64], from: &[f64]| apart(row, from, &sigmas, &places);
        let mut benign: Vec<f64> = benign.iter().map(|row| far(row, middle)).collect();
        benign.sort_by(f64::total_cmp);
        let place = ((WITHIN * benign.len() as f64) as usize).min(benign.len().saturating_sub(1));
        let healthy = benign.get(place).copied().unwrap_or(f64::NAN);
        let own: Vec<f64> = held_out.iter().map(|h| far(h.row, &h.others)).collect();
        Nearness {
            block,
            before: mean(held_out.iter().map(|h| far(h.row, h.before))),
            after: mean(held_out.iter().map(|h| far(h.row, &h.after))),
            healthy,
            own: mean(own.iter().copied()),
            limit: healthy.max(by_chance(&own, of)),
        }
    };
    let causes = Block::CHAIN.into_iter().filter(|block| !block.is_consequence());
    let seen: Vec<Block> = causes
        .filter(|block| {
            let known = |j: usize| held_out.iter().any(|h| (h.row[j] / sigmas[j]).is_finite());
            (0..specs().len()).any(|j| specs()[j].block == *block && known(j))
        })
        .collect();
    let blocks = seen
        .iter()
        .map(|block| nearness(block.name(), seen.len(), &|j| specs()[j].block == *block))
        .collect();
    Judged { blocks, whole: nearness("all", 1, &|j| !specs()[j].block.is_consequence()) }
}

/// Mean distance that as many flights of this vehicle, flown anew, would have from their fellows at most: one of so many such limits
/// is passed by chance in [`FALSE_ALARM`] of the cases. Distances of accepted flights are its only source, so that a simulator's
/// errors do not widen it.
fn by_chance(own: &[f64], limits: usize) -> f64 {
    let n = own.len() as f64;
    let middle = mean(own.iter().copied());
    let square = own.iter().map(|d| (d - middle).powi(2)).sum::<f64>() / (n - 1.0);
    let p = 1.0 - FALSE_ALARM / limits as f64;
    // Of a difference of two such means.
    middle + student_quantile(p, n - 1.0) * (square * 2.0 / n).sqrt()
}

/// Mean squared difference over these statistics, in their sigmas; what sticks out far is compressed.
fn apart(row: &[f64], from: &[f64], sigmas: &[f64], places: &[usize]) -> f64 {
    mean(places.iter().map(|j| compressed((row[*j] - from[*j]) / sigmas[*j]).powi(2)))
}

fn means(rows: &[Vec<f64>]) -> Vec<f64> {
    (0..specs().len()).map(|j| mean(rows.iter().map(|row| row[j]))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_model::random::Stream;

    /// Vehicles of 8 flights with 12 statistics of which four at a time go together, beside a simulator that is off by so many sigma of a
    /// flight: share that passes one of 8 limits.
    fn passed(off: f64) -> f64 {
        let (flights, limits, vehicles) = (8, 8, 400);
        let mut rng = Stream::new(9, "limits");
        let mut flight = |off: f64| -> Vec<f64> {
            let groups: Vec<f64> = (0..3).map(|_| rng.normal()).collect();
            (0..12).map(|j| 0.8 * groups[j % 3] + 0.6 * rng.normal() + off).collect()
        };
        let places: Vec<usize> = (0..12).collect();
        let far = |row: &[f64], from: &[Vec<f64>]| {
            let from: Vec<f64> = places.iter().map(|j| mean(from.iter().map(|r| r[*j]))).collect();
            apart(row, &from, &[1.0; 12], &places)
        };
        let mut passes = |off: f64| {
            let real: Vec<Vec<f64>> = (0..flights).map(|_| flight(0.0)).collect();
            let simulated: Vec<Vec<f64>> = (0..flights).map(|_| flight(off)).collect();
            let own: Vec<f64> = (0..flights)
                .map(|k| far(&real[k], &[&real[..k], &real[k + 1..]].concat()))
                .collect();
            mean(real.iter().map(|row| far(row, &simulated))) > by_chance(&own, limits)
        };
        let any = (0..vehicles).filter(|_| (0..limits).any(|_| passes(off))).count();
        any as f64 / f64::from(vehicles)
    }

    #[test]
    fn prop_right_simulators_keep_what_flights_do_to_one_another_and_wrong_ones_do_not() {
        let [right, wrong] = [0.0, 1.5].map(passed);
        assert!(right <= FALSE_ALARM && wrong > 0.95, "{right} {wrong}");
    }
}
