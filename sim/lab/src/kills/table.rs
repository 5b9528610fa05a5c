//! What the flights came to, as one table or as JSON.

use std::io::Write as _;

use anyhow::Result;
use serde_json::json;

use super::judge::Outcome;
use super::kind::{Kind, Phase, Trial};

/// Lower than this it stood when it was struck, m.
const AIRBORNE_M: f64 = 0.15;

type Flown = (Trial, Result<Outcome>);

/// Tells it. `false`: one went wrong.
pub fn tell(as_json: bool, outcomes: &[Flown]) -> Result<bool> {
    let flown: Vec<&Outcome> = outcomes.iter().filter_map(|(_, o)| o.as_ref().ok()).collect();
    let ok = outcomes.iter().all(|(_, o)| o.as_ref().is_ok_and(Outcome::ok));
    let failed: Vec<(&Trial, String)> = outcomes
        .iter()
        .filter_map(|(trial, o)| Some((trial, format!("{:#}", o.as_ref().err()?))))
        .collect();
    let mut out = haltere::cli::Out::lock();
    if as_json {
        let all = Row::of(&flown);
        let result = json!({
            "ok": ok, "kills": outcomes.len(), "airborne": all.airborne,
            "landed": all.landed, "hard": all.hard,
            "recaptured": flown.iter().filter(|o| o.recaptured > 0).count(),
            "arm_again": flown.iter().filter(|o| o.arms_again).count(),
            "largest_drift_m": all.drift_m, "hardest_impact_mps": all.impact_mps,
            "outcomes": flown, "not_flown": failed,
        });
        writeln!(out, "{}", serde_json::to_string_pretty(&result)?)?;
        return Ok(ok);
    }
    writeln!(
        out,
        "{:16} {:8} {:>5} {:>6} {:>6} {:>5} {:>6} {:>7} {:>8} {:>8} {:>6}",
        "kind",
        "phase",
        "flown",
        "in air",
        "landed",
        "hard",
        "wrong",
        "above m",
        "sidew. m",
        "floor m/s",
        "again"
    )?;
    for (kind, phase) in groups(outcomes) {
        let of = |o: &&&Outcome| (o.trial.kind, o.trial.phase) == (kind, phase);
        let group: Vec<&Outcome> = flown.iter().filter(of).copied().collect();
        let row = Row::of(&group);
        writeln!(
            out,
            "{:16} {:8} {:5} {:6} {:6} {:5} {:6} {:7.2} {:8.2} {:8.2} {:>6}",
            kind.name(),
            phase.name(),
            group.len(),
            row.airborne,
            row.landed,
            row.hard,
            row.wrong,
            row.above_m,
            row.drift_m,
            row.impact_mps,
            if kind == Kind::Killed { row.arms_again.to_string() } else { "-".into() },
        )?;
    }
    for o in flown.iter().filter(|o| o.hard && o.ok()) {
        writeln!(out, "hard: {}", serde_json::to_string(o)?)?;
    }
    for o in flown.iter().filter(|o| !o.ok()) {
        writeln!(out, "WRONG: {}", serde_json::to_string(o)?)?;
    }
    for (trial, why) in &failed {
        writeln!(out, "NOT FLOWN: {}: {why}", serde_json::to_string(trial)?)?;
    }
    Ok(ok)
}

/// What was flown, in the order of its flights.
fn groups(outcomes: &[Flown]) -> Vec<(Kind, Phase)> {
    let mut groups: Vec<_> = outcomes.iter().map(|(trial, _)| (trial.kind, trial.phase)).collect();
    groups.dedup();
    groups
}

/// Sums over flights.
struct Row {
    airborne: usize,
    landed: usize,
    hard: usize,
    wrong: usize,
    arms_again: usize,
    above_m: f64,
    drift_m: f64,
    impact_mps: f64,
}

impl Row {
    fn of(flown: &[&Outcome]) -> Self {
        let count = |is: &dyn Fn(&Outcome) -> bool| flown.iter().filter(|o| is(o)).count();
        let most = |of: &dyn Fn(&Outcome) -> f64| flown.iter().map(|o| of(o)).fold(0.0, f64::max);
        Self {
            airborne: count(&|o| o.height_m > AIRBORNE_M),
            landed: count(&|o| o.landed),
            hard: count(&|o| o.hard),
            wrong: count(&|o| !o.ok()),
            arms_again: count(&|o| o.arms_again),
            above_m: most(&|o| o.above_m),
            drift_m: most(&|o| o.drift_m),
            impact_mps: most(&|o| o.impact_mps),
        }
    }
}
