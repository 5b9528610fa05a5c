//! `haltere-sim campaign`: many flights over distributions of a scenario (docs/CAMPAIGNS.md).

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use haltere::cli::{print, print_json};
use haltere::simulated::campaign::file::Campaign;
use haltere::simulated::campaign::merge::merge;
use haltere::simulated::campaign::row::{Outcome, Row};
use haltere::simulated::campaign::{
    Run, SUMMARY, WRITTEN, again_alone, fly_all, outcomes, write_results,
};
use haltere_log::written;

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
    Merge(Merge),
}

/// `haltere-sim campaign merge`
#[derive(Debug, clap::Args)]
struct Merge {
    /// Folders of all shards, in any order.
    #[arg(required = true)]
    shards: Vec<PathBuf>,
    /// Where the whole goes: a new folder.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Runs the command. `false`: a flight panicked.
pub fn run(options: &Options) -> Result<bool> {
    if let Some(Command::Merge(Merge { shards, out })) = &options.command {
        print(&format!("{}{}\n", merge(shards, out)?, out.display()))?;
        return Ok(true);
    }
    let path: &Path = options.file.as_deref().context("no campaign file")?;
    let run = &options.run;
    let campaign = Campaign::load(path, run.seed)?;
    let seed = run.seed.map_or(String::new(), |seed| format!(" --seed {seed}"));
    let again = format!("haltere-sim campaign {}{seed}", campaign.source);
    written::look_all(&run.out, &WRITTEN, &[path]).context("--out")?;
    if let Some(row) = again_alone(&campaign, run, &[path])? {
        print_json(&row)?;
        return Ok(true);
    }
    let (identity, rows) = fly_all(&campaign, run, None)?;
    let rows: Vec<&Row> = rows.values().collect();
    write_results(&run.out, &identity, &rows, &again)?;
    print(&format!("{}{}\n", outcomes(&rows), run.out.join(SUMMARY).display()))?;
    Ok(rows.iter().all(|r| r.outcome != Outcome::Panicked))
}
