//! `haltere fit lag`: what the attitude makes of its setpoint, roll and pitch apart.
//!
//! The attitude is the estimate's, which integrates the gyroscope and lags by no more than the IMU
//! message. Only stretches in which the setpoint moves count: doublets, steps, turns of a leg.

use super::PLOT_PX;
use crate::fit::lag::{self, Lag, LagError, Order};
use crate::fit::outcome::{Outcome, Refusal};
use crate::fit::programs::Program;
use crate::fit::source::{Source, names};
use crate::report::svg::{Mark, Plot, Series, Tone};

/// Step of the columns, s: the control period.
const STEP_S: f64 = 0.01;
/// Longest stretch that is fitted, s: more adds time and little else.
const MOST_S: f64 = 60.0;
/// A stretch begins this long before the setpoint moves and ends this long after, s.
const AROUND_S: f64 = 0.7;
/// The setpoint moves when it changes by more than this within a tenth of a second, rad.
const MOVES_RAD: f64 = 0.04;
/// A recording that is silent for longer goes on where it speaks again, s.
const GAP_S: f64 = 1.0;
/// Length of the plot, s.
const SHOWN_S: f64 = 8.0;

/// Setpoint and attitude, evenly spaced, without trims.
struct Columns {
    setpoint_rad: [Vec<f64>; 2],
    attitude_rad: [Vec<f64>; 2],
}

/// Fits the lag.
pub fn fit(sources: &[Source]) -> Result<Outcome, Refusal> {
    let mut columns =
        Columns { setpoint_rad: [Vec::new(), Vec::new()], attitude_rad: [Vec::new(), Vec::new()] };
    for source in sources {
        gather(source, &mut columns)?;
    }
    let mut outcome = Outcome::new(
        "lag",
        names(sources),
        "attitude = offset + gain·(setpoint, delayed, through a first or second order)",
    );
    let mut refused = Vec::new();
    for (axis, name) in ["roll", "pitch"].into_iter().enumerate() {
        let (u, y) = excited(&columns.setpoint_rad[axis], &columns.attitude_rad[axis]);
        match lag::fit(STEP_S, &u, &y) {
            Ok(found) => told(&mut outcome, name, &found, &u, &y),
            Err(LagError::NotExcited { .. } | LagError::TooFew { .. }) if u.is_empty() => {
                refused.push(format!("{name}: the setpoint does not move"));
            }
            Err(why) => refused.push(format!("{name}: {why}")),
        }
    }
    if outcome.parameters.is_empty() {
        return Err(Refusal::NotExcited { why: refused.join("; "), program: Program::Lag });
    }
    outcome.notes.extend(refused);
    outcome.notes.push(
        "no key of the configuration holds the lag; control.drag.filter_s should be about half of \
         the time it is late"
            .into(),
    );
    Ok(outcome)
}

fn gather(source: &Source, columns: &mut Columns) -> Result<(), Refusal> {
    match source {
        Source::Log { flight, .. } => {
            let mut estimates = flight.estimates.iter().peekable();
            for c in &flight.controls {
                while estimates.next_if(|e| e.at < c.at).is_some() {}
                let Some(e) = estimates.peek() else { break };
                let [roll, pitch, _] = e.R_EB.euler_rad();
                for (k, (set, is)) in
                    [(c.roll_rad, roll), (c.pitch_rad, pitch)].into_iter().enumerate()
                {
                    columns.setpoint_rad[k].push(set);
                    columns.attitude_rad[k].push(is);
                }
            }
            Ok(())
        }
        Source::Recording(r) => {
            let mut rows = r.rows.iter().peekable();
            let Some(first) = r.rows.first().filter(|row| row.setpoint_rad.is_some()) else {
                return Err(Refusal::WrongKind {
                    why: format!(
                        "{}: no columns set_roll_deg, set_pitch_deg, set_yaw_deg: a lag needs the \
                         setpoint",
                        r.name
                    ),
                });
            };
            let (mut t_s, mut last) = (first.t_s, *first);
            while let Some(next) = rows.peek() {
                if next.t_s <= t_s {
                    last = **next;
                    rows.next();
                    continue;
                }
                // What is not recorded is not made up, nor is a grid of whatever length a stamp claims. At
                // stamps so large that a step is lost in them the grid would never arrive.
                if next.t_s - t_s > GAP_S || t_s + STEP_S <= t_s {
                    t_s = next.t_s;
                    continue;
                }
                let [roll, pitch, _] = last.R_EB.euler_rad();
                let [set_roll, set_pitch, _] = last.setpoint_rad.unwrap_or_default();
                for (k, (set, is)) in [(set_roll, roll), (set_pitch, pitch)].into_iter().enumerate()
                {
                    columns.setpoint_rad[k].push(set);
                    columns.attitude_rad[k].push(is);
                }
                t_s += STEP_S;
            }
            Ok(())
        }
        Source::Stand(s) => {
            Err(Refusal::WrongKind { why: format!("{}: a thrust stand shows no attitude", s.name) })
        }
    }
}

