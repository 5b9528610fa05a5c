//! A link to the board that becomes late in flight: in either direction and both, in every part of a flight.

use rayon::prelude::*;

use super::*;
use crate::faults::{Fault, FaultKind, LineId};
use crate::line_noise::LineNoise;
use crate::lockstep::fly_watched;

/// Everything on these lines is so late from now on.
fn delay(world: &mut Lockstep, lines: &[LineId], late_s: f64) {
    let noise =
        LineNoise { late: if late_s > 0.0 { 1.0 } else { 0.0 }, late_s, ..LineNoise::default() };
    for line in lines {
        world.plant_mut().inject(Fault::LineNoise { line: *line, noise }).unwrap();
    }
}

const LINES: [&[LineId]; 3] =
    [&[LineId::FromBoard], &[LineId::ToBoard], &[LineId::FromBoard, LineId::ToBoard]];

/// Where in a flight it begins.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Part {
    Spool,
    Climb,
    Hover,
    Goto,
    Landing,
}

const PARTS: [Part; 5] = [Part::Spool, Part::Climb, Part::Hover, Part::Goto, Part::Landing];

/// In that part of a flight from 2 m.
fn in_part(seed: u64, part: Part) -> (Lockstep, Ground) {
    let mut world = world(seed);
    let mut ground = Ground::new();
    let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 2.0];
    ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
    arm(&mut world, &mut ground);
    let at = if part == Part::Spool { Mode::Spool } else { Mode::Takeoff };
    until(&mut world, at, 5.0);
    fly_for(&mut world, 0.4 + 0.3 * (seed % 4) as f64);
    if matches!(part, Part::Spool | Part::Climb) {
        return (world, ground);
    }
    until(&mut world, Mode::Hold, 20.0);
    let answer = match part {
        Part::Goto => ground.goto(&mut world, [6.5, 6.0, -2.0]),
        Part::Landing => ground.command(&mut world, MavCmd::MAV_CMD_NAV_LAND, [0.0; 7]),
        _ => Some(MavResult::MAV_RESULT_ACCEPTED),
    };
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    fly_for(&mut world, 0.5 + 0.4 * (seed % 4) as f64);
    (world, ground)
}

/// How a flight with a late link ended.
#[derive(Debug)]
struct End {
    contact_mps: f64,
    /// Heights after the floor was touched, m.
    hop_m: f64,
    noticed_s: Option<f64>,
    took_s: f64,
}

fn fly_late(seed: u64, part: Part, lines: &[LineId], late_s: f64) -> End {
    let (mut world, mut ground) = in_part(seed, part);
    delay(&mut world, lines, late_s);
    comes_down(&mut world, &mut ground, &format!("{seed} {part:?} {lines:?} {late_s} s"), |_, _| {})
}

/// Flies until the board is disarmed; `happens` is called every step with the time since now, s.
fn comes_down(
    world: &mut Lockstep,
    ground: &mut Ground,
    case: &str,
    mut happens: impl FnMut(&mut Lockstep, f64),
) -> End {
    let start_us = world.t_us();
    let mut end = End { contact_mps: 0.0, hop_m: 0.0, noticed_s: None, took_s: 0.0 };
    let mut before = world.truth();
    let (mut flew, mut down) = (false, false);
    while world.pilot().mode() != Mode::Disarmed || world.truth().armed {
        world.step();
        let elapsed_s = (world.t_us() - start_us) as f64 * 1e-6;
        happens(world, elapsed_s);
        let truth = world.truth();
        ground.listen(world);
        if end.noticed_s.is_none() && world.pilot().mode() == Mode::Descend {
            end.noticed_s = Some(elapsed_s);
        }
        flew |= truth.height_m > 0.3;
        if truth.on_ground && !before.on_ground && flew {
            end.contact_mps = end.contact_mps.max(before.vel_E_mps.z());
            down = true;
        }
        if down {
            end.hop_m = end.hop_m.max(truth.height_m);
        }
        before = truth;
        let said = || format!("{case}: {truth:?} {:#?}", ground.texts);
        assert!(!truth.crashed, "crashed, {}", said());
        assert!(elapsed_s < 60.0, "still {:?}, {}", world.pilot().mode(), said());
    }
    end.took_s = (world.t_us() - start_us) as f64 * 1e-6;
    assert_landed(world, &ground.texts);
    end
}

