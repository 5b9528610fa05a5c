//! `haltere-lab detectable`: from which size on an effect of the generator shows in the diagnostic flight.
//!
//! The suite flies every effect at one, two and four times this size (GAP.md 4.2), or the mild end of its
//! plausible range where that is larger, so it must not hang on the diagnosis that is scored. It is found by
//! a detector that knows no effect and learns nothing:
//!
//! ```text
//! z_i = (s_i - median_i) / max(1.4826 MAD_i, SD_i)      over N healthy flights
//! d   = sum of max(|z_i| - 2.5, 0)^2 over the statistics s_i of the flight
//! ```
//! An effect shows when d is above what 5 % of as many other healthy flights have. Strengths are halves
//! of the strong end of the plausible range; a draw of sign, direction, place and anchor shows down to the
//! weakest strength from which on all stronger ones are above the line, and half an octave below it is
//! its limit. The detectable strength is the median of the limits of all draws.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};
use haltere::progress::Progress;
use haltere_gap::flight::logs;
use haltere_gap::flight::statistics::observe;
use haltere_gap::nominal::Nominal;
use haltere_gap::scene::{Scene, Told};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::list::{Mission, mixed};
use super::{GENERATOR, SUITE_SEED, flight};
use crate::generator::craft::Craft;
use crate::generator::effects::{Deviations, Spec, known, unknown};
use crate::generator::noise::Noise;
use crate::generator::{Setup, hall};

/// Strengths tried: the strong end and so many halves of it.
const HALVES: u32 = 5;
/// Where a statistic begins to count, sigma: one healthy statistic of eighty is beyond it.
const FROM_SIGMA: f64 = 2.5;
/// Sigma of a normal distribution over its median absolute deviation.
const SIGMA_PER_MAD: f64 = 1.4826;
/// Share of healthy flights above the line.
const FALSE_ALARM: f64 = 0.05;
/// Fewest healthy flights in which a statistic must be there.
const LEAST_SHARE: f64 = 0.8;

/// What to measure.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Draws of sign, direction, place and anchor for each effect.
    #[arg(long, default_value_t = 6, value_parser = clap::value_parser!(u64).range(1..=100))]
    draws: u64,
    /// Healthy flights for the scale, and as many again for the line; every other one with jitter.
    #[arg(long, default_value_t = 100, value_parser = clap::value_parser!(u64).range(20..=2000))]
    healthy: u64,
    /// Seed of the suite whose room is flown in.
    #[arg(long, default_value_t = SUITE_SEED)]
    seed: u64,
    /// Writes the sizes that the suite is made with.
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Writes statistics of labelled flights instead, a line of JSON each.
    ///
    /// Every effect at one, two and four times its committed size, and as many healthy flights as for scale and
    /// line together, with seeds of their own: none of them is a case of the suite. They show what the statistics can
    /// tell at all (`sim/lab/peers/oracle.py`).
    #[arg(long, value_name = "FILE", conflicts_with = "out")]
    labelled: Option<PathBuf>,
    /// Keeps the logs of the labelled flights in this folder, some 10 MB each: `haltere gap observe` says other statistics of
    /// them.
    #[arg(long, value_name = "DIR", requires = "labelled")]
    logs: Option<PathBuf>,
}

/// The committed measurement.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Detectable {
    /// Name of the generator.
    pub generator: String,
    /// Seed of the suite whose room was flown in.
    pub suite_seed: u64,
    /// Healthy flights for the scale and for the line.
    pub healthy: [usize; 2],
    /// The line.
    pub line: f64,
    /// By id of the effect.
    pub effects: BTreeMap<String, Limit>,
}

/// From where on one effect shows.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Limit {
    /// Name of the effect.
    pub name: String,
    /// Smallest size that shows in half of the draws, in `unit`; absent: more than half do not show at the
    /// strong end either.
    pub size: Option<f64>,
    /// Strong end of the plausible range.
    pub strong: f64,
    /// Unit of both.
    pub unit: String,
    /// Octaves below the strong end down to which each draw shows; -1: not at all.
    pub octaves: Vec<i32>,
    /// Flights that did not land by themselves.
    pub not_landed: usize,
}

impl Detectable {
    /// What the suite is made with.
    pub fn committed() -> Self {
        // The file is part of the source, and a test reads it.
        serde_json::from_str(include_str!("detectable.json")).unwrap_or_else(|error| {
            panic!(
                "sim/lab/src/cases/detectable.json, written by `haltere-lab detectable`: {error}"
            )
        })
    }

