//! Laws of the list.

use super::*;
use crate::Pilot;
use crate::flight::awaited::Next;
use crate::flight::modes::{Event, Mode, transition};
use haltere_core::frames::Vec3;
use haltere_core::measure::AnchorId;
use haltere_core::survey::Survey;

fn at(ms: u64) -> HostTime {
    HostTime::from_us(1_000_000 + ms * 1000)
}

fn survey() -> Survey {
    let corner = |i: u8| {
        let far = |bit: u8, size_m: f64| if i & bit != 0 { size_m } else { 0.0 };
        (AnchorId(i), Vec3::new(far(1, 10.0), far(2, 10.0), -far(4, 7.0)))
    };
    Survey::new(&(0..8).map(corner).collect::<Vec<_>>()).unwrap()
}

fn pilot() -> Pilot {
    Pilot::new(PilotConfig::default(), survey(), at(0)).without_topics()
}

/// Configurations that differ in every choice.
fn configs() -> Vec<PilotConfig> {
    let actions = [Action::Tell, Action::Hold, Action::Return, Action::Land];
    actions
        .into_iter()
        .map(|action| {
            let mut config = PilotConfig::default();
            let s = &mut config.supervisor;
            (s.ground_loss, s.battery_low, s.battery_home, s.wall_hard) =
                (action, action, action, action);
            s.offboard_loss = if action == Action::Tell { Action::Hold } else { action };
            s.stick_takeover = true;
            config
        })
        .collect()
}

/// Conditions that hold all at once, as one supervisor sees them.
fn holding(pilot: &mut Pilot, rows: &[usize]) {
    for (n, state) in pilot.flight.supervisor.states.0.iter_mut().enumerate() {
        *state = State { holds: rows.contains(&n), ..State::default() };
    }
}

fn random(seed: &mut u64) -> u64 {
    *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    *seed >> 33
}

fn airborne(mode: Mode) -> bool {
    (mode.has_thrust() && mode != Mode::Spool) || mode == Mode::Yielded
}

#[test]
fn prop_names_are_unique() {
    let names: std::collections::BTreeSet<_> = CONDITIONS.iter().map(|row| row.name).collect();
    assert_eq!(names.len(), CONDITIONS.len());
    assert!(TABLE.len() + CONDITIONS.len() < 256, "numbers of causes are a byte");
}

#[test]
fn prop_no_condition_holds_without_a_reaction() {
    for config in configs() {
        for row in &CONDITIONS {
            for mode in Mode::ALL {
                let reaction = row.reaction(mode, &config);
                assert_eq!(reaction >= Reaction::Tell, row.watched.holds(mode), "{row:?} {mode:?}");
            }
            // Looked at wherever it can hold: in the air, unless it is about one mode's own business.
            let everywhere = !matches!(row.watched, Watched::In(_));
            for mode in Mode::ALL.into_iter().filter(|m| airborne(*m) && everywhere) {
                assert!(row.reaction(mode, &config) >= Reaction::Tell, "{row:?} {mode:?}");
            }
        }
    }
}

#[test]
fn prop_a_harder_wish_never_comes_to_something_milder() {
    // What is flown afterwards: the mode that the order brings, or the present one.
    let flown = |mode: Mode, reaction: Reaction| {
        let to = transition(mode, Event::Ordered(reaction.in_mode(mode))).map_or(mode, |r| r.to);
        Reaction::of_mode(to)
    };
    for mode in Mode::ALL {
        for pair in Reaction::ALL.windows(2) {
            let [mild, hard] = [pair[0], pair[1]];
            // Sticks end a hold or a return by order of a person, and only they do.
            if mild == Reaction::TakeOver || hard == Reaction::TakeOver {
                continue;
            }
            assert!(flown(mode, hard) >= flown(mode, mild), "{mode:?}: {mild:?} {hard:?}");
            assert!(flown(mode, hard) >= Reaction::of_mode(mode), "{mode:?}: {hard:?}");
        }
    }
}

