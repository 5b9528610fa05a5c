//! Which experiment would separate what a diagnosis left open, by predicted gain.
//!
//! Candidates that are not ruled out are flown in the nominal simulator on the mission of every
//! experiment, each flight with parameters drawn from their intervals and with benign jitter; how far
//! apart their statistics lie gives the probability that the right one would be named
//! ([`crate::advice::discriminate`]). Bench actions are readings: what each candidate would make the instrument
//! show, over its interval, against the resolution. Effects that the flight could not have shown are
//! flown too: how probable is it that they would stand out. Everything is relative to the nominal
//! simulator, and to the candidates: what is not among them is not separated by anything here.

pub mod discriminate;
pub mod experiments;
pub(crate) mod manoeuvres;

use std::cmp::Ordering;
use std::sync::atomic::{AtomicUsize, Ordering as Memory};

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use nalgebra::DMatrix;
use serde::Serialize;

use crate::advice::discriminate::{Clouds, correct};
use crate::advice::experiments::{EXPERIMENTS, Experiment, Means, Reading};
use crate::bank::archive::{self, Archive, Job, Shelf};
use crate::bank::library;
use crate::bank::missions::wire;
use crate::normal;
use crate::scene::Scene;
use haltere_model::effects::{Axis, EffectSpec, Kind};
use haltere_model::random::Stream;

/// Candidates at least this probable are not ruled out.
const RULED_OUT: f64 = 0.02;
/// Most candidates that are compared, and most effects that the flight could not have shown.
const MOST_CANDIDATES: usize = 5;
const MOST_UNTESTED: usize = 5;
/// Flights of null, of every candidate, and of every effect that could not be shown.
const NULLS: usize = 24;
const FLIGHTS: usize = 8;
const UNTESTED_FLIGHTS: usize = 4;
/// First seed: none of a bank's, none of a shrink's.
const SEED: u64 = 8_800_000;
/// One-sided 5 %.
const ALARM_SIGMA: f64 = 1.645;
/// Probabilities closer than this are alike: the cheaper experiment goes first.
const ALIKE: f64 = 0.02;
/// Samples of a bench action per candidate.
const SAMPLES: usize = 2000;
/// What it counts that an effect becomes testable, relative to telling candidates apart.
const TESTABLE_WEIGHT: f64 = 0.1;

/// A candidate that is not ruled out.
#[derive(Debug, Clone)]
pub struct Hypothesis {
    /// The effect.
    pub spec: &'static EffectSpec,
    /// Probability, among those that are left.
    pub probability: f64,
    /// Best parameters, in the order of the specification.
    pub theta: Vec<f64>,
    /// Interval per parameter.
    pub theta_90: Vec<[f64; 2]>,
}

/// What a diagnosis left open.
#[derive(Debug, Clone, Default)]
pub struct Remaining {
    /// Not ruled out, most probable first; probabilities sum to one.
    pub candidates: Vec<Hypothesis>,
    /// Effects that the flight could not have shown.
    pub untested: Vec<&'static EffectSpec>,
    /// More of either that were not looked at.
    pub left_out: Vec<String>,
}

impl Remaining {
    /// From candidates with their probabilities; `set`: ids that are kept however improbable.
    pub fn new(
        mut candidates: Vec<Hypothesis>,
        set: &[String],
        untested: Vec<&'static EffectSpec>,
    ) -> Self {
        let in_set = |h: &Hypothesis| set.iter().any(|id| id == h.spec.id);
        candidates.retain(|h| {
            let whole = h.theta.len() == h.spec.parameters.len();
            whole && (h.probability >= RULED_OUT || in_set(h))
        });
        candidates.sort_by(|a, b| {
            in_set(b).cmp(&in_set(a)).then(b.probability.total_cmp(&a.probability))
        });
        let mut left_out: Vec<String> =
            candidates.iter().skip(MOST_CANDIDATES).map(|h| h.spec.id.to_owned()).collect();
        candidates.truncate(MOST_CANDIDATES);
        left_out.extend(untested.iter().skip(MOST_UNTESTED).map(|s| s.id.to_owned()));
        let total: f64 = candidates.iter().map(|h| h.probability.max(1e-3)).sum();
        for h in &mut candidates {
            h.probability = h.probability.max(1e-3) / total;
        }
        candidates.sort_by(|a, b| b.probability.total_cmp(&a.probability));
        Self { candidates, untested: untested.into_iter().take(MOST_UNTESTED).collect(), left_out }
    }

