//! Parameters and plans of a whole core: error cases, locks, what holds in flight.

use haltere_dialect::mav::haltere::{
    MISSION_CLEAR_ALL_DATA, MISSION_COUNT_DATA, MISSION_ITEM_DATA, MISSION_REQUEST_DATA,
    MISSION_REQUEST_INT_DATA, MISSION_REQUEST_LIST_DATA, MISSION_REQUEST_PARTIAL_LIST_DATA,
    MISSION_WRITE_PARTIAL_LIST_DATA, MavFrame, MavMessage, MavMissionResult, MavMissionType,
    MavParamError, MavParamType, PARAM_REQUEST_LIST_DATA, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA,
    PARAM_VALUE_DATA, PositionTargetTypemask, SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use haltere_dialect::mav::known;

use super::*;
use MavMissionType as T;
use haltere_core::geo::{Geodetic, LocalOrigin};

const PATIENCE_US: u64 = 2_000_000;

fn id(name: &str) -> [u8; 16] {
    std::array::from_fn(|i| name.as_bytes().get(i).copied().unwrap_or(0))
}

fn set(world: &mut Lockstep, ground: &mut Ground, name: &str, value: f32) {
    let message = MavMessage::PARAM_SET(PARAM_SET_DATA {
        param_value: value,
        target_system: 1,
        target_component: 1,
        param_id: id(name).into(),
        param_type: MavParamType::MAV_PARAM_TYPE_REAL32 as u8,
    });
    ground.send(world, &message);
}

fn value(world: &mut Lockstep, ground: &mut Ground, name: &str) -> Option<PARAM_VALUE_DATA> {
    let wanted = id(name);
    ground.wait_for(world, PATIENCE_US, |m| match m {
        MavMessage::PARAM_VALUE(v) if *v.param_id == wanted => Some(v.clone()),
        _ => None,
    })
}

fn error(world: &mut Lockstep, ground: &mut Ground) -> Option<MavParamError> {
    ground.wait_for(world, PATIENCE_US, |m| match m {
        MavMessage::PARAM_ERROR(e) => Some(e.error),
        _ => None,
    })
}

fn said(world: &mut Lockstep, ground: &mut Ground, what: &str) {
    fly_for(world, 0.05);
    ground.listen(world);
    assert!(ground.texts.iter().any(|t| t.contains(what)), "no {what:?} in {:?}", ground.texts);
}

#[test]
fn prop_all_parameters_are_listed_once_to_component_zero_too() {
    let mut world = world(1);
    let mut ground = Ground::new();
    let ask = PARAM_REQUEST_LIST_DATA { target_system: 1, target_component: 0 };
    ground.send(&mut world, &MavMessage::PARAM_REQUEST_LIST(ask));
    let mut seen = std::collections::BTreeMap::new();
    let start_us = world.t_us();
    while let Some(v) = ground.wait_for(&mut world, 200_000, |m| match m {
        MavMessage::PARAM_VALUE(v) => Some(v.clone()),
        _ => None,
    }) {
        assert_eq!(v.param_type, MavParamType::MAV_PARAM_TYPE_REAL32 as u8);
        assert!(v.param_value.is_finite());
        let count = usize::from(v.param_count);
        assert!(seen.insert(v.param_index, v.param_id).is_none(), "twice");
        if seen.len() == count {
            break;
        }
    }
    let took_s = (world.t_us() - start_us) as f64 * 1e-6;
    assert!(seen.len() > 100 && seen.keys().copied().eq(0..seen.len() as u16));
    // 1000 in less than a second is 100 in less than 0.1 s.
    assert!(took_s < 0.1 * seen.len() as f64 / 100.0, "{} in {took_s} s", seen.len());
}

#[test]
fn prop_one_is_read_by_index_and_by_name_and_unknown_ones_are_refused() {
    let mut world = world(1);
    let mut ground = Ground::new();
    let ask = |index: i16, name: &str| {
        MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
            param_index: index,
            target_system: 1,
            target_component: 1,
            param_id: id(name).into(),
        })
    };
    ground.send(&mut world, &ask(-1, "FLT_TKO_HGT"));
    let by_name = value(&mut world, &mut ground, "FLT_TKO_HGT").unwrap();
    ground.send(&mut world, &ask(by_name.param_index as i16, ""));
    assert_eq!(value(&mut world, &mut ground, "FLT_TKO_HGT"), Some(by_name));
    // The volume is that of the anchors, less what wings and stopping take.
    ground.send(&mut world, &ask(-1, "LIM_NORTH_MAX"));
    assert_eq!(value(&mut world, &mut ground, "LIM_NORTH_MAX").unwrap().param_value, 9.55);
    for (index, name) in [(-1, "NO_SUCH"), (5000, ""), (-1, "MIS_TAKEOFF_ALT")] {
        ground.send(&mut world, &ask(index, name));
        let found = error(&mut world, &mut ground);
        assert_eq!(found, Some(MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST), "{index} {name}");
    }
    ground.send(&mut world, &ask(-1, "_HASH_CHECK"));
    let hash = value(&mut world, &mut ground, "_HASH_CHECK").unwrap();
    assert_eq!(hash.param_index, u16::MAX);
    set(&mut world, &mut ground, "FLT_ACC_RAD", 0.45);
    ground.send(&mut world, &ask(-1, "_HASH_CHECK"));
    let other = value(&mut world, &mut ground, "_HASH_CHECK").unwrap();
    assert_ne!(hash.param_value.to_bits(), other.param_value.to_bits());
}

