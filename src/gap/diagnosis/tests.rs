//! The diagnosis on a bank made of numbers: what is loud, what could not be seen, what faults say.

use super::*;
use crate::attribute::{Adequacy, BlockScore, Candidate, Gate, PairCandidate, Settings};
use crate::bank::axis::Axis;
use crate::bank::library::standard;
use crate::bank::{Bank, Draw, EffectDraws};
use crate::commission::budget;
use crate::flight::statistics::specs;
use crate::nominal::Nominal;
use crate::outcome::Remainder;
use crate::scene::Scene;
use haltere_core::measure::AnchorId;
use haltere_log::replay::{Demand, Verdict};
use haltere_model::effects::Choice;
use haltere_model::random::Stream;

/// Place of a statistic.
fn place(name: &str) -> usize {
    specs().iter().position(|s| s.name == name).unwrap()
}

/// Null flights of sigma one; P1 moves one statistic by thirty, A9 none, with L1 none was flown.
fn workshop(moved: usize) -> Workshop {
    let mut rng = Stream::new(1, "diagnosis");
    let mut row = |shift: f64| -> Vec<f64> {
        let mut row: Vec<f64> = specs().iter().map(|_| rng.normal()).collect();
        row[moved] += shift;
        row
    };
    let jitter = (0..60).map(|_| row(0.0)).collect();
    let mut effect = |id: &str, shift: f64| EffectDraws {
        id: id.to_owned(),
        axes: vec![Axis::over([0.05, 0.2].into_iter())],
        draws: (0..8)
            .map(|seed| Draw { theta: vec![0.1], seed, twin: 0, statistics: row(shift) })
            .collect(),
    };
    let effects = vec![effect("P1", 30.0), effect("A9", 0.0)];
    let scene = Scene::lab().unwrap();
    Workshop {
        nominal: Nominal::of_scene(&scene),
        scene,
        items: Vec::new(),
        library: standard().into_iter().filter(|s| ["P1", "A9", "L1"].contains(&s.id)).collect(),
        bank: Bank {
            names: specs().iter().map(|s| s.name.clone()).collect(),
            seeds: Vec::new(),
            jitter,
            effects,
        },
        bank_hash: 7,
        lost: Vec::new(),
        folder: None,
    }
}

fn observation(statistics: Vec<f64>) -> Observation {
    Observation {
        statistics,
        anchors: [4, 5, 6, 7, 2].map(AnchorId).to_vec(),
        cells: Vec::new(),
        span_s: 60.0,
    }
}

fn attribution(blocks: &[(&str, f64)]) -> Attribution {
    let candidate = |id: &str, residual_score: f64| Candidate {
        id: id.to_owned(),
        posterior: 0.5,
        log_evidence: 10.0,
        theta: vec![0.1],
        theta_90: vec![[0.05, 0.15]],
        explained: 0.0,
        residual_score,
    };
    Attribution {
        outcome: Outcome::NoMaterialGap,
        candidates: vec![candidate("P1", 4.0), candidate("A9", 20.0)],
        pairs: vec![PairCandidate {
            ids: ["P1".to_owned(), "A9".to_owned()],
            theta: [vec![0.1], vec![0.1]],
            gain: 1.0,
            residual_score: 1.0,
        }],
        pair_limit: 1.0,
        blocks: blocks
            .iter()
            .map(|(block, sigma)| BlockScore {
                block: (*block).to_owned(),
                statistics: 5,
                score: *sigma,
                sigma: *sigma,
                p_value: 0.01,
            })
            .collect(),
        gate: Gate { distance: 30.0, ..Gate::default() },
        adequacy: Adequacy::default(),
        remainder: Remainder::default(),
        used: 100,
        unknown: Vec::new(),
    }
}

#[test]
fn prop_an_effect_is_testable_only_where_its_statistic_was_visited() {
    let moved = place("uwb.bias.first");
    let workshop = workshop(moved);
    let mut statistics = vec![0.0; specs().len()];
    assert_eq!(not_testable(&workshop, &observation(statistics.clone())), ["A9", "L1"]);
    statistics[moved] = f64::NAN;
    assert_eq!(not_testable(&workshop, &observation(statistics)), ["A9", "P1", "L1"]);
}