/// The board comes down by itself; in the first second of the climb its mean of the thrust is not yet one of flight.
#[test]
fn regress_a_link_that_is_cut_early_in_the_climb_does_not_let_it_fall() {
    (0..12u64).into_par_iter().for_each(|n| {
        let mut world = world(80 + n);
        let mut ground = Ground::new();
        let takeoff = [0.0, 0.0, 0.0, f32::NAN, f32::NAN, f32::NAN, 2.0];
        ground.command(&mut world, MavCmd::MAV_CMD_NAV_TAKEOFF, takeoff);
        arm(&mut world, &mut ground);
        until(&mut world, Mode::Takeoff, 5.0);
        fly_for(&mut world, 0.15 * n as f64);
        world.plant_mut().inject(Fault::BoardLink(FaultKind::Off)).unwrap();
        let mut cut = true;
        let end = comes_down(&mut world, &mut ground, &format!("cut {n}"), |world, elapsed_s| {
            if cut && elapsed_s > 2.0 {
                cut = false;
                world.plant_mut().inject(Fault::BoardLink(FaultKind::Healthy)).unwrap();
            }
        });
        println!("{:.2} s into the climb: {end:.2?}", 0.15 * n as f64);
        assert!(end.contact_mps < 2.0, "{n}: {end:?}");
    });
}

#[test]
fn regress_a_late_link_is_descended_from_in_every_part_of_a_flight() {
    let mut flights = Vec::new();
    for (n, late_s) in [0.1, 0.15, 0.2, 0.25, 0.3, 0.4].into_iter().enumerate() {
        for lines in LINES {
            flights.extend(PARTS.map(|part| (n as u64, part, lines, late_s)));
        }
    }
    let ends: Vec<_> = flights
        .into_par_iter()
        .map(|(seed, part, lines, late_s)| {
            let end = fly_late(seed, part, lines, late_s);
            println!("{late_s} s {part:?} {lines:?}: {end:.2?}");
            (part, late_s, end)
        })
        .collect();
    for (part, late_s, end) in ends {
        assert!(end.contact_mps < 2.0, "{part:?} {late_s}: {end:?}");
        // Gear that springs stays below; thrown up by 0.77 m without a bound on thrust.
        assert!(end.hop_m < 0.15, "{part:?} {late_s}: it left the floor again, {end:?}");
    }
}

/// The search for the floor was over within 0.1 s where the loop had cut the thrust already: it fell from 0.6 m and met
/// the floor with 3.4 m/s.
#[test]
fn regress_a_landing_over_a_link_that_becomes_late_near_the_floor_is_not_let_fall() {
    let mut flights = Vec::new();
    for late_s in [0.2, 0.3, 0.4] {
        for lines in LINES {
            flights.extend((0..40u64).map(|seed| (seed, lines, late_s)));
        }
    }
    flights.into_par_iter().for_each(|(seed, lines, late_s)| {
        let (mut world, mut ground) = in_part(seed, Part::Landing);
        let from_m = 0.4 + 0.01 * seed as f64;
        while world.truth().height_m > from_m {
            world.step();
        }
        delay(&mut world, lines, late_s);
        let case = format!("{late_s} s from {from_m:.2} m, {lines:?}");
        let end = comes_down(&mut world, &mut ground, &case, |_, _| {});
        println!("{case}: {end:.2?}");
        assert!(end.contact_mps < 2.0, "{case}: {end:?}");
    });
}

/// The estimate seemed to be back when samples came again, of 0.3 s before.
#[test]
fn regress_an_estimate_of_old_samples_is_not_back() {
    for late_s in [0.22, 0.3, 0.35] {
        let (mut world, mut ground) = hovering(world(31));
        delay(&mut world, &[LineId::FromBoard], late_s);
        until(&mut world, Mode::Descend, 0.7);
        while world.pilot().mode() != Mode::Disarmed {
            world.step();
            assert_ne!(world.pilot().mode(), Mode::Land, "{late_s}: {:?}", ground.texts);
            ground.listen(&mut world);
        }
        assert_landed(&world, &ground.texts);
        let said = |what: &str| ground.texts.iter().any(|t| t.contains(what));
        assert!(said("link to the board is late: "), "{:?}", ground.texts);
        assert!(!said("clock jumped"), "{:?}", ground.texts);
    }
}

/// What is over is over: a link that is prompt again is landed on, never flown on.
#[test]
fn prop_a_link_that_is_prompt_again_ends_in_a_landing() {
    let (mut world, mut ground) = hovering(world(32));
    let answer = ground.goto(&mut world, [5.0, 5.0, -5.0]);
    assert_eq!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
    fly_for(&mut world, 9.0);
    delay(&mut world, LINES[2], 0.2);
    until(&mut world, Mode::Descend, 2.5);
    fly_for(&mut world, 0.5);
    delay(&mut world, LINES[2], 0.0);
    until(&mut world, Mode::Land, 4.0);
    ground.listen(&mut world);
    until(&mut world, Mode::Disarmed, 30.0);
    assert_landed(&world, &ground.texts);
    assert!(ground.texts.iter().any(|t| t.contains("prompt again")), "{:?}", ground.texts);
}

