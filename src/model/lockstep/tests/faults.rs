//! Things that break in flight.

use rayon::prelude::*;

use super::*;
use crate::faults::{Fault, FaultKind};
use crate::lockstep::fly;
use haltere_pilot::{Input, LinkId};

/// Flies until it is disarmed; what it took, s.
fn until_disarmed(world: &mut Lockstep, limit_s: f64) -> f64 {
    until(world, Mode::Disarmed, limit_s)
}

fn texts(world: &mut Lockstep, ground: &mut Ground) -> Vec<String> {
    ground.listen(world);
    ground.texts.clone()
}

fn check_landed(world: &mut Lockstep, ground: &mut Ground) {
    let said = texts(world, ground);
    assert_landed(world, &said);
}

#[test]
fn prop_without_uwb_it_lands_in_the_room() {
    (0..8u64).into_par_iter().for_each(|seed| {
        let (mut world, mut ground) = hovering(world(seed));
        ground.goto(&mut world, [6.5, 5.0, -1.2]);
        fly_for(&mut world, 2.0); // at speed, the worse moment
        world.plant_mut().inject(Fault::TagSilent(true)).unwrap();
        // What waits for too long is forgotten.
        fly_for(&mut world, 2.5);
        ground.listen(&mut world);
        let took_s = 2.5 + until_disarmed(&mut world, 12.5);
        let said = texts(&mut world, &mut ground);
        println!(
            "seed {seed}: disarmed {took_s:.1} s after UWB stopped, {:?}",
            world.truth().pos_E_m
        );
        assert_landed(&world, &said);
        assert!(said.iter().any(|t| t.contains("no UWB")), "{said:?}");
    });
}

#[test]
fn prop_uwb_that_comes_back_is_flown_on() {
    let (mut world, mut ground) = hovering(world(3));
    world.plant_mut().inject(Fault::TagSilent(true)).unwrap();
    fly_for(&mut world, 0.8);
    world.plant_mut().inject(Fault::TagSilent(false)).unwrap();
    fly_for(&mut world, 3.0);
    assert_eq!(world.pilot().mode(), Mode::Hold, "{:?}", texts(&mut world, &mut ground));
}

#[test]
fn prop_without_imu_it_descends() {
    (0..8u64).into_par_iter().for_each(|seed| {
        let (mut world, mut ground) = hovering(world(seed));
        world.plant_mut().inject(Fault::Accelerometer(FaultKind::Off)).unwrap();
        world.plant_mut().inject(Fault::Gyroscope(FaultKind::Off)).unwrap();
        let noticed_s = until(&mut world, Mode::Descend, 1.0);
        let took_s = until_disarmed(&mut world, 15.0);
        println!("seed {seed}: descent after {noticed_s:.2} s, disarmed {took_s:.1} s later");
        check_landed(&mut world, &mut ground);
    });
}

#[test]
fn regress_imu_that_comes_back_ends_the_blind_descent() {
    let (mut world, mut ground) = hovering(world(4));
    world.plant_mut().inject(Fault::Gyroscope(FaultKind::Off)).unwrap();
    until(&mut world, Mode::Descend, 1.0);
    fly_for(&mut world, 0.1);
    world.plant_mut().inject(Fault::Gyroscope(FaultKind::Healthy)).unwrap();
    until(&mut world, Mode::Land, 2.0);
    until_disarmed(&mut world, 15.0);
    check_landed(&mut world, &mut ground);
}

#[test]
fn prop_a_silent_board_link_ends_the_flight_on_the_floor() {
    (0..8u64).into_par_iter().for_each(|seed| {
        let (mut world, mut ground) = hovering(world(seed));
        world.plant_mut().inject(Fault::BoardLink(FaultKind::Off)).unwrap();
        fly_for(&mut world, 2.0);
        world.plant_mut().inject(Fault::BoardLink(FaultKind::Healthy)).unwrap();
        let took_s = until_disarmed(&mut world, 15.0);
        let said = texts(&mut world, &mut ground);
        println!("seed {seed}: disarmed {took_s:.1} s after the link was back");
        assert_landed(&world, &said);
        assert!(said.iter().any(|t| t.contains("board silent")), "{said:?}");
    });
}

#[test]
fn prop_a_board_link_that_stays_silent_is_left_to_the_board() {
    let (mut world, mut ground) = hovering(world(6));
    world.plant_mut().inject(Fault::BoardLink(FaultKind::Off)).unwrap();
    fly_for(&mut world, 12.0);
    // The board descends and cuts by itself; we know nothing and must not claim more.
    let truth = world.truth();
    assert!(!truth.armed && truth.on_ground, "{truth:?}");
    world.plant_mut().inject(Fault::BoardLink(FaultKind::Healthy)).unwrap();
    until_disarmed(&mut world, 5.0);
    texts(&mut world, &mut ground);
}

