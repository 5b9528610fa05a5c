//! What a fence forbids is not flown through, whoever flies and wherever home lies: judged by the truth.

use haltere_dialect::mav::haltere::{
    COMMAND_INT_DATA, HEARTBEAT_DATA, MANUAL_CONTROL_DATA, MavMessage, MavMissionResult,
    MavMissionType, PositionTargetTypemask, SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use haltere_dialect::mav::known;

use super::services::{ACCEPTED, upload_as};
use super::*;
use MavMissionType as T;
use haltere_pilot::Action;

/// Where the vehicle takes off, and where it is asked to come back from: a pillar stands between.
const HOME_M: [f64; 2] = [2.0, 5.0];
const AWAY_M: [f64; 2] = [8.0, 5.0];
const HEIGHT_M: f64 = 1.5;

#[derive(Debug, Clone, Copy)]
enum Pillar {
    Circle(f64),
    Box,
}

const PILLARS: [Pillar; 3] = [Pillar::Circle(0.5), Pillar::Circle(0.9), Pillar::Box];

impl Pillar {
    fn items(self) -> Vec<MISSION_ITEM_INT_DATA> {
        let corner = MavCmd::MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION;
        match self {
            Pillar::Circle(radius_m) => vec![circle([5.0, 5.0], radius_m)],
            Pillar::Box => [[4.0, 3.5], [4.0, 6.5], [6.0, 6.5], [6.0, 3.5]]
                .map(|[n, e]| item(corner, [n, e, 0.0], 4.0))
                .to_vec(),
        }
    }

    /// How deep a place is in it, m.
    fn depth_m(self, [north, east]: [f64; 2]) -> f64 {
        match self {
            Pillar::Circle(radius_m) => radius_m - (north - 5.0).hypot(east - 5.0),
            Pillar::Box => (north - 4.0).min(6.0 - north).min(east - 3.5).min(6.5 - east),
        }
    }
}

fn circle([north, east]: [f64; 2], radius_m: f64) -> MISSION_ITEM_INT_DATA {
    let command = MavCmd::MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION;
    item(command, [north, east, 0.0], radius_m as f32)
}

fn draw(world: &mut Lockstep, ground: &mut Ground, fence: &[MISSION_ITEM_INT_DATA]) {
    assert_eq!(upload_as(world, ground, T::MAV_MISSION_TYPE_FENCE, fence), ACCEPTED);
}

fn rally(
    world: &mut Lockstep,
    ground: &mut Ground,
    [north, east]: [f64; 2],
) -> Option<MavMissionResult> {
    let point = item(MavCmd::MAV_CMD_NAV_RALLY_POINT, [north, east, 0.0], 0.0);
    upload_as(world, ground, T::MAV_MISSION_TYPE_RALLY, &[point])
}

fn here(world: &Lockstep) -> [f64; 2] {
    let pos = world.truth().pos_E_m;
    [pos.x(), pos.y()]
}

fn away_m(world: &Lockstep, place: [f64; 2]) -> f64 {
    let at = here(world);
    (at[0] - place[0]).hypot(at[1] - place[1])
}

/// Taken off at home.
fn aloft(seed: u64, change: impl FnOnce(&mut PilotConfig)) -> (Lockstep, Ground) {
    let mut plant = PlantConfig::hall(seed);
    plant.start_E_m = haltere_core::frames::Vec3::new(HOME_M[0], HOME_M[1], 0.0);
    let mut pilot = pilot_config(&plant);
    change(&mut pilot);
    let survey = plant.survey.clone();
    hovering(Lockstep::new(plant, pilot, &survey).unwrap())
}

/// The same, and round whatever stands in the middle, to the place beyond it.
fn beyond(seed: u64, change: impl FnOnce(&mut PilotConfig)) -> (Lockstep, Ground) {
    let (mut world, mut ground) = aloft(seed, change);
    for [north, east] in [[2.0, 8.5], [8.0, 8.5], AWAY_M] {
        let answer = ground.goto(&mut world, [north, east, -HEIGHT_M]);
        assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
        until(&mut world, Mode::Goto, 1.0);
        fly_for(&mut world, 16.0);
        assert!(away_m(&world, [north, east]) < 0.6, "{:?}", here(&world));
    }
    (world, ground)
}

/// Flies on for a time or until it is down. The greatest depth on the way, m.
fn deepest_m(
    world: &mut Lockstep,
    ground: &mut Ground,
    pillar: Pillar,
    limit_s: f64,
    mut each: impl FnMut(&mut Lockstep, &mut Ground),
) -> f64 {
    let end_us = world.t_us() + (limit_s * 1e6) as u64;
    let mut deepest_m = f64::NEG_INFINITY;
    while world.t_us() < end_us && world.pilot().mode() != Mode::Disarmed {
        each(world, ground);
        for _ in 0..50 {
            world.step();
            deepest_m = deepest_m.max(pillar.depth_m(here(world)));
        }
        ground.listen(world);
    }
    deepest_m
}

fn said(ground: &Ground, what: &str) -> bool {
    ground.texts.iter().any(|t| t.contains(what))
}

/// Back from beyond a pillar, asked for or because the station is gone, with and without another place.
#[test]
fn regress_a_return_does_not_lead_through_what_the_fence_forbids() {
    for (seed, pillar) in (1..).zip(PILLARS) {
        for (asked, other) in [(true, false), (false, false), (true, true)] {
            let (mut world, mut ground) = beyond(seed, |pilot| {
                pilot.supervisor.ground_loss = if asked { Action::Tell } else { Action::Return };
            });
            draw(&mut world, &mut ground, &pillar.items());
            if other {
                assert_eq!(rally(&mut world, &mut ground, [8.0, 8.0]), ACCEPTED);
            }
            if asked {
                let answer =
                    ground.command(&mut world, MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, [0.0; 7]);
                assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
            } else {
                ground.send(&mut world, &MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()));
            }
            let deep_m = deepest_m(&mut world, &mut ground, pillar, 60.0, |_, _| {});
            let end = here(&world);
            println!("{pillar:?} asked {asked} other {other}: {deep_m:.2} m, down at {end:?}");
            assert!(deep_m < 0.0, "{pillar:?}: {deep_m:.2} m inside");
            assert_landed(&world, &ground.texts);
            let landed_at = if other { [8.0, 8.0] } else { AWAY_M };
            assert!(away_m(&world, landed_at) < 0.7, "{end:?} {:#?}", ground.texts);
            assert_eq!(said(&ground, "the fence bars the way home"), !other, "{:#?}", ground.texts);
        }
    }
}

