//! A budget of the gap without accepted flights: which constants of the vehicle file differ, what each closes, and what is left.
//!
//! Commissioning believes the file and moves all that flights show. Here the file itself is in doubt ([`Constant::in_doubt`]), and the
//! answer is to be short: the fewest constants that explain the flights.
//!
//! **Choice.** The best lists of each length are made longer by each other constant (beam search), and the one with which the flights
//! are likeliest ([`Posterior::unlikely`]) stands for its length. An addition has to gain more than the best of all constants gains on
//! simulated flights, each of which plays the real one in turn: a limit that is measured, for these statistics and this number of
//! flights. Constants that do as well within that limit are told beside the chosen one. Slopes are taken anew where the first choice
//! ends, of constants that came near to being chosen.
//!
//! What is chosen has to show in flights as well: a constant without which the others, fitted anew, come as near is given back.
//!
//! **Shares.** The vehicle is flown with each chosen constant alone and with one after the other, by seeds that nothing was fitted to,
//! beside flights that were held out where three or more are given: `1 - (D - D0) / (D_file - D0)` with the distance of
//! [`crate::shrink`], `D0` what flights of the vehicle as found do to one another.

#[cfg(test)]
mod tests;

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::AtomicUsize;

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use rayon::prelude::*;
use serde::Serialize;

use super::constants::{CONSTANTS, Constant};
use super::solve::{Evidence, Posterior};
use super::{Hand, Linear, MEAN_FLIGHTS, NotCommissioned, SHARES, SLOPE_ERROR, TRIAL_FLIGHTS};
use crate::flight::logs::Flown;
use crate::flight::statistics::{specs, statistics_of};
use crate::flight::trace::Trace;
use crate::normal;
use crate::outcome::Ending;
use crate::scene::Scene;
use crate::shrink::{Paired, Shrink, mean, scales, shrink, to_all};
use haltere_model::effects::Block;

/// Pairs of flights behind a slope: as few as say how sure it is, since all constants are asked for.
const SLOPE_PAIRS: usize = 2;
/// Choices of each length that are kept while longer ones are sought, so that one constant may take the place of two; the constants in
/// them are asked for again where the first choice ends, since slopes of all would take twice as long as everything else (judgement).
const KEPT: usize = 8;
/// Share of a step by which its slope changes, for each sigma of the step: half of the sigma of a number in doubt, as of what goes with
/// the reciprocal of the number.
const CURVE: f64 = 0.1;
/// Most constants that are told: a longer list is no answer (judgement).
const MOST_PARTS: usize = 8;
/// Share of flights without a gap in which no constant is told: the usual level.
const WITHIN: f64 = 0.95;
/// Of so many flights one is held out; fewer have none to spare.
const HELD_OUT: usize = 3;
/// Flights with benign jitter that give the scale of a difference, as for a shrink.
const BENIGN_FLIGHTS: usize = 32;
/// Flights beside those of slopes and means: of the step to where slopes are taken again, for scales, and for three parts.
const OTHER_FLIGHTS: usize = (SHARES.len() + 7) * TRIAL_FLIGHTS + BENIGN_FLIGHTS;
/// First seed of flights that shares are told by: nothing is fitted to them.
const SHARE_SEED: u64 = 7_950_000;

/// Why there is no budget.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NotBudgeted {
    /// No flight can be observed.
    #[error("no flight that can be observed{why}")]
    NotObservable {
        /// What became of one of them.
        why: String,
    },
    /// The simulator does not fly the mission with the vehicle file.
    #[error(transparent)]
    NotFlown(#[from] NotCommissioned),
}

/// A constant of the vehicle file that differs.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Part {
    /// Key in the vehicle file, with its axis.
    pub key: &'static str,
    /// As the file says.
    pub file: f64,
    /// As found.
    pub value: f64,
    /// 90 % interval.
    pub low: f64,
    /// Its upper end.
    pub high: f64,
    /// Constants that explain the flights as well in its place, best first.
    pub or: Vec<&'static str>,
    /// Share of the gap that it closes when it alone is put back; `None`: the distance is not above its own noise.
    pub share: Option<f64>,
    /// Share that is left once it and those above are put back.
    pub left_after: Option<f64>,
}

/// What a block has of the gap: squared distance beyond what simulated flights do to one another, in what healthy vehicles differ by.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BlockGap {
    /// Block.
    pub block: &'static str,
    /// With the vehicle file.
    pub before: f64,
    /// With all parts put back.
    pub left: f64,
}

