//! What happens and why, as stations are told it: events, the fence, the date, programs, and what is cancelled.

use haltere_dialect::mav::haltere::{
    COMMAND_CANCEL_DATA, COMMAND_LONG_DATA, EVENT_DATA, FENCE_STATUS_DATA, FenceBreach, MavMessage,
    REQUEST_EVENT_DATA,
};
use haltere_dialect::mav::known;

use super::*;
use haltere_pilot::services::{FileFault, FileTask, encode_plan};
use haltere_pilot::{Endpoint, Identity, Input, LinkId};

const PATIENCE_US: u64 = 3_000_000;

/// Numbers of events, by their names in `events.json`.
const MODE_CHANGED: u32 = 1 << 24 | 1;
const ARMING_SUMMARY: u32 = 1 << 24 | 2;
const HEALTH_SUMMARY: u32 = 1 << 24 | 3;

fn px4_world(seed: u64) -> Lockstep {
    let plant = PlantConfig::hall(seed);
    let survey = plant.survey.clone();
    let mut pilot = pilot_config(&plant);
    let px4 = Endpoint { identity: Identity::Px4, ..Endpoint::default() };
    pilot.endpoints = vec![px4, Endpoint::default()];
    Lockstep::new(plant, pilot, &survey).unwrap()
}

fn events(world: &mut Lockstep, ground: &mut Ground) -> Vec<EVENT_DATA> {
    ground.listen(world);
    let mut all = Vec::new();
    while let Some(event) = ground.take(|m| match m {
        MavMessage::EVENT(event) => Some(event.clone()),
        _ => None,
    }) {
        all.push(event);
    }
    all
}

fn ask<T>(
    world: &mut Lockstep,
    ground: &mut Ground,
    msg_id: f32,
    pick: impl FnMut(&MavMessage) -> Option<T>,
) -> T {
    let params = [msg_id, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let answer = ground.command(world, MavCmd::MAV_CMD_REQUEST_MESSAGE, params);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED), "{msg_id}");
    ground.wait_for(world, PATIENCE_US, pick).unwrap()
}

#[test]
fn prop_events_count_without_holes_and_lost_ones_come_again() {
    let mut world = px4_world(1);
    let mut ground = Ground::new();
    let mut plain = Ground::at_endpoint(1, 254);
    plain.listen(&mut world);
    fly_for(&mut world, 12.0);
    arm(&mut world, &mut ground);
    fly_for(&mut world, 1.0);
    let all = events(&mut world, &mut ground);
    assert!(all.windows(2).all(|w| w[1].sequence == w[0].sequence + 1), "holes");
    // Nothing is aligned at first, later everything: a report for either, in the order of the protocol.
    let summaries: Vec<_> = all.iter().filter(|e| e.id == ARMING_SUMMARY).collect();
    assert!(summaries.len() >= 2, "{}", summaries.len());
    let can_arm = |e: &EVENT_DATA| e.arguments[9] != 0;
    assert!(!can_arm(summaries[0]) && can_arm(summaries.last().unwrap()));
    let begins = all.iter().filter(|e| e.id == ARMING_SUMMARY).count();
    let ends = all.iter().filter(|e| e.id == HEALTH_SUMMARY).count();
    assert_eq!(begins, ends);
    // disarmed, arming, idle by their numbers.
    let modes: Vec<_> = all.iter().filter(|e| e.id == MODE_CHANGED).collect();
    let of = |e: &EVENT_DATA| (e.arguments[0], e.arguments[1]);
    assert_eq!(modes.iter().map(|e| of(e)).collect::<Vec<_>>(), [(0, 1), (1, 2)]);
    // Texts that an event says too are marked; a station without events is sent plain ones alone.
    fly_for(&mut world, 0.1);
    ground.listen(&mut world);
    plain.listen(&mut world);
    assert!(ground.texts.contains(&"idle: board armed\t".to_owned()), "{:?}", ground.texts);
    assert!(plain.texts.contains(&"idle: board armed".to_owned()), "{:?}", plain.texts);
    assert!(events(&mut world, &mut plain).is_empty());

    let again = |first, last| {
        MavMessage::REQUEST_EVENT(REQUEST_EVENT_DATA {
            first_sequence: first,
            last_sequence: last,
            target_system: 1,
            target_component: 1,
        })
    };
    let last = all.last().unwrap();
    ground.send(&mut world, &again(last.sequence - 1, last.sequence));
    fly_for(&mut world, 0.1);
    assert_eq!(events(&mut world, &mut ground), all[all.len() - 2..]);
    ground.send(&mut world, &again(60_000, 60_000));
    let refused = ground.wait_for(&mut world, PATIENCE_US, |m| match m {
        MavMessage::RESPONSE_EVENT_ERROR(e) => Some((e.sequence, e.sequence_oldest_available)),
        _ => None,
    });
    assert_eq!(refused, Some((60_000, all[0].sequence)));
}

