//! How far a gap shrinks on flights that the fit did not see: one explanation, others as control, by
//! channel, with floor, noise, attainable maximum.
//!
//! Attainable is the best of everything that was tried, the asked explanation and pairs of effects
//! included: no retuning of every constant stands behind it, so it is a bound from below.

use serde::Serialize;

use super::diagnosis::{HeldOut, observed};
use super::logs::Flown;
use super::nominal::Nominal;
use super::resize::resize;
use super::shrink::{Paired, Shrink, by_channel, efficiency, wrong_effects};
use super::statistics::specs;
use crate::model::effects::EffectSpec;
use crate::model::room::Room;

/// Seed of intervals by channel.
const SEED: u64 = 2;

/// Effects that act together, as one explanation.
#[derive(Debug, Clone)]
pub struct Explanation {
    /// For people.
    pub name: String,
    /// The effects with their parameters.
    pub effects: Vec<(&'static EffectSpec, Vec<f64>)>,
}

/// What was measured.
#[derive(Debug, Clone, Serialize)]
pub struct Measured {
    /// Over all statistics.
    pub whole: Shrink,
    /// By channel.
    pub channels: Vec<(String, Shrink)>,
    /// Best shrink of everything that was tried.
    pub attainable: Option<f64>,
    /// By which explanation.
    pub attained_by: String,
    /// Shrink over attainable.
    pub efficiency: Option<f64>,
    /// Shrink of the others.
    pub wrong: Vec<(String, Option<f64>)>,
    /// Median of these.
    pub wrong_median: Option<f64>,
}

/// Searches the size of every explanation of one effect on the flight that was diagnosed (see
/// [`super::resize`]); several effects keep their sizes, which were fitted together. Returns the shares.
/// `fitted_on`: statistics of that flight; `model` flies its mission; `progress`: done, of how many.
pub fn resize_all(
    model: &HeldOut<'_>,
    fitted_on: &[f64],
    explanations: &mut [&mut Explanation],
    progress: impl Fn(usize, usize),
) -> Vec<f64> {
    let of = explanations.len();
    let mut shares = Vec::with_capacity(of);
    for (k, explanation) in explanations.iter_mut().enumerate() {
        let share = match &explanation.effects[..] {
            [(spec, theta)] => {
                let sized = resize(model, fitted_on, spec, theta);
                explanation.effects = sized.theta.map(|theta| (*spec, theta)).into_iter().collect();
                sized.share
            }
            _ => 1.0,
        };
        shares.push(share);
        progress(k + 1, of);
    }
    shares
}

/// Why nothing was measured.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum NotMeasured {
    /// No flight can be used.
    #[error("no held-out flight could be observed: {0}")]
    Nothing(String),
}

/// Flies every explanation beside every held-out flight. `accepted`: healthy flights of the airframe on
/// the same missions; `progress`: done, of how many.
pub fn measure(
    held_out: &[Flown],
    accepted: &[Flown],
    room: Option<Room>,
    asked: &Explanation,
    others: &[Explanation],
    progress: impl Fn(usize, usize),
) -> Result<Measured, NotMeasured> {
    let mut pairs: Vec<Vec<Paired>> = vec![Vec::new(); 1 + others.len()];
    let mut model_of_last: Option<Vec<f64>> = None;
    let mut why = "none was named".to_owned();
    let of = held_out.len() * (2 + others.len());
    let mut done = 0;
    for flown in held_out {
        let scene = flown.scene(room.clone()).on_grid();
        let nominal = Nominal::of_scene(&scene);
        let real = match observed(flown.clone(), &nominal).observation {
            Ok(seen) => seen.statistics,
            Err(error) => {
                why = format!("{}: {error}", flown.path.display());
                done += 2 + others.len();
                continue;
            }
        };
        let references: Vec<Vec<f64>> = accepted
            .iter()
            .filter(|a| a.mission.len() == flown.mission.len())
            .filter_map(|a| observed(a.clone(), &nominal).observation.ok())
            .map(|seen| seen.statistics)
            .collect();
        let model = HeldOut::new(&scene, &flown.mission, &references);
        done += 1;
        progress(done, of);
        for (slot, explanation) in pairs.iter_mut().zip(std::iter::once(asked).chain(others)) {
            let effects: Vec<_> =
                explanation.effects.iter().map(|(spec, theta)| (*spec, &theta[..])).collect();
            slot.push(model.paired(&real, &effects));
            done += 1;
            progress(done, of);
        }
        model_of_last = Some(model.scales().to_vec());
    }
    let Some(scales) = model_of_last else { return Err(NotMeasured::Nothing(why)) };
    let mut shrinks: Vec<Shrink> =
        pairs.iter().map(|p| super::shrink::shrink(p, &scales, SEED)).collect();
    let own = shrinks.remove(0);
    let names: Vec<&str> = others.iter().map(|o| o.name.as_str()).collect();
    let (mut best, mut attained_by) = (own, asked.name.clone());
    for (s, name) in shrinks.iter().zip(&names) {
        if s.value > best.value {
            (best, attained_by) = (*s, (*name).to_owned());
        }
    }
    Ok(Measured {
        whole: own,
        channels: by_channel(&pairs[0], &scales, &channels(), SEED),
        attainable: best.value,
        attained_by,
        efficiency: efficiency(&own, &best),
        wrong: names.iter().zip(&shrinks).map(|(n, s)| ((*n).to_owned(), s.value)).collect(),
        wrong_median: wrong_effects(&shrinks),
    })
}

/// Channels with the places of their statistics.
pub fn channels() -> Vec<(String, Vec<usize>)> {
    let mut out: Vec<(String, Vec<usize>)> = Vec::new();
    for (j, spec) in specs().iter().enumerate() {
        let name = format!("{:?}", spec.channel);
        match out.iter_mut().find(|(n, _)| *n == name) {
            Some((_, places)) => places.push(j),
            None => out.push((name, vec![j])),
        }
    }
    out
}
