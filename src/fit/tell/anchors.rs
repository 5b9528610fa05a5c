//! `haltere fit anchors`: the survey and the range biases from a flight, with and without truth.

use super::logs;
use crate::fit::anchors::{self, Calibration, Difference, PRIOR_M, Positions};
use crate::fit::outcome::{Outcome, Refusal, Table};
use crate::fit::programs::Program;
use crate::fit::source::{Source, names};
use crate::report::flight::Flight;
use haltere_core::frames::{E, Vec3, survey_from_earth};
use haltere_core::time::HostTime;

/// Positions are interpolated between rows that lie no farther apart than this, s.
const GAP_S: f64 = 0.1;
/// Least extent of the flight along every axis, m: from one place an offset and a bias look alike.
const LEAST_EXTENT_M: [f64; 3] = [1.5, 1.5, 0.8];
/// Most measurements that are used: more take time and tell little.
const MOST: usize = 40_000;
/// Below this height multipath on the floor bends every range, m.
const LOWEST_M: f64 = 0.3;

/// Calibrates. `known`: positions are motion capture or the simulator's truth, not the estimate.
pub fn fit(sources: &[Source], known: bool) -> Result<Outcome, Refusal> {
    let logs = logs(sources, Program::Anchors)?;
    let [(flight, _)] = logs[..] else {
        return Err(Refusal::WrongKind {
            why: "fit anchors takes one log: anchors are moved between flights".into(),
        });
    };
    let positions = if known { Positions::Known } else { Positions::Estimated };
    let Some(survey) = &flight.survey else {
        return Err(Refusal::WrongKind { why: "the log holds no anchors".into() });
    };
    let ids = survey.ids().to_vec();
    let places: Vec<[f64; 3]> =
        ids.iter().filter_map(|id| survey.position_E_m(*id)).map(|p| p.to_array()).collect();
    let path = path(flight, known).ok_or_else(|| Refusal::WrongKind {
        why: "the log holds no motion capture, and no truth file was given with --truth".into(),
    })?;
    let mut differences = Vec::new();
    let mut extent = [[f64::INFINITY, f64::NEG_INFINITY]; 3];
    let step = flight.uwb.len() / MOST + 1;
    let mut next = 0;
    for record in flight.uwb.iter().step_by(step) {
        let t = &record.tdoa;
        let Some(pos) = at(&path, t.valid_at, &mut next) else { continue };
        if -pos.z() < LOWEST_M {
            continue;
        }
        let index = |id| ids.iter().position(|i| *i == id);
        let (Some(a), Some(b)) = (index(t.anchor_a), index(t.anchor_b)) else { continue };
        for (range, value) in extent.iter_mut().zip(pos.to_array()) {
            *range = [range[0].min(value), range[1].max(value)];
        }
        differences.push(Difference {
            t_s: t.valid_at.as_us() as f64 * 1e-6,
            a,
            b,
            difference_m: t.distance_diff_m,
            pos_E_m: pos.to_array(),
        });
    }
    for ((range, least), name) in extent.iter().zip(LEAST_EXTENT_M).zip(["north", "east", "height"])
    {
        let found = (range[1] - range[0]).max(0.0);
        if found < least {
            return Err(Refusal::NotExcited {
                why: format!(
                    "the flight spans {found:.1} m in {name}, at least {least} needed: from one place \
                     an offset and a bias look alike"
                ),
                program: Program::Anchors,
            });
        }
    }
    let found = anchors::fit(&places, &differences, positions)
        .map_err(|why| Refusal::NotExcited { why: why.to_string(), program: Program::Anchors })?;
    let mut outcome = Outcome::new(
        "anchors",
        names(sources),
        "difference = (|p - s_b - d_b| + bias_b) - (|p - s_a - d_a| + bias_a)",
    );
    outcome.quality("rms of the differences before", found.residual_m[0], "m");
    outcome.quality("rms after", found.residual_m[1], "m");
    outcome.quality("differences used", found.used as f64, "");
    outcome.quality("left out as too far off", found.gated as f64, "");
    outcome.quality("differences per independent one", found.stretch, "");
    let mut rows = Vec::new();
    let (mut biases, mut stds) = (Vec::new(), Vec::new());
    let mut toml =
        String::from("# anchors.toml: surveyed places with the offsets found\nframe = \"enu\"\n");
    for ((id, place), anchor) in ids.iter().zip(&places).zip(&found.anchors) {
        let names = ["north", "east", "down"];
        for (name, value) in names.iter().zip(anchor.offset_E_m) {
            outcome.parameter(format!("anchor {id} offset {name}"), "m", value);
        }
        outcome.parameter(format!("anchor {id} range bias"), "m", anchor.bias_m);
        let cell = |v: crate::fit::Value| format!("{:+.3} ± {:.3}", v.value, v.std);
        rows.push(
            [id.to_string()]
                .into_iter()
                .chain(anchor.offset_E_m.map(cell))
                .chain([cell(anchor.bias_m), anchor.measurements.to_string()])
                .collect(),
        );
        let moved =
            Vec3::<E>::from_array(std::array::from_fn(|k| place[k] + anchor.offset_E_m[k].value));
        let [x, y, z] = survey_from_earth(moved).to_array();
        let [north, east, down] = anchor.offset_E_m.map(|v| v.std);
        toml.push_str(&format!(
            "\n[[anchor]]\nid = {id}\n# one sigma {east:.3}, {north:.3}, {down:.3} m\n\
             position_m = [{x:.3}, {y:.3}, {z:.3}]\n"
        ));
        biases.push(format!("[{id}, {:.3}]", anchor.bias_m.value));
        stds.push(format!("{:.3}", anchor.bias_m.std));
    }
    outcome.tables.push(Table {
        title: "anchors: found less surveyed, m".into(),
        head: ["id", "north", "east", "down", "range bias", "heard"].map(String::from).to_vec(),
        rows,
    });
    toml.push_str(&format!(
        "\n# Range biases, for [estimator] of the configuration; one sigma {} m:\n\
         # range_bias_m = [{}]\n",
        stds.join(", "),
        biases.join(", ")
    ));
    notes(&mut outcome, &found);
    if outcome.differs() {
        // Not a configuration but an anchor file: checked by its own reader in the tests.
        outcome.snippet = Some(toml);
    } else {
        outcome.notes.push("all of it may be chance: the survey stays".into());
    }
    Ok(outcome)
}