#[test]
fn prop_whoever_asks_for_events_gets_them_and_a_report() {
    let mut world = px4_world(2);
    let mut plain = Ground::at_endpoint(1, 254);
    fly_for(&mut world, 2.0);
    let on = [411.0, 500_000.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let answer = plain.command(&mut world, MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL, on);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    let (first, later) = [1, 0]
        .map(|flags| {
            plain.wait_for(&mut world, PATIENCE_US, |m| match m {
                MavMessage::CURRENT_EVENT_SEQUENCE(m) if m.flags.bits() == flags => {
                    Some(m.sequence)
                }
                _ => None,
            })
        })
        .into();
    assert!(first.is_some() && later >= first, "{first:?} {later:?}");
    events(&mut world, &mut plain);
    let answer = plain.command(&mut world, MavCmd::MAV_CMD_RUN_PREARM_CHECKS, [0.0; 7]);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    let report = events(&mut world, &mut plain);
    assert_eq!(report.first().map(|e| e.id), Some(ARMING_SUMMARY));
    assert_eq!(report.last().map(|e| e.id), Some(HEALTH_SUMMARY));
}

#[test]
fn prop_the_date_is_told_once_the_core_knows_it() {
    let mut world = world(3);
    let mut ground = Ground::new();
    let time = |m: &MavMessage| match m {
        MavMessage::SYSTEM_TIME(m) => Some(m.time_unix_usec),
        _ => None,
    };
    assert_eq!(ask(&mut world, &mut ground, 2.0, time), 0);
    let told_us = 1_795_000_000_000_000;
    world.input(Input::Calendar { unix_us: told_us });
    let from_us = world.t_us();
    fly_for(&mut world, 2.0);
    ground.listen(&mut world);
    while ground.take(time).is_some() {}
    let unix_us = ask(&mut world, &mut ground, 2.0, time);
    let expected_us = told_us as u64 + world.t_us() - from_us;
    assert!(unix_us.abs_diff(expected_us) < 30_000, "{unix_us} {expected_us}");
}

#[test]
fn prop_leaving_the_volume_is_counted_as_a_breach() {
    // Its border is where it stands by its own estimate on average: the noise of that takes it over.
    let within = |border_m: f64| {
        let plant = PlantConfig::hall(4);
        let survey = plant.survey.clone();
        let mut pilot = pilot_config(&plant);
        pilot.limits.east_m = Some([2.0, border_m]);
        hovering(Lockstep::new(plant, pilot, &survey).unwrap())
    };
    let (mut world, _) = within(8.0);
    let mut east_m = 0.0;
    for _ in 0..100 {
        fly_for(&mut world, 0.1);
        east_m += 0.01 * world.pilot().estimate().pos_E_m.y();
    }
    let (mut world, mut ground) = within(east_m);
    let status = |m: &MavMessage| match m {
        MavMessage::FENCE_STATUS(m) => Some(m.clone()),
        _ => None,
    };
    let mut seen: Vec<FENCE_STATUS_DATA> = Vec::new();
    for _ in 0..100 {
        fly_for(&mut world, 0.1);
        ground.listen(&mut world);
        while ground.take(status).is_some() {}
        seen.push(ask(&mut world, &mut ground, 162.0, status));
    }
    let inside = seen.iter().filter(|s| s.breach_status == 0).count();
    assert!((1..100).contains(&inside), "inside in {inside} of 100");
    assert!(seen.windows(2).all(|w| w[0].breach_count <= w[1].breach_count));
    let last = &seen[99];
    assert!((1..200).contains(&last.breach_count), "{}", last.breach_count);
    assert_eq!(last.breach_type, FenceBreach::FENCE_BREACH_BOUNDARY);
}

#[test]
fn prop_arming_that_waits_can_be_cancelled() {
    // The board falls silent just before.
    let silence: Damage = Box::new(|t_us, link, bytes| {
        if link == LinkId::Board && t_us > 8_000_000 {
            bytes.clear();
        }
    });
    let mut world = world(5).with_damage(silence);
    let mut ground = Ground::new();
    fly_for(&mut world, 8.01);
    let command = MavCmd::MAV_CMD_COMPONENT_ARM_DISARM;
    let order = MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
        param1: 1.0,
        command: command as u16,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    });
    ground.send(&mut world, &order);
    let cancel = MavMessage::COMMAND_CANCEL(COMMAND_CANCEL_DATA {
        command: command as u16,
        target_system: 1,
        target_component: 1,
    });
    fly_for(&mut world, 0.3);
    ground.send(&mut world, &cancel);
    let mut results: Vec<MavResult> = Vec::new();
    fly_for(&mut world, 0.1);
    ground.listen(&mut world);
    while let Some(result) = ground.take(|m| match m {
        MavMessage::COMMAND_ACK(ack) if ack.command == command as u16 => known(ack.result),
        _ => None,
    }) {
        results.push(result);
    }
    use MavResult as R;
    assert_eq!(results, [R::MAV_RESULT_IN_PROGRESS, R::MAV_RESULT_CANCELLED]);
    assert_eq!(world.pilot().mode(), Mode::Disarming);
}

#[test]
fn prop_at_every_quarter_of_a_program_people_are_told() {
    let plant = PlantConfig::hall(6);
    let survey = plant.survey.clone();
    let pilot = PilotConfig { store: true, ..pilot_config(&plant) };
    let disk = |task: &FileTask| match task {
        FileTask::LoadPlan(_) | FileTask::SavePlan(..) => Ok(Vec::new()),
        FileTask::LoadProgram(name) if name.is_empty() => Ok(b"square".to_vec()),
        FileTask::LoadProgram(_) => Ok(encode_plan(&square())),
        _ => Err(FileFault::NotFound),
    };
    let mut world = Lockstep::new(plant, pilot, &survey).unwrap().with_disk(Box::new(disk));
    let mut ground = Ground::new();
    let load = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_USER_4, load);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    arm(&mut world, &mut ground);
    until(&mut world, Mode::Mission, 20.0);
    while world.pilot().mode() != Mode::Disarmed && world.t_us() < 120_000_000 {
        fly_for(&mut world, 0.1);
        ground.listen(&mut world);
    }
    let told = |text: &str| ground.texts.iter().any(|t| t == text);
    assert!(told("program square: 50 %, item 3 of 6 done"), "{:?}", ground.texts);
}
