//! Commissioning on flights of the simulator itself, with a vehicle whose constants were moved.

use super::constants::CONSTANTS;
use super::*;
use crate::bank::fly::fly_observed;
use crate::bank::missions;
use crate::flight::residuals::StatSpec;
use haltere_model::effects::Block;
use haltere_model::random::Stream;

const MOVED: [(&str, f64); 8] = [
    ("wings.thrust_n_per_hz", 1.15),
    ("drag.k_ns_per_m_hz.x", 0.85),
    ("drag.k_ns_per_m_hz.y", 1.15),
    ("battery.resistance_ohm", 1.15),
    ("inner_loop.frequency_radps.x", 0.85),
    ("inner_loop.frequency_radps.y", 1.15),
    ("imu.std_gyro_radps", 1.15),
    ("uwb.std_m", 1.15),
];

#[test]
fn val_constants_that_were_moved_by_15_per_cent_are_found_and_held_out_flights_come_near() {
    let scene = Scene::lab().unwrap();
    let items = missions::plain(&scene);
    let constants: Vec<Constant> =
        MOVED.iter().map(|(key, _)| *CONSTANTS.iter().find(|c| c.key == *key).unwrap()).collect();
    let file = &scene.vehicle;
    let at: Vec<f64> = constants
        .iter()
        .zip(MOVED)
        .map(|(c, (_, times))| c.sigmas(file, times * c.value(file)))
        .collect();
    let flown = Scene { vehicle: moved(&constants, file, &at), ..scene.clone() };
    let traces: Vec<Trace> = (0..LEAST_FLIGHTS as u64)
        .map(|seed| {
            fly_observed(&flown, &items, flown.plant(100 + seed), flown.pilot.clone()).unwrap()
        })
        .collect();
    let accepted: Vec<&Trace> = traces.iter().collect();
    let found = commission_for(&constants, &scene, &items, &accepted, &|_, _| ()).unwrap();
    let told: Vec<String> = found.constants.iter().map(|f| format!("{f:?}")).collect();
    let shown = found.constants.iter().filter(|f| f.shown).count();
    assert!(shown >= 6, "{told:#?}");
    let inside = |(f, (_, times)): &(&Found, (&str, f64))| {
        !f.shown || (f.low..=f.high).contains(&(times * f.file))
    };
    // Of eight intervals of 90 % six or more hold the truth in 96 of 100 cases.
    let inside = found.constants.iter().zip(MOVED).filter(inside).count();
    assert!(inside >= 6, "{told:#?}");
    assert!(
        found.whole.after < found.whole.limit && found.whole.limit < found.whole.before,
        "{:?}",
        found.blocks
    );
    assert_eq!(found.why_not_yet(), None);
}

#[test]
fn val_flights_with_what_no_constant_says_are_not_yet_this_vehicles() {
    let scene = Scene::lab().unwrap();
    let items = missions::plain(&scene);
    let constants: Vec<Constant> = CONSTANTS
        .iter()
        .filter(|c| ["wings.thrust_n_per_hz", "uwb.std_m"].contains(&c.key))
        .copied()
        .collect();
    // Rolling turns the vehicle: the file has no word for it.
    let traces: Vec<Trace> = (0..LEAST_FLIGHTS as u64)
        .map(|seed| {
            let mut plant = scene.plant(200 + seed);
            plant.effects = plant.effects.with("L6", &[("coupling", 0.6)]).unwrap();
            fly_observed(&scene, &items, plant, scene.pilot.clone()).unwrap()
        })
        .collect();
    let accepted: Vec<&Trace> = traces.iter().collect();
    let found = commission_for(&constants, &scene, &items, &accepted, &|_, _| ()).unwrap();
    let beyond: Vec<&str> = found.blocks.iter().filter(|n| !n.holds()).map(|n| n.block).collect();
    assert!(beyond.contains(&"inner_loop"), "{:#?}", found.blocks);
    assert!(found.why_not_yet().unwrap().contains("inner_loop"));
}

#[test]
fn prop_too_few_flights_are_refused_in_words() {
    let scene = Scene::lab().unwrap();
    let said = commission_traces(&scene, &missions::plain(&scene), &[], |_, _| ()).unwrap_err();
    assert!(said.to_string().contains("0 accepted flights"), "{said}");
}

#[test]
fn prop_a_bank_whose_flights_are_unlike_accepted_ones_is_not_yet_this_vehicles() {
    let mut rng = Stream::new(4, "not yet");
    let mut flights = |count: usize, off: f64| -> Vec<Vec<f64>> {
        let inner_loop = |spec: &StatSpec| f64::from(u8::from(spec.block == Block::InnerLoop));
        let mut row = || {
            let of =
                |s: &StatSpec| 10.0 * s.resolution.max(1.0) * (rng.normal() + off * inner_loop(s));
            specs().iter().map(of).collect()
        };
        (0..count).map(|_| row()).collect()
    };
    let names = specs().iter().map(|s| s.name.clone()).collect();
    let bank = Bank { names, seeds: flights(24, 0.0), jitter: flights(60, 0.0), effects: vec![] };
    assert_eq!(not_yet(&bank, &flights(LEAST_FLIGHTS, 0.0)), None);
    assert_eq!(not_yet(&bank, &flights(LEAST_FLIGHTS - 1, 3.0)), None, "too few to say");
    let said = not_yet(&bank, &flights(LEAST_FLIGHTS, 3.0)).unwrap();
    assert!(said.contains("inner_loop") && !said.contains("thrust"), "{said}");
}
