//! What ground stations ask, grant and refuse included.

use haltere_core::drops::DropReason;
use haltere_core::topics::Topic;
use haltere_dialect::mav::haltere::{
    MANUAL_CONTROL_DATA, MavFrame, MavMessage, MavMissionResult, PositionTargetTypemask as Mask,
    SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use haltere_dialect::mav::known;

use super::*;
use crate::faults::{Fault, FaultKind};
use crate::lockstep::fly;
use MavResult as R;

fn said(world: &mut Lockstep, ground: &mut Ground, what: &str) {
    fly_for(world, 0.05);
    ground.listen(world);
    assert!(ground.texts.iter().any(|t| t.contains(what)), "no {what:?} in {:?}", ground.texts);
}

fn mode(custom: Mode) -> [f32; 7] {
    let n = custom.custom_mode();
    [1.0, (n >> 16 & 0xFF) as f32, (n >> 24) as f32, 0.0, 0.0, 0.0, 0.0]
}

fn setpoint(mask: u16, pos: [f32; 3], vel: [f32; 3]) -> MavMessage {
    MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
        // Acceleration and yaw rate are never given here.
        type_mask: Mask::from_bits_retain(mask | 0x1C0 | 0xC00),
        x: pos[0],
        y: pos[1],
        z: pos[2],
        vx: vel[0],
        vy: vel[1],
        vz: vel[2],
        target_system: 1,
        target_component: 1,
        ..Default::default()
    })
}

const POSITION: u16 = 0b111_000;
const VELOCITY: u16 = 0b000_111;

/// Sends a setpoint at 20 Hz for a time.
fn stream(world: &mut Lockstep, ground: &mut Ground, message: &MavMessage, seconds: f64) {
    for _ in 0..(seconds * 20.0) as u32 {
        ground.send(world, message);
        fly_for(world, 0.05);
    }
}

/// A client streamed setpoints in Hold, and nobody said why the vehicle did not move.
#[test]
fn regress_setpoints_that_nobody_follows_are_told_once_with_the_mode_to_ask_for() {
    let mut world = world(1);
    let mut ground = Ground::new();
    let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 1.0];
    ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
    arm(&mut world, &mut ground);
    until(&mut world, Mode::Hold, 20.0);
    let north = setpoint(POSITION, [6.0, 5.0, -1.0], [0.0; 3]);
    let told = |ground: &Ground| {
        ground
            .texts
            .iter()
            .filter(|text| text.contains("not followed in mode hold: ask for OFFBOARD"))
            .count()
    };
    // PX4 wants a second of them before the mode: so long nothing is wrong.
    stream(&mut world, &mut ground, &north, 1.5);
    ground.listen(&mut world);
    assert_eq!(told(&ground), 0, "{:?}", ground.texts);
    stream(&mut world, &mut ground, &north, 5.0);
    ground.listen(&mut world);
    assert_eq!(told(&ground), 1, "{:?}", ground.texts);
    let offboard = mode(Mode::Offboard);
    assert_eq!(
        ground.command(&mut world, MavCmd::MAV_CMD_DO_SET_MODE, offboard),
        Some(R::MAV_RESULT_ACCEPTED)
    );
    stream(&mut world, &mut ground, &north, 3.0);
    ground.listen(&mut world);
    assert_eq!(told(&ground), 1, "{:?}", ground.texts);
    // Taken out of it, it is told anew.
    ground.command(&mut world, MavCmd::MAV_CMD_DO_SET_MODE, mode(Mode::Hold));
    stream(&mut world, &mut ground, &north, 3.0);
    ground.listen(&mut world);
    assert_eq!(told(&ground), 2, "{:?}", ground.texts);
}

/// Who asked for arming at once was warned five times within the first second of every flight.
#[test]
fn regress_a_healthy_start_warns_of_nothing_in_its_first_second() {
    let mut world = world(1);
    let mut ground = Ground::new();
    for _ in 0..3 {
        ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
        fly_for(&mut world, 0.02);
    }
    ground.listen(&mut world);
    assert!(ground.texts.iter().any(|text| text.contains("arming refused")), "{:?}", ground.texts);
    let mut warnings = Vec::new();
    world.pilot_mut().drain_topics(|topic| match topic {
        Topic::Text(text) if text.severity <= 4 => warnings.push(text.text),
        _ => {}
    });
    assert_eq!(warnings, [""; 0]);
    // Nor is what every start brings called lost.
    let usual =
        [DropReason::TagStartByte, DropReason::UwbClockUnsettled, DropReason::MavBeforeHeartbeat];
    fly_for(&mut world, 3.0);
    let lost: Vec<_> =
        world.pilot().drops().iter().flat_map(|drops| drops.iter().collect::<Vec<_>>()).collect();
    assert!(lost.iter().any(|(reason, _)| usual.contains(reason)), "{lost:?}");
    assert!(lost.iter().all(|(reason, _)| reason.is_usual()), "{lost:?}");
}