    /// Size of an effect at so many times its detectable strength, or times the mild end of its plausible
    /// range where that is stronger; not beyond the strong end.
    pub fn size(&self, spec: &Spec, times: f64) -> f64 {
        let detectable = self.effects.get(spec.id).and_then(|limit| limit.size);
        let [mildest, strongest] = spec.range.map(|size| spec.strength(size));
        let least = detectable.map_or(strongest, |size| spec.strength(size).max(mildest));
        spec.size((times * least).min(strongest))
    }
}

/// Measures and prints; `true` when something was measured.
pub fn run(options: &Options) -> Result<bool> {
    let scene = Scene::lab().map_err(|problems| anyhow!("{problems}"))?;
    let passing = tempfile::tempdir()?;
    let folder = options.logs.as_deref().unwrap_or(passing.path());
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let bench = Bench { scene: &scene, folder, keep: options.logs.is_some(), seed: options.seed };
    if let Some(path) = &options.labelled {
        labelled::write(&bench, options, path)?;
        return Ok(true);
    }
    let (scale, line) = bench.healthy(options.healthy)?;
    let specs: Vec<&Spec> = known().chain(unknown()).collect();
    let jobs: Vec<(&Spec, u64)> =
        specs.iter().flat_map(|spec| (0..options.draws).map(move |draw| (*spec, draw))).collect();
    let progress = Progress::counted("draws", 0, jobs.len() as u64);
    let found: Vec<(i32, usize)> = jobs
        .par_iter()
        .map(|(spec, draw)| {
            let found = bench.octaves(spec, *draw, &scale, line)?;
            progress.advance(1);
            Ok(found)
        })
        .collect::<Result<_>>()?;
    progress.end();
    let effects = specs
        .iter()
        .zip(found.chunks(options.draws as usize))
        .map(|(spec, draws)| (spec.id.to_owned(), limit(spec, draws)))
        .collect();
    let measured = Detectable {
        generator: GENERATOR.to_owned(),
        suite_seed: options.seed,
        healthy: [options.healthy as usize; 2],
        line,
        effects,
    };
    let text = serde_json::to_string_pretty(&measured)? + "\n";
    if let Some(path) = &options.out {
        haltere_log::written::write(path, &text, &[""; 0])?;
    }
    print!("{text}");
    Ok(true)
}

/// The detectable size from the draws of an effect.
fn limit(spec: &Spec, draws: &[(i32, usize)]) -> Limit {
    let mut octaves: Vec<i32> = draws.iter().map(|(octaves, _)| *octaves).collect();
    octaves.sort_unstable();
    let middle = octaves.len() / 2;
    let median = if octaves.len() % 2 == 1 {
        f64::from(octaves[middle])
    } else {
        0.5 * f64::from(octaves[middle - 1] + octaves[middle])
    };
    // A draw's limit lies half an octave below the weakest strength that shows.
    let size = (median > -0.75)
        .then(|| spec.size(spec.strongest() * 0.5_f64.powf((median + 0.5).max(0.0))));
    Limit {
        name: spec.name.to_owned(),
        size,
        strong: spec.range[1],
        unit: spec.unit.to_owned(),
        octaves,
        not_landed: draws.iter().map(|(_, lost)| lost).sum(),
    }
}

/// Centre and width of every statistic over healthy flights; absent where too few have it.
struct Scale(Vec<Option<(f64, f64)>>);

impl Scale {
    fn of(flights: &[Vec<f64>]) -> Self {
        let count = flights.first().map_or(0, Vec::len);
        let one = |i: usize| {
            let mut values: Vec<f64> =
                flights.iter().map(|f| f[i]).filter(|v| v.is_finite()).collect();
            if (values.len() as f64) < LEAST_SHARE * flights.len() as f64 {
                return None;
            }
            let n = values.len() as f64;
            let centre = median(&mut values);
            let sd = (values.iter().map(|v| (v - centre).powi(2)).sum::<f64>() / n).sqrt();
            let mut off: Vec<f64> = values.iter().map(|v| (v - centre).abs()).collect();
            let width = sd.max(SIGMA_PER_MAD * median(&mut off));
            (width > 0.0).then_some((centre, width))
        };
        Self((0..count).map(one).collect())
    }

    /// How far a flight is from the healthy ones.
    fn distance(&self, flight: &[f64]) -> f64 {
        let squares = self.0.iter().zip(flight).filter_map(|(scale, value)| {
            let (centre, width) = (*scale)?;
            let beyond = ((value - centre) / width).abs() - FROM_SIGMA;
            // Not visited on this flight: says nothing.
            (beyond > 0.0).then(|| beyond.powi(2))
        });
        squares.sum()
    }
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let n = values.len();
    0.5 * (values[(n - 1) / 2] + values[n / 2])
}

