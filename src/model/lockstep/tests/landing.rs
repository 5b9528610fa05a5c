//! Normal flights: the square, how well it is known where the vehicle is, and the touch-down.

use rayon::prelude::*;

use super::*;
use crate::lockstep::{Flight, Sample, fly};

const SEEDS: u64 = 50;
/// A touch-down must be noticed within this time, s.
const NOTICED_S: f64 = 2.0;
/// Disarming counts as "on the floor" below this height, m.
const FLOOR_M: f64 = 0.05;

fn square_of(seed: u64) -> (Lockstep, Flight) {
    let mut world = world(seed);
    let flight = fly(&mut world, &square(), 90.0).unwrap_or_else(|e| panic!("seed {seed}: {e}"));
    (world, flight)
}

/// Mean absolute error of the estimate while flying, horizontally along each axis, m.
fn estimate_mae_m(samples: &[Sample]) -> [f64; 2] {
    let flying: Vec<_> = samples.iter().filter(|s| s.mode.is_flying()).collect();
    std::array::from_fn(|axis| {
        let error = |s: &&Sample| (s.estimate.pos_E_m[axis] - s.truth.pos_E_m[axis]).abs();
        flying.iter().map(error).sum::<f64>() / flying.len() as f64
    })
}

/// Time from the first touch of the floor after the flight to the order to disarm, s, and the
/// height at that order, m.
fn touch_down(samples: &[Sample]) -> (f64, f64) {
    let airborne = samples.iter().position(|s| s.truth.height_m > 0.5).unwrap();
    let ordered = airborne + samples[airborne..].iter().position(|s| !s.mode.has_thrust()).unwrap();
    let touched = airborne + samples[airborne..].iter().position(|s| s.truth.on_ground).unwrap();
    let waited_s = (samples[ordered].t_us as f64 - samples[touched].t_us as f64) * 1e-6;
    (waited_s, samples[ordered].truth.height_m)
}

#[test]
fn val_squares_are_flown_and_landed() {
    let flights: Vec<_> = (100..100 + SEEDS).into_par_iter().map(square_of).collect();
    let mut waits: Vec<f64> = Vec::new();
    let mut worst = [0.0_f64; 2];
    let mut mean = [0.0; 2];
    for (seed, (world, flight)) in (100..).zip(&flights) {
        assert!(flight.landed, "seed {seed}: {:?}", flight.texts);
        assert_landed(world, &flight.texts);
        let (waited_s, height_m) = touch_down(&flight.samples);
        assert!(height_m < FLOOR_M, "seed {seed}: disarmed at {height_m} m");
        assert!((0.0..=NOTICED_S).contains(&waited_s), "seed {seed}: noticed after {waited_s} s");
        waits.push(waited_s);
        for (axis, mae_m) in estimate_mae_m(&flight.samples).into_iter().enumerate() {
            mean[axis] += mae_m / SEEDS as f64;
            worst[axis] = worst[axis].max(mae_m);
        }
        let degraded = flight.texts.iter().filter(|t| t.contains("degraded")).count();
        assert!(degraded <= 3, "seed {seed}: {:?}", flight.texts);
    }
    waits.sort_by(f64::total_cmp);
    println!(
        "touch-down noticed after {:.2} s (median), {:.2} to {:.2} s; estimate MAE {mean:.3?} m, \
         worst {worst:.3?} m",
        waits[waits.len() / 2],
        waits[0],
        waits[waits.len() - 1]
    );
    // The source's figure is 8 to 10 cm on such paths.
    assert!(mean.iter().all(|m| *m < 0.10), "{mean:?}");
}

#[test]
fn prop_a_mission_that_turns_the_vehicle_stays_on_its_path() {
    let mut items = square();
    items.insert(3, item(MavCmd::MAV_CMD_CONDITION_YAW, [0.0; 3], 90.0));
    items.insert(5, item(MavCmd::MAV_CMD_CONDITION_YAW, [0.0; 3], -120.0));
    let mut world = world(5);
    let flight = fly(&mut world, &items, 90.0).unwrap();
    assert!(flight.landed, "{:?}", flight.texts);
    for s in flight.samples.iter().filter(|s| s.mode == Mode::Mission) {
        let pos = s.truth.pos_E_m;
        let inside = (4.3..=6.7).contains(&pos.x()) && (4.3..=6.7).contains(&pos.y());
        assert!(inside && s.truth.height_m > 0.6, "{:.2} s: {pos:?}", s.t_us as f64 * 1e-6);
    }
}

#[test]
fn prop_a_tag_that_computes_tdoa_is_flown_on_too() {
    let mut plant = PlantConfig::hall(17);
    plant.protocol = crate::tag::TagProtocol::Mavlink;
    let mut config = pilot_config(&plant);
    config.tag_protocol = haltere_pilot::TagProtocol::Mavlink;
    let survey = plant.survey.clone();
    let mut world = Lockstep::new(plant, config, &survey).unwrap();
    let flight = fly(&mut world, &square(), 90.0).unwrap();
    assert!(flight.landed, "{:?}", flight.texts);
    assert_landed(&world, &flight.texts);
}
