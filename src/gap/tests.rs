//! The smoother against truth, and the statistics against effects.

use rayon::prelude::*;

use crate::bank::fly::fly_observed;
use crate::bank::jitter::jittered;
use crate::bank::missions;
use crate::flight::residuals::Flight;
use crate::flight::statistics::{observe, specs};
use crate::flight::timeline::NotObservable;
use crate::flight::trace::Trace;
use crate::nominal::Nominal;
use crate::scene::Scene;
use haltere_core::measure::ServoOutput;
use haltere_model::EffectSet;
use haltere_model::effects::Block;
use haltere_model::lockstep::{Lockstep, fly_watched};

#[test]
fn val_smoother_finds_position_and_velocity_without_aerodynamics() {
    let scene = Scene::lab().unwrap();
    let items = missions::diagnostic(&scene);
    let mut world = Lockstep::new(scene.plant(3), scene.pilot.clone(), &scene.survey).unwrap();
    let mut trace = Trace::new(scene.survey.clone());
    let mut truths = Vec::new();
    let flown = fly_watched(&mut world, &items, 150.0, |world| {
        truths.push((world.host_now(), world.truth()));
        world.pilot_mut().drain_topics(|topic| trace.take(topic));
    })
    .unwrap();
    let nominal = Nominal::of_scene(&scene);
    // Weather and doors move the air pressure by half a metre in a minute. Whether the floor is near was asked of it alone, so that a
    // vehicle at 1 m was smoothed to 0.7 m: one healthy flight in twenty of another simulator was a gap of its UWB.
    let mut still_m = f64::INFINITY;
    for wander_paps in [0.0, 0.12] {
        for baro in &mut trace.baros {
            baro.pressure_pa += wander_paps * baro.valid_at.seconds_since(truths[0].0);
        }
        let f = Flight::new(&trace, &nominal).unwrap();
        let (mut pos2, mut vel2, mut n) = (0.0, 0.0, 0.0);
        for (at, truth) in &truths {
            let Some((k, share)) = f.line.place(*at).filter(|(k, _)| f.clear[*k]) else { continue };
            let (a, b) = (&f.states[k], &f.states[k + 1]);
            let p = a.pos_E_m + (b.pos_E_m - a.pos_E_m) * share;
            let v = a.vel_E_mps + (b.vel_E_mps - a.vel_E_mps) * share;
            pos2 += (p - truth.pos_E_m.raw()).norm_squared();
            vel2 += (v - truth.vel_E_mps.raw()).norm_squared();
            n += 1.0;
        }
        let (pos_m, vel_mps) = (f64::sqrt(pos2 / n), f64::sqrt(vel2 / n));
        assert!(n > 5000.0, "{:?}", flown.texts);
        assert!(pos_m < 0.15 && pos_m < still_m + 0.01, "{pos_m} m by {wander_paps} Pa/s");
        assert!(vel_mps < 0.12, "{vel_mps} m/s by {wander_paps} Pa/s");
        still_m = pos_m;
    }
}

#[test]
fn prop_a_trace_without_records_is_not_observable() {
    let scene = Scene::lab().unwrap();
    let nominal = Nominal::of_scene(&scene);
    let said = observe(&Trace::new(scene.survey.clone()), &nominal).unwrap_err();
    assert!(matches!(said, NotObservable::Missing { what: "IMU samples", .. }), "{said}");
}

/// Which block's statistics must be moved most by an effect, at the default of the list.
const EXPECTED: [(&str, &[Block]); 13] = [
    // Drag damps rotation too (effect N2 shares its coefficients): the yaw loop shows it first.
    ("A1", &[Block::Aerodynamics, Block::InnerLoop]),
    ("A5", &[Block::Aerodynamics]),
    // The yaw loop turns the thrust: more flapping for the same weight makes it faster.
    ("P1", &[Block::Thrust, Block::InnerLoop]),
    ("P2", &[Block::Battery]),
    ("L1", &[Block::InnerLoop]),
    ("L3", &[Block::Actuators]),
    ("M1", &[Block::Imu]),
    ("U2", &[Block::Uwb]),
    ("U5", &[Block::Uwb]),
    ("U7", &[Block::Uwb]),
    // Late positions make late velocities, and those a force along the way: the loudest single number
    // does not tell this one's block, the attribution over all of them has to.
    ("T1", &[Block::Timing, Block::Uwb, Block::Aerodynamics]),
    ("T2", &[Block::InnerLoop, Block::Link, Block::Timing]),
    ("H1", &[Block::InnerLoop]),
];

/// Flights of each effect.
const SEEN: u64 = 4;