#[test]
fn prop_arming_is_refused_with_the_reason() {
    let mut world = world(1);
    let mut ground = Ground::new();
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    assert_eq!(answer, Some(R::MAV_RESULT_TEMPORARILY_REJECTED));
    said(&mut world, &mut ground, "arming refused: ");
    world.plant_mut().inject(Fault::TagSilent(true)).unwrap();
    fly_for(&mut world, 5.0);
    ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    said(&mut world, &mut ground, "anchors heard, keep the vehicle still");
    assert_eq!(world.pilot().mode(), Mode::Disarmed);
}

#[test]
fn prop_take_off_heights_have_limits() {
    let mut world = world(1);
    let mut ground = Ground::new();
    for (height_m, answer) in [
        (0.1, R::MAV_RESULT_DENIED),
        (-1.0, R::MAV_RESULT_DENIED),
        (7.5, R::MAV_RESULT_DENIED),
        (0.3, R::MAV_RESULT_ACCEPTED),
        (f32::NAN, R::MAV_RESULT_ACCEPTED),
    ] {
        let params = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, height_m];
        let got = ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, params);
        assert_eq!(got, Some(answer), "{height_m}");
    }
    said(&mut world, &mut ground, "take-off height = 7.50, allowed 0.3 to 6.7 m");
    // The local form has z down.
    let params = [0.0, 0.0, 0.0, f32::NAN, 5.0, 5.0, -1.0];
    let got = ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF_LOCAL, params);
    assert_eq!(got, Some(R::MAV_RESULT_ACCEPTED));
}

#[test]
fn prop_a_mission_outside_is_refused_and_the_old_one_stays() {
    let mut world = world(1);
    let mut ground = Ground::new();
    let accepted = Some(MavMissionResult::MAV_MISSION_ACCEPTED);
    assert_eq!(ground.upload(&mut world, &square()), accepted);
    let mut far = square();
    far[2].x = 6_000_000;
    let answer = ground.upload(&mut world, &far);
    assert_eq!(answer, Some(MavMissionResult::MAV_MISSION_INVALID));
    said(&mut world, &mut ground, "mission refused: item 3: N 600.00");
    assert!(fly(&mut world, &square(), 60.0).unwrap().landed);
}

#[test]
fn regress_what_waits_for_arming_is_shown() {
    let mut world = world(1);
    let mut ground = Ground::new();
    ground.upload(&mut world, &square());
    let set_mode = MavCmd::MAV_CMD_DO_SET_MODE;
    let answer = ground.command(&mut world, set_mode, mode(Mode::Mission));
    assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED));
    fly_for(&mut world, 1.2);
    ground.listen(&mut world);
    assert_eq!(ground.custom_mode, Some(Mode::Mission.custom_mode()));
    // Hold calls it off again.
    ground.command(&mut world, set_mode, mode(Mode::Hold));
    fly_for(&mut world, 1.2);
    ground.listen(&mut world);
    assert_eq!(ground.custom_mode, Some(Mode::Hold.custom_mode()));
    arm(&mut world, &mut ground);
    fly_for(&mut world, 3.0);
    assert_eq!(world.pilot().mode(), Mode::Idle);
    // Entered again, armed this time: it starts.
    ground.command(&mut world, set_mode, mode(Mode::Mission));
    until(&mut world, Mode::Mission, 15.0);
}

