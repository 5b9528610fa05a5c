//! How far a gap shrinks on flights that the fit did not see: one explanation, others as control, by
//! channel, with floor, noise, attainable maximum.
//!
//! Attainable is the best of everything that was tried, the asked explanation and pairs of effects
//! included: no retuning of every constant stands behind it, so it is a bound from below.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};

use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;
use rayon::prelude::*;
use serde::Serialize;

use crate::bank::archive::{Job, Shelf};
use crate::bank::fly::fly_observed_into;
use crate::bank::library::with_effect;
use crate::flight::logs::Flown;
use crate::flight::statistics::{specs, statistics_of};
use crate::flight::trace::Trace;
use crate::nominal::Nominal;
use crate::scene::{Scene, Told};
use crate::shrink::resize::{Off, resize};
use crate::shrink::{
    Paired, Shrink, by_channel, efficiency, medians, scales, shrink, wrong_effects,
};
use haltere_model::Vehicle;
use haltere_model::effects::EffectSpec;

/// Seed of intervals by channel.
const SEED: u64 = 2;

/// Simulated flights before and after, per held-out flight. Paired seeds.
pub const SHRINK_FLIGHTS: usize = 8;
/// The same after, for what is not named: of it a value is told, no interval (judgement).
const RIVAL_FLIGHTS: usize = 4;
/// At each size that is searched (judgement): beside one flight, the variance of both is 1.5 of its own, with many it were 1.
pub const SEARCH_FLIGHTS: usize = 2;
/// Flights with benign jitter that give the scale of a difference, and the seed of the first.
const BENIGN_FLIGHTS: usize = 32;
const BENIGN_SEED: u64 = 7_800_000;
/// Fewest healthy flights whose spread counts.
const LEAST_REFERENCES: usize = 8;
/// First seed of these flights: none of a bank's.
const SHRINK_SEED: u64 = 7_700_000;
/// Resampling of intervals.
const BOOTSTRAP_SEED: u64 = 1;
/// Effects with their parameters.
type Acting<'a> = [(&'a EffectSpec, &'a [f64])];

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
/// [`crate::shrink::resize`]); several effects keep their sizes, which were fitted together. Returns the shares.
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
                let sized = resize(
                    |e| model.off(fitted_on, e, SEARCH_FLIGHTS),
                    model.vehicle(),
                    spec,
                    theta,
                );
                let share = sized.as_ref().map_or(0.0, |(share, _)| *share);
                explanation.effects = sized.map(|(_, theta)| (*spec, theta)).into_iter().collect();
                share
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