/// Who flies at the pillar.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Way {
    Position,
    Velocity,
    Stick,
    Goto,
    Mission,
    Jump,
}

fn setpoint(way: Way) -> MavMessage {
    let velocity = way == Way::Velocity;
    MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
        type_mask: PositionTargetTypemask::from_bits_retain(if velocity { 0xDC3 } else { 0xDF8 }),
        x: HOME_M[0] as f32,
        y: HOME_M[1] as f32,
        z: -HEIGHT_M as f32,
        vx: -1.5,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    })
}

fn fly_way(world: &mut Lockstep, ground: &mut Ground, way: Way, pillar: Pillar) -> f64 {
    let accepted = Some(MavResult::MAV_RESULT_ACCEPTED);
    let stick = MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA {
        target: 1,
        x: -1000,
        z: 500,
        ..Default::default()
    });
    let home = item(MavCmd::MAV_CMD_NAV_WAYPOINT, [HOME_M[0], HOME_M[1], -HEIGHT_M], 0.0);
    let mut stream = None;
    match way {
        Way::Position | Way::Velocity => stream = Some((setpoint(way), 6.0)),
        Way::Stick => stream = Some((stick, 3.0)),
        Way::Goto => {
            let answer = ground.goto(world, [HOME_M[0], HOME_M[1], -HEIGHT_M]);
            assert_eq!(answer, Some(MavResult::MAV_RESULT_DENIED));
            assert!(said(ground, "the fence bars the straight way to N 2.00 E 5.00"));
        }
        Way::Mission => {
            ground.upload(world, &[home]);
            let start = ground.command(world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
            assert_eq!(start, Some(MavResult::MAV_RESULT_DENIED));
            assert!(said(ground, "the fence bars the straight way from here to item 1"));
        }
        Way::Jump => {
            // The way is free until somebody jumps over the items that lead round.
            let point = |n, e| item(MavCmd::MAV_CMD_NAV_WAYPOINT, [n, e, -HEIGHT_M], 0.0);
            let answer = ground.upload(world, &[point(8.0, 8.5), point(2.0, 8.5), home]);
            assert_eq!(answer, Some(MavMissionResult::MAV_MISSION_ACCEPTED));
            let start = ground.command(world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
            assert_eq!(start, accepted);
            let jump = [2.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
            ground.command(world, MavCmd::MAV_CMD_DO_SET_MISSION_CURRENT, jump);
        }
    }
    if let Some((message, main)) = &stream {
        ground.send(world, message);
        fly_for(world, 0.1);
        ground.send(world, message);
        let mode = [1.0, *main, 0.0, 0.0, 0.0, 0.0, 0.0];
        assert_eq!(ground.command(world, MavCmd::MAV_CMD_DO_SET_MODE, mode), accepted, "{way:?}");
    }
    deepest_m(world, ground, pillar, 15.0, |world, ground| {
        if let Some((message, _)) = &stream {
            ground.send(world, message);
        }
    })
}

#[test]
fn regress_nobody_leads_the_vehicle_through_what_the_fence_forbids() {
    let ways = [Way::Position, Way::Velocity, Way::Stick, Way::Goto, Way::Mission, Way::Jump];
    for (seed, pillar) in (11..).zip(PILLARS) {
        for way in ways {
            let (mut world, mut ground) = beyond(seed, |pilot| pilot.flight.cruise_speed_mps = 0.8);
            draw(&mut world, &mut ground, &pillar.items());
            let deep_m = fly_way(&mut world, &mut ground, way, pillar);
            println!("{pillar:?} {way:?}: {deep_m:.2} m, at {:?}", here(&world));
            assert!(deep_m < 0.0, "{pillar:?} {way:?}: {deep_m:.2} m inside");
            assert!(here(&world)[0] > 5.0, "{way:?}: {:?}", here(&world));
            assert!(said(&ground, "fence"), "{way:?}: {:#?}", ground.texts);
        }
    }
}

/// A lean that is held flies at metres a second, and asks for no point.
#[test]
fn regress_a_tilt_step_ends_before_what_the_fence_forbids() {
    let pillar = Pillar::Circle(0.5);
    let (mut world, mut ground) = aloft(21, |pilot| pilot.flight.takeoff_height_m = HEIGHT_M);
    draw(&mut world, &mut ground, &pillar.items());
    let mut tilt = item(MavCmd::MAV_CMD_USER_2, [0.0; 3], 1.0);
    (tilt.param2, tilt.param3) = (-25.0, 3.0);
    let start = item(MavCmd::MAV_CMD_NAV_WAYPOINT, [1.5, 5.0, -HEIGHT_M], 2.0);
    let answer = ground.upload(&mut world, &[start, tilt]);
    assert_eq!(answer, Some(MavMissionResult::MAV_MISSION_ACCEPTED), "{:?}", ground.texts);
    let start = ground.command(&mut world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
    assert_eq!(start, Some(MavResult::MAV_RESULT_ACCEPTED));
    let deep_m = deepest_m(&mut world, &mut ground, pillar, 12.0, |_, _| {});
    println!("{deep_m:.2} m, at {:?} {:?}", here(&world), ground.texts);
    assert!(deep_m < 0.0, "{deep_m:.2} m inside");
    assert!(said(&ground, "ended by the fence"), "{:#?}", ground.texts);
}

/// Home and rally points that the fence forbids, whichever came first.
#[test]
fn regress_nobody_returns_to_where_the_fence_forbids() {
    let return_home = |world: &mut Lockstep, ground: &mut Ground| {
        ground.command(world, MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, [0.0; 7])
    };
    let away = [6.5, 2.5];
    let (mut world, mut ground) = aloft(31, |_| {});
    ground.goto(&mut world, [away[0], away[1], -HEIGHT_M]);
    fly_for(&mut world, 16.0);
    draw(&mut world, &mut ground, &[circle([4.0, 2.5], 1.2)]);
    // The fence came first: refused, and home stays where it was.
    let message = COMMAND_INT_DATA {
        command: MavCmd::MAV_CMD_DO_SET_HOME as u16,
        frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
        x: 40_000,
        y: 25_000,
        target_system: 1,
        target_component: 1,
        ..Default::default()
    };
    ground.send(&mut world, &MavMessage::COMMAND_INT(message));
    let answer = ground.wait_for(&mut world, 1_000_000, |m| match m {
        MavMessage::COMMAND_ACK(a) if a.command == MavCmd::MAV_CMD_DO_SET_HOME as u16 => {
            known(a.result)
        }
        _ => None,
    });
    assert_eq!(answer, Some(MavResult::MAV_RESULT_DENIED), "{:?}", ground.texts);
    assert_eq!(
        rally(&mut world, &mut ground, [4.0, 2.5]),
        Some(MavMissionResult::MAV_MISSION_INVALID)
    );
    // The fence comes last: left out, and told.
    draw(&mut world, &mut ground, &[]);
    assert_eq!(rally(&mut world, &mut ground, [5.5, 2.5]), ACCEPTED);
    draw(&mut world, &mut ground, &[circle(HOME_M, 1.0), circle([5.0, 2.5], 1.0)]);
    fly_for(&mut world, 0.1);
    ground.listen(&mut world);
    assert!(said(&ground, "home refused: N 4.00 E 2.50 m"), "{:#?}", ground.texts);
    assert!(said(&ground, "no return to home, N "), "{:#?}", ground.texts);
    assert!(said(&ground, "no return to rally point 0"), "{:#?}", ground.texts);
    assert_eq!(return_home(&mut world, &mut ground), Some(MavResult::MAV_RESULT_ACCEPTED));
    let took_s = until(&mut world, Mode::Disarmed, 20.0);
    ground.listen(&mut world);
    println!("down after {took_s:.1} s: {:?}", ground.texts);
    assert_landed(&world, &ground.texts);
    assert!(away_m(&world, away) < 0.7);
}

/// A fence that comes during a leg: a goal that it bars is given up, and a return comes down.
#[test]
fn regress_a_fence_that_comes_later_ends_the_leg_that_it_bars() {
    let pillar = Pillar::Circle(0.9);
    let (mut world, mut ground) = aloft(41, |_| {});
    ground.goto(&mut world, [AWAY_M[0], AWAY_M[1], -HEIGHT_M]);
    fly_for(&mut world, 1.0);
    draw(&mut world, &mut ground, &pillar.items());
    fly_for(&mut world, 0.1);
    ground.listen(&mut world);
    assert_eq!(world.pilot().mode(), Mode::Hold);
    assert!(said(&ground, "the fence bars the rest of the leg"), "{:#?}", ground.texts);
    draw(&mut world, &mut ground, &[]);
    ground.goto(&mut world, [AWAY_M[0], AWAY_M[1], -HEIGHT_M]);
    fly_for(&mut world, 16.0);
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_NAV_RETURN_TO_LAUNCH, [0.0; 7]);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    draw(&mut world, &mut ground, &pillar.items());
    let deep_m = deepest_m(&mut world, &mut ground, pillar, 40.0, |_, _| {});
    println!("{deep_m:.2} m, down at {:?}", here(&world));
    assert!(deep_m < 0.0, "{deep_m:.2} m inside");
    assert_landed(&world, &ground.texts);
    assert!(said(&ground, "the fence bars the way home"), "{:#?}", ground.texts);
    assert!(!said(&ground, "where it should be"), "{:#?}", ground.texts);
}
