//! Commissioning: the constants of the vehicle file with which the simulator flies as accepted flights were flown, each with an
//! interval, and how far that brings it on flights that it was not fitted to.
//!
//! The diagnosis asks what a flight has that the simulator lacks. What the simulator lacks on every flight, a wrong thrust law or
//! another inner loop, has to go first, or each effect is sought through it (docs/GAP.md, 2.9).
//!
//! **Method.** Indirect inference (Gouriéroux, Monfort and Renault 1993): real and simulated flights of one mission are observed alike,
//! and the constants are those with which the means of their statistics agree. Slopes are central differences of simulated flights
//! with the same seeds; [`solve`] makes the step, with the file as prior; a step is taken as far as flights at its end are nearer. There
//! slopes are those that the step would have foretold, and anew where it led beyond the flights that they were taken from. The
//! nominal chain that residuals are formed with follows the constants, so that a statistic near zero stays a sharp one.
//!
//! **What flights do not show** stays as the file says: a constant of which they leave more than [`solve::SHOWN`] of its prior's sigma.
//!
//! **Cross-validation.** The constants are found anew without each accepted flight, from the last slopes, and flown. How far that flight
//! is from the simulator, before and after, is told block by block, in squares of what healthy vehicles differ by. The simulator is
//! this vehicle's where that is within what 95 % of flights with benign jitter keep, or within what the accepted flights do to one
//! another: each of them beside the mean of the others, as it stands beside the simulator.

mod begun;
pub mod budget;
mod constants;
mod crossed;
mod kept;
mod solve;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use serde::Serialize;

use crate::bank::Bank;
use crate::bank::fly::fly_observed_into;
use crate::bank::jitter::jittered;
use crate::bank::kept_file::fnv;
use crate::flight::logs::Flown;
use crate::flight::statistics::{specs, statistics_of};
use crate::flight::trace::Trace;
use crate::nominal::Nominal;
use crate::normal;
use crate::scene::Scene;
use constants::{CONSTANTS, Constant, moved};
use haltere_core::checks::Problems;
use haltere_model::Vehicle;
use solve::{Evidence, Posterior};

pub use crossed::Nearness;
pub use kept::{Fitted, Moved, begun_with, fitted};

/// Fewest accepted flights: of fewer the spread from flight to flight is not known (as for a diagnosis).
pub const LEAST_FLIGHTS: usize = 8;
/// Steps, and one more: the first crosses most of the way, the third is within its noise (on simulated vehicles whose constants were
/// moved by 15 %).
const ROUNDS: usize = 3;
/// Simulated flights that a mean and its spread are of.
const MEAN_FLIGHTS: usize = 24;
/// Pairs of flights behind a slope, and half of their distance in sigma of the prior.
const SLOPE_FLIGHTS: usize = 4;
const SLOPE_SIGMAS: f64 = 0.5;
/// Share of a slope that is not believed: so much it changes within a sigma of the prior, and differs from pair to pair (judgement). It
/// keeps a statistic that hardly varies from knowing a constant without end.
const SLOPE_ERROR: f64 = 0.05;
/// Fewest flights of the file as it is that must come to their end: less than half of a bank's may, since commissioning is to mend that.
const LEAST_FLOWN: usize = 6;
/// Shares of a step that are tried, and flights for each.
const SHARES: [f64; 3] = [1.0, 0.5, 0.25];
const TRIAL_FLIGHTS: usize = 8;
/// Changes of a statistic below this share of it are rounding.
const NEGLIGIBLE: f64 = 1e-9;
/// First seed of these flights: none of a bank's.
const SEED: u64 = 7_900_000;

/// Why nothing was found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NotCommissioned {
    /// Too few flights.
    #[error(
        "{found} accepted flights that can be observed, at least {LEAST_FLIGHTS} needed, 20 are better{why}"
    )]
    TooFew {
        /// How many.
        found: usize,
        /// What became of one of the others.
        why: String,
    },
    /// The simulator does not fly the mission with the vehicle file as it is.
    #[error(
        "{flown} of {MEAN_FLIGHTS} simulated flights of this mission came to its end with the vehicle file as it is, and no more with \
         the thrust, drag and lag of the real ones; at least {LEAST_FLOWN} are needed: `haltere gap bank LOG --vehicle FILE` says which number they fail by"
    )]
    NotFlown {
        /// How many did.
        flown: usize,
    },
}

