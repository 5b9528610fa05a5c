//! `haltere-sim campaign`: many flights over distributions of a scenario, in lockstep on all cores.
//!
//! A flight follows from the campaign's digest and its number alone: what is done is not flown again,
//! shards on other machines give the rows that one machine would give. docs/CAMPAIGNS.md.

mod catalogue;
pub(crate) mod draw;
mod fault_report;
mod fault_tables;
pub(crate) mod file;
pub(crate) mod flight;
mod judge;
mod merge;
mod operator;
mod page;
pub(crate) mod plan;
pub(crate) mod row;
mod store;
mod table;
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
use haltere::cli::{print, print_json};
use haltere::progress::Progress;
use haltere_log::written;
use row::{Outcome, Row};
use store::{Identity, Store, write_whole};

/// `haltere-sim campaign`
#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Options {
    #[command(subcommand)]
    command: Option<Command>,
    /// Campaign file, or the name of a built-in one (`haltere-sim print campaign`).
    #[arg(required = true, value_name = "FILE")]
    file: Option<PathBuf>,
    #[command(flatten)]
    run: Run,
}

#[derive(Debug, clap::Subcommand)]
enum Command {
    /// Put the shards of a campaign together.
    Merge(merge::Options),
    /// Every fault of the catalogue in every part of a flight; writes docs/FAULTS.md's table. Exit code 1
    /// when a flight leaves the fence, or leaves the floor again or crashes where a reaction exists.
    Faults(fault_report::Options),
}

/// How a campaign is run.
#[derive(Debug, Clone, clap::Args)]
pub struct Run {
    /// Folder of the results; flights that are there already are not flown again.
    #[arg(long, value_name = "DIR", default_value = "campaign")]
    pub out: PathBuf,
    /// Fly only share I of N, for instance one of the machines of a job array.
    #[arg(long, value_name = "I/N", default_value = "1/1", value_parser = shard)]
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
pub struct Shard([u64; 2]);

fn shard(text: &str) -> Result<Shard, String> {
    let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
    match parts {
        Some((i, n)) if (1..=n).contains(&i) && n <= 100_000 => Ok(Shard([i, n])),
        _ => Err("write I/N with I from 1 to N, N up to 100000".to_owned()),
    }
}

/// Runs the command. `false`: a bound is broken or a flight panicked.
pub fn run(options: &Options) -> Result<bool> {
    match &options.command {
        Some(Command::Merge(options)) => merge::run(options).map(|()| true),
        Some(Command::Faults(options)) => fault_report::run(options),
        None => {
            let path = options.file.as_deref().context("no campaign file")?;
            let campaign = Campaign::load(path, options.run.seed)?;
            let seed = options.run.seed.map_or(String::new(), |seed| format!(" --seed {seed}"));
            let again = format!("haltere-sim campaign {}{seed}", campaign.source);
            written::look_all(&options.run.out, &WRITTEN, &[path]).context("--out")?;
            if again_alone(&campaign, &options.run, &[path])? {
                return Ok(true);
            }
            let (identity, rows) = fly_all(&campaign, &options.run, None)?;
            let rows: Vec<&Row> = rows.values().collect();
            write_results(&options.run.out, &identity, &rows, &again)?;
            print_outcomes(&rows)?;
            print(&format!("{}\n", options.run.out.join(SUMMARY).display()))?;
            Ok(rows.iter().all(|r| r.outcome != Outcome::Panicked))
        }
    }
}

const SUMMARY: &str = "summary.html";
const RESULTS: &str = "results.parquet";
/// What is written into the folder.
const WRITTEN: [&str; 4] = [SUMMARY, RESULTS, store::IDENTITY, store::ROWS];

/// Flies one flight again, if that was asked for, and keeps its log.
fn again_alone(campaign: &Campaign, run: &Run, inputs: &[&Path]) -> Result<bool> {
    let (Some(index), Some(log)) = (run.fly, &run.log) else { return Ok(false) };
    if index >= campaign.flights {
        bail!("--fly {index}: the campaign has flights 0 to {}", campaign.flights - 1);
    }
    written::look_for_log(log, inputs).context("--log")?;
    let row = flight::fly(&campaign.plan(index)?, Some(&flight::Keep { log }))?;
    print_json(&row)?;
    Ok(true)
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
fn fly_all(
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
fn write_results(out: &Path, identity: &Identity, rows: &[&Row], again: &str) -> Result<()> {
    table::write(&out.join(RESULTS), identity, rows)?;
    write_whole(&out.join(SUMMARY), page::render(identity, rows, again).as_bytes())
}

fn print_outcomes(rows: &[&Row]) -> Result<()> {
    let mut text = format!("{} flights\n", rows.len());
    for outcome in Outcome::ALL {
        let count = rows.iter().filter(|r| r.outcome == outcome).count();
        text += &format!("{count:8} {}\n", outcome.name());
    }
    print(&text)
}

#[cfg(test)]
mod tests;
