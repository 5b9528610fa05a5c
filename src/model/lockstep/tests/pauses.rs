//! The companion stands still and comes back: nothing leaps, nothing takes off again.

use rayon::prelude::*;

use super::*;
use crate::board::Firmware;
use crate::faults::{Fault, FaultKind};
use crate::lockstep::STEP_US;
use haltere_pilot::Input;

/// In which part of the flight it stands still.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Part {
    Spool,
    Climb,
    Hover,
    Mission,
    Landing,
    /// A landing because the battery is empty.
    Empty,
    Descent,
}

/// What waits to be read when it comes back, and whether the core wakes before anything of it is read.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Waits {
    most_bytes: usize,
    wakes_first: bool,
}

/// All; what the buffers of a kernel hold, half a second; nothing.
const WAITS: [Waits; 3] = [
    Waits { most_bytes: usize::MAX, wakes_first: false },
    Waits { most_bytes: 15_000, wakes_first: true },
    Waits { most_bytes: 0, wakes_first: true },
];

/// What became of it.
#[derive(Debug)]
struct Came {
    /// Highest above where it was when the companion came back, m.
    rose_m: f64,
    /// Highest above the floor after the floor was touched, m.
    lifted_m: f64,
    /// Fastest touch of the floor with the companion back, m/s.
    touched_mps: f64,
    /// How long after it came back it is disarmed, s.
    down_s: f64,
    /// Of that, standing on the floor with motors that may run, s.
    stood_s: f64,
    crashed: bool,
    texts: Vec<String>,
}

/// It has lifted off again above this, m: gear that springs stays below.
const LIFTS_M: f64 = 0.15;

fn in_part(seed: u64, firmware: Firmware, part: Part, height_m: f64) -> (Lockstep, Ground) {
    let mut plant = PlantConfig::hall(seed);
    plant.board.firmware = firmware;
    let mut pilot = pilot_config(&plant);
    pilot.board_set_parameters = true;
    let survey = plant.survey.clone();
    let mut world = Lockstep::new(plant, pilot, &survey).unwrap();
    let mut ground = Ground::new();
    arm(&mut world, &mut ground);
    let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, height_m as f32];
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED), "{:?}", ground.texts);
    until(&mut world, Mode::Spool, 40.0);
    fly_for(&mut world, 0.7);
    if part == Part::Spool {
        return (world, ground);
    }
    until(&mut world, Mode::Takeoff, 10.0);
    while part == Part::Climb && world.truth().height_m < 0.6 * height_m {
        world.step();
    }
    if part == Part::Climb {
        return (world, ground);
    }
    until(&mut world, Mode::Hold, 30.0);
    fly_for(&mut world, 1.5);
    match part {
        Part::Mission => {
            ground.goto(&mut world, [6.5, 6.0, -height_m]);
            fly_for(&mut world, 1.5);
        }
        Part::Landing => {
            ground.command(&mut world, MavCmd::MAV_CMD_NAV_LAND, [0.0; 7]);
            while world.truth().height_m > 0.5 * height_m {
                world.step();
            }
        }
        Part::Empty => {
            world.plant_mut().inject(Fault::BatteryDrop(2.6)).unwrap();
            until(&mut world, Mode::Land, 6.0);
            while world.truth().height_m > 0.5 * height_m {
                world.step();
            }
        }
        Part::Descent => {
            world.plant_mut().inject(Fault::Gyroscope(FaultKind::Off)).unwrap();
            until(&mut world, Mode::Descend, 1.0);
            while world.truth().height_m > 0.6 * height_m {
                world.step();
            }
            world.plant_mut().inject(Fault::Gyroscope(FaultKind::Healthy)).unwrap();
        }
        _ => {}
    }
    (world, ground)
}