/// A constant as it was found.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Found {
    /// Key in the vehicle file, with its axis.
    pub key: &'static str,
    /// As the file says.
    pub file: f64,
    /// As found; that of the file where flights do not show it.
    pub value: f64,
    /// 90 % interval.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
    /// By how many sigma of its prior it moved.
    pub sigmas: f64,
    /// Whether flights show it.
    pub shown: bool,
}

impl Found {
    /// Whether it moved by more than its owner may be wrong by.
    pub fn moved_far(&self) -> bool {
        moved_far(self.sigmas)
    }
}

/// Whether a constant moved by more than its owner may be wrong by.
fn moved_far(sigmas: f64) -> bool {
    sigmas.abs() > 1.0
}

/// What was found.
#[derive(Debug, Clone, Serialize)]
pub struct Commissioned {
    /// The vehicle.
    pub vehicle: Vehicle,
    /// Its constants, in the order of the file.
    pub constants: Vec<Found>,
    /// How near the simulator is to accepted flights that it was not fitted to, by block.
    pub blocks: Vec<Nearness>,
    /// The same over all of them.
    pub whole: Nearness,
    /// Accepted flights.
    pub flights: usize,
    /// Simulated flights that were flown for it.
    pub simulated: usize,
}

impl Commissioned {
    /// Why the simulator is not this vehicle's yet; `None`: it can be judged by. Flights that it was not fitted to are farther off in a
    /// block than a simulator of this vehicle is.
    pub fn why_not_yet(&self) -> Option<String> {
        why_not_yet(&self.blocks)
    }
}

/// Why the simulator of a bank is not this vehicle's yet, by accepted flights; `None`: it can be judged by, or too few were given to say.
pub fn not_yet(bank: &Bank, accepted: &[Vec<f64>]) -> Option<String> {
    if accepted.len() < LEAST_FLIGHTS {
        return None;
    }
    why_not_yet(&crossed::judge_as_is(&bank.seeds, &bank.jitter, accepted).blocks)
}

fn why_not_yet(blocks: &[Nearness]) -> Option<String> {
    let beyond = blocks.iter().filter(|n| !n.holds());
    let far: Vec<String> =
        beyond.map(|n| format!("{} {:.1} (limit {:.1})", n.block, n.after, n.limit)).collect();
    (!far.is_empty()).then(|| {
        format!(
            "the simulator is not this vehicle's yet: accepted flights that it was not fitted to are farther off than healthy \
             vehicles and than they are from one another: {}",
            far.join(", ")
        )
    })
}

/// Finds the constants. `scene`: room, companion and the vehicle file as it is; `progress`: done, of how many.
pub fn commission(
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    accepted: &[Flown],
    progress: impl Fn(usize, usize) + Sync,
) -> Result<Commissioned, NotCommissioned> {
    let traces: Vec<&Trace> = accepted.iter().map(|flown| &flown.trace).collect();
    commission_traces(scene, items, &traces, progress)
}

/// The same from what was recorded of the flights.
pub fn commission_traces(
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    accepted: &[&Trace],
    progress: impl Fn(usize, usize) + Sync,
) -> Result<Commissioned, NotCommissioned> {
    commission_for(&CONSTANTS, scene, items, accepted, &progress)
}

fn commission_for(
    constants: &[Constant],
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    accepted: &[&Trace],
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Commissioned, NotCommissioned> {
    commission_by(&Hand::of(constants, scene, items, accepted.len(), progress), accepted)
}

fn commission_by(hand: &Hand<'_>, accepted: &[&Trace]) -> Result<Commissioned, NotCommissioned> {
    let file = &hand.scene.vehicle;
    let mut line = Linear::first(hand, accepted)?;
    for _ in 1..ROUNDS {
        let posterior = line.evidence().solve();
        let Some(better) = line.step(hand, &posterior) else { break };
        line = line.moved_to(hand, &better, accepted)?;
    }
    let posterior = line.evidence().solve_shown();
    let mut vehicle = hand.moved(&posterior.at);
    vehicle.commissioned.flights = accepted.len().try_into().unwrap_or(u32::MAX);
    let judged = crossed::judge(hand, &line, &posterior, accepted);
    let z90 = normal::quantile(0.95);
    let found = |(k, constant): (usize, &Constant)| Found {
        key: constant.key,
        file: constant.value(file),
        value: constant.value(&vehicle),
        low: constant.moved(file, posterior.at[k] - z90 * posterior.std[k]),
        high: constant.moved(file, posterior.at[k] + z90 * posterior.std[k]),
        sigmas: constant.sigmas(file, constant.value(&vehicle)),
        shown: posterior.shows(k),
    };
    Ok(Commissioned {
        constants: hand.constants.iter().enumerate().map(found).collect(),
        vehicle,
        blocks: judged.blocks,
        whole: judged.whole,
        flights: accepted.len(),
        simulated: hand.known().len(),
    })
}

/// Who flies.
struct Hand<'a> {
    constants: &'a [Constant],
    scene: &'a Scene,
    items: &'a [MISSION_ITEM_INT_DATA],
    done: AtomicUsize,
    /// Of how many, if every step is taken at once.
    of: usize,
    /// Fewest real flights.
    least: usize,
    /// Pairs of flights behind a slope.
    pairs: usize,
    /// What was flown.
    flown: Arc<Mutex<Known>>,
    progress: &'a (dyn Fn(usize, usize) + Sync),
}

