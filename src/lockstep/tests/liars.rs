//! Sensors and surveys that lie and fit: ranging that is played again, an accelerometer of another scale, a room that
//! is a mirror image or turned. Judged by the truth.

use std::sync::{Arc, Mutex};

use haltere_dialect::mav::haltere::MavMessage;
use haltere_dialect::mav_stream::{MavSplitter, encode};
use rayon::prelude::*;

use super::*;
use crate::frames::{E, Vec3};
use crate::measure::AnchorId;
use crate::model::faults::{Fault, FaultKind};
use crate::pilot::LinkId;
use crate::survey::Survey;

/// When a fault begins, simulated µs; nothing before.
type Onset = Arc<Mutex<Option<u64>>>;

/// What came of a flight, in truth.
#[derive(Debug, Clone, Copy, Default)]
struct Outcome {
    highest_m: f64,
    farthest_m: f64,
    fastest_mps: f64,
    touch_mps: f64,
    crashed: bool,
    armed: bool,
}

/// Flies on until it is disarmed, or for so long, s.
fn watch(world: &mut Lockstep, ground: &mut Ground, limit_s: f64) -> Outcome {
    let mut out = Outcome::default();
    let start = world.truth().pos_E_m;
    let end_us = world.t_us() + (limit_s * 1e6) as u64;
    let mut sink_mps = 0.0;
    while world.t_us() < end_us {
        world.step();
        ground.listen(world);
        let truth = world.truth();
        let away = truth.pos_E_m - start;
        out.highest_m = out.highest_m.max(truth.height_m);
        out.farthest_m = out.farthest_m.max(away.x().hypot(away.y()));
        let vel = truth.vel_E_mps;
        out.fastest_mps = out.fastest_mps.max(vel.norm());
        if truth.on_ground {
            out.touch_mps = out.touch_mps.max(sink_mps);
        }
        sink_mps = if truth.on_ground { 0.0 } else { vel.z() };
        out.crashed = truth.crashed;
        out.armed = truth.armed;
        if world.pilot().mode() == Mode::Disarmed && !truth.armed {
            break;
        }
    }
    out
}

fn assert_down(out: &Outcome, what: &str, texts: &[String]) {
    assert!(!out.crashed && !out.armed && out.touch_mps < 2.0, "{what}: {out:?} {texts:#?}");
}

/// Plays the last seconds of the tag's bytes again and again from the onset on; with receive times that go on if asked.
fn played_again(onset: &Onset, window_s: f64, times_grow: bool) -> Damage {
    let onset = onset.clone();
    let mut kept: Vec<(u64, Vec<u8>)> = Vec::new();
    let mut rest = Vec::new();
    Box::new(move |t_us, link, bytes| {
        if link != LinkId::Tag {
            return;
        }
        rest.append(bytes);
        let began = *onset.lock().unwrap();
        let window_us = (window_s * 1e6) as u64;
        let Some(began_us) = began else {
            while let Some(frame) = next_frame(&mut rest) {
                bytes.extend_from_slice(&frame);
                kept.push((t_us, frame));
            }
            kept.retain(|(at_us, _)| at_us + window_us > t_us);
            return;
        };
        rest.clear();
        let window_us = window_us.min(began_us);
        let lap = (t_us - began_us) / window_us;
        // What came in the same step of the window.
        let from_us = began_us - window_us + (t_us - began_us) % window_us;
        for (at_us, frame) in &kept {
            if (from_us..from_us + super::super::STEP_US).contains(at_us) {
                let mut frame = frame.clone();
                if times_grow {
                    let ticks = ((lap + 1) as f64 * window_s * 63.8976e9) as u64;
                    let mut rx = [0; 8];
                    rx[..5].copy_from_slice(&frame[1..6]);
                    let moved = u64::from_le_bytes(rx).wrapping_add(ticks).to_le_bytes();
                    frame[1..6].copy_from_slice(&moved[..5]);
                }
                bytes.extend_from_slice(&frame);
            }
        }
    })
}

