//! The hover thrust that is learned in flight, on vehicles that are not as configured.

use rayon::prelude::*;

use super::*;
use crate::effects::EffectSet;

/// What a hover at 1.2 m gave.
struct Hover {
    /// Learned factor at its end.
    factor: f64,
    /// Mean of what was flown with, over the base thrust, in its last 10 s.
    flown: f64,
    /// Mean height error in the last 10 s, of the estimate and of truth, and its largest, m.
    seen_m: f64,
    mean_m: f64,
    most_m: f64,
    /// Highest overshoot of the take-off, m.
    overshoot_m: f64,
    said: Vec<String>,
}

fn hover(seed: u64, edit: impl FnOnce(&mut PlantConfig)) -> (Hover, Lockstep, Ground) {
    let mut plant = PlantConfig::hall(seed);
    edit(&mut plant);
    let pilot = pilot_config(&plant);
    let survey = plant.survey.clone();
    let mut world = Lockstep::new(plant, pilot, &survey).unwrap();
    let mut ground = Ground::new();
    let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 1.2];
    ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
    arm(&mut world, &mut ground);
    let mut overshoot_m = 0.0f64;
    let mut seen_m = 0.0;
    let (mut flown, mut sum_m, mut most_m, mut n) = (0.0, 0.0, 0.0f64, 0.0);
    let start_us = world.t_us();
    while world.t_us() < start_us + 40_000_000 {
        fly_for(&mut world, 0.01);
        ground.listen(&mut world);
        let error_m = -world.truth().pos_E_m.z() - 1.2;
        overshoot_m = overshoot_m.max(error_m);
        if world.t_us() >= start_us + 30_000_000 {
            let control = world.pilot().control_record();
            flown += control.thrust_frac / (control.thrust_base_frac * control.ground_factor);
            seen_m += -world.pilot().estimate().pos_E_m.z() - 1.2;
            sum_m += error_m;
            most_m = most_m.max(error_m.abs());
            n += 1.0;
        }
    }
    assert_eq!(world.pilot().mode(), Mode::Hold, "{:#?}", ground.texts);
    let factor = world.pilot().control_record().hover_factor;
    let said = ground.texts.clone();
    let hover = Hover {
        factor,
        flown: flown / n,
        seen_m: seen_m / n,
        mean_m: sum_m / n,
        most_m,
        overshoot_m,
        said,
    };
    (hover, world, ground)
}

fn heavier(plant: &mut PlantConfig) {
    plant.vehicle.body.mass_kg *= 1.15;
}

fn weaker(plant: &mut PlantConfig) {
    plant.effects = EffectSet::nominal().with("P1", &[("loss", 0.15)]).unwrap();
}

