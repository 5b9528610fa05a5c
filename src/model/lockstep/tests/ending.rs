//! The program is asked to end, in every mode: what flies is landed first, and nobody keeps it in the air.

use haltere_dialect::mav::haltere::{COMMAND_LONG_DATA, MavMessage};

use super::*;
use crate::faults::{Fault, FaultKind};
use haltere_pilot::Input;

/// Longer than any of these takes, s.
const LIMIT_S: f64 = 30.0;

const TAKE_OFF: [f32; 7] = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 1.2];

/// Armed, with a take-off under way where it is wanted, until this mode.
fn on_the_way_to(mode: Mode) -> (Lockstep, Ground) {
    let mut world = world(3);
    let mut ground = Ground::new();
    arm(&mut world, &mut ground);
    if mode != Mode::Idle {
        ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, TAKE_OFF);
    }
    until(&mut world, mode, 20.0);
    (world, ground)
}

/// The end is asked for; the time until the core grants it, s. It stands then, disarmed.
fn ends(world: &mut Lockstep, ground: &mut Ground) -> f64 {
    let began_us = world.t_us();
    world.input(Input::EndAsked);
    while !world.pilot().may_end() {
        let elapsed_s = (world.t_us() - began_us) as f64 * 1e-6;
        assert!(elapsed_s < LIMIT_S, "still {:?}: {:#?}", world.pilot().mode(), ground.texts);
        world.step();
        ground.listen(world);
    }
    assert_landed(world, &ground.texts);
    (world.t_us() - began_us) as f64 * 1e-6
}

fn said(ground: &Ground, what: &str) -> bool {
    ground.texts.iter().any(|text| text.contains(what))
}

#[test]
fn regress_an_end_asked_in_any_mode_comes_after_the_landing() {
    for mode in [Mode::Idle, Mode::Spool, Mode::Takeoff, Mode::Hold] {
        let (mut world, mut ground) = on_the_way_to(mode);
        assert!(!world.pilot().may_end());
        let took_s = ends(&mut world, &mut ground);
        assert!(said(&ground, "haltere is asked to end: it lands first"), "{:#?}", ground.texts);
        println!("{mode:?}: {took_s:.1} s");
        // And stays there.
        fly_for(&mut world, 3.0);
        assert_landed(&world, &ground.texts);
    }
}

#[test]
fn prop_a_program_that_flies_nothing_ends_at_once() {
    let mut world = world(4);
    world.input(Input::EndAsked);
    assert!(world.pilot().may_end());
}

#[test]
fn prop_a_mission_a_return_and_a_landing_end_here() {
    for (command, mode) in [
        (None, Mode::Mission),
        (Some(MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH), Mode::Return),
        (Some(MavCmd::MAV_CMD_NAV_LAND), Mode::Land),
    ] {
        let (mut world, mut ground) = hovering(world(5));
        match command {
            Some(command) => {
                ground.goto(&mut world, [6.5, 6.5, -1.5]);
                fly_for(&mut world, 6.0);
                ground.command(&mut world, command, [f32::NAN; 7]);
            }
            None => {
                let mut items = square();
                items.remove(0);
                ground.upload(&mut world, &items);
                ground.command(&mut world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
                fly_for(&mut world, 3.0);
            }
        }
        assert_eq!(world.pilot().mode(), mode);
        let here = world.truth().pos_E_m;
        ends(&mut world, &mut ground);
        let there = world.truth().pos_E_m;
        assert!((there.x() - here.x()).hypot(there.y() - here.y()) < 0.8, "{mode:?}");
    }
}

#[test]
fn prop_no_client_holds_the_end_back() {
    use MavResult as R;
    let (mut world, mut ground) = hovering(world(6));
    world.input(Input::EndAsked);
    fly_for(&mut world, 0.3);
    assert_eq!(world.pilot().mode(), Mode::Land);
    for (command, params) in [
        (MavCmd::MAV_CMD_NAV_LOITER_UNLIM, [0.0; 7]),
        (MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, [0.0; 7]),
        (MavCmd::MAV_CMD_NAV_TAKEOFF, TAKE_OFF),
    ] {
        let answer = ground.command(&mut world, command, params);
        assert_eq!(answer, Some(R::MAV_RESULT_TEMPORARILY_REJECTED), "{command:?}");
    }
    ground.goto(&mut world, [6.0, 6.0, -1.5]);
    fly_for(&mut world, 0.3);
    ground.listen(&mut world);
    assert!(said(&ground, "refused: the program is asked to end"), "{:#?}", ground.texts);
    assert_eq!(world.pilot().mode(), Mode::Land);
    // What is no milder is granted.
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_NAV_LAND, [f32::NAN; 7]);
    assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED));
    let began_us = world.t_us();
    while !world.pilot().may_end() {
        assert!(world.t_us() - began_us < 20_000_000, "{:#?}", ground.texts);
        world.step();
    }
    assert_landed(&world, &ground.texts);
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    assert_eq!(answer, Some(R::MAV_RESULT_TEMPORARILY_REJECTED));
}

#[test]
fn prop_an_arming_under_way_ends_disarmed() {
    let (mut world, mut ground) = (world(8), Ground::new());
    // Aligned, or arming would be refused.
    fly_for(&mut world, 8.0);
    let order = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        command: MavCmd::MAV_CMD_COMPONENT_ARM_DISARM as u16,
        target_system: 1,
        target_component: 1,
        param1: 1.0,
        ..Default::default()
    });
    ground.send(&mut world, &order);
    assert_eq!(world.pilot().mode(), Mode::Arming);
    world.input(Input::EndAsked);
    let began_us = world.t_us();
    while !world.pilot().may_end() {
        assert!(world.t_us() - began_us < 10_000_000, "{:?}", world.pilot().mode());
        world.step();
    }
    fly_for(&mut world, 2.0);
    ground.listen(&mut world);
    assert!(!world.truth().armed, "{:#?}", ground.texts);
}

/// With no usable estimate, and with a board that is not heard any more: down, and an end.
#[test]
fn prop_a_descent_and_a_silent_board_come_to_an_end() {
    for (fault, mode) in [
        (Fault::Accelerometer(FaultKind::Stuck), Mode::Descend),
        (Fault::BoardLink(FaultKind::Off), Mode::Descend),
    ] {
        let (mut world, mut ground) = hovering(world(7));
        world.plant_mut().inject(fault.clone()).unwrap();
        until(&mut world, mode, 5.0);
        let began_us = world.t_us();
        world.input(Input::EndAsked);
        while !world.pilot().may_end() {
            assert!(world.t_us() - began_us < 60_000_000, "{fault:?}: {:?}", world.pilot().mode());
            world.step();
            ground.listen(&mut world);
        }
        let truth = world.truth();
        assert!(truth.on_ground && !truth.crashed, "{fault:?} {truth:?} {:#?}", ground.texts);
    }
}