fn notes(outcome: &mut Outcome, found: &Calibration) {
    outcome
        .notes
        .push("gauge: the biases sum to zero, a common one cancels in every difference".into());
    outcome.notes.push(match found.positions {
        Positions::Known => "positions are truth: offsets are where the anchors stand".into(),
        Positions::Estimated => {
            "positions are unknowns: offsets carry no common shift and no common turn of the room, \
             which no flight without truth can show"
                .into()
        }
    });
    outcome.notes.push(format!(
        "expected beforehand within {PRIOR_M} m: an offset whose error is near that was not seen by \
         this flight and stays at the survey"
    ));
    outcome.notes.push(
        "range biases go into estimator.range_bias_m as a whole, with the places they were found with"
            .into(),
    );
}

type Path = Vec<(HostTime, Vec3<E>)>;

fn path(flight: &Flight, known: bool) -> Option<Path> {
    let path: Path = if !known {
        flight.estimates.iter().map(|e| (e.at, e.pos_E_m)).collect()
    } else if !flight.truth.is_empty() {
        flight.truth.iter().map(|r| (r.at, r.pos_E_m)).collect()
    } else {
        flight.references.iter().map(|r| (r.valid_at, r.pos_E_m)).collect()
    };
    (path.len() > 1).then_some(path)
}

/// Position at a time; `next` remembers where the last one was found.
fn at(path: &Path, when: HostTime, next: &mut usize) -> Option<Vec3<E>> {
    // Measurements come nearly in order; a step back is found by going back.
    while *next > 0 && path[*next].0 > when {
        *next -= 1;
    }
    while *next + 1 < path.len() && path[*next + 1].0 <= when {
        *next += 1;
    }
    let (a, b) = (path.get(*next)?, path.get(*next + 1)?);
    let (gap_s, since_s) = (b.0.seconds_since(a.0), when.seconds_since(a.0));
    if !(0.0..GAP_S).contains(&gap_s) || !(0.0..=gap_s).contains(&since_s) || gap_s == 0.0 {
        return None;
    }
    let pos = a.1 + (b.1 - a.1) * (since_s / gap_s);
    pos.is_finite().then_some(pos)
}
