//! What worlds teach: how sessions differ, and how laws of an effect do.
//!
//! Sessions: how much more a statistic varies between them than within one.
//!
//! `r = E[(s - m)^2] / w - (1 + 1/n)` over healthy flights of other sessions, where `m` and `w` are mean and variance of `n` accepted
//! flights of one. Laws: what an effect by the law of that world did to every statistic, beside the same flight without it. No bank
//! and no commissioning is needed: a residual moves by the same whichever chain it was formed with.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use haltere_gap::flight::residuals::StatSpec;
use haltere_gap::flight::statistics::{specs, statistics_of};
use haltere_gap::flight::trace::Trace;
use haltere_gap::nominal::Nominal;
use haltere_log::written;
use nalgebra::DMatrix;
use rayon::prelude::*;
use serde_json::json;

use super::flown::Flyable;
use crate::score::Truth;

/// A flight farther than this many sigma counts as so far: one that was disturbed says nothing of the others.
const FARTHEST: f64 = 12.0;
/// Fewest worlds that know a statistic.
const LEAST_WORLDS: usize = 6;

/// Flies the sessions of these worlds and writes `r` of every statistic that varies more between sessions, by name.
pub fn sessions(seeds: &[u64], file: &Path) -> Result<()> {
    let mut sums = vec![Vec::new(); specs().len()];
    for seed in seeds {
        let flyable = Flyable::found(*seed, false, &|line| eprintln!("{seed}: {line}"))?;
        let nominal = Nominal::of_scene(&flyable.scene);
        let rows = |traces: &mut dyn Iterator<Item = &Trace>| {
            traces.filter_map(|trace| statistics_of(trace, &nominal).ok()).collect::<Vec<_>>()
        };
        let accepted = rows(&mut flyable.accepted.iter());
        let others = rows(&mut flyable.healthy.iter().map(|(_, trace)| trace));
        for (j, sums) in sums.iter_mut().enumerate() {
            sums.extend(excess(&accepted, &others, j));
        }
        eprintln!("{seed}: {} accepted flights, {} others", accepted.len(), others.len());
    }
    let found: BTreeMap<&str, f64> = specs()
        .iter()
        .zip(&sums)
        .filter(|(_, of_worlds)| of_worlds.len() >= LEAST_WORLDS)
        .map(|(spec, of_worlds)| {
            (spec.name.as_str(), of_worlds.iter().sum::<f64>() / of_worlds.len() as f64)
        })
        // Two decimals are more than is known.
        .map(|(name, r)| (name, (100.0 * r.max(0.0)).round() / 100.0))
        .filter(|(_, r)| *r > 0.0)
        .collect();
    let text = serde_json::to_string_pretty(&found)? + "\n";
    written::write(file, text, &[""; 0]).with_context(|| file.display().to_string())
}

/// Principal directions that are kept of what an effect did. Three, five, eight and all name as many of 118 effects of three other worlds
/// (`--choose 0..3`) right, with the gate's limit by its allowance alone: 74, 74, 75 and 76.
const DIRECTIONS: usize = 4;

/// Flies an effect each by the law of these worlds, and writes the directions of what they did: every world counts as much, whatever
/// the strength.
pub fn laws(seeds: &[u64], file: &Path) -> Result<()> {
    let mut did: BTreeMap<String, Vec<Vec<f64>>> = BTreeMap::new();
    let mut scatter = vec![Vec::new(); specs().len()];
    for seed in seeds {
        let flyable = Flyable::found(*seed, false, &|line| eprintln!("{seed}: {line}"))?;
        let nominal = Nominal::of_scene(&flyable.scene);
        let row = |trace: Result<Trace>| statistics_of(&trace.ok()?, &nominal).ok();
        let jobs = flyable.jobs();
        let found: Vec<(&str, Vec<f64>)> = jobs
            .par_iter()
            .filter_map(|job| {
                let Truth::Single { id, .. } = &job.truth else { return None };
                let (with, without) = (row(flyable.fly(job))?, row(flyable.fly_healthy(job))?);
                Some((id.as_str(), with.iter().zip(&without).map(|(a, b)| a - b).collect()))
            })
            .collect();
        eprintln!("{seed}: {} effects", found.len());
        for (id, by) in found {
            did.entry(id.to_owned()).or_default().push(by);
        }
        let accepted: Vec<Vec<f64>> = flyable
            .accepted
            .iter()
            .filter_map(|trace| statistics_of(trace, &nominal).ok())
            .collect();
        for (j, scatter) in scatter.iter_mut().enumerate() {
            let of: Vec<f64> =
                accepted.iter().map(|row| row[j]).filter(|v| v.is_finite()).collect();
            scatter.push(moments(&of)[1].sqrt());
        }
    }
    let typical = |(of, spec): (&mut Vec<f64>, &StatSpec)| {
        of.retain(|v| v.is_finite());
        of.sort_by(f64::total_cmp);
        let middle = of.get(of.len() / 2).map_or(0.0, |middle| middle.hypot(spec.resolution));
        // Two digits.
        format!("{middle:.1e}").parse().unwrap_or(middle)
    };
    let sigma: Vec<f64> = scatter.iter_mut().zip(specs()).map(typical).collect();
    let did: BTreeMap<&str, Vec<Vec<i64>>> =
        did.iter().map(|(id, flights)| (id.as_str(), directions(flights, &sigma))).collect();
    let statistics: Vec<&str> = specs().iter().map(|spec| spec.name.as_str()).collect();
    let told = json!({ "statistics": statistics, "sigma": sigma, "did": did });
    // A line each: lists of numbers are read by nobody, but compared.
    let text = told.to_string().replace("],\"", "],\n\"").replace("]],", "]],\n") + "\n";
    written::write(file, text, &[""; 0]).with_context(|| file.display().to_string())
}

