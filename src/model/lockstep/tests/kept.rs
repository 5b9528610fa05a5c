//! What was kept over a restart and cannot be read back: told to whoever comes, and nothing arms until somebody
//! has put it right.

use haltere_dialect::mav::haltere::{
    HEARTBEAT_DATA, MISSION_CLEAR_ALL_DATA, MavMessage, MavMissionType,
};

use super::services::{ACCEPTED, upload_as};
use super::*;
use MavMissionType as T;
use haltere_pilot::services::{FileFault, FileTask, PARAMETERS_TICKET, Plan, encode_plan};
use haltere_pilot::{Input, LinkId};

/// A world whose disk answers so to the question for one list; the others were never kept.
fn restarted(plan: Plan, answer: Result<Vec<u8>, FileFault>) -> (Lockstep, Ground) {
    let plant = PlantConfig::hall(1);
    let survey = plant.survey.clone();
    let pilot = PilotConfig { store: true, ..pilot_config(&plant) };
    let disk = move |task: &FileTask| match task {
        FileTask::LoadPlan(asked) if *asked == plan => answer.clone(),
        _ => Ok(Vec::new()),
    };
    let world = Lockstep::new(plant, pilot, &survey).unwrap().with_disk(Box::new(disk));
    newcomer(world)
}

/// Whoever comes when all has been said.
fn newcomer(mut world: Lockstep) -> (Lockstep, Ground) {
    fly_for(&mut world, 6.0);
    world.clear_ground_out_of(0);
    world.input(Input::LinkUp { link: LinkId::Ground(0) });
    let mut ground = Ground::new();
    ground.send(&mut world, &MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()));
    fly_for(&mut world, 0.1);
    ground.listen(&mut world);
    (world, ground)
}

fn arms(world: &mut Lockstep, ground: &mut Ground) -> bool {
    let answer = ground.command(world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    answer == Some(MavResult::MAV_RESULT_ACCEPTED)
}

fn clear(world: &mut Lockstep, ground: &mut Ground, mission_type: MavMissionType) {
    let message = MISSION_CLEAR_ALL_DATA {
        target_system: 1,
        target_component: 1,
        mission_type: mission_type as u8,
    };
    ground.send(world, &MavMessage::MISSION_CLEAR_ALL(message));
    fly_for(world, 0.2);
}

fn said(ground: &Ground, what: &str) -> bool {
    ground.texts.iter().any(|t| t.contains(what))
}

#[test]
fn regress_what_was_lost_is_told_to_newcomers_and_forbids_arming_until_it_is_put_right() {
    let corner = MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION;
    let fence = [[3.0, 3.0], [3.0, 7.0], [7.0, 7.0], [7.0, 3.0]]
        .map(|[n, e]| item(corner, [n, e, 0.0], 4.0));
    let whole = encode_plan(&fence);
    let damaged = whole[..whole.len() - 7].to_vec();
    for (plan, kind, name) in [
        (Plan::Fence, T::MAV_MISSION_TYPE_FENCE, "fence"),
        (Plan::Rally, T::MAV_MISSION_TYPE_RALLY, "rally points"),
        (Plan::Mission, T::MAV_MISSION_TYPE_MISSION, "mission"),
    ] {
        for answer in [Ok(damaged.clone()), Err(FileFault::Nonsense), Err(FileFault::Failed)] {
            let (mut world, mut ground) = restarted(plan, answer.clone());
            let lost = format!("{name} not restored: ");
            assert!(said(&ground, &lost), "{answer:?}: {:?}", ground.texts);
            assert!(!arms(&mut world, &mut ground), "{name} {answer:?}");
            assert!(said(&ground, &format!("arming refused: {lost}")), "{:?}", ground.texts);
            let (mut world, mut ground) = newcomer(world);
            assert!(said(&ground, &lost), "the second newcomer: {:?}", ground.texts);
            clear(&mut world, &mut ground, kind);
            assert!(arms(&mut world, &mut ground), "{name} cleared: {:?}", ground.texts);
        }
    }
    // Uploaded anew.
    let (mut world, mut ground) = restarted(Plan::Fence, Err(FileFault::Nonsense));
    assert_eq!(upload_as(&mut world, &mut ground, T::MAV_MISSION_TYPE_FENCE, &fence), ACCEPTED);
    let (mut world, mut ground) = newcomer(world);
    assert!(!said(&ground, "not restored"), "{:?}", ground.texts);
    assert!(arms(&mut world, &mut ground), "{:?}", ground.texts);
    // Never kept, and kept whole: not a word.
    for answer in [Ok(Vec::new()), Err(FileFault::NotFound), Ok(whole)] {
        let (mut world, mut ground) = restarted(Plan::Fence, answer);
        assert!(!said(&ground, "not restored") && arms(&mut world, &mut ground));
    }
}

/// A disk that says nothing is not an empty one.
#[test]
fn regress_a_disk_that_does_not_answer_has_lost_what_was_kept() {
    let plant = PlantConfig::hall(1);
    let survey = plant.survey.clone();
    let pilot = PilotConfig { store: true, ..pilot_config(&plant) };
    let (mut world, mut ground) = newcomer(Lockstep::new(plant, pilot, &survey).unwrap());
    assert!(said(&ground, "fence not restored: the disk does not answer"), "{:?}", ground.texts);
    assert!(!arms(&mut world, &mut ground));
    clear(&mut world, &mut ground, T::MAV_MISSION_TYPE_ALL);
    assert!(arms(&mut world, &mut ground), "{:?}", ground.texts);
}

/// Parameters are read before the core begins: glue tells what became of them.
#[test]
fn regress_lost_parameters_are_told_too() {
    let mut world = world(1);
    let bytes = b"crc32 is 00000000, line 1 says 12345678";
    let result = Err(FileFault::Nonsense);
    world.input(Input::File { ticket: PARAMETERS_TICKET, result, bytes });
    let (mut world, mut ground) = newcomer(world);
    assert!(said(&ground, "parameters not restored: crc32"), "{:?}", ground.texts);
    assert!(!arms(&mut world, &mut ground));
    assert!(said(&ground, "set them, or reset them"), "{:?}", ground.texts);
    assert!(!world.pilot().mode().has_thrust());
}