/// Flights by a hash of all that tells them apart: a constant at its bound is not moved, and the file's own are asked for again.
type Known = BTreeMap<u64, Option<Vec<f64>>>;

impl<'a> Hand<'a> {
    fn of(
        constants: &'a [Constant],
        scene: &'a Scene,
        items: &'a [MISSION_ITEM_INT_DATA],
        accepted: usize,
        progress: &'a (dyn Fn(usize, usize) + Sync),
    ) -> Self {
        // A step takes a fifth of the constants so far that their slopes are taken anew (three drawn worlds).
        let slopes = 2 * SLOPE_FLIGHTS * constants.len() * (4 + ROUNDS) / 5;
        let of = ROUNDS * MEAN_FLIGHTS + slopes + crossed::flights(accepted);
        let (done, least, pairs) = (AtomicUsize::new(0), LEAST_FLIGHTS, SLOPE_FLIGHTS);
        let flown = Arc::default();
        Self { constants, scene, items, done, of, least, pairs, flown, progress }
    }
}

impl Hand<'_> {
    /// The vehicle of the file with its constants so many sigma of their priors from there.
    fn moved(&self, at: &[f64]) -> Vehicle {
        moved(self.constants, &self.scene.vehicle, at)
    }

    fn done(&self) -> usize {
        self.done.load(Ordering::Relaxed)
    }

    fn tell(&self) {
        let done = 1 + self.done.fetch_add(1, Ordering::Relaxed);
        (self.progress)(done.min(self.of), self.of);
    }

    fn known(&self) -> MutexGuard<'_, Known> {
        self.flown.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// The nominal chain of a vehicle in this scene.
    fn nominal(&self, vehicle: &Vehicle) -> Nominal {
        Nominal { vehicle: vehicle.clone(), ..Nominal::of_scene(self.scene) }
    }

    /// Flights of vehicles by seeds, as a nominal chain sees them, each flown once; `None`: refused, or not to its end.
    fn fly(
        &self,
        jobs: &[(&Vehicle, u64)],
        nominal: &Nominal,
        jitter: bool,
    ) -> Vec<Option<Vec<f64>>> {
        // Debug output of numbers is exact.
        let chain = fnv(format!("{:?} {jitter}", nominal.vehicle).as_bytes());
        let key = |(vehicle, seed): &(&Vehicle, u64)| {
            fnv(format!("{vehicle:?} {seed} {chain}").as_bytes())
        };
        let keys: Vec<u64> = jobs.iter().map(key).collect();
        let mut new: BTreeMap<u64, &(&Vehicle, u64)> = keys.iter().copied().zip(jobs).collect();
        new.retain(|key, _| !self.known().contains_key(key));
        (new.len()..jobs.len()).for_each(|_| self.tell());
        let fly = |trace: &mut Trace, (vehicle, seed): &(&Vehicle, u64)| {
            self.tell();
            let mut problems = Problems::new();
            vehicle.check("vehicle", &mut problems);
            problems.into_result().ok()?;
            let scene = Scene { vehicle: (*vehicle).clone(), ..self.scene.clone() };
            let mut plant = scene.plant(*seed);
            if jitter {
                plant = jittered(plant).ok()?;
            }
            fly_observed_into(trace, &scene, self.items, plant, scene.pilot.clone()).ok()?;
            let whole = trace.came_as_far_as(scene.until_s) && trace.crashed != Some(true);
            whole.then(|| statistics_of(trace, nominal).ok())?
        };
        let trace = || Trace::new(self.scene.survey.clone());
        let new: Vec<_> = new.into_iter().collect();
        let rows = new.par_iter().map_init(trace, |trace, (key, job)| (*key, fly(trace, job)));
        let rows: Vec<_> = rows.collect();
        let mut known = self.known();
        known.extend(rows);
        keys.iter().map(|key| known.get(key)?.clone()).collect()
    }

    /// Flights of one vehicle by these seeds that came to their end.
    fn rows(
        &self,
        vehicle: &Vehicle,
        nominal: &Nominal,
        seeds: &[u64],
        jitter: bool,
    ) -> Vec<Vec<f64>> {
        let jobs: Vec<_> = seeds.iter().map(|seed| (vehicle, *seed)).collect();
        self.fly(&jobs, nominal, jitter).into_iter().flatten().collect()
    }
}

