//! The list of cases: fixed by the seed of the suite, before anything is flown.

use std::collections::BTreeMap;

use serde::Serialize;

use super::detectable::Detectable;
use crate::generator::craft::Craft;
use crate::generator::effects::{Deviations, Hall, SEVERITIES, Severity, Spec, known, unknown};
use crate::generator::noise::Noise;
use crate::generator::{Setup, hall};
use haltere_gap::scene::Scene;

/// Numbers of the protocol.
const PAIRS: usize = 96;
const HEALTHY: usize = 120;
const REPEATS: usize = 40;
const COMMISSIONING: usize = 24;
const CALIBRATION: usize = 40;
/// Severities of the four flights of an effect that the library lacks.
const UNKNOWN_SEVERITIES: [Severity; 4] =
    [Severity::Low, Severity::Middle, Severity::High, Severity::Middle];
/// An effect that begins in flight does so between these times of the log, s.
const ONSET_S: [f64; 2] = [32.0, 58.0];
/// Every tenth case of a class, from this one on, is of the fixed tenth.
const TENTH: usize = 3;

/// Class of a case.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Class {
    /// One effect.
    Single,
    /// Two effects.
    Pair,
    /// None.
    NoGap,
    /// One that the library does not have.
    Unknown,
    /// One effect, flown as hover and box.
    Plain,
    /// Healthy, public: what a user flies first.
    Commissioning,
    /// Healthy, public: for thresholds.
    Calibration,
}

/// A standard flight.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Mission {
    /// The diagnostic one.
    Diagnostic,
    /// The one that shrinkage is measured on.
    HeldOut,
    /// Hover and box.
    Plain,
}

impl Mission {
    /// As it stands in file names.
    pub fn name(self) -> &'static str {
        match self {
            Self::Diagnostic => "diagnostic",
            Self::HeldOut => "held-out",
            Self::Plain => "plain",
        }
    }
}

/// An effect of a case, as the key tells it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct KeyEffect {
    /// Id of GAP.md section 3, `X…` for what the library lacks.
    pub id: &'static str,
    /// Name.
    pub name: &'static str,
    /// Block of the chain.
    pub block: &'static str,
    /// How strong.
    pub severity: Severity,
    /// Size, in `unit`.
    pub size: f64,
    /// Unit of the size.
    pub unit: &'static str,
    /// What was set; names and units as in docs/EFFECTS.md where the number means the same.
    pub parameters: BTreeMap<&'static str, f64>,
    /// Place of the anchor in the survey, ascending id.
    pub anchor: Option<u8>,
    /// Place, m.
    pub place_NE_m: Option<[f64; 2]>,
}

/// The key to a case.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Key {
    /// Version of the format.
    pub format: u32,
    /// Id of the case.
    pub id: String,
    /// Class.
    pub class: Class,
    /// What it is diagnosed on.
    pub mission: Mission,
    /// What deviates.
    pub effects: Vec<KeyEffect>,
    /// Since when in the first flight, s of the log; absent: always. In the held-out flight: always.
    pub onset_s: Option<f64>,
    /// Whether the constants of the vehicle are jittered.
    pub jitter: bool,
    /// Seed of the case.
    pub seed: u64,
    /// Whether it is of the fixed tenth.
    pub tenth: bool,
    /// Whether it is kept for releases.
    pub lockbox: bool,
}

/// A case, ready to be flown.
pub struct Case {
    /// What it is.
    pub key: Key,
    /// Its flights.
    pub missions: Vec<Mission>,
    deviations: Deviations,
    /// All flights of a suite are flown in one room.
    room_seed: u64,
}

impl Case {
    /// The world of one of its flights.
    pub fn setup(&self, scene: &Scene, mission: Mission) -> Setup {
        let seed = self.key.seed;
        let healthy = Setup::healthy(scene, mixed(seed, mission as u64 + 1));
        let craft: Craft = healthy.craft.clone();
        let craft = if self.key.jitter { craft.jittered(seed) } else { craft };
        let onset_s = if mission == Mission::HeldOut { None } else { self.key.onset_s };
        Setup {
            craft,
            deviations: self.deviations.clone(),
            onset_s: onset_s.unwrap_or(0.0),
            room_seed: self.room_seed,
            ..healthy
        }
    }
}

/// Another seed for each number.
pub fn mixed(seed: u64, number: u64) -> u64 {
    (seed ^ number.wrapping_mul(0x9e37_79b9_7f4a_7c15)).wrapping_mul(0xd134_2543_de82_ef95) >> 11
}

/// A case without its id.
struct Plan {
    class: Class,
    effects: Vec<(&'static Spec, Severity)>,
    jitter: bool,
    sudden: bool,
}

/// What all cases of a suite have in common.
struct Place<'a> {
    hall: Hall,
    detectable: &'a Detectable,
    suite_seed: u64,
}