#[test]
fn prop_bad_values_are_refused_with_the_old_value_and_a_reason() {
    let mut world = world(1);
    let mut ground = Ground::new();
    use MavParamError as E;
    for (name, bad, wanted, says) in [
        ("FLT_TKO_HGT", 25.0, E::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE, "allowed 0.3 to 20 m"),
        ("FLT_TKO_HGT", f32::NAN, E::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE, "not a number"),
        // A rule that joins two values.
        ("LIM_BAT_CRIT", 7.0, E::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE, "limits.battery_critical_v"),
    ] {
        set(&mut world, &mut ground, name, bad);
        assert_eq!(error(&mut world, &mut ground), Some(wanted), "{name} {bad}");
        let old = value(&mut world, &mut ground, name).unwrap().param_value;
        assert!(old.is_finite() && old != bad);
        said(&mut world, &mut ground, says);
    }
    set(&mut world, &mut ground, "NO_SUCH", 1.0);
    assert_eq!(error(&mut world, &mut ground), Some(E::MAV_PARAM_ERROR_DOES_NOT_EXIST));
    let typed = MavMessage::PARAM_SET(PARAM_SET_DATA {
        param_value: 1.0,
        target_system: 1,
        target_component: 1,
        param_id: id("FLT_TKO_HGT").into(),
        param_type: MavParamType::MAV_PARAM_TYPE_INT32 as u8,
    });
    ground.send(&mut world, &typed);
    assert_eq!(error(&mut world, &mut ground), Some(E::MAV_PARAM_ERROR_TYPE_MISMATCH));
    // For another system: no answer at all.
    let foreign = MavMessage::PARAM_SET(PARAM_SET_DATA { target_system: 7, ..Default::default() });
    ground.send(&mut world, &foreign);
    assert_eq!(error(&mut world, &mut ground), None);
}

