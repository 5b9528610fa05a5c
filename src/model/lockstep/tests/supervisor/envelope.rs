//! Outside of the envelope of flight in truth: leaning too far, too fast, too high.

use super::*;
use crate::Truth;

/// Angle between body z and the vertical, degrees.
fn tilt_deg(truth: &Truth) -> f64 {
    let up = truth.R_EB.raw().to_rotation_matrix().matrix()[(2, 2)];
    up.clamp(-1.0, 1.0).acos().to_degrees()
}

/// Steps until another mode is in force; the largest of what is looked at meanwhile.
fn until_left(world: &mut Lockstep, mode: Mode, limit_s: f64, look: fn(&Truth) -> f64) -> f64 {
    let start_us = world.t_us();
    let mut most = f64::NEG_INFINITY;
    while world.pilot().mode() == mode {
        let elapsed_s = (world.t_us() - start_us) as f64 * 1e-6;
        assert!(elapsed_s < limit_s, "still {mode:?}: {most} {:?}", world.truth());
        world.step();
        most = most.max(look(&world.truth()));
    }
    most
}

/// A wing fails for a moment, high up: it tumbles almost, is caught by the board and comes down. (With 0.2 s of
/// it the vehicle is on its back, and no setpoint brings it back.)
#[test]
fn prop_a_vehicle_that_leans_too_far_comes_down_level() {
    for seed in 0..4 {
        let world = hall(seed, |_, pilot| {
            pilot.limits.height_m = Some(6.0);
            pilot.supervisor.tilt_most_deg = 55.0;
        });
        let (mut world, mut ground) = hovering(world);
        ground.goto(&mut world, [5.0, 5.0, -4.5]);
        fly_for(&mut world, 12.0);
        let mode = world.pilot().mode();
        let wing = |gain| Fault::WingThrust { wing: Some(seed as usize % 2), gain };
        world.plant_mut().inject(wing(0.0)).unwrap();
        fly_for(&mut world, 0.164);
        world.plant_mut().inject(wing(1.0)).unwrap();
        let most_deg = until_left(&mut world, mode, 2.0, tilt_deg);
        println!("seed {seed}: {most_deg:.0} deg, {:?}", world.pilot().mode());
        assert_eq!(world.pilot().mode(), Mode::Descend);
        assert!(most_deg > 55.0, "{most_deg}");
        assert_said(&mut world, &mut ground, "tilt ");
        assert_said(&mut world, &mut ground, "descend: tilt too high");
        assert_comes_down(&mut world, &mut ground, 30.0);
        assert_said(&mut world, &mut ground, "tilt is low again");
    }
}

/// A leg at twice the speed that is allowed, ordered by a station and in a mission.
#[test]
fn prop_a_vehicle_that_is_too_fast_lands() {
    let speed = |truth: &Truth| truth.vel_E_mps.norm();
    for seed in 0..3 {
        for as_mission in [false, true] {
            let world = hall(seed, |_, pilot| {
                pilot.control.limits.horizontal_mps = 3.5;
                pilot.control.limits.tilt_deg = 52.0;
                pilot.flight.cruise_speed_mps = 5.0;
                pilot.supervisor.speed_most_mps = 2.0;
            });
            let (mut world, mut ground) = hovering(world);
            let slow = world.pilot().mode();
            assert_eq!(slow, Mode::Hold);
            let mode = if as_mission {
                let point = [8.5, 6.5, -1.2];
                ground.upload(&mut world, &[item(MavCmd::MAV_CMD_NAV_WAYPOINT, point, 5.0)]);
                let start = ground.command(&mut world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
                assert_eq!(start, Some(MavResult::MAV_RESULT_ACCEPTED));
                Mode::Mission
            } else {
                ground.goto(&mut world, [8.5, 6.5, -1.2]);
                Mode::Goto
            };
            let most_mps = until_left(&mut world, mode, 4.0, speed);
            println!("seed {seed}: {most_mps:.1} m/s");
            assert_eq!(world.pilot().mode(), Mode::Land);
            assert!(most_mps > 2.0, "{most_mps}");
            assert_said(&mut world, &mut ground, "speed ");
            assert_said(&mut world, &mut ground, "land: too fast");
            assert_comes_down(&mut world, &mut ground, 20.0);
        }
    }
}

/// For a moment its wings carry much more than they are told: it leaps, and nothing tells that from an accelerometer
/// that reads twice the force. It comes down by neither.
#[test]
fn prop_a_vehicle_that_is_carried_by_more_than_its_thrust_comes_down() {
    let height = |truth: &Truth| truth.height_m;
    for (seed, phase) in [(0, Phase::Hover), (1, Phase::Hover), (2, Phase::Mission)] {
        let (mut world, mut ground) = aloft(world(seed), phase);
        let mode = world.pilot().mode();
        let lift = |gain| Fault::WingThrust { wing: None, gain };
        world.plant_mut().inject(lift(2.0)).unwrap();
        let most_m = until_left(&mut world, mode, 1.0, height);
        world.plant_mut().inject(lift(1.0)).unwrap();
        println!("seed {seed}: {most_m:.2} m");
        assert_eq!(world.pilot().mode(), Mode::Descend);
        assert!(most_m < 1.5, "{most_m}");
        assert_said(&mut world, &mut ground, "times the force of the thrust");
        assert_comes_down(&mut world, &mut ground, 20.0);
    }
}