#[test]
fn prop_of_all_that_hold_exactly_one_wins_and_it_is_the_hardest() {
    let mut seed = 7;
    for config in configs() {
        let mut pilot = pilot();
        pilot.config = config;
        for _ in 0..4000 {
            let mode = Mode::ALL[(random(&mut seed) as usize) % Mode::ALL.len()];
            let mut rows: Vec<usize> = (0..random(&mut seed) as usize % 6)
                .map(|_| random(&mut seed) as usize % CONDITIONS.len())
                .collect();
            holding(&mut pilot, &rows);
            let wanted = |n: &usize| CONDITIONS[*n].reaction(mode, &pilot.config);
            let hardest = rows.iter().map(wanted).max().unwrap_or(Reaction::Nothing);
            let won = pilot.flight.winner(mode, &pilot.config);
            match won {
                None => assert!(hardest <= Reaction::Tell, "{mode:?} {rows:?}"),
                Some((index, _, reaction)) => {
                    assert_eq!(reaction, hardest);
                    let first = rows.iter().copied().filter(|n| wanted(n) == hardest).min();
                    assert_eq!(Some(index), first, "the first of those that want the same");
                    assert!(transition(mode, Event::Ordered(reaction)).is_some());
                }
            }
            // One condition more never makes it milder.
            rows.push(random(&mut seed) as usize % CONDITIONS.len());
            let before = won.map_or(Reaction::Tell, |(_, _, r)| r);
            holding(&mut pilot, &rows);
            let after =
                pilot.flight.winner(mode, &pilot.config).map_or(Reaction::Tell, |(_, _, r)| r);
            assert!(after >= before, "{mode:?} {rows:?}");
        }
    }
}

#[test]
fn prop_clients_cannot_order_what_is_milder() {
    let asked = [
        Event::HoldAsked,
        Event::GotoAsked,
        Event::MissionAsked,
        Event::OffboardAsked,
        Event::ManualAsked,
        Event::ReturnAsked,
        Event::LandAsked,
    ];
    for config in configs() {
        let mut pilot = pilot();
        pilot.config = config;
        for (n, condition) in CONDITIONS.iter().enumerate() {
            holding(&mut pilot, &[n]);
            for mode in Mode::ALL {
                pilot.flight.mode = mode;
                for event in asked {
                    let Some(to) = transition(mode, event).map(|r| r.to) else { continue };
                    // If it were granted, the next walk must have nothing to undo.
                    let undone = condition.reaction(to, &pilot.config) > Reaction::TakeOver
                        && to != Mode::Disarming;
                    let forbidden = pilot.flight.forbids(event, &pilot.config, &pilot.navigation);
                    assert_eq!(forbidden.is_some(), undone, "{n} {mode:?} {event:?}");
                }
            }
        }
    }
}

/// Whatever was asked, and however it came to be armed.
#[test]
fn prop_nothing_takes_off_with_an_estimator_that_is_not_aligned() {
    for from in [Mode::Disarmed, Mode::Arming, Mode::Idle] {
        let mut pilot = pilot();
        pilot.flight.mode = from;
        pilot.flight.lift_off_asked = true;
        pilot.flight.guidance.next = Next::Mission;
        for ms in (10..3000).step_by(10) {
            if pilot.flight.mode == Mode::Arming && ms > 500 {
                pilot.act().fire(at(ms), Event::BoardArmed);
            }
            pilot.handle(at(ms), crate::input::Input::Wake);
            assert!(!pilot.flight.mode.has_thrust(), "{from:?}: {:?}", pilot.flight.mode);
            assert!(pilot.flight.control.thrust_frac == 0.0);
        }
    }
    // Should the spool-up be reached nevertheless, it ends there, in the same step.
    let mut pilot = pilot();
    pilot.flight.mode = Mode::Spool;
    pilot.handle(at(10), crate::input::Input::Wake);
    assert_eq!(pilot.flight.mode, Mode::Disarming);
    assert!(pilot.sight(at(20)).may_arm().is_err());
}