/// Gains change in flight without a jump of attitude or thrust; limits do not change there.
#[test]
fn prop_what_would_jump_waits_for_the_floor_and_the_rest_fades() {
    let (mut world, mut ground) = hovering(world(2));
    let before = *world.pilot().control_record();
    set(&mut world, &mut ground, "GAN_VEL_X_P", 0.25);
    set(&mut world, &mut ground, "TRM_PITCH", 2.0);
    world.run_until(world.t_us() + 12_000);
    let after = *world.pilot().control_record();
    assert!(after.at > before.at);
    let jump_rad = (after.pitch_rad - before.pitch_rad).abs();
    assert!(jump_rad < 0.02, "{} deg", jump_rad.to_degrees());
    assert!((after.thrust_frac - before.thrust_frac).abs() < 0.03);
    assert_eq!(value(&mut world, &mut ground, "GAN_VEL_X_P").unwrap().param_value, 0.25);
    set(&mut world, &mut ground, "CLM_TILT", 30.0);
    let found = error(&mut world, &mut ground);
    assert_eq!(found, Some(MavParamError::MAV_PARAM_ERROR_PERMISSION_DENIED));
    said(&mut world, &mut ground, "CLM_TILT cannot change in flight: land first");
    // Of the filter: kept, but not in force.
    set(&mut world, &mut ground, "EST_UWB_STD", 0.2);
    assert_eq!(value(&mut world, &mut ground, "EST_UWB_STD").unwrap().param_value, 0.2);
    said(&mut world, &mut ground, "EST_UWB_STD = 0.2: in force after a restart");
    // It still holds.
    fly_for(&mut world, 3.0);
    let pos = world.truth().pos_E_m;
    assert!((pos.x() - 5.0).abs() < 0.7 && (pos.y() - 5.0).abs() < 0.7, "{pos:?}");
    assert_eq!(world.pilot().mode(), Mode::Hold);
}

// ---- plans ----

pub(super) fn upload_as(
    world: &mut Lockstep,
    ground: &mut Ground,
    mission_type: MavMissionType,
    items: &[MISSION_ITEM_INT_DATA],
) -> Option<MavMissionResult> {
    let count = MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
        count: items.len() as u16,
        target_system: 1,
        target_component: 1,
        mission_type: mission_type as u8,
        opaque_id: 0,
    });
    ground.send(world, &count);
    answer_requests(world, ground, mission_type, items)
}

fn answer_requests(
    world: &mut Lockstep,
    ground: &mut Ground,
    mission_type: MavMissionType,
    items: &[MISSION_ITEM_INT_DATA],
) -> Option<MavMissionResult> {
    loop {
        let step = ground.wait_for(world, PATIENCE_US, |m| match m {
            MavMessage::MISSION_REQUEST_INT(r) => Some(Ok(r.seq)),
            MavMessage::MISSION_REQUEST(r) => Some(Ok(r.seq)),
            MavMessage::MISSION_ACK(ack) => known(ack.mavtype).map(Err),
            _ => None,
        })?;
        match step {
            Err(result) => return Some(result),
            Ok(seq) => {
                let item = items.get(usize::from(seq)).cloned().unwrap_or_default();
                let message = MavMessage::MISSION_ITEM_INT(MISSION_ITEM_INT_DATA {
                    seq,
                    target_system: 1,
                    target_component: 1,
                    mission_type: mission_type as u8,
                    ..item
                });
                ground.send(world, &message);
            }
        }
    }
}

/// Inclusion polygon from 3 to 7 m.
fn fence() -> Vec<MISSION_ITEM_INT_DATA> {
    [[3.0, 3.0], [3.0, 7.0], [7.0, 7.0], [7.0, 3.0]]
        .map(|[n, e]| item(MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, [n, e, 0.0], 4.0))
        .to_vec()
}

pub(super) const ACCEPTED: Option<MavMissionResult> = Some(MavMissionResult::MAV_MISSION_ACCEPTED);

fn download(
    world: &mut Lockstep,
    ground: &mut Ground,
    mission_type: MavMissionType,
) -> Vec<MISSION_ITEM_INT_DATA> {
    let ask = MISSION_REQUEST_LIST_DATA {
        target_system: 1,
        target_component: 1,
        mission_type: mission_type as u8,
    };
    ground.send(world, &MavMessage::MISSION_REQUEST_LIST(ask));
    let count = ground
        .wait_for(world, PATIENCE_US, |m| match m {
            MavMessage::MISSION_COUNT(c) if c.mission_type == mission_type as u8 => Some(c.count),
            _ => None,
        })
        .unwrap();
    // Five in flight, as MAVProxy does.
    let mut items = vec![None; usize::from(count)];
    for first in (0..count).step_by(5) {
        for seq in first..count.min(first + 5) {
            let ask = MISSION_REQUEST_INT_DATA {
                seq,
                target_system: 1,
                target_component: 1,
                mission_type: mission_type as u8,
            };
            ground.send(world, &MavMessage::MISSION_REQUEST_INT(ask));
        }
        for _ in first..count.min(first + 5) {
            let item = ground
                .wait_for(world, PATIENCE_US, |m| match m {
                    MavMessage::MISSION_ITEM_INT(i) => Some(i.clone()),
                    _ => None,
                })
                .unwrap();
            let slot = usize::from(item.seq);
            items[slot] = Some(item);
        }
    }
    items.into_iter().map(Option::unwrap).collect()
}

