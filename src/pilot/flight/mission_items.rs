//! Uploaded items, checked: from the wire to [`MissionItem`].
//!
//! Frames: LOCAL_NED (x and y in 0.1 mm), GLOBAL and GLOBAL_INT (heights above sea level),
//! GLOBAL_RELATIVE_ALT and its twin (heights above home, which is the floor), and MISSION for items
//! without a place. Others are refused by name. Yaw counts from true north in a global frame and
//! from room north in the local one.

use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd, MavFrame, MavMissionResult};
use haltere_dialect::mav::{known, name_of};

use haltere_core::checks::shown;
use haltere_core::frames::{E, Vec3};
use haltere_core::geo::{Geodetic, LocalOrigin};

use super::excitation::Doublet;
use super::mission::{LOWEST_M, MissionItem};
use super::place::LOCAL_SCALE;
use super::tilt_step::{Envelope, TiltStep};

/// The frame that counts from the room's origin, on the wire.
const LOCAL_NED: u8 = MavFrame::MAV_FRAME_LOCAL_NED as u8;
/// Highest voltage that can be waited for, V: as for `limits.battery_low_v`.
const HIGHEST_WAIT_V: f64 = 30.0;
/// Longest wait at a place, s.
const LONGEST_S: f64 = 3600.0;
/// Most repetitions of a jump.
const MOST_JUMPS: f64 = 65_535.0;

/// What the protocol answers, and a sentence for people.
pub(crate) type Refusal = (MavMissionResult, String);

/// What items are checked against.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Room<'a> {
    pub envelope: &'a Envelope,
    pub origin: Option<LocalOrigin>,
}

/// NaN on the wire means "not given".
fn given(value: f32) -> Option<f64> {
    value.is_finite().then_some(f64::from(value))
}

/// Whether a frame counts from the globe.
pub(crate) fn is_global(frame: u8) -> bool {
    use MavFrame as F;
    matches!(
        known(frame),
        Some(
            F::MAV_FRAME_GLOBAL
                | F::MAV_FRAME_GLOBAL_INT
                | F::MAV_FRAME_GLOBAL_RELATIVE_ALT
                | F::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        )
    )
}

/// The place of an item in the room, wherever that is.
pub(crate) fn place_E_m(
    item: &MISSION_ITEM_INT_DATA,
    origin: Option<&LocalOrigin>,
) -> Result<Vec3<E>, Refusal> {
    use MavFrame as F;
    let seq = item.seq;
    let z = f64::from(item.z);
    if item.frame == LOCAL_NED {
        let [x, y] = [item.x, item.y].map(|v| f64::from(v) * LOCAL_SCALE);
        return Ok(Vec3::new(x, y, z));
    }
    if !is_global(item.frame) {
        let why = format!(
            "item {seq}: frame {} not supported, use LOCAL_NED, GLOBAL or GLOBAL_RELATIVE_ALT",
            name_of::<F>(item.frame),
            seq = seq.saturating_add(1)
        );
        return Err((MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME, why));
    }
    let Some(origin) = origin else {
        let why = format!(
            "item {seq}: the room has no origin on the globe, send one first",
            seq = seq.saturating_add(1)
        );
        return Err((MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME, why));
    };
    let above_sea =
        matches!(known(item.frame), Some(F::MAV_FRAME_GLOBAL | F::MAV_FRAME_GLOBAL_INT));
    let base_m = origin.place().alt_m;
    let height_m = if above_sea { z - base_m } else { z };
    match Geodetic::from_e7(item.x, item.y, base_m) {
        Some(place) => {
            let pos = origin.to_local(&place);
            Ok(Vec3::new(pos.x(), pos.y(), -height_m))
        }
        None => {
            let why = format!(
                "item {seq}: {} {} is not on the globe",
                item.x,
                item.y,
                seq = seq.saturating_add(1)
            );
            Err((MavMissionResult::MAV_MISSION_INVALID_PARAM5_X, why))
        }
    }
}

