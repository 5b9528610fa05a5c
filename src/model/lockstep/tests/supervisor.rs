//! Every condition of the supervisor's list that can be brought about in the simulator, provoked in hover
//! and in a mission: what is done about it, what is said, and how it ends in truth.

use haltere_dialect::mav::haltere::{
    HEARTBEAT_DATA, MANUAL_CONTROL_DATA, MavAutopilot, MavMessage, MavType, PositionTargetTypemask,
    SET_POSITION_TARGET_LOCAL_NED_DATA,
};
use rayon::prelude::*;

mod divergence;
mod envelope;
mod lies;
mod noise;
mod timing;
mod walls;

use super::*;
use crate::faults::{Fault, FaultKind};
use haltere_core::time::HostTime;
use haltere_pilot::{Action, Input, LinkId, Reaction};

/// From which flight it is provoked.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Phase {
    Hover,
    Mission,
}

const PHASES: [Phase; 2] = [Phase::Hover, Phase::Mission];

fn hall(seed: u64, change: impl FnOnce(&mut PlantConfig, &mut PilotConfig)) -> Lockstep {
    let mut plant = PlantConfig::hall(seed);
    let mut pilot = pilot_config(&plant);
    change(&mut plant, &mut pilot);
    let survey = plant.survey.clone();
    Lockstep::new(plant, pilot, &survey).unwrap()
}