fn found(
    said: &Attribution,
    seen: &Observation,
    workshop: &Workshop,
    surveyed: &[AnchorId],
) -> Vec<Where> {
    let heard = Heard { statistics: &seen.statistics, worst: &seen.anchors, surveyed };
    places(said, heard, &workshop.bank)
}

#[test]
fn prop_loud_blocks_name_their_loudest_statistic_and_its_anchor() {
    let moved = place("uwb.bias.first");
    let workshop = workshop(moved);
    let mut statistics = vec![0.0; specs().len()];
    statistics[moved] = -40.0;
    let seen = observation(statistics);
    let found = found(&attribution(&[("uwb", 12.0), ("thrust", 2.9)]), &seen, &workshop, &[]);
    assert_eq!(found.len(), 1, "{found:?}");
    assert_eq!((found[0].block.as_str(), found[0].anchor), ("uwb", Some(4)));
    assert_eq!(found[0].regime, "uwb.bias.first");
}

#[test]
fn prop_the_cause_comes_first_however_loud_what_follows_from_it() {
    let workshop = workshop(0);
    let seen = observation(vec![0.0; specs().len()]);
    let mut said = attribution(&[("controller", 90.0), ("battery", 30.0), ("thrust", 5.0)]);
    said.outcome = Outcome::NotInLibrary { remainder: Remainder::default() };
    said.candidates[0].posterior = 0.9;
    said.candidates[1].posterior = 0.1;
    let found = found(&said, &seen, &workshop, &[]);
    let order: Vec<(&str, Part)> = found.iter().map(|p| (p.block.as_str(), p.part)).collect();
    // P1 is of the thrust, A9 of the aerodynamics; nothing of the library is of the battery.
    let want = [
        ("thrust", Part::Cause),
        ("aerodynamics", Part::Cause),
        ("battery", Part::Cause),
        ("controller", Part::Consequence),
    ];
    assert_eq!(order, want);
}

#[test]
fn regress_a_named_survey_error_has_a_place_and_its_anchor_where_no_block_is_loud() {
    let workshop = workshop(0);
    let seen = observation(vec![0.0; specs().len()]);
    let mut said = attribution(&[("uwb", 0.5)]);
    // Fourth by ascending id.
    let theta = vec![0.2, 0.1, 0.0, 3.2];
    let theta_90 = vec![[0.0; 2]; 4];
    let effect = Named { id: "U7".into(), probability: 0.9, theta, theta_90 };
    said.outcome = Outcome::Named { effect };
    let found = found(&said, &seen, &workshop, &[1, 3, 5, 9].map(AnchorId));
    assert_eq!((found[0].block.as_str(), found[0].anchor), ("uwb", Some(9)), "{found:?}");
}

#[test]
fn prop_an_effect_of_one_anchor_is_at_the_one_that_stands_out_by_its_error() {
    let mut said = attribution(&[]);
    let theta = vec![0.2, 1.3];
    let theta_90 = vec![[0.1, 0.3], [0.0, 2.0]];
    let effect = Named { id: "U2".into(), probability: 0.9, theta, theta_90 };
    said.outcome = Outcome::Named { effect };
    let heard =
        Heard { statistics: &[], worst: &[9].map(AnchorId), surveyed: &[1, 3, 5, 9].map(AnchorId) };
    take_anchors(&mut said, heard);
    let named = &said.outcome.effects()[0];
    assert_eq!((&named.theta[..], named.theta_90[1]), (&[0.2, 3.0][..], [3.0, 3.0]));
    assert_eq!(chosen(Choice::Anchor("bias"), named.theta[1], heard.surveyed), "anchor 9");
}

#[test]
fn prop_the_ladder_goes_from_none_to_two_effects() {
    let rungs = ladder(&attribution(&[]), &[]);
    let names: Vec<&str> = rungs.iter().map(|r| r.name.as_str()).collect();
    assert_eq!(names, ["nominal", "+ P1", "+ P1 + A9"]);
    assert!(rungs.windows(2).all(|w| w[1].left < w[0].left));
    // What this flight cannot show is no step.
    assert_eq!(ladder(&attribution(&[]), &["A9".to_owned()]).len(), 2);
}

