//! `haltere fit ground`: the ladder of heights.
//!
//! Hover of the logs, in means of half a second. The command is made independent of the battery with
//! the discharge law (exponent −1, or what `fit thrust` found), then held against the height. Heights
//! are those that were asked for: one rung is one height, and the noise of the estimate does not
//! smear the law. The mean height by the estimate is shown beside it.

use super::thrust::pack;
use super::{APART_S, PLOT_PX, logs};
use crate::fit::columns::{HoverMean, hover_means};
use crate::fit::ground::{self, Ground};
use crate::fit::outcome::{Outcome, Refusal, Table};
use crate::fit::programs::Program;
use crate::fit::source::{Source, names};
use crate::report::svg::{Mark, Plot, Series, Tone};

/// Heights nearer to one another than this are one rung, m.
const RUNG_M: f64 = 0.05;
/// Least time on a rung, s.
const LEAST_RUNG_S: f64 = 10.0;

/// Means on one rung.
struct Rung {
    height_m: f64,
    seen_m: f64,
    seconds: f64,
    mean: f64,
    std_throttle_frac: f64,
    std_supply_v: f64,
}

/// Fits the ground effect. `exponent` is that of the discharge law; with `truth` the heights are the
/// true ones of the log.
pub fn fit(sources: &[Source], exponent: f64, truth: bool) -> Result<Outcome, Refusal> {
    let logs = logs(sources, Program::Ground)?;
    let mut means: Vec<HoverMean> = Vec::new();
    for (flight, config) in logs {
        let offset_s = means.last().map_or(0.0, |m| m.t_s + APART_S);
        let gear_m = config.flight.gear_height_m;
        means.extend(hover_means(flight, truth).into_iter().map(|m| HoverMean {
            t_s: m.t_s + offset_s,
            height_m: m.height_m - gear_m,
            seen_m: m.seen_m - gear_m,
            ..m
        }));
    }
    let centre_v = pack(sources).centre_v();
    let free = |m: &HoverMean| m.thrust_frac * (m.supply_v / centre_v).powf(-exponent);
    let rungs = rungs(&means, &free);
    let on_rung = |m: &HoverMean| rungs.iter().any(|r| (r.height_m - m.height_m).abs() < RUNG_M);
    means.retain(on_rung);
    let t: Vec<f64> = means.iter().map(|m| m.t_s).collect();
    // One rung is one height: the mean that was truly flown, or what was asked for.
    let of_rung = |m: &HoverMean| {
        let rung = rungs.iter().find(|r| (r.height_m - m.height_m).abs() < RUNG_M);
        rung.filter(|_| truth).map_or(m.height_m, |r| r.seen_m)
    };
    let h: Vec<f64> = means.iter().map(of_rung).collect();
    let y: Vec<f64> = means.iter().map(free).collect();
    let found = ground::fit(&t, &h, &y).map_err(|why| Refusal::NotExcited {
        why: format!("{why}; hovers of at least {LEAST_RUNG_S} s count"),
        program: Program::Ground,
    })?;
    Ok(told(sources, &found, &rungs, exponent, truth))
}

fn rungs(means: &[HoverMean], free: &dyn Fn(&HoverMean) -> f64) -> Vec<Rung> {
    let mut sorted: Vec<&HoverMean> = means.iter().collect();
    sorted.sort_by(|a, b| a.height_m.total_cmp(&b.height_m));
    sorted
        .chunk_by(|a, b| b.height_m - a.height_m < RUNG_M)
        .map(|group| {
            let n = group.len() as f64;
            let mean =
                |of: &dyn Fn(&HoverMean) -> f64| group.iter().map(|m| of(m)).sum::<f64>() / n;
            let std = |of: &dyn Fn(&HoverMean) -> f64| {
                let centre = mean(of);
                (group.iter().map(|m| (of(m) - centre).powi(2)).sum::<f64>() / n).sqrt()
            };
            Rung {
                height_m: mean(&|m| m.height_m),
                seen_m: mean(&|m| m.seen_m),
                seconds: 0.5 * n,
                mean: mean(free),
                std_throttle_frac: std(&|m| m.thrust_frac) / mean(&|m| m.thrust_frac),
                std_supply_v: std(&|m| m.supply_v),
            }
        })
        .filter(|r| r.seconds >= LEAST_RUNG_S)
        .collect()
}