/// A link that was late from the beginning is not armed with, whatever the board.
#[test]
fn regress_a_link_that_is_late_from_the_start_is_refused() {
    for lines in LINES {
        let mut world = world(33);
        delay(&mut world, lines, 0.15);
        let mut ground = Ground::new();
        for _ in 0..20 {
            fly_for(&mut world, 0.5);
            let answer = ground.command(&mut world, MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, ARM);
            assert_ne!(answer, Some(MavResult::MAV_RESULT_ACCEPTED));
        }
        let refused = |t: &String| t.starts_with("arming refused: board answers after");
        assert!(ground.texts.iter().any(refused), "{lines:?}: {:?}", ground.texts);
    }
}

/// Setpoints that take 80 ms are slow, not late: an effect that the diagnosis knows (T2).
#[test]
fn prop_the_slowest_link_that_is_diagnosed_is_flown_to_its_end() {
    (40..44u64).into_par_iter().for_each(|seed| {
        let mut world = world(seed);
        let values = vec![("delay".into(), 80.0)];
        world.plant_mut().inject(Fault::EffectOn { id: "T2".into(), values }).unwrap();
        let mut late = false;
        let flight = fly_watched(&mut world, &square(), 90.0, |world| {
            late |= world.pilot().mode() == Mode::Descend;
        })
        .unwrap();
        assert!(flight.landed && !late, "seed {seed}: {:?}", flight.texts);
    });
}

/// The largest lag of the response in a flight of long legs at the speed limit, and how it ended.
fn response_of(seed: u64, effects: &[(&str, &str, f64)]) -> (f64, bool, Mode, Vec<String>) {
    let mut plant = PlantConfig::hall(seed);
    for (id, name, value) in effects {
        plant.effects = plant.effects.with(id, &[(*name, *value)]).unwrap();
    }
    let mut pilot = pilot_config(&plant);
    pilot.flight.cruise_speed_mps = 2.5; // the setpoint jumps
    let survey = plant.survey.clone();
    let mut world = Lockstep::new(plant, pilot, &survey).unwrap();
    let mut items = square();
    items[2..5].iter_mut().for_each(|item| (item.x, item.y) = (item.x + 10_000, item.y + 15_000));
    let (mut most_s, mut hardest) = (0.0_f64, Mode::Disarmed);
    let flight = fly_watched(&mut world, &items, 90.0, |world| {
        most_s = most_s.max(world.pilot().response_lag_s().unwrap_or(0.0));
        if world.pilot().mode() == Mode::Descend {
            hardest = Mode::Descend;
        }
    })
    .unwrap();
    (most_s, flight.landed && !world.truth().crashed, hardest, flight.texts)
}

/// A board that obeys late and answers TIMESYNC at once: told by its attitude alone. Slow loops and slow lines that
/// still fly are left alone.
#[test]
fn regress_a_board_that_obeys_late_is_found_by_its_attitude() {
    // What must be found; `None`: between what flies and what does not, printed.
    type Effect = (&'static str, &'static str, f64);
    let cases: [(&str, &[Effect], Option<bool>); 8] = [
        ("nominal", &[], Some(false)),
        ("loop at 0.6", &[("L1", "factor", 0.6)], Some(false)),
        ("board 60 ms", &[("T2", "delay", 60.0), ("T2", "share", 0.0)], Some(false)),
        ("line 80 ms", &[("T2", "delay", 80.0)], Some(false)),
        ("board 150 ms", &[("T2", "delay", 150.0), ("T2", "share", 0.0)], Some(false)),
        ("board 200 ms", &[("T2", "delay", 200.0), ("T2", "share", 0.0)], None),
        ("board 250 ms", &[("T2", "delay", 250.0), ("T2", "share", 0.0)], None),
        ("board 300 ms", &[("T2", "delay", 300.0), ("T2", "share", 0.0)], Some(true)),
    ];
    let flown: Vec<_> = cases
        .par_iter()
        .flat_map(|(name, effects, late)| {
            (70..73u64)
                .into_par_iter()
                .map(move |seed| (*name, *late, seed, response_of(seed, effects)))
        })
        .collect();
    for (name, _, seed, (most_s, whole, hardest, _)) in &flown {
        println!("{name}, seed {seed}: lag {most_s:.2} s at most, {hardest:?}, whole {whole}");
    }
    for (name, late, seed, (_, whole, hardest, texts)) in &flown {
        let Some(late) = late else { continue };
        assert!(*whole, "{name} {seed}: {texts:?}");
        assert_eq!(*hardest == Mode::Descend, *late, "{name} {seed}: {texts:?}");
    }
}
