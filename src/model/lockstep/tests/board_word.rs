//! What the board, or whoever speaks with its number, says of being armed: one word may be wrong.

use haltere_dialect::mav::haltere::{
    HEARTBEAT_DATA, MavAutopilot, MavMessage, MavModeFlag, MavState, MavType,
};
use haltere_dialect::mav_stream;

use super::boards::{assert_said, land, pass, said, to_board};
use super::*;
use haltere_pilot::{Input, LinkId};

/// A heartbeat as the generic board sends it.
fn beat(armed: bool) -> Vec<u8> {
    let mut base_mode = MavModeFlag::MAV_MODE_FLAG_STABILIZE_ENABLED;
    base_mode.set(MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED, armed);
    let message = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
        custom_mode: 0,
        mavtype: MavType::MAV_TYPE_FLAPPING_WING as u8,
        autopilot: MavAutopilot::MAV_AUTOPILOT_GENERIC as u8,
        base_mode,
        system_status: MavState::MAV_STATE_STANDBY as u8,
        mavlink_version: 3,
    });
    let mut bytes = Vec::new();
    mav_stream::encode(&mut bytes, 1, 1, 0, &message);
    bytes
}

fn say(world: &mut Lockstep, armed: bool) {
    world.input(Input::Bytes { link: LinkId::Board, bytes: &beat(armed) });
}

/// Waits for the board's own heartbeat, at 1 Hz on the whole second, to be this old, s.
fn after_its_own(world: &mut Lockstep, age_s: f64) {
    let phase_us = (age_s * 1e6) as u64;
    while world.t_us() % 1_000_000 != phase_us {
        world.step();
    }
}

/// Setpoints with thrust from here on.
fn thrusts_since(sent: &Sent, t_us: u64) -> usize {
    let with_thrust = |m: &(u64, MavMessage)| {
        m.0 > t_us && matches!(&m.1, MavMessage::SET_ATTITUDE_TARGET(s) if s.thrust > 0.0)
    };
    to_board(sent).into_iter().filter(with_thrust).count()
}

#[test]
fn regress_one_heartbeat_that_says_disarmed_does_not_end_a_flight() {
    for at_s in [0.1, 0.4, 0.7] {
        let (mut world, mut ground) = hovering(world(31));
        for _ in 0..3 {
            after_its_own(&mut world, at_s);
            say(&mut world, false);
            pass(&mut world, &mut ground, 1.5);
            assert_eq!(world.pilot().mode(), Mode::Hold, "{:#?}", said(&mut world, &mut ground));
            assert!((world.truth().height_m - 1.2).abs() < 0.5, "{:?}", world.truth());
        }
        assert_said(&mut world, &mut ground, &["disarmed", "unless it says so again"]);
        assert_said(&mut world, &mut ground, &["armed after all"]);
        land(&mut world, &mut ground);
    }
}

#[test]
fn regress_one_heartbeat_that_says_disarmed_does_not_end_a_climb_or_a_landing() {
    let mut world = world(32);
    let mut ground = Ground::new();
    let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 2.5];
    ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
    arm(&mut world, &mut ground);
    until(&mut world, Mode::Takeoff, 20.0);
    while world.truth().height_m < 0.8 {
        world.step();
    }
    say(&mut world, false);
    until(&mut world, Mode::Hold, 20.0);
    ground.command(&mut world, MavCmd::MAV_CMD_NAV_LAND, [0.0; 7]);
    fly_for(&mut world, 1.0);
    say(&mut world, false);
    until(&mut world, Mode::Disarmed, 20.0);
    let texts = said(&mut world, &mut ground);
    assert_landed(&world, &texts);
}

/// A person's kill switch wins, and what it has ended nobody but us begins again.
#[test]
fn prop_two_heartbeats_that_say_disarmed_end_a_flight_for_good() {
    for (apart_s, at_once) in [(0.5, true), (0.3, false)] {
        let sent = Sent::default();
        let (world, mut ground) = hovering(world(33));
        let mut world = world.with_tap(tap(&sent));
        after_its_own(&mut world, 0.1);
        say(&mut world, false);
        fly_for(&mut world, apart_s - 0.01);
        assert_eq!(world.pilot().mode(), Mode::Hold);
        fly_for(&mut world, 0.01);
        say(&mut world, false);
        if at_once {
            assert_eq!(world.pilot().mode(), Mode::Disarmed);
        }
        // The next one says armed again: too late.
        pass(&mut world, &mut ground, 1.0);
        assert_eq!(world.pilot().mode(), Mode::Disarmed, "{apart_s}");
        let ended_us = world.t_us();
        pass(&mut world, &mut ground, 8.0);
        assert_eq!(thrusts_since(&sent, ended_us), 0);
        assert_said(&mut world, &mut ground, &["not by us"]);
        // The board's own failsafe has brought it down, and it is armed by us again.
        assert!(world.truth().on_ground && !world.truth().armed);
        arm(&mut world, &mut ground);
        until(&mut world, Mode::Idle, 2.0);
    }
}

#[test]
fn prop_on_the_floor_nothing_is_taken_back() {
    let sent = Sent::default();
    let mut world = world(34).with_tap(tap(&sent));
    let mut ground = Ground::new();
    arm(&mut world, &mut ground);
    until(&mut world, Mode::Idle, 2.0);
    after_its_own(&mut world, 0.2);
    assert_eq!(world.pilot().mode(), Mode::Idle);
    say(&mut world, false);
    fly_for(&mut world, 0.2);
    assert_eq!(world.pilot().mode(), Mode::Idle);
    say(&mut world, true);
    pass(&mut world, &mut ground, 2.0);
    assert_eq!(world.pilot().mode(), Mode::Disarmed);
    assert!(!world.truth().armed, "{:#?}", said(&mut world, &mut ground));
    assert_eq!(thrusts_since(&sent, 0), 0);
}

#[test]
fn prop_an_acknowledged_disarm_is_believed_at_its_first_heartbeat() {
    let (mut world, mut ground) = hovering(world(35));
    ground.command(&mut world, MavCmd::MAV_CMD_NAV_LAND, [0.0; 7]);
    until(&mut world, Mode::Disarming, 20.0);
    let took_s = until(&mut world, Mode::Disarmed, 20.0);
    // One interval of the heartbeat, and the way of the order and its answer.
    assert!(took_s < 1.3, "{took_s}");
    let texts = said(&mut world, &mut ground);
    assert!(!texts.iter().any(|t| t.contains("says that it is disarmed")), "{texts:#?}");
}