#[test]
fn prop_offboard_on_the_floor_needs_a_stream_that_begins_above_the_vehicle() {
    let mut world = world(2);
    let mut ground = Ground::new();
    arm(&mut world, &mut ground);
    fly_for(&mut world, 1.1);
    let set_mode = MavCmd::MAV_CMD_DO_SET_MODE;
    let offboard = mode(Mode::Offboard);
    ground.command(&mut world, set_mode, offboard);
    said(&mut world, &mut ground, "send setpoints first");
    // Three metres away, where nobody lifts off to.
    ground.send(&mut world, &setpoint(POSITION, [8.0, 5.0, -1.0], [0.0; 3]));
    let answer = ground.command(&mut world, set_mode, offboard);
    assert_eq!(answer, Some(R::MAV_RESULT_DENIED));
    said(&mut world, &mut ground, "the setpoint is 3.0 m away, allowed 1 m");
    // One that is not renewed lifts nothing.
    ground.send(&mut world, &setpoint(POSITION, [5.0, 5.0, -1.0], [0.0; 3]));
    let answer = ground.command(&mut world, set_mode, offboard);
    assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED));
    fly_for(&mut world, 2.0);
    said(&mut world, &mut ground, "offboard called off: no setpoint for");
    // Idle ends by itself.
    until(&mut world, Mode::Disarmed, 20.0);
}

/// Streams setpoints, asks for offboard, arms: as mavros' own example does.
#[test]
fn regress_a_stream_on_the_floor_lifts_off_and_the_next_arming_asks_anew() {
    let mut world = world(2);
    let mut ground = Ground::new();
    fly_for(&mut world, 8.0);
    let above = setpoint(POSITION, [5.0, 5.0, -1.5], [0.0; 3]);
    stream(&mut world, &mut ground, &above, 0.5);
    let set_mode = MavCmd::MAV_CMD_DO_SET_MODE;
    let answer = ground.command(&mut world, set_mode, mode(Mode::Offboard));
    assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED));
    stream(&mut world, &mut ground, &above, 1.2);
    ground.listen(&mut world);
    assert_eq!(ground.custom_mode, Some(Mode::Offboard.custom_mode()));
    assert_eq!(world.pilot().mode(), Mode::Disarmed);
    arm(&mut world, &mut ground);
    let mut fastest_mps = 0.0_f64;
    for _ in 0..200 {
        stream(&mut world, &mut ground, &above, 0.05);
        if world.pilot().mode() == Mode::Takeoff {
            fastest_mps = fastest_mps.max(-world.pilot().estimate().vel_E_mps().z());
        }
        if world.pilot().mode() == Mode::Offboard {
            break;
        }
    }
    assert_eq!(world.pilot().mode(), Mode::Offboard, "{:?}", ground.texts);
    assert!((0.2..1.4).contains(&fastest_mps), "{fastest_mps} m/s");
    assert!((world.truth().pos_E_m.z() + 1.5).abs() < 0.35, "{:?}", world.truth().pos_E_m);
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_NAV_LAND, [0.0; 7]);
    assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED));
    until(&mut world, Mode::Disarmed, 30.0);
    arm(&mut world, &mut ground);
    stream(&mut world, &mut ground, &above, 3.0);
    assert_eq!(world.pilot().mode(), Mode::Idle, "{:?}", ground.texts);
}

/// The fault: 0.78 s of setpoints and 0.22 s of silence were taken for a stream of 1 s, and one that stopped while the wings
/// spooled up lifted the vehicle off with nobody speaking.
#[test]
fn regress_a_stream_that_stops_before_the_lift_off_lifts_nothing() {
    for seconds in [0.75, 1.3] {
        let mut world = world(2);
        let mut ground = Ground::new();
        arm(&mut world, &mut ground);
        fly_for(&mut world, 1.1);
        let above = setpoint(POSITION, [5.0, 5.0, -1.0], [0.0; 3]);
        ground.send(&mut world, &above);
        let set_mode = MavCmd::MAV_CMD_DO_SET_MODE;
        let answer = ground.command(&mut world, set_mode, mode(Mode::Offboard));
        assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED));
        stream(&mut world, &mut ground, &above, seconds);
        fly_for(&mut world, 3.0);
        said(&mut world, &mut ground, "offboard called off: no setpoint for");
        assert!(world.truth().pos_E_m.z() > -0.2, "{seconds} s: {:?}", world.truth().pos_E_m);
        until(&mut world, Mode::Disarmed, 20.0);
    }
}

/// The fault: the first refused setpoint was told, and none after it however long they came.
#[test]
fn regress_setpoints_that_go_on_being_refused_are_told_again() {
    let mut world = world(2);
    let mut ground = Ground::new();
    let far = |x| setpoint(POSITION, [x, 5.0, -1.0], [0.0; 3]);
    stream(&mut world, &mut ground, &far(30.0), 2.0);
    stream(&mut world, &mut ground, &far(40.0), 5.0);
    ground.listen(&mut world);
    let told = |x: &str| ground.texts.iter().filter(|t| t.contains(x)).count();
    assert_eq!(
        [told("N 30.00 m is outside"), told("N 40.00 m is outside")],
        [1, 1],
        "{:?}",
        ground.texts
    );
}