/// The yaw of an item from room north, rad.
fn yaw_rad(frame: u8, yaw_deg: f64, origin: Option<&LocalOrigin>) -> f64 {
    match origin {
        Some(origin) if frame != LOCAL_NED => origin.room_yaw_rad(yaw_deg.to_radians()),
        _ => yaw_deg.to_radians(),
    }
}

fn in_range(
    seq: u16,
    value: f64,
    [low, high]: [f64; 2],
    result: MavMissionResult,
    what: &str,
    unit: &str,
) -> Result<f64, Refusal> {
    if (low..=high).contains(&value) {
        Ok(value)
    } else {
        let [value, low, high] = [value, low, high].map(shown);
        let nth = seq.saturating_add(1);
        Err((result, format!("item {nth}: {what} = {value}, allowed {low} to {high} {unit}")))
    }
}

/// A place that may be flown to, or landed at.
fn place_inside(
    item: &MISSION_ITEM_INT_DATA,
    room: &Room<'_>,
    landing: bool,
) -> Result<Vec3<E>, Refusal> {
    let pos = place_E_m(item, room.origin.as_ref())?;
    let volume = &room.envelope.volume;
    let inside = if landing { volume.contains_over(pos) } else { volume.contains(pos) };
    if pos.is_finite() && inside {
        return Ok(pos);
    }
    let why = format!(
        "item {}: N {:.2} E {:.2} height {:.2} m is outside N {:.1} to {:.1}, E {:.1} to {:.1}, \
         height {LOWEST_M} to {:.1} m",
        item.seq.saturating_add(1),
        pos.x(),
        pos.y(),
        -pos.z(),
        volume.north_m[0],
        volume.north_m[1],
        volume.east_m[0],
        volume.east_m[1],
        volume.height_m
    );
    Err((MavMissionResult::MAV_MISSION_INVALID, why))
}

