//! An estimate that its measurements do not fit.

use super::*;

/// What the accelerometer says of the vertical is wrong, and more so every second: the velocity of the
/// estimate is not that of its height any more. A landing, which flies by velocity, would climb.
#[test]
fn prop_an_accelerometer_that_drifts_is_found_before_it_leads_out() {
    let cases: Vec<_> =
        (0..6u64).flat_map(|seed| [false, true].map(|landing| (seed, landing))).collect();
    cases.into_par_iter().for_each(|(seed, landing)| {
        let world = hall(seed, |_, pilot| pilot.limits.height_m = Some(4.0));
        let (mut world, mut ground) = hovering(world);
        if landing {
            ground.goto(&mut world, [5.0, 5.0, -3.0]);
            fly_for(&mut world, 7.0);
        }
        world.plant_mut().inject(Fault::Accelerometer(FaultKind::Drift)).unwrap();
        if landing {
            let answer = ground.command(&mut world, MavCmd::MAV_CMD_NAV_LAND, [0.0; 7]);
            assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
        }
        let start_us = world.t_us();
        let mut most_m: f64 = 0.0;
        while world.pilot().mode() != Mode::Descend {
            assert!(world.t_us() - start_us < 15_000_000, "not found: {:?}", world.truth());
            world.step();
            most_m = most_m.max(world.truth().height_m);
        }
        let took_s = (world.t_us() - start_us) as f64 * 1e-6;
        println!("seed {seed} landing {landing}: after {took_s:.1} s, {most_m:.2} m at most");
        assert!(most_m < if landing { 3.2 } else { 1.8 }, "{most_m}");
        assert_comes_down(&mut world, &mut ground, 40.0);
        assert_said(&mut world, &mut ground, "faster than the vertical velocity says");
    });
}