    fn prior(&self) -> Vec<f64> {
        self.candidates.iter().map(|h| h.probability).collect()
    }

    /// Probability that the first guess is right, as of now.
    pub fn correct_now(&self) -> f64 {
        self.candidates.first().map_or(1.0, |h| h.probability)
    }

    /// Whether the catalogue lists an experiment for what is open.
    fn lists(&self, experiment: &Experiment) -> bool {
        let sets = experiment.separates.iter();
        sets.into_iter().any(|set| {
            let open = self.candidates.iter().filter(|h| set.contains(&h.spec.id)).count();
            open >= 2 || self.untested.iter().any(|s| set.contains(&s.id))
        })
    }

    /// Nothing to separate and nothing to test.
    pub fn is_settled(&self) -> bool {
        self.candidates.len() < 2 && self.untested.is_empty()
    }
}

/// One experiment and what it would be worth.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Advice {
    /// Name in the catalogue.
    pub experiment: String,
    /// In words.
    pub title: String,
    /// What to do and look for.
    pub how: String,
    /// Time with set-up, s.
    pub cost_s: f64,
    /// A flight, with a mission file; else an action on the bench.
    pub flight: bool,
    /// Why it cannot be done here.
    pub not_possible: Option<String>,
    /// Predicted probability that the right candidate is named after it.
    pub correct_after: Option<f64>,
    /// The same minus that of now.
    pub gain: Option<f64>,
    /// The two candidates that it separates worst, and their distance, sigma.
    pub hardest: Option<(String, String, f64)>,
    /// Effects that could not be tested so far: predicted probability that it would show them.
    pub would_show: Vec<(String, f64)>,
    /// Sets of the open effects that the catalogue lists it for.
    pub separates: Vec<Vec<String>>,
}

impl Advice {
    /// What it is worth, for the order.
    pub fn value(&self) -> f64 {
        let shown: f64 = self.would_show.iter().map(|(_, p)| p).sum();
        let of = self.would_show.len().max(1) as f64;
        self.gain.unwrap_or(0.0) + TESTABLE_WEIGHT * shown / of
    }
}

/// How many flights of the catalogue are tried.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effort {
    /// All of them.
    All,
    /// Those that the catalogue lists for a set with two open effects, or for one that could not be
    /// tested: what a report has time for.
    Listed,
}

/// All experiments, best first; those that cannot be done last. `shelf`: where flights are kept that do not hang
/// on what is open.
pub fn advise(
    scene: &Scene,
    remaining: &Remaining,
    effort: Effort,
    shelf: &Shelf,
    progress: impl Fn(usize, usize) + Sync,
) -> Vec<Advice> {
    let tried: Vec<&Experiment> = EXPERIMENTS
        .iter()
        .filter(|e| !e.is_flight() || effort == Effort::All || remaining.lists(e))
        .collect();
    let flights = tried.iter().filter(|e| e.is_flight()).count();
    let each =
        NULLS + remaining.candidates.len() * FLIGHTS + remaining.untested.len() * UNTESTED_FLIGHTS;
    let of = flights * each;
    let done = AtomicUsize::new(0);
    let tick = || progress(done.fetch_add(1, Memory::Relaxed) + 1, of);
    let mut all: Vec<Advice> =
        tried.iter().map(|e| predicted(scene, remaining, e, shelf, &tick)).collect();
    let rank = |a: &Advice| (a.value() / ALIKE).round();
    all.sort_by(|a, b| {
        let possible = a.not_possible.is_some().cmp(&b.not_possible.is_some());
        possible.then(rank(b).total_cmp(&rank(a))).then(a.cost_s.total_cmp(&b.cost_s))
    });
    all
}