#[test]
fn prop_three_lists_are_held_apart_and_come_back() {
    let mut world = world(1);
    let mut ground = Ground::new();
    assert_eq!(upload_as(&mut world, &mut ground, T::MAV_MISSION_TYPE_FENCE, &fence()), ACCEPTED);
    let rally = [item(MavCmd::MAV_CMD_NAV_RALLY_POINT, [4.0, 4.0, 0.0], 0.0)];
    assert_eq!(upload_as(&mut world, &mut ground, T::MAV_MISSION_TYPE_RALLY, &rally), ACCEPTED);
    assert_eq!(
        upload_as(&mut world, &mut ground, T::MAV_MISSION_TYPE_MISSION, &square()),
        ACCEPTED
    );
    for (mission_type, want) in [
        (T::MAV_MISSION_TYPE_FENCE, fence()),
        (T::MAV_MISSION_TYPE_RALLY, rally.to_vec()),
        (T::MAV_MISSION_TYPE_MISSION, square()),
    ] {
        let got = download(&mut world, &mut ground, mission_type);
        assert_eq!(got.len(), want.len());
        for (got, want) in got.iter().zip(&want) {
            assert_eq!((got.command, got.x, got.y), (want.command, want.x, want.y));
            assert_eq!(got.mission_type, mission_type as u8);
        }
    }
    // A rally point or a leg outside the fence is refused.
    let outside = [item(MavCmd::MAV_CMD_NAV_RALLY_POINT, [8.0, 8.0, 0.0], 0.0)];
    let answer = upload_as(&mut world, &mut ground, T::MAV_MISSION_TYPE_RALLY, &outside);
    assert_eq!(answer, Some(MavMissionResult::MAV_MISSION_INVALID));
    let mut leaving = square();
    leaving.insert(2, item(MavCmd::MAV_CMD_NAV_WAYPOINT, [8.0, 5.0, -1.2], 0.0));
    let answer = upload_as(&mut world, &mut ground, T::MAV_MISSION_TYPE_MISSION, &leaving);
    assert_eq!(answer, Some(MavMissionResult::MAV_MISSION_INVALID));
    said(&mut world, &mut ground, "item 3: it, or the way to it, is outside the fence");
    // Everything at once.
    let clear = MISSION_CLEAR_ALL_DATA {
        target_system: 1,
        target_component: 1,
        mission_type: T::MAV_MISSION_TYPE_ALL as u8,
    };
    ground.send(&mut world, &MavMessage::MISSION_CLEAR_ALL(clear));
    fly_for(&mut world, 0.1);
    for mission_type in
        [T::MAV_MISSION_TYPE_FENCE, T::MAV_MISSION_TYPE_RALLY, T::MAV_MISSION_TYPE_MISSION]
    {
        assert!(download(&mut world, &mut ground, mission_type).is_empty());
    }
}