fn seeds(flights: usize) -> Vec<u64> {
    (0..flights as u64).map(|k| SEED + k).collect()
}

/// Real and simulated flights beside one another where the constants are, and what each of these does there.
struct Linear {
    nominal: Nominal,
    at: Vec<f64>,
    /// Statistics that all flights could say.
    places: Vec<usize>,
    /// A row for each accepted flight and for each simulated one, of these statistics.
    real: Vec<Vec<f64>>,
    simulated: Vec<Vec<f64>>,
    /// Seeds of the simulated ones: where a vehicle is not flown by every seed, it is flown by these.
    seeds: Vec<u64>,
    slopes: DMatrix<f64>,
}

impl Linear {
    /// At the file, or, where its simulator does not fly, at what the flights themselves say of it ([`begun`]), as far as that is asked
    /// for.
    fn first(hand: &Hand<'_>, accepted: &[&Trace]) -> Result<Self, NotCommissioned> {
        let at_file = Self::at(hand, &vec![0.0; hand.constants.len()], accepted);
        let Err(not_flown @ NotCommissioned::NotFlown { .. }) = at_file else { return at_file };
        let file = &hand.scene.vehicle;
        match begun::begun(hand.scene, hand.items, accepted) {
            // What is told is what became of the file's own flights.
            Some(vehicle) => {
                let sigmas = |constant: &Constant| constant.sigmas(file, constant.value(&vehicle));
                let at: Vec<f64> = hand.constants.iter().map(sigmas).collect();
                Self::at(hand, &at, accepted).map_err(|_| not_flown)
            }
            None => Err(not_flown),
        }
    }

    /// There, with slopes of flights about it.
    fn at(hand: &Hand<'_>, at: &[f64], accepted: &[&Trace]) -> Result<Self, NotCommissioned> {
        let (mut line, rows) = Self::beside(hand, at, accepted, |_| true)?;
        let all: Vec<usize> = (0..hand.constants.len()).collect();
        line.slopes = slopes(hand, &line, &rows, &all);
        Ok(line)
    }

    /// There, with the slopes of here as the step shows them ([`solve::carried`]); new ones of constants that it took beyond the interval
    /// over which their slope was taken.
    fn moved_to(
        &self,
        hand: &Hand<'_>,
        at: &[f64],
        accepted: &[&Trace],
    ) -> Result<Self, NotCommissioned> {
        let known = |j: &usize| self.places.binary_search(j).is_ok();
        let (mut line, rows) = Self::beside(hand, at, accepted, known)?;
        let kept: Vec<usize> =
            line.places.iter().filter_map(|j| self.places.binary_search(j).ok()).collect();
        let step = DVector::from_fn(at.len(), |k, _| at[k] - self.at[k]);
        let [was, is] = [self.evidence().off, line.evidence().off];
        let mean_by_chance = |of: &Self, place| {
            let rows: Vec<&Vec<f64>> = of.simulated.iter().collect();
            moments(&rows, place)[1] / rows.len() as f64
        };
        let taken: Vec<[f64; 2]> = kept
            .iter()
            .enumerate()
            .map(|(place, before)| {
                let chance = mean_by_chance(self, *before) + mean_by_chance(&line, place);
                [was[*before] - is[place], chance]
            })
            .collect();
        line.slopes = solve::carried(self.slopes.select_rows(&kept), &step, &taken, SLOPE_ERROR);
        let beyond: Vec<usize> = (0..at.len()).filter(|k| step[*k].abs() > SLOPE_SIGMAS).collect();
        let anew = slopes(hand, &line, &rows, &beyond);
        for (column, k) in anew.column_iter().zip(&beyond) {
            line.slopes.set_column(*k, &column);
        }
        Ok(line)
    }