/// Flies every explanation beside every held-out flight; flights of one mission are beside the same ones. `accepted`: healthy flights
/// of the airframe on the same missions; `shelf`: where flights without an effect are kept; `progress`: done, of how many.
pub fn measure(
    held_out: &[Flown],
    accepted: &[Flown],
    told: &Told,
    asked: &Explanation,
    others: &[Explanation],
    shelf: &Shelf,
    progress: impl Fn(usize, usize),
) -> Result<Measured, NotMeasured> {
    let scenes: Vec<Scene> = held_out.iter().map(|flown| flown.scene(told).on_grid()).collect();
    let mut models: BTreeMap<String, HeldOut<'_>> = BTreeMap::new();
    let mut pairs: Vec<Vec<Paired>> = vec![Vec::new(); 1 + others.len()];
    let mut scales_of_last: Option<Vec<f64>> = None;
    let mut why = "none was named".to_owned();
    let of = held_out.len() * (2 + others.len());
    let mut done = 0;
    for (flown, scene) in held_out.iter().zip(&scenes) {
        let nominal = Nominal::of_scene(scene);
        let real = match statistics_of(&flown.trace, &nominal) {
            Ok(statistics) => statistics,
            Err(error) => {
                why = format!("{}: {error}", flown.path.display());
                done += 2 + others.len();
                continue;
            }
        };
        let model = models.entry(scene.key(&flown.mission, "")).or_insert_with(|| {
            let of_mission = accepted.iter().filter(|a| a.mission.len() == flown.mission.len());
            let rows = of_mission.filter_map(|a| statistics_of(&a.trace, &nominal).ok());
            HeldOut::new(scene, &flown.mission, &rows.collect::<Vec<_>>(), shelf)
        });
        done += 1;
        progress(done, of);
        let counts = std::iter::once(SHRINK_FLIGHTS).chain(std::iter::repeat(RIVAL_FLIGHTS));
        let explanations = std::iter::once(asked).chain(others).zip(counts);
        for (slot, (explanation, count)) in pairs.iter_mut().zip(explanations) {
            let effects: Vec<_> =
                explanation.effects.iter().map(|(spec, theta)| (*spec, &theta[..])).collect();
            slot.push(model.paired(&real, &effects, count));
            done += 1;
            progress(done, of);
        }
        scales_of_last = Some(model.scales.clone());
    }
    let Some(scales) = scales_of_last else { return Err(NotMeasured::Nothing(why)) };
    let mut shrinks: Vec<Shrink> =
        pairs.iter().map(|p| crate::shrink::shrink(p, &scales, SEED)).collect();
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

/// Flights of the model on another mission, nominal and with effects, for [`shrink`].
#[derive(Debug)]
pub struct HeldOut<'a> {
    scene: &'a Scene,
    items: &'a [MISSION_ITEM_INT_DATA],
    nominal: Nominal,
    before: Vec<Vec<f64>>,
    scales: Vec<f64>,
    /// Added to every simulated flight: what healthy flights of this airframe differ by.
    offset: Vec<f64>,
    /// Healthy flights of this airframe on this mission.
    healthy: Vec<Vec<f64>>,
    /// What was flown already: by effects, in the order of seeds; `None`: lost.
    flown: Mutex<BTreeMap<String, Vec<Option<Vec<f64>>>>>,
}

impl<'a> HeldOut<'a> {
    /// Flies the nominal model. `references`: healthy flights of this airframe on this mission; `shelf`: where flights of the model
    /// without an effect are kept.
    pub fn new(
        scene: &'a Scene,
        items: &'a [MISSION_ITEM_INT_DATA],
        references: &[Vec<f64>],
        shelf: &Shelf,
    ) -> Self {
        let mut archive = shelf.open(scene, items);
        let mut fly = |first: u64, count: usize, jitter: bool| {
            let job = |k: usize| Job { seed: first + k as u64, jitter, effect: None };
            archive.fly(&(0..count).map(job).collect::<Vec<_>>(), &|| ())
        };
        let plain = fly(SHRINK_SEED, SHRINK_FLIGHTS, false);
        let benign: Vec<_> = fly(BENIGN_SEED, BENIGN_FLIGHTS, true).into_iter().flatten().collect();
        archive.keep();
        let mut result = Self {
            scene,
            items,
            nominal: Nominal::of_scene(scene),
            before: Vec::new(),
            scales: Vec::new(),
            offset: Vec::new(),
            healthy: references.to_vec(),
            flown: Mutex::new(BTreeMap::from([(String::new(), plain)])),
        };
        result.before = result.fly(&[], SHRINK_FLIGHTS);
        // A difference counts by what benign changes of the constants make, and by what healthy flights
        // differ by: a battery that is charged otherwise is no gap, however exactly it repeats.
        result.scales = scales(&benign);
        if references.len() >= LEAST_REFERENCES {
            for (own, real) in result.scales.iter_mut().zip(scales(references)) {
                *own = if real.is_finite() { own.hypot(real) } else { *own };
            }
        }
        // What the recording computer adds is no gap either: a simulator is punctual to the microsecond.
        for (own, spec) in result.scales.iter_mut().zip(specs()) {
            let unknown = spec.relative && references.len() < LEAST_REFERENCES;
            *own = if unknown { f64::NAN } else { own.hypot(spec.resolution) };
        }
        let nominal = medians(&result.before);
        result.offset = if references.is_empty() {
            vec![0.0; nominal.len()]
        } else {
            medians(references).iter().zip(&nominal).map(|(r, n)| r - n).collect()
        };
        let before = std::mem::take(&mut result.before);
        result.before = result.shifted(before);
        result
    }

    fn shifted(&self, rows: Vec<Vec<f64>>) -> Vec<Vec<f64>> {
        let shift = |row: Vec<f64>| {
            row.iter()
                .zip(&self.offset)
                .map(|(v, o)| if o.is_finite() { v + o } else { *v })
                .collect()
        };
        rows.into_iter().map(shift).collect()
    }