/// A velocity names no height: a climb lifts off, rest does not.
#[test]
fn prop_a_climb_rate_lifts_off_too() {
    let mut world = world(4);
    let mut ground = Ground::new();
    arm(&mut world, &mut ground);
    let rest = setpoint(VELOCITY, [0.0; 3], [0.0; 3]);
    stream(&mut world, &mut ground, &rest, 0.1);
    let set_mode = MavCmd::MAV_CMD_DO_SET_MODE;
    let answer = ground.command(&mut world, set_mode, mode(Mode::Offboard));
    assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED));
    stream(&mut world, &mut ground, &rest, 2.0);
    assert_eq!(world.pilot().mode(), Mode::Idle);
    let climb = setpoint(VELOCITY, [0.0; 3], [0.0, 0.0, -0.3]);
    stream(&mut world, &mut ground, &climb, 8.0);
    assert_eq!(world.pilot().mode(), Mode::Offboard, "{:?}", ground.texts);
    assert!(world.truth().pos_E_m.z() < -0.6, "{:?}", world.truth().pos_E_m);
}

/// What is asked for while the vehicle climbs follows, and is shown at once.
#[test]
fn regress_a_point_and_a_joystick_can_be_asked_for_in_the_climb() {
    for stick in [false, true] {
        let mut world = world(5);
        let mut ground = Ground::new();
        let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 1.5];
        ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
        arm(&mut world, &mut ground);
        until(&mut world, Mode::Spool, 5.0);
        let middle = MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA {
            target: 1,
            z: 500,
            ..Default::default()
        });
        if stick {
            ground.send(&mut world, &middle);
            let asked = mode(Mode::Manual);
            let answer = ground.command(&mut world, MavCmd::MAV_CMD_DO_SET_MODE, asked);
            assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED), "{:?}", ground.texts);
        } else {
            let answer = ground.goto(&mut world, [6.0, 5.5, -1.2]);
            assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED), "{:?}", ground.texts);
        }
        let wanted = if stick { Mode::Manual } else { Mode::Goto };
        let mut low_m = f64::INFINITY;
        for _ in 0..200 {
            if world.pilot().mode() == wanted {
                break;
            }
            low_m = -world.truth().pos_E_m.z();
            stream(&mut world, &mut ground, &middle, 0.05);
        }
        assert_eq!(world.pilot().mode(), wanted, "{:?}", ground.texts);
        assert!((0.35..0.8).contains(&low_m), "{low_m} m");
        if !stick {
            fly_for(&mut world, 8.0);
            let off = world.truth().pos_E_m - haltere_core::frames::Vec3::new(6.0, 5.5, -1.2);
            assert!(off.norm() < 0.3, "{off:?}");
        }
    }
}

#[test]
fn prop_velocity_setpoints_end_in_hold_when_they_stop() {
    let (mut world, mut ground) = hovering(world(3));
    let north = setpoint(VELOCITY, [0.0; 3], [0.4, 0.0, 0.0]);
    ground.send(&mut world, &north);
    let set_mode = MavCmd::MAV_CMD_DO_SET_MODE;
    let answer = ground.command(&mut world, set_mode, mode(Mode::Offboard));
    assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED));
    let before = world.truth().pos_E_m;
    stream(&mut world, &mut ground, &north, 4.0);
    let way = world.truth().pos_E_m - before;
    assert!((1.0..=2.0).contains(&way.x()) && way.y().abs() < 0.4, "{way:?}");
    assert_eq!(world.pilot().mode(), Mode::Offboard);
    let took_s = until(&mut world, Mode::Hold, 1.0);
    assert!((0.3..=0.7).contains(&took_s), "{took_s}");
    said(&mut world, &mut ground, "setpoints stopped");
    let here = world.truth().pos_E_m;
    fly_for(&mut world, 4.0);
    assert!((world.truth().pos_E_m - here).norm() < 0.5);
}

