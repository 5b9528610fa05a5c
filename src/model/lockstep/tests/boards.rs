//! Flights with each firmware that the simulated board plays, from arming to disarming, kindly and with
//! each unkind manner switched on by itself (docs/BOARDS.md says where each was seen).

use haltere_dialect::mav::haltere::MavMessage;
use haltere_dialect::mav_stream::MavSplitter;

use super::*;
use crate::board::Firmware;
use crate::effects::EffectSet;
use crate::faults::Fault;
use haltere_pilot::{BoardProfile, LinkId};

pub(super) const REAL: [Firmware; 2] = [Firmware::Px4, Firmware::Ardupilot];
pub(super) fn board(
    firmware: Firmware,
    seed: u64,
    edit: impl FnOnce(&mut PlantConfig, &mut PilotConfig),
) -> Lockstep {
    let mut plant = PlantConfig::hall(seed);
    plant.board.firmware = firmware;
    let mut pilot = pilot_config(&plant);
    edit(&mut plant, &mut pilot);
    let survey = plant.survey.clone();
    Lockstep::new(plant, pilot, &survey).unwrap()
}

/// Lets time pass, listening: a station that does not read loses what overflows.
pub(super) fn pass(world: &mut Lockstep, ground: &mut Ground, seconds: f64) {
    for _ in 0..(seconds * 10.0).round() as usize {
        fly_for(world, 0.1);
        ground.listen(world);
    }
}

pub(super) fn said(world: &mut Lockstep, ground: &mut Ground) -> Vec<String> {
    ground.listen(world);
    ground.texts.clone()
}

#[track_caller]
pub(super) fn assert_said(world: &mut Lockstep, ground: &mut Ground, words: &[&str]) {
    let texts = said(world, ground);
    let found = texts.iter().any(|t| words.iter().all(|w| t.contains(w)));
    assert!(found, "nobody said {words:?}: {texts:#?}");
}

