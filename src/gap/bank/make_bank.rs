//! Makes the bank of a mission: nominal flights, flights with benign jitter, and flights under
//! every effect of the library, all in lockstep and all seen through the same observation.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use rayon::prelude::*;

use crate::bank::one_flight::{Drawn, End, Hand, Heard, Silence};
use crate::bank::{Bank, Draw, EffectDraws, LEAST_DRAWS, library};
use crate::flight::statistics::specs;
use crate::flight::trace::Trace;
use crate::nominal::Nominal;
use crate::scene::Scene;
use crate::shrink::scales;
use haltere_model::Vehicle;
use haltere_model::effects::{EffectSpec, Kind, ParameterSpec};
use haltere_model::random::Stream;

/// How many flights.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BankSize {
    /// Nominal flights.
    pub seeds: usize,
    /// Flights with jitter.
    pub jitter: usize,
    /// Flights of an effect with two parameters ([`BankSize::draws_of`]).
    pub draws: usize,
}

impl BankSize {
    /// For a first look: half of the flights.
    pub const SMALL: Self = Self { seeds: 20, jitter: 60, draws: 10 };

    /// Flights of this effect. A place in the room and one of six anchors take more of them to learn than a loss of thrust, so
    /// their number goes with that of the parameters: 0.75 of `draws` for one, twice for six. A choice counts twice.
    pub fn draws_of(&self, spec: &EffectSpec) -> usize {
        let few = self.draws.min(LEAST_DRAWS);
        let is_choice = |p: &&ParameterSpec| matches!(p.kind, Kind::Which(_));
        let choices = spec.parameters.iter().filter(is_choice).count();
        (self.draws * (spec.parameters.len() + choices + 2)).div_ceil(4).max(few)
    }

    /// Flights of all effects of a library.
    pub fn draws_of_all(&self, library: &[&EffectSpec]) -> usize {
        library.iter().map(|spec| self.draws_of(spec)).sum()
    }
}

impl Default for BankSize {
    /// Some 1150 flights with the standard library; 2100 of them name no more (sim/lab/RUNS.md, run 57). Limits rest on flights with
    /// jitter, and 24 seeds serve as well as 120.
    fn default() -> Self {
        Self { seeds: 24, jitter: 240, draws: 18 }
    }
}

/// What a bank is made for.
#[derive(Debug, Clone)]
pub struct Recipe<'a> {
    /// The room and the companion.
    pub scene: &'a Scene,
    /// The mission.
    pub items: &'a [MISSION_ITEM_INT_DATA],
    /// Candidates.
    pub library: &'a [&'static EffectSpec],
    /// How many flights.
    pub size: BankSize,
    /// Seed of the bank: flights of another bank, and of what is judged, are none of its own.
    pub seed: u64,
}

impl<'a> Recipe<'a> {
    fn hand(&self) -> Hand<'a> {
        let Self { scene, items, library, .. } = *self;
        Hand { scene, items, library, nominal: Nominal::of_scene(scene) }
    }
}

/// One flight without effect.
#[derive(Debug, Clone, Copy)]
struct Null {
    seed: u64,
    jitter: bool,
}

/// A bank, and what could not be flown for it.
#[derive(Debug, Clone)]
pub struct Made {
    /// The bank.
    pub bank: Bank,
    /// Flights that never left the floor or could not be observed, by effect id; nulls under "".
    pub lost: Vec<(String, usize)>,
    /// What became of healthy flights with jitter that are not in the bank: what, how many, and the seed of one.
    pub ends: Vec<(End, usize, u64)>,
}

/// What came of one flight without effect.
pub(super) type NullRow = Result<Vec<f64>, End>;

/// What came of the draws of one effect, in their order; `None`: lost.
pub(super) type EffectRows = Vec<Option<Draw>>;

/// A share of a list: every `of`-th of it, beginning with the `number`-th, counted from 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Part {
    /// Which.
    pub number: usize,
    /// Of how many.
    pub of: usize,
}

impl Part {
    /// All of it.
    pub const WHOLE: Self = Self { number: 1, of: 1 };
    /// Most parts: a bank has fewer flights.
    const MOST: usize = 1000;

    /// Whether it holds what stands at this place of the list.
    pub fn holds(self, place: usize) -> bool {
        place % self.of == self.number - 1
    }
}

impl std::str::FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers =
            text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match numbers {
            Some((number, of)) if of <= Self::MOST && (1..=of).contains(&number) => {
                Ok(Self { number, of })
            }
            _ => Err(format!("write I/N with I from 1 to N, N up to {}", Self::MOST)),
        }
    }
}

