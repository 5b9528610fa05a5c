//! Flights with a Crazyflie in the place of the board: the square over good and bad radios, fades, and what fails.

use super::boards::{arm_patiently, assert_said, board, pass, said};
use super::*;
use crate::board::Firmware;
use crate::board::crazyflie::Build;
use crate::faults::{CrazyflieFault as Breaks, Fault};
use haltere_pilot::{BoardProfile, Input, LinkId, TagProtocol};

/// Share of packets that a radio loses and their largest age, s.
type Radio = [f64; 2];

fn crazyflie(seed: u64, build: Build, [lost, age_s]: Radio) -> Lockstep {
    board(Firmware::Crazyflie, seed, |plant, pilot| {
        let settings = &mut plant.board.crazyflie;
        (settings.build, settings.radio.lost, settings.radio.age_s) = (build, lost, age_s);
        (pilot.board_profile, pilot.tag_protocol) =
            (BoardProfile::Crazyflie, TagProtocol::Crazyflie);
    })
}

/// Whole on the floor of the room, and nothing turns by our order. Builds that arm by themselves stay hot.
#[track_caller]
fn assert_stands(world: &Lockstep, texts: &[String]) {
    let truth = world.truth();
    assert!(!truth.crashed && truth.on_ground, "{truth:?} {texts:#?}");
    assert_in_room(world);
}

/// Takes off and flies the square; `each` hears of every control step until it is disarmed.
fn fly(world: &mut Lockstep, ground: &mut Ground, mut each: impl FnMut(&mut Lockstep)) {
    ground.upload(world, &square());
    arm_patiently(world, ground, 30.0);
    ground.command(world, MavCmd::MAV_CMD_MISSION_START, [0.0; 7]);
    let start_us = world.t_us();
    let mut flew = false;
    while !flew || world.pilot().mode() != Mode::Disarmed {
        fly_for(world, 0.01);
        ground.listen(world);
        flew |= world.pilot().mode() == Mode::Mission;
        each(world);
        assert!(world.t_us() - start_us < 90_000_000, "{:#?}", said(world, ground));
    }
}

/// Distance from where it is asked to be, m.
fn error_m(world: &Lockstep) -> f64 {
    let wanted = world.pilot().control_record().pos_setpoint_E_m;
    let is = world.truth().pos_E_m.to_array();
    let squares = (0..3).map(|i| wanted[i].map_or(0.0, |wanted| (wanted - is[i]).powi(2)));
    squares.sum::<f64>().sqrt()
}

/// 20 flights: without loss, with 2 and with 10 % of it, packets up to 20 ms old.
#[test]
fn prop_the_square_is_flown_over_a_radio_that_loses_and_waits() {
    let (mut squares, mut steps) = (0.0, 0.0);
    for seed in 1..=20 {
        let build = [Build::Flapper, Build::Bolt, Build::Cf2][seed as usize % 3];
        let radio = [[0.0, 0.0], [0.02, 0.02], [0.1, 0.02], [0.1, 0.0]][seed as usize % 4];
        let (mut world, mut ground) = (crazyflie(seed, build, radio), Ground::new());
        fly(&mut world, &mut ground, |world| {
            if world.pilot().mode() == Mode::Mission {
                squares += error_m(world).powi(2);
                steps += 1.0;
            }
        });
        let texts = said(&mut world, &mut ground);
        assert_stands(&world, &texts);
        for words in ["descend", "ignored", "does not fly our setpoints", "late"] {
            assert!(!texts.iter().any(|text| text.contains(words)), "{seed}: {texts:#?}");
        }
    }
    let rms_m = f64::sqrt(squares / steps);
    // The generic board, with a sniffer's tag on wires, flies the same seeds within 0.089 m.
    assert!(rms_m < 0.10, "{rms_m}");
}

