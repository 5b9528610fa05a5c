//! An effect to hide: drawn from the library, as strong as those of the sealed suite.

use haltere_core::checks::Problems;
use haltere_gap::library::{at_share, axes, draws, standard};
use haltere_gap::make_bank::with_effect;
use haltere_gap::scene::Scene;
use haltere_model::PlantConfig;
use haltere_model::effects::EffectSpec;
use haltere_model::random::Stream;
use serde::Serialize;

/// Strength of each effect of the sealed suite (those of the library but P7, H2, L2 and U4), as a share of the strong end of its
/// plausible range: just detectable, twice and four times as strong (sim/lab/PROTOCOL.md). The laboratory's tests hold the
/// two together.
pub const SHARES: [(&str, [f64; 3]); 42] = [
    ("A1", [0.25, 0.5, 1.0]),
    ("A2", [0.6, 1.0, 1.0]),
    ("A3", [0.1, 0.2, 0.4]),
    ("A4", [1.0, 1.0, 1.0]),
    ("A5", [0.177, 0.354, 0.707]),
    ("A6", [0.354, 0.707, 1.0]),
    ("A7", [0.167, 0.333, 0.667]),
    ("A8", [0.707, 1.0, 1.0]),
    ("A9", [1.0, 1.0, 1.0]),
    ("A10", [1.0, 1.0, 1.0]),
    ("P1", [0.177, 0.354, 0.707]),
    ("P2", [0.227, 0.455, 0.909]),
    ("P3", [0.354, 0.707, 1.0]),
    ("P4", [0.707, 1.0, 1.0]),
    ("P5", [0.707, 1.0, 1.0]),
    ("P6", [0.707, 1.0, 1.0]),
    ("I1", [0.354, 0.707, 1.0]),
    ("I2", [0.25, 0.5, 1.0]),
    ("L1", [0.25, 0.5, 1.0]),
    ("L3", [0.25, 0.5, 1.0]),
    ("L4", [0.354, 0.707, 1.0]),
    ("L5", [0.533, 1.0, 1.0]),
    ("L6", [0.354, 0.707, 1.0]),
    ("M1", [0.707, 1.0, 1.0]),
    ("M2", [0.354, 0.707, 1.0]),
    ("M3", [0.707, 1.0, 1.0]),
    ("M4", [0.354, 0.707, 1.0]),
    ("M5", [0.354, 0.707, 1.0]),
    ("M6", [0.707, 1.0, 1.0]),
    ("U1", [0.2, 0.4, 0.8]),
    ("U2", [0.229, 0.457, 0.914]),
    ("U3", [0.2, 0.4, 0.8]),
    ("U5", [0.187, 0.375, 0.75]),
    ("U6", [0.707, 1.0, 1.0]),
    ("U7", [0.2, 0.4, 0.8]),
    ("U8", [0.2, 0.4, 0.8]),
    ("U9", [0.312, 0.625, 1.0]),
    ("U10", [0.167, 0.333, 0.667]),
    ("T1", [0.316, 0.632, 1.0]),
    ("T2", [0.25, 0.5, 1.0]),
    ("T3", [0.25, 0.5, 1.0]),
    ("H1", [0.354, 0.707, 1.0]),
];

/// What the diagnostic flight in the laboratory does not show, by the word of the diagnosis: `not_testable` of `haltere gap
/// diagnose --size small --json`, the same on each of twelve flights of other effects. Hidden where it is asked for, but not by
/// chance.
pub const NOT_SHOWN: [&str; 7] = ["A8", "A9", "A10", "P5", "M1", "M3", "U3"];

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
        let shown: Vec<_> = SHARES.iter().filter(|(id, _)| !NOT_SHOWN.contains(id)).collect();
        let any = ((rng.uniform() * shown.len() as f64) as usize).min(shown.len() - 1);
        let ((id, shares), weakest) = match id {
            None => (*shown[any], 1),
            Some(id) => (*SHARES.iter().find(|(known, _)| known.eq_ignore_ascii_case(id))?, 0),
        };
        let spec = standard().into_iter().find(|spec| spec.id == id)?;
        let anchors = scene.survey.ids().len();
        let drawn = draws(spec, &scene.vehicle, &scene.room, anchors, DRAWS, &mut rng);
        let picked = ((rng.uniform() * DRAWS as f64) as usize).min(DRAWS - 1);
        let strong = ((rng.uniform() * 3.0) as usize).clamp(weakest, 2);
        let theta = drawn.get(picked)?;
        let sizes = axes(spec, &scene.vehicle, &scene.room, anchors).into_iter().zip(theta);
        let largest = sizes.filter_map(|(axis, value)| axis.share(*value)).fold(0.0, f64::max);
        let times = if largest > 0.0 { shares[strong] / largest } else { 1.0 };
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
        for (id, shares) in SHARES {
            for seed in 0..12 {
                let hidden = Hidden::draw(Some(id), seed, &scene).unwrap();
                let spec = hidden.spec.unwrap();
                let sizes =
                    axes(spec, &scene.vehicle, &scene.room, 8).into_iter().zip(&hidden.theta);
                let most = sizes.filter_map(|(axis, v)| axis.share(*v)).fold(0.0, f64::max);
                assert!(shares.iter().any(|s| (s - most).abs() < 1e-9), "{id} {most} {shares:?}");
                haltere_model::Plant::new(hidden.within(scene.plant(seed)).unwrap()).unwrap();
            }
        }
    }

    #[test]
    fn prop_half_of_an_effect_is_half_as_strong() {
        let scene = Scene::lab().unwrap();
        for (id, _) in SHARES {
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
        assert!(ids.len() > 32 && NOT_SHOWN.iter().all(|id| !ids.contains(id)), "{ids:?}");
        assert!(Hidden::draw(Some("Z9"), 1, &scene).is_none());
    }
}
