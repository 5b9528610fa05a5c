//! What worlds teach of sessions: how much more a statistic varies between them than within one.
//!
//! `r = E[(s - m)^2] / w - (1 + 1/n)` over healthy flights of other sessions, where `m` and `w` are mean and variance of `n` accepted
//! flights of one. No bank and no commissioning is needed: a residual moves by the same whichever chain it was formed with.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use haltere_gap::flight::statistics::{specs, statistics_of};
use haltere_gap::flight::trace::Trace;
use haltere_gap::nominal::Nominal;
use haltere_log::written;

use super::flown::Flyable;

/// A flight farther than this many sigma counts as so far: one that was disturbed says nothing of the others.
const FARTHEST: f64 = 12.0;
/// Fewest worlds that know a statistic.
const LEAST_WORLDS: usize = 6;

/// Flies the sessions of these worlds and writes `r` of every statistic that varies more between sessions, by name.
pub fn sessions(seeds: &[u64], file: &Path) -> Result<()> {
    let mut sums = vec![Vec::new(); specs().len()];
    for seed in seeds {
        let flyable = Flyable::found(*seed, &|line| eprintln!("{seed}: {line}"))?;
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

/// What [`sessions`] wrote, in the order of the statistics.
pub fn taught(file: &Path) -> Result<Vec<f64>> {
    let place = || file.display().to_string();
    let text = std::fs::read_to_string(file).with_context(place)?;
    let found: BTreeMap<String, f64> = serde_json::from_str(&text).with_context(place)?;
    Ok(specs().iter().map(|spec| found.get(&spec.name).copied().unwrap_or(0.0)).collect())
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
    let mean = own.iter().sum::<f64>() / n;
    let variance = own.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1.0);
    let variance = variance + specs()[j].resolution.powi(2);
    // A variance of n flights stands too small in a denominator: by (n - 1) / (n - 3) on average.
    let fair = (n - 3.0) / (n - 1.0);
    let square = |v: &f64| ((v - mean).powi(2) / variance).min(FARTHEST.powi(2));
    let squares = other.iter().map(square).sum::<f64>() / other.len() as f64;
    (variance > 0.0).then_some(fair * squares - (1.0 + 1.0 / n))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::generator::noise::Noise;

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