fn predicted(
    scene: &Scene,
    remaining: &Remaining,
    experiment: &Experiment,
    shelf: &Shelf,
    tick: &(impl Fn() + Sync),
) -> Advice {
    let open = |id: &str| {
        remaining.candidates.iter().any(|h| h.spec.id == id)
            || remaining.untested.iter().any(|s| s.id == id)
    };
    let separates = experiment
        .separates
        .iter()
        .map(|set| set.iter().filter(|id| open(id)).map(|id| (*id).to_owned()).collect::<Vec<_>>())
        .filter(|set| set.len() > 1)
        .collect();
    let mut advice = Advice {
        experiment: experiment.id.to_owned(),
        title: experiment.title.to_owned(),
        how: experiment.how.to_owned(),
        cost_s: experiment.whole_cost_s(),
        flight: experiment.is_flight(),
        not_possible: None,
        correct_after: None,
        gain: None,
        hardest: None,
        would_show: Vec::new(),
        separates,
    };
    let distances = match experiment.means {
        Means::Flight(mission) => match mission(scene) {
            Err(why) => {
                advice.not_possible = Some(why);
                return advice;
            }
            Ok(mission) => {
                let items = wire(&mission);
                let mut archive = shelf.open(scene, &items);
                let distances = flown(scene, remaining, &items, &mut archive, &mut advice, tick);
                archive.keep();
                distances
            }
        },
        Means::Bench(readings) => {
            advice.would_show = shown_on_the_bench(remaining, readings);
            if remaining.candidates.len() > 1 {
                let p = read_off(remaining, readings);
                advice.correct_after = Some(p);
            }
            (remaining.candidates.len() > 1).then(|| bench_distances(remaining, readings))
        }
    };
    if let Some(squared) = distances {
        let n = remaining.candidates.len();
        let p = advice.correct_after.unwrap_or_else(|| correct(&squared, &remaining.prior(), SEED));
        advice.correct_after = Some(p);
        advice.gain = Some((p - remaining.correct_now()).max(0.0));
        let id = |k: usize| remaining.candidates[k].spec.id.to_owned();
        advice.hardest = (0..n)
            .flat_map(|i| (i + 1..n).map(move |j| (i, j)))
            .map(|(i, j)| (i, j, squared[(i, j)].sqrt()))
            .min_by(|a, b| a.2.total_cmp(&b.2))
            .map(|(i, j, d)| (id(i), id(j), d));
    }
    advice
}

/// Flies everything on one mission; squared distances of the candidates.
fn flown(
    scene: &Scene,
    remaining: &Remaining,
    items: &[MISSION_ITEM_INT_DATA],
    archive: &mut Archive<'_>,
    advice: &mut Advice,
    tick: &(impl Fn() + Sync),
) -> Option<DMatrix<f64>> {
    let nulls: Vec<_> = archive.fly(&healthy(SEED), tick).into_iter().flatten().collect();
    let classes: Vec<Vec<Vec<f64>>> = remaining
        .candidates
        .iter()
        .enumerate()
        .map(|(k, h)| fly(scene, items, &h.flights(FLIGHTS, SEED + 1000 * (k as u64 + 1)), tick))
        .collect();
    let untested: Vec<Vec<Vec<f64>>> = remaining
        .untested
        .iter()
        .map(|spec| {
            // Of the effect alone, so that its flights are the same whatever else is open.
            let place = library::whole().iter().position(|s| s.id == spec.id).unwrap_or(0);
            let seed = SEED + 100_000 + 1000 * place as u64;
            let flown = archive.fly(&middle(spec, scene).flights(UNTESTED_FLIGHTS, seed), tick);
            flown.into_iter().flatten().collect()
        })
        .collect();
    if !untested.is_empty() {
        for (spec, rows) in remaining.untested.iter().zip(untested) {
            let pair = vec![rows, nulls.clone()];
            let shown = Clouds::new(&nulls, &pair)
                .map_or(0.0, |c| normal::share(c.squared(0, 1).sqrt() - ALARM_SIGMA));
            advice.would_show.push((spec.id.to_owned(), shown));
        }
    }
    if classes.len() < 2 {
        return None;
    }
    Clouds::new(&nulls, &classes).map(|c| c.distances())
}