/// Asks to arm until it is, for as long as a patient user would. What it took, s.
pub(super) fn arm_patiently(world: &mut Lockstep, ground: &mut Ground, limit_s: f64) -> f64 {
    let start_us = world.t_us();
    loop {
        let answer = ground.command(world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
        let took_s = (world.t_us() - start_us) as f64 * 1e-6;
        if answer == Some(MavResult::MAV_RESULT_ACCEPTED) {
            return took_s;
        }
        let texts = said(world, ground);
        assert!(took_s < limit_s, "not armed after {took_s} s: {texts:#?}");
        fly_for(world, 0.5);
    }
}

/// Take-off to 1.2 m, a square, a landing; the largest distance from the setpoint, m.
fn fly_square(world: &mut Lockstep, ground: &mut Ground) -> f64 {
    let answer = ground.upload(world, &square());
    assert!(answer.is_some(), "{:?}", ground.texts);
    arm_patiently(world, ground, 60.0);
    let answer = ground.command(world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    until(world, Mode::Mission, 20.0);
    let mut worst_m = 0.0f64;
    let start_us = world.t_us();
    while world.pilot().mode() != Mode::Disarmed {
        fly_for(world, 0.01);
        ground.listen(world);
        if world.pilot().mode() == Mode::Mission {
            let wanted = world.pilot().control_record().pos_setpoint_E_m;
            let is = world.truth().pos_E_m.to_array();
            let error_m: f64 =
                (0..3).map(|i| wanted[i].map_or(0.0, |w| (w - is[i]).powi(2))).sum::<f64>().sqrt();
            worst_m = worst_m.max(error_m);
        }
        assert!(world.t_us() - start_us < 90_000_000, "{:#?}", said(world, ground));
    }
    let texts = said(world, ground);
    assert_landed(world, &texts);
    worst_m
}

/// Holding at 1.2 m over (5, 5).
pub(super) fn in_hover(mut world: Lockstep) -> (Lockstep, Ground) {
    let mut ground = Ground::new();
    let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 1.2];
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    arm_patiently(&mut world, &mut ground, 60.0);
    until(&mut world, Mode::Hold, 20.0);
    pass(&mut world, &mut ground, 3.0);
    (world, ground)
}

pub(super) fn land(world: &mut Lockstep, ground: &mut Ground) {
    ground.command(world, MavCmd::MAV_CMD_NAV_LAND, [0.0; 7]);
    until(world, Mode::Disarmed, 20.0);
    let texts = said(world, ground);
    assert_landed(world, &texts);
}

/// All frames that the core sent to the board.
pub(super) fn to_board(sent: &Sent) -> Vec<(u64, MavMessage)> {
    let mut splitter = MavSplitter::new();
    let mut all = Vec::new();
    for (t_us, link, bytes) in sent.lock().unwrap().iter() {
        if *link == LinkId::Board {
            splitter.push(bytes);
            while let Some(frame) = splitter.next() {
                all.push((*t_us, frame.unwrap().decode().unwrap()));
            }
        }
    }
    all
}

#[test]
fn prop_each_firmware_is_recognised_and_flown_from_arming_to_disarming() {
    for firmware in [Firmware::Generic, Firmware::Px4, Firmware::Ardupilot] {
        for seed in [1, 2] {
            let mut world = board(firmware, seed, |_, _| {});
            let mut ground = Ground::new();
            let worst_m = fly_square(&mut world, &mut ground);
            println!("{firmware:?} seed {seed}: at most {worst_m:.2} m from the setpoint");
            assert!(worst_m < 1.2, "{firmware:?}: {worst_m}");
            let name = format!("{firmware:?}").to_lowercase();
            assert_said(&mut world, &mut ground, &["board found", &name]);
            let texts = said(&mut world, &mut ground);
            let bad = ["does not", "left", "came back", "disarming failed", "restarted"];
            let odd: Vec<_> = texts.iter().filter(|t| bad.iter().any(|b| t.contains(b))).collect();
            assert!(odd.is_empty(), "{firmware:?}: {odd:?}");
        }
    }
}

/// ArduCopter 4.6.3 held its motors for 2.5 s, in which an estimate that thought itself in the air rose by 0.35 m, and
/// the take-off was begun on the floor.
#[test]
fn regress_the_estimate_stands_while_motors_are_held() {
    for seed in 1..5 {
        let mut world = board(Firmware::Ardupilot, seed, |plant, pilot| {
            pilot.estimator.rest_height_m = Some(plant.vehicle.body.gear_m);
        });
        let mut ground = Ground::new();
        let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 1.2];
        ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
        arm_patiently(&mut world, &mut ground, 60.0);
        until(&mut world, Mode::Spool, 5.0);
        let began_us = world.t_us();
        while world.pilot().mode() == Mode::Spool {
            fly_for(&mut world, 0.01);
            let (ours, truth) = (world.pilot().estimate().pos_E_m, world.truth().pos_E_m);
            let held = world.truth().flap_hz == [0.0; 2];
            assert!(!held || (ours.z() - truth.z()).abs() < 0.05, "{ours:?}");
        }
        assert_eq!(world.pilot().mode(), Mode::Takeoff, "{:?}", said(&mut world, &mut ground));
        assert!(world.t_us() - began_us > 2_000_000);
        let up_m = world.truth().pos_E_m.z() - world.pilot().estimate().pos_E_m.z();
        assert!(up_m.abs() < 0.25, "{up_m}");
        until(&mut world, Mode::Hold, 20.0);
    }
}

/// A companion that comes back at once must not keep ArduPilot's failsafe from acting by its heartbeat: without
/// setpoints the board would hold its height and drift for as long as the battery lasts.
#[test]
fn prop_a_companion_that_comes_back_in_flight_leaves_the_board_to_its_failsafe() {
    for firmware in [Firmware::Generic, Firmware::Px4, Firmware::Ardupilot] {
        let (mut world, mut ground) = in_hover(board(firmware, 3, |_, _| {}));
        let plant = PlantConfig::hall(3);
        world.restart_companion(pilot_config(&plant), &plant.survey);
        let mut took_s = 0.0;
        while !world.truth().landed || world.truth().armed {
            pass(&mut world, &mut ground, 0.1);
            took_s += 0.1;
            assert!(took_s < 20.0, "{firmware:?} does not come down: {:?}", world.truth());
        }
        println!("{firmware:?}: on the floor after {took_s:.1} s");
        assert!(!world.truth().crashed);
        // And it is of use again.
        pass(&mut world, &mut ground, 3.0);
        arm_patiently(&mut world, &mut ground, 60.0);
    }
}

