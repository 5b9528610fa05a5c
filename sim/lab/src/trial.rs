//! Measures the advice: how often the right effect is named after the recommended flight, and after a
//! flight chosen by chance.
//!
//! Cases are ambiguous on purpose: a set of GAP.md 3.9, one of it is the truth at a third of a strength
//! drawn from its range, and the first flight is no more than a hover. Its posterior comes from flights
//! of the candidates ([`haltere_gap::advice::after_flight`]), a stand-in for a diagnosis that needs no bank. A
//! case counts where the first flight leaves more than one candidate open. Everything is flown in the
//! nominal simulator with benign jitter, where candidates are easier to tell apart than in a room.

use serde::Serialize;

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use haltere_gap::advice::experiments::{EXPERIMENTS, Means};
use haltere_gap::advice::{Effort, Hypothesis, Remaining, advise, judge};
use haltere_gap::bank::archive::Shelf;
use haltere_gap::bank::fly::fly_observed;
use haltere_gap::bank::jitter::jittered;
use haltere_gap::bank::library::draws;
use haltere_gap::bank::library::with_effect;
use haltere_gap::bank::missions::{HEIGHT_M, LEG_MPS, Plan, wire};
use haltere_gap::flight::statistics::statistics_of;
use haltere_gap::nominal::Nominal;
use haltere_gap::scene::Scene;
use haltere_model::effects::{ALL, EffectSpec, Kind, ParameterSpec};
use haltere_model::random::Stream;

use crate::score::Share;

/// Sets that a plain flight may not separate.
const SETS: [&[&str]; 6] = [
    &["P4", "P5", "A4"],
    &["L1", "T2", "L4"],
    &["M1", "M4", "L3"],
    &["A1", "A2", "A3"],
    &["P1", "I1", "P2"],
    &["U2", "U7", "U8"],
];
/// A case counts when the first flight leaves the best candidate less probable than this.
const OPEN: f64 = 0.95;
/// First flights that are tried per wanted case.
const MOST_TRIES: usize = 4;
/// Seed of truths.
const SEED: u64 = 5_500_000;
/// Strength of truths and rivals relative to what is drawn from the range.
const WEAK: f64 = 0.33;
/// Length of the first flight's hover, s.
const HOVER_S: f64 = 12.0;
/// Flights by chance that are tried in a case.
const BY_CHANCE: usize = 3;
/// Half width of the interval of a parameter that a fit knows, as a share of its range.
const KNOWN: f64 = 0.15;

/// One case.
#[derive(Debug, Clone, Serialize)]
pub struct Case {
    /// The truth.
    pub truth: String,
    /// Candidates after the first flight, most probable first.
    pub open: Vec<String>,
    /// The first guess was right.
    pub right_before: bool,
    /// Flight that was recommended.
    pub recommended: String,
    /// Predicted probability of being right after it.
    pub predicted: f64,
    /// Right after it.
    pub right_after: bool,
    /// Share of flights chosen by chance after which it is right.
    pub right_by_chance: f64,
}

/// All cases.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Trial {
    /// Cases that were ambiguous.
    pub cases: Vec<Case>,
    /// First flights that settled the case, and did not count.
    pub settled: usize,
}

impl Trial {
    /// For people.
    pub fn table(&self) -> String {
        use std::fmt::Write as _;
        let mut out = String::new();
        for c in &self.cases {
            let _ = writeln!(
                out,
                "{:<4} open {:<10} {:<5} -> {:<18} predicted {:.2} {:<5} by chance {:.2}",
                c.truth,
                c.open.join(" "),
                if c.right_before { "right" } else { "wrong" },
                c.recommended,
                c.predicted,
                if c.right_after { "right" } else { "wrong" },
                c.right_by_chance
            );
        }
        let n = self.cases.len();
        let hits = |of: &dyn Fn(&Case) -> bool| self.cases.iter().filter(|c| of(c)).count();
        let share = |hits: usize| {
            let s = Share::new(hits, n);
            format!("{:.2} (95 %: {:.2} to {:.2})", hits as f64 / n.max(1) as f64, s.low, s.high)
        };
        let mean =
            |of: &dyn Fn(&Case) -> f64| self.cases.iter().map(of).sum::<f64>() / n.max(1) as f64;
        let _ = writeln!(
            out,
            "{n} ambiguous cases ({} settled by the first flight)\nright before              {}\nright after recommended   {}, predicted {:.2}\nright after one by chance {:.2}",
            self.settled,
            share(hits(&|c| c.right_before)),
            share(hits(&|c| c.right_after)),
            mean(&|c| c.predicted),
            mean(&|c| c.right_by_chance),
        );
        out
    }
}

/// Runs until `cases` ambiguous ones were found, or too many were tried.
pub fn run(scene: &Scene, cases: usize, progress: impl Fn(usize, usize)) -> Trial {
    let mut trial = Trial::default();
    for k in 0..cases * MOST_TRIES {
        if trial.cases.len() >= cases {
            break;
        }
        match one(scene, k) {
            Some(case) => trial.cases.push(case),
            None => trial.settled += 1,
        }
        progress(trial.cases.len(), cases);
    }
    trial
}

