//! Soft walls: however fast the vehicle flies at them, it stops before the hard ones, in truth.

use super::*;

/// Who flies it at the wall.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Way {
    /// A client's velocity.
    Velocity,
    /// A client's position at the wall; one outside is refused.
    Position,
    /// A leg to a point at the wall.
    Goto,
    /// The same in a mission.
    Mission,
    /// A joystick at its stop.
    Manual,
}

const WAYS: [Way; 5] = [Way::Velocity, Way::Position, Way::Goto, Way::Mission, Way::Manual];
/// Walls of the test, N and E, and the ceiling, m.
const WALLS_M: [f64; 2] = [2.2, 7.8];
const CEILING_M: f64 = 3.0;
/// From the middle to a point that is not outside by rounding, m.
const EDGE_M: f64 = 2.79;
/// North, east, up.
const DIRECTIONS: [[f64; 3]; 7] = [
    [1.0, 0.0, 0.0],
    [-1.0, 0.0, 0.0],
    [0.0, 1.0, 0.0],
    [0.0, -1.0, 0.0],
    [0.7, 0.7, 0.0],
    [-0.7, 0.7, 0.3],
    [0.0, 0.0, 1.0],
];

#[derive(Debug, Clone, Copy)]
struct Run {
    way: Way,
    towards: [f64; 3],
    speed_mps: f64,
    /// Wind towards the wall and a weak battery.
    hard: bool,
}

fn fly_at_wall(run: Run) -> f64 {
    let Run { way, towards, speed_mps, hard } = run;
    let world = hall(40, |_, pilot| {
        pilot.limits.north_m = Some(WALLS_M);
        pilot.limits.east_m = Some(WALLS_M);
        pilot.limits.height_m = Some(CEILING_M);
        pilot.control.limits.horizontal_mps = speed_mps.min(4.0);
        pilot.control.limits.vertical_mps = speed_mps.min(3.0);
        pilot.control.limits.tilt_deg = 52.0;
        pilot.flight.cruise_acceleration_mps2 = 5.0;
        if way == Way::Manual {
            pilot.flight.cruise_speed_mps = speed_mps;
        }
        pilot.limits.battery_low_v = 3.5;
        pilot.limits.battery_critical_v = 3.4;
    });
    let (mut world, mut ground) = hovering(world);
    let [n, e, up] = towards;
    let start = [5.0 - 2.6 * n, 5.0 - 2.6 * e, -1.2];
    ground.goto(&mut world, start);
    fly_for(&mut world, 9.0);
    if hard {
        let values = vec![("north".into(), 0.6 * n), ("east".into(), 0.6 * e)];
        world.plant_mut().inject(Fault::EffectOn { id: "A5".into(), values }).unwrap();
        world.plant_mut().inject(Fault::BatteryDrop(0.8)).unwrap();
        fly_for(&mut world, 5.0);
    }
    let edge = [
        5.0 + EDGE_M * n.signum() * f64::from(n != 0.0),
        5.0 + EDGE_M * e.signum() * f64::from(e != 0.0),
    ];
    let edge_down = if up > 0.0 { 0.01 - CEILING_M } else { -1.2 };
    let set_speed = [1.0, speed_mps as f32, -1.0, 0.0, 0.0, 0.0, 0.0];
    match way {
        Way::Goto => {
            ground.command(&mut world, MavCmd::MAV_CMD_DO_CHANGE_SPEED, set_speed);
            let answer = ground.goto(&mut world, [edge[0], edge[1], edge_down]);
            assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED), "{:?}", ground.texts);
        }
        Way::Mission => {
            let mut speed = item(MavCmd::MAV_CMD_DO_CHANGE_SPEED, [0.0; 3], 1.0);
            speed.param2 = speed_mps as f32;
            let point = [edge[0], edge[1], edge_down];
            let waypoint = item(MavCmd::MAV_CMD_NAV_WAYPOINT, point, 5.0);
            ground.upload(&mut world, &[speed, waypoint]);
            let start = ground.command(&mut world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
            assert_eq!(start, Some(MavResult::MAV_RESULT_ACCEPTED), "{:?}", ground.texts);
        }
        _ => {}
    }
    let mut worst_m: f64 = 0.0;
    for step in 0..160 {
        // The weak battery lets it sink beside the wall: what the floor then does to it is no matter of walls.
        if hard && world.truth().height_m < 0.05 {
            break;
        }
        match way {
            Way::Velocity => {
                let vel = [n, e, -up].map(|d| (d * speed_mps) as f32);
                velocity(&mut ground, &mut world, vel);
            }
            Way::Position => position(&mut ground, &mut world, [edge[0], edge[1], edge_down]),
            Way::Manual => {
                // Body axes: the vehicle looks north.
                let stick = |share: f64| (share.clamp(-1.0, 1.0) * 1000.0) as i16;
                let message = MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA {
                    x: stick(1.5 * n),
                    y: stick(1.5 * e),
                    z: 500 + stick(up) / 2,
                    target: 1,
                    ..Default::default()
                });
                ground.send(&mut world, &message);
            }
            _ => {}
        }
        if step == 2 && matches!(way, Way::Velocity | Way::Position | Way::Manual) {
            let mode = if way == Way::Manual { MANUAL } else { OFFBOARD };
            let answer = ground.command(&mut world, MavCmd::MAV_CMD_DO_SET_MODE, mode);
            assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED), "{run:?} {:?}", ground.texts);
        }
        let end_us = world.t_us() + 50_000;
        while world.t_us() < end_us {
            world.step();
            let pos = world.truth().pos_E_m;
            let out = |x: f64| (WALLS_M[0] - x).max(x - WALLS_M[1]);
            worst_m = worst_m.max(out(pos.x())).max(out(pos.y())).max(-pos.z() - CEILING_M);
        }
        ground.listen(&mut world);
    }
    let ended = |t: &&String| t.contains("beyond the hard wall") || t.contains("descend: ");
    let told = ground.texts.iter().find(ended);
    assert!(told.is_none() && !world.truth().crashed, "{run:?}: {:#?}", ground.texts);
    worst_m
}

