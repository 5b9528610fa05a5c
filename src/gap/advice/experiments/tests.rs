//! The catalogue: names of the list, flights to their end, inside any room.

use super::*;
use crate::bank::missions::wire;
use haltere_model::effects::ALL;
use haltere_model::lockstep::{Lockstep, fly};
use haltere_pilot::mission_file::MissionFile;
use rayon::prelude::*;

#[test]
fn prop_the_catalogue_names_effects_and_parameters_of_the_list() {
    let mut ids: Vec<_> = EXPERIMENTS.iter().map(|e| e.id).collect();
    ids.sort_unstable();
    ids.dedup();
    assert_eq!(ids.len(), EXPERIMENTS.len());
    let spec = |id: &str| ALL.iter().find(|s| s.id == id);
    for e in EXPERIMENTS {
        for id in e.separates.iter().flat_map(|s| s.iter()) {
            assert!(spec(id).is_some(), "{}: {id}", e.id);
        }
        if let Means::Bench(readings) = e.means {
            for (id, name, _) in readings.iter().flat_map(|r| r.of) {
                let spec = spec(id).unwrap_or_else(|| panic!("{}: {id}", e.id));
                assert!(spec.parameters.iter().any(|p| p.name == *name), "{id}.{name}");
            }
            assert!(readings.iter().all(|r| r.resolution > 0.0));
        }
    }
}

#[test]
fn val_every_flight_is_flown_to_its_end_inside_the_room_at_the_stated_cost() {
    let scene = Scene::lab().unwrap();
    EXPERIMENTS.par_iter().for_each(|e| {
        let Means::Flight(mission) = e.means else { return };
        let mission = mission(&scene).unwrap();
        // As a file, the way a user flies it.
        let text = toml::to_string(&mission).unwrap();
        assert_eq!(MissionFile::parse(&text).unwrap(), mission, "{}", e.id);
        let mut world = Lockstep::new(scene.plant(1), scene.pilot.clone(), &scene.survey)
            .unwrap()
            .without_topics();
        let flight = fly(&mut world, &wire(&mission), 200.0).unwrap();
        let flown_s = flight.samples.len() as f64 * 0.01;
        println!("{}: {flown_s:.0} s, listed {:.0} s", e.id, e.cost_s);
        assert!(flight.landed, "{}: {:?}", e.id, flight.texts);
        assert!(flight.samples.iter().all(|s| !s.truth.crashed), "{}", e.id);
        assert!((flown_s - e.cost_s).abs() < 0.2 * e.cost_s, "{}: {flown_s} s", e.id);
        for s in &flight.samples {
            let p = s.truth.pos_E_m;
            let inside = (0.1..=5.9).contains(&p.x()) && (0.1..=5.9).contains(&p.y());
            assert!(inside && -p.z() < 2.95, "{}: {p:?}", e.id);
        }
    });
}

#[test]
fn prop_missions_stay_in_any_room_or_say_why_not() {
    for (side_m, ceiling_m) in [(2.0, 2.2), (3.0, 1.6), (4.0, 2.5), (12.0, 8.0)] {
        for share in [0.5, 0.1] {
            let mut scene = Scene::lab().unwrap();
            scene.room.north_m = [0.0, side_m];
            scene.room.east_m = [-1.0, side_m - 1.0];
            scene.room.ceiling_m = ceiling_m;
            scene.start_NE_m = [share * side_m, share * side_m - 1.0];
            for e in EXPERIMENTS {
                let Means::Flight(mission) = e.means else { continue };
                let Ok(mission) = mission(&scene) else { continue };
                for item in mission.items.iter().filter_map(|i| i.position_m) {
                    let [n, east, h] = item;
                    assert!((0.4..=side_m - 0.4).contains(&n), "{} {n}", e.id);
                    assert!((-0.6..=side_m - 1.4).contains(&east), "{} {east}", e.id);
                    assert!(h <= ceiling_m - 0.35, "{}: {h} under {ceiling_m}", e.id);
                }
            }
        }
    }
}

/// A set of mass and thrust was told to replace the wings before anybody had weighed the vehicle.
#[test]
fn regress_the_cheapest_test_that_tells_a_set_apart_comes_first() {
    let first = |ids: &[&str]| {
        let ids: Vec<String> = ids.iter().map(|id| (*id).to_owned()).collect();
        telling_apart(&ids).first().map(|e| e.id)
    };
    assert_eq!(first(&["P1", "I1"]), Some("scale"));
    assert_eq!(first(&["M3", "M6"]), Some("rest-log"));
    assert_eq!(first(&["P1"]), None, "one effect is told apart from nothing");
    assert_eq!(first(&["P1", "U1"]), None);
}