/// What is seen of a flight.
struct Seen {
    statistics: Vec<f64>,
    /// By itself.
    landed: bool,
    /// The mission was flown to its end.
    whole: bool,
}

/// Where draws are flown and looked at.
struct Bench<'a> {
    scene: &'a Scene,
    folder: &'a Path,
    /// Logs stay in the folder.
    keep: bool,
    seed: u64,
}

impl Bench<'_> {
    /// Scale and line from healthy flights.
    fn healthy(&self, count: u64) -> Result<(Scale, f64)> {
        let progress = Progress::counted("healthy flights", 0, 2 * count);
        let flights: Vec<Option<Vec<f64>>> = (0..2 * count)
            .into_par_iter()
            .map(|number| {
                let seed = mixed(self.seed ^ 0x4ea1, number);
                let name = format!("healthy-{number}");
                let seen = self.fly(&name, seed, number % 2 == 1, Deviations::default())?;
                progress.advance(1);
                Ok(seen.filter(|seen| seen.landed).map(|seen| seen.statistics))
            })
            .collect::<Result<_>>()?;
        progress.end();
        let half = |odd: usize| -> Vec<Vec<f64>> {
            let of = flights.iter().enumerate().filter(|(i, _)| (i / 2) % 2 == odd);
            of.filter_map(|(_, flight)| flight.clone()).collect()
        };
        let scale = Scale::of(&half(0));
        let mut others: Vec<f64> = half(1).iter().map(|flight| scale.distance(flight)).collect();
        others.sort_unstable_by(f64::total_cmp);
        let place = ((1.0 - FALSE_ALARM) * others.len() as f64).ceil() as usize;
        let line = others.get(place.saturating_sub(1)).context("no healthy flight landed")?;
        Ok((scale, *line))
    }

    /// Octaves below the strong end down to which a draw shows, and how many of its flights did not land.
    fn octaves(&self, spec: &Spec, draw: u64, scale: &Scale, line: f64) -> Result<(i32, usize)> {
        let seed = mixed(self.seed ^ 0xde7e_c700, draw) ^ spec.id[1..].parse::<u64>()?;
        let hall = hall(self.scene);
        let (mut shows, mut not_landed) = (-1, 0);
        for halves in 0..=HALVES {
            let size = spec.size(spec.strongest() * 0.5_f64.powi(halves as i32));
            let mut deviations = Deviations::default();
            // The same draw at every strength.
            spec.apply(size, &mut Noise::new(seed, spec.id), &hall, &mut deviations);
            let name = format!("{}-{draw}-{halves}", spec.id);
            let seen = self.fly(&name, seed, false, deviations)?;
            not_landed += usize::from(!seen.as_ref().is_some_and(|s| s.landed));
            // What cannot be looked at, or ended early, is seen by anybody.
            let seen = seen.is_none_or(|s| !s.landed || scale.distance(&s.statistics) > line);
            if !seen {
                break;
            }
            shows = halves as i32;
        }
        Ok((shows, not_landed))
    }

    /// A diagnostic flight; `None`: nothing can be observed.
    fn fly(
        &self,
        name: &str,
        seed: u64,
        jitter: bool,
        deviations: Deviations,
    ) -> Result<Option<Seen>> {
        let healthy = Setup::healthy(self.scene, mixed(seed, 1));
        let craft: Craft = healthy.craft.clone();
        let craft = if jitter { craft.jittered(seed) } else { craft };
        let setup = Setup { craft, deviations, room_seed: self.seed, ..healthy };
        let path = self.folder.join(format!("{name}.mcap"));
        let outcome = flight::record(self.scene, setup, Mission::Diagnostic, &path)
            .with_context(|| path.display().to_string())?;
        let flown = logs::read(&path).ok();
        if !self.keep {
            std::fs::remove_file(&path).with_context(|| path.display().to_string())?;
        }
        Ok(flown.and_then(|flown| {
            let scene = flown.scene(&Told::of_room(&self.scene.room)).on_grid();
            let seen = observe(&flown.trace, &Nominal::of_scene(&scene)).ok()?;
            let whole = scene.until_s.is_none();
            Some(Seen { statistics: seen.statistics, landed: outcome.landed, whole })
        }))
    }
}

mod labelled;
#[cfg(test)]
mod tests;