/// The budget.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Budget {
    /// No gap, or a budget.
    pub outcome: Ending,
    /// What differs, largest share first.
    pub parts: Vec<Part>,
    /// Share of the gap that is left with all of them; `None`: the distance is not above its own noise.
    pub left: Option<f64>,
    /// Blocks that differ, before or after.
    pub blocks: Vec<BlockGap>,
    /// Flights that it was fitted to.
    pub flights: usize,
    /// Flights that shares were told by and nothing was fitted to; 0: by those that it was fitted to, too.
    pub held_out: usize,
    /// Simulated flights that were flown for it.
    pub simulated: usize,
    /// Whether the simulator flies the mission with the file as it is; without that there are no shares.
    pub flies: bool,
}

impl Budget {
    /// Exit code of `haltere gap budget`.
    pub fn exit_code(&self) -> u8 {
        self.outcome.exit_code()
    }

    /// One line for people.
    pub fn words(&self) -> String {
        let differ = match self.parts.len() {
            _ if self.outcome == Ending::NoGap => {
                return "no gap beyond what simulated flights of the file differ by among one another"
                    .to_owned();
            }
            0 => return "a gap of which these flights show no constant of the vehicle file to be the cause".to_owned(),
            1 => "one constant of the vehicle file differs".to_owned(),
            n => format!("{n} constants of the vehicle file differ"),
        };
        match self.left {
            Some(left) => format!("{differ}: {:.2} of the gap is closed", 1.0 - left),
            None if !self.flies => format!(
                "{differ}; the simulator does not fly the mission with the file as it is, so that there are no shares"
            ),
            None => format!("{differ}; all in all the gap is too small for shares"),
        }
    }

    /// What shares were told on.
    pub fn told_on(&self) -> String {
        match self.held_out {
            0 => "shares are told on the flights that were fitted, with other seeds".to_owned(),
            n => format!("shares are told on {n} held-out flights"),
        }
    }
}

impl Part {
    /// What explains as much in its place; empty without such.
    pub fn or_words(&self) -> String {
        self.or.iter().map(|key| format!(", or {key}")).collect()
    }
}

/// Makes the budget. `scene`: room, companion and the vehicle file; `progress`: done, of how many.
pub fn budget(
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    flights: &[&Flown],
    progress: impl Fn(usize, usize) + Sync,
) -> Result<Budget, NotBudgeted> {
    let traces: Vec<&Trace> = flights.iter().map(|flown| &flown.trace).collect();
    budget_for(&CONSTANTS, scene, items, &traces, &progress)
}

fn budget_for(
    constants: &[Constant],
    scene: &Scene,
    items: &[MISSION_ITEM_INT_DATA],
    flights: &[&Trace],
    progress: &(dyn Fn(usize, usize) + Sync),
) -> Result<Budget, NotBudgeted> {
    let all: Vec<Constant> = constants.iter().map(|constant| constant.in_doubt()).collect();
    let hand = Hand {
        constants: &all,
        scene,
        items,
        done: AtomicUsize::new(0),
        of: 2 * MEAN_FLIGHTS + 2 * SLOPE_PAIRS * (all.len() + 2 * KEPT) + OTHER_FLIGHTS,
        least: 1,
        pairs: SLOPE_PAIRS,
        flown: Arc::default(),
        progress,
    };
    let spared = |k: &usize| flights.len() >= HELD_OUT && k % HELD_OUT == HELD_OUT - 1;
    let (held_out, fitted): (Vec<usize>, Vec<usize>) = (0..flights.len()).partition(spared);
    let of_these = |places: &[usize]| places.iter().map(|k| flights[*k]).collect::<Vec<_>>();
    let (judged, fitted) = (of_these(&held_out), of_these(&fitted));
    let real = observed(&hand, if judged.is_empty() { &fitted } else { &judged })?;

    let line = Linear::first(&hand, &fitted)?;
    let limit = limit(&line);
    let first = Found::from(&line, limit);
    let better = (!first.choice.chosen.is_empty())
        .then(|| line.step(&hand, &first.choice.posterior))
        .flatten();
    let near: Vec<Constant> = first.near.iter().map(|k| all[*k]).collect();
    let (hand, mut found) = match better {
        Some(at) => {
            let hand = hand.asking(&near);
            let at: Vec<f64> = first.near.iter().map(|k| at[*k]).collect();
            let line = Linear::at(&hand, &at, &fitted)?;
            let mut found = Found::from(&line, limit);
            // Another choice lies elsewhere; where flights there are no nearer, the one that led here stays.
            if found.keys(&near) != first.keys(&all) {
                match line.step(&hand, &found.choice.posterior) {
                    Some(at) => found = Found::from(&Linear::at(&hand, &at, &fitted)?, limit),
                    None => {
                        let place = |k: &usize| first.near.iter().position(|near| near == k);
                        let led_here = first.choice.chosen.iter().filter_map(place).collect();
                        found.choice = Choice::new(&found.bare, led_here);
                    }
                }
            }
            (hand, found)
        }
        None => (hand, first),
    };
    let told = Shares::new(&hand, &mut found, real).told(&found);
    Ok(Budget { flights: fitted.len(), held_out: held_out.len(), ..told })
}