/// Checks an uploaded item. The error is what the protocol answers, and a sentence for people.
pub(crate) fn from_wire(
    item: &MISSION_ITEM_INT_DATA,
    room: &Room<'_>,
) -> Result<MissionItem, Refusal> {
    use MavMissionResult as R;
    let seq = item.seq;
    let envelope = room.envelope;
    let origin = room.origin.as_ref();
    // A zero point is what clients send for "here".
    let here = item.x == 0 && item.y == 0;
    let placed = is_global(item.frame) || item.frame == LOCAL_NED;
    let hold_s = |result| {
        in_range(seq, given(item.param1).unwrap_or(0.0), [0.0, LONGEST_S], result, "time", "s")
    };
    let Some(command) = known(item.command) else {
        let why = format!(
            "item {seq}: command {} not supported",
            item.command,
            seq = seq.saturating_add(1)
        );
        return Err((R::MAV_MISSION_UNSUPPORTED, why));
    };
    match command {
        MavCmd::MAV_CMD_NAV_TAKEOFF | MavCmd::MAV_CMD_NAV_TAKEOFF_LOCAL => {
            // Straight up, wherever the point is: on a take-off it is where the vehicle stands.
            let height_m = -place_E_m(item, origin)?.z();
            let allowed = [0.3, envelope.volume.height_m];
            let what = "take-off height";
            in_range(seq, height_m, allowed, R::MAV_MISSION_INVALID_PARAM7, what, "m")
                .map(|height_m| MissionItem::Takeoff { height_m })
        }
        MavCmd::MAV_CMD_NAV_WAYPOINT => {
            if seq == 0
                && is_global(item.frame)
                && place_E_m(item, origin).is_ok_and(|pos| -pos.z() < LOWEST_M)
            {
                // Planners of ArduPilot's habit (DroneKit, files of MAVProxy) begin with home.
                return Ok(MissionItem::Home);
            }
            Ok(MissionItem::Waypoint {
                pos_E_m: place_inside(item, room, false)?,
                hold_s: hold_s(R::MAV_MISSION_INVALID_PARAM1)?,
                acceptance_m: match given(item.param2) {
                    Some(radius_m) if radius_m > 0.0 => Some(in_range(
                        seq,
                        radius_m,
                        [0.05, 5.0],
                        R::MAV_MISSION_INVALID_PARAM2,
                        "acceptance radius",
                        "m",
                    )?),
                    _ => None,
                },
                yaw_rad: given(item.param4).map(|deg| yaw_rad(item.frame, deg, origin)),
            })
        }
        MavCmd::MAV_CMD_NAV_LOITER_UNLIM | MavCmd::MAV_CMD_NAV_LOITER_TIME => {
            let endless = command == MavCmd::MAV_CMD_NAV_LOITER_UNLIM;
            let hold_s =
                if endless { f64::INFINITY } else { hold_s(R::MAV_MISSION_INVALID_PARAM1)? };
            if here || !placed {
                return Ok(MissionItem::Delay { duration_s: hold_s });
            }
            let pos_E_m = place_inside(item, room, false)?;
            let yaw = if endless { given(item.param4) } else { None };
            let yaw_rad = yaw.map(|deg| yaw_rad(item.frame, deg, origin));
            Ok(MissionItem::Waypoint { pos_E_m, hold_s, acceptance_m: None, yaw_rad })
        }
        MavCmd::MAV_CMD_NAV_LAND if here || !placed => Ok(MissionItem::Land { pos_E_m: None }),
        MavCmd::MAV_CMD_NAV_LAND => {
            Ok(MissionItem::Land { pos_E_m: Some(place_inside(item, room, true)?) })
        }
        // Its fields are swapped: param5 is y, param6 is x (common.xml).
        MavCmd::MAV_CMD_NAV_LAND_LOCAL => {
            let swapped = MISSION_ITEM_INT_DATA {
                x: item.y,
                y: item.x,
                frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
                ..item.clone()
            };
            Ok(MissionItem::Land { pos_E_m: Some(place_inside(&swapped, room, true)?) })
        }
        MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH => Ok(MissionItem::Return),
        MavCmd::MAV_CMD_NAV_DELAY if given(item.param1).is_none_or(|s| s < 0.0) => {
            let why = format!(
                "item {seq}: a delay until a time of day is not supported",
                seq = seq.saturating_add(1)
            );
            Err((R::MAV_MISSION_INVALID_PARAM1, why))
        }
        MavCmd::MAV_CMD_NAV_DELAY | MavCmd::MAV_CMD_CONDITION_DELAY => {
            Ok(MissionItem::Delay { duration_s: hold_s(R::MAV_MISSION_INVALID_PARAM1)? })
        }
        MavCmd::MAV_CMD_DO_JUMP => {
            let target = given(item.param1).filter(|t| t.fract() == 0.0).unwrap_or(-1.0);
            let allowed = [0.0, f64::from(u16::MAX)];
            let result = R::MAV_MISSION_INVALID_PARAM1;
            let to = in_range(seq, target, allowed, result, "target of the jump", "")?;
            let times = given(item.param2).unwrap_or(0.0);
            let times = if times == -1.0 {
                None
            } else {
                let result = R::MAV_MISSION_INVALID_PARAM2;
                let range = [0.0, MOST_JUMPS];
                Some(in_range(seq, times, range, result, "repetitions (-1: for ever)", "")? as u32)
            };
            if to as u16 == seq {
                let why = format!("item {seq}: jumps to itself", seq = seq.saturating_add(1));
                return Err((R::MAV_MISSION_INVALID_PARAM1, why));
            }
            Ok(MissionItem::Jump { to: to as u16, times })
        }
        MavCmd::MAV_CMD_DO_CHANGE_SPEED => Ok(MissionItem::Speed {
            speed_mps: match given(item.param2) {
                Some(speed) if speed > 0.0 => Some(in_range(
                    seq,
                    speed,
                    [0.05, 20.0],
                    R::MAV_MISSION_INVALID_PARAM2,
                    "speed",
                    "m/s",
                )?),
                _ => None,
            },
        }),
        MavCmd::MAV_CMD_CONDITION_YAW => {
            let deg = in_range(
                seq,
                given(item.param1).unwrap_or(0.0),
                [-360.0, 360.0],
                R::MAV_MISSION_INVALID_PARAM1,
                "yaw",
                "deg",
            )?;
            if item.param4 == 1.0 {
                let sign = if item.param3 < 0.0 { -1.0 } else { 1.0 };
                return Ok(MissionItem::Yaw { yaw_rad: sign * deg.to_radians(), relative: true });
            }
            Ok(MissionItem::Yaw { yaw_rad: yaw_rad(item.frame, deg, origin), relative: false })
        }
        MavCmd::MAV_CMD_USER_1 => {
            let [axis, amplitude, half_s] = [item.param1, item.param2, item.param3].map(f64::from);
            Doublet::from_params(axis, amplitude, half_s).map(MissionItem::Doublet).map_err(|why| {
                (
                    R::MAV_MISSION_INVALID,
                    format!("item {seq}: doublet: {why}", seq = seq.saturating_add(1)),
                )
            })
        }
        MavCmd::MAV_CMD_USER_2 => {
            let params = [item.param1, item.param2, item.param3, item.param4].map(f64::from);
            TiltStep::from_params(params, f64::from(item.z))
                .and_then(|step| step.check(envelope).map(|()| MissionItem::Tilt(step)))
                .map_err(|why| {
                    (
                        R::MAV_MISSION_INVALID,
                        format!("item {seq}: tilt: {why}", seq = seq.saturating_add(1)),
                    )
                })
        }
        MavCmd::MAV_CMD_USER_3 => Ok(MissionItem::UntilVoltage {
            supply_v: in_range(
                seq,
                f64::from(item.param1),
                [envelope.battery_critical_v, HIGHEST_WAIT_V],
                R::MAV_MISSION_INVALID_PARAM1,
                "voltage",
                "V; below, the vehicle lands by itself",
            )?,
            limit_s: match given(item.param2) {
                Some(limit_s) if limit_s > 0.0 => in_range(
                    seq,
                    limit_s,
                    [1.0, LONGEST_S],
                    R::MAV_MISSION_INVALID_PARAM2,
                    "longest time",
                    "s",
                )?,
                _ => LONGEST_S,
            },
        }),
        other => Err((
            R::MAV_MISSION_UNSUPPORTED,
            format!("item {seq}: {other:?} not supported", seq = seq.saturating_add(1)),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::super::mission::{Volume, plan_id};
    use super::*;

    fn volume() -> Envelope {
        let volume = Volume { north_m: [-5.0, 5.0], east_m: [-5.0, 5.0], height_m: 3.0 };
        Envelope::new(volume, &Default::default(), 6.0)
    }

    /// Room north is 30 degrees from true north, the floor 500 m above the sea.
    fn origin() -> LocalOrigin {
        let place = Geodetic::from_deg(47.4, 8.5, 500.0).unwrap();
        LocalOrigin::new(place, 30.0_f64.to_radians()).unwrap()
    }

    fn check_one(item: &MISSION_ITEM_INT_DATA) -> Result<MissionItem, Refusal> {
        from_wire(item, &Room { envelope: &volume(), origin: Some(origin()) })
    }

    fn waypoint() -> MISSION_ITEM_INT_DATA {
        MISSION_ITEM_INT_DATA {
            command: MavCmd::MAV_CMD_NAV_WAYPOINT as u16,
            frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
            x: 10_000,
            y: -20_000,
            z: -1.5,
            param1: 2.0,
            param4: f32::NAN,
            ..Default::default()
        }
    }

    #[test]
    fn prop_local_items_are_read_in_metres() {
        assert_eq!(
            check_one(&waypoint()),
            Ok(MissionItem::Waypoint {
                pos_E_m: Vec3::new(1.0, -2.0, -1.5),
                hold_s: 2.0,
                acceptance_m: None,
                yaw_rad: None,
            })
        );
    }

    #[test]
    fn prop_refusals_name_the_item_and_the_reason() {
        let check = |item: MISSION_ITEM_INT_DATA, result, says: &str| {
            let (got, text) = check_one(&item).unwrap_err();
            assert_eq!(got, result);
            assert!(text.contains(says), "{text}");
        };
        use MavMissionResult as R;
        // What MAVProxy and QGroundControl send for a local frame: scaled by 1e7, 1000 times too far.
        let scaled = MISSION_ITEM_INT_DATA { x: 10_000_000, seq: 3, ..waypoint() };
        check(scaled, R::MAV_MISSION_INVALID, "item 4: N 1000.00");
        let body =
            MISSION_ITEM_INT_DATA { frame: MavFrame::MAV_FRAME_BODY_FRD as u8, ..waypoint() };
        check(body, R::MAV_MISSION_UNSUPPORTED_FRAME, "use LOCAL_NED");
        let nan = MISSION_ITEM_INT_DATA { z: f32::NAN, ..waypoint() };
        check(nan, R::MAV_MISSION_INVALID, "height NaN");
        let roi =
            MISSION_ITEM_INT_DATA { command: MavCmd::MAV_CMD_DO_SET_ROI as u16, ..waypoint() };
        check(roi, R::MAV_MISSION_UNSUPPORTED, "not supported");
        let floor = MISSION_ITEM_INT_DATA { z: 0.0, ..waypoint() };
        check(floor, R::MAV_MISSION_INVALID, "height 0.2 to 3.0 m");
        // A landing place lies on the floor.
        let land = MISSION_ITEM_INT_DATA {
            command: MavCmd::MAV_CMD_NAV_LAND as u16,
            z: 0.0,
            ..waypoint()
        };
        assert!(check_one(&land).is_ok());
    }

    #[test]
    fn prop_id_follows_the_content() {
        let id = |items: &[MISSION_ITEM_INT_DATA]| plan_id(items.iter());
        let moved = MISSION_ITEM_INT_DATA { x: 10_001, ..waypoint() };
        assert_ne!(id(&[waypoint()]), id(&[moved]));
        assert_eq!(id(&[waypoint()]), id(&[waypoint()]));
        assert_eq!(id(&[]), 0);
    }

    /// A place on the globe and the same place in the room are the same waypoint; heights above sea
    /// level and above home differ by the origin's.
    #[test]
    fn prop_global_items_are_turned_into_the_room() {
        let origin = origin();
        let [x, y] = origin.to_global(Vec3::new(1.0, -2.0, 0.0)).to_e7();
        use MavFrame as F;
        for (frame, z) in [
            (F::MAV_FRAME_GLOBAL, 501.5),
            (F::MAV_FRAME_GLOBAL_INT, 501.5),
            (F::MAV_FRAME_GLOBAL_RELATIVE_ALT, 1.5),
            (F::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, 1.5),
        ] {
            let frame = frame as u8;
            let item = MISSION_ITEM_INT_DATA { frame, x, y, z, param4: 90.0, ..waypoint() };
            let Ok(MissionItem::Waypoint { pos_E_m, yaw_rad, .. }) = check_one(&item) else {
                panic!("{frame:?}: {:?}", check_one(&item))
            };
            assert!((pos_E_m - Vec3::new(1.0, -2.0, -1.5)).norm() < 0.02, "{frame:?} {pos_E_m:?}");
            // Room north is 30 degrees from true north.
            assert!((yaw_rad.unwrap() - 60.0_f64.to_radians()).abs() < 1e-9);
        }
        let item = MISSION_ITEM_INT_DATA { frame: F::MAV_FRAME_GLOBAL as u8, x, y, ..waypoint() };
        let lost = Room { envelope: &volume(), origin: None };
        let (result, why) = from_wire(&item, &lost).unwrap_err();
        assert_eq!(result, MavMissionResult::MAV_MISSION_UNSUPPORTED_FRAME);
        assert!(why.contains("no origin"));
        let nowhere = MISSION_ITEM_INT_DATA { x: i32::MAX, ..item };
        assert!(check_one(&nowhere).unwrap_err().1.contains("not on the globe"));
    }

    #[test]
    fn prop_home_of_other_planners_is_no_waypoint() {
        let [x, y] = origin().to_global(Vec3::new(0.0, 0.0, 0.0)).to_e7();
        let home = MISSION_ITEM_INT_DATA {
            frame: MavFrame::MAV_FRAME_GLOBAL as u8,
            x,
            y,
            z: 500.0,
            ..waypoint()
        };
        assert_eq!(check_one(&home), Ok(MissionItem::Home));
        // Anywhere else it is a waypoint on the floor.
        assert!(check_one(&MISSION_ITEM_INT_DATA { seq: 1, ..home }).is_err());
    }

    #[test]
    fn prop_commands_without_a_place() {
        let bare = |command: MavCmd, param1: f32, param2: f32| MISSION_ITEM_INT_DATA {
            command: command as u16,
            param1,
            param2,
            seq: 2,
            frame: MavFrame::MAV_FRAME_MISSION as u8,
            ..Default::default()
        };
        let check = |item: MISSION_ITEM_INT_DATA, want: MissionItem| {
            assert_eq!(check_one(&item), Ok(want));
        };
        check(bare(MavCmd::MAV_CMD_NAV_DELAY, 3.0, 0.0), MissionItem::Delay { duration_s: 3.0 });
        check(
            bare(MavCmd::MAV_CMD_CONDITION_DELAY, 3.0, 0.0),
            MissionItem::Delay { duration_s: 3.0 },
        );
        check(
            bare(MavCmd::MAV_CMD_NAV_LOITER_UNLIM, 0.0, 0.0),
            MissionItem::Delay { duration_s: f64::INFINITY },
        );
        check(bare(MavCmd::MAV_CMD_NAV_LAND, 0.0, 0.0), MissionItem::Land { pos_E_m: None });
        let jump = |to, times| MissionItem::Jump { to, times };
        check(bare(MavCmd::MAV_CMD_DO_JUMP, 1.0, 4.0), jump(1, Some(4)));
        check(bare(MavCmd::MAV_CMD_DO_JUMP, 1.0, -1.0), jump(1, None));
        for (to, times, says) in [
            (2.0, 1.0, "jumps to itself"),
            (-1.0, 1.0, "target of the jump = -1"),
            (f32::NAN, 1.0, "target of the jump"),
            (1.0, -2.0, "repetitions"),
        ] {
            let item = bare(MavCmd::MAV_CMD_DO_JUMP, to, times);
            assert!(check_one(&item).unwrap_err().1.contains(says));
        }
        let noon = bare(MavCmd::MAV_CMD_NAV_DELAY, -1.0, 12.0);
        assert!(check_one(&noon).unwrap_err().1.contains("time of day"));
        let turn = MISSION_ITEM_INT_DATA {
            param3: -1.0,
            param4: 1.0,
            ..bare(MavCmd::MAV_CMD_CONDITION_YAW, 90.0, 0.0)
        };
        let yaw_rad = -90.0_f64.to_radians();
        check(turn, MissionItem::Yaw { yaw_rad, relative: true });
        let local = MISSION_ITEM_INT_DATA {
            command: MavCmd::MAV_CMD_NAV_LAND_LOCAL as u16,
            frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
            x: 20_000,
            y: 10_000,
            ..Default::default()
        };
        check(local, MissionItem::Land { pos_E_m: Some(Vec3::new(1.0, 2.0, 0.0)) });
    }
}