fn one(scene: &Scene, k: usize) -> Option<Case> {
    let ids = SETS[k % SETS.len()];
    let specs: Vec<&'static EffectSpec> =
        ids.iter().filter_map(|id| ALL.iter().find(|s| s.id == *id)).collect();
    let mut rng = Stream::new(SEED + k as u64, "trial");
    let truth = *specs.get((rng.uniform() * specs.len() as f64) as usize)?;
    let theta = weak(truth, scene, &mut rng)?;
    let statistics = |items: &[MISSION_ITEM_INT_DATA], seed: u64| -> Option<Vec<f64>> {
        let mut plant = jittered(scene.plant(seed)).ok()?;
        plant.effects = with_effect(plant.effects, truth, &theta).ok()?;
        let trace = fly_observed(scene, items, plant, scene.pilot.clone()).ok()?;
        statistics_of(&trace, &Nominal::of_scene(scene)).ok()
    };
    let seed = SEED + 10_000 * (k as u64 + 1);
    let mut hover = Plan::new(scene);
    hover.speed(LEG_MPS);
    hover.go([0.0, 0.0], HEIGHT_M, HOVER_S);
    let items = wire(&hover.land());
    let first = statistics(&items, seed)?;
    // Rivals of the strength that a fit would give them: their own draw, known about as well.
    let hypotheses: Vec<Hypothesis> = specs
        .iter()
        .map(|spec| {
            let own = if spec.id == truth.id {
                theta.clone()
            } else {
                weak(spec, scene, &mut rng).unwrap_or_default()
            };
            let theta_90 = spec
                .parameters
                .iter()
                .zip(&own)
                .map(|(p, v)| {
                    let choice = matches!(p.kind, Kind::Which(_)) || !p.off.is_finite();
                    let half = if choice { 0.0 } else { KNOWN * WEAK * (p.high - p.low) };
                    [v - half, v + half]
                })
                .collect();
            Hypothesis { spec, probability: 1.0 / specs.len() as f64, theta: own, theta_90 }
        })
        .collect();
    let all = Remaining { candidates: hypotheses, ..Remaining::default() };
    let posterior = judge(scene, &items, &all, |_, _| {})?
        .posterior(&first, &vec![1.0 / specs.len() as f64; specs.len()]);
    let updated: Vec<Hypothesis> = all
        .candidates
        .iter()
        .zip(&posterior)
        .map(|(h, p)| Hypothesis { probability: *p, ..h.clone() })
        .collect();
    let open = Remaining::new(updated, &[truth.id.to_owned()], Vec::new());
    if open.candidates.len() < 2 || open.correct_now() > OPEN {
        return None;
    }
    let advice = advise(scene, &open, Effort::All, &Shelf::none(), |_, _| {});
    let recommended = advice.iter().find(|a| a.flight && a.not_possible.is_none())?;
    let prior: Vec<f64> = open.candidates.iter().map(|h| h.probability).collect();
    let right = |id: &str| -> Option<bool> {
        let experiment = EXPERIMENTS.iter().find(|e| e.id == id)?;
        let Means::Flight(mission) = experiment.means else { return None };
        let items = wire(&mission(scene).ok()?);
        let seen = statistics(&items, seed + 1)?;
        let p = judge(scene, &items, &open, |_, _| {})?.posterior(&seen, &prior);
        let best = (0..p.len()).max_by(|a, b| p[*a].total_cmp(&p[*b]))?;
        Some(open.candidates.get(best)?.spec.id == truth.id)
    };
    let right_after = right(&recommended.experiment)?;
    let all: Vec<&str> = EXPERIMENTS.iter().filter(|e| e.is_flight()).map(|e| e.id).collect();
    let (mut hits, mut tried) = (0, 0);
    while tried < BY_CHANCE {
        let id = all.get((rng.uniform() * all.len() as f64) as usize)?;
        let is_right = if *id == recommended.experiment { right_after } else { right(id)? };
        (hits, tried) = (hits + usize::from(is_right), tried + 1);
    }
    Some(Case {
        truth: truth.id.to_owned(),
        open: open.candidates.iter().map(|h| h.spec.id.to_owned()).collect(),
        right_before: open.candidates.first().is_some_and(|h| h.spec.id == truth.id),
        recommended: recommended.experiment.clone(),
        predicted: recommended.correct_after.unwrap_or(f64::NAN),
        right_after,
        right_by_chance: hits as f64 / tried as f64,
    })
}

/// Parameters from the range, drawn towards "off"; choices and places stay.
fn weak(spec: &EffectSpec, scene: &Scene, rng: &mut Stream) -> Option<Vec<f64>> {
    let theta = draws(spec, &scene.vehicle, &scene.room, scene.survey.ids().len(), 1, rng).pop()?;
    let shrunk = |(p, v): (&ParameterSpec, f64)| {
        let scaled = p.off.is_finite() && !matches!(p.kind, Kind::Which(_)) && p.off != p.default;
        if scaled { p.off + WEAK * (v - p.off) } else { v }
    };
    Some(spec.parameters.iter().zip(theta).map(shrunk).collect())
}