fn told(sources: &[Source], found: &Ground, rungs: &[Rung], exponent: f64, truth: bool) -> Outcome {
    let mut outcome = Outcome::new(
        "ground",
        names(sources),
        "thrust that hovers at h over thrust far from the floor = 1 - lambda/(h - a)^2",
    );
    outcome.parameter("lambda", "m²", found.lambda_m2);
    outcome.parameter("a", "m", found.a_m);
    outcome.parameter("ratio at the lowest rung", "", found.at_lowest);
    let centre_v = pack(sources).centre_v();
    outcome.parameter(format!("free-air command at {centre_v} V"), "of full", found.free);
    outcome.quality("R²", found.r_squared, "");
    outcome.quality("scatter of half a second, one sigma", found.scatter_frac, "of free air");
    let [low, high] = found.range_m;
    outcome.notes.push(format!(
        "heights from {low:.2} to {high:.2} m; below {low:.2} m the law dives towards its pole and is \
         held"
    ));
    outcome.notes.push(format!("battery taken out with exponent {exponent:.2}"));
    if !truth {
        outcome.notes.push(
            "heights are those asked for: what ranging adds near the floor (up to half a metre of \
             multipath) is not seen in a log without truth or motion capture, and shifts the law"
                .into(),
        );
    }
    if found.lambda_m2.value.abs() < 2.0 * found.lambda_m2.std {
        outcome.notes.push(
            "lambda is not told from zero, or is traded for a: trust the ratio at the lowest rung \
             before either of them"
                .into(),
        );
    }
    if found.at_bound {
        outcome.notes.push("a ran to the end of its search: the rungs show no law".into());
    }
    outcome.tables.push(Table {
        title: "rungs".into(),
        head: [
            "asked m",
            if truth { "true m" } else { "estimate m" },
            "s",
            "ratio",
            "scatter of throttle",
            "of voltage V",
        ]
        .map(String::from)
        .to_vec(),
        rows: rungs
            .iter()
            .map(|r| {
                vec![
                    format!("{:.2}", r.height_m),
                    format!("{:.2}", r.seen_m),
                    format!("{:.0}", r.seconds),
                    format!("{:.4}", r.mean / found.free.value),
                    format!("{:.2} %", r.std_throttle_frac * 100.0),
                    format!("{:.3}", r.std_supply_v),
                ]
            })
            .collect(),
    });
    let line = |factor: f64| {
        (0..=80)
            .map(|i| low + (high - low) * f64::from(i) / 80.0)
            .map(|h| [h, found.ratio(h) * factor])
            .collect::<Vec<_>>()
    };
    let series = |name: &str, tone, mark, points| Series { name: name.into(), tone, mark, points };
    outcome.plots.push(Plot {
        title: "Thrust ratio over height".into(),
        x_label: "height, m".into(),
        y_label: "ratio".into(),
        series: vec![
            series(
                "rungs",
                Tone::Truth,
                Mark::Dots,
                rungs
                    .iter()
                    .map(|r| [if truth { r.seen_m } else { r.height_m }, r.mean / found.free.value])
                    .collect(),
            ),
            series("law", Tone::Command, Mark::Line, line(1.0)),
            series("one sigma up", Tone::Family(1), Mark::Dashed, line(1.0 + found.scatter_frac)),
            series("one sigma down", Tone::Family(1), Mark::Dashed, line(1.0 - found.scatter_frac)),
        ],
        size_px: PLOT_PX,
        ..Plot::default()
    });
    outcome.offer(format!(
        "[control.ground]\nlambda_m2 = {:.6}\na_m = {:.4}\n",
        found.lambda_m2.value, found.a_m.value
    ));
    outcome
}