#[test]
fn prop_a_tag_that_reboots_does_not_end_the_flight() {
    for reopened in [true, false] {
        let (mut world, mut ground) = hovering(world(7));
        world.plant_mut().inject(Fault::TagSilent(true)).unwrap();
        if reopened {
            world.input(Input::LinkDown { link: LinkId::Tag });
        }
        fly_for(&mut world, 0.3);
        world.plant_mut().tag_input(b"d"); // reset: it speaks text again
        world.plant_mut().inject(Fault::TagSilent(false)).unwrap();
        if reopened {
            world.plant_mut().tag_opened();
            world.input(Input::LinkUp { link: LinkId::Tag });
        }
        fly_for(&mut world, 5.0);
        let said = texts(&mut world, &mut ground);
        assert_eq!(world.pilot().mode(), Mode::Hold, "reopened {reopened}: {said:?}");
        let error_m = (world.pilot().estimate().pos_E_m - world.truth().pos_E_m).norm();
        assert!(error_m < 0.4, "{error_m}");
    }
}

#[test]
fn prop_noise_on_the_wires_is_survived() {
    // One byte in 500 lost and one inserted: a sniffer frame of 69 bytes is hit with 24 %, an IMU
    // frame of about 50 bytes with 18 %.
    (20..26u64).into_par_iter().for_each(|seed| {
        let mut world = world(seed).with_damage(noisy_wire(seed, 500.0));
        let flight =
            fly(&mut world, &square(), 90.0).unwrap_or_else(|e| panic!("seed {seed}: {e}"));
        assert!(flight.landed, "seed {seed}: {:?}", flight.texts);
        assert_landed(&world, &flight.texts);
        let drops = world.pilot().drops();
        let lost = |link: usize| drops[link].iter().map(|(_, n)| n).sum::<u64>();
        assert!(lost(0) > 1000 && lost(1) > 1000, "losses are not counted: {drops:?}");
    });
}

#[test]
fn prop_an_empty_battery_lands_from_anywhere() {
    for goto in [false, true] {
        let (mut world, mut ground) = hovering(world(9));
        if goto {
            ground.goto(&mut world, [7.0, 7.0, -1.5]);
        }
        world.plant_mut().inject(Fault::BatteryDrop(2.6)).unwrap();
        until(&mut world, Mode::Land, 4.0);
        until_disarmed(&mut world, 15.0);
        check_landed(&mut world, &mut ground);
    }
    // In the take-off as well.
    let mut world = world(9);
    let mut ground = Ground::new();
    let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 2.5];
    ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
    arm(&mut world, &mut ground);
    until(&mut world, Mode::Takeoff, 5.0);
    world.plant_mut().inject(Fault::BatteryDrop(2.6)).unwrap();
    until(&mut world, Mode::Land, 4.0);
    until_disarmed(&mut world, 15.0);
    check_landed(&mut world, &mut ground);
}

#[test]
fn prop_failures_can_be_ordered_over_the_ground_link() {
    let mut world = world(10);
    let mut ground = Ground::new();
    fly_for(&mut world, 8.0);
    // Unit 0 is the gyroscope, type 1 off. On the floor only: what flies is not broken through us.
    let off = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_INJECT_FAILURE, off);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    fly_for(&mut world, 1.0);
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
}

#[test]
fn prop_a_disarm_by_the_board_in_flight_is_believed() {
    // A board that reboots in the air comes back disarmed, without streams, with a new clock. It says so twice.
    let (mut world, mut ground) = hovering(world(13));
    world.plant_mut().inject(Fault::BoardReboot).unwrap();
    let took_s = until(&mut world, Mode::Disarmed, 1.5);
    assert!(took_s > 0.5, "{took_s}");
    use haltere_dialect::mav::haltere::{HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag};
    let beat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        autopilot: MavAutopilot::MAV_AUTOPILOT_GENERIC as u8,
        base_mode: MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED,
        ..Default::default()
    });
    let mut bytes = Vec::new();
    haltere_dialect::mav_stream::encode(&mut bytes, 1, 1, 0, &beat);
    world.input(Input::Bytes { link: LinkId::Board, bytes: &bytes });
    // A heartbeat that says armed again comes too late; that flight is not ours any more.
    fly_for(&mut world, 1.5);
    assert_eq!(world.pilot().mode(), Mode::Disarmed);
    let said = texts(&mut world, &mut ground);
    assert!(said.iter().any(|t| t.contains("armed, but not by us")), "{said:?}");
}
