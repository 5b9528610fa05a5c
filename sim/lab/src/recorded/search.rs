//! Leave one flight out: parameters chosen by search on the other flights, judged on that one.
//!
//! The search walks along one parameter after the other, in factors that shrink from round to round,
//! from a start that none of the flights has shaped (`start`). Flights with and without IMU are searched together, since one
//! set of UWB errors flies. What it minimises is the
//! root of the mean over the flights of `½ (whole flight)² + ½ (airborne)²`, 3D rms, m. A change is taken
//! only when its mean gain exceeds the standard error of that mean over the flights (the one standard
//! error rule of Breiman, Friedman, Olshen and Stone, Classification and Regression Trees, 1984, 3.4.3):
//! what helps one flight and spoils the next is chance, and would be carried to the one left out.

use std::fmt::{self, Write};

use serde::Serialize;

use crate::util_flights::file::Flight;
use crate::util_flights::{FlightReport, run_flight, table};
use haltere_core::estimator::{AnchorBias, EstimatorConfig, GateConfig, IsolationConfig, Quality};

/// Error that a flight without a figure or with a divergence counts as, m.
const DIVERGED_M: f64 = 5.0;
/// Factors of the rounds.
const FACTORS: [f64; 3] = [2.0, 1.414, 1.19];

/// A parameter that is searched.
struct Knob {
    name: &'static str,
    of: fn(&mut EstimatorConfig) -> &mut f64,
}

const KNOBS: [Knob; 10] = [
    Knob { name: "std_uwb_m", of: |c| &mut c.std_uwb_m },
    Knob { name: "uwb_correlation_s", of: |c| &mut c.uwb_correlation_s },
    Knob { name: "anchor_bias.std_m", of: |c| &mut c.anchor_bias.std_m },
    Knob { name: "anchor_bias.constant_std_m", of: |c| &mut c.anchor_bias.constant_std_m },
    Knob { name: "anchor_bias.correlation_s", of: |c| &mut c.anchor_bias.correlation_s },
    Knob { name: "anchor_bias.correlation_m", of: |c| &mut c.anchor_bias.correlation_m },
    Knob { name: "anchor_bias.level_s", of: |c| &mut c.anchor_bias.level_s },
    Knob { name: "quality.time_s", of: |c| &mut c.quality.time_s },
    Knob { name: "isolation.others_doubt", of: |c| &mut c.isolation.others_doubt },
    Knob { name: "gate.tail_sigma", of: |c| &mut c.gate.tail_sigma },
];

