//! The fits on recorded data, when it lies beside the checkout.

use std::path::{Path, PathBuf};

use super::{carry_over, drag, thrust};
use crate::fit::outcome::Outcome;
use crate::fit::source::Source;
use crate::fit::value::Value;
use crate::import::{flapper, motion, stand};

fn folder(name: &str) -> Option<PathBuf> {
    let crate_dir = Path::new(env!("CARGO_MANIFEST_DIR"));
    let found = ["../shared/data", "../../shared/data"]
        .iter()
        .map(|up| crate_dir.join(up).join(name))
        .find(|dir| dir.exists());
    if found.is_none() {
        println!("skipped: no data");
    }
    found
}

fn flight(dir: &Path, name: &str) -> Source {
    Source::Recording(flapper::read(&dir.join(format!("fd_model_tuning_{name}.csv.gz"))).unwrap())
}

fn value(outcome: &Outcome, name: &str) -> Value {
    outcome.parameters.iter().find(|p| p.name == name).unwrap_or_else(|| panic!("{name}")).value
}

const FLIGHTS: [&str; 3] = ["level_flight_1", "level_flight_3", "wAlt_1"];

#[test]
fn val_drag_of_every_flight_is_the_published_one() {
    let Some(dir) = folder("flapper_swarm3d") else { return };
    for name in FLIGHTS {
        let outcome = drag::fit(&[flight(&dir, name)], false).unwrap();
        println!("{}", outcome.text());
        let (x, y) = (value(&outcome, "forward drag k"), value(&outcome, "sideways drag k"));
        // README of the recordings: 3.4 to 4.2 forward, 1.9 to 2.1 sideways.
        assert!((3.3..=4.3).contains(&x.value), "{name}: {x:?}");
        assert!((1.8..=2.2).contains(&y.value), "{name}: {y:?}");
        assert!(x.std < 0.4 && y.std < 0.25, "{name}: {x:?} {y:?}");
        assert!(outcome.snippet.is_some());
    }
}

#[test]
fn val_thrust_goes_as_one_over_voltage() {
    let Some(dir) = folder("flapper_swarm3d") else { return };
    let all: Vec<Source> = FLIGHTS.iter().map(|n| flight(&dir, n)).collect();
    let outcome = thrust::fit(&all).unwrap();
    println!("{}", outcome.text());
    let n = value(&outcome, "exponent n");
    assert!((n.value + 1.01).abs() < 0.1 && n.std < 0.08, "{n:?}");
    assert!(outcome.snippet.is_some(), "{:?}", outcome.notes);
}

#[test]
fn val_models_of_one_flight_carry_over_to_unseen_ones() {
    let Some(dir) = folder("flapper_swarm3d") else { return };
    for train in FLIGHTS {
        let tests: Vec<Source> =
            FLIGHTS.iter().filter(|n| **n != train).map(|n| flight(&dir, n)).collect();
        let outcome = carry_over::fit(&flight(&dir, train), &tests).unwrap();
        println!("{}", outcome.text());
    }
    let samples = |name: &str| {
        let path = dir.join(format!("fd_model_tuning_{name}.csv.gz"));
        motion::samples(&flapper::read(&path).unwrap()).0
    };
    let models = carry_over::models(&samples("wAlt_1")).unwrap();
    let unseen = carry_over::judge(&models, "level_flight_3", &samples("level_flight_3"));
    assert!(unseen.vertical_mean_mps2.gone() >= 0.9, "{unseen:?}");
    assert!(unseen.horizontal_rms_mps2.gone() >= 0.5, "{unseen:?}");
}

#[test]
fn val_the_stand_shows_voltage_and_carries_over() {
    let Some(dir) = folder("cf21_thrust_stand") else { return };
    let table = |name: &str| Source::Stand(stand::read(&dir.join(name)).unwrap());
    let [a, b] = ["cf21_stock2.csv", "cf2.1-stock-prop.csv"];
    for (train, test) in [(a, b), (b, a)] {
        println!("{}", thrust::fit(&[table(train)]).unwrap().text());
        println!("{}", carry_over::fit(&table(train), &[table(test)]).unwrap().text());
    }
}