#[test]
fn prop_velocity_setpoints_stop_at_the_edge() {
    let (mut world, mut ground) = hovering(world(4));
    let east = setpoint(VELOCITY, [0.0; 3], [0.0, 1.5, 0.0]);
    ground.send(&mut world, &east);
    ground.command(&mut world, MavCmd::MAV_CMD_DO_SET_MODE, mode(Mode::Offboard));
    stream(&mut world, &mut ground, &east, 10.0);
    let pos = world.truth().pos_E_m;
    // The volume ends at the anchors, 10 m; what is beyond is the error of estimate and loops.
    assert!((9.0..=10.3).contains(&pos.y()), "{pos:?}");
}

#[test]
fn prop_axes_may_mix_position_and_velocity() {
    let (mut world, mut ground) = hovering(world(5));
    // North by velocity, east and down by position.
    let mixed = setpoint(0b110_001, [0.0, 5.5, -1.5], [0.3, 0.0, 0.0]);
    ground.send(&mut world, &mixed);
    ground.command(&mut world, MavCmd::MAV_CMD_DO_SET_MODE, mode(Mode::Offboard));
    let before = world.truth().pos_E_m;
    stream(&mut world, &mut ground, &mixed, 5.0);
    let pos = world.truth().pos_E_m;
    assert!((1.0..=2.0).contains(&(pos.x() - before.x())), "{pos:?}");
    assert!((pos.y() - 5.5).abs() < 0.35 && (pos.z() + 1.5).abs() < 0.35, "{pos:?}");
}

#[test]
fn prop_hold_and_land_on_the_floor_change_nothing() {
    let mut world = world(6);
    let mut ground = Ground::new();
    let set_mode = MavCmd::MAV_CMD_DO_SET_MODE;
    for asked in [Mode::Hold, Mode::Land] {
        let answer = ground.command(&mut world, set_mode, mode(asked));
        assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED));
        assert_eq!(world.pilot().mode(), Mode::Disarmed);
    }
    arm(&mut world, &mut ground);
    fly_for(&mut world, 1.1);
    let answer = ground.command(&mut world, set_mode, mode(Mode::Hold));
    assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED));
    assert_eq!(world.pilot().mode(), Mode::Idle);
}

#[test]
fn prop_two_endpoints_at_once() {
    let plant = PlantConfig::hall(7);
    let survey = plant.survey.clone();
    let mut config = pilot_config(&plant);
    config.endpoints = vec![haltere_pilot::Endpoint::default(); 2];
    let mut world = Lockstep::new(plant, config, &survey).unwrap();
    let mut first = Ground::at_endpoint(0, 255);
    let mut second = Ground::at_endpoint(1, 245);
    assert_eq!(second.upload(&mut world, &square()), Some(MavMissionResult::MAV_MISSION_ACCEPTED));
    arm(&mut world, &mut first);
    let start = second.command(&mut world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
    assert_eq!(start, Some(R::MAV_RESULT_ACCEPTED));
    until(&mut world, Mode::Mission, 20.0);
    // One stops what the other began; both hear of it.
    let hold = first.command(&mut world, MavCmd::MAV_CMD_DO_SET_MODE, mode(Mode::Hold));
    assert_eq!(hold, Some(R::MAV_RESULT_ACCEPTED));
    said(&mut world, &mut first, "hold: hold asked");
    said(&mut world, &mut second, "hold: hold asked");
    // Answers go to the asker only.
    let other = second.take(|m| match m {
        MavMessage::COMMAND_ACK(ack) if ack.command == MavCmd::MAV_CMD_DO_SET_MODE as u16 => {
            Some(())
        }
        _ => None,
    });
    assert_eq!(other, None);
}

#[test]
fn regress_a_second_uploader_is_refused() {
    use haltere_dialect::mav::haltere::MISSION_COUNT_DATA;
    let plant = PlantConfig::hall(7);
    let survey = plant.survey.clone();
    let mut config = pilot_config(&plant);
    config.endpoints = vec![haltere_pilot::Endpoint::default(); 2];
    let mut world = Lockstep::new(plant, config, &survey).unwrap();
    let mut first = Ground::at_endpoint(0, 255);
    let mut second = Ground::at_endpoint(1, 245);
    let count = MISSION_COUNT_DATA {
        count: 3,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    };
    first.send(&mut world, &MavMessage::MISSION_COUNT(count));
    let answer = second.upload(&mut world, &square());
    assert_eq!(answer, Some(MavMissionResult::MAV_MISSION_DENIED));
    // A client that went away does not block for ever.
    fly_for(&mut world, 11.0);
    let answer = second.upload(&mut world, &square());
    assert_eq!(answer, Some(MavMissionResult::MAV_MISSION_ACCEPTED));
}

#[test]
fn regress_goto_after_an_aborted_landing_starts_where_the_vehicle_is() {
    let (mut world, mut ground) = hovering(world(8));
    ground.command(&mut world, MavCmd::MAV_CMD_NAV_LAND, [0.0; 7]);
    fly_for(&mut world, 2.6);
    let low = world.truth().height_m;
    assert!((0.1..0.45).contains(&low), "{low}");
    assert_eq!(ground.goto(&mut world, [5.5, 5.0, -0.5]), Some(R::MAV_RESULT_ACCEPTED));
    fly_for(&mut world, 0.05);
    let asked = world.pilot().control_record().pos_setpoint_E_m[2].unwrap();
    assert!((-asked - low).abs() < 0.4, "setpoint at {asked} while {low} m high");
    fly_for(&mut world, 5.0);
    let pos = world.truth().pos_E_m;
    assert!((pos.x() - 5.5).abs() < 0.4 && (pos.z() + 0.5).abs() < 0.4, "{pos:?}");
}

#[test]
fn prop_a_jump_within_the_mission_leaves_the_leg() {
    let mut world = world(9);
    let mut ground = Ground::new();
    let mut items = square();
    items[1] = item(MavCmd::MAV_CMD_NAV_WAYPOINT, [8.5, 5.0, -1.2], 1.0);
    ground.upload(&mut world, &items);
    arm(&mut world, &mut ground);
    ground.command(&mut world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
    until(&mut world, Mode::Mission, 15.0);
    fly_for(&mut world, 2.0);
    // To the landing, in the middle of the first leg.
    let jump = [5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_DO_SET_MISSION_CURRENT, jump);
    assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED));
    until(&mut world, Mode::Land, 0.5);
    until(&mut world, Mode::Disarmed, 15.0);
    let pos = world.truth().pos_E_m;
    assert!(pos.x() < 7.0, "{pos:?}");
}