#[test]
fn prop_setpoints_are_what_both_firmwares_read_alike() {
    for firmware in REAL {
        let sent = Sent::default();
        let mut world = board(firmware, 3, |_, _| {}).with_tap(tap(&sent));
        fly_square(&mut world, &mut Ground::new());
        let mut count = 0;
        for (t_us, message) in to_board(&sent) {
            let MavMessage::SET_ATTITUDE_TARGET(m) = message else { continue };
            count += 1;
            let length = m.q.iter().map(|c| f64::from(*c).powi(2)).sum::<f64>().sqrt();
            assert!((length - 1.0).abs() < 1e-6, "{t_us}: {length}");
            assert_eq!(m.type_mask.bits(), 7);
            assert!((0.0..=1.0).contains(&m.thrust));
            assert_eq!((m.target_system, m.target_component), (1, 1));
        }
        assert!(count > 2000, "{count}");
    }
}

#[test]
fn prop_refusals_to_arm_are_waited_for_and_their_reasons_are_told() {
    for firmware in REAL {
        let mut world = board(firmware, 4, |plant, _| {
            plant.board.boot_us = 0;
            plant.board.manners.settling_s = 23.0;
        });
        let mut ground = Ground::new();
        let took_s = arm_patiently(&mut world, &mut ground, 60.0);
        println!("{firmware:?}: armed after {took_s:.1} s");
        assert!(world.t_us() > 23_000_000);
        match firmware {
            Firmware::Ardupilot => {
                assert_said(&mut world, &mut ground, &["Accels inconsistent"]);
                assert_said(&mut world, &mut ground, &["Gyros inconsistent"]);
                // Longer than one STATUSTEXT.
                let whole = "gyro calibration and EKF not settled yet";
                assert_said(&mut world, &mut ground, &["Internal errors", whole]);
            }
            _ => assert_said(&mut world, &mut ground, &["event", "no words"]),
        }
        fly_square(&mut world, &mut ground);
    }
}

#[test]
fn prop_a_board_that_never_settles_is_given_up_and_named() {
    for firmware in REAL {
        let mut world = board(firmware, 4, |plant, _| plant.board.manners.settling_s = 600.0);
        let mut ground = Ground::new();
        pass(&mut world, &mut ground, 12.0);
        ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
        assert_eq!(world.pilot().mode(), Mode::Arming);
        until(&mut world, Mode::Disarmed, 40.0);
        assert_said(&mut world, &mut ground, &["arming failed", "30 s"]);
        // Nobody is armed behind our back by an order that is still under way.
        pass(&mut world, &mut ground, 5.0);
        assert!(!world.truth().armed);
    }
}

#[test]
fn prop_a_mode_that_is_overridden_after_the_boot_is_asked_for_again() {
    for firmware in REAL {
        for override_s in [8.0, 10.0, 12.0, 14.0] {
            let mut world = board(firmware, 5, |plant, _| {
                plant.board.boot_us = 0;
                plant.board.manners.mode_override_s = override_s;
            });
            let mut ground = Ground::new();
            let worst_m = fly_square_or_yield(&mut world, &mut ground, override_s);
            println!("{firmware:?} override at {override_s} s: {worst_m:.2} m");
        }
    }
}

/// The override may come before arming (asked for again), on the floor (disarmed) or in the air (left
/// to the board): whatever it is, no setpoint may be taken for obeyed.
fn fly_square_or_yield(world: &mut Lockstep, ground: &mut Ground, override_s: f64) -> f64 {
    ground.upload(world, &square());
    let mut worst_m = 0.0f64;
    for attempt in 0..3 {
        arm_patiently(world, ground, 60.0);
        ground.command(world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
        while !matches!(world.pilot().mode(), Mode::Disarmed) {
            fly_for(world, 0.05);
            ground.listen(world);
            if world.pilot().mode() == Mode::Yielded {
                let said = said(world, ground);
                assert!(said.iter().any(|t| t.contains("board left")), "{said:?}");
                ground.command(world, MavCmd::MAV_CMD_NAV_LAND, [0.0; 7]);
                pass(world, ground, 4.0);
                assert_ne!(world.pilot().mode(), Mode::Yielded, "{:#?}", ground.texts);
            }
            if world.pilot().mode() == Mode::Mission {
                let height_m = world.truth().height_m;
                worst_m = worst_m.max((height_m - 1.2).abs());
            }
            assert!(world.t_us() < 200_000_000, "{:#?}", said(world, ground));
        }
        let texts = said(world, ground);
        assert_landed(world, &texts);
        // Past the moment and flown at least once.
        if world.t_us() as f64 * 1e-6 > override_s && attempt > 0 {
            break;
        }
    }
    worst_m
}

#[test]
fn prop_thrust_that_means_a_climb_rate_is_refused_or_set_with_consent() {
    let wrong = |plant: &mut PlantConfig| {
        plant.board.parameters.insert("GUID_OPTIONS".into(), 0.0);
    };
    let mut world = board(Firmware::Ardupilot, 6, |plant, _| wrong(plant));
    let mut ground = Ground::new();
    pass(&mut world, &mut ground, 15.0);
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED));
    assert_said(&mut world, &mut ground, &["GUID_OPTIONS = 0", "climb rate", "set_parameters"]);
    assert!(!world.truth().armed);

    for lost_echoes in [false, true] {
        let mut world = board(Firmware::Ardupilot, 6, |plant, pilot| {
            wrong(plant);
            plant.board.parameters.insert("GUID_TIMEOUT".into(), 3.0);
            plant.board.manners.lost_echoes = lost_echoes;
            pilot.board_set_parameters = true;
        });
        let mut ground = Ground::new();
        fly_square(&mut world, &mut ground);
        assert_said(&mut world, &mut ground, &["GUID_OPTIONS set from 0 to 8"]);
        assert_said(&mut world, &mut ground, &["GUID_TIMEOUT is now 0.5"]);
    }
}

