//! Gains as a set: what cannot fly is not armed with, and does not come about in the air.

use super::*;
use haltere_core::control::ControlGains;
use haltere_dialect::mav::haltere::{MavMessage, MavParamType, PARAM_SET_DATA};

fn set(world: &mut Lockstep, ground: &mut Ground, name: &str, value: f32) {
    let mut id = [0; 16];
    id.iter_mut().zip(name.bytes()).for_each(|(slot, byte)| *slot = byte);
    let message = MavMessage::PARAM_SET(PARAM_SET_DATA {
        param_value: value,
        target_system: 1,
        target_component: 1,
        param_id: id.into(),
        param_type: MavParamType::MAV_PARAM_TYPE_REAL32 as u8,
    });
    ground.send(world, &message);
    fly_for(world, 0.02);
    ground.listen(world);
}

#[test]
fn regress_gains_that_cannot_fly_are_refused_by_name_at_arming() {
    let ends =
        [[0.0; ControlGains::TUNABLES.len()], ControlGains::TUNABLES.map(|tunable| tunable.high)];
    for end in ends {
        let plant = PlantConfig::hall(61);
        let mut pilot = pilot_config(&plant);
        pilot.control.gains = ControlGains::from_vector(end);
        let survey = plant.survey.clone();
        let mut world = Lockstep::new(plant, pilot, &survey).unwrap();
        let mut ground = Ground::new();
        fly_for(&mut world, 8.0);
        let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
        assert_eq!(answer, Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
        ground.listen(&mut world);
        let refused = |t: &String| t.starts_with("arming refused: control.gains.");
        assert!(ground.texts.iter().any(refused), "{:?}", ground.texts);
    }
}

#[test]
fn regress_a_gain_that_would_spoil_the_flight_is_refused_in_the_air_and_taken_on_the_floor() {
    let mut world = world(62);
    let mut ground = Ground::new();
    fly_for(&mut world, 1.0);
    // On the floor any of the range, as long as it is mended before arming.
    set(&mut world, &mut ground, "GAN_VEL_Y_P", 0.9);
    set(&mut world, &mut ground, "GAN_VEL_Y_P", 0.3);
    let (mut world, mut ground) = hovering(world);
    set(&mut world, &mut ground, "GAN_VEL_Y_P", 0.9);
    set(&mut world, &mut ground, "GAN_POS_Z_P", 0.0);
    set(&mut world, &mut ground, "CLM_THR_MAX", 0.5);
    set(&mut world, &mut ground, "GAN_VEL_X_P", 0.3);
    let said = |what: &str| ground.texts.iter().any(|t| t.starts_with(what));
    assert!(said("parameter refused: GAN_VEL_Y_P = 0.9 cannot be flown: "), "{:?}", ground.texts);
    assert!(said("parameter refused: GAN_POS_Z_P = 0 cannot be flown: "), "{:?}", ground.texts);
    assert!(said("GAN_VEL_X_P = 0.3"), "{:?}", ground.texts);
    fly_for(&mut world, 4.0);
    let pos = world.truth().pos_E_m;
    assert!((pos.x() - 5.0).hypot(pos.y() - 5.0) < 0.4, "{pos:?}");
}