#[test]
fn prop_the_fence_holds_back_goto_and_offboard_and_arming() {
    let mut world = world(3);
    let mut ground = Ground::new();
    assert_eq!(upload_as(&mut world, &mut ground, T::MAV_MISSION_TYPE_FENCE, &fence()), ACCEPTED);
    let (mut world, mut ground) = hovering(world);
    // The room would allow it.
    let answer = ground.goto(&mut world, [9.0, 5.0, -1.2]);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_DENIED));
    // Straight on at 1 m/s, as an offboard client may ask: it stops at the fence, and stays.
    let north = MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
        // Horizontal velocity and height.
        type_mask: PositionTargetTypemask::from_bits_retain(0x1C0 | 0xC00 | 0b100_011),
        z: -1.2,
        vx: 1.0,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    });
    let mut farthest: f64 = 0.0;
    for n in 0..200 {
        ground.send(&mut world, &north);
        if n == 1 {
            let offboard = [1.0, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0];
            let answer = ground.command(&mut world, MavCmd::MAV_CMD_DO_SET_MODE, offboard);
            assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
        }
        fly_for(&mut world, 0.05);
        farthest = farthest.max(world.truth().pos_E_m.x());
    }
    assert!((6.0..7.2).contains(&farthest), "N {farthest}");
    said(&mut world, &mut ground, "held back by the fence");
    assert_eq!(world.pilot().mode(), Mode::Offboard);
    // A fence that leaves the vehicle outside is refused in flight.
    let away = [[0.5, 0.5], [0.5, 1.5], [1.5, 1.5], [1.5, 0.5]]
        .map(|[n, e]| item(MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION, [n, e, 0.0], 4.0));
    let answer = upload_as(&mut world, &mut ground, T::MAV_MISSION_TYPE_FENCE, &away);
    assert_eq!(answer, Some(MavMissionResult::MAV_MISSION_DENIED));
    // On the floor it is taken, and arming is refused.
    let mut world = super::world(3);
    let mut ground = Ground::new();
    fly_for(&mut world, 6.0);
    assert_eq!(upload_as(&mut world, &mut ground, T::MAV_MISSION_TYPE_FENCE, &away), ACCEPTED);
    ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    said(&mut world, &mut ground, "outside the fence");
}

/// Float items in a global frame, as DroneKit and MAVProxy send them, and their way back.
#[test]
fn prop_float_items_in_a_global_frame() {
    let mut world = world(1);
    let mut ground = Ground::new();
    let origin = LocalOrigin::new(Geodetic::from_deg(0.5, 0.5, 0.0).unwrap(), 0.0).unwrap();
    let place = origin.to_global(haltere_core::frames::Vec3::new(6.0, 5.0, 0.0));
    let count = MISSION_COUNT_DATA {
        count: 1,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    };
    ground.send(&mut world, &MavMessage::MISSION_COUNT(count));
    let float = MISSION_ITEM_DATA {
        x: place.lat_rad.to_degrees() as f32,
        y: place.lon_rad.to_degrees() as f32,
        z: 1.5,
        command: MavCmd::MAV_CMD_NAV_WAYPOINT as u16,
        frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT as u8,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    };
    ground.send(&mut world, &MavMessage::MISSION_ITEM(float.clone()));
    let answer = ground.wait_for(&mut world, PATIENCE_US, |m| match m {
        MavMessage::MISSION_ACK(ack) => known(ack.mavtype),
        _ => None,
    });
    assert_eq!(answer, ACCEPTED);
    let ask = MISSION_REQUEST_DATA { target_system: 1, target_component: 1, ..Default::default() };
    ground.send(&mut world, &MavMessage::MISSION_REQUEST(ask));
    let back = ground
        .wait_for(&mut world, PATIENCE_US, |m| match m {
            MavMessage::MISSION_ITEM(i) => Some(i.clone()),
            _ => None,
        })
        .unwrap();
    // 1e-7 degrees on the way.
    assert!((back.x - float.x).abs() < 2e-7 && (back.y - float.y).abs() < 2e-7);
    let haltere_pilot::MissionItem::Waypoint { pos_E_m, .. } =
        world.pilot().mission().items[0].item
    else {
        panic!("no waypoint")
    };
    assert!((pos_E_m.x() - 6.0).abs() < 0.05 && (pos_E_m.y() - 5.0).abs() < 0.05, "{pos_E_m:?}");
}