#[test]
fn prop_what_is_seen_for_a_moment_is_not_held_and_what_ends_is_told_once() {
    let row = CONDITIONS.iter().find(|row| row.name == "anchors_few").unwrap();
    let mut state = State::default();
    let mut step = |ms: u64, seen: bool| proceed(&mut state, row, seen, true, at(ms), 0.5);
    for ms in (0..490).step_by(10) {
        assert_eq!(step(ms, true), Change::None);
    }
    assert_eq!(step(490, false), Change::None);
    for ms in (500..1000).step_by(10) {
        assert_eq!(step(ms, true), Change::None, "{ms}");
    }
    assert_eq!(step(1000, true), Change::Begins);
    assert_eq!(step(1010, true), Change::None);
    // Gone for less than its time, it goes on.
    assert_eq!(step(1020, false), Change::None);
    assert_eq!(step(1200, true), Change::None);
    assert_eq!(step(1210, false), Change::None);
    assert_eq!(step(1520, false), Change::Ends);
    assert_eq!(step(1530, false), Change::None);
}

/// The readers of the wires stood still too: what came meanwhile is read only after the first step.
#[test]
fn prop_our_own_pause_is_not_taken_for_a_silence_of_the_imu() {
    let lost = CONDITIONS.iter().find(|row| row.name == "imu_lost").unwrap();
    let sees = |pauses_ms: &[u64], then_silent_ms: u64| {
        let mut pilot = pilot();
        let mut now_ms = 0;
        let mut wake = |pilot: &mut Pilot, after_ms: u64| {
            now_ms += after_ms;
            pilot.handle(at(now_ms), crate::input::Input::Wake);
            (lost.is_seen)(&pilot.sight(at(now_ms)))
        };
        for _ in 0..5 {
            wake(&mut pilot, 10);
        }
        pilot.navigation.last_imu = Some(at(50));
        let paused = pauses_ms.iter().any(|pause_ms| wake(&mut pilot, *pause_ms));
        paused || (0..then_silent_ms / 10).any(|_| wake(&mut pilot, 10))
    };
    let loss_ms = (PilotConfig::default().supervisor.imu_loss_s * 1e3) as u64;
    assert!(!sees(&[], loss_ms - 10) && sees(&[], loss_ms + 20), "without a pause as ever");
    assert!(!sees(&[loss_ms + 150], 30), "the samples are about to be read");
    assert!(sees(&[loss_ms + 150], 60), "they are not: it is lost");
    assert!(sees(&[60; 10], 0), "a loop that always pauses hides nothing");
}

#[test]
fn prop_what_is_latched_stays_until_the_vehicle_is_disarmed() {
    let row = CONDITIONS.iter().find(|row| row.name == "battery_critical").unwrap();
    let mut state = State::default();
    assert_eq!(proceed(&mut state, row, true, true, at(0), 0.0), Change::Begins);
    for ms in [10, 5000] {
        assert_eq!(proceed(&mut state, row, false, true, at(ms), 0.0), Change::None);
        assert_eq!(proceed(&mut state, row, false, false, at(ms), 0.0), Change::None);
        assert!(state.holds);
    }
    let mut supervisor = Supervisor::default();
    supervisor.states.0.fill(State { holds: true, ..State::default() });
    supervisor.end_flight();
    assert!(supervisor.holding().all(|(_, row)| !row.latched));
}

/// Keys that the list names are keys of the configuration, with the values that it shows.
#[test]
fn prop_numbers_are_those_of_the_configuration() {
    let config = PilotConfig::default();
    for row in &CONDITIONS {
        for n in row.numbers.iter().filter(|n| !n.key.is_empty()) {
            let there = crate::stations::services::all_parameters().find(|p| p.key == n.key);
            let there = there.map(|p| p.value(&config));
            assert_eq!(there, Some((n.value)(&config) as f32), "{}", n.key);
        }
    }
}
