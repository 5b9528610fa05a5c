//! Whole flights in lockstep: what they share, and one file per kind of question.

mod anchors;
mod at_rest;
mod board_word;
mod boards;
mod boards_in_flight;
mod crazyflie;
mod determinism;
mod ending;
mod faults;
mod fence;
mod gains;
mod ground;
mod heading;
mod hostile;
mod hover;
mod instances;
mod kept;
mod landing;
mod late;
mod low;
mod news;
mod pauses;
mod programs;
mod rooms;
mod second_board;
mod services;
mod shadow;
mod streams;
mod supervisor;
mod tipped;
mod touch_down;
mod velocities;

use haltere_dialect::mav::haltere::{MISSION_ITEM_INT_DATA, MavCmd, MavFrame, MavResult};

pub(super) use super::local_item as item;
use super::{Damage, Ground, Lockstep, Tap};
use crate::PlantConfig;
use crate::random::Stream;
use haltere_pilot::{Mode, PilotConfig};

pub(super) fn pilot_config(plant: &PlantConfig) -> PilotConfig {
    let mut pilot = PilotConfig::default();
    pilot.flight.gear_height_m = plant.vehicle.body.gear_m;
    pilot
}

pub(super) fn world(seed: u64) -> Lockstep {
    let plant = PlantConfig::hall(seed);
    let survey = plant.survey.clone();
    let pilot = pilot_config(&plant);
    Lockstep::new(plant, pilot, &survey).unwrap()
}

/// Over the middle of the hall, 1 m sides, landing where it began.
pub(super) fn square() -> Vec<MISSION_ITEM_INT_DATA> {
    let mut items = vec![item(MavCmd::MAV_CMD_NAV_TAKEOFF, [5.0, 5.0, -1.2], 0.0)];
    for (north, east) in [(6.0, 5.0), (6.0, 6.0), (5.0, 6.0), (5.0, 5.0)] {
        items.push(item(MavCmd::MAV_CMD_NAV_WAYPOINT, [north, east, -1.2], 1.0));
    }
    items.push(item(MavCmd::MAV_CMD_NAV_LAND, [0.0; 3], 0.0));
    items
}

pub(super) const ARM: [f32; 7] = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];

/// Arms as soon as it is possible.
pub(super) fn arm(world: &mut Lockstep, ground: &mut Ground) {
    for _ in 0..40 {
        match ground.command(world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM) {
            Some(MavResult::MAV_RESULT_ACCEPTED) => return,
            _ => world.run_until(world.t_us() + 500_000),
        }
    }
    panic!("not armed: {:?}", ground.texts);
}

pub(super) fn fly_for(world: &mut Lockstep, seconds: f64) {
    world.run_until(world.t_us() + (seconds * 1e6) as u64);
}

/// Flies on until a mode is in force. The time it took, s.
pub(super) fn until(world: &mut Lockstep, mode: Mode, limit_s: f64) -> f64 {
    let start_us = world.t_us();
    while world.pilot().mode() != mode {
        let elapsed_s = (world.t_us() - start_us) as f64 * 1e-6;
        assert!(elapsed_s < limit_s, "still {:?} after {elapsed_s} s", world.pilot().mode());
        world.step();
    }
    (world.t_us() - start_us) as f64 * 1e-6
}

/// In the air at 1.2 m over (5, 5), holding.
pub(super) fn hovering(mut world: Lockstep) -> (Lockstep, Ground) {
    let mut ground = Ground::new();
    let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 1.2];
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    arm(&mut world, &mut ground);
    until(&mut world, Mode::Hold, 20.0);
    fly_for(&mut world, 1.0);
    (world, ground)
}

/// Nothing is broken, it stands on the floor inside the room, disarmed.
pub(super) fn assert_landed(world: &Lockstep, texts: &[String]) {
    let truth = world.truth();
    assert!(!truth.crashed && truth.on_ground && !truth.armed, "{truth:?} {texts:?}");
    assert_in_room(world);
}

pub(super) fn assert_in_room(world: &Lockstep) {
    let pos = world.truth().pos_E_m;
    let inside = |x: f64| (0.3..=9.7).contains(&x);
    assert!(inside(pos.x()) && inside(pos.y()), "{pos:?}");
}

/// Bytes that are lost or added: one in `one_in` bytes is dropped, and as many are inserted.
pub(super) fn noisy_wire(seed: u64, one_in: f64) -> Damage {
    let mut rng = Stream::new(seed, "noisy wire");
    Box::new(move |_, link, bytes| {
        if matches!(link, haltere_pilot::LinkId::Ground(_)) {
            return;
        }
        let before = std::mem::take(bytes);
        for byte in before {
            if rng.uniform() * one_in >= 1.0 {
                bytes.push(byte);
            }
            if rng.uniform() * one_in < 1.0 {
                bytes.push((rng.uniform() * 256.0) as u8);
            }
        }
    })
}

/// All output of a flight as one list.
pub(super) type Sent = std::sync::Arc<std::sync::Mutex<Vec<(u64, haltere_pilot::LinkId, Vec<u8>)>>>;

pub(super) fn tap(sent: &Sent) -> Tap {
    let sent = sent.clone();
    Box::new(move |t_us, link, bytes| {
        if let Ok(mut sent) = sent.lock() {
            sent.push((t_us, link, bytes.to_vec()));
        }
    })
}