fn pause(world: &mut Lockstep, ground: &mut Ground, seconds: f64, waits: Waits) -> Came {
    let end_us = world.t_us() + (seconds * 1e6) as u64;
    while world.t_us() < end_us {
        // The first so many bytes of tag and board find room.
        world.stall_until(world.t_us() + STEP_US);
        world.plant_mut().tag_output().truncate(waits.most_bytes);
        world.plant_mut().board_output().truncate(waits.most_bytes);
    }
    if waits.wakes_first {
        world.input(Input::Wake);
    }
    let back_us = world.t_us();
    let truth = world.truth();
    let from_m = truth.height_m;
    let mut was = truth;
    let mut touched = truth.on_ground;
    let mut came = Came {
        rose_m: 0.0,
        lifted_m: 0.0,
        touched_mps: 0.0,
        down_s: 0.0,
        stood_s: 0.0,
        crashed: truth.crashed,
        texts: Vec::new(),
    };
    while world.pilot().mode() != Mode::Disarmed && came.down_s < 60.0 {
        world.step();
        ground.listen(world);
        let truth = world.truth();
        came.rose_m = came.rose_m.max(truth.height_m - from_m);
        if truth.on_ground && !was.on_ground {
            came.touched_mps = came.touched_mps.max(was.vel_E_mps.z());
        }
        touched |= truth.on_ground;
        if touched {
            came.lifted_m = came.lifted_m.max(truth.height_m);
        }
        came.down_s = (world.t_us() - back_us) as f64 * 1e-6;
        came.stood_s += if truth.on_ground && truth.armed { 0.002 } else { 0.0 };
        came.crashed |= truth.crashed;
        was = truth;
    }
    came.texts = ground.texts.clone();
    came
}

/// Flies all cases: how each fell short, if it did.
fn fell_short(
    firmware: Firmware,
    parts: &[Part],
    pauses_s: &[f64],
    heights_m: &[f64],
    most_stood_s: f64,
) -> Vec<String> {
    let cases: Vec<_> = pauses_s
        .iter()
        .flat_map(|s| parts.iter().map(move |part| (*s, *part)))
        .flat_map(|(s, part)| heights_m.iter().map(move |m| (s, part, *m)))
        .enumerate()
        .collect();
    cases
        .into_par_iter()
        .filter_map(|(n, (seconds, part, height_m))| {
            let (mut world, mut ground) = in_part(40 + n as u64, firmware, part, height_m);
            let waits = WAITS[(n / heights_m.len() + n) % WAITS.len()];
            let came = pause(&mut world, &mut ground, seconds, waits);
            let what = format!("{firmware:?} {part:?} {height_m} m {seconds} s {waits:?}");
            println!(
                "{what}: rose {:.2} lifted {:.2} touched {:.2} down {:.1} stood {:.1} {}",
                came.rose_m,
                came.lifted_m,
                came.touched_mps,
                came.down_s,
                came.stood_s,
                came.crashed
            );
            let fine = came.rose_m < 0.3
                && came.lifted_m < LIFTS_M
                && came.touched_mps < 2.0
                && came.stood_s < most_stood_s
                && came.down_s < 40.0;
            (!fine).then(|| format!("{what}: {came:#?}"))
        })
        .collect()
}

/// Every part of a flight, from short to far beyond what the board waits, with every way in which the first samples
/// arrive: it never rises, never leaves the floor again, and is down and off in time.
#[test]
fn regress_a_companion_that_stood_still_neither_leaps_nor_takes_off_again() {
    let parts =
        [Part::Spool, Part::Climb, Part::Hover, Part::Mission, Part::Landing, Part::Descent];
    let pauses_s = [0.6, 1.5, 2.0, 3.0, 10.0];
    let mut bad = fell_short(Firmware::Generic, &parts, &pauses_s, &[0.6, 2.0], 4.0);
    // With the thrust that is left of an empty battery the board itself falls faster from higher up.
    bad.extend(fell_short(Firmware::Generic, &[Part::Empty], &pauses_s, &[0.6, 2.0], 4.0));
    assert!(bad.is_empty(), "{} fell short: {}", bad.len(), bad.join("\n"));
}

/// Boards that fly by themselves in other ways: PX4 lands and takes setpoints again by itself, ArduPilot holds its
/// height until it misses our heartbeat.
#[test]
fn regress_a_companion_that_stood_still_comes_back_to_a_real_firmware() {
    let parts = [Part::Climb, Part::Hover, Part::Landing];
    for firmware in [Firmware::Px4, Firmware::Ardupilot] {
        // Their land detectors take a second to agree.
        let bad = fell_short(firmware, &parts, &[0.5, 1.5, 3.0, 6.0], &[0.6, 2.0], 5.0);
        assert!(bad.is_empty(), "{} fell short: {}", bad.len(), bad.join("\n"));
    }
}
