//! A survey that is wrong: the anchor is named before anything takes off.

use super::*;
use haltere_core::frames::{E, Vec3};
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;

/// Asks to arm for some seconds of a world in which the companion's survey has one anchor moved.
fn ask(seed: u64, start: [f64; 2], moved: Option<(u8, f64)>) -> (bool, Vec<String>) {
    let mut plant = PlantConfig::hall(seed);
    plant.start_E_m = Vec3::new(start[0], start[1], 0.0);
    let survey = plant.survey.clone();
    let told: Vec<(AnchorId, Vec3<E>)> = survey
        .ids()
        .iter()
        .map(|id| {
            let site = survey.position_E_m(*id).unwrap();
            let along = (site - plant.start_E_m).raw().normalize();
            let by_m = moved.filter(|(n, _)| *n == id.0).map_or(0.0, |(_, by_m)| by_m);
            (*id, site + Vec3::from_raw(along * by_m))
        })
        .collect();
    let told = Survey::new(&told).unwrap();
    let mut world = Lockstep::new(plant.clone(), pilot_config(&plant), &told).unwrap();
    let mut ground = Ground::new();
    world.run_until(7_000_000);
    let mut armed = false;
    for _ in 0..4 {
        armed |= ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM)
            == Some(MavResult::MAV_RESULT_ACCEPTED);
        fly_for(&mut world, 0.5);
        ground.listen(&mut world);
    }
    (armed, ground.texts)
}

#[test]
fn prop_an_anchor_surveyed_1_m_off_is_named_before_arming() {
    for id in 0..8u8 {
        // Where the companion believes it too far away, it reads too near.
        let (by_m, way) = if id % 2 == 0 { (1.0, "near") } else { (-1.0, "far") };
        let start = [4.0 + 0.3 * f64::from(id), 6.5 - 0.4 * f64::from(id)];
        let (armed, texts) = ask(u64::from(id) + 1, start, Some((id, by_m)));
        let named = |t: &String| {
            t.contains(&format!("anchor {id} does not fit")) && t.contains(&format!("m too {way}"))
        };
        assert!(!armed && texts.iter().any(named), "{id}: {texts:?}");
        let others =
            texts.iter().filter(|t| t.contains("does not fit the others") && !named(t)).count();
        assert_eq!(others, 0, "{id}: {texts:?}");
    }
}

#[test]
fn prop_a_sound_survey_is_armed_with() {
    for seed in 0..6u64 {
        let start = [2.5 + seed as f64, 7.5 - 0.7 * seed as f64];
        let (armed, texts) = ask(seed + 20, start, None);
        assert!(armed && !texts.iter().any(|t| t.contains("does not fit")), "{texts:?}");
    }
}