#[test]
fn val_each_effect_moves_its_statistics() {
    let scene = Scene::lab().unwrap();
    let items = missions::diagnostic(&scene);
    let nominal = Nominal::of_scene(&scene);
    let fly = |seed: u64, effects: EffectSet| {
        let mut plant = scene.plant(seed);
        plant.effects = effects;
        let trace = fly_observed(&scene, &items, plant, scene.pilot.clone()).unwrap();
        observe(&trace, &nominal).unwrap()
    };
    let nulls: Vec<Vec<f64>> =
        (0..20u64).into_par_iter().map(|s| fly(s, EffectSet::nominal()).statistics).collect();
    let n = nulls.len() as f64;
    let scale: Vec<[f64; 2]> = (0..specs().len())
        .map(|i| {
            let mean = nulls.iter().map(|x| x[i]).sum::<f64>() / n;
            let var = nulls.iter().map(|x| (x[i] - mean).powi(2)).sum::<f64>() / (n - 1.0);
            // As a diagnosis measures: one half second with outliers where healthy flights have none is no difference.
            let sigma = var.sqrt().hypot(specs()[i].resolution);
            [mean, sigma.max(1e-6 * mean.abs()).max(1e-9)]
        })
        .collect();
    EXPECTED.par_iter().for_each(|(id, blocks)| {
        // The zone of the list is made for a hall of 10 m; this room has 6.
        let values: &[(&str, f64)] =
            if *id == "U5" { &[("north", 4.5), ("east", 4.5)] } else { &[] };
        let seen: Vec<Vec<f64>> = (1000..1000 + SEEN)
            .map(|seed| fly(seed, EffectSet::nominal().with(id, values).unwrap()).statistics)
            .collect();
        // Of their mean, in standard errors: one flight alone shows a weak effect by luck, or not.
        let z: Vec<f64> = scale
            .iter()
            .enumerate()
            .map(|(i, [mean, sigma])| {
                let off = seen.iter().map(|x| (x[i] - mean) / sigma).sum::<f64>();
                off.abs() / (SEEN as f64).sqrt()
            })
            .collect();
        let (worst, z_worst) = z
            .iter()
            .copied()
            .enumerate()
            // Our own software works on the sum of all that lies upstream: its errors and trims tell
            // that something is wrong, not where.
            .filter(|(i, z)| z.is_finite() && !specs()[*i].block.is_consequence())
            .max_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap();
        let spec = &specs()[worst];
        println!("{id}: {} by {z_worst:.1}", spec.name);
        // Wherever it is loudest, its own block must show it.
        let own =
            z.iter().enumerate().filter(|(i, z)| specs()[*i].block == blocks[0] && z.is_finite());
        let own_z = own.map(|(_, z)| *z).fold(0.0, f64::max);
        assert!(own_z > 6.0, "{id}: {own_z} in {:?}", blocks[0]);
        assert!(z_worst > 6.0, "{id}: {} by {z_worst}", spec.name);
        assert!(
            blocks.contains(&spec.block),
            "{id}: {} of {:?} by {z_worst}",
            spec.name,
            spec.block
        );
    });
}

/// What holds the vehicle level is told to the servos, whatever the board leaves of it in the attitude; a tilted accelerometer
/// is not. Travel, unit and sign of an output say nothing, and outputs in another order are not read.
#[test]
fn prop_servos_tell_a_trim_from_a_tilted_accelerometer_whatever_their_sign() {
    let scene = Scene::lab().unwrap();
    let items = missions::diagnostic(&scene);
    let nominal = Nominal::of_scene(&scene);
    let place = |name: &str| specs().iter().position(|s| s.name == name).unwrap();
    let fly = |effect: Option<(&str, &[(&str, f64)])>| {
        let mut plant = scene.plant(5);
        if let Some((id, values)) = effect {
            plant.effects = EffectSet::nominal().with(id, values).unwrap();
        }
        fly_observed(&scene, &items, plant, scene.pilot.clone()).unwrap()
    };
    let seen =
        |trace: &Trace, name: &str| observe(trace, &nominal).unwrap().statistics[place(name)];
    let healthy = fly(None);
    let trimmed = fly(Some(("L3", &[("dihedral", 3.0), ("kept", 0.1)])));
    let tilted = fly(Some(("M4", &[])));
    let moved = |trace: &Trace, name: &str| (seen(trace, name) - seen(&healthy, name)).abs();
    for half in ["servo.pitch.early", "servo.pitch.late"] {
        let [trim, tilt] = [&trimmed, &tilted].map(|trace| moved(trace, half));
        assert!(trim > 0.4 && tilt < 0.1, "{half}: {trim} {tilt}");
    }
    // The board holds it against the trim: a third of a degree is what is left of some 1.5.
    assert!(moved(&trimmed, "att.pitch.const") < 0.006);
    assert!(moved(&trimmed, "servo.thrust.delay") < 0.005);

    let told = |order: [usize; 4], scale: [f32; 4]| {
        let mut other = trimmed.clone();
        for servos in &mut other.servos {
            let us = servos.outputs().to_vec();
            let us = order.iter().zip(scale).map(|(n, s)| 1500.0 + s * (us[*n] - 1500.0));
            *servos = ServoOutput::new(servos.received_at, servos.port, us.collect::<Vec<_>>());
        }
        seen(&other, "servo.pitch.early")
    };
    let as_it_is = seen(&trimmed, "servo.pitch.early");
    let reversed = told([0, 1, 2, 3], [-0.5, 1.0, -1.0, 1.0]);
    assert!((reversed - as_it_is).abs() < 0.02 * as_it_is.abs(), "{reversed} {as_it_is}");
    assert!(told([1, 0, 3, 2], [1.0; 4]).is_nan(), "motors where servos should be");
    assert!(told([1, 0, 2, 3], [1.0; 4]).is_nan(), "the Flapper's board of 2021");
}

