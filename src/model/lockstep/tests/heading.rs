//! The heading with a magnetometer on the board, and without one.

use super::*;
use crate::board::Firmware;
use crate::effects::EffectSet;
use crate::faults::Fault;
use haltere_core::frames::wrap_pi_rad;

/// Magnetic north of the room, deg.
const NORTH_DEG: f64 = 25.0;

fn fitted(
    seed: u64,
    fuse: bool,
    edit: impl FnOnce(&mut PlantConfig, &mut PilotConfig),
) -> Lockstep {
    let mut plant = PlantConfig::hall(seed);
    plant.start_yaw_rad = 0.8;
    plant.board.magnetometer.fitted = true;
    plant.board.magnetometer.north_deg = NORTH_DEG;
    let mut pilot = pilot_config(&plant);
    pilot.estimator.magnetometer.fuse = fuse;
    pilot.estimator.magnetometer.north_deg = NORTH_DEG;
    edit(&mut plant, &mut pilot);
    let survey = plant.survey.clone();
    Lockstep::new(plant, pilot, &survey).unwrap()
}

fn heading_error_deg(world: &Lockstep) -> f64 {
    let (ours, truth) = (world.pilot().estimate().R_EB, world.truth().R_EB);
    wrap_pi_rad(ours.yaw_rad() - truth.yaw_rad()).to_degrees()
}

/// The board was switched on anywhere: its north is 57 degrees from where the configuration has it.
fn unknown_north(_: &mut PlantConfig, pilot: &mut PilotConfig) {
    pilot.board_north_offset_rad = 1.0;
}

#[test]
fn prop_the_start_knows_the_heading_that_nobody_told() {
    let error_deg = |seed, fuse| {
        let mut world = fitted(seed, fuse, unknown_north);
        world.run_until(6_000_000);
        let mut ground = Ground::new();
        fly_for(&mut world, 0.5);
        ground.listen(&mut world);
        heading_error_deg(&world)
    };
    for seed in 1..7 {
        assert!(error_deg(seed, false).abs() > 45.0);
        let with_deg = error_deg(seed, true);
        // Two sigma of what steel in the floor and hard iron do here.
        assert!(with_deg.abs() < 25.0, "seed {seed}: {with_deg}");
    }
}

#[test]
fn prop_a_drifting_gyroscope_is_held_in_hover() {
    let error_deg = |fuse| {
        let world = fitted(4, fuse, |plant, _| {
            plant.effects = EffectSet::nominal();
        });
        let (mut world, mut ground) = hovering(world);
        let bias = Fault::EffectOn {
            id: "M5".into(),
            values: vec![("x".into(), 0.0), ("z".into(), 0.01)],
        };
        world.plant_mut().inject(bias).unwrap();
        fly_for(&mut world, 60.0);
        ground.listen(&mut world);
        assert_eq!(world.pilot().mode(), Mode::Hold, "{:?}", ground.texts);
        heading_error_deg(&world)
    };
    let (with_deg, without_deg) = (error_deg(true), error_deg(false));
    println!("after 60 s with 0.01 rad/s: {with_deg:.1} deg with, {without_deg:.1} deg without");
    assert!(with_deg.abs() < 20.0 && with_deg.abs() < 0.7 * without_deg.abs());
}

#[test]
fn prop_both_firmwares_bring_their_field_and_the_start_says_so() {
    for firmware in [Firmware::Generic, Firmware::Px4, Firmware::Ardupilot] {
        let mut world = fitted(2, true, |plant, _| plant.board.firmware = firmware);
        let mut ground = Ground::new();
        fly_for(&mut world, 9.0);
        ground.listen(&mut world);
        let told = ground
            .texts
            .iter()
            .any(|t| t.contains("magnetic field of 4") || t.contains("magnetic field of 5"));
        assert!(told, "{firmware:?}: {:?}", ground.texts);
    }
    // Asked for, and not there.
    let mut world = fitted(2, true, |plant, _| plant.board.magnetometer.fitted = false);
    let mut ground = Ground::new();
    fly_for(&mut world, 9.0);
    ground.listen(&mut world);
    assert!(
        ground.texts.iter().any(|t| t.contains("sends no magnetic field")),
        "{:?}",
        ground.texts
    );
    assert!(world.pilot().estimate().health == haltere_core::estimate::Health::Good);
}