/// Takes the next frame of the sniffer off what came.
fn next_frame(bytes: &mut Vec<u8>) -> Option<Vec<u8>> {
    let begin = bytes.iter().position(|b| *b == 0xBC)?;
    bytes.drain(..begin);
    let len = 12 + usize::from(*bytes.get(8)?);
    (bytes.len() >= len).then(|| bytes.drain(..len).collect())
}

/// The accelerometer reads so many times the force from the onset on, by axis.
fn scaled(onset: &Onset, factor: [f32; 3]) -> Damage {
    let onset = onset.clone();
    let mut splitter = MavSplitter::new();
    Box::new(move |_, link, bytes| {
        if link != LinkId::Board {
            return;
        }
        let wrong = onset.lock().unwrap().is_some();
        splitter.push(&std::mem::take(bytes));
        while let Some(next) = splitter.next() {
            let Ok(frame) = next else { continue };
            match frame.decode() {
                Ok(MavMessage::HIGHRES_IMU(mut imu)) if wrong => {
                    imu.xacc *= factor[0];
                    imu.yacc *= factor[1];
                    imu.zacc *= factor[2];
                    let header = frame.header;
                    let message = MavMessage::HIGHRES_IMU(imu);
                    encode(bytes, header.system_id, header.component_id, header.sequence, &message);
                }
                _ => bytes.extend_from_slice(frame.raw),
            }
        }
    })
}

/// A hall with this damage, from where it is asked for, in hover at a height.
fn aloft(seed: u64, damage: Damage, height_m: f32) -> (Lockstep, Ground) {
    let (mut world, mut ground) = (world(seed).with_damage(damage), Ground::new());
    let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, height_m];
    ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
    arm(&mut world, &mut ground);
    (world, ground)
}

/// Where in a flight a fault begins.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Part {
    /// This long after the climb began, s.
    Climb(f64),
    Hover,
    /// On a leg of 3 m.
    Leg,
    /// This long after the landing began, s.
    Landing(f64),
}

fn until_part(world: &mut Lockstep, ground: &mut Ground, part: Part) {
    until(world, Mode::Takeoff, 20.0);
    if let Part::Climb(s) = part {
        return fly_for(world, s);
    }
    until(world, Mode::Hold, 20.0);
    fly_for(world, 2.0);
    match part {
        Part::Leg => {
            ground.goto(world, [7.0, 6.0, -1.5]);
            fly_for(world, 2.0);
        }
        Part::Landing(s) => {
            ground.command(world, MavCmd::MAV_CMD_NAV_LAND, [0.0; 7]);
            fly_for(world, s);
        }
        _ => {}
    }
}

fn begin(onset: &Onset, world: &Lockstep) {
    *onset.lock().unwrap() = Some(world.t_us());
}

#[test]
fn regress_ranging_that_is_played_again_ends_the_flight_low_and_whole() {
    let windows = [1.0, 3.0, 10.0];
    let parts = [Part::Climb(1.0), Part::Climb(4.0), Part::Hover, Part::Leg];
    let cases: Vec<_> = windows
        .into_iter()
        .flat_map(|w| {
            parts.into_iter().flat_map(move |p| [false, true].map(move |grow| (w, p, grow)))
        })
        .flat_map(|(w, p, grow)| [false, true].map(move |baro| (w, p, grow, baro)))
        .collect();
    cases.into_par_iter().enumerate().for_each(|(n, (window_s, part, times_grow, baro))| {
        let onset = Onset::default();
        let damage = played_again(&onset, window_s, times_grow);
        let (mut world, mut ground) = aloft(n as u64, damage, 1.5);
        if !baro {
            world.plant_mut().inject(Fault::Barometer(FaultKind::Off)).unwrap();
        }
        until_part(&mut world, &mut ground, part);
        begin(&onset, &world);
        let out = watch(&mut world, &mut ground, 60.0);
        let what = format!("{window_s} s {part:?} times grow {times_grow} baro {baro}");
        println!("{what}: {out:.2?}");
        assert_down(&out, &what, &ground.texts);
        assert!(out.highest_m < 2.2 && out.farthest_m < 4.0, "{what}: {out:?} {:#?}", ground.texts);
    });
}