#[test]
fn val_no_standard_flight_sets_a_healthy_vehicle_on_the_floor() {
    let scene = Scene::lab().unwrap();
    for (name, items) in [
        ("diagnostic", missions::diagnostic(&scene)),
        ("held-out", missions::wire(&missions::held_out_file(&scene))),
    ] {
        let carried: Vec<f64> = (1..=40_u64)
            .into_par_iter()
            .map(|seed| {
                let plant = jittered(scene.plant(seed)).unwrap();
                let trace = fly_observed(&scene, &items, plant, scene.pilot.clone()).unwrap();
                trace.carried_s.unwrap()
            })
            .filter(|carried_s| *carried_s > 0.0)
            .collect();
        println!("{name}: carried {} of 40, {carried:?} s", carried.len());
        // At 0.45 and 0.35 m 16 and more: see `missions.rs`.
        assert!(carried.len() <= 1, "{name}: {carried:?}");
    }
}

#[test]
fn val_a_bank_serves_flights_that_start_beside_it() {
    // Healthy flights of the same seeds from the first place of the mission and from beside it. The start must move the mean
    // of the statistics by little of what benign jitter does, and a flight must lie no farther from the others.
    let scene = Scene::lab().unwrap();
    let items = missions::diagnostic(&scene);
    let nominal = Nominal::of_scene(&scene);
    let fly = |seed: u64, off_m: [f64; 2]| {
        let mut plant = jittered(scene.plant(seed)).unwrap();
        plant.start_E_m += haltere_core::frames::Vec3::new(off_m[0], off_m[1], 0.0);
        let trace = fly_observed(&scene, &items, plant, scene.pilot.clone()).unwrap();
        crate::flight::statistics::statistics_of(&trace, &nominal).unwrap()
    };
    let flights = |off_m: [f64; 2]| -> Vec<Vec<f64>> {
        (1..=24_u64).into_par_iter().map(|seed| fly(seed, off_m)).collect()
    };
    let there = flights([0.0; 2]);
    let middle = crate::shrink::medians(&there);
    // What a diagnosis measures by: as resolved and, below, as compressed as the whitening has it.
    let resolved = crate::shrink::scales(&there).into_iter().zip(specs());
    let sigma: Vec<f64> = resolved.map(|(s, spec)| s.hypot(spec.resolution)).collect();
    // Root mean square of a flight's statistics in sigma.
    let far = |row: &Vec<f64>| {
        let z = row.iter().zip(middle.iter().zip(&sigma)).map(|(v, (m, s))| (v - m) / s);
        let z: Vec<f64> = z.filter(|z| z.is_finite()).map(|z| z.clamp(-8.0, 8.0)).collect();
        (z.iter().map(|z| z * z).sum::<f64>() / z.len() as f64).sqrt()
    };
    let sorted = |rows: &[Vec<f64>]| {
        let mut all: Vec<f64> = rows.iter().map(far).collect();
        all.sort_by(f64::total_cmp);
        all
    };
    let usual = sorted(&there);
    let side = 0.5_f64.sqrt() * crate::scene::SERVED_M;
    let far_m = crate::scene::SERVED_M;
    let starts = [[0.2, 0.0], [-far_m, 0.0], [side, -side], [-side, -side]];
    let told: Vec<(f64, f64)> = starts
        .into_iter()
        .map(|off_m| {
            let beside = flights(off_m);
            // Square of the shift of each mean, less what the scatter of so many pairs makes of none.
            let shifts: Vec<f64> = (0..sigma.len())
                .filter(|k| sigma[*k] > 0.0)
                .filter_map(|k| {
                    let by = there.iter().zip(&beside).map(|(a, b)| (b[k] - a[k]) / sigma[k]);
                    let known: Vec<f64> = by.filter(|v| v.is_finite()).collect();
                    let n = known.len() as f64;
                    let mean = known.iter().sum::<f64>() / n;
                    let var = known.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
                    (known.len() > 12).then_some(mean * mean - var / n)
                })
                .collect();
            let rms = (shifts.iter().sum::<f64>() / shifts.len() as f64).max(0.0).sqrt();
            let distance = sorted(&beside)[12];
            println!("{off_m:?}: means moved by {rms:.3} sigma, flights {distance:.2} sigma off");
            (rms, distance)
        })
        .collect();
    println!("from the place itself: {:.2} in the middle, 90 % below {:.2}", usual[12], usual[21]);
    for (rms, distance) in told {
        // A quarter of a sigma in quadrature widens the healthy spread by 3 %.
        assert!(rms < 0.25 && distance <= usual[21], "{rms} {distance} {usual:?}");
    }
}