/// Flights that shares are told by, as the nominal chain of the file sees them, which nothing was fitted to.
fn observed(hand: &Hand<'_>, flights: &[&Trace]) -> Result<Vec<Vec<f64>>, NotBudgeted> {
    let nominal = hand.nominal(&hand.scene.vehicle);
    let (mut rows, mut why) = (Vec::new(), String::new());
    for trace in flights {
        match statistics_of(trace, &nominal) {
            Ok(row) => rows.push(row),
            Err(error) => why = format!(": {error}"),
        }
    }
    if rows.is_empty() { Err(NotBudgeted::NotObservable { why }) } else { Ok(rows) }
}

/// Constants that are free, with what follows from the flights.
#[derive(Clone)]
struct Choice {
    chosen: Vec<usize>,
    /// Where they lie; the others at the file.
    posterior: Posterior,
}

impl Choice {
    /// These constants, with the doubts of their own step.
    fn new(bare: &Evidence, chosen: Vec<usize>) -> Self {
        let there = bare.solve_for(&chosen);
        let posterior = bare.doubting(&there.at, SLOPE_ERROR, CURVE).solve_for(&chosen);
        Self { chosen, posterior }
    }

    /// All of these, the likeliest first.
    fn each(bare: &Evidence, choices: BTreeSet<Vec<usize>>) -> Vec<Self> {
        let choices = choices.into_par_iter();
        let mut each: Vec<Self> = choices.map(|chosen| Self::new(bare, chosen)).collect();
        each.sort_by(|a, b| a.unlikely().total_cmp(&b.unlikely()));
        each
    }

    fn unlikely(&self) -> f64 {
        self.posterior.unlikely
    }

    /// With each of the other constants.
    fn with_another(&self) -> impl Iterator<Item = Vec<usize>> {
        let others = (0..self.posterior.at.len()).filter(|k| !self.chosen.contains(k));
        others.map(|k| {
            let mut more = [&self.chosen[..], &[k]].concat();
            more.sort_unstable();
            more
        })
    }

    /// These of the chosen where they were found, the others at the file.
    fn put_back(&self, these: &[usize]) -> Vec<f64> {
        let found = self.posterior.at.iter().enumerate();
        found.map(|(k, at)| if these.contains(&k) { *at } else { 0.0 }).collect()
    }
}

/// The fewest constants that explain the flights.
struct Found {
    choice: Choice,
    /// Those that came near to being chosen, too.
    near: BTreeSet<usize>,
    bare: Evidence,
    limit: f64,
}

impl Found {
    /// `limit`: what an addition has to gain.
    fn from(line: &Linear, limit: f64) -> Self {
        let real: Vec<&Vec<f64>> = line.real.iter().collect();
        let bare = line.evidence_of(&real, &line.simulated.iter().collect::<Vec<_>>());
        let choice = Choice::new(&bare, Vec::new());
        let mut kept = vec![choice.clone()];
        let mut found = Self { choice, near: BTreeSet::new(), bare, limit };
        for _ in 0..MOST_PARTS {
            let longer = kept.iter().flat_map(Choice::with_another).collect();
            kept = Choice::each(&found.bare, longer);
            kept.truncate(KEPT);
            found.near.extend(kept.iter().flat_map(|choice| &choice.chosen));
            match kept.first() {
                Some(best) if best.unlikely() + limit < found.choice.unlikely() => {
                    found.choice = best.clone();
                }
                _ => break,
            }
        }
        found
    }