/// Flights of the healthy vehicle.
fn healthy(seed: u64) -> Vec<Job> {
    (0..NULLS as u64).map(|k| Job { seed: seed + k, jitter: true, effect: None }).collect()
}

/// Statistics of flights that hang on what is open: nobody will ask for them again.
fn fly(
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    jobs: &[Job],
    tick: &(impl Fn() + Sync),
) -> Vec<Vec<f64>> {
    archive::fly(scene, items, jobs, tick).into_iter().flatten().collect()
}

impl Hypothesis {
    /// Flights, each with its own draw of the parameters.
    fn flights(&self, count: usize, seed: u64) -> Vec<Job> {
        let one = |k: usize| {
            let seed = seed + k as u64;
            Job { seed, jitter: true, effect: Some((self.spec, self.draw(seed, k))) }
        };
        (0..count).map(one).collect()
    }

    /// Parameters of one flight: the best ones first, then from the interval.
    fn draw(&self, seed: u64, k: usize) -> Vec<f64> {
        let mut rng = Stream::new(seed, "advise");
        self.spec
            .parameters
            .iter()
            .zip(self.theta.iter().zip(&self.theta_90))
            .map(|(p, (best, [low, high]))| {
                // An interval that is none, or not known, has no inside.
                if k == 0
                    || matches!(p.kind, Kind::Which(_))
                    || high.partial_cmp(low) != Some(Ordering::Greater)
                {
                    return p.told(*best);
                }
                rng.between(*low, *high)
            })
            .collect()
    }
}

/// An effect nobody fitted, in the middle of its range, in the middle of the room.
fn middle(spec: &'static EffectSpec, scene: &Scene) -> Hypothesis {
    let centre = |[low, high]: [f64; 2]| 0.5 * (low + high);
    let theta: Vec<f64> = spec
        .parameters
        .iter()
        .map(|p| match p.kind {
            Kind::Where(Axis::North) => centre(scene.room.north_m),
            Kind::Where(Axis::East) => centre(scene.room.east_m),
            _ => p.of(&scene.vehicle).default,
        })
        .collect();
    let theta_90 = theta.iter().map(|v| [*v, *v]).collect();
    Hypothesis { spec, probability: 0.0, theta, theta_90 }
}

/// What an instrument shows under these parameters.
fn shows(reading: &Reading, spec: &EffectSpec, theta: &[f64]) -> f64 {
    reading
        .of
        .iter()
        .filter(|(id, ..)| *id == spec.id)
        .filter_map(|(_, name, weight)| {
            let k = spec.parameters.iter().position(|p| p.name == *name)?;
            let off = spec.parameters[k].off;
            Some(weight * (theta.get(k)? - if off.is_finite() { off } else { 0.0 }))
        })
        .sum()
}