/// Principal directions `1000 s_k v_k / √n` of n flights, each in `sigma` and of length one: `Σ s_k u_k v_kᵀ` is the matrix of these flights, so that
/// all directions together have a square of one (in thousandths).
fn directions(flights: &[Vec<f64>], sigma: &[f64]) -> Vec<Vec<i64>> {
    let mut rows = DMatrix::from_fn(flights.len(), sigma.len(), |i, j| {
        let sized = flights[i][j] / sigma[j];
        if sized.is_finite() { sized } else { 0.0 }
    });
    for mut row in rows.row_iter_mut() {
        let length = row.norm().max(f64::MIN_POSITIVE);
        row /= length;
    }
    let found = rows.svd(false, true);
    let (Some(directions), n) = (found.v_t, flights.len() as f64) else { return Vec::new() };
    let sized = directions.row_iter().zip(found.singular_values.iter()).take(DIRECTIONS);
    sized
        .map(|(row, value)| {
            row.iter().map(|v| (1e3 * v * value / n.sqrt()).round() as i64).collect()
        })
        .collect()
}

/// `r` of a statistic in one world; `None`: not known there, or it never varies.
fn excess(accepted: &[Vec<f64>], others: &[Vec<f64>], j: usize) -> Option<f64> {
    let of = |rows: &[Vec<f64>]| -> Vec<f64> {
        rows.iter().map(|row| row[j]).filter(|v| v.is_finite()).collect()
    };
    let (own, other) = (of(accepted), of(others));
    if own.len() < accepted.len() || other.is_empty() {
        return None;
    }
    let n = own.len() as f64;
    let [mean, variance] = moments(&own);
    let variance = variance + specs()[j].resolution.powi(2);
    // A variance of n flights stands too small in a denominator: by (n - 1) / (n - 3) on average.
    let fair = (n - 3.0) / (n - 1.0);
    let square = |v: &f64| ((v - mean).powi(2) / variance).min(FARTHEST.powi(2));
    let squares = other.iter().map(square).sum::<f64>() / other.len() as f64;
    (variance > 0.0).then_some(fair * squares - (1.0 + 1.0 / n))
}

/// Mean and variance of a sample.
fn moments(values: &[f64]) -> [f64; 2] {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    [mean, values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generator::noise::Noise;

    /// Strength and sign of a flight say nothing of the law, and what never varies is left out.
    #[test]
    fn prop_directions_are_those_of_all_worlds() {
        let sigma = [1.0, 2.0, 0.0];
        let flights = [3.0, -40.0, 0.5].map(|size| vec![0.6 * size, 1.6 * size, size]);
        let found = directions(&flights, &sigma);
        let first: Vec<i64> = found[0].iter().map(|v| v * found[0][0].signum()).collect();
        assert_eq!(first, [600, 800, 0]);
        assert!(found[1..].iter().flatten().all(|v| *v == 0), "{found:?}");
    }

    #[test]
    fn prop_what_sessions_add_is_found() {
        let mut rng = Noise::new(7, "sessions");
        let (mut same, mut more) = (0.0, 0.0);
        let worlds = 400;
        for _ in 0..worlds {
            let mut flight = |shift: f64| {
                let mut row = vec![rng.normal(); specs().len()];
                row[0] += shift;
                row
            };
            let accepted: Vec<_> = (0..10).map(|_| flight(0.0)).collect();
            let others = |shift: f64, flight: &mut dyn FnMut(f64) -> Vec<f64>| {
                (0..3).map(|_| flight(shift)).collect::<Vec<_>>()
            };
            same += excess(&accepted, &others(0.0, &mut flight), 0).unwrap();
            more += excess(&accepted, &others(2.0, &mut flight), 0).unwrap();
        }
        let [same, more] = [same, more].map(|sum| sum / f64::from(worlds));
        assert!(same.abs() < 0.2 && (more - 4.0).abs() < 0.5, "{same} {more}");
    }
}