#[test]
fn regress_an_accelerometer_of_another_scale_ends_the_flight_gently() {
    let factors =
        [[1.3; 3], [1.6; 3], [2.0; 3], [3.0; 3], [4.0; 3], [5.0; 3], [1.0, 1.0, 2.5], [0.4; 3]];
    let parts = [
        Part::Climb(0.5),
        Part::Climb(2.0),
        Part::Climb(4.0),
        Part::Hover,
        Part::Leg,
        Part::Landing(0.5),
        Part::Landing(3.0),
    ];
    let cases: Vec<_> =
        factors.into_iter().flat_map(|f| parts.into_iter().map(move |p| (f, p))).collect();
    cases.into_par_iter().enumerate().for_each(|(n, (factor, part))| {
        let onset = Onset::default();
        let height_m = if n % 2 == 0 { 1.5 } else { 2.5 };
        let (mut world, mut ground) = aloft(n as u64, scaled(&onset, factor), height_m);
        until_part(&mut world, &mut ground, part);
        begin(&onset, &world);
        let from_us = world.t_us();
        let out = watch(&mut world, &mut ground, 60.0);
        let what = format!("{factor:?} {part:?}");
        println!("{what}: {out:.2?} {:.1} s", (world.t_us() - from_us) as f64 * 1e-6);
        assert_down(&out, &what, &ground.texts);
        assert!(out.highest_m < 3.3 && out.farthest_m < 3.5, "{what}: {out:?} {:#?}", ground.texts);
    });
}

#[test]
fn regress_an_accelerometer_that_reads_too_much_is_refused_on_the_floor() {
    let onset = Onset::default();
    *onset.lock().unwrap() = Some(0);
    let (mut world, mut ground) = (world(3).with_damage(scaled(&onset, [1.3; 3])), Ground::new());
    world.run_until(7_000_000);
    let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
    assert_ne!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    ground.listen(&mut world);
    let told = ground.texts.iter().any(|t| t.contains("m/s2 at rest, 7.8 to 11.8 allowed"));
    assert!(told, "{:#?}", ground.texts);
}

/// A flight to 1.5 m in a hall that the companion knows as `told`, with a heading that is off by an angle.
fn in_room(
    seed: u64,
    heading_deg: f64,
    told: impl Fn(Vec3<E>) -> Vec3<E>,
) -> (Option<Outcome>, Vec<String>) {
    in_a_room(seed, 7.0, heading_deg, told)
}

/// The same under a ceiling of so many metres.
fn in_a_room(
    seed: u64,
    ceiling_m: f64,
    heading_deg: f64,
    told: impl Fn(Vec3<E>) -> Vec3<E>,
) -> (Option<Outcome>, Vec<String>) {
    let mut plant = PlantConfig::hall(seed);
    let lowered = |p: Vec3<E>| Vec3::new(p.x(), p.y(), p.z() * ceiling_m / 7.0);
    let hall = plant.survey.clone();
    let sites: Vec<_> =
        hall.ids().iter().map(|id| (*id, lowered(hall.position_E_m(*id).unwrap()))).collect();
    plant.survey = Survey::new(&sites).unwrap();
    let survey = plant.survey.clone();
    let sites: Vec<(AnchorId, Vec3<E>)> =
        survey.ids().iter().map(|id| (*id, told(survey.position_E_m(*id).unwrap()))).collect();
    let told = Survey::new(&sites).unwrap();
    let mut pilot = pilot_config(&plant);
    pilot.board_north_offset_rad = heading_deg.to_radians();
    let mut world = Lockstep::new(plant, pilot, &told).unwrap();
    let mut ground = Ground::new();
    let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 1.5];
    ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
    for _ in 0..30 {
        let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
        if answer == Some(MavResult::MAV_RESULT_ACCEPTED) {
            let out = watch(&mut world, &mut ground, 25.0);
            return (Some(out), ground.texts);
        }
        fly_for(&mut world, 0.5);
        ground.listen(&mut world);
    }
    (None, ground.texts)
}