    fn keys(&self, constants: &[Constant]) -> Vec<&'static str> {
        self.choice.chosen.iter().map(|k| constants[*k].key).collect()
    }

    /// Choices that are shorter by one, the likeliest first.
    fn shorter(&self) -> Vec<Choice> {
        let shorter = self.choice.chosen.iter().map(|k| self.without(*k)).collect();
        Choice::each(&self.bare, shorter)
    }

    /// Constants that explain as much in the place of this one, best first.
    fn instead_of(&self, k: usize) -> Vec<usize> {
        let own = &self.choice.chosen;
        let rest = Choice { chosen: self.without(k), ..self.choice.clone() };
        let others = rest.with_another().filter(|other| other != own).collect();
        let each = Choice::each(&self.bare, others).into_iter();
        let as_good = each.take_while(|c| c.unlikely() < self.choice.unlikely() + self.limit);
        as_good.flat_map(|c| c.chosen.into_iter().filter(|k| !own.contains(k))).collect()
    }

    fn without(&self, k: usize) -> Vec<usize> {
        self.choice.chosen.iter().copied().filter(|chosen| *chosen != k).collect()
    }
}

/// What the best constant gains by chance: on simulated flights, as many at a time as real ones, beside the others.
fn limit(line: &Linear) -> f64 {
    let (all, constants) = (line.simulated.len(), line.at.len());
    let played = line.real.len().min(all / 2);
    let gain = |first: usize| {
        let is_played = |k: &usize| (k + all - first) % all < played;
        let (real, others): (Vec<usize>, Vec<usize>) = (0..all).partition(is_played);
        let rows = |places: Vec<usize>| -> Vec<&Vec<f64>> {
            places.into_iter().map(|k| &line.simulated[k]).collect()
        };
        let mut evidence = line.evidence_of(&rows(real), &rows(others));
        // Where these flights are flown is where their file is.
        evidence.at = vec![0.0; constants];
        let none = Choice::new(&evidence, Vec::new());
        let best = Choice::each(&evidence, none.with_another().collect());
        best.first().map_or(0.0, |best| none.unlikely() - best.unlikely())
    };
    let mut gains: Vec<f64> = (0..all).map(gain).collect();
    gains.sort_by(f64::total_cmp);
    // An addition that makes the flights less likely is none, whatever chance does.
    gains[((WITHIN * all as f64) as usize).min(all - 1)].max(0.0)
}

impl<'a> Hand<'a> {
    /// The same that asks for these constants from here on.
    fn asking<'b>(&self, constants: &'b [Constant]) -> Hand<'b>
    where
        'a: 'b,
    {
        let flown = self.flown.clone();
        Hand { constants, done: AtomicUsize::new(self.done()), flown, ..*self }
    }
}

/// Flights beside vehicles with some of the constants put back.
struct Shares<'a> {
    hand: &'a Hand<'a>,
    real: Vec<Vec<f64>>,
    scales: Vec<f64>,
    /// With the file as it is, and as found.
    paired: Vec<Paired>,
    whole: Shrink,
    /// Whether there are flights with the file as it is; else those as found stand for them, and there are no shares.
    flies: bool,
}

impl<'a> Shares<'a> {
    /// Gives back what is not needed: constants without which the others come as near, but for what one flight is off by chance.
    fn new(hand: &'a Hand<'a>, found: &mut Found, real: Vec<Vec<f64>>) -> Self {
        let vehicle = hand.moved(&found.choice.posterior.at);
        let nominal = hand.nominal(&hand.scene.vehicle);
        let seeds: Vec<u64> = (0..BENIGN_FLIGHTS as u64).map(|k| SHARE_SEED + k).collect();
        let mut scales = scales(&hand.rows(&vehicle, &nominal, &seeds, true));
        for (scale, spec) in scales.iter_mut().zip(specs()) {
            *scale = if spec.relative { f64::NAN } else { scale.hypot(spec.resolution) };
        }
        let before = flown(hand, &[]);
        let flies = before.len() * 2 >= TRIAL_FLIGHTS;
        let paired = |after: &[Vec<f64>]| -> Vec<Paired> {
            let beside = |real: &Vec<f64>| Paired {
                real: real.clone(),
                before: if flies { before.clone() } else { after.to_vec() },
                after: after.to_vec(),
                healthy: Vec::new(),
            };
            real.iter().map(beside).collect()
        };
        let fly = |choice: &Choice| match choice.chosen[..] {
            [] => before.clone(),
            _ => flown(hand, &choice.posterior.at),
        };
        let told = |paired: &[Paired]| {
            let whole = shrink(paired, &scales, 0);
            Shrink { value: whole.value.filter(|_| flies), ..whole }
        };
        let mut after = fly(&found.choice);
        let whole = told(&paired(&after));
        let as_near = |choice: Choice| {
            let rows = fly(&choice);
            let far = shrink(&paired(&rows), &scales, 0).after;
            (far <= whole.after + whole.noise).then_some((choice, rows))
        };
        while let Some(shorter) = found.shorter().into_iter().find_map(&as_near) {
            (found.choice, after) = shorter;
        }
        let paired = paired(&after);
        let whole = told(&paired);
        Self { hand, real, scales, paired, whole, flies }
    }