#[test]
fn val_converges_on_a_vehicle_that_is_15_percent_off_and_height_is_held() {
    let nominal = |_: &mut PlantConfig| {};
    let lighter = |plant: &mut PlantConfig| plant.vehicle.body.mass_kg *= 0.85;
    type Edit = fn(&mut PlantConfig);
    let vehicles: [(&str, Edit, std::ops::Range<f64>); 4] = [
        ("nominal", nominal, 0.97..1.03),
        ("15 % heavier", heavier, 1.08..1.20),
        ("15 % less thrust", weaker, 1.08..1.22),
        ("15 % lighter", lighter, 0.80..0.92),
    ];
    for (name, edit, range) in vehicles {
        for seed in [1, 2] {
            let (h, mut world, mut ground) = hover(seed, edit);
            println!(
                "{name}, seed {seed}: factor {:.3}, flown with {:.3}, height error seen {:.3} m, true {:.3} m, \
                 most {:.3} m, overshoot {:.2} m",
                h.factor, h.flown, h.seen_m, h.mean_m, h.most_m, h.overshoot_m
            );
            assert!((h.factor / h.flown - 1.0).abs() < 0.02, "{name}: {} {}", h.factor, h.flown);
            assert!(range.contains(&h.factor), "{name}: {}", h.factor);
            // Multipath over the floor biases the estimate of height itself by some centimetres.
            assert!(h.overshoot_m < 0.5, "{name}: {}", h.overshoot_m);
            assert!(h.seen_m.abs() < 0.02, "{name}: {}", h.seen_m);
            assert!(h.mean_m.abs() < 0.12 && h.most_m < 0.25, "{name} {} {}", h.mean_m, h.most_m);
            ground.command(&mut world, MavCmd::MAV_CMD_NAV_LAND, [0.0; 7]);
            until(&mut world, Mode::Disarmed, 20.0);
            assert_landed(&world, &h.said);
            // Kept for the next flight, frozen on the floor.
            let learned = world.pilot().control_record().hover_factor;
            fly_for(&mut world, 5.0);
            let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 1.2];
            ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
            arm(&mut world, &mut ground);
            until(&mut world, Mode::Takeoff, 5.0);
            let control = world.pilot().control_record();
            assert_eq!(control.hover_factor, learned, "{name}");
            let share = control.thrust_frac / control.thrust_base_frac;
            assert!((share / (0.85 * learned) - 1.0).abs() < 0.02, "{name}: spool to {share}");
            until(&mut world, Mode::Hold, 20.0);
        }
    }
}

#[test]
fn prop_a_blind_descent_sinks_alike_whatever_the_vehicle_weighs() {
    use crate::faults::{Fault, FaultKind};
    for edit in [heavier, weaker] {
        let (h, mut world, mut ground) = hover(3, edit);
        ground.goto(&mut world, [5.0, 5.0, -2.5]);
        for _ in 0..80 {
            fly_for(&mut world, 0.1);
            ground.listen(&mut world);
        }
        world.plant_mut().inject(Fault::Accelerometer(FaultKind::Off)).unwrap();
        world.plant_mut().inject(Fault::Gyroscope(FaultKind::Off)).unwrap();
        until(&mut world, Mode::Descend, 1.0);
        let mut fastest_mps = 0.0f64;
        while world.pilot().mode() != Mode::Disarmed {
            fly_for(&mut world, 0.01);
            fastest_mps = fastest_mps.max(world.truth().vel_E_mps.z());
        }
        println!("factor {:.3}: sank at {fastest_mps:.2} m/s at most", h.factor);
        // 8 % less than hover; 15 % more weight on top would sink at twice that.
        assert!(fastest_mps < 1.5, "{fastest_mps}");
        assert_landed(&world, &h.said);
    }
}

#[test]
fn regress_a_take_off_is_told_to_climb_no_faster_than_its_speed() {
    // Where the floor held the estimate back the setpoint ran away from it, and the vehicle climbed at 1.2 m/s: when
    // the board's link then broke, it came down from 1.9 m after the board's three seconds of descent.
    (0..6u64).into_par_iter().for_each(|seed| {
        let plant = PlantConfig::hall(seed);
        let mut pilot = pilot_config(&plant);
        // The floor holds back who is not told how high he stands.
        pilot.flight.gear_height_m = 0.0;
        let told_mps = pilot.flight.takeoff_speed_mps;
        let survey = plant.survey.clone();
        let mut world = Lockstep::new(plant, pilot, &survey).unwrap();
        let mut ground = Ground::new();
        let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 1.3];
        ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
        arm(&mut world, &mut ground);
        until(&mut world, Mode::Takeoff, 10.0);
        let mut steps = 0;
        while world.pilot().mode() == Mode::Takeoff {
            fly_for(&mut world, 0.01);
            let wanted_mps = -world.pilot().control_record().vel_setpoint_E_mps.z();
            assert!(wanted_mps < 1.3 * told_mps, "{seed}: {wanted_mps} m/s");
            steps += 1;
        }
        assert!(steps > 100 && world.pilot().mode() == Mode::Hold, "{seed}: {:#?}", ground.texts);
    });
}