/// In the air at 1.2 m, holding, or on the second leg of a square.
fn aloft(world: Lockstep, phase: Phase) -> (Lockstep, Ground) {
    let (mut world, mut ground) = hovering(world);
    if phase == Phase::Mission {
        let mut items = square();
        items.remove(0);
        ground.upload(&mut world, &items);
        let start = ground.command(&mut world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
        assert_eq!(start, Some(MavResult::MAV_RESULT_ACCEPTED));
        fly_for(&mut world, 5.0);
        assert_eq!(world.pilot().mode(), Mode::Mission);
    }
    (world, ground)
}

fn said(world: &mut Lockstep, ground: &mut Ground, what: &str) -> bool {
    ground.listen(world);
    ground.texts.iter().any(|t| t.contains(what))
}

fn assert_said(world: &mut Lockstep, ground: &mut Ground, what: &str) {
    assert!(said(world, ground, what), "{what}: {:#?}", ground.texts);
}

/// Flies on until it is disarmed, and checks that it stands in the room, whole.
fn assert_comes_down(world: &mut Lockstep, ground: &mut Ground, limit_s: f64) {
    let start_us = world.t_us();
    while world.pilot().mode() != Mode::Disarmed {
        if world.t_us() - start_us > (limit_s * 1e6) as u64 {
            ground.listen(world);
            panic!("still {:?}: {:?} {:#?}", world.pilot().mode(), world.truth(), ground.texts);
        }
        world.step();
        // What waits for too long is forgotten.
        ground.listen(world);
    }
    assert_landed(world, &ground.texts);
}

/// A fault, the mode that must follow within a time, and the words.
struct Case {
    fault: Fault,
    to: Mode,
    within_s: f64,
    words: &'static str,
}

fn case(fault: Fault, to: Mode, within_s: f64, words: &'static str) -> Case {
    Case { fault, to, within_s, words }
}

fn fly_case(seed: u64, phase: Phase, case: &Case) {
    let (mut world, mut ground) = aloft(world(seed), phase);
    world.plant_mut().inject(case.fault.clone()).unwrap();
    let start_us = world.t_us();
    let limit_us = (case.within_s * 1e6) as u64;
    let rank = Reaction::of_mode(case.to);
    while Reaction::of_mode(world.pilot().mode()) < rank {
        if world.t_us() - start_us > limit_us {
            ground.listen(&mut world);
            panic!("{:?} {phase:?} {seed}: no reaction {:#?}", case.fault, ground.texts);
        }
        world.step();
    }
    let took_s = (world.t_us() - start_us) as f64 * 1e-6;
    println!("{:?} {phase:?} seed {seed}: {:?} after {took_s:.2} s", case.fault, case.to);
    assert_comes_down(&mut world, &mut ground, 40.0);
    assert_said(&mut world, &mut ground, case.words);
}

/// The board does not hear us. A generic one comes down by itself, by its own failsafe; that it does not
/// fly what it is sent is noticed before it is down.
#[test]
fn prop_a_board_that_does_not_hear_us_is_noticed() {
    let (mut world, mut ground) = hovering(world(9));
    ground.goto(&mut world, [5.0, 5.0, -4.0]);
    fly_for(&mut world, 8.0);
    world.plant_mut().inject(Fault::ToBoard(FaultKind::Off)).unwrap();
    while matches!(world.pilot().mode(), Mode::Goto | Mode::Hold) {
        assert!(world.truth().height_m > 0.5, "down, and nothing was noticed");
        world.step();
    }
    assert_said(&mut world, &mut ground, "lift is not what was sent");
}

#[test]
fn prop_sensor_faults_are_found_and_end_on_the_floor() {
    use FaultKind as K;
    let cases = [
        case(Fault::Accelerometer(K::Off), Mode::Descend, 0.5, "no IMU"),
        case(Fault::Accelerometer(K::Stuck), Mode::Descend, 0.5, "accelerometer repeats itself"),
        case(Fault::Gyroscope(K::Stuck), Mode::Descend, 0.5, "gyroscope repeats itself"),
        case(Fault::Accelerometer(K::Garbage), Mode::Descend, 0.6, "accelerometer is noise"),
        // The height follows the UWB, and hardly the drift, until then (`divergence.rs`).
        case(Fault::Accelerometer(K::Drift), Mode::Descend, 15.0, "vertical velocity"),
        case(Fault::Gyroscope(K::Garbage), Mode::Descend, 0.6, "gyroscope is noise"),
        case(Fault::Gyroscope(K::Drift), Mode::Descend, 30.0, "no usable estimate"),
        case(Fault::TagSilent(true), Mode::Land, 1.2, "land: no UWB measurements"),
        case(Fault::BatteryDrop(2.6), Mode::Land, 4.0, "battery empty"),
    ];
    let flights: Vec<_> = cases
        .iter()
        .flat_map(|case| PHASES.into_iter().flat_map(move |p| (0..4u64).map(move |s| (s, p, case))))
        .collect();
    flights.into_par_iter().for_each(|(seed, phase, case)| fly_case(seed, phase, case));
}

#[test]
fn prop_a_link_that_comes_and_goes_ends_on_the_floor() {
    for phase in PHASES {
        (0..6u64).into_par_iter().for_each(|seed| {
            let (mut world, mut ground) = aloft(world(seed), phase);
            world.plant_mut().inject(Fault::BoardLink(FaultKind::Intermittent)).unwrap();
            assert_comes_down(&mut world, &mut ground, 30.0);
        });
    }
}

#[test]
fn prop_late_uwb_is_dead_reckoned_and_told() {
    let (mut world, mut ground) = aloft(world(3), Phase::Mission);
    world.plant_mut().inject(Fault::TagSilent(true)).unwrap();
    fly_for(&mut world, 0.8);
    world.plant_mut().inject(Fault::TagSilent(false)).unwrap();
    fly_for(&mut world, 1.0);
    assert_eq!(world.pilot().mode(), Mode::Mission);
    assert_said(&mut world, &mut ground, "no UWB for 0.3 s");
    assert_said(&mut world, &mut ground, "UWB measurements are back");
}

#[test]
fn prop_one_silent_anchor_is_told_and_four_are_too_many() {
    for phase in PHASES {
        let (mut world, mut ground) = aloft(world(4), phase);
        let silence = |world: &mut Lockstep, anchor| {
            world.plant_mut().inject(Fault::AnchorSilent { anchor, silent: true }).unwrap();
        };
        let mode = world.pilot().mode();
        silence(&mut world, 3);
        fly_for(&mut world, 2.0);
        assert_eq!(world.pilot().mode(), mode);
        assert_said(&mut world, &mut ground, "anchor 3 silent, 7 of 8 heard");
        [0, 5, 6].into_iter().for_each(|anchor| silence(&mut world, anchor));
        until(&mut world, Mode::Land, 3.0);
        assert_said(&mut world, &mut ground, "4 of 8 anchors heard, 5 needed");
        // Nobody can order it up again meanwhile.
        let answer = ground.goto(&mut world, [6.0, 6.0, -1.2]);
        assert_eq!(answer, Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
        assert_said(&mut world, &mut ground, "refused: too few anchors");
        assert_comes_down(&mut world, &mut ground, 20.0);
        // Nor to arm.
        let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
        assert_eq!(answer, Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
    }
}

#[test]
fn prop_a_board_that_was_silent_ends_the_flight_and_cannot_be_overruled() {
    for phase in PHASES {
        let (mut world, mut ground) = aloft(world(5), phase);
        world.plant_mut().inject(Fault::BoardLink(FaultKind::Off)).unwrap();
        fly_for(&mut world, 1.2);
        assert_said(&mut world, &mut ground, "board silent for 1.0 s");
        world.plant_mut().inject(Fault::BoardLink(FaultKind::Healthy)).unwrap();
        fly_for(&mut world, 0.3);
        let hold = ground.command(&mut world, MavCmd::MAV_CMD_DO_PAUSE_CONTINUE, [0.0; 7]);
        assert_ne!(hold, Some(MavResult::MAV_RESULT_ACCEPTED));
        assert_said(&mut world, &mut ground, "board was silent");
        assert_comes_down(&mut world, &mut ground, 20.0);
    }
}

fn beat(ground: &mut Ground, world: &mut Lockstep) {
    let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        mavtype: MavType::MAV_TYPE_GCS as u8,
        autopilot: MavAutopilot::MAV_AUTOPILOT_INVALID as u8,
        ..Default::default()
    });
    ground.send(world, &message);
}

#[test]
fn prop_the_ground_link_is_watched_as_configured() {
    let wanted = [
        (Action::Tell, Mode::Hold),
        (Action::Hold, Mode::Hold),
        (Action::Return, Mode::Return),
        (Action::Land, Mode::Land),
    ];
    for (action, mode) in wanted {
        let world = hall(6, |_, pilot| pilot.supervisor.ground_loss = action);
        let (mut world, mut ground) = hovering(world);
        // Without a heartbeat at the start no station takes part.
        fly_for(&mut world, 7.0);
        assert_eq!(world.pilot().mode(), Mode::Hold);
        ground.goto(&mut world, [6.0, 5.0, -1.2]);
        beat(&mut ground, &mut world);
        fly_for(&mut world, 4.5);
        assert!(!said(&mut world, &mut ground, "no station heard"));
        let after_s = 1.0;
        fly_for(&mut world, after_s);
        assert_said(&mut world, &mut ground, "no station heard for 5.0 s");
        let expected = if action == Action::Tell { Mode::Goto } else { mode };
        assert_eq!(world.pilot().mode(), expected, "{action:?}");
        beat(&mut ground, &mut world);
        fly_for(&mut world, 0.6);
        assert_said(&mut world, &mut ground, "a station is heard again");
    }
}

fn velocity(ground: &mut Ground, world: &mut Lockstep, vel_mps: [f32; 3]) {
    let message = MavMessage::SET_POSITION_TARGET_LOCAL_NED(SET_POSITION_TARGET_LOCAL_NED_DATA {
        coordinate_frame: MavFrame::MAV_FRAME_LOCAL_NED as u8,
        type_mask: PositionTargetTypemask::from_bits_truncate(0xDC7),
        vx: vel_mps[0],
        vy: vel_mps[1],
        vz: vel_mps[2],
        ..Default::default()
    });
    ground.send(world, &message);
}

const OFFBOARD: [f32; 7] = [1.0, 6.0, 0.0, 0.0, 0.0, 0.0, 0.0];

/// Streams a velocity; the farthest points that the vehicle really came to, m: N, E, height.
fn push(world: &mut Lockstep, ground: &mut Ground, vel_mps: [f32; 3], seconds: f64) -> [f64; 3] {
    let mut most = [f64::NEG_INFINITY; 3];
    for n in 0..(seconds * 20.0) as u32 {
        velocity(ground, world, vel_mps);
        fly_for(world, 0.05);
        if n == 2 {
            let answer = ground.command(world, MavCmd::MAV_CMD_DO_SET_MODE, OFFBOARD);
            assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
        }
        let pos = world.truth().pos_E_m;
        let here = [pos.x(), pos.y(), -pos.z()];
        most = std::array::from_fn(|i| most[i].max(here[i]));
    }
    most
}

#[test]
fn prop_setpoints_that_stop_do_what_is_configured() {
    let wanted =
        [(Action::Hold, Mode::Hold), (Action::Return, Mode::Return), (Action::Land, Mode::Land)];
    for (action, mode) in wanted {
        let world = hall(7, |_, pilot| pilot.supervisor.offboard_loss = action);
        let (mut world, mut ground) = hovering(world);
        push(&mut world, &mut ground, [0.3, 0.0, 0.0], 1.5);
        assert_eq!(world.pilot().mode(), Mode::Offboard);
        fly_for(&mut world, 0.7);
        assert_eq!(world.pilot().mode(), mode);
        assert_said(&mut world, &mut ground, "setpoints stopped");
    }
}

/// A client that pushes against the walls at full speed stays inside.
#[test]
fn prop_soft_walls_hold() {
    (0..4u64).into_par_iter().for_each(|seed| {
        let world = hall(seed, |_, pilot| {
            pilot.limits.north_m = Some([3.0, 7.0]);
            pilot.limits.east_m = Some([3.0, 7.0]);
            pilot.limits.height_m = Some(2.5);
        });
        let (mut world, mut ground) = hovering(world);
        let most = push(&mut world, &mut ground, [2.0, 2.0, -1.0], 8.0);
        println!("seed {seed}: N {:.2} E {:.2} height {:.2} m", most[0], most[1], most[2]);
        assert_eq!(world.pilot().mode(), Mode::Offboard);
        assert!(most[0] < 7.4 && most[1] < 7.4 && most[2] < 2.9, "{most:?}");
        assert!(!said(&mut world, &mut ground, "beyond the hard wall"), "{:?}", ground.texts);
    });
}

/// Out of a small volume at speed, because the board did not hear us for a moment: back inside and down.
#[test]
fn prop_the_hard_wall_ends_the_flight_inside() {
    let world = hall(8, |_, pilot| {
        pilot.limits.north_m = Some([3.5, 5.6]);
        pilot.limits.east_m = Some([3.5, 6.5]);
        pilot.supervisor.wall_hard_m = 0.1;
        pilot.flight.cruise_speed_mps = 2.5; // the setpoint jumps
    });
    let (mut world, mut ground) = hovering(world);
    ground.goto(&mut world, [3.6, 5.0, -1.2]);
    fly_for(&mut world, 4.0);
    ground.goto(&mut world, [5.5, 5.0, -1.2]);
    while world.truth().pos_E_m.x() < 4.7 {
        assert_eq!(world.pilot().mode(), Mode::Goto);
        world.step();
    }
    // The board holds its lean for half a second.
    world.plant_mut().inject(Fault::ToBoard(FaultKind::Off)).unwrap();
    fly_for(&mut world, 0.5);
    world.plant_mut().inject(Fault::ToBoard(FaultKind::Healthy)).unwrap();
    let mut most_m: f64 = 0.0;
    let start_us = world.t_us();
    while world.pilot().mode() != Mode::Land {
        let truth = world.truth();
        most_m = most_m.max(truth.pos_E_m.x());
        assert!(world.t_us() - start_us < 5_000_000, "farthest {most_m}: {truth:?}");
        world.step();
    }
    assert_said(&mut world, &mut ground, "beyond the hard wall");
    assert_comes_down(&mut world, &mut ground, 30.0);
    let north_m = world.truth().pos_E_m.x();
    println!("farthest {most_m:.2} m, down at {north_m:.2} m");
    assert!(most_m > 5.65 && north_m < 5.8, "{most_m} {north_m}");
}

#[test]
fn prop_a_battery_that_falls_fast_brings_it_home_in_time() {
    let world = hall(10, |_, pilot| pilot.limits.battery_low_v = 6.4);
    let (mut world, mut ground) = hovering(world);
    ground.goto(&mut world, [8.5, 8.5, -1.2]);
    // A straight fall of 15 mV/s more than the flight takes.
    let mut dropped_v = 0.0;
    let mut home = None;
    let mut fastest_mps = 0.0_f64;
    for _ in 0..1200 {
        fly_for(&mut world, 0.1);
        dropped_v += 0.0015;
        world.plant_mut().inject(Fault::BatteryDrop(dropped_v)).unwrap();
        ground.listen(&mut world);
        if home.is_none() && world.pilot().mode() == Mode::Return {
            home = Some(world.truth().supply_v);
        }
        if world.pilot().mode() == Mode::Return {
            fastest_mps = fastest_mps.max(world.truth().vel_E_mps.norm());
        }
        if world.pilot().mode() == Mode::Disarmed {
            break;
        }
    }
    let supply_v = world.truth().supply_v;
    println!("return at {home:?} V, {fastest_mps:.2} m/s, on the floor at {supply_v:.2} V");
    // It flew, and budgeted, the cruise speed of 0.5 m/s: 17 s for these 5 m and the landing.
    assert!(fastest_mps > 1.3, "{fastest_mps} m/s");
    assert_said(&mut world, &mut ground, "left, home and down takes 11 s");
    ground.listen(&mut world);
    assert_landed(&world, &ground.texts);
    let pos = world.truth().pos_E_m;
    assert!((pos.x() - 5.0).hypot(pos.y() - 5.0) < 0.6, "{pos:?}");
    assert!(!said(&mut world, &mut ground, "battery empty"), "{:?}", ground.texts);
}

#[test]
fn prop_a_loop_that_stood_still_ends_the_flight() {
    for phase in PHASES {
        let (mut world, mut ground) = aloft(world(11), phase);
        let t_us = world.t_us();
        world.stall_until(t_us + 300_000);
        fly_for(&mut world, 1.0);
        assert_ne!(world.pilot().mode(), Mode::Land, "a short pause is none");
        let t_us = world.t_us();
        world.stall_until(t_us + 600_000);
        // Longer than the board waits: it comes down by nothing that was known before.
        until(&mut world, Mode::Descend, 0.5);
        assert_said(&mut world, &mut ground, "control loop stood still for 0.6 s");
        assert_comes_down(&mut world, &mut ground, 20.0);
    }
}

#[test]
fn prop_a_clock_that_goes_back_does_not_stop_the_loop() {
    let (mut world, mut ground) = hovering(world(12));
    // High enough that it is not at the floor before it is heard anew: there it comes down as it is.
    ground.goto(&mut world, [5.0, 5.0, -2.5]);
    fly_for(&mut world, 5.0);
    let steps = |world: &Lockstep| world.pilot().control_record().at;
    // One stamp of the future: the core's time is then ahead of the world's by 20 s.
    let future = HostTime::from_us(world.host_now().as_us() + 20_000_000);
    world.pilot_mut().handle(future, Input::Bytes { link: LinkId::Tag, bytes: &[] });
    let before = steps(&world);
    fly_for(&mut world, 0.5);
    let elapsed_s = steps(&world).seconds_since(before);
    assert!(elapsed_s > 0.4, "the loop stands still: {elapsed_s} s");
    until(&mut world, Mode::Land, 1.0);
    assert_said(&mut world, &mut ground, "clock");
    assert_comes_down(&mut world, &mut ground, 20.0);
}

fn sticks(ground: &mut Ground, world: &mut Lockstep, x: i16) {
    let message = MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA {
        x,
        y: 0,
        z: 500,
        r: 0,
        target: 1,
        ..Default::default()
    });
    ground.send(world, &message);
}

