//! What a demo flight came to: bounds, table, JSON, page.

use std::fmt::Write as _;
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use anyhow::{Context, Result};
use haltere::report::errors::{
    AXES, AxisErrors, NotFlown, Path as FlownPath, PathKind, STEP_WINDOW_S, axis_errors, find_paths,
};
use haltere::report::flight::Flight;
use haltere::report::verdict::{Check, Verdict, all_passed};
use haltere::report::{Page, from_log, truth};
use haltere_log::log_file::shown_name;
use haltere_log::record::{LogEnd, LogReader};
use serde_json::{Value, json};

use super::Judged;
use super::plan::{Plan, SHAPES};

/// Estimate against truth on the shapes, mean absolute error of each axis, m: the upper end of
/// the paper's 8 to 10 cm.
const ESTIMATE_BOUND_M: f64 = 0.10;

/// A judged flight.
#[derive(Debug)]
pub struct Outcome {
    flight: Flight,
    errors: Vec<AxisErrors>,
    paths: Vec<FlownPath>,
    checks: Vec<Check>,
    /// Why what went wrong says nothing of the vehicle.
    late: Option<String>,
}

/// Reads log and truth and judges them.
pub fn judge(
    plan: &Plan,
    log: &Path,
    truth_file: &Path,
    flown: Result<(), String>,
    late: Option<String>,
) -> Result<Outcome> {
    let reader = LogReader::open(log)?;
    let (mut flight, end) = from_log::read(&reader);
    let truth_name = || truth_file.display().to_string();
    let file = File::open(truth_file).with_context(truth_name)?;
    flight.truth = truth::read(BufReader::new(file)).with_context(truth_name)?;
    // Rows outside the log only stretch the plots.
    if let Some((from, to)) = flight.ends() {
        flight.truth.retain(|row| row.at >= from && row.at <= to);
    }
    let (paths, found) = find_paths(&plan.legs, &flight.controls);
    let errors = axis_errors(&flight, &paths);
    let checks = checks(&flight, &errors, &found, &flown, &end);
    Ok(Outcome { flight, errors, paths, checks, late })
}

fn checks(
    flight: &Flight,
    errors: &[AxisErrors],
    found: &Result<(), NotFlown>,
    flown: &Result<(), String>,
    end: &LogEnd,
) -> Vec<Check> {
    let mut checks = Vec::new();
    for shape in SHAPES {
        let mae_m: Vec<Option<f64>> = (0..AXES.len())
            .map(|axis| {
                let row = errors
                    .iter()
                    .find(|e| e.path == shape && e.kind == PathKind::Shape && e.axis == axis);
                row.and_then(|row| row.estimate_position_m.mae())
            })
            .collect();
        let worst_m = mae_m.iter().copied().reduce(|a, b| Some(a?.max(b?))).flatten();
        let name = format!("estimate against truth, {shape}, every axis");
        let mut check = Check::at_most(name, worst_m, ESTIMATE_BOUND_M, "m");
        if worst_m.is_some() {
            let each = AXES.into_iter().zip(mae_m);
            let each = each.map(|(axis, m)| format!("{axis} {:.3}", m.unwrap_or(f64::NAN)));
            check.found = format!("{} m", each.collect::<Vec<_>>().join(", "));
        }
        checks.push(check);
    }
    let said = |result: Result<(), String>| match result {
        Ok(()) => (true, "yes".to_string()),
        Err(why) => (false, why),
    };
    let (ok, words) = said(found.clone().map_err(|e| e.to_string()));
    checks.push(Check::that("every path was flown", ok, words));
    let (ok, words) = said(flown.clone());
    checks.push(Check::that("flown and landed, as the ground station saw it", ok, words));
    match flight.truth.last() {
        None => checks.push(Check {
            name: "stands on the floor at the end".into(),
            found: "\u{2013}".into(),
            allowed: "yes".into(),
            verdict: Verdict::NotChecked { why: "no truth".into() },
        }),
        Some(last) => {
            let words = if last.on_ground { "yes" } else { "in the air" };
            checks.push(Check::that("stands on the floor at the end", last.on_ground, words));
            let crash = flight.truth.iter().find(|row| row.crashed);
            let words = crash
                .map_or("none".to_string(), |row| format!("{:.1} s into the simulation", row.t_s));
            let mut check = Check::that("no crash", crash.is_none(), words);
            check.allowed = "none".into();
            checks.push(check);
        }
    }
    checks.push(Check::that("log is complete", *end == LogEnd::Complete, end.to_string()));
    checks
}

impl Outcome {
    /// Whether every bound was checked and held.
    pub fn ok(&self) -> bool {
        all_passed(&self.checks)
    }

    /// What it came to. A flight that held every bound did so for all that it was disturbed.
    pub fn judged(&self) -> Judged {
        match &self.late {
            _ if self.ok() => Judged::Well,
            Some(_) => Judged::Not,
            None => Judged::Badly,
        }
    }