#[test]
fn prop_failsafes_that_would_climb_are_refused() {
    for (name, value) in [("COM_OBL_RC_ACT", 0.0), ("COM_OBL_RC_ACT", 3.0), ("COM_OF_LOSS_T", 5.0)]
    {
        let mut world = board(Firmware::Px4, 6, |plant, _| {
            plant.board.parameters.insert(name.into(), value);
        });
        let mut ground = Ground::new();
        pass(&mut world, &mut ground, 15.0);
        ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
        assert_said(&mut world, &mut ground, &["arming refused", name]);
        // The same with consent flies.
        let mut world = board(Firmware::Px4, 6, |plant, pilot| {
            plant.board.parameters.insert(name.into(), value);
            pilot.board_set_parameters = true;
        });
        fly_square(&mut world, &mut Ground::new());
    }
}

#[test]
fn prop_an_older_release_is_asked_by_its_own_names_and_messages() {
    let mut world = board(Firmware::Ardupilot, 7, |plant, _| {
        plant.board.parameters.insert("SYSID_MYGCS".into(), 255.0);
        plant.board.manners.no_highres_imu = true;
    });
    let mut ground = Ground::new();
    let worst_m = fly_square(&mut world, &mut ground);
    println!("RAW_IMU in whole milli-g: {worst_m:.2} m");
    assert!(worst_m < 1.2, "{worst_m}");
    assert_said(&mut world, &mut ground, &["SYSID_MYGCS = 255", "needed 1"]);
}

#[test]
fn prop_a_vehicle_type_that_gets_no_thrust_is_refused() {
    let mut world = board(Firmware::Px4, 8, |plant, _| {
        plant.board.parameters.insert("MAV_TYPE".into(), 16.0);
    });
    let mut ground = Ground::new();
    pass(&mut world, &mut ground, 15.0);
    ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    assert_said(&mut world, &mut ground, &["arming refused", "MAV_TYPE = 16"]);

    // With consent it is set, and acts after a restart of the board only.
    let mut world = board(Firmware::Px4, 8, |plant, pilot| {
        plant.board.parameters.insert("MAV_TYPE".into(), 16.0);
        pilot.board_set_parameters = true;
    });
    let mut ground = Ground::new();
    pass(&mut world, &mut ground, 15.0);
    ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    assert_said(&mut world, &mut ground, &["arming refused", "vehicle type 16", "restart"]);
    world.plant_mut().inject(Fault::BoardReboot).unwrap();
    fly_square(&mut world, &mut ground);
}

#[test]
fn prop_thrust_that_goes_nowhere_is_noticed_before_take_off() {
    for firmware in REAL {
        let mut world = board(firmware, 8, |plant, _| plant.board.manners.no_thrust = true);
        let mut ground = Ground::new();
        let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 1.2];
        ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
        arm_patiently(&mut world, &mut ground, 60.0);
        let start_us = world.t_us();
        while world.pilot().mode() != Mode::Disarmed {
            fly_for(&mut world, 0.01);
            assert_ne!(world.pilot().mode(), Mode::Takeoff, "{:#?}", ground.texts);
            assert!(world.t_us() - start_us < 20_000_000);
        }
        let texts = said(&mut world, &mut ground);
        assert!(texts.iter().any(|t| t.contains("does not fly our setpoints")), "{texts:#?}");
        assert_landed(&world, &texts);
    }
}