    /// Flights beside one another there, without slopes; `of_use`: statistics that may be used. With what the simulated ones say of all.
    fn beside(
        hand: &Hand<'_>,
        at: &[f64],
        accepted: &[&Trace],
        of_use: impl Fn(&usize) -> bool,
    ) -> Result<(Self, Vec<Vec<f64>>), NotCommissioned> {
        let vehicle = hand.moved(at);
        let nominal = hand.nominal(&vehicle);
        let real = observed(accepted, hand.least, &nominal)?;
        let jobs: Vec<_> = seeds(MEAN_FLIGHTS).into_iter().map(|seed| (&vehicle, seed)).collect();
        let flown = hand.fly(&jobs, &nominal, false).into_iter().zip(jobs);
        let (seeds, rows): (Vec<u64>, Vec<Vec<f64>>) =
            flown.filter_map(|(row, (_, seed))| Some((seed, row?))).unzip();
        if rows.len() < LEAST_FLOWN {
            return Err(NotCommissioned::NotFlown { flown: rows.len() });
        }
        let known = |j: &usize| {
            let of = |row: &Vec<f64>| row[*j];
            let first = of(&rows[0]);
            // One that never varies says nothing, and would say it without end.
            !specs()[*j].relative
                && real.iter().chain(&rows).all(|row| of(row).is_finite())
                && rows.iter().any(|row| (of(row) - first).abs() > NEGLIGIBLE * first.abs())
        };
        let places: Vec<usize> = (0..specs().len()).filter(|j| of_use(j) && known(j)).collect();
        let of_places = |rows: &[Vec<f64>]| {
            rows.iter().map(|row| places.iter().map(|j| row[*j]).collect()).collect()
        };
        let (real, simulated) = (of_places(&real), of_places(&rows));
        let slopes = DMatrix::zeros(places.len(), hand.constants.len());
        Ok((Self { nominal, at: at.to_vec(), places, real, simulated, seeds, slopes }, rows))
    }

    /// What all accepted flights show.
    fn evidence(&self) -> Evidence {
        self.evidence_without(|_| false)
    }

    /// What those show that are not left out, by their place.
    fn evidence_without(&self, left_out: impl Fn(usize) -> bool) -> Evidence {
        let kept = self.real.iter().enumerate().filter(|(k, _)| !left_out(*k));
        let real: Vec<&Vec<f64>> = kept.map(|(_, row)| row).collect();
        let mut evidence = self.evidence_of(&real, &self.simulated.iter().collect::<Vec<_>>());
        for (chance, slopes) in evidence.chance.iter_mut().zip(self.slopes.row_iter()) {
            *chance += (SLOPE_ERROR * slopes.norm()).powi(2);
        }
        evidence
    }

    /// What these flights show beside simulated ones, with slopes that are right.
    fn evidence_of(&self, real: &[&Vec<f64>], simulated: &[&Vec<f64>]) -> Evidence {
        let (n, m) = (real.len() as f64, simulated.len() as f64);
        let (mut off, mut chance, mut flight) = (Vec::new(), Vec::new(), Vec::new());
        for (place, j) in self.places.iter().enumerate() {
            let [mean, of_flights] = moments(real, place);
            let [of_simulator, by_chance] = moments(simulated, place);
            let resolution = specs()[*j].resolution.powi(2);
            // What simulated flights differ by and real ones do not is one draw for this vehicle and room: it stays in their mean.
            let stays = (by_chance - of_flights).max(0.0);
            off.push(mean - of_simulator);
            chance.push(of_flights / n + stays + by_chance / m + resolution);
            flight.push(of_flights.max(by_chance) + resolution);
        }
        let group: Vec<usize> = self.places.iter().map(|j| specs()[*j].channel as usize).collect();
        let news = solve::news(&self.simulated, &group);
        Evidence {
            off,
            chance,
            flight,
            slopes: self.slopes.clone(),
            group,
            news,
            at: self.at.clone(),
        }
    }

    /// The farthest share of the step to a posterior at whose end flights are nearer; `None`: at none.
    fn step(&self, hand: &Hand<'_>, to: &Posterior) -> Option<Vec<f64>> {
        let count = TRIAL_FLIGHTS.min(self.seeds.len());
        let seeds = &self.seeds[..count];
        let mut best = (self.left(to, &self.simulated[..count], &self.at), None);
        for share in SHARES {
            let at: Vec<f64> =
                self.at.iter().zip(&to.at).map(|(from, to)| from + share * (to - from)).collect();
            let rows = hand.rows(&hand.moved(&at), &self.nominal, seeds, false);
            if rows.len() * 2 < count {
                continue;
            }
            let rows: Vec<Vec<f64>> =
                rows.iter().map(|row| self.places.iter().map(|j| row[*j]).collect()).collect();
            let left = self.left(to, &rows, &at);
            if left < best.0 {
                best = (left, Some(at));
            }
        }
        best.1
    }