    /// Share of the gap that is left with these constants.
    fn left(&self, at: &[f64]) -> Option<f64> {
        self.whole.value?;
        let rows = flown(self.hand, at);
        let far = mean(self.real.iter().map(|real| to_all(real, &rows, &self.scales)));
        let left = (far - self.whole.floor) / (self.whole.before - self.whole.floor);
        left.is_finite().then_some(left)
    }

    fn told(&self, found: &Found) -> Budget {
        let choice = &found.choice;
        let (file, z90) = (&self.hand.scene.vehicle, normal::quantile(0.95));
        let mut alone: Vec<(usize, Option<f64>)> = (0..choice.chosen.len())
            .map(|place| {
                let left = self.left(&choice.put_back(&choice.chosen[place..=place]));
                (place, left.map(|left| 1.0 - left))
            })
            .collect();
        // Without shares in the order of choice.
        alone.sort_by(|a, b| b.1.partial_cmp(&a.1).unwrap_or(std::cmp::Ordering::Equal));
        let mut put_back = Vec::new();
        let mut parts = Vec::new();
        for (place, share) in alone {
            let k = choice.chosen[place];
            put_back.push(k);
            let (constant, posterior) = (&self.hand.constants[k], &choice.posterior);
            let value = |by: f64| constant.moved(file, posterior.at[k] + by * posterior.std[k]);
            parts.push(Part {
                key: constant.key,
                file: constant.value(file),
                value: value(0.0),
                low: value(-z90),
                high: value(z90),
                or: found.instead_of(k).iter().map(|k| self.hand.constants[*k].key).collect(),
                share,
                left_after: self.left(&choice.put_back(&put_back)),
            });
        }
        let gap = self.whole.value.is_some() || !parts.is_empty() || !self.flies;
        let blocks = if gap && self.flies { self.blocks() } else { Vec::new() };
        Budget {
            outcome: if gap { Ending::Budget } else { Ending::NoGap },
            left: self.whole.value.map(|closed| 1.0 - closed),
            parts,
            blocks,
            flights: 0,
            held_out: 0,
            simulated: self.hand.done(),
            flies: self.flies,
        }
    }

    /// Blocks whose own statistics are farther off than simulated flights are from one another, before or after.
    fn blocks(&self) -> Vec<BlockGap> {
        let of_block = |block: Block| {
            let scales: Vec<f64> = specs()
                .iter()
                .zip(&self.scales)
                .map(|(spec, scale)| if spec.block == block { *scale } else { f64::NAN })
                .collect();
            let s = shrink(&self.paired, &scales, 0);
            let [before, left] = [s.before, s.after].map(|distance| distance - s.floor);
            (before.max(left) > s.noise).then_some(BlockGap { block: block.name(), before, left })
        };
        Block::CHAIN.into_iter().filter_map(of_block).collect()
    }
}

/// Flights with these constants by the seeds that shares are told by; of none given those of the file.
fn flown(hand: &Hand<'_>, at: &[f64]) -> Vec<Vec<f64>> {
    let seeds: Vec<u64> =
        (0..TRIAL_FLIGHTS).map(|k| SHARE_SEED + (BENIGN_FLIGHTS + k) as u64).collect();
    let nominal = hand.nominal(&hand.scene.vehicle);
    hand.rows(&hand.moved(at), &nominal, &seeds, false)
}
