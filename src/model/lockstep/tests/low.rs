//! Near the floor, where the height is estimated too high: a vehicle that came to stand there without being asked to is not
//! left standing with motors that run, and one that flies is left alone.

use haltere_dialect::mav::haltere::{
    MANUAL_CONTROL_DATA, MavMessage, PositionTargetTypemask as Mask,
    SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use rayon::prelude::*;

use super::*;

/// Most time on the floor until the motors are off, s: the mean over 1 s, and a landing's feeling for the floor …
const STANDS_S: f64 = 4.0;
/// … and where the height that is asked for is nearly the one that is estimated on the floor: the thrust may then be any that
/// does not lift off, and it is asked, at times while it hops. It was 15 s.
const STANDS_WAVERING_S: f64 = 6.0;

fn setpoint(height_m: f32) -> MavMessage {
    MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
        type_mask: Mask::from_bits_retain(0xDF8),
        x: 5.0,
        y: 5.0,
        z: -height_m,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    })
}

fn set_mode(world: &mut Lockstep, ground: &mut Ground, mode: Mode, message: &MavMessage) {
    ground.send(world, message);
    let n = mode.custom_mode();
    let params = [1.0, (n >> 16 & 0xFF) as f32, 0.0, 0.0, 0.0, 0.0, 0.0];
    let answer = ground.command(world, MavCmd::MAV_CMD_DO_SET_MODE, params);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED), "{:?}", ground.texts);
}

/// Sends a message at 20 Hz. The longest that the vehicle stood armed without a break, s.
fn stood_s(world: &mut Lockstep, ground: &mut Ground, message: &MavMessage, for_s: f64) -> f64 {
    let (mut stood_s, mut longest_s) = (0.0, 0.0_f64);
    for _ in 0..(for_s * 20.0) as u32 {
        ground.send(world, message);
        for _ in 0..25 {
            world.step();
            let truth = world.truth();
            stood_s = if truth.on_ground && truth.armed { stood_s + 0.002 } else { 0.0 };
            longest_s = longest_s.max(stood_s);
        }
        ground.listen(world);
    }
    longest_s
}

/// The fault: asked for 0.05 to 0.4 m, it stood on the floor for as long as it was asked to, with motors on, said that it flew
/// at 0.4 to 0.6 m, and leapt up as soon as more was asked for.
#[test]
fn regress_a_vehicle_that_is_led_onto_the_floor_is_found_and_disarmed() {
    let cases: Vec<_> =
        (1..=12).flat_map(|seed| [0.05, 0.2, 0.3, 0.4].map(|height_m| (seed, height_m))).collect();
    let bad: Vec<String> = cases
        .into_par_iter()
        .filter_map(|(seed, height_m)| {
            let (mut world, mut ground) = hovering(world(seed));
            set_mode(&mut world, &mut ground, Mode::Offboard, &setpoint(1.2));
            let low = setpoint(height_m);
            let longest_s = stood_s(&mut world, &mut ground, &low, 30.0);
            let told = ground.texts.iter().any(|t| t.contains("it stands on the floor"));
            let truth = world.truth();
            let ended = !truth.armed && truth.on_ground && !truth.crashed && told;
            // At 0.4 m some fly on.
            let flies = truth.armed && !told && height_m > 0.35;
            let most_s = if height_m < 0.25 { STANDS_S } else { STANDS_WAVERING_S };
            let fine = longest_s < most_s && (ended || flies);
            println!("seed {seed} at {height_m} m: stood {longest_s:.1} s, told {told}");
            (!fine)
                .then(|| format!("seed {seed}, {height_m} m: {longest_s:.1} s {:#?}", ground.texts))
        })
        .collect();
    assert!(bad.is_empty(), "{} fell short: {}", bad.len(), bad.join("\n"));
}

/// One rule, whatever led it there. (Where the estimate has it more than 0.5 m above the floor, `force_scale` may be sooner.)
#[test]
fn regress_a_point_and_a_joystick_that_lead_onto_the_floor_end_alike() {
    for stick in [false, true] {
        let (mut world, mut ground) = hovering(world(1));
        let z = if stick { 0 } else { 500 };
        let down =
            MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA { target: 1, z, ..Default::default() });
        if stick {
            set_mode(&mut world, &mut ground, Mode::Manual, &down);
        } else {
            let answer = ground.goto(&mut world, [5.0, 5.0, -0.2]);
            assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED), "{:?}", ground.texts);
        }
        let longest_s = stood_s(&mut world, &mut ground, &down, 30.0);
        println!("stick {stick}: stood {longest_s:.1} s");
        assert!(longest_s < STANDS_S, "{longest_s} s, {:#?}", ground.texts);
        let told = ground.texts.iter().any(|t| t.contains("it stands on the floor"));
        assert!(told, "{:#?}", ground.texts);
        assert_landed(&world, &ground.texts);
    }
}

/// Vehicles whose weight is not as configured fly low, and dive from 1.5 m, again and again.
#[test]
fn prop_who_flies_low_is_left_alone() {
    let cases: Vec<_> = [0.75, 1.0, 1.2]
        .into_iter()
        .flat_map(|mass| {
            (1..=6).flat_map(move |seed| [false, true].map(|dives| (mass, seed, dives)))
        })
        .collect();
    let bad: Vec<String> = cases
        .into_par_iter()
        .filter_map(|(mass, seed, dives)| {
            let mut plant = PlantConfig::hall(seed);
            plant.vehicle.body.mass_kg *= mass;
            let survey = plant.survey.clone();
            let pilot = pilot_config(&plant);
            let (mut world, mut ground) = hovering(Lockstep::new(plant, pilot, &survey).unwrap());
            fly_for(&mut world, 10.0);
            set_mode(&mut world, &mut ground, Mode::Offboard, &setpoint(1.2));
            for n in 0..10 {
                let height_m = if dives && n % 2 == 0 { 1.5 } else { 0.55 };
                stood_s(&mut world, &mut ground, &setpoint(height_m), 3.0);
            }
            let flies = world.pilot().mode() == Mode::Offboard;
            (!flies).then(|| format!("mass {mass} seed {seed} dives {dives}: {:#?}", ground.texts))
        })
        .collect();
    assert!(bad.is_empty(), "{} fell short: {}", bad.len(), bad.join("\n"));
}

/// The first hop of a vehicle that is lighter than configured: what hovers is not learned so low.
#[test]
fn prop_a_light_vehicle_hops() {
    let cases: Vec<_> = [0.6, 0.75, 1.0]
        .into_iter()
        .flat_map(|mass| (1..=4).map(move |seed| (mass, seed)))
        .collect();
    let bad: Vec<String> = cases
        .into_par_iter()
        .filter_map(|(mass, seed)| {
            let mut plant = PlantConfig::hall(seed);
            plant.vehicle.body.mass_kg *= mass;
            let survey = plant.survey.clone();
            let pilot = pilot_config(&plant);
            let mut world = Lockstep::new(plant, pilot, &survey).unwrap();
            let mut ground = Ground::new();
            let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 0.5];
            ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
            arm(&mut world, &mut ground);
            until(&mut world, Mode::Hold, 20.0);
            fly_for(&mut world, 15.0);
            ground.listen(&mut world);
            let flies = world.pilot().mode() == Mode::Hold && !world.truth().on_ground;
            (!flies).then(|| format!("mass {mass} seed {seed}: {:#?}", ground.texts))
        })
        .collect();
    assert!(bad.is_empty(), "{} fell short: {}", bad.len(), bad.join("\n"));
}