#[test]
fn prop_a_moved_stick_takes_over_where_that_is_configured() {
    for (on, phase) in [(true, Phase::Hover), (true, Phase::Mission), (false, Phase::Mission)] {
        let world = hall(13, |_, pilot| pilot.supervisor.stick_takeover = on);
        let (mut world, mut ground) = aloft(world, phase);
        let before = world.pilot().mode();
        for _ in 0..20 {
            sticks(&mut ground, &mut world, 100);
            fly_for(&mut world, 0.05);
        }
        assert_eq!(world.pilot().mode(), before, "sticks in their middle");
        for _ in 0..10 {
            sticks(&mut ground, &mut world, 600);
            fly_for(&mut world, 0.05);
        }
        assert_eq!(world.pilot().mode(), if on { Mode::Manual } else { before });
        fly_for(&mut world, 1.0);
        if on {
            assert_eq!(world.pilot().mode(), Mode::Hold);
            assert_said(&mut world, &mut ground, "joystick silent");
        }
    }
}

/// Between arming and the take-off the estimate is lost: nothing lifts off.
#[test]
fn prop_a_vehicle_that_lost_its_estimate_since_it_was_armed_stays_on_the_floor() {
    let mut world = world(14);
    let mut ground = Ground::new();
    arm(&mut world, &mut ground);
    until(&mut world, Mode::Idle, 3.0);
    world.plant_mut().inject(Fault::TagSilent(true)).unwrap();
    fly_for(&mut world, 3.0);
    let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 1.2];
    ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
    fly_for(&mut world, 3.0);
    assert!(world.truth().on_ground && world.truth().flap_hz[0] < 1.0);
    assert_said(&mut world, &mut ground, "take-off refused: ");
    // In the spool-up it ends at once.
    let mut world = super::world(15);
    let mut ground = Ground::new();
    arm(&mut world, &mut ground);
    ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
    until(&mut world, Mode::Spool, 3.0);
    world.plant_mut().inject(Fault::Gyroscope(FaultKind::Off)).unwrap();
    until(&mut world, Mode::Disarming, 0.5);
    until(&mut world, Mode::Disarmed, 5.0);
    assert!(world.truth().on_ground && !world.truth().crashed);
}