/// Flies the whole bank on all cores. `progress` hears of every flight: done, of how many.
pub fn make(recipe: &Recipe<'_>, progress: impl Fn(usize, usize) + Sync) -> Made {
    let total = flights_without(recipe, Part::WHOLE) + recipe.size.draws_of_all(recipe.library);
    let done = AtomicUsize::new(0);
    let tell = || progress(done.fetch_add(1, Ordering::Relaxed) + 1, total);
    let begun = begin(recipe, fly_nulls(recipe, Part::WHOLE, &tell));
    let flown = fly_effects(recipe, &begun, Part::WHOLE, &tell);
    end(begun, flown)
}

/// Flights without effect in a part.
pub(super) fn flights_without(recipe: &Recipe<'_>, part: Part) -> usize {
    (0..nulls(recipe).len()).filter(|k| part.holds(*k)).count()
}

/// Draws of the effects of a part.
pub(super) fn flights_with(recipe: &Recipe<'_>, part: Part) -> usize {
    let ours = recipe.library.iter().enumerate().filter(|(place, _)| part.holds(*place));
    ours.map(|(_, spec)| recipe.size.draws_of(spec)).sum()
}

/// Flies those of a part without effect.
pub(super) fn fly_nulls(
    recipe: &Recipe<'_>,
    part: Part,
    tell: &(impl Fn() + Sync),
) -> Vec<NullRow> {
    let hand = recipe.hand();
    let ours = nulls(recipe).into_iter().enumerate().filter(|(k, _)| part.holds(*k));
    let ours: Vec<Null> = ours.map(|(_, null)| null).collect();
    ours.par_iter()
        .map_init(
            || Trace::new(recipe.scene.survey.clone()),
            |trace, null| {
                let row = hand.fly(null.seed, null.jitter, None, trace);
                tell();
                row
            },
        )
        .collect()
}

/// A bank with its flights without effect, and what those with one need of them.
pub(super) struct Begun {
    pub bank: Bank,
    /// Of the flown flights with jitter.
    seeds: Vec<u64>,
    lost: BTreeMap<String, usize>,
    ends: BTreeMap<End, (usize, u64)>,
}

impl Begun {
    /// What became of healthy flights with jitter that are not in the bank ([`Made::ends`]).
    pub fn ends(&self) -> Vec<(End, usize, u64)> {
        self.ends.iter().map(|(end, (count, seed))| (*end, *count, *seed)).collect()
    }
}

/// Begins a bank with all flights without effect, in the order of their list.
pub(super) fn begin(recipe: &Recipe<'_>, rows: Vec<NullRow>) -> Begun {
    let mut bank =
        Bank { names: specs().iter().map(|s| s.name.clone()).collect(), ..Bank::default() };
    let mut seeds: Vec<u64> = Vec::new();
    let mut lost: BTreeMap<String, usize> = BTreeMap::new();
    let mut ends: BTreeMap<End, (usize, u64)> = BTreeMap::new();
    for (null, row) in nulls(recipe).iter().zip(rows) {
        match row {
            Ok(row) if null.jitter => {
                seeds.push(null.seed);
                bank.jitter.push(row);
            }
            Ok(row) => bank.seeds.push(row),
            Err(end) => {
                *lost.entry(String::new()).or_default() += 1;
                // Those with jitter are counted: they and what became of the others make up their number.
                if !null.jitter {
                    continue;
                }
                ends.entry(end).or_insert((0, null.seed)).0 += 1;
            }
        }
    }
    let scene = recipe.scene;
    for spec in recipe.library {
        let axes = library::axes(spec, &scene.vehicle, &scene.room, anchors(scene));
        bank.effects.push(EffectDraws { id: spec.id.to_owned(), axes, draws: Vec::new() });
    }
    Begun { bank, seeds, lost, ends }
}

/// Flies the effects of a part.
pub(super) fn fly_effects(
    recipe: &Recipe<'_>,
    begun: &Begun,
    part: Part,
    tell: &(impl Fn() + Sync),
) -> Vec<EffectRows> {
    let hand = recipe.hand();
    let Begun { bank, seeds, .. } = begun;
    let sigmas = scales(&bank.jitter);
    let drawn = drawn(recipe, seeds);
    let ours: Vec<(usize, &EffectDraws)> =
        bank.effects.iter().enumerate().filter(|(place, _)| part.holds(*place)).collect();
    // One effect after the other on each core: its later draws know what its earlier ones came to.
    ours.par_iter()
        .with_max_len(1)
        .map_init(
            || Trace::new(recipe.scene.survey.clone()),
            |trace, (place, effect)| {
                let mut heard = Heard::NOTHING;
                let of_effect = drawn.iter().filter(|drawn| drawn.place == *place);
                let fly = |drawn: &Drawn| {
                    let silence = Silence { row: &bank.jitter[drawn.twin], sigmas: &sigmas };
                    let flown = hand.draw(drawn, &effect.axes, silence, &mut heard, trace);
                    tell();
                    let (theta, statistics) = flown?;
                    Some(Draw { theta, seed: drawn.seed, twin: drawn.twin, statistics })
                };
                of_effect.map(fly).collect()
            },
        )
        .collect()
}