#[test]
fn prop_arming_ends_when_the_board_says_nothing() {
    let mut world = world(10);
    let mut ground = Ground::new();
    fly_for(&mut world, 8.0);
    assert!(world.pilot().estimate().health == haltere_core::estimate::Health::Good);
    world.plant_mut().inject(Fault::BoardLink(FaultKind::Off)).unwrap();
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    assert_eq!(answer, Some(R::MAV_RESULT_FAILED));
    said(&mut world, &mut ground, "arming failed: board did not answer");
    assert_eq!(world.pilot().mode(), Mode::Disarmed);
}

#[test]
fn regress_disarming_before_the_board_showed_armed_ends() {
    let mut world = world(11);
    let mut ground = Ground::new();
    arm(&mut world, &mut ground);
    // The answer comes at once, the heartbeat that shows it up to a second later.
    let disarm = [0.0; 7];
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, disarm);
    assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED));
    until(&mut world, Mode::Disarmed, 3.0);
    assert!(!world.truth().armed);
    arm(&mut world, &mut ground);
}

#[test]
fn regress_disarming_in_the_spool_up_is_granted() {
    let mut world = world(12);
    let mut ground = Ground::new();
    arm(&mut world, &mut ground);
    let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 1.2];
    ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
    until(&mut world, Mode::Spool, 3.0);
    fly_for(&mut world, 0.5);
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0; 7]);
    assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED));
    until(&mut world, Mode::Disarmed, 3.0);
    assert_landed(&world, &ground.texts);
    // In the air it is refused, and forced it is done.
    let (mut world, mut ground) = hovering(super::world(12));
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [0.0; 7]);
    assert_eq!(answer, Some(R::MAV_RESULT_DENIED));
    let force = [0.0, 21196.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, force);
    assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED));
    assert!(!world.truth().armed);
}

#[test]
fn regress_a_false_marker_does_not_hold_back_a_command() {
    let (mut world, mut ground) = hovering(world(13));
    // The beginning of a frame of 255 bytes; nothing else comes on the link but one command.
    world.ground_in_at(0, &[0xFD, 255, 0, 0, 0, 1, 1, 0, 0, 0]);
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_NAV_LAND, [0.0; 7]);
    assert_eq!(answer, Some(R::MAV_RESULT_ACCEPTED));
    assert_eq!(world.pilot().mode(), Mode::Land);
}

