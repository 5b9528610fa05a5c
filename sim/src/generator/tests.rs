//! The healthy vehicle flies; every effect flies and shows; nothing is shared with the model.

use haltere::gap::missions;
use haltere::gap::scene::Scene;
use haltere::lockstep::{Flight, Lockstep, Sample, World, fly};
use haltere_dialect::mav::haltere::MISSION_ITEM_INT_DATA;

use super::*;

const MISSIONS: [(&str, fn(&Scene) -> Vec<MISSION_ITEM_INT_DATA>); 3] = [
    ("diagnostic", missions::diagnostic),
    ("held out", missions::held_out),
    ("plain", missions::plain),
];

fn flown<W: World>(scene: &Scene, world: W, mission: usize, limit_s: f64) -> Flight {
    let items = MISSIONS[mission].1(scene);
    let mut lockstep =
        Lockstep::in_world(world, scene.pilot.clone(), &scene.survey, None).without_topics();
    fly(&mut lockstep, &items, limit_s).unwrap()
}

/// Mean errors in the air: estimate of position (m) and velocity (m/s), tracking (m), command times
/// voltage (V).
fn figures(flight: &Flight) -> [f64; 4] {
    let air: Vec<_> = flight.samples.iter().filter(|s| s.truth.height_m > 0.5).collect();
    let n = air.len().max(1) as f64;
    let mean = |f: &dyn Fn(&Sample) -> f64| air.iter().map(|s| f(s)).sum::<f64>() / n;
    [
        mean(&|s| (s.estimate.pos_E_m - s.truth.pos_E_m).norm()),
        mean(&|s| (s.estimate.vel_E_mps() - s.truth.vel_E_mps).norm()),
        mean(&|s| {
            let off = |i: usize| s.control.pos_setpoint_E_m[i].map_or(0.0, |p| s.truth.pos_E_m[i] - p);
            off(0).hypot(off(1)).hypot(off(2))
        }),
        mean(&|s| s.control.thrust_frac * s.truth.supply_v),
    ]
}

#[test]
fn val_a_healthy_vehicle_flies_as_well_as_the_nominal_one() {
    // HALTERE_GENERATOR_SEEDS flies more than CI can afford.
    let seeds = std::env::var("HALTERE_GENERATOR_SEEDS").ok().and_then(|s| s.parse().ok());
    let scene = Scene::lab().unwrap();
    for (mission, (name, _)) in MISSIONS.iter().enumerate() {
        let (mut ours, mut theirs) = (Vec::new(), Vec::new());
        for seed in 0..seeds.unwrap_or(1) {
            let flight = flown(&scene, Foreign::new(Setup::healthy(&scene, seed)), mission, 150.0);
            assert!(flight.landed, "{name} {seed}: {:?}", flight.texts);
            assert!(flight.samples.iter().all(|s| !s.truth.crashed), "{name} {seed}");
            ours.push(figures(&flight));
            let nominal = haltere::model::Plant::new(scene.plant(seed)).unwrap();
            theirs.push(figures(&flown(&scene, nominal, mission, 150.0)));
        }
        let mean = |rows: &[[f64; 4]]| -> [f64; 4] {
            std::array::from_fn(|i| rows.iter().map(|r| r[i]).sum::<f64>() / rows.len() as f64)
        };
        let worst = ours.iter().map(|r| r[0]).fold(0.0, f64::max);
        let (ours, theirs) = (mean(&ours), mean(&theirs));
        println!("{name}: estimate m, m/s, tracking m, command V; generator {ours:.3?}, worst {worst:.3} m, nominal {theirs:.3?}");
        assert!(ours[0] < 2.0 * theirs[0] && ours[2] < 2.0 * theirs[2]);
        assert!((ours[3] / theirs[3] - 1.0).abs() < 0.04, "{} {}", ours[3], theirs[3]);
    }
}

/// Only the record of the truth may come from the model.
#[test]
fn prop_the_generator_shares_no_physics_with_the_model() {
    let root = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("src/generator");
    let mut files = 0;
    let mut folders = vec![root];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            // Tests compare with the nominal plant, and this sentence names what it forbids.
            if path.file_name().is_some_and(|name| name == "tests.rs") {
                continue;
            }
            files += 1;
            for line in std::fs::read_to_string(&path).unwrap().lines() {
                let code = line.split("//").next().unwrap_or("");
                let names = code.contains("model::") || code.contains("::model");
                let allowed = code.trim() == "use haltere::model::Truth;";
                assert!(!names || allowed, "{}: {line}", path.display());
                assert!(!code.contains("lockstep::Lockstep"), "{}: {line}", path.display());
            }
        }
    }
    assert!(files > 10, "{files} files read");
}