/// A fade at the second corner of the square; what was sent in it, and what was said.
fn faded(for_s: f64) -> (Lockstep, Vec<String>, f64) {
    let (mut ground, mut faded_us) = (Ground::new(), None);
    let sent: Sent = Sent::default();
    let mut world = crazyflie(3, Build::Flapper, [0.0, 0.0]).with_tap(tap(&sent));
    let mut hover_frac = 0.0;
    fly(&mut world, &mut ground, |world| {
        if faded_us.is_none() && world.pilot().mission_progress()[0] >= 2 {
            faded_us = Some(world.t_us());
            hover_frac = world.pilot().control_record().thrust_base_frac;
            world.plant_mut().inject(Fault::Crazyflie(Breaks::Fade { for_s })).unwrap();
        }
    });
    pass(&mut world, &mut ground, 2.0);
    // From the loss of the IMU on; what was sent before may be the last that was heard.
    let from_us = faded_us.unwrap() + 250_000;
    let until_us = faded_us.unwrap() + (for_s * 1e6) as u64;
    let most = sent
        .lock()
        .unwrap()
        .iter()
        .filter(|(t_us, link, _)| *link == LinkId::Board && (from_us..until_us).contains(t_us))
        .filter_map(|(_, _, bytes)| {
            let [15, header, .., low, high] = bytes.as_slice() else { return None };
            (header & 0xF3 == 0x30).then(|| u16::from_le_bytes([*low, *high]))
        })
        .max();
    let share = most.map_or(0.0, |most| f64::from(most) / 65535.0 / hover_frac);
    (world, ground.texts, share)
}

#[test]
fn val_fades_end_as_the_board_lets_them() {
    for (for_s, words) in [
        (0.3, "IMU is back"),
        (0.6, "IMU is back"),
        // Its blocks are gone after a second of silence, and made again.
        (1.2, "board was silent for 1.2 s"),
        // Motors off and locked at 2 s, wherever the last thrust has brought it: here it falls the rest.
        (3.0, "locked, motors stay off"),
    ] {
        let (world, texts, share) = faded(for_s);
        assert!(texts.iter().any(|text| text.contains(words)), "{for_s}: {texts:#?}");
        assert!(texts.iter().any(|text| text.contains("no usable estimate: no IMU")), "{for_s}");
        assert!((0.5..1.0).contains(&share), "{for_s}: {share} of the hover thrust in the slot");
        if for_s < 2.0 {
            assert_stands(&world, &texts);
        } else {
            assert!(world.truth().on_ground, "{texts:#?}");
            assert_in_room(&world);
        }
    }
}

/// How it ends.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Ends {
    /// The square is flown to its end.
    FliesOn,
    /// It comes down whole before its end.
    ComesDown,
    /// The board has cut its motors: nothing can be done.
    Falls,
}

/// What breaks at the second corner of the square, how it ends, and what is said.
#[test]
fn prop_each_failure_has_its_end_and_its_words() {
    use Ends::{ComesDown, Falls, FliesOn};
    let rows: [(Build, Breaks, Ends, &[&str]); 16] = [
        // It must be down before the board cuts its motors 4 s later.
        (Build::Flapper, Breaks::ChipDead(true), ComesDown, &["no UWB measurements"]),
        (Build::Bolt, Breaks::ChipDead(true), ComesDown, &["no UWB measurements"]),
        (Build::Flapper, Breaks::BlocksGone, ComesDown, &["rows have stopped", "IMU is back"]),
        (Build::Flapper, Breaks::RadioReset, ComesDown, &["IMU is back"]),
        (Build::Flapper, Breaks::Congested(true), ComesDown, &["link to the board is late"]),
        (Build::Flapper, Breaks::SecondClient(true), ComesDown, &["is another client connected?"]),
        (Build::Flapper, Breaks::Tdoa3(true), ComesDown, &["no UWB measurements"]),
        (Build::Flapper, Breaks::DongleOut(true), ComesDown, &["board silent for 1.0 s"]),
        // Armed again by itself within 0.2 s.
        (Build::Flapper, Breaks::Disarm, FliesOn, &["somebody disarmed it"]),
        (Build::Flapper, Breaks::NoPort9(true), FliesOn, &[]),
        (Build::Bolt, Breaks::NoPort9(true), FliesOn, &[]),
        (Build::Flapper, Breaks::MainReset, Falls, &["board has restarted"]),
        (Build::Flapper, Breaks::OtherTable, Falls, &["board has restarted"]),
        (Build::Bolt, Breaks::Disarm, Falls, &["it is disarmed"]),
        (Build::Flapper, Breaks::Lock, Falls, &["locked, motors stay off"]),
        (Build::Flapper, Breaks::DeckFault(true), Falls, &["a deck does not answer"]),
    ];
    for (build, breaks, ends, words) in rows {
        let (mut world, mut ground) = (crazyflie(1, build, [0.0, 0.0]), Ground::new());
        let mut reached = 0;
        let mut broken = false;
        fly(&mut world, &mut ground, |world| {
            reached = reached.max(world.pilot().mission_progress()[0]);
            if !broken && reached >= 2 {
                broken = true;
                world.plant_mut().inject(Fault::Crazyflie(breaks)).unwrap();
            }
        });
        let texts = said(&mut world, &mut ground);
        for words in words {
            assert!(
                texts.iter().any(|text| text.contains(words)),
                "{breaks:?}, {words}: {texts:#?}"
            );
        }
        assert_eq!(reached >= 5, ends == FliesOn, "{breaks:?}: {texts:#?}");
        if ends != Falls {
            assert_stands(&world, &texts);
        }
    }
}