    fn deadline_misses(&self) -> u64 {
        self.flight.health.last().map_or(0, |h| h.deadline_misses)
    }

    /// For people.
    pub fn table(&self) -> String {
        let mut out = format!(
            "\nmean absolute error ± standard deviation; steps over {STEP_WINDOW_S:.0} s from the \
             jump, on their axis\n\n\
             path         axis  truth-command        truth-command        estimate-truth       \
             estimate-truth\n\
             \x20                  position, m          velocity, m/s        position, m          \
             velocity, m/s\n",
        );
        let mut before = "";
        for row in &self.errors {
            let name = if row.path == before { "" } else { row.path.as_str() };
            before = &row.path;
            let _ = write!(out, "{name:12} {:5}", AXES[row.axis]);
            for spread in [
                &row.position_m,
                &row.velocity_mps,
                &row.estimate_position_m,
                &row.estimate_velocity_mps,
            ] {
                match (spread.mae(), spread.std()) {
                    (Some(mae), Some(std)) => {
                        let _ = write!(out, " {mae:6.3} ± {std:5.3}      ");
                    }
                    _ => out.push_str(" no samples          "),
                }
            }
            out.truncate(out.trim_end().len());
            out.push('\n');
        }
        out.push('\n');
        let health = self.flight.health.last();
        let _ = writeln!(
            out,
            "control steps {}, deadline misses {}",
            health.map_or(0, |h| h.control_steps),
            self.deadline_misses()
        );
        if let Some(glue) = self.flight.glue.last() {
            let _ = writeln!(
                out,
                "wake-ups {}, late {}, worst lateness {:.1} ms",
                glue.wake_ups,
                glue.late_wake_ups,
                glue.worst_lateness_s * 1e3
            );
        }
        let ages = |f: fn(&haltere_core::topics::HealthRecord) -> Option<f64>| {
            let mut all: Vec<f64> = self.flight.health.iter().filter_map(f).collect();
            all.sort_by(f64::total_cmp);
            let middle = all.get(all.len() / 2).copied();
            let ms = |s: Option<f64>| s.map_or("-".into(), |s| format!("{:.1}", s * 1e3));
            format!("median {} ms, worst {} ms", ms(middle), ms(all.last().copied()))
        };
        let _ = writeln!(out, "age of UWB: {}", ages(|h| h.uwb_age_s));
        let _ = writeln!(out, "age of IMU: {}", ages(|h| h.imu_age_s));
        let drops = self.flight.drops();
        if drops.iter().next().is_none() {
            out.push_str("dropped: nothing\n");
        }
        for (reason, count) in drops.iter() {
            let how = if reason.is_usual() { "unused, as at every start" } else { "dropped" };
            let _ = writeln!(out, "{how}: {} {count}", reason.name());
        }
        out.push('\n');
        for check in &self.checks {
            let word = match &check.verdict {
                Verdict::Pass => "pass".to_string(),
                Verdict::Warn => "look".to_string(),
                Verdict::Fail => "FAIL".to_string(),
                Verdict::NotChecked { why } => format!("NOT CHECKED ({why})"),
            };
            let Check { name, found, allowed, .. } = check;
            let _ = writeln!(out, "{word}  {name}: {found} (allowed: {allowed})");
        }
        let word = match self.judged() {
            Judged::Well => "PASS",
            Judged::Badly => "FAIL",
            Judged::Not => self.late.as_deref().unwrap_or_default(),
        };
        let _ = writeln!(out, "\n{word}");
        out
    }

    /// The keys that scripts rely on.
    pub fn json(&self, log: &Path, report: &Path) -> Value {
        let paths: Vec<Value> = self
            .errors
            .iter()
            .map(|row| {
                json!({
                    "name": row.path,
                    "axis": AXES[row.axis],
                    "position_mae_m": row.position_m.mae(),
                    "position_std_m": row.position_m.std(),
                    "velocity_mae_mps": row.velocity_mps.mae(),
                    "estimate_mae_m": row.estimate_position_m.mae(),
                })
            })
            .collect();
        let drops: serde_json::Map<String, Value> =
            self.flight.drops().iter().map(|(r, n)| (r.name().to_string(), n.into())).collect();
        json!({
            "ok": self.ok(),
            "not_judged": self.late.as_ref().filter(|_| self.judged() == Judged::Not),
            "paths": paths,
            "deadline_misses": self.deadline_misses(),
            "drops": drops,
            "log": log,
            "report": report,
        })
    }

    /// The page.
    pub fn html(&self, log: &Path) -> String {
        let name = shown_name(log);
        Page {
            title: "Demo flight",
            subtitle: &format!("simulated Flapper, {name}"),
            checks: &self.checks,
            errors: &self.errors,
            paths: &self.paths,
            flight: &self.flight,
        }
        .render()
    }
}
