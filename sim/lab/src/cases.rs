//! `haltere-lab cases DIR`: writes the sealed suite that the diagnosis is scored on.
//!
//! ```text
//! DIR/cases.json           ids, logs, missions and the SHA-256 of every key: no class, no effect
//! DIR/logs/ID-MISSION.mcap flight logs as the companion writes them
//! DIR/key/ID.json          the key; only the scorer opens it
//! ```
//! Everything follows from the seed of the suite. What is there already is not flown again.

pub mod detectable;
mod flight;
pub mod list;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, anyhow};
use haltere::progress::Progress;
use haltere::taped::Outcome;
use haltere_gap::flight::seal;
use haltere_gap::scene::Scene;
use haltere_log::written;
use rayon::prelude::*;
use serde_json::json;

use list::{Case, Class, Mission, suite};

/// Seed of the committed suite.
const SUITE_SEED: u64 = 20_261_123;
/// Name of the generator; changes with its physics.
const GENERATOR: &str = "foreign-2";

/// What to write.
#[derive(Debug, clap::Args)]
pub struct Options {
    /// Where to.
    directory: PathBuf,
    /// Only the fixed tenth of every class, and the public flights.
    #[arg(long)]
    tenth: bool,
    /// Only this class; may be given more than once.
    #[arg(long, value_enum)]
    only: Vec<Class>,
    /// Seed of the suite.
    #[arg(long, default_value_t = SUITE_SEED)]
    seed: u64,
    /// Key and list only; nothing is flown.
    #[arg(long)]
    list: bool,
}

fn log_name(case: &Case, mission: Mission) -> String {
    format!("logs/{}-{}.mcap", case.key.id, mission.name())
}

/// Writes the suite. Always `true`: a flight that ends badly is part of it.
pub fn run(options: &Options) -> Result<bool> {
    let scene = Scene::lab().map_err(|problems| anyhow!("{problems}"))?;
    let cases = suite(&scene, options.seed);
    let selected: Vec<&Case> = cases
        .iter()
        .filter(|c| !options.tenth || c.key.tenth)
        .filter(|c| options.only.is_empty() || options.only.contains(&c.key.class))
        .collect();
    let directory = &options.directory;
    for folder in ["logs", "key"] {
        let path = directory.join(folder);
        std::fs::create_dir_all(&path).with_context(|| path.display().to_string())?;
    }
    let listed = write_list(directory, options.seed, &cases, &selected)?;
    if options.list {
        println!("{listed}");
        return Ok(true);
    }
    let flights: Vec<(&Case, Mission, PathBuf)> = selected
        .iter()
        .flat_map(|case| case.missions.iter().map(|mission| (*case, *mission)))
        .map(|(case, mission)| (case, mission, directory.join(log_name(case, mission))))
        .collect();
    let total = flights.len();
    let due: Vec<_> = flights.into_iter().filter(|(_, _, path)| !path.exists()).collect();
    let progress = Progress::counted("flights", (total - due.len()) as u64, due.len() as u64);
    let outcomes: Vec<Outcome> = due
        .par_iter()
        .map(|(case, mission, path)| {
            let outcome = flight::record(&scene, case.setup(&scene, *mission), *mission, path)
                .with_context(|| path.display().to_string())?;
            progress.advance(1);
            Ok(outcome)
        })
        .collect::<Result<_>>()?;
    progress.end();
    let bytes: u64 = outcomes.iter().map(|o| o.bytes).sum();
    println!(
        "{}",
        json!({
            "directory": directory,
            "cases": selected.len(),
            "flights_before": total - due.len(),
            "flights_now": due.len(),
            "not_landed": due
                .iter()
                .zip(&outcomes)
                .filter(|(_, o)| !o.landed)
                .map(|((case, mission, _), _)| log_name(case, *mission))
                .collect::<Vec<_>>(),
            "landed": outcomes.iter().filter(|o| o.landed).count(),
            "flown_s": outcomes.iter().map(|o| o.flown_s).sum::<f64>().round(),
            "megabytes": (bytes as f64 * 1e-6).round(),
            "seconds": progress.seconds().round(),
        })
    );
    Ok(true)
}

/// Writes keys and list; returns the digest over all keys.
fn write_list(
    directory: &Path,
    suite_seed: u64,
    all: &[Case],
    selected: &[&Case],
) -> Result<String> {
    let mut sealed = Vec::new();
    let (mut commissioning, mut calibration) = (Vec::new(), Vec::new());
    let digest = digest(all)?;
    for case in all {
        let key = &case.key;
        let first = directory.join(log_name(case, case.missions[0]));
        if !first.exists() && !selected.iter().any(|c| c.key.id == key.id) {
            continue;
        }
        let text = key_text(case)?;
        let logs = |m: Mission| log_name(case, m);
        match key.class {
            Class::Commissioning | Class::Calibration => {
                let row = json!({
                    "id": key.id,
                    "diagnostic": logs(Mission::Diagnostic),
                    "held_out": logs(Mission::HeldOut),
                    "plain": logs(Mission::Plain),
                    "jitter": key.jitter,
                });
                let list = match key.class {
                    Class::Commissioning => &mut commissioning,
                    _ => &mut calibration,
                };
                list.push(row);
            }
            _ => {
                written::write(
                    &directory.join("key").join(format!("{}.json", key.id)),
                    &text,
                    &[""; 0],
                )?;
                sealed.push(json!({
                    "id": key.id,
                    "mission": key.mission,
                    "log": logs(key.mission),
                    "held_out_log": logs(Mission::HeldOut),
                    "tenth": key.tenth,
                    "lockbox": key.lockbox,
                    "key_sha256": seal::digest(text.as_bytes()),
                }));
            }
        }
    }
    let list = json!({
        "format": 1,
        "generator": GENERATOR,
        "suite_seed": suite_seed,
        "all_keys_sha256": digest,
        "cases": sealed,
        "commissioning": commissioning,
        "calibration": calibration,
    });
    let list = serde_json::to_string_pretty(&list)? + "\n";
    written::write(&directory.join("cases.json"), list, &[""; 0])?;
    Ok(digest)
}

fn key_text(case: &Case) -> Result<String> {
    Ok(serde_json::to_string_pretty(&case.key)? + "\n")
}

/// SHA-256 over the SHA-256 of every key of the sealed cases, in the order of their ids.
fn digest(all: &[Case]) -> Result<String> {
    let mut lines = String::new();
    for case in all.iter().filter(|c| c.key.id.starts_with("case-")) {
        lines += &seal::digest(key_text(case)?.as_bytes());
        lines.push('\n');
    }
    Ok(seal::digest(lines.as_bytes()))
}

#[cfg(test)]
mod tests;