#[test]
fn prop_parts_are_written_and_read() {
    let mut world = world(1);
    let mut ground = Ground::new();
    assert_eq!(
        upload_as(&mut world, &mut ground, T::MAV_MISSION_TYPE_MISSION, &square()),
        ACCEPTED
    );
    let part = |start_index, end_index| {
        MavMessage::MISSION_WRITE_PARTIAL_LIST(MISSION_WRITE_PARTIAL_LIST_DATA {
            start_index,
            end_index,
            target_system: 1,
            target_component: 1,
            ..Default::default()
        })
    };
    let mut changed = square();
    changed[2] = item(MavCmd::MAV_CMD_NAV_WAYPOINT, [6.5, 5.5, -1.2], 0.0);
    ground.send(&mut world, &part(2, 2));
    let plan = T::MAV_MISSION_TYPE_MISSION;
    assert_eq!(answer_requests(&mut world, &mut ground, plan, &changed), ACCEPTED);
    let got = download(&mut world, &mut ground, plan);
    assert_eq!((got.len(), got[2].x, got[3].x), (6, 65_000, 50_000));
    for (start, end) in [(7, 8), (-1, 0), (3, 2)] {
        ground.send(&mut world, &part(start, end));
        let answer = answer_requests(&mut world, &mut ground, plan, &changed);
        assert_eq!(answer, Some(MavMissionResult::MAV_MISSION_INVALID_SEQUENCE), "{start} {end}");
    }
    let ask = MISSION_REQUEST_PARTIAL_LIST_DATA {
        start_index: 1,
        end_index: -1,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    };
    ground.send(&mut world, &MavMessage::MISSION_REQUEST_PARTIAL_LIST(ask));
    for seq in 1..6 {
        let got = ground.wait_for(&mut world, PATIENCE_US, |m| match m {
            MavMessage::MISSION_ITEM_INT(i) => Some(i.seq),
            _ => None,
        });
        assert_eq!(got, Some(seq));
    }
}

#[test]
fn prop_two_stations_do_not_mix_their_missions() {
    let plant = PlantConfig::hall(1);
    let survey = plant.survey.clone();
    let pilot = PilotConfig { endpoints: vec![Default::default(); 2], ..pilot_config(&plant) };
    let mut world = Lockstep::new(plant, pilot, &survey).unwrap();
    let mut first = Ground::new();
    let mut second = Ground::at_endpoint(1, 245);
    let count = |n| {
        MavMessage::MISSION_COUNT(MISSION_COUNT_DATA {
            count: n,
            target_system: 1,
            target_component: 1,
            ..Default::default()
        })
    };
    first.send(&mut world, &count(6));
    let plan = T::MAV_MISSION_TYPE_MISSION;
    let answer = upload_as(&mut world, &mut second, plan, &square());
    assert_eq!(answer, Some(MavMissionResult::MAV_MISSION_DENIED));
    assert_eq!(answer_requests(&mut world, &mut first, plan, &square()), ACCEPTED);
    assert_eq!(upload_as(&mut world, &mut second, plan, &square()), ACCEPTED);
    // Too many, and nothing.
    second.send(&mut world, &count(1001));
    let answer = answer_requests(&mut world, &mut second, plan, &[]);
    assert_eq!(answer, Some(MavMissionResult::MAV_MISSION_NO_SPACE));
    second.send(&mut world, &count(0));
    assert_eq!(answer_requests(&mut world, &mut second, plan, &[]), ACCEPTED);
    assert!(world.pilot().mission().items.is_empty());
}

