//! Measures the advice: how often the right effect is named after the recommended flight, and after a
//! flight chosen by chance.
//!
//! Cases are ambiguous on purpose: a set of GAP.md 3.9, one of it is the truth with parameters from its
//! range, and the first flight is the plain one. Its posterior comes from flights of the candidates
//! ([`super::advise::after_flight`]), whose parameters are as unknown as the whole range: a weak but
//! honest stand-in for a diagnosis, without a bank. A case counts where the first flight leaves more than
//! one candidate open. Everything is flown in the nominal simulator with benign jitter.

use serde::Serialize;

use super::advise::{Hypothesis, Remaining, advise, judge};
use super::experiments::{EXPERIMENTS, Means};
use super::fly::fly_observed;
use super::library::draws;
use super::make_bank::{jittered, with_effect};
use super::missions::{plain, wire};
use super::nominal::Nominal;
use super::scene::Scene;
use super::score::Share;
use super::statistics::observe;
use crate::model::effects::{ALL, EffectSpec};
use crate::model::random::Stream;
use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;

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
const OPEN: f64 = 0.9;
/// First flights that are tried per wanted case.
const MOST_TRIES: usize = 4;
/// Seed of truths.
const SEED: u64 = 5_500_000;
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
    /// Share of all flights of the catalogue after which it would be right: a choice by chance.
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
            "{n} ambiguous cases ({} settled by the first flight)\nright before              {}\nright after recommended   {}, predicted {:.2}\nright after any flight    {:.2}",
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
    let theta = draws(truth, &scene.room, scene.survey.ids().len(), 1, &mut rng).pop()?;
    let statistics = |items: &[MISSION_ITEM_INT_DATA], seed: u64| -> Option<Vec<f64>> {
        let mut plant = jittered(scene.plant(seed)).ok()?;
        plant.effects = with_effect(plant.effects, truth, &theta).ok()?;
        let trace = fly_observed(scene, items, plant, scene.pilot.clone()).ok()?;
        observe(&trace, &Nominal::of_scene(scene)).ok().map(|o| o.statistics)
    };
    let seed = SEED + 10_000 * (k as u64 + 1);
    let items = plain(scene);
    let first = statistics(&items, seed)?;
    // Rivals of the strength that a fit would give them: their own draw, known about as well.
    let hypotheses: Vec<Hypothesis> = specs
        .iter()
        .map(|spec| {
            let own = if spec.id == truth.id {
                theta.clone()
            } else {
                let anchors = scene.survey.ids().len();
                draws(spec, &scene.room, anchors, 1, &mut rng).pop().unwrap_or_default()
            };
            let theta_90 = spec
                .parameters
                .iter()
                .zip(&own)
                .map(|(p, v)| {
                    let half = KNOWN * (p.high - p.low);
                    [(v - half).max(p.low), (v + half).min(p.high)]
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
    let advice = advise(scene, &open, |_, _| {});
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
    let flights: Vec<(&str, bool)> = EXPERIMENTS
        .iter()
        .filter(|e| e.is_flight())
        .filter_map(|e| Some((e.id, right(e.id)?)))
        .collect();
    let hits = flights.iter().filter(|(_, right)| *right).count();
    Some(Case {
        truth: truth.id.to_owned(),
        open: open.candidates.iter().map(|h| h.spec.id.to_owned()).collect(),
        right_before: open.candidates.first().is_some_and(|h| h.spec.id == truth.id),
        recommended: recommended.experiment.clone(),
        predicted: recommended.correct_after.unwrap_or(f64::NAN),
        right_after: flights.iter().any(|(id, right)| *id == recommended.experiment && *right),
        right_by_chance: hits as f64 / flights.len().max(1) as f64,
    })
}