/// A landing against a steady wind finds the floor.
#[test]
fn regress_a_landing_that_leans_against_the_wind_ends() {
    (0..8u64).into_par_iter().for_each(|seed| {
        let (mut world, mut ground) = hovering(world(seed));
        let (sin, cos) = (0.8 * seed as f64).sin_cos();
        let values = vec![("north".into(), 0.6 * cos), ("east".into(), 0.6 * sin)];
        world.plant_mut().inject(Fault::EffectOn { id: "A5".into(), values }).unwrap();
        fly_for(&mut world, 6.0);
        let answer = ground.command(&mut world, MavCmd::MAV_CMD_NAV_LAND, [0.0; 7]);
        assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
        assert_comes_down(&mut world, &mut ground, 20.0);
    });
}

/// What a flight without a fault says must not name a condition.
#[test]
fn prop_a_sound_flight_raises_nothing() {
    (200..208u64).into_par_iter().for_each(|seed| {
        let mut world = world(seed);
        let flight = crate::lockstep::fly(&mut world, &square(), 90.0).unwrap();
        assert!(flight.landed);
        let raised = |text: &str| {
            let words = [
                "silent",
                "no UWB",
                "noise",
                "repeats",
                "off by",
                "differs",
                "away from",
                "outside",
                "late",
                "clock",
                "descend",
                "battery",
            ];
            !text.starts_with("arming") && words.iter().any(|word| text.contains(word))
        };
        let texts: Vec<_> = flight.texts.iter().filter(|t| raised(t)).collect();
        assert!(texts.is_empty(), "seed {seed}: {texts:?}");
    });
}

#[test]
fn regress_what_waited_in_a_pause_is_taken_in_its_order() {
    // The oldest sample of a pause of 0.3 s and more was stamped as new, all the others were then out of order, and
    // its specific force, wing beat and all, counted for the whole pause: up to 4.5 m/s at once.
    (5..17u64).into_par_iter().for_each(|seed| {
        for pause_us in [300_000, 380_000] {
            let (mut world, mut ground) = hovering(world(seed));
            let t_us = world.t_us();
            world.stall_until(t_us + pause_us);
            for _ in 0..100 {
                fly_for(&mut world, 0.01);
                let error_E_mps = world.pilot().estimate().vel_E_mps() - world.truth().vel_E_mps;
                assert!(error_E_mps.norm() < 1.0, "{seed}, {pause_us}: {error_E_mps:?}");
            }
            ground.listen(&mut world);
            assert_eq!(world.pilot().mode(), Mode::Hold, "{seed}: {:#?}", ground.texts);
        }
    });
}