/// Its driver tells when it is gone and when it is back; the board has waited for 0.7 s, and flies on level by itself.
#[test]
fn prop_a_dongle_that_is_put_in_again_lands_it() {
    let link = LinkId::Board;
    let (mut world, mut ground) = (crazyflie(1, Build::Flapper, [0.0, 0.0]), Ground::new());
    let mut changes = [
        (0, Breaks::DongleOut(true), Input::LinkDown { link }),
        (700_000, Breaks::DongleOut(false), Input::LinkUp { link }),
    ]
    .into_iter()
    .peekable();
    let mut since_us = None;
    fly(&mut world, &mut ground, |world| {
        if since_us.is_none() && world.pilot().mission_progress()[0] >= 2 {
            since_us = Some(world.t_us());
        }
        let due = |(after_us, ..): &(u64, Breaks, Input<'_>)| {
            since_us.is_some_and(|us| world.t_us() >= us + after_us)
        };
        if let Some((_, breaks, input)) = changes.next_if(due) {
            world.plant_mut().inject(Fault::Crazyflie(breaks)).unwrap();
            world.input(input);
        }
    });
    let texts = said(&mut world, &mut ground);
    assert_stands(&world, &texts);
    assert!(texts.iter().any(|text| text.contains("IMU is back")), "{texts:#?}");
}

/// What forbids arming, and what is only told.
#[test]
fn prop_what_is_wrong_on_the_floor_is_named() {
    for (breaks, words, arms) in [
        (Breaks::Lock, "locked, motors stay off: switch the board off and on", false),
        (Breaks::Crash, "has crashed, motors stay off", false),
        (Breaks::DeckFault(true), "look at the Loco deck", false),
        (Breaks::Tdoa3(true), "anchors speak TDoA3", false),
        (Breaks::DongleOut(true), "no Crazyflie answers", false),
        (Breaks::AnchorsOff([0.5, 0.0, 0.0]), "0 by 0.5 m, 1 by 0.5 m", true),
        // The order of older firmware.
        (Breaks::NoPort9(true), "firmware 2025.12, protocol 11", true),
    ] {
        let (mut world, mut ground) = (crazyflie(1, Build::Bolt, [0.0, 0.0]), Ground::new());
        world.plant_mut().inject(Fault::Crazyflie(breaks)).unwrap();
        pass(&mut world, &mut ground, 6.0);
        let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
        assert_eq!(
            answer == Some(MavResult::MAV_RESULT_ACCEPTED),
            arms,
            "{breaks:?} {:#?}",
            ground.texts
        );
        assert_said(&mut world, &mut ground, &[words]);
    }
}

/// Restarted on the floor with another firmware: what it logs has other ids by then.
#[test]
fn prop_another_build_is_learned_anew() {
    let (mut world, mut ground) = (crazyflie(1, Build::Flapper, [0.02, 0.01]), Ground::new());
    pass(&mut world, &mut ground, 5.0);
    world.plant_mut().inject(Fault::Crazyflie(Breaks::OtherTable)).unwrap();
    pass(&mut world, &mut ground, 6.0);
    fly(&mut world, &mut ground, |_| {});
    let texts = said(&mut world, &mut ground);
    assert_stands(&world, &texts);
    assert!(texts.iter().any(|text| text.contains("board has restarted")), "{texts:#?}");
}
