//! Budgets of flights of the simulator itself, beside a vehicle file in which constants were altered.

use super::*;
use crate::bank::fly::fly_observed;
use crate::bank::missions;
use haltere_model::Vehicle;

/// Constants that are asked for: few, so that the tests are short.
const ASKED: [&str; 6] = [
    "body.mass_kg",
    "wings.thrust_n_per_hz",
    "drag.k_ns_per_m_hz.x",
    "battery.resistance_ohm",
    "inner_loop.delay_ms",
    "uwb.std_m",
];

fn asked() -> Vec<Constant> {
    ASKED.iter().map(|key| *CONSTANTS.iter().find(|c| c.key == *key).unwrap()).collect()
}

/// The budget of a few flights of the usual vehicle beside a file that says otherwise. Twenty seconds of the mission are enough.
fn of_file(alter: impl FnOnce(&mut Vehicle), flights: u64) -> Budget {
    let mut scene = Scene { until_s: Some(20.0), ..Scene::lab().unwrap() };
    let items = missions::plain(&scene);
    let flown: Vec<Trace> = (0..flights)
        .map(|k| fly_observed(&scene, &items, scene.plant(300 + k), scene.pilot.clone()).unwrap())
        .collect();
    alter(&mut scene.vehicle);
    let flown: Vec<&Trace> = flown.iter().collect();
    budget_for(&asked(), &scene, &items, &flown, &|_, _| ()).unwrap()
}

fn keys(budget: &Budget) -> Vec<&str> {
    budget.parts.iter().map(|part| part.key).collect()
}

#[test]
fn prop_a_mass_that_the_file_has_wrong_is_the_whole_budget() {
    let budget = of_file(|v| v.body.mass_kg *= 1.15, 1);
    assert_eq!((keys(&budget), budget.exit_code()), (vec!["body.mass_kg"], 15), "{budget:#?}");
    let part = &budget.parts[0];
    let truth = Vehicle::default().body.mass_kg;
    assert!((part.value / truth - 1.0).abs() < 0.02, "{part:?}");
    assert!(part.share.unwrap() > 0.9 && budget.left.unwrap() < 0.1, "{budget:#?}");
}

#[test]
fn prop_two_constants_are_told_with_their_shares_on_flights_that_were_held_out() {
    let alter = |v: &mut Vehicle| {
        v.drag.k_ns_per_m_hz[0] *= 0.75;
        v.inner_loop.delay_ms += 15.0;
    };
    let budget = of_file(alter, 3);
    let mut keys = keys(&budget);
    keys.sort_unstable();
    assert_eq!(keys, ["drag.k_ns_per_m_hz.x", "inner_loop.delay_ms"], "{budget:#?}");
    assert_eq!((budget.flights, budget.held_out), (2, 1));
    assert!(budget.parts[0].share > budget.parts[1].share, "{budget:#?}");
    let [last, left] = [budget.parts[1].left_after, budget.left].map(Option::unwrap);
    assert!((last - left).abs() < 1e-9, "{budget:#?}");
    assert!(budget.left.unwrap().abs() < 0.15, "{budget:#?}");
}

#[test]
fn prop_a_file_that_is_right_has_no_budget() {
    let budget = of_file(|_| (), 1);
    assert_eq!(
        (budget.outcome, budget.exit_code()),
        (crate::outcome::Ending::NoGap, 0),
        "{budget:#?}"
    );
    assert!(budget.parts.is_empty() && budget.blocks.is_empty(), "{budget:#?}");
}

#[test]
fn val_a_thrust_too_low_to_fly_with_is_found_from_what_carries_the_real_vehicle() {
    let budget = of_file(|v| v.wings.thrust_n_per_hz *= 0.7, 1);
    assert_eq!(
        (keys(&budget), budget.exit_code()),
        (vec!["wings.thrust_n_per_hz"], 15),
        "{budget:#?}"
    );
    let (part, truth) = (&budget.parts[0], Vehicle::default().wings.thrust_n_per_hz);
    assert!((part.value / truth - 1.0).abs() < 0.02, "{part:?}");
    // There is nothing to take shares of.
    assert!(!budget.flies && budget.left.is_none() && part.share.is_none(), "{budget:#?}");
    assert!(budget.words().contains("does not fly"), "{}", budget.words());
}
