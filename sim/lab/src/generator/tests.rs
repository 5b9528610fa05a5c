//! The healthy vehicle flies; every effect flies and shows; nothing is shared with the model.

use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd};
use haltere_gap::bank::missions;
use haltere_gap::scene::Scene;
use haltere_model::lockstep::{Flight, Lockstep, Sample, World, fly};
use rayon::prelude::*;

use super::effects::{known, unknown};
use super::*;

type Plan = fn(&Scene) -> Vec<MISSION_ITEM_INT_DATA>;
const MISSIONS: [(&str, Plan); 3] = [
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
            let off =
                |i: usize| s.control.pos_setpoint_E_m[i].map_or(0.0, |p| s.truth.pos_E_m[i] - p);
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
            let nominal = haltere_model::Plant::new(scene.plant(seed)).unwrap();
            theirs.push(figures(&flown(&scene, nominal, mission, 150.0)));
        }
        let mean = |rows: &[[f64; 4]]| -> [f64; 4] {
            std::array::from_fn(|i| rows.iter().map(|r| r[i]).sum::<f64>() / rows.len() as f64)
        };
        let worst = ours.iter().map(|r| r[0]).fold(0.0, f64::max);
        let (ours, theirs) = (mean(&ours), mean(&theirs));
        println!(
            "{name}: estimate m, m/s, tracking m, command V; generator {ours:.3?}, worst {worst:.3} m, nominal {theirs:.3?}"
        );
        assert!(ours[0] < 2.0 * theirs[0] && ours[2] < 2.0 * theirs[2]);
        assert!((ours[3] / theirs[3] - 1.0).abs() < 0.04, "{} {}", ours[3], theirs[3]);
    }
}

/// A short flight that visits what effects need: turn, dash, ceiling, wall, floor.
fn tour(scene: &Scene) -> Vec<MISSION_ITEM_INT_DATA> {
    let items = missions::diagnostic(scene);
    let mut tour: Vec<_> = items.iter().take(2).cloned().collect();
    let point = |n: f64, e: f64, height_m: f32, hold_s: f32| MISSION_ITEM_INT_DATA {
        param1: hold_s,
        x: ((scene.start_NE_m[0] + n) * 1e4) as i32,
        y: ((scene.start_NE_m[1] + e) * 1e4) as i32,
        z: -height_m,
        ..items[2].clone()
    };
    tour.push(point(0.0, 0.0, 1.0, 1.0));
    tour.push(point(0.0, 0.0, 0.6, 1.5));
    tour.push(point(1.9, 0.0, 1.0, 0.3));
    tour.push(point(-1.5, -1.9, 2.4, 0.3));
    tour.extend(
        items.iter().filter(|i| i.command == MavCmd::MAV_CMD_CONDITION_YAW as u16).take(1).cloned(),
    );
    tour.push(point(0.0, 1.9, 1.2, 0.3));
    tour.push(items[items.len() - 1].clone());
    tour
}

#[test]
fn prop_every_effect_flies_and_shows() {
    // HALTERE_GENERATOR_FULL flies the diagnostic mission at every severity.
    let full = std::env::var_os("HALTERE_GENERATOR_FULL").is_some();
    let scene = Scene::lab().unwrap();
    let items = if full { missions::diagnostic(&scene) } else { tour(&scene) };
    let hall = hall(&scene);
    let fly = |deviations: Deviations| {
        let setup = Setup { deviations, ..Setup::healthy(&scene, 5) };
        let world = Foreign::new(setup);
        let mut lockstep =
            Lockstep::in_world(world, scene.pilot.clone(), &scene.survey, None).without_topics();
        fly(&mut lockstep, &items, if full { 200.0 } else { 60.0 })
    };
    let healthy = fly(Deviations::default()).unwrap();
    let jobs: Vec<_> = known()
        .chain(unknown())
        .enumerate()
        .flat_map(|(i, spec)| {
            // One size each keeps the test short; over the list ends and middle of the range come.
            let [mild, strong] = spec.range;
            [mild, (mild * strong).sqrt(), strong]
                .into_iter()
                .enumerate()
                .filter(move |(k, _)| full || (i + 1) % 3 == *k)
                .map(move |(_, size)| (spec, size))
        })
        .collect();
    let lines: Vec<String> = jobs
        .par_iter()
        .map(|(spec, size)| {
            let mut deviations = Deviations::default();
            let set = spec.apply(*size, &mut Noise::new(3, spec.id), &hall, &mut deviations);
            let flight = match fly(deviations) {
                Ok(flight) => flight,
                Err(error) => return format!("{} {size:.3}: NOT FLOWN {error}", spec.id),
            };
            let finite = flight.samples.iter().all(|s| {
                s.truth.pos_E_m.is_finite() && s.estimate.pos_E_m.is_finite() && s.truth.supply_v.is_finite()
            });
            assert!(finite, "{}", spec.id);
            // Largest difference from the healthy flight: truth, estimate error, command times
            // voltage, supply.
            let apart = flight.samples.iter().zip(&healthy.samples).map(|(a, b)| {
                let error = |s: &Sample| s.estimate.pos_E_m - s.truth.pos_E_m;
                [
                    (a.truth.pos_E_m - b.truth.pos_E_m).norm(),
                    (error(a) - error(b)).norm(),
                    (a.control.thrust_frac - b.control.thrust_frac).abs(),
                    (a.truth.supply_v - b.truth.supply_v).abs(),
                ]
            });
            let apart = apart.fold([0.0f64; 4], |m, x| std::array::from_fn(|i| m[i].max(x[i])));
            // What an instrument or the UWB gets wrong has to be in the estimate, what the vehicle does in the flight.
            let measured = spec.id.starts_with(['M', 'U']);
            let moves = apart[usize::from(measured)] > 0.005 && apart[2] > 0.002;
            // A smaller pack shows in the voltage long before it shows in the flight.
            let shows = moves || apart[3] > 0.02;
            let crashed = flight.samples.iter().any(|s| s.truth.crashed);
            let ok = flight.landed && !crashed;
            let [_, _, _, hover] = figures(&flight);
            let last = if ok { &[][..] } else { &flight.texts[flight.texts.len().saturating_sub(4)..] };
            format!(
                "{} {size:.3} {}: {}{:.0} s, est {:.3} m, hover {hover:.2} V, apart {apart:.3?} {:?} {last:?}",
                spec.id,
                spec.unit,
                match (ok, shows) {
                    (false, _) => "NOT LANDED ",
                    (true, false) => "NOT SEEN ",
                    (true, true) => "",
                },
                flight.samples.len() as f64 * 0.01,
                figures(&flight)[0],
                set.parameters,
            )
        })
        .collect();
    let bad: Vec<_> = lines.iter().filter(|l| l.contains("NOT ")).collect();
    for line in &lines {
        println!("{line}");
    }
    assert!(bad.is_empty(), "{bad:#?}");
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
                // The clock of a world is glue, no law.
                let allowed = ["use haltere_model::Truth;", "use haltere_model::lockstep::World;"]
                    .contains(&code.trim());
                assert!(!names || allowed, "{}: {line}", path.display());
                assert!(!code.contains("lockstep::Lockstep"), "{}: {line}", path.display());
            }
        }
    }
    assert!(files > 10, "{files} files read");
}