#[test]
fn prop_a_log_that_cannot_be_read_has_a_whole_report() {
    let d = unreadable("x.mcap".into(), "byte 3: not a log".into());
    assert_eq!((d.exit_code(), d.outcome), (30, Ending::Fault));
    let json = serde_json::to_value(&d).unwrap();
    // Keys that scripts rely on (INTERFACES: `gap diagnose`).
    for key in ["outcome", "where", "effects", "set", "not_testable", "shrink", "replay"] {
        assert!(json.get(key).is_some(), "{key} is missing");
    }
    assert_eq!(json["faults"][0], "byte 3: not a log");
}

#[test]
fn prop_a_budget_is_the_answer_only_where_it_has_parts() {
    let part = budget::Part { key: "mass_kg", file: 0.1, value: 0.12, ..budget::Part::default() };
    for (parts, outcome, code) in [(vec![part], Ending::Budget, 15), (vec![], Ending::Fault, 30)] {
        let mut d = unreadable("x.mcap".into(), "byte 3: not a log".into());
        d.budgeted(Budget { outcome: Ending::Budget, parts, ..Budget::default() });
        assert_eq!((d.outcome, d.exit_code()), (outcome, code));
        assert_eq!(d.remarks.len(), usize::from(code == 30), "what was looked for is told");
        assert_eq!(serde_json::to_value(&d).unwrap()["budget"]["outcome"], "budget");
    }
}

#[test]
fn prop_without_accepted_flights_a_refusal_is_no_verdict() {
    let mut said = attribution(&[]);
    said.outcome = Outcome::NotInLibrary { remainder: Remainder::default() };
    let code = |said: &Attribution, came_far, alone| comparable(said, came_far, alone).exit_code();
    let codes =
        [(true, false), (true, true), (false, false)].map(|(far, alone)| code(&said, far, alone));
    assert_eq!(codes, [13, 20, 20]);
    // Half a mission that an effect explains in part is no verdict either.
    let effect = Named { id: "P1".into(), probability: 0.9, theta: vec![], theta_90: vec![] };
    said.outcome = Outcome::NamedWithRemainder { effect, remainder: Remainder::default() };
    assert_eq!([code(&said, false, true), code(&said, false, false)], [20, 14]);
}

#[test]
fn prop_what_another_build_would_have_sent_has_a_word() {
    let report = |same_source, differs| {
        let mut report = Report::new("x.mcap".into(), Demand::Decoded, Vec::new(), same_source);
        (report.verdict, report.differs) = (Verdict::Different, Some(differs));
        replay_word(&report)
    };
    assert_eq!(report(true, Differs::Setpoints), "different");
    assert_eq!(report(false, Differs::Setpoints), "setpoints_differ");
    assert_eq!(report(false, Differs::OtherTraffic), "other_traffic_differs");
}

#[test]
fn prop_what_was_learned_is_kept_for_the_same_references_and_no_others() {
    let folder = tempfile::tempdir().unwrap();
    let workshop = Workshop { folder: Some(folder.path().to_owned()), ..workshop(0) };
    let learn = |references: &[Vec<f64>]| {
        let mut anew = false;
        let settings = Settings::for_flights();
        let attributor = workshop.learn(references, &[], &settings, || anew = true).unwrap();
        (attributor, anew)
    };
    let flight = workshop.bank.effects[0].draws[0].statistics.clone();
    let (first, anew) = learn(&[]);
    assert!(anew);
    let (second, anew) = learn(&[]);
    assert!(!anew, "learned twice");
    // NaN differs from itself: compare as text.
    let text = |a: &Attributor| format!("{:?}", a.attribute(&flight));
    assert_eq!(text(&first), text(&second));
    let references = workshop.bank.jitter[..12].to_vec();
    assert!(learn(&references).1 && !learn(&references).1);
    // A damaged file is learned anew and replaced.
    for entry in std::fs::read_dir(folder.path()).unwrap() {
        std::fs::write(entry.unwrap().path(), b"HALTLRND").unwrap();
    }
    assert!(learn(&[]).1 && !learn(&[]).1);
}