    /// Flights by the first seeds with these effects, lost ones left out.
    fn fly(&self, effects: &Acting<'_>, flights: usize) -> Vec<Vec<f64>> {
        // Debug output of numbers is exact.
        let key: String =
            effects.iter().map(|(spec, theta)| format!("{} {theta:?} ", spec.id)).collect();
        let known = || self.flown.lock().unwrap_or_else(PoisonError::into_inner);
        let mut rows = known().get(&key).cloned().unwrap_or_default();
        let fly = |trace: &mut Trace, k: usize| {
            let mut plant = self.scene.plant(SHRINK_SEED + k as u64);
            for (spec, theta) in effects {
                plant.effects = with_effect(plant.effects, spec, theta).ok()?;
            }
            let pilot = self.scene.pilot.clone();
            fly_observed_into(trace, self.scene, self.items, plant, pilot).ok()?;
            statistics_of(trace, &self.nominal).ok()
        };
        if rows.len() < flights {
            let trace = || Trace::new(self.scene.survey.clone());
            rows.par_extend((rows.len()..flights).into_par_iter().map_init(trace, fly));
            known().insert(key, rows.clone());
        }
        rows.into_iter().take(flights).flatten().collect()
    }

    /// The vehicle that is flown.
    pub fn vehicle(&self) -> &Vehicle {
        &self.scene.vehicle
    }

    /// One real flight beside so many flights of the model before and after.
    pub fn paired(&self, real: &[f64], effects: &Acting<'_>, flights: usize) -> Paired {
        let after = self.shifted(self.fly(effects, flights));
        let common = after.len().min(self.before.len());
        Paired {
            real: real.to_vec(),
            before: self.before[..common].to_vec(),
            after: after[..common].to_vec(),
            healthy: self.healthy.clone(),
        }
    }

    /// How far so many flights of the model with these effects are from a real one.
    pub fn off(&self, real: &[f64], effects: &Acting<'_>, flights: usize) -> Off {
        let flights = self.shifted(self.fly(effects, flights));
        let count = flights.len() as f64;
        let mean = |j: usize| flights.iter().filter_map(|row| row.get(j)).sum::<f64>() / count;
        let places = self.scales.iter().zip(real).enumerate();
        let left = crate::shrink::to_all(real, &flights, &self.scales);
        Off {
            mean: places.map(|(j, (scale, real))| (mean(j) - real) / scale).collect(),
            // Effects that cannot be flown explain nothing.
            distance: if left.is_finite() { left } else { f64::INFINITY },
        }
    }

    /// Distance of a held-out flight before and after.
    pub fn distances(&self, flight: &Paired) -> [f64; 2] {
        let to = |sims: &[Vec<f64>]| crate::shrink::to_all(&flight.real, sims, &self.scales);
        [to(&flight.before), to(&flight.after)]
    }

    /// Shrink over held-out flights.
    pub fn shrink(&self, flights: &[Paired]) -> Shrink {
        shrink(flights, &self.scales, BOOTSTRAP_SEED)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bank::library::standard;

    #[test]
    fn val_a_held_out_flight_of_the_effect_is_explained_by_it() {
        let scene = Scene::lab().unwrap();
        let items = crate::bank::missions::plain(&scene);
        let spec = standard().into_iter().find(|s| s.id == "P1").unwrap();
        let model = HeldOut::new(&scene, &items, &[], &Shelf::none());
        let own = model.fly(&[(spec, &[0.12])], SHRINK_FLIGHTS).swap_remove(0);
        let paired =
            |effects: &[(&EffectSpec, &[f64])]| model.paired(&own, effects, SHRINK_FLIGHTS);
        let (right, none) = (paired(&[(spec, &[0.12])]), paired(&[]));
        let (right, none) = (model.shrink(&[right]), model.shrink(&[none]));
        assert!(right.value.unwrap() > 0.8, "{right:?}");
        assert!(none.value.unwrap().abs() < 0.1, "{none:?}");
        assert_eq!(right.interval, None, "one flight has no interval");
    }
}
