//! What boards of the two real firmwares do in the air without being asked: silence, failsafes, remote
//! controls, and the end of a flight.

use haltere_dialect::mav::haltere::MavMessage;

use super::boards::{REAL, assert_said, board, in_hover, land, pass, said, to_board};
use super::*;
use crate::board::Firmware;
use crate::faults::{Fault, FaultKind};

/// Modes of the boards by their own numbers.
const ARDUPILOT_STABILIZE: u32 = 0;
const ARDUPILOT_GUIDED_NOGPS: u32 = 20;
const PX4_HOLD: u32 = 4 << 16 | 3 << 24;
const PX4_OFFBOARD: u32 = 6 << 16;

#[test]
fn prop_a_silent_hold_of_the_board_is_noticed_and_left_again() {
    // ArduPilot: level and holding its height, same mode, no word (seen).
    let (mut world, mut ground) = in_hover(board(Firmware::Ardupilot, 11, |plant, _| {
        // Its watchdog on our heartbeat, which comes once a second, stays out of this.
        plant.board.parameters.insert("FS_GCS_TIMEOUT".into(), 5.0);
    }));
    ground.goto(&mut world, [6.5, 5.0, -1.2]);
    fly_for(&mut world, 1.0);
    world.plant_mut().inject(Fault::ToBoard(FaultKind::Off)).unwrap();
    fly_for(&mut world, 1.6);
    assert_said(&mut world, &mut ground, &["does not fly our setpoints"]);
    world.plant_mut().inject(Fault::ToBoard(FaultKind::Healthy)).unwrap();
    fly_for(&mut world, 1.0);
    assert_said(&mut world, &mut ground, &["flies our setpoints again"]);
    pass(&mut world, &mut ground, 6.0);
    let error_m = world.truth().pos_E_m - haltere_core::frames::Vec3::new(6.5, 5.0, -1.2);
    assert!(error_m.norm() < 0.4, "{error_m:?}");
    land(&mut world, &mut ground);
}

#[test]
fn prop_a_failsafe_of_the_board_is_not_fought_and_control_comes_back_on_demand() {
    for (firmware, away) in [(Firmware::Ardupilot, "LAND"), (Firmware::Px4, "LAND")] {
        let sent = Sent::default();
        let (mut world, mut ground) =
            in_hover(board(firmware, 12, |_, pilot| pilot.flight.takeoff_height_m = 2.0));
        ground.goto(&mut world, [5.0, 5.0, -4.0]);
        pass(&mut world, &mut ground, 6.0);
        let mut world = world.with_tap(tap(&sent));
        world.plant_mut().inject(Fault::ToBoard(FaultKind::Off)).unwrap();
        until(&mut world, Mode::Yielded, 6.0);
        assert_said(&mut world, &mut ground, &["board left", away]);
        world.plant_mut().inject(Fault::ToBoard(FaultKind::Healthy)).unwrap();
        // Not a setpoint: PX4 would take it and come back by itself.
        let yielded_us = world.t_us();
        fly_for(&mut world, 1.0);
        let later = |m: &(u64, MavMessage)| {
            m.0 > yielded_us + 20_000 && matches!(m.1, MavMessage::SET_ATTITUDE_TARGET(_))
        };
        assert!(!to_board(&sent).iter().any(later));
        assert_eq!(world.pilot().mode(), Mode::Yielded);
        // A plain disarm is not passed on in the air.
        let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0; 7]);
        assert_eq!(answer, Some(MavResult::MAV_RESULT_DENIED));
        // Hold asks for it.
        ground.command(&mut world, MavCmd::MAV_CMD_NAV_LOITER_UNLIM, [0.0; 7]);
        until(&mut world, Mode::Hold, 6.0);
        let from_m = world.truth().height_m;
        pass(&mut world, &mut ground, 3.0);
        let texts = said(&mut world, &mut ground);
        assert!((world.truth().height_m - from_m).abs() < 0.5, "{from_m} {texts:#?}");
        land(&mut world, &mut ground);
    }
}

#[test]
fn prop_px4_that_comes_back_by_itself_is_flown_on() {
    for gap_s in [0.5, 1.0, 1.5] {
        let (mut world, mut ground) = in_hover(board(Firmware::Px4, 13, |_, _| {}));
        world.plant_mut().inject(Fault::ToBoard(FaultKind::Off)).unwrap();
        fly_for(&mut world, gap_s);
        assert_ne!(world.plant_mut().board().custom_mode(), PX4_OFFBOARD, "it went to land");
        world.plant_mut().inject(Fault::ToBoard(FaultKind::Healthy)).unwrap();
        fly_for(&mut world, 0.1);
        assert_eq!(world.plant_mut().board().custom_mode(), PX4_OFFBOARD, "by itself");
        pass(&mut world, &mut ground, 6.0);
        let texts = said(&mut world, &mut ground);
        assert_eq!(world.pilot().mode(), Mode::Hold, "{texts:#?}");
        let error_m = world.truth().pos_E_m - haltere_core::frames::Vec3::new(5.0, 5.0, -1.2);
        assert!(error_m.norm() < 0.5, "{gap_s}: {error_m:?} {texts:#?}");
        land(&mut world, &mut ground);
    }
}