/// Ends a bank with the draws of all effects, in the order of the library. Of an effect with which the mission is hardly ever
/// flown, however weak, nothing can be learned: it is not in the bank.
pub(super) fn end(begun: Begun, flown: Vec<EffectRows>) -> Made {
    let ends = begun.ends();
    let Begun { mut bank, mut lost, .. } = begun;
    for (mut effect, draws) in std::mem::take(&mut bank.effects).into_iter().zip(flown) {
        let least = LEAST_DRAWS.min(draws.len());
        for draw in draws {
            let Some(draw) = draw else {
                *lost.entry(effect.id.clone()).or_default() += 1;
                continue;
            };
            // What was drawn weaker to be flown may lie beyond what is plausible.
            for (axis, value) in effect.axes.iter_mut().zip(&draw.theta) {
                *axis = axis.with(*value);
            }
            effect.draws.push(draw);
        }
        if effect.draws.len() >= least {
            bank.effects.push(effect);
        }
    }
    Made { bank, lost: lost.into_iter().collect(), ends }
}

/// How many of `count` healthy flights of this recipe come to their end with another vehicle in its place.
pub fn flown_by(recipe: &Recipe<'_>, vehicle: &Vehicle, count: usize) -> usize {
    let scene = Scene { vehicle: vehicle.clone(), ..recipe.scene.clone() };
    let other = Recipe { scene: &scene, ..*recipe };
    let hand = other.hand();
    let nulls: Vec<Null> =
        nulls(recipe).into_iter().filter(|null| null.jitter).take(count).collect();
    nulls
        .par_iter()
        .map_init(
            || Trace::new(scene.survey.clone()),
            |trace, null| hand.fly(null.seed, true, None, trace),
        )
        .filter(Result::is_ok)
        .count()
}

fn nulls(recipe: &Recipe<'_>) -> Vec<Null> {
    let BankSize { seeds, jitter, .. } = recipe.size;
    // Far apart, so that neighbouring banks share no seed.
    let first = recipe.seed.wrapping_mul(1_000_003);
    let null = |k: usize| Null { seed: first.wrapping_add(k as u64), jitter: k >= seeds };
    (0..seeds + jitter).map(null).collect()
}

/// Flights with an effect.
///
/// **Twins.** What an effect does is far less than what jitter and noise do, until it is large. A flight with an effect has
/// the seed of a flight without one, so that both have the same constants, noise and start (common random numbers;
/// Glasserman and Yao 1992), and differ by the effect alone. `seeds`: of the flown flights with jitter.
fn drawn(recipe: &Recipe<'_>, seeds: &[u64]) -> Vec<Drawn> {
    let scene = recipe.scene;
    let anchors = anchors(scene);
    let twins = if seeds.len() < FOLDS { seeds.len() } else { seeds.len() - seeds.len() % FOLDS };
    let mut all: Vec<Drawn> = Vec::new();
    let mut first = 0;
    for (place, spec) in recipe.library.iter().enumerate() {
        let draws = recipe.size.draws_of(spec);
        let mut rng = Stream::new(recipe.seed, spec.id);
        let thetas = library::draws(spec, &scene.vehicle, &scene.room, anchors, draws, &mut rng);
        for (k, theta) in thetas.into_iter().enumerate() {
            let Some(twin) = (first + k).checked_rem(twins) else {
                return all;
            };
            all.push(Drawn { seed: seeds[twin], place, theta, number: k, twin });
        }
        first += draws.next_multiple_of(FOLDS);
    }
    all
}

fn anchors(scene: &Scene) -> usize {
    scene.survey.ids().len()
}