/// One flight left out.
#[derive(Debug, Clone, Serialize)]
pub struct LeftOut {
    /// How it went with parameters of the others.
    pub report: FlightReport,
    /// How it goes with the set that is shipped.
    pub flown: FlightReport,
    /// What the search chose, by name.
    pub chosen: Vec<(&'static str, f64)>,
    /// What the search reached on the others, m.
    pub training_m: f64,
}

/// Where the search begins: round numbers from the README of the recordings (white part 0.05 to 0.09 m, constant of 0.06
/// m, wandering part of 0.04 to 0.3 m that stays 0.1 to 3 s) and what is usual, none of it from our own results. The
/// vehicle's numbers are those of what flies and not searched.
fn start(flown: &EstimatorConfig) -> EstimatorConfig {
    EstimatorConfig {
        std_uwb_m: 0.1,
        uwb_correlation_s: 0.1,
        gate: GateConfig { tail_sigma: 2.0, ..flown.gate },
        anchor_bias: AnchorBias {
            std_m: 0.2,
            correlation_s: 3.0,
            correlation_m: 1.0,
            level_s: 10.0,
            constant_std_m: 0.06,
            ..flown.anchor_bias
        },
        quality: Quality { time_s: 1.0, ..flown.quality },
        isolation: IsolationConfig { others_doubt: 1.0, ..flown.isolation },
        ..flown.clone()
    }
}

/// Leaves out every flight in turn. `tell` is told how far it is: done, of how many, what.
pub fn leave_one_out(
    flights: &[Flight],
    flown: &EstimatorConfig,
    mut tell: impl FnMut(usize, usize, &str),
) -> Vec<LeftOut> {
    let total = flights.len() * FACTORS.len() * KNOBS.len();
    let mut done = 0;
    let mut out = Vec::new();
    for (i, flight) in flights.iter().enumerate() {
        let others: Vec<&Flight> =
            flights.iter().enumerate().filter(|(k, _)| *k != i).map(|(_, f)| f).collect();
        let (config, training_m) = search(&others, &start(flown), |knob| {
            done += 1;
            tell(done, total, &format!("without {}: {knob}", flight.name));
        });
        let mut chosen_of = config.clone();
        out.push(LeftOut {
            report: run_flight(flight, &config),
            flown: run_flight(flight, flown),
            chosen: KNOBS.iter().map(|knob| (knob.name, *(knob.of)(&mut chosen_of))).collect(),
            training_m,
        });
    }
    out
}

fn search(
    flights: &[&Flight],
    start: &EstimatorConfig,
    mut tell: impl FnMut(&str),
) -> (EstimatorConfig, f64) {
    let mut best = start.clone();
    let mut least_m2 = costs_m2(flights, &best);
    for factor in FACTORS {
        for knob in &KNOBS {
            tell(knob.name);
            for step in [factor, 1.0 / factor] {
                loop {
                    let mut tried = best.clone();
                    *(knob.of)(&mut tried) *= step;
                    let mut problems = haltere_core::checks::Problems::new();
                    tried.check("", &mut problems);
                    if !problems.is_empty() {
                        break;
                    }
                    let tried_m2 = costs_m2(flights, &tried);
                    if !is_gain(&least_m2, &tried_m2) {
                        break;
                    }
                    (best, least_m2) = (tried, tried_m2);
                }
            }
        }
    }
    (best, mean(&least_m2).sqrt())
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

/// Whether the second costs are lower than the first by more than chance explains.
fn is_gain(before_m2: &[f64], after_m2: &[f64]) -> bool {
    let gains: Vec<f64> = before_m2.iter().zip(after_m2).map(|(b, a)| b - a).collect();
    let n = gains.len() as f64;
    let gain = mean(&gains);
    let spread = gains.iter().map(|g| (g - gain).powi(2)).sum::<f64>() / (n - 1.0).max(1.0);
    gain > (spread / n.max(1.0)).sqrt()
}

/// Cost of each flight, m².
fn costs_m2(flights: &[&Flight], config: &EstimatorConfig) -> Vec<f64> {
    let reports: Vec<FlightReport> = std::thread::scope(|scope| {
        let running: Vec<_> =
            flights.iter().map(|f| scope.spawn(move || run_flight(f, config))).collect();
        running.into_iter().filter_map(|r| r.join().ok()).collect()
    });
    let square = |v: Option<f64>| v.unwrap_or(DIVERGED_M).min(DIVERGED_M).powi(2);
    let cost = |r: &FlightReport| {
        let lost = if r.diverged { DIVERGED_M * DIVERGED_M } else { 0.0 };
        0.5 * (square(r.rmse_3d_m) + square(r.rmse_3d_airborne_m)) + lost
    };
    reports.iter().map(cost).collect()
}

/// Head of the table.
pub const LEFT_OUT_HEAD: &str = "| left out | whole flight | airborne | worst | diverged | the set: whole | airborne |\n\
                                 |---|---|---|---|---|---|---|";

/// Medians over the flights, a line for those with an IMU and one for the others, as the last rows of the table.
pub fn print_medians(out: &mut impl Write, left_out: &[LeftOut]) -> fmt::Result {
    type Figure = fn(&LeftOut) -> Option<f64>;
    for (name, aided) in [("with IMU", true), ("TDOA alone", false)] {
        let median = |of: Figure| {
            let kind = left_out.iter().filter(|l| l.report.aided_by_imu == aided);
            table::metres(table::median(kind.map(of)))
        };
        writeln!(
            out,
            "| **median, {name}** | {} | {} | | | {} | {} |",
            median(|l| l.report.rmse_3d_m),
            median(|l| l.report.rmse_3d_airborne_m),
            median(|l| l.flown.rmse_3d_m),
            median(|l| l.flown.rmse_3d_airborne_m),
        )?;
    }
    Ok(())
}

/// Writes the table as Markdown.
pub fn print_left_out(
    out: &mut impl Write,
    left_out: &[LeftOut],
    flown: &EstimatorConfig,
) -> fmt::Result {
    writeln!(out, "{LEFT_OUT_HEAD}")?;
    for l in left_out {
        writeln!(
            out,
            "| {} | {} | {} | {} | {} | {} | {} |",
            l.report.flight,
            table::metres(l.report.rmse_3d_m),
            table::metres(l.report.rmse_3d_airborne_m),
            table::metres(l.report.worst_m),
            if l.report.diverged { "yes" } else { "no" },
            table::metres(l.flown.rmse_3d_m),
            table::metres(l.flown.rmse_3d_airborne_m),
        )?;
    }
    print_medians(out, left_out)?;
    writeln!(
        out,
        "\nWhat the searches chose:\n\n| parameter | start | the set | least | most |\n|---|---|---|---|---|"
    )?;
    let (mut start, mut flown) = (start(flown), flown.clone());
    for (i, knob) in KNOBS.iter().enumerate() {
        let chosen = || left_out.iter().filter_map(|l| l.chosen.get(i)).map(|(_, v)| *v);
        writeln!(
            out,
            "| `{}` | {:.3} | {:.3} | {:.3} | {:.3} |",
            knob.name,
            (knob.of)(&mut start),
            (knob.of)(&mut flown),
            chosen().fold(f64::INFINITY, f64::min),
            chosen().fold(f64::NEG_INFINITY, f64::max)
        )?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn prop_what_helps_one_flight_alone_is_no_gain() {
        let before = [0.04, 0.05, 0.06, 0.05, 0.04];
        assert!(is_gain(&before, &before.map(|c| c - 0.001)));
        assert!(!is_gain(&before, &before));
        assert!(!is_gain(&before, &before.map(|c| c + 0.001)));
        // The same mean gain, by one flight.
        let mut one = before;
        one[2] -= 0.005;
        assert!(!is_gain(&before, &one));
    }
}