#[test]
fn prop_intervals_that_a_reboot_forgot_are_asked_for_again() {
    for firmware in REAL {
        let mut world = board(firmware, 9, |_, _| {});
        let mut ground = Ground::new();
        pass(&mut world, &mut ground, 12.0);
        world.plant_mut().inject(Fault::BoardReboot).unwrap();
        fly_for(&mut world, 0.5);
        let took_s = arm_patiently(&mut world, &mut ground, 60.0);
        println!("{firmware:?}: armed {took_s:.1} s after a reboot");
        assert!(took_s < 12.0, "{took_s}");
        assert_said(&mut world, &mut ground, &["board has restarted"]);
        fly_square_after_disarm(&mut world, &mut ground);
    }
}

fn fly_square_after_disarm(world: &mut Lockstep, ground: &mut Ground) {
    let disarm = [0.0; 7];
    ground.command(world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, disarm);
    until(world, Mode::Disarmed, 5.0);
    fly_square(world, ground);
}

#[test]
fn prop_refused_and_decimated_rates_are_worked_around() {
    for firmware in REAL {
        for (fastest_hz, decimation) in [(130.0, 1), (101.0, 1), (0.0, 2)] {
            let mut world = board(firmware, 10, |plant, _| {
                plant.board.manners.fastest_hz = fastest_hz;
                plant.board.manners.decimation = decimation;
            });
            let mut ground = Ground::new();
            // What cannot be had (IMU 100 Hz at least) is refused with its rate.
            pass(&mut world, &mut ground, 15.0);
            let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
            let texts = said(&mut world, &mut ground);
            let slow = texts.iter().any(|t| t.contains("at least"));
            println!("{firmware:?} fastest {fastest_hz} every {decimation}: {answer:?} {slow}");
            if answer == Some(MavResult::MAV_RESULT_TEMPORARILY_REJECTED) {
                assert!(slow, "{texts:#?}");
                assert!(firmware == Firmware::Px4 && fastest_hz == 101.0, "could have been had");
                continue;
            }
            fly_square_after_disarm(&mut world, &mut ground);
        }
    }
}

#[test]
fn prop_a_board_whose_heading_is_off_and_drifts_is_flown_straight() {
    for firmware in REAL {
        for offset_deg in [10.0, -10.0] {
            let mut world = board(firmware, 15, |plant, _| {
                plant.effects = EffectSet::nominal()
                    .with("N13", &[("offset", offset_deg)])
                    .and_then(|e| e.with("H2", &[("rate", 3.0)]))
                    .unwrap();
            });
            let mut ground = Ground::new();
            let worst_m = fly_square(&mut world, &mut ground);
            println!("{firmware:?} {offset_deg} deg and 3 deg/min: {worst_m:.2} m");
            assert!(worst_m < 1.4, "{worst_m}");
        }
    }
}

#[test]
fn prop_a_line_that_is_too_slow_is_noticed_and_asked_for_less() {
    let mut world = board(Firmware::Ardupilot, 16, |plant, _| plant.board.manners.baud = 115_200);
    let mut ground = Ground::new();
    pass(&mut world, &mut ground, 20.0);
    assert_said(&mut world, &mut ground, &["board answers after", "921600"]);
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    let texts = said(&mut world, &mut ground);
    println!("115200 baud: {answer:?} {:?}", texts.last());
    // The same line at 921600 says nothing.
    let mut world = board(Firmware::Ardupilot, 16, |plant, _| plant.board.manners.baud = 921_600);
    let mut ground = Ground::new();
    let worst_m = fly_square(&mut world, &mut ground);
    let texts = said(&mut world, &mut ground);
    assert!(!texts.iter().any(|t| t.contains("board answers")), "{texts:#?}");
    println!("921600 baud: {worst_m:.2} m");
}

#[test]
fn prop_a_profile_that_is_not_the_boards_is_refused() {
    let mut world = board(Firmware::Ardupilot, 17, |_, pilot| {
        pilot.board_profile = BoardProfile::Px4;
    });
    let mut ground = Ground::new();
    pass(&mut world, &mut ground, 15.0);
    ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    assert_said(&mut world, &mut ground, &["arming refused", "ardupilot"]);
}
