//! Programs that collect data: angle steps, waiting for a voltage.

use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd, MavMissionResult};

use super::super::{Flight, Ground, Lockstep, fly};
use super::{item, pilot_config};
use crate::PlantConfig;
use haltere_core::control::Version;
use haltere_pilot::{Mode, PilotConfig};

const ROLL: f32 = 0.0;
const PITCH: f32 = 1.0;

fn tilt(axis: f32, angle_deg: f32, duration_s: f32, beyond: bool) -> MISSION_ITEM_INT_DATA {
    MISSION_ITEM_INT_DATA {
        param2: angle_deg,
        param3: duration_s,
        param4: f32::from(u8::from(beyond)),
        ..item(MavCmd::MAV_CMD_USER_2, [0.0; 3], axis)
    }
}

fn point(north: f64, east: f64, hold_s: f32) -> MISSION_ITEM_INT_DATA {
    item(MavCmd::MAV_CMD_NAV_WAYPOINT, [north, east, -2.5], hold_s)
}

/// Hall of the source; the thrust limit at full throttle, as 52° needs it.
fn hall(version: Version, seed: u64) -> Lockstep {
    let plant = PlantConfig::hall(seed);
    let survey = plant.survey.clone();
    let mut pilot = pilot_config(&plant);
    pilot.control.version = version;
    pilot.control.limits.thrust_max_frac = 1.0;
    // A net hangs where the anchors are: the steps need all of the room.
    pilot.limits.resolve_to_anchors(&survey);
    Lockstep::new(plant, pilot, &survey).unwrap().without_topics()
}

/// There and back along one axis through the hall.
fn there_and_back(axis: f32, angle_deg: f32) -> Vec<MISSION_ITEM_INT_DATA> {
    let [mut from, mut to] = [[5.0, 5.0]; 2];
    let along = usize::from(axis == ROLL);
    (from[along], to[along]) = (0.9, 9.1);
    // Nose down flies north, right side down flies east.
    let towards = if axis == PITCH { -1.0 } else { 1.0 };
    vec![
        item(MavCmd::MAV_CMD_NAV_TAKEOFF, [5.0, 5.0, -2.5], 0.0),
        point(from[0], from[1], 1.0),
        tilt(axis, towards * angle_deg, 4.0, true),
        point(to[0], to[1], 1.0),
        tilt(axis, -towards * angle_deg, 4.0, true),
        point(5.0, 5.0, 0.5),
        item(MavCmd::MAV_CMD_NAV_LAND, [0.0; 3], 0.0),
    ]
}

/// What a step of a flight did: the samples during which item `seq` was in force.
struct Flown {
    hold_s: f64,
    top_mps: f64,
    /// Least way to the wall that it flew towards, m.
    left_m: f64,
    height_m: [f64; 2],
}

fn flown(flight: &Flight, seq: u16, angle_rad: f64, pitch: bool) -> Flown {
    let mut hold = 0;
    let mut found = Flown {
        hold_s: 0.0,
        top_mps: 0.0,
        left_m: f64::INFINITY,
        height_m: [f64::INFINITY, f64::NEG_INFINITY],
    };
    for s in flight.samples.iter().filter(|s| s.mode == Mode::Mission && s.reached == seq) {
        let set = if pitch { s.control.pitch_rad } else { s.control.roll_rad };
        hold += u32::from((set - angle_rad).abs() < 1e-6);
        let (pos, vel) = (s.truth.pos_E_m, s.truth.vel_E_mps);
        found.top_mps = found.top_mps.max(vel.x().hypot(vel.y()));
        let along = if pitch { pos.x() } else { pos.y() };
        // Nose down flies north, right side down east.
        let up = (angle_rad < 0.0) == pitch;
        found.left_m = found.left_m.min(if up { 10.0 - along } else { along });
        let height_m = -pos.z();
        found.height_m = [found.height_m[0].min(height_m), found.height_m[1].max(height_m)];
    }
    found.hold_s = f64::from(hold) * 0.01;
    found
}

/// Every angle of the source, to both sides, through the hall of the source and back.
fn fly_steps(version: Version, mut judge: impl FnMut(f32, f32, usize, &Flown, &Flight)) {
    for (axis, angles) in
        [(PITCH, [12.0, 22.0, 33.0, 45.0, 52.0]), (ROLL, [12.0, 22.0, 33.0, 47.0, 52.0])]
    {
        for angle_deg in angles {
            let mut world = hall(version, 7);
            let flight = fly(&mut world, &there_and_back(axis, angle_deg), 120.0).unwrap();
            assert!(flight.landed, "{:?}", flight.texts);
            for (side, seq) in [2, 4].into_iter().enumerate() {
                let towards = if (axis == PITCH) == (side == 0) { -1.0 } else { 1.0 };
                let angle_rad = towards * f64::from(angle_deg).to_radians();
                let f = flown(&flight, seq, angle_rad, axis == PITCH);
                println!(
                    "{version:?} axis {axis} {angle_deg} deg side {side}: held {:.2} s, \
                     {:.2} m/s, {:.2} m left, height {:.2} to {:.2} m",
                    f.hold_s, f.top_mps, f.left_m, f.height_m[0], f.height_m[1]
                );
                judge(axis, angle_deg, side, &f, &flight);
            }
        }
    }
}

