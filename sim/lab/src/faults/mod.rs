//! `haltere-lab faults`: every fault of the catalogue in every part of a flight, as a table.

mod catalogue;
mod tables;

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use haltere::cli::{print, print_json};
use haltere::simulated::campaign::entry::Reaction;
use haltere::simulated::campaign::file::Campaign;
use haltere::simulated::campaign::row::Row;
use haltere::simulated::campaign::store::write_whole;
use haltere::simulated::campaign::{Run, again_alone, fly_all, outcomes, write_results};
use haltere_log::written;

use tables::Report;

/// `haltere-lab faults`
#[derive(Debug, clap::Args)]
pub struct Options {
    #[command(flatten)]
    run: Run,
    /// Write the table there, as docs/FAULTS.md. The same by fault stands in the folder of the results as faults.json.
    #[arg(long, value_name = "FILE")]
    doc: Option<PathBuf>,
    /// Only a fixed share: every fault in this many of the parts of a flight, every part equally often.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..=7))]
    sample: Option<u64>,
    /// Only faults of these names or groups, or whose name holds this: `replayed_ranging`, `"servos limp"`. Every
    /// part of the flight and every repetition, or the share that --sample leaves.
    #[arg(long, value_name = "NAME", num_args = 1..)]
    only: Vec<String>,
    /// Exit code 1 only where a fault is not safe that was safe in all flights of this earlier result (a
    /// faults.json; the kept one is sim/lab/FAULTS.json), or a flight panics. A fault that it does not know is new, and judged by the
    /// bounds alone.
    #[arg(long, value_name = "FILE")]
    against: Option<PathBuf>,
    /// Print the catalogue; nothing is flown.
    #[arg(long)]
    list: bool,
    /// Print the table as JSON.
    #[arg(long)]
    json: bool,
}

/// The committed campaign: hall, mission, fence, repetitions.
const CAMPAIGN: &str = include_str!("campaign.toml");

/// Flies and reports. `false`: the target is missed.
pub fn run(options: &Options) -> Result<bool> {
    if options.list {
        print(&list())?;
        return Ok(true);
    }
    let run = &options.run;
    let seed = run.seed.map_or(String::new(), |seed| format!(" --seed {seed}"));
    let again = format!("haltere-lab faults{seed}");
    let campaign = Campaign::parse(CAMPAIGN, Path::new("."), run.seed, "faults", catalogue::all())?;
    if let Some(doc) = &options.doc {
        let inputs: Vec<&PathBuf> = options.against.iter().collect();
        written::look(doc, &inputs).context("--doc")?;
    }
    if let Some(row) = again_alone(&campaign, run, &[])? {
        print_json(&row)?;
        return Ok(true);
    }
    let sample = selected(&campaign, options)?;
    if sample.is_some() && run.shard.0 != [1, 1] {
        bail!("--sample, --only: it is small, and flown in one piece: leave --shard out");
    }
    let (identity, rows) = fly_all(&campaign, run, sample.as_deref())?;
    let rows: Vec<&Row> = rows.values().collect();
    write_results(&run.out, &identity, &rows, &again)?;
    let report = Report { campaign: &campaign, identity: &identity, rows: &rows, again: &again };
    let json = serde_json::to_string_pretty(&report.json())? + "\n";
    if let Some(doc) = &options.doc {
        write_whole(doc, report.markdown().as_bytes())?;
    }
    write_whole(&run.out.join("faults.json"), json.as_bytes())?;
    if options.json {
        print(&json)?;
    } else {
        print(&outcomes(&rows))?;
        print(&report.table(|entry| &entry.name))?;
        print(&(report.failures(true) + &report.failures(false)))?;
    }
    let Some(earlier) = &options.against else { return Ok(report.target_is_met()) };
    let text = std::fs::read_to_string(earlier).with_context(|| earlier.display().to_string())?;
    let earlier = serde_json::from_str(&text).with_context(|| earlier.display().to_string())?;
    let new = report.new_since(&earlier);
    if !new.is_empty() {
        eprintln!("new, judged by the bounds: {}", new.join("; "));
    }
    let worse = report.worse_than(&earlier);
    worse.iter().for_each(|line| eprintln!("{line}"));
    Ok(worse.is_empty())
}

/// The flights that --sample and --only leave; `None`: all.
fn selected(campaign: &Campaign, options: &Options) -> Result<Option<Vec<u64>>> {
    if options.only.is_empty() {
        return Ok(options.sample.map(|n| sample(campaign, n)));
    }
    for word in &options.only {
        if !campaign.faults.iter().any(|entry| entry.is_named(word)) {
            bail!("--only {word}: no fault and no group of that name; --list prints them");
        }
    }
    let wanted = |i: &u64| {
        let place = campaign.fault_place(*i);
        let entry = place.and_then(|(fault, _, _)| campaign.faults.get(fault));
        entry.is_some_and(|entry| options.only.iter().any(|word| entry.is_named(word)))
    };
    let all: Vec<u64> = match options.sample {
        Some(n) => sample(campaign, n),
        None => (0..campaign.flights).collect(),
    };
    Ok(Some(all.into_iter().filter(wanted).collect()))
}

/// Every fault in `n` phases; over the faults each phase comes equally often. Of the first repetition.
fn sample(campaign: &Campaign, n: u64) -> Vec<u64> {
    let (faults, phases) = (campaign.faults.len() as u64, campaign.phases.len() as u64);
    let mut list: Vec<u64> = (0..faults)
        .flat_map(|fault| {
            let step = (phases / n.min(phases)).max(1);
            (0..n.min(phases)).map(move |k| fault + faults * ((fault + k * step) % phases))
        })
        .collect();
    list.sort_unstable();
    list.dedup();
    list
}

fn list() -> String {
    let mut text = String::new();
    for entry in catalogue::all() {
        let reaction = match entry.reaction {
            Reaction::Exists(what) => format!("reaction: {what}"),
            Reaction::None(why) => format!("no reaction: {why}"),
        };
        let _ = writeln!(text, "{:12} {:44} {reaction}", entry.group, entry.name);
    }
    text
}

#[cfg(test)]
mod tests;