#[test]
fn regress_a_room_that_is_mirrored_or_turned_is_found_in_the_take_off() {
    type Told = fn(Vec3<E>) -> Vec3<E>;
    let same: Told = |p| p;
    let cases: [(&str, f64, Told, &str); 9] = [
        ("exchanged", 0.0, |p| Vec3::new(p.y(), p.x(), p.z()), "north and east are exchanged"),
        ("north", 0.0, |p| Vec3::new(10.0 - p.x(), p.y(), p.z()), "north is south"),
        ("east", 0.0, |p| Vec3::new(p.x(), 10.0 - p.y(), p.z()), "east is west"),
        ("45", 45.0, same, "heading is not the room's: UWB leads -"),
        ("-60", -60.0, same, "heading is not the room's: UWB leads +"),
        ("90", 90.0, same, "heading is not the room's: UWB leads -"),
        ("-90", -90.0, same, "heading is not the room's: UWB leads +"),
        ("135", 135.0, same, "heading is not the room's"),
        ("180", 180.0, same, "heading is not the room's"),
    ];
    let flights: Vec<_> = cases.iter().flat_map(|c| (0..3u64).map(move |seed| (seed, c))).collect();
    flights.into_par_iter().for_each(|(seed, (name, heading_deg, told, words))| {
        let (out, texts) = in_room(seed, *heading_deg, told);
        let out = out.unwrap_or_else(|| panic!("{name}: not armed {texts:#?}"));
        println!("{name} {seed}: {out:.2?}");
        assert_down(&out, name, &texts);
        assert!(out.highest_m < 0.9 && out.farthest_m < 1.5, "{name}: {out:?} {texts:#?}");
        assert!(texts.iter().any(|t| t.contains(words)), "{name}: {texts:#?}");
    });
}

#[test]
fn regress_floor_and_ceiling_exchanged_do_not_fly() {
    let (out, texts) = in_room(1, 0.0, |p| Vec3::new(p.x(), p.y(), -7.0 - p.z()));
    assert!(out.is_none_or(|out| out.highest_m < 0.1), "{out:?} {texts:#?}");
    assert!(texts.iter().any(|t| t.contains("2.5 m at most")), "{texts:#?}");
    // In a low room what the exchange adds is what a floor may add.
    for seed in 0..4 {
        let (out, texts) = in_a_room(seed, 2.5, 0.0, |p| Vec3::new(p.x(), p.y(), -2.5 - p.z()));
        let Some(out) = out else { continue };
        println!("low room {seed}: {out:.2?}");
        assert_down(&out, "low room", &texts);
        assert!(out.highest_m < 1.5, "{out:?} {texts:#?}");
    }
}

#[test]
fn prop_a_survey_that_is_too_small_or_too_large_flies_inside() {
    for scale in [0.8, 1.2] {
        let (out, texts) = in_room(2, 0.0, |p| {
            Vec3::new(5.0 + scale * (p.x() - 5.0), 5.0 + scale * (p.y() - 5.0), p.z())
        });
        let Some(out) = out else { continue };
        println!("{scale}: {out:.2?}");
        assert!(!out.crashed && out.farthest_m < 1.5, "{scale}: {out:?} {texts:#?}");
    }
}

/// No sound flight is stopped.
#[test]
fn prop_no_sound_flight_is_stopped() {
    let stopped: Vec<_> = (0..24u64)
        .into_par_iter()
        .filter_map(|seed| {
            let mut world = world(seed + 100);
            let flight = super::super::fly(&mut world, &square(), 60.0).unwrap();
            let told = flight.texts.iter().find(|t| t.contains("no usable estimate")).cloned();
            assert!(flight.landed, "{seed}: {:#?}", flight.texts);
            told
        })
        .collect();
    println!("{} of 24 sound flights stopped: {stopped:?}", stopped.len());
    assert!(stopped.is_empty());
}