/// Twins fall into the same fold when flights are held out by any of 2, 3, 4, 6 and 12 folds.
const FOLDS: usize = 12;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::missions;

    #[test]
    fn regress_a_bank_holds_few_flights_on_which_nothing_happens() {
        // Motors that never meet their limit: two thirds of the draws of P5 were the same flight as their twin, so
        // that little was known of the others, and P5 was said of whatever nothing else explained.
        let scene = Scene::lab().unwrap();
        let items = missions::diagnostic(&scene);
        let library: Vec<_> = library::standard().into_iter().filter(|s| s.id == "P5").collect();
        let size = BankSize { seeds: 0, jitter: 12, draws: 3 };
        let recipe = Recipe { scene: &scene, items: &items, library: &library, size, seed: 1 };
        let made = make(&recipe, |_, _| {});
        let drawn: Vec<Vec<f64>> = drawn(&recipe, &[0]).into_iter().map(|d| d.theta).collect();
        let flown: Vec<Vec<f64>> =
            made.bank.effects[0].draws.iter().map(|d| d.theta.clone()).collect();
        assert!(drawn.iter().any(|t| t[0] > 1.2), "one does nothing: {drawn:?}");
        let sigmas = scales(&made.bank.jitter);
        for draw in &made.bank.effects[0].draws {
            let row = &made.bank.jitter[draw.twin];
            let silent = Silence { row, sigmas: &sigmas }.holds(&draw.statistics);
            assert!(!silent, "{:?}: drawn {drawn:?}, flown {flown:?}", draw.theta);
        }
    }

    #[test]
    fn regress_an_effect_that_cannot_be_flown_does_not_end_the_bank() {
        // Of a stranger's log 8 references made a simulator that tumbled with every L1, and after a quarter of an hour of flying
        // there was "no bank to learn from".
        let scene = Scene::lab().unwrap();
        let library: Vec<_> =
            library::standard().into_iter().filter(|s| ["P1", "L1"].contains(&s.id)).collect();
        let size = BankSize { seeds: 0, jitter: 1, draws: 6 };
        let recipe = Recipe { scene: &scene, items: &[], library: &library, size, seed: 1 };
        let draw = |k: u64| Draw { theta: vec![0.1], seed: k, twin: 0, statistics: Vec::new() };
        let flown = library.iter().map(|spec| match spec.id {
            "L1" => vec![None; 6],
            _ => (0..6).map(|k| Some(draw(k))).collect(),
        });
        let made = end(begin(&recipe, vec![Ok(Vec::new())]), flown.collect());
        assert_eq!(made.bank.effects.iter().map(|e| &e.id[..]).collect::<Vec<_>>(), ["P1"]);
        assert_eq!(made.lost, [("L1".to_owned(), 6)]);
    }

    #[test]
    fn val_a_small_bank_holds_what_was_asked_for() {
        let scene = Scene::lab().unwrap();
        let items = missions::plain(&scene);
        let library: Vec<_> =
            library::standard().into_iter().filter(|s| ["P1", "U2"].contains(&s.id)).collect();
        let recipe = Recipe {
            scene: &scene,
            items: &items,
            library: &library,
            size: BankSize { seeds: 1, jitter: 1, draws: 1 },
            seed: 1,
        };
        let made = make(&recipe, |_, _| {});
        assert!(made.lost.is_empty(), "{:?}", made.lost);
        assert_eq!((made.bank.seeds.len(), made.bank.jitter.len()), (1, 1));
        let asked = library.iter().map(|spec| recipe.size.draws_of(spec));
        assert!(made.bank.effects.iter().map(|e| e.draws.len()).eq(asked.clone()));
        // Of one draw for two parameters: one of P1, two of U2, which has an anchor to choose.
        assert_eq!(asked.collect::<Vec<_>>(), [1, 2]);
        let known = made.bank.seeds[0].iter().filter(|v| v.is_finite()).count();
        assert!(known * 2 > made.bank.names.len(), "{known} of {}", made.bank.names.len());
    }

    #[test]
    fn regress_a_bank_holds_no_flights_that_fell() {
        // Drag that saturates within its plausible range makes the dashes end on the floor: every draw of A2
        // used to be a crash, and every crash was called A2.
        let scene = Scene::lab().unwrap();
        let items = missions::diagnostic(&scene);
        let library: Vec<_> = library::standard().into_iter().filter(|s| s.id == "A2").collect();
        let size = BankSize { seeds: 0, jitter: 3, draws: 3 };
        let recipe = Recipe { scene: &scene, items: &items, library: &library, size, seed: 1 };
        let made = make(&recipe, |_, _| {});
        assert!(made.lost.is_empty(), "{:?}", made.lost);
        let place = specs().iter().position(|s| s.name == "loop.side_std").unwrap();
        for draw in &made.bank.effects[0].draws {
            assert!(draw.theta[0] > 2.5, "weaker than the plausible range: {:?}", draw.theta);
            assert!(draw.statistics[place].is_finite());
        }
    }
}