/// The parts in which the setpoint moves, with their surroundings.
fn excited(setpoint: &[f64], attitude: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let n = setpoint.len();
    let around = (AROUND_S / STEP_S) as usize;
    let tenth = (0.1 / STEP_S) as usize;
    let mut keep = vec![false; n];
    for i in tenth..n {
        if (setpoint[i] - setpoint[i - tenth]).abs() > MOVES_RAD {
            let end = (i + around).min(n);
            keep[i.saturating_sub(around + tenth)..end].fill(true);
        }
    }
    let most = (MOST_S / STEP_S) as usize;
    let pick = |values: &[f64]| {
        values.iter().zip(&keep).filter(|(_, k)| **k).map(|(v, _)| *v).take(most).collect()
    };
    (pick(setpoint), pick(attitude))
}

fn told(outcome: &mut Outcome, name: &str, found: &Lag, u: &[f64], y: &[f64]) {
    let best = found.best();
    outcome.parameter(format!("{name} delay"), "s", best.delay_s);
    if let Some(time_s) = best.time_s {
        outcome.parameter(format!("{name} time constant"), "s", time_s);
    }
    if let (Some(omega), Some(damping)) = (best.omega_radps, best.damping) {
        outcome.parameter(format!("{name} natural frequency"), "rad/s", omega);
        outcome.parameter(format!("{name} damping"), "", damping);
    }
    outcome.parameter(format!("{name} gain"), "", best.gain);
    outcome.parameter(format!("{name} offset"), "deg", best.offset_rad.scaled(1f64.to_degrees()));
    outcome.parameter(format!("{name} late altogether"), "s", best.late_s);
    outcome.quality(format!("{name} R²"), best.r_squared, "");
    outcome.quality(format!("{name} rms of what is left"), best.residual_rad.to_degrees(), "deg");
    let second = found.second.as_ref().map_or(f64::NAN, |s| s.aic);
    outcome.notes.push(format!(
        "{name}: {} order preferred (AIC {:.0} first, {second:.0} second); setpoint of {:.1} deg rms",
        match found.preferred {
            Order::First => "first",
            Order::Second => "second",
        },
        found.first.aic,
        found.setpoint_rms_rad.to_degrees()
    ));
    let line = |label: &str, tone, mark, values: &[f64]| Series {
        name: label.into(),
        tone,
        mark,
        points: values
            .iter()
            .take((SHOWN_S / STEP_S) as usize)
            .enumerate()
            .map(|(i, v)| [i as f64 * STEP_S, v.to_degrees()])
            .collect(),
    };
    outcome.plots.push(Plot {
        title: format!("{name}: setpoint, attitude and fit"),
        x_label: "time, s (rests cut out)".into(),
        y_label: "deg".into(),
        series: vec![
            line("setpoint", Tone::Command, Mark::Dashed, u),
            line("attitude", Tone::Truth, Mark::Line, y),
            line("fit", Tone::Estimate, Mark::Line, &lag::response(STEP_S, u, best)),
        ],
        size_px: PLOT_PX,
        ..Plot::default()
    });
}