#[test]
fn prop_a_remote_control_takes_over_and_gives_back() {
    for (firmware, theirs, ours) in [
        (Firmware::Ardupilot, ARDUPILOT_STABILIZE, ARDUPILOT_GUIDED_NOGPS),
        (Firmware::Px4, PX4_HOLD, PX4_OFFBOARD),
    ] {
        let (mut world, mut ground) = in_hover(board(firmware, 14, |_, _| {}));
        world.plant_mut().inject(Fault::BoardMode(theirs)).unwrap();
        let noticed_s = until(&mut world, Mode::Yielded, 5.0);
        println!("{firmware:?}: noticed after {noticed_s:.2} s");
        pass(&mut world, &mut ground, 2.0);
        assert_eq!(world.pilot().mode(), Mode::Yielded);
        if firmware == Firmware::Ardupilot {
            // The pilot switches back: our will is to stay where that happens.
            world.plant_mut().inject(Fault::BoardMode(ours)).unwrap();
        } else {
            // PX4 does not take OFFBOARD without a stream: a client has to ask.
            ground.command(&mut world, MavCmd::MAV_CMD_NAV_LOITER_UNLIM, [0.0; 7]);
        }
        until(&mut world, Mode::Hold, 6.0);
        pass(&mut world, &mut ground, 4.0);
        let texts = said(&mut world, &mut ground);
        assert!((0.6..2.5).contains(&world.truth().height_m), "{:?} {texts:#?}", world.truth());
        land(&mut world, &mut ground);
    }
}

#[test]
fn prop_a_slow_land_detector_is_waited_for_and_not_forced() {
    for firmware in REAL {
        let sent = Sent::default();
        let (world, mut ground) = in_hover(board(firmware, 18, |_, _| {}));
        let mut world = world.with_tap(tap(&sent));
        land(&mut world, &mut ground);
        let disarms: Vec<(u64, f32)> = to_board(&sent)
            .into_iter()
            .filter_map(|(t, m)| match m {
                MavMessage::COMMAND_LONG(m)
                    if m.command == MavCmd::MAV_CMD_COMPONENT_ARM_DISARM as u16 =>
                {
                    Some((t, m.param2))
                }
                _ => None,
            })
            .collect();
        // It refuses for a second; patience is three.
        assert!(disarms.len() >= 2, "{firmware:?}: {disarms:?}");
        assert!(disarms.iter().all(|d| d.1 == 0.0), "{firmware:?}: {disarms:?}");
    }
}

/// A station that asked for it got a flying vehicle's motors stopped, and an answer before the board had one.
#[test]
fn regress_no_failure_is_injected_into_a_board_that_is_armed_and_the_answer_is_the_boards() {
    const INJECT: MavCmd = MavCmd::MAV_CMD_INJECT_FAILURE;
    // MAV_FAILURE_UNIT and MAV_FAILURE_TYPE: all motors off, barometer off, gps off; healthy again.
    let [motors, baro, gps] =
        [101.0, 3.0, 4.0].map(|unit| [unit, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0_f32]);
    let healthy = [3.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let sent = Sent::default();
    let (world, mut ground) = hovering(world(36));
    let mut world = world.with_tap(tap(&sent));
    let answer = ground.command(&mut world, INJECT, motors);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
    assert_said(&mut world, &mut ground, &["failure injection refused", "armed"]);
    pass(&mut world, &mut ground, 2.0);
    assert_eq!(world.pilot().mode(), Mode::Hold);
    land(&mut world, &mut ground);
    let passed_on = || {
        let command = |m: &(u64, MavMessage)| matches!(&m.1, MavMessage::COMMAND_LONG(c) if c.command == INJECT as u16);
        to_board(&sent).into_iter().filter(command).count()
    };
    assert_eq!(passed_on(), 0);
    // On the floor the board answers, and is waited for.
    for (params, answer) in [
        (baro, MavResult::MAV_RESULT_ACCEPTED),
        (healthy, MavResult::MAV_RESULT_ACCEPTED),
        (gps, MavResult::MAV_RESULT_UNSUPPORTED),
    ] {
        assert_eq!(ground.command(&mut world, INJECT, params), Some(answer));
    }
    assert_eq!(passed_on(), 3);
    // A line on which nothing comes back.
    world.plant_mut().inject(Fault::ToBoard(FaultKind::Off)).unwrap();
    assert_eq!(ground.command(&mut world, INJECT, baro), Some(MavResult::MAV_RESULT_FAILED));
    assert_said(&mut world, &mut ground, &["board does not answer"]);
}