/// Number of the mode for a joystick, as stations send it.
const MANUAL: [f32; 7] = [1.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0];

pub(super) fn position(ground: &mut Ground, world: &mut Lockstep, pos_m: [f64; 3]) {
    let message = MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
        type_mask: PositionTargetTypemask::from_bits_truncate(0xDF8),
        x: pos_m[0] as f32,
        y: pos_m[1] as f32,
        z: pos_m[2] as f32,
        ..Default::default()
    });
    ground.send(world, &message);
}

#[test]
fn prop_no_speed_carries_it_through_the_soft_wall_to_the_hard_one() {
    let mut runs = Vec::new();
    for way in WAYS {
        for towards in DIRECTIONS {
            for speed_mps in [0.5, 1.0, 2.0, 3.0, 4.0, 10.0] {
                for hard in [false, true] {
                    runs.push(Run { way, towards, speed_mps, hard });
                }
            }
        }
    }
    let mut worst: Vec<(f64, Run)> =
        runs.into_par_iter().map(|run| (fly_at_wall(run), run)).collect();
    worst.sort_by(|a, b| b.0.total_cmp(&a.0));
    for (m, run) in worst.iter().take(12) {
        println!("{m:.2} m beyond: {run:?}");
    }
    let most_m = PilotConfig::default().supervisor.wall_hard_m;
    assert!(
        worst.iter().all(|(m, _)| *m < most_m),
        "{} flights beyond",
        worst.iter().filter(|(m, _)| *m >= most_m).count()
    );
}

/// Points outside were moved inside without a word, and the default volume was the walls themselves.
#[test]
fn regress_points_outside_are_refused_and_the_default_volume_keeps_the_wings_off_the_walls() {
    let (mut world, mut ground) = hovering(hall(50, |_, _| {}));
    let inside = [5.5, 5.0, -1.2];
    let stream = |world: &mut Lockstep, ground: &mut Ground, point: [f64; 3], count: usize| {
        let mut farthest: f64 = 0.0;
        for _ in 0..count {
            position(ground, world, point);
            for _ in 0..50 {
                world.step();
                farthest = farthest.max(world.truth().pos_E_m.x());
            }
            ground.listen(world);
        }
        farthest
    };
    stream(&mut world, &mut ground, inside, 3);
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_DO_SET_MODE, OFFBOARD);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    stream(&mut world, &mut ground, inside, 60);
    for outside in [[12.0, 5.0, -1.2], [9.8, 5.0, -1.2], [5.0, -0.2, -1.2], [5.5, 5.0, -6.9]] {
        stream(&mut world, &mut ground, outside, 40);
        let pos = world.truth().pos_E_m;
        let away_m = (pos.x() - inside[0]).hypot(pos.y() - inside[1]);
        assert!(away_m < 0.5 && -pos.z() < 1.7, "{outside:?}: {pos:?}");
        assert_eq!(world.pilot().mode(), Mode::Offboard);
    }
    let told: Vec<_> = ground.texts.iter().filter(|t| t.contains("setpoint refused")).collect();
    for outside in ["N 12.00 m is", "N 9.80 m is", "E -0.20 m is", "height 6.90 m is"] {
        let times = told.iter().filter(|t| t.contains(outside)).count();
        assert!((1..=2).contains(&times), "{outside} {times} times in 8 s: {told:?}");
    }
    assert!(told[0].contains("outside the limits, allowed 0.45 to 9.55 m"), "{told:?}");
    let farthest = stream(&mut world, &mut ground, [9.54, 5.0, -1.2], 160);
    println!("at the edge: N {farthest:.2}");
    assert!((9.3..9.75).contains(&farthest), "{farthest}");
}