/// P(correct) after the readings, over the intervals of the candidates.
fn read_off(remaining: &Remaining, readings: &[Reading]) -> f64 {
    let mut rng = Stream::new(SEED, "bench");
    // Each candidate as a cloud of readings in units of the resolution: a mixture over its interval.
    let clouds: Vec<Vec<Vec<f64>>> = remaining
        .candidates
        .iter()
        .map(|h| {
            (0..MIXTURE)
                .map(|k| {
                    let theta = h.draw(SEED + k as u64, k);
                    readings.iter().map(|r| shows(r, h.spec, &theta) / r.resolution).collect()
                })
                .collect()
        })
        .collect();
    let log = |cloud: &[Vec<f64>], y: &[f64]| -> f64 {
        let logs: Vec<f64> = cloud
            .iter()
            .map(|x| -0.5 * x.iter().zip(y).map(|(a, b)| (a - b).powi(2)).sum::<f64>())
            .collect();
        normal::log_mean_exp(&logs)
    };
    let mut total = 0.0;
    for (h, own) in remaining.candidates.iter().zip(&clouds) {
        let mut hits = 0usize;
        for k in 0..SAMPLES / MIXTURE * MIXTURE {
            let y: Vec<f64> = own[k % MIXTURE].iter().map(|x| x + rng.normal()).collect();
            let best = remaining
                .candidates
                .iter()
                .zip(&clouds)
                .map(|(c, cloud)| (c.spec.id, c.probability.ln() + log(cloud, &y)))
                // The first of equals is the more probable one.
                .fold(("", f64::NEG_INFINITY), |a, b| if b.1 > a.1 { b } else { a });
            hits += usize::from(best.0 == h.spec.id);
        }
        total += h.probability * hits as f64 / (SAMPLES / MIXTURE * MIXTURE) as f64;
    }
    total.max(remaining.correct_now())
}

/// Draws of the parameters in the cloud of a bench action.
const MIXTURE: usize = 40;

/// Squared distances of the candidates' best parameters in units of the resolution.
fn bench_distances(remaining: &Remaining, readings: &[Reading]) -> DMatrix<f64> {
    let n = remaining.candidates.len();
    let shown: Vec<Vec<f64>> = remaining
        .candidates
        .iter()
        .map(|h| readings.iter().map(|r| shows(r, h.spec, &h.theta) / r.resolution).collect())
        .collect();
    DMatrix::from_fn(n, n, |i, j| {
        shown[i].iter().zip(&shown[j]).map(|(a, b)| (a - b).powi(2)).sum()
    })
}

fn shown_on_the_bench(remaining: &Remaining, readings: &[Reading]) -> Vec<(String, f64)> {
    remaining
        .untested
        .iter()
        .map(|spec| {
            let theta: Vec<f64> = spec.parameters.iter().map(|p| p.default).collect();
            let squared: f64 =
                readings.iter().map(|r| (shows(r, spec, &theta) / r.resolution).powi(2)).sum();
            let seen =
                if squared > 0.0 { normal::share(squared.sqrt() - ALARM_SIGMA) } else { 0.0 };
            (spec.id.to_owned(), seen)
        })
        .collect()
}

/// Flights per candidate when a flown experiment is judged: a centre must be known better than for a
/// prediction.
const JUDGING_FLIGHTS: usize = 30;

/// Candidates with their probabilities after an experiment was flown: `statistics` of that flight,
/// `items` its mission.
pub fn after_flight(
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    remaining: &Remaining,
    statistics: &[f64],
    progress: impl Fn(usize, usize) + Sync,
) -> Option<Vec<(&'static EffectSpec, f64)>> {
    judge(scene, items, remaining, progress).map(|clouds| {
        let posterior = clouds.posterior(statistics, &remaining.prior());
        remaining.candidates.iter().map(|h| h.spec).zip(posterior).collect()
    })
}

/// Clouds of the candidates on a mission, as good as a judgement needs.
pub fn judge(
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    remaining: &Remaining,
    progress: impl Fn(usize, usize) + Sync,
) -> Option<Clouds> {
    let of = NULLS + remaining.candidates.len() * JUDGING_FLIGHTS;
    let done = AtomicUsize::new(0);
    let tick = || progress(done.fetch_add(1, Memory::Relaxed) + 1, of);
    // Seeds of their own: what chose an experiment must not judge it.
    let seed = SEED + 500_000;
    let nulls = fly(scene, items, &healthy(seed), &tick);
    let classes: Vec<Vec<Vec<f64>>> = remaining
        .candidates
        .iter()
        .enumerate()
        .map(|(k, h)| {
            let seed = seed + 1000 * (k as u64 + 1);
            fly(scene, items, &h.flights(JUDGING_FLIGHTS, seed), &tick)
        })
        .collect();
    Clouds::new(&nulls, &classes)
}

#[cfg(test)]
mod tests;