#[test]
fn val_steps_stop_inside() {
    fly_steps(Version::Modified, |axis, angle_deg, side, f, flight| {
        assert!(f.left_m > 0.3, "{angle_deg}: {} m left", f.left_m);
        assert!(f.height_m[0] > 1.7 && f.height_m[1] < 3.2, "{angle_deg}: {:?}", f.height_m);
        // The second 52 deg of a flight finds the battery too low, and that is said.
        if angle_deg == 52.0 && side == 1 {
            let said = |t: &String| t.contains("refused") && t.contains("1.62 times the hover");
            assert!(f.hold_s > 0.8 || flight.texts.iter().any(said), "{:?}", flight.texts);
            return;
        }
        assert!(f.hold_s > 0.8, "{angle_deg}: held {} s", f.hold_s);
        // Drag of the nominal vehicle is 4.2 1/s forward and 1.9 1/s sideways at least in order of
        // size: where the step lasted, the speed is that of the balance.
        if f.hold_s > 3.5 {
            let balance_mps = 9.81 * f64::from(angle_deg).to_radians().tan();
            let drag_per_s = balance_mps / f.top_mps;
            let range = if axis == PITCH { 3.0..5.0 } else { 1.6..2.6 };
            assert!(range.contains(&drag_per_s), "{angle_deg}: drag {drag_per_s:.2} 1/s");
        }
    });
}

#[test]
fn prop_steps_of_the_raw_version_stop_inside_too() {
    fly_steps(Version::Raw, |_, angle_deg, _, f, _| {
        assert!(f.left_m > 0.3, "{angle_deg}: {} m left", f.left_m);
    });
}

#[test]
fn prop_what_cannot_be_flown_is_refused_with_the_reason() {
    let refused = |item: MISSION_ITEM_INT_DATA, change: &dyn Fn(&mut PilotConfig), says: &str| {
        let plant = PlantConfig::hall(3);
        let survey = plant.survey.clone();
        let mut pilot = pilot_config(&plant);
        change(&mut pilot);
        let mut world = Lockstep::new(plant, pilot, &survey).unwrap();
        let mut ground = Ground::new();
        let answer = ground.upload(&mut world, &[item]);
        super::fly_for(&mut world, 0.5);
        ground.listen(&mut world);
        assert_eq!(answer, Some(MavMissionResult::MAV_MISSION_INVALID), "{:?}", ground.texts);
        assert!(ground.texts.iter().any(|t| t.contains(says)), "{says}: {:?}", ground.texts);
    };
    let same = |_: &mut PilotConfig| {};
    refused(tilt(PITCH, -50.0, 2.0, false), &same, "beyond control.limits.tilt_deg = 45.0");
    refused(tilt(PITCH, -53.0, 2.0, true), &same, "allowed 1 to 52 deg");
    refused(tilt(2.0, -10.0, 2.0, true), &same, "axis = 2");
    refused(tilt(ROLL, -10.0, 20.0, true), &same, "duration = 20");
    let small = |p: &mut PilotConfig| {
        p.limits.north_m = Some([3.0, 7.0]);
        p.limits.east_m = Some([3.0, 7.0]);
    };
    refused(tilt(ROLL, 47.0, 3.0, true), &small, "begin farther from the fence");
    let weak = |p: &mut PilotConfig| p.control.limits.thrust_max_frac = 0.85;
    refused(tilt(PITCH, 52.0, 2.0, true), &weak, "1.62 times the hover thrust");
    let empty = item(MavCmd::MAV_CMD_USER_3, [0.0; 3], 5.0);
    let mut world = hall(Version::Modified, 3);
    let answer = Ground::new().upload(&mut world, &[empty]);
    assert_eq!(answer, Some(MavMissionResult::MAV_MISSION_INVALID_PARAM1));
}

#[test]
fn prop_a_step_too_near_the_fence_is_left_out_and_the_flight_goes_on() {
    let mut world = hall(Version::Modified, 5);
    let items = [
        item(MavCmd::MAV_CMD_NAV_TAKEOFF, [5.0, 5.0, -2.5], 0.0),
        point(8.8, 5.0, 0.5),
        tilt(PITCH, -33.0, 3.0, false),
        item(MavCmd::MAV_CMD_NAV_LAND, [0.0; 3], 0.0),
    ];
    let flight = fly(&mut world, &items, 60.0).unwrap();
    assert!(flight.landed);
    let said = |t: &String| t.contains("item 3: pitch -33.0 deg refused") && t.contains("fence");
    assert!(flight.texts.iter().any(said), "{:?}", flight.texts);
    assert!(flight.samples.iter().all(|s| s.truth.pos_E_m.x() < 9.7));
}

#[test]
fn val_hover_ends_at_the_voltage_asked_for() {
    let mut world = hall(Version::Modified, 5);
    let items = [
        item(MavCmd::MAV_CMD_NAV_TAKEOFF, [5.0, 5.0, -1.2], 0.0),
        item(MavCmd::MAV_CMD_USER_3, [0.0; 3], 7.6),
        item(MavCmd::MAV_CMD_NAV_LAND, [0.0; 3], 0.0),
    ];
    let flight = fly(&mut world, &items, 400.0).unwrap();
    assert!(flight.landed);
    let hover: Vec<_> = flight.samples.iter().filter(|s| s.mode == Mode::Mission).collect();
    assert!(hover.len() > 1000, "over at once");
    // The thrust trembles, and the voltage with it.
    let last = &hover[hover.len() - 200..];
    let last_v = last.iter().map(|s| s.truth.supply_v).sum::<f64>() / last.len() as f64;
    println!("{:.0} s, {last_v:.3} V", hover.len() as f64 * 0.01);
    assert!((7.57..7.63).contains(&last_v), "{last_v}");
}
