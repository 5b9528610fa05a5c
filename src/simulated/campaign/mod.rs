//! Many flights over distributions of a scenario, in lockstep on all cores.
//!
//! A flight follows from the campaign's digest and its number alone: what is done is not flown again,
//! shards on other machines give the rows that one machine would give. docs/CAMPAIGNS.md.

pub mod draw;
pub mod entry;
pub mod file;
pub mod flight;
mod judge;
pub mod merge;
mod operator;
mod page;
pub mod plan;
pub mod row;
pub mod store;
pub mod table;
mod takeoff;

use std::any::Any;
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::PoisonError;

use anyhow::{Context, Result, bail};
use rayon::prelude::*;

use file::Campaign;
use haltere_log::written;
use row::{Outcome, Row};
use store::{Identity, Store, write_whole};

use crate::progress::Progress;

/// How a campaign is run.
#[derive(Debug, Clone, clap::Args)]
pub struct Run {
    /// Folder of the results; flights that are there already are not flown again.
    #[arg(long, value_name = "DIR", default_value = "campaign")]
    pub out: PathBuf,
    /// Fly only share I of N, for instance one of the machines of a job array.
    #[arg(long, visible_alias = "part", value_name = "I/N", default_value = "1/1", value_parser = shard)]
    pub shard: Shard,
    /// Flights at a time; 0: as many as there are cores.
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub jobs: usize,
    /// Seed of the campaign; wins over the file.
    #[arg(long, value_name = "N")]
    pub seed: Option<u64>,
    /// Fly this flight alone again and keep its log; nothing is written into the folder.
    #[arg(long, value_name = "INDEX", requires = "log")]
    pub fly: Option<u64>,
    /// The log of that flight; its truth goes beside it.
    #[arg(long, value_name = "FILE", requires = "fly")]
    pub log: Option<PathBuf>,
}

/// A share of a campaign.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard(pub [u64; 2]);

fn shard(text: &str) -> Result<Shard, String> {
    let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
    match parts {
        Some((i, n)) if (1..=n).contains(&i) && n <= 100_000 => Ok(Shard([i, n])),
        _ => Err("write I/N with I from 1 to N, N up to 100000".to_owned()),
    }
}

/// The page.
pub const SUMMARY: &str = "summary.html";
const RESULTS: &str = "results.parquet";
/// What is written into the folder.
pub const WRITTEN: [&str; 4] = [SUMMARY, RESULTS, store::IDENTITY, store::ROWS];

/// Flies one flight again, if that was asked for, and keeps its log.
pub fn again_alone(campaign: &Campaign, run: &Run, inputs: &[&Path]) -> Result<Option<Row>> {
    let (Some(index), Some(log)) = (run.fly, &run.log) else { return Ok(None) };
    if index >= campaign.flights {
        bail!("--fly {index}: the campaign has flights 0 to {}", campaign.flights - 1);
    }
    written::look_for_log(log, inputs).context("--log")?;
    flight::fly(&campaign.plan(index)?, Some(&flight::Keep { log })).map(Some)
}

/// Numbers of the flights of a share.
fn selection(
    flights: u64,
    [shard, of]: [u64; 2],
    sample: Option<&[u64]>,
) -> Box<dyn Iterator<Item = u64> + '_> {
    let ours = move |i: &u64| i % of == shard - 1;
    match sample {
        Some(sample) => Box::new(sample.iter().copied().filter(ours)),
        None => Box::new((0..flights).filter(ours)),
    }
}

/// Flies what is not flown yet. `sample`: only these.
pub fn fly_all(
    campaign: &Campaign,
    run: &Run,
    sample: Option<&[u64]>,
) -> Result<(Identity, BTreeMap<u64, Row>)> {
    let identity = Identity::new(campaign, run.shard.0, sample.is_some());
    let wanted: Vec<u64> = selection(campaign.flights, run.shard.0, sample).collect();
    if wanted.is_empty() {
        bail!(
            "shard {}/{} of {} flights is empty",
            run.shard.0[0],
            run.shard.0[1],
            campaign.flights
        );
    }
    // A value that no flight can be flown with is told before the first one.
    wanted.par_iter().try_for_each(|i| campaign.plan(*i).map(|_| ()))?;
    let (store, found) = Store::open(&run.out, &identity)?;
    if found.torn > 0 {
        eprintln!("{}: {} torn rows, flown again", run.out.display(), found.torn);
    }
    let mut rows = found.rows;
    rows.retain(|i, _| wanted.binary_search(i).is_ok());
    let due: Vec<u64> = wanted.iter().copied().filter(|i| !rows.contains_key(i)).collect();
    let progress = Progress::counted("flights", rows.len() as u64, due.len() as u64);
    let store = Mutex::new(store);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(run.jobs).build()?;
    let flown: Vec<Row> = pool.install(|| {
        due.par_iter()
            .map(|index| {
                let row = fly_caught(campaign, *index)?;
                store.lock().unwrap_or_else(PoisonError::into_inner).add(&row)?;
                progress.advance(1);
                Ok(row)
            })
            .collect::<Result<_>>()
    })?;
    progress.end();
    rows.extend(flown.into_iter().map(|row| (row.index, row)));
    drop(store);
    // In order: the same flights give the same file, whoever flew them when.
    store::write_rows(&run.out, rows.values())?;
    Ok((identity, rows))
}

/// A panic ends its flight and not the campaign.
fn fly_caught(campaign: &Campaign, index: u64) -> Result<Row> {
    let plan = campaign.plan(index)?;
    caught(&plan, |plan| flight::fly(plan, None)).with_context(|| format!("flight {index}"))
}

fn caught(plan: &plan::Plan, fly: impl FnOnce(&plan::Plan) -> Result<Row>) -> Result<Row> {
    match catch_unwind(AssertUnwindSafe(|| fly(plan))) {
        Ok(row) => row,
        Err(panic) => {
            Ok(Row::panicked(plan.index, plan.seed, plan.drawn.clone(), words(panic.as_ref())))
        }
    }
}

fn words(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "panic".to_owned())
}

/// The table and the page.
pub fn write_results(out: &Path, identity: &Identity, rows: &[&Row], again: &str) -> Result<()> {
    table::write(&out.join(RESULTS), identity, rows)?;
    write_whole(&out.join(SUMMARY), page::render(identity, rows, again).as_bytes())
}

/// How many flights came to what.
pub fn outcomes(rows: &[&Row]) -> String {
    let mut text = format!("{} flights\n", rows.len());
    for outcome in Outcome::ALL {
        let count = rows.iter().filter(|r| r.outcome == outcome).count();
        text += &format!("{count:8} {}\n", outcome.name());
    }
    text
}

#[cfg(test)]
mod tests;