/// The whole suite in the order of its ids; commissioning and calibration come first.
pub fn suite(scene: &Scene, suite_seed: u64) -> Vec<Case> {
    let detectable = Detectable::committed();
    let place = Place { hall: hall(scene), detectable: &detectable, suite_seed };
    let mut sealed = Vec::new();
    let mut sealed_index = BTreeMap::<Class, usize>::new();
    for plan in sealed_plans(suite_seed) {
        let index = sealed_index.entry(plan.class).or_default();
        sealed.push((plan, *index));
        *index += 1;
    }
    // Ids must not tell the class.
    let mut rng = Noise::new(suite_seed, "order");
    for i in (1..sealed.len()).rev() {
        sealed.swap(i, rng.below(i + 1));
    }
    let healthy = |class, jitter| Plan { class, effects: Vec::new(), jitter, sudden: false };
    let mut cases = Vec::new();
    for i in 0..COMMISSIONING {
        let plan = healthy(Class::Commissioning, false);
        let seed = mixed(suite_seed ^ 0xc0, i as u64);
        cases.push(case(format!("commissioning-{:02}", i + 1), plan, i, seed, &place));
    }
    for i in 0..CALIBRATION {
        let plan = healthy(Class::Calibration, i % 2 == 1);
        let seed = mixed(suite_seed ^ 0xca00, i as u64);
        cases.push(case(format!("calibration-{:02}", i + 1), plan, i, seed, &place));
    }
    for (number, (plan, index)) in sealed.into_iter().enumerate() {
        let seed = mixed(suite_seed ^ 0x5ea1_0000, number as u64);
        cases.push(case(format!("case-{:03}", number + 1), plan, index, seed, &place));
    }
    cases
}

fn sealed_plans(suite_seed: u64) -> Vec<Plan> {
    let mut plans = Vec::new();
    let one = |class, spec, severity| Plan {
        class,
        effects: vec![(spec, severity)],
        jitter: false,
        sudden: false,
    };
    for spec in known() {
        for severity in SEVERITIES {
            for repeat in 0..2 {
                // Of what can break in flight, one of the strong flights begins healthy.
                let sudden = spec.sudden && severity == Severity::High && repeat == 1;
                plans.push(Plan { sudden, ..one(Class::Single, spec, severity) });
            }
        }
    }
    let all: Vec<&'static Spec> = known().collect();
    let mut rng = Noise::new(suite_seed, "pairs");
    for i in 0..PAIRS {
        let same = i % 2 == 0;
        // Every effect leads at least twice.
        let first = all[i % all.len()];
        let mates: Vec<_> =
            all.iter().filter(|s| s.id != first.id && (group(s) == group(first)) == same).collect();
        let second = mates[rng.below(mates.len())];
        let strengths = match rng.below(4) {
            0 => [Severity::High, Severity::Low],
            1 => [Severity::High, Severity::Middle],
            2 => [Severity::Middle, Severity::High],
            _ => [Severity::Low, Severity::High],
        };
        plans.push(Plan {
            class: Class::Pair,
            effects: vec![(first, strengths[0]), (second, strengths[1])],
            jitter: false,
            sudden: false,
        });
    }
    for i in 0..HEALTHY {
        let jitter = i % 2 == 1;
        plans.push(Plan { class: Class::NoGap, effects: Vec::new(), jitter, sudden: false });
    }
    for spec in unknown() {
        for severity in UNKNOWN_SEVERITIES {
            plans.push(one(Class::Unknown, spec, severity));
        }
    }
    let mut order: Vec<usize> = (0..all.len()).collect();
    let mut rng = Noise::new(suite_seed, "repeats");
    for i in (1..order.len()).rev() {
        order.swap(i, rng.below(i + 1));
    }
    for (i, spec) in order.into_iter().take(REPEATS).enumerate() {
        plans.push(one(Class::Plain, all[spec], SEVERITIES[i % 3]));
    }
    plans
}

/// Letters of the id: the subsystem of GAP.md.
fn group(spec: &Spec) -> &'static str {
    spec.id.get(..1).unwrap_or("")
}

fn case(id: String, plan: Plan, index: usize, seed: u64, place: &Place<'_>) -> Case {
    let mut deviations = Deviations::default();
    let mut rng = Noise::new(seed, "draw");
    let effects = plan
        .effects
        .iter()
        .map(|(spec, severity)| {
            let size = place.detectable.size(spec, severity.times());
            let set = spec.apply(size, &mut rng, &place.hall, &mut deviations);
            KeyEffect {
                id: spec.id,
                name: spec.name,
                block: spec.block,
                severity: *severity,
                size,
                unit: spec.unit,
                parameters: set.parameters,
                anchor: set.anchor,
                place_NE_m: set.place_NE_m,
            }
        })
        .collect();
    let onset_s = plan.sudden.then(|| rng.between(ONSET_S[0], ONSET_S[1]).round());
    let sealed = !matches!(plan.class, Class::Commissioning | Class::Calibration);
    let tenth = index % 10 == TENTH || !sealed;
    // A quarter of every class that does not beat with the order of severities and repeats.
    let lockbox = sealed && !tenth && (index * 7 + index / 6).is_multiple_of(4);
    let missions = match plan.class {
        Class::Plain => vec![Mission::Plain, Mission::HeldOut],
        Class::Commissioning | Class::Calibration => {
            vec![Mission::Diagnostic, Mission::HeldOut, Mission::Plain]
        }
        _ => vec![Mission::Diagnostic, Mission::HeldOut],
    };
    let key = Key {
        format: 1,
        id,
        class: plan.class,
        mission: missions[0],
        effects,
        onset_s,
        jitter: plan.jitter,
        seed,
        tenth,
        lockbox,
    };
    Case { key, missions, deviations, room_seed: place.suite_seed }
}
