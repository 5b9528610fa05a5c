//! What is known at rest is asked before the motors turn.

use super::*;
use crate::faults::{Fault, Misreading, Sensor};
use haltere_core::frames::Vec3;
use haltere_core::survey::Survey;

/// What is answered and said to whoever arms a vehicle with this fault from the floor on.
fn arming(seed: u64, fault: Option<Fault>) -> (bool, Vec<String>) {
    let mut world = world(seed);
    if let Some(fault) = fault {
        world.plant_mut().inject(fault).unwrap();
    }
    arming_of(&mut world)
}

/// The same of a world: asked again until it is armed or 10 s are over.
fn arming_of(world: &mut Lockstep) -> (bool, Vec<String>) {
    let mut ground = Ground::new();
    fly_for(world, 4.0);
    for _ in 0..12 {
        let answer = ground.command(world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
        fly_for(world, 0.1);
        ground.listen(world);
        if answer == Some(MavResult::MAV_RESULT_ACCEPTED) {
            return (true, ground.texts);
        }
        fly_for(world, 0.4);
    }
    (false, ground.texts)
}

fn turned(sensor: Sensor, roll_deg: f64) -> Fault {
    let (sin, cos) = roll_deg.to_radians().sin_cos();
    let matrix = [[1.0, 0.0, 0.0], [0.0, cos, sin], [0.0, -sin, cos]];
    Fault::Misread(sensor, Misreading { matrix, ..Misreading::NONE })
}

fn more(sensor: Sensor, offset: [f64; 3]) -> Fault {
    Fault::Misread(sensor, Misreading { offset, ..Misreading::NONE })
}

fn times(sensor: Sensor, scale: f64) -> Fault {
    Fault::Misread(sensor, Misreading::scale([scale; 3]))
}

#[test]
fn regress_what_stands_with_a_sensor_that_is_wrong_is_not_armed() {
    use Sensor as S;
    let force = "accelerometer reads";
    let level = "accelerometer and board's attitude differ by";
    let gyroscope = "gyroscope reads";
    let battery = "2 cells do not have";
    for (fault, words) in [
        (times(S::Accelerometer, 0.8), force),
        (times(S::Accelerometer, 0.5), force),
        (times(S::Accelerometer, 1.1), force),
        (times(S::Accelerometer, 1.0 / 9.80665), force),
        (Fault::accelerometer_scale([1.0, 1.0, 0.8]), force),
        (more(S::Accelerometer, [0.0, 0.0, 1.0]), force),
        (more(S::Accelerometer, [1.0, 0.0, 0.0]), level),
        (Fault::accelerometer_scale([1.0, 1.0, -1.0]), level),
        (turned(S::Imu, 15.0), level),
        (turned(S::Imu, 45.0), level),
        (turned(S::Imu, 180.0), level),
        (turned(S::Attitude, 15.0), level),
        (times(S::Gyroscope, 57.3), gyroscope),
        (more(S::Gyroscope, [0.0, 0.3, 0.0]), gyroscope),
        (times(S::Battery, 1.5), battery),
        (times(S::Battery, 1.25), battery),
        (times(S::Battery, 0.5), battery),
    ] {
        let (armed, texts) = arming(1, Some(fault.clone()));
        let refused = texts.iter().any(|t| t.contains("arming refused") && t.contains(words));
        assert!(!armed && refused, "{fault:?}: {texts:#?}");
    }
}

#[test]
fn regress_an_accelerometer_of_a_few_percent_is_told_and_used_with_its_scale() {
    for (seed, scale) in [(1, 0.96), (2, 1.04)] {
        let mut world = world(seed);
        world.plant_mut().inject(times(Sensor::Accelerometer, scale)).unwrap();
        let (mut world, mut ground) = hovering(world);
        ground.listen(&mut world);
        let told =
            ground.texts.iter().any(|t| t.contains("arming with an accelerometer that reads"));
        assert!(told, "{scale}: {:#?}", ground.texts);
        let mut worst_m: f64 = 0.0;
        for _ in 0..50 {
            fly_for(&mut world, 0.1);
            let off_m = world.pilot().estimate().pos_E_m.z() - world.truth().pos_E_m.z();
            worst_m = worst_m.max(off_m.abs());
        }
        assert!(worst_m < 0.5 && world.pilot().mode() == Mode::Hold, "{scale}: {worst_m}");
    }
}

#[test]
fn regress_a_pressure_is_read_in_pascal_whoever_sends_it_and_arming_says_what_there_is() {
    let mut said = Vec::new();
    for scale in [1.0, 100.0, 0.1] {
        let (armed, texts) = arming(1, Some(times(Sensor::Barometer, scale)));
        assert!(armed, "{texts:#?}");
        said.push(texts.into_iter().find(|t| t.contains("barometer")).unwrap_or_default());
    }
    assert!(
        said[0].contains("barometer 101") && said[0].starts_with("at rest: gravity 9.8"),
        "{said:?}"
    );
    assert!(said[1].contains("barometer 101"), "{said:?}");
    assert!(said[2].contains("without barometer: the board sends a pressure of 101"), "{said:?}");
}

/// The survey has its floor so much above the one that the vehicle stands on, m.
fn in_a_pit(seed: u64, pit_m: f64) -> (bool, Vec<String>) {
    let plant = PlantConfig::hall(seed);
    let pilot = pilot_config(&plant);
    let told: Vec<_> = plant
        .survey
        .ids()
        .iter()
        .filter_map(|id| Some((*id, plant.survey.position_E_m(*id)? + Vec3::new(0.0, 0.0, pit_m))))
        .collect();
    let told = Survey::new(&told).unwrap();
    arming_of(&mut Lockstep::new(plant, pilot, &told).unwrap())
}

#[test]
fn regress_below_the_floor_of_the_survey_and_high_above_it_nothing_is_armed() {
    for seed in 1..4 {
        for (pit_m, words) in [
            (-1.6, "m above the floor by UWB"),
            (-0.4, ""),
            (0.0, ""),
            (0.4, ""),
            (1.0, "m below the floor by UWB"),
            (1.5, "m below the floor by UWB"),
        ] {
            let (armed, texts) = in_a_pit(seed, pit_m);
            let refused =
                texts.iter().any(|t| t.contains("arming refused: stands") && t.contains(words));
            assert_eq!(
                (armed, refused),
                (words.is_empty(), !words.is_empty()),
                "{pit_m} {seed}: {texts:#?}"
            );
        }
    }
}

/// A gyroscope that reads a turn about the vertical the other way round stands as any other. The mission turns, and flown by
/// that heading the vehicle left the room by 5 m.
#[test]
fn regress_a_gyroscope_that_turns_the_other_way_is_found_by_the_first_turn() {
    for seed in 0..4 {
        let mut world = world(seed);
        let matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]];
        let fault = Fault::Misread(Sensor::Gyroscope, Misreading { matrix, ..Misreading::NONE });
        world.plant_mut().inject(fault).unwrap();
        let (mut world, mut ground) = hovering(world);
        let from_m = world.truth().pos_E_m;
        let turn = [90.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0];
        ground.command(&mut world, MavCmd::MAV_CMD_CONDITION_YAW, turn);
        for _ in 0..40 {
            fly_for(&mut world, 0.5);
            ground.listen(&mut world);
        }
        let told = ground.texts.iter().any(|t| t.contains("attitude differs from the board's"));
        let far_m = (world.truth().pos_E_m.raw() - from_m.raw()).xy().norm();
        assert!(told && far_m < 2.0, "seed {seed}: {far_m} m {:#?}", ground.texts);
    }
}
