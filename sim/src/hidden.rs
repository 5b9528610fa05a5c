//! An effect to hide: drawn from the library, as strong as those of the sealed suite.

use haltere_core::checks::Problems;
use haltere_gap::bank::library::with_effect;
use haltere_gap::bank::library::{at_share, axes, draws, standard};
use haltere_gap::scene::Scene;
use haltere_model::PlantConfig;
use haltere_model::effects::{self, EffectSpec};
use haltere_model::random::Stream;
use serde::Serialize;

/// An effect that can be hidden.
#[derive(Debug, Clone, Copy)]
pub struct Candidate {
    /// It.
    pub spec: &'static EffectSpec,
    /// Its strengths, as shares of the strong end of its plausible range.
    pub strengths: [f64; 3],
    /// Whether the flight shows it: others are hidden where they are asked for, but not by chance.
    pub shown: bool,
}

/// The effects that can be hidden, in the order of the list.
pub fn candidates() -> impl Iterator<Item = Candidate> {
    standard().into_iter().filter_map(|spec| {
        let hidden = spec.deviation()?.hidden;
        let shown = matches!(hidden, effects::Hidden::ByChance(_));
        Some(Candidate { spec, strengths: hidden.strengths()?, shown })
    })
}

/// Words for the three.
const STRENGTHS: [&str; 3] = ["just detectable", "middle", "strong"];
/// Draws of which one is taken: every other draw of a vector has one component alone.
const DRAWS: usize = 8;

/// A number that was set.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Value {
    /// Name and unit as in docs/EFFECTS.md.
    pub name: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// What it was set to.
    pub value: f64,
}

/// What is hidden.
#[derive(Debug, Clone)]
pub struct Hidden {
    /// The effect; `None`: the vehicle is healthy.
    pub spec: Option<&'static EffectSpec>,
    /// Its parameters, in the order of its specification.
    pub theta: Vec<f64>,
    /// How strong, in words.
    pub strength: &'static str,
    /// How often that was halved.
    pub halvings: usize,
}

impl Hidden {
    /// Nothing.
    pub fn none() -> Self {
        Self { spec: None, theta: Vec::new(), strength: "", halvings: 0 }
    }

    /// The effect of this id, or one of those that the flight shows, and then more than just detectable; strength, signs
    /// and places follow from the seed. `None`: there is no such effect.
    pub fn draw(id: Option<&str>, seed: u64, scene: &Scene) -> Option<Self> {
        let mut rng = Stream::new(seed, "hidden");
        let shown: Vec<_> = candidates().filter(|one| one.shown).collect();
        let any = ((rng.uniform() * shown.len() as f64) as usize).min(shown.len().checked_sub(1)?);
        let (Candidate { spec, strengths, .. }, weakest) = match id {
            None => (*shown.get(any)?, 1),
            Some(id) => (candidates().find(|one| one.spec.id.eq_ignore_ascii_case(id))?, 0),
        };
        let anchors = scene.survey.ids().len();
        let drawn = draws(spec, &scene.vehicle, &scene.room, anchors, DRAWS, &mut rng);
        let picked = ((rng.uniform() * DRAWS as f64) as usize).min(DRAWS - 1);
        let strong = ((rng.uniform() * 3.0) as usize).clamp(weakest, 2);
        let theta = drawn.get(picked)?;
        let sizes = axes(spec, &scene.vehicle, &scene.room, anchors).into_iter().zip(theta);
        let largest = sizes.filter_map(|(axis, value)| axis.share(*value)).fold(0.0, f64::max);
        let times = if largest > 0.0 { strengths[strong] / largest } else { 1.0 };
        let theta = at_share(spec, theta, times);
        Some(Self { spec: Some(spec), theta, strength: STRENGTHS[strong], halvings: 0 })
    }

    /// Half as much of it, for a vehicle that does not come to the end of its mission.
    pub fn halved(self) -> Self {
        let theta = self.spec.map_or(Vec::new(), |spec| at_share(spec, &self.theta, 0.5));
        Self { theta, halvings: self.halvings + 1, ..self }
    }

    /// Its id, or `none`.
    pub fn id(&self) -> &'static str {
        self.spec.map_or("none", |spec| spec.id)
    }

    /// The numbers that were set.
    pub fn values(&self) -> Vec<Value> {
        let parameters = self.spec.map_or(&[][..], |spec| spec.parameters);
        parameters
            .iter()
            .zip(&self.theta)
            .map(|(p, value)| Value { name: p.name, unit: p.unit, value: *value })
            .collect()
    }

    /// The plant with it.
    pub fn within(&self, mut plant: PlantConfig) -> Result<PlantConfig, Problems> {
        if let Some(spec) = self.spec {
            plant.effects = with_effect(plant.effects, spec, &self.theta)?;
        }
        Ok(plant)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_every_effect_is_as_strong_as_it_is_said_to_be_and_can_be_flown() {
        let scene = Scene::lab().unwrap();
        for Candidate { spec, strengths, .. } in candidates() {
            let id = spec.id;
            for seed in 0..12 {
                let hidden = Hidden::draw(Some(id), seed, &scene).unwrap();
                let sizes =
                    axes(spec, &scene.vehicle, &scene.room, 8).into_iter().zip(&hidden.theta);
                let most = sizes.filter_map(|(axis, v)| axis.share(*v)).fold(0.0, f64::max);
                assert!(strengths.iter().any(|s| (s - most).abs() < 1e-9), "{id} {most}");
                haltere_model::Plant::new(hidden.within(scene.plant(seed)).unwrap()).unwrap();
            }
        }
    }

    #[test]
    fn prop_half_of_an_effect_is_half_as_strong() {
        let scene = Scene::lab().unwrap();
        for Candidate { spec, .. } in candidates() {
            let id = spec.id;
            let whole = Hidden::draw(Some(id), 5, &scene).unwrap();
            let strongest = |hidden: &Hidden| {
                let axes = axes(hidden.spec.unwrap(), &scene.vehicle, &scene.room, 8);
                let shares = axes.into_iter().zip(&hidden.theta);
                shares.filter_map(|(axis, v)| axis.share(*v)).fold(0.0, f64::max)
            };
            let (was, half) = (strongest(&whole), whole.halved());
            assert!((strongest(&half) - 0.5 * was).abs() < 1e-9, "{id}");
            assert_eq!(half.halvings, 1);
        }
    }

    #[test]
    fn prop_the_same_seed_hides_the_same_and_many_seeds_hide_many() {
        let scene = Scene::lab().unwrap();
        let ids: std::collections::BTreeSet<_> = (0..400)
            .map(|seed| {
                let [one, again] = [0; 2].map(|_| Hidden::draw(None, seed, &scene).unwrap());
                assert_eq!((one.id(), &one.theta), (again.id(), &again.theta));
                assert_ne!(one.strength, STRENGTHS[0]);
                one.id()
            })
            .collect();
        let unseen = |one: &Candidate| !one.shown && ids.contains(one.spec.id);
        assert!(ids.len() > 32 && !candidates().any(|one| unseen(&one)), "{ids:?}");
        assert!(Hidden::draw(Some("Z9"), 1, &scene).is_none());
    }
}