    fn left(&self, posterior: &Posterior, rows: &[Vec<f64>], at: &[f64]) -> f64 {
        let (real, rows): (Vec<_>, Vec<_>) = (self.real.iter().collect(), rows.iter().collect());
        let off = |place| moments(&real, place)[0] - moments(&rows, place)[0];
        posterior.left(&(0..self.places.len()).map(off).collect::<Vec<_>>(), at)
    }
}

/// Statistics of flights by a nominal chain, of so many at least.
fn observed(
    accepted: &[&Trace],
    least: usize,
    nominal: &Nominal,
) -> Result<Vec<Vec<f64>>, NotCommissioned> {
    let seen: Vec<_> = accepted
        .par_iter()
        .map(|trace| statistics_of(trace, nominal).map_err(|e| e.to_string()))
        .collect();
    let why =
        seen.iter().find_map(|row| row.as_ref().err()).map_or(String::new(), |e| format!(": {e}"));
    let rows: Vec<Vec<f64>> = seen.into_iter().flatten().collect();
    if rows.len() < least {
        return Err(NotCommissioned::TooFew { found: rows.len(), why });
    }
    Ok(rows)
}

/// Slopes of the statistics on the constants, from pairs of flights with the same seed. What pairs differ by among one another makes a
/// slope smaller, to nothing where it is no larger than that (James and Stein 1961, one by one).
fn slopes(hand: &Hand<'_>, line: &Linear, middle: &[Vec<f64>], of: &[usize]) -> DMatrix<f64> {
    let Linear { at, nominal, places, seeds, .. } = line;
    let seeds = &seeds[..hand.pairs.min(seeds.len())];
    let (file, constants) = (&hand.scene.vehicle, hand.constants);
    let there = |k: usize, by: f64| {
        let mut there = at.clone();
        there[k] += by;
        hand.moved(&there)
    };
    let vehicles: Vec<[Vehicle; 2]> =
        of.iter().map(|k| [SLOPE_SIGMAS, -SLOPE_SIGMAS].map(|by| there(*k, by))).collect();
    let jobs: Vec<(&Vehicle, u64)> = vehicles
        .iter()
        .flat_map(|pair| seeds.iter().flat_map(move |seed| pair.iter().map(move |v| (v, *seed))))
        .collect();
    let rows = hand.fly(&jobs, nominal, false);
    let mut slopes = DMatrix::zeros(places.len(), of.len());
    for (column, (flown, vehicles)) in rows.chunks(2 * seeds.len()).zip(&vehicles).enumerate() {
        let k = of[column];
        let sigmas =
            [0, 1].map(|side| constants[k].sigmas(file, constants[k].value(&vehicles[side])));
        // Where one side is not flown to its end, the middle stands for it.
        let pairs: Vec<[(&Vec<f64>, f64); 2]> = flown
            .chunks(2)
            .zip(middle)
            .map(|(pair, middle)| {
                [0, 1].map(|side| {
                    pair[side].as_ref().map_or((middle, at[k]), |row| (row, sigmas[side]))
                })
            })
            .filter(|[above, below]| above.1 > below.1)
            .collect();
        for (place, j) in places.iter().enumerate() {
            let differences: Vec<f64> = pairs
                .iter()
                .map(|[above, below]| (above.0[*j] - below.0[*j]) / (above.1 - below.1))
                .filter(|slope| slope.is_finite())
                .collect();
            let n = differences.len() as f64;
            if n < 2.0 {
                continue;
            }
            let mean = differences.iter().sum::<f64>() / n;
            let square =
                differences.iter().map(|d| (d - mean).powi(2)).sum::<f64>() / (n * (n - 1.0));
            slopes[(place, column)] =
                mean * (1.0 - square / (mean * mean + f64::MIN_POSITIVE)).max(0.0);
        }
    }
    slopes
}

/// Mean and variance of one statistic.
fn moments(rows: &[&Vec<f64>], place: usize) -> [f64; 2] {
    let n = rows.len() as f64;
    let mean = rows.iter().map(|row| row[place]).sum::<f64>() / n;
    let square = rows.iter().map(|row| (row[place] - mean).powi(2)).sum::<f64>();
    [mean, square / (n - 1.0).max(1.0)]
}
