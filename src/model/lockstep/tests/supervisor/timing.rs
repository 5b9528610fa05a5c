//! Time in flight: a board whose clock jumps, a control loop that comes late.

use haltere_dialect::mav_stream::{self, MavSplitter};

use super::*;
use crate::lockstep::{Damage, STEP_US};

/// The board's clock is another by so many seconds from a time on, µs of simulated time: in every stamp that
/// it sends.
fn other_clock(from_us: u64, by_s: f64) -> Damage {
    let mut splitter = MavSplitter::new();
    let by_us = (by_s * 1e6) as i64;
    Box::new(move |t_us, link, bytes| {
        if link != LinkId::Board {
            return;
        }
        splitter.push(bytes);
        bytes.clear();
        while let Some(next) = splitter.next() {
            let Ok(frame) = next else { continue };
            let Ok(mut message) = frame.decode() else { continue };
            let header = frame.header;
            if t_us >= from_us {
                set_clock(&mut message, by_us);
            }
            let (system, component) = (header.system_id, header.component_id);
            mav_stream::encode(bytes, system, component, header.sequence, &message);
        }
    })
}

fn set_clock(message: &mut MavMessage, by_us: i64) {
    let ms = |t: u32| (i64::from(t) + by_us / 1000).max(0) as u32;
    match message {
        // An answer carries the board's time; a question carries none.
        MavMessage::TIMESYNC(m) if m.tc1 != 0 => m.tc1 += by_us * 1000,
        MavMessage::HIGHRES_IMU(m) => m.time_usec = m.time_usec.saturating_add_signed(by_us),
        MavMessage::ATTITUDE(m) => m.time_boot_ms = ms(m.time_boot_ms),
        MavMessage::ATTITUDE_QUATERNION(m) => m.time_boot_ms = ms(m.time_boot_ms),
        MavMessage::ATTITUDE_TARGET(m) => m.time_boot_ms = ms(m.time_boot_ms),
        MavMessage::SYSTEM_TIME(m) => m.time_boot_ms = ms(m.time_boot_ms),
        _ => {}
    }
}

fn error_m(world: &Lockstep) -> f64 {
    (world.pilot().estimate().pos_E_m - world.truth().pos_E_m).norm()
}

/// Forwards, backwards, far and just beyond what is noticed: told, and flown on by time of arrival.
#[test]
fn prop_a_board_clock_that_jumps_is_told_and_flown_on() {
    let jumps_s = [-3.0, -0.4, -0.15, -0.06, 0.06, 0.15, 0.4, 3.0, 4000.0];
    let flights: Vec<_> =
        jumps_s.iter().flat_map(|by_s| PHASES.into_iter().map(move |p| (*by_s, p))).collect();
    flights.into_par_iter().for_each(|(by_s, phase)| {
        // Where `aloft` leaves off differs with the phase: the first look finds out when that is.
        let (calm, _) = aloft(world(21), phase);
        let from_us = calm.t_us() + 300_000;
        let world = world(21).with_damage(other_clock(from_us, by_s));
        let (mut world, mut ground) = aloft(world, phase);
        let mode = world.pilot().mode();
        assert!(world.t_us() <= from_us, "the same flight");
        let mut worst_m: f64 = 0.0;
        for _ in 0..30 {
            fly_for(&mut world, 0.1);
            worst_m = worst_m.max(error_m(&world));
            ground.listen(&mut world);
        }
        println!("clock {by_s:+} s, {phase:?}: estimate off by {worst_m:.2} m at worst");
        assert_said(&mut world, &mut ground, "the board's clock jumped");
        assert_eq!(world.pilot().mode(), mode, "{by_s} s: {:#?}", ground.texts);
        assert!(worst_m < 0.5, "{by_s} s {phase:?}: estimate off by {worst_m} m");
        if phase == Phase::Hover {
            let land = ground.command(&mut world, MavCmd::MAV_CMD_NAV_LAND, [0.0; 7]);
            assert_eq!(land, Some(MavResult::MAV_RESULT_ACCEPTED));
        }
        assert_comes_down(&mut world, &mut ground, 60.0);
        let jumps = ground.texts.iter().filter(|t| t.contains("clock jumped")).count();
        assert_eq!(jumps, 1, "{:#?}", ground.texts);
    });
}

/// A clock that is told anew within what round trips scatter is none that jumped.
#[test]
fn prop_a_board_clock_that_moves_a_little_is_followed() {
    let world = world(22).with_damage(other_clock(0, 0.0));
    let (calm, _) = aloft(world, Phase::Hover);
    let damage = other_clock(calm.t_us() + 300_000, 0.03);
    let (mut world, mut ground) = aloft(super::world(22).with_damage(damage), Phase::Hover);
    fly_for(&mut world, 6.0);
    assert_eq!(world.pilot().mode(), Mode::Hold);
    assert!(!said(&mut world, &mut ground, "clock"), "{:#?}", ground.texts);
    assert!(error_m(&world) < 0.5);
}

/// The computer wakes the core so much too late, every so many milliseconds.
fn limp(world: &mut Lockstep, seconds: f64, every_ms: u64) {
    let end_us = world.t_us() + (seconds * 1e6) as u64;
    while world.t_us() < end_us {
        let t_us = world.t_us();
        world.stall_until(t_us + every_ms * 1000 - STEP_US);
        world.step();
    }
}

#[test]
fn prop_a_late_loop_is_told_and_flown_on() {
    for phase in PHASES {
        let (mut world, mut ground) = aloft(world(23), phase);
        let mode = world.pilot().mode();
        // One step of six is late.
        for _ in 0..40 {
            fly_for(&mut world, 0.05);
            limp(&mut world, 0.018, 18);
        }
        assert!(!said(&mut world, &mut ground, "late"), "{:#?}", ground.texts);
        limp(&mut world, 4.0, 18);
        assert_said(&mut world, &mut ground, "control loop is late: ");
        assert_said(&mut world, &mut ground, "% of steps by over 5 ms");
        assert_eq!(world.pilot().mode(), mode, "{:#?}", ground.texts);
        assert!(error_m(&world) < 0.5 && world.truth().height_m > 0.8, "{:?}", world.truth());
        fly_for(&mut world, 4.0);
        assert_said(&mut world, &mut ground, "control loop is punctual again");
        if phase == Phase::Hover {
            let land = ground.command(&mut world, MavCmd::MAV_CMD_NAV_LAND, [0.0; 7]);
            assert_eq!(land, Some(MavResult::MAV_RESULT_ACCEPTED));
        }
        // Late to the end it comes down as well.
        while world.pilot().mode() != Mode::Disarmed {
            limp(&mut world, 0.1, 18);
            ground.listen(&mut world);
            assert!(world.t_us() < 90_000_000, "{:#?}", ground.texts);
        }
        assert_landed(&world, &ground.texts);
    }
}