/// Jumps are counted, delays waited for, and the mission goes on behind them.
#[test]
fn prop_jumps_are_flown_as_often_as_they_say() {
    let mut world = world(1);
    let mut ground = Ground::new();
    let mut items = vec![
        item(MavCmd::MAV_CMD_NAV_TAKEOFF, [5.0, 5.0, -1.2], 0.0),
        item(MavCmd::MAV_CMD_NAV_WAYPOINT, [5.5, 5.0, -1.2], 0.0),
        item(MavCmd::MAV_CMD_NAV_WAYPOINT, [5.0, 5.0, -1.2], 0.0),
    ];
    let mut jump = item(MavCmd::MAV_CMD_DO_JUMP, [0.0; 3], 1.0);
    jump.param2 = 2.0;
    items.push(jump);
    items.push(item(MavCmd::MAV_CMD_CONDITION_DELAY, [0.0; 3], 0.5));
    items.push(item(MavCmd::MAV_CMD_NAV_LAND, [0.0; 3], 0.0));
    assert_eq!(upload_as(&mut world, &mut ground, T::MAV_MISSION_TYPE_MISSION, &items), ACCEPTED);
    let start = ground.command(&mut world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
    assert_eq!(start, Some(MavResult::MAV_RESULT_ACCEPTED));
    arm(&mut world, &mut ground);
    until(&mut world, Mode::Mission, 20.0);
    let mut reached = Vec::new();
    while world.pilot().mode() != Mode::Disarmed {
        fly_for(&mut world, 0.1);
        ground.listen(&mut world);
        while let Some(seq) = ground.take(|m| match m {
            MavMessage::MISSION_ITEM_REACHED(r) => Some(r.seq),
            _ => None,
        }) {
            reached.push(seq);
        }
        assert!(world.t_us() < 120_000_000, "{reached:?}");
    }
    assert_eq!(reached, [0, 1, 2, 1, 2, 1, 2, 3, 4, 5]);
    assert_landed(&world, &ground.texts);
}

#[test]
fn prop_a_return_flies_to_the_nearer_rally_point() {
    let mut world = world(4);
    let mut ground = Ground::new();
    let rally = [item(MavCmd::MAV_CMD_NAV_RALLY_POINT, [7.5, 5.0, 0.0], 0.0)];
    assert_eq!(upload_as(&mut world, &mut ground, T::MAV_MISSION_TYPE_RALLY, &rally), ACCEPTED);
    let (mut world, mut ground) = hovering(world);
    ground.goto(&mut world, [8.0, 5.0, -1.2]);
    fly_for(&mut world, 10.0);
    ground.command(&mut world, MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, [0.0; 7]);
    until(&mut world, Mode::Disarmed, 40.0);
    let pos = world.truth().pos_E_m;
    assert!((pos.x() - 7.5).abs() < 0.7, "{pos:?}");
}

/// MAVSDK takes a mission for finished with its last item: that is the landing, which is done when the vehicle stands.
#[test]
fn regress_a_mission_is_not_finished_in_the_air() {
    let mut world = world(6);
    let mut ground = Ground::new();
    assert_eq!(ground.upload(&mut world, &square()), ACCEPTED);
    arm(&mut world, &mut ground);
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    let last = square().len() as u16 - 1;
    let mut heard = Vec::new();
    until(&mut world, Mode::Land, 90.0);
    while world.pilot().mode() != Mode::Disarmed {
        fly_for(&mut world, 0.1);
        ground.listen(&mut world);
        while let Some(seq) = ground.take(|m| match m {
            MavMessage::MISSION_ITEM_REACHED(r) => Some(r.seq),
            _ => None,
        }) {
            assert!(seq < last || world.truth().on_ground, "{:?}", world.truth());
            heard.push(seq);
        }
        assert!(world.t_us() < 150_000_000);
    }
    assert_eq!(heard.last(), Some(&last));
}

/// MISSION_START names the item after which the mission ends.
#[test]
fn regress_a_mission_ends_after_the_last_item_that_was_named() {
    let mut world = world(6);
    let mut ground = Ground::new();
    assert_eq!(ground.upload(&mut world, &square()), ACCEPTED);
    let start = MavCmd::MAV_CMD_MISSION_START;
    let beyond = ground.command(&mut world, start, [0.0, 60.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(beyond, Some(MavResult::MAV_RESULT_DENIED));
    let answer = ground.command(&mut world, start, [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    arm(&mut world, &mut ground);
    until(&mut world, Mode::Mission, 20.0);
    until(&mut world, Mode::Hold, 20.0);
    let pos = world.truth().pos_E_m;
    assert!((pos.x() - 6.0).abs() < 0.4 && (pos.y() - 5.0).abs() < 0.4, "{pos:?}");
    // Asked for anew it goes on, to its own end.
    let answer = ground.command(&mut world, start, [0.0; 7]);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    until(&mut world, Mode::Land, 60.0);
}