#[test]
fn regress_each_endpoint_hears_of_every_pair() {
    use haltere_dialect::mav_stream::MavSplitter;
    let plant = PlantConfig::hall(14);
    let survey = plant.survey.clone();
    let mut config = pilot_config(&plant);
    config.endpoints = vec![haltere_pilot::Endpoint::default(); 2];
    let mut world = Lockstep::new(plant, config, &survey).unwrap();
    for n in 0..2 {
        let mut ground = Ground::at_endpoint(n, 255 - n);
        let ask = [54_103.0, 250_000.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        ground.command(&mut world, MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, ask);
    }
    fly_for(&mut world, 30.0);
    let pairs = |n: u8| {
        let mut splitter = MavSplitter::new();
        let mut pairs = std::collections::BTreeSet::new();
        for chunk in world.ground_out_of(n).chunks(1000) {
            splitter.push(chunk);
            while let Some(next) = splitter.next() {
                if let Ok(MavMessage::HALTERE_PAIR(m)) = next.and_then(|frame| frame.decode()) {
                    pairs.insert((m.anchor_a, m.anchor_b));
                }
            }
        }
        pairs
    };
    let (first, second) = (pairs(0), pairs(1));
    assert!(first.len() > 7, "{first:?}");
    assert_eq!(first, second);
}

#[test]
fn regress_clearing_the_fence_keeps_the_plan() {
    use haltere_dialect::mav::haltere::{MISSION_CLEAR_ALL_DATA, MavMissionType as Type};
    let mut world = world(15);
    let mut ground = Ground::new();
    ground.upload(&mut world, &square());
    let mut clear = |mission_type| {
        let message = MavMessage::MISSION_CLEAR_ALL(MISSION_CLEAR_ALL_DATA {
            target_system: 1,
            target_component: 1,
            mission_type,
        });
        ground.send(&mut world, &message);
        ground.command(&mut world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7])
    };
    assert_eq!(clear(Type::MAV_MISSION_TYPE_FENCE as u8), Some(R::MAV_RESULT_ACCEPTED));
    assert_eq!(clear(Type::MAV_MISSION_TYPE_ALL as u8), Some(R::MAV_RESULT_DENIED));
    // What waited for arming was that mission.
    fly_for(&mut world, 1.2);
    ground.listen(&mut world);
    assert_eq!(ground.custom_mode, Some(Mode::Hold.custom_mode()));
}

#[test]
fn regress_an_upload_does_not_replace_the_mission_in_flight() {
    use haltere_dialect::mav::haltere::{MISSION_COUNT_DATA, MISSION_ITEM_INT_DATA};
    let mut world = world(16);
    let mut ground = Ground::new();
    ground.upload(&mut world, &square());
    arm(&mut world, &mut ground);
    ground.command(&mut world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
    let count = MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
        count: 1,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    });
    ground.send(&mut world, &count);
    // Its take-off is a part of it.
    until(&mut world, Mode::Takeoff, 5.0);
    ground.listen(&mut world);
    while ground.take(|m| matches!(m, MavMessage::MISSION_ACK(_)).then_some(())).is_some() {}
    ground.send(&mut world, &count);
    let acked = |m: &MavMessage| match m {
        MavMessage::MISSION_ACK(ack) => known(ack.mavtype),
        _ => None,
    };
    let answer = ground.wait_for(&mut world, 2_000_000, acked);
    assert_eq!(answer, Some(MavMissionResult::MAV_MISSION_DENIED));
    until(&mut world, Mode::Mission, 15.0);
    ground.listen(&mut world);
    while ground.take(|m| matches!(m, MavMessage::MISSION_ACK(_)).then_some(())).is_some() {}
    let far = MISSION_ITEM_INT_DATA {
        target_system: 1,
        target_component: 1,
        ..item(MavCmd::MAV_CMD_NAV_WAYPOINT, [9.0, 9.0, -3.0], 0.0)
    };
    ground.send(&mut world, &MavMessage::MISSION_ITEM_INT(far));
    let answer = ground.wait_for(&mut world, 2_000_000, |m| match m {
        MavMessage::MISSION_ACK(ack) => known(ack.mavtype),
        _ => None,
    });
    assert_eq!(answer, Some(MavMissionResult::MAV_MISSION_DENIED));
    until(&mut world, Mode::Land, 30.0);
    let pos = world.truth().pos_E_m;
    assert!(pos.x() < 7.0 && pos.y() < 7.0, "{pos:?}");
}
