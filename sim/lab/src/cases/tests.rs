//! The list is what the protocol says, and its logs are reproduced.

use std::collections::{BTreeMap, BTreeSet};

use haltere_log::record::LogReader;
use haltere_log::replay::{Verdict, replay_log};

use super::*;
use crate::generator::effects::Severity;

fn committed() -> (Scene, Vec<Case>) {
    let scene = Scene::lab().unwrap();
    let cases = suite(&scene, SUITE_SEED);
    (scene, cases)
}

#[test]
fn prop_the_suite_has_the_numbers_of_the_protocol() {
    let (_, cases) = committed();
    let mut counts = BTreeMap::new();
    for case in &cases {
        *counts.entry(case.key.class).or_insert(0) += 1;
    }
    let want = [
        (Class::Single, 252),
        (Class::Pair, 96),
        (Class::NoGap, 120),
        (Class::Unknown, 80),
        (Class::Plain, 40),
        (Class::Commissioning, 24),
        (Class::Calibration, 40),
    ];
    assert_eq!(counts, BTreeMap::from(want));
    let ids: BTreeSet<_> = cases.iter().map(|c| &c.key.id).collect();
    let seeds: BTreeSet<_> = cases.iter().map(|c| c.key.seed).collect();
    assert_eq!((ids.len(), seeds.len()), (cases.len(), cases.len()));

    let sealed = || cases.iter().filter(|c| c.key.id.starts_with("case-"));
    let share = |pick: fn(&Case) -> bool| sealed().filter(|c| pick(c)).count() as f64 / 588.0;
    assert!((share(|c| c.key.tenth) - 0.1).abs() < 0.01);
    assert!((share(|c| c.key.lockbox) - 0.25).abs() < 0.04, "{}", share(|c| c.key.lockbox));
    assert!(!cases.iter().any(|c| c.key.lockbox && c.key.tenth));
    for class in [Class::Single, Class::Pair, Class::NoGap, Class::Unknown, Class::Plain] {
        let of =
            |pick: fn(&Case) -> bool| sealed().filter(|c| c.key.class == class && pick(c)).count();
        assert!(of(|c| c.key.tenth) >= 4 && of(|c| c.key.lockbox) >= 7, "{class:?}");
    }
    let singles = || sealed().filter(|c| c.key.class == Class::Single);
    let effects: BTreeSet<_> = singles().map(|c| c.key.effects[0].id).collect();
    assert_eq!(effects.len(), 42);
    let pairs = || sealed().filter(|c| c.key.class == Class::Pair);
    assert!(pairs().all(|c| c.key.effects[0].severity != c.key.effects[1].severity));
    let same = pairs().filter(|c| c.key.effects[0].id[..1] == c.key.effects[1].id[..1]).count();
    assert_eq!(same, 48);
    assert!(singles().any(|c| c.key.onset_s.is_some()));
    assert!(
        singles().all(|c| c.key.onset_s.is_none() || c.key.effects[0].severity == Severity::High)
    );
}

/// The list is part of the protocol: whoever changes it changes the suite, and has to say so there.
#[test]
fn golden_the_committed_list() {
    let (_, cases) = committed();
    assert_eq!(digest(&cases).unwrap(), COMMITTED_DIGEST);
}

const COMMITTED_DIGEST: &str = "ec205a82cc433fe639438005b1da6ffde854e32f965cd6d6deaf579d51fa4850";

#[test]
fn prop_a_log_is_reproduced_and_a_second_one_is_equal() {
    let (scene, cases) = committed();
    let case = cases.iter().find(|c| c.key.class == Class::Plain).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let fly = |name: &str| {
        let path = folder.path().join(name);
        let setup = case.setup(&scene, Mission::Plain);
        let outcome = flight::record(&scene, setup, Mission::Plain, &path).unwrap();
        println!("{} {outcome:?}", case.key.id);
        path
    };
    let path = fly("a.mcap");
    let report = replay_log(&LogReader::open(&path).unwrap()).unwrap();
    assert_eq!(report.verdict, Verdict::Identical, "{report}");
    assert!(report.outputs > 5000, "{report}");
    // Chunks of the file depend on when it was synced; what it holds does not.
    let other = fly("b.mcap");
    let (a, b) = (LogReader::open(&path).unwrap(), LogReader::open(&other).unwrap());
    assert_eq!(a.session(), b.session());
    assert!(a.entries().eq(b.entries()));
}

#[test]
fn regress_a_healthy_vehicle_is_flown_to_the_end_of_its_mission() {
    // Its gears shake the board so that the accelerometer was called noise at 42 s: blind descent.
    let scene = Scene::lab().unwrap();
    let cases = suite(&scene, 777);
    let case = cases.iter().find(|c| c.key.id == "commissioning-19").unwrap();
    let dir = tempfile::tempdir().unwrap();
    let log = dir.path().join("flight.mcap");
    let setup = case.setup(&scene, Mission::Diagnostic);
    let outcome = flight::record(&scene, setup, Mission::Diagnostic, &log).unwrap();
    assert!(outcome.landed && outcome.flown_s > 100.0, "{outcome:?}");
}

/// `haltere-sim hide` says that it hides effects as strong as these.
#[test]
fn prop_what_is_hidden_is_as_strong_as_the_suite() {
    let (_, cases) = committed();
    for case in cases.iter().filter(|case| case.key.class == Class::Single) {
        let effect = &case.key.effects[0];
        let spec = crate::generator::effects::known().find(|spec| spec.id == effect.id).unwrap();
        let share = spec.strength(effect.size) / spec.strongest();
        let row = haltere_sim::hidden::candidates().find(|one| one.spec.id == effect.id).unwrap();
        let hidden = row.strengths[effect.severity as usize];
        assert!((share - hidden).abs() < 1e-3, "{}: {share} and {hidden}", effect.id);
    }
}
