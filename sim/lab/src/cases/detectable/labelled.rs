//! Labelled flights of the generator, outside of the suite: what can the statistics tell at all?

use std::io::{BufWriter, Write};
use std::path::Path;
use std::sync::Mutex;

use anyhow::{Context, Result, anyhow};
use haltere::progress::Progress;
use haltere_gap::flight::statistics::specs;
use haltere_log::written::{Old, Output};
use rayon::prelude::*;
use serde_json::json;

use super::{Bench, Detectable, Options};
use crate::cases::list::mixed;
use crate::generator::effects::{Deviations, Spec, known, unknown};
use crate::generator::hall;
use crate::generator::noise::Noise;

/// Strengths, in detectable ones.
const TIMES: [u64; 3] = [1, 2, 4];

/// One flight: its effect, the draw of sign, place and anchor, the strength.
type Job = (Option<&'static Spec>, u64, u64);

/// Flies them all and writes a line of JSON for each, in any order, after one with the names of the statistics.
pub(super) fn write(bench: &Bench<'_>, options: &Options, path: &Path) -> Result<()> {
    let place = || path.display().to_string();
    let mut file = BufWriter::new(Output::begin(path, &[""; 0], Old::Goes)?);
    let names: Vec<&str> = specs().iter().map(|s| s.name.as_str()).collect();
    writeln!(file, "{}", json!({ "names": names })).with_context(place)?;
    let sizes = Detectable::committed();
    let effects = known().chain(unknown()).flat_map(|spec| {
        let draws = 0..options.draws;
        draws.flat_map(move |draw| TIMES.map(|times| (Some(spec), draw, times)))
    });
    let jobs: Vec<Job> =
        (0..2 * options.healthy).map(|draw| (None, draw, 0)).chain(effects).collect();
    let progress = Progress::counted("labelled flights", 0, jobs.len() as u64);
    let file = Mutex::new(file);
    jobs.par_iter().try_for_each(|job| -> Result<()> {
        let line = fly(bench, &sizes, *job)?;
        let mut file = file.lock().map_err(|_| anyhow!("{}: a writer failed", place()))?;
        writeln!(file, "{line}").with_context(place)?;
        progress.advance(1);
        Ok(())
    })?;
    progress.end();
    let file = file.into_inner().map_err(|_| anyhow!("{}: a writer failed", place()))?;
    let output = file.into_inner().map_err(|error| error.into_error()).with_context(place)?;
    Ok(output.finish()?)
}

fn fly(bench: &Bench<'_>, sizes: &Detectable, job: Job) -> Result<serde_json::Value> {
    let (spec, draw, times) = job;
    let mut deviations = Deviations::default();
    let (name, seed, size) = match spec {
        None => (format!("healthy-{draw}"), mixed(bench.seed ^ 0x4ea7, draw), 0.0),
        Some(spec) => {
            let number = spec.id[1..].parse::<u64>()?;
            let seed = mixed(bench.seed ^ 0xde7e_c701, 8 * draw + times) ^ number;
            let size = sizes.size(spec, times as f64);
            let mut noise = Noise::new(seed, spec.id);
            spec.apply(size, &mut noise, &hall(bench.scene), &mut deviations);
            (format!("{}-{draw}-{times}", spec.id), seed, size)
        }
    };
    let jitter = spec.is_none() && draw % 2 == 1;
    let seen = bench.fly(&name, seed, jitter, deviations)?;
    let seen = seen.as_ref();
    Ok(json!({
        "id": spec.map(|s| s.id),
        "draw": draw,
        "times": times,
        "size": size,
        "jitter": jitter,
        "landed": seen.is_some_and(|s| s.landed),
        "whole": seen.is_some_and(|s| s.whole),
        // JSON has no NaN: unknown is null.
        "statistics": seen.map(|s| &s.statistics),
    }))
}
