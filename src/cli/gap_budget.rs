//! `haltere gap budget`: what of a gap each constant of the vehicle file is, without accepted flights.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Instant;

use clap::Args;

use super::gap::SceneOptions;
use super::gap_references::of_one_mission;
use super::{print, print_json};
use crate::progress::Progress;
use crate::report::gap::budget::{self as page, number};
use haltere_gap::commission::budget::{Budget, budget};
use haltere_gap::outcome::Outcome;
use haltere_log::written;

/// Says which constants of the vehicle file differ from the vehicle, what share of the gap each closes, and what is left. Needs no
/// accepted flights.
///
/// Each constant has a 90 % interval and those that explain the flights as well in its place. With three flights or more every third is
/// held out, and shares are told on those. Configuration and survey are those that were flown: they are in the log.
///
/// Exit codes: 0 no gap, 15 a budget, 20 not testable.
#[derive(Debug, Args)]
pub(super) struct BudgetCommand {
    /// Flights of one mission: logs, or folders of logs.
    #[arg(required = true, value_name = "LOG|FOLDER")]
    logs: Vec<PathBuf>,
    #[command(flatten)]
    told: SceneOptions,
    /// Writes the budget as one HTML page.
    #[arg(long, value_name = "FILE.html")]
    out: Option<PathBuf>,
    /// Prints as JSON.
    #[arg(long)]
    json: bool,
}

impl BudgetCommand {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let inputs: Vec<&PathBuf> =
            self.told.vehicle_file().into_iter().chain(&self.logs).collect();
        if let Some(out) = &self.out {
            written::look(out, &inputs)?;
        }
        let told = self.told.told()?;
        let flights = of_one_mission(&self.logs)?;
        let Some(first) = flights.first() else {
            anyhow::bail!("no flight that can be judged lies there");
        };
        let scene = first.scene(&told).for_bank(&first.mission);
        let started = Instant::now();
        let progress = Progress::new("budget");
        let all: Vec<_> = flights.iter().collect();
        let found = budget(&scene, &first.mission, &all, |done, of| progress.at(done, of));
        let seconds = started.elapsed().as_secs_f64();
        let found = match found {
            Ok(found) => found,
            Err(why) => {
                let outcome = Outcome::NotTestable { why: why.to_string() };
                if self.json {
                    print_json(&outcome)?;
                } else {
                    print(&format!("VERDICT     {}\n", outcome.sentence(str::to_owned)))?;
                }
                return Ok(ExitCode::from(outcome.exit_code()));
            }
        };
        if let Some(out) = &self.out {
            let names = flights.iter().map(|flown| flown.path.display().to_string());
            written::write(out, page::render(&found, &names.collect::<Vec<_>>()), &inputs)?;
        }
        if self.json {
            print_json(&found)?;
        } else {
            print(&text(&found, seconds))?;
        }
        Ok(ExitCode::from(found.exit_code()))
    }
}

fn text(found: &Budget, seconds: f64) -> String {
    let mut out = String::new();
    let flights = found.flights + found.held_out;
    let _ = writeln!(
        out,
        "BUDGET      {flights} flight{} beside the vehicle file, {} simulated ones, {seconds:.0} s",
        if flights == 1 { "" } else { "s" },
        found.simulated
    );
    let _ = writeln!(out, "VERDICT     {}", found.words());
    out.push_str(&parts(found));
    out
}

/// What differs, and what is left.
pub(super) fn parts(found: &Budget) -> String {
    let mut out = String::new();
    for part in &found.parts {
        let _ = writeln!(
            out,
            "PART        {} = {}, found {} (90 %: {} to {}){}",
            part.key,
            number(part.file),
            number(part.value),
            number(part.low),
            number(part.high),
            part.or_words()
        );
        if let (Some(share), Some(left)) = (part.share, part.left_after) {
            let _ = writeln!(
                out,
                "              alone it closes {share:.2} of the gap; {left:.2} is left after it and those above"
            );
        }
    }
    if let Some(left) = found.left {
        let _ = writeln!(out, "LEFT        {left:.2} of the gap; {}", found.told_on());
    }
    for block in &found.blocks {
        let _ = writeln!(
            out,
            "            {:<14} {:>7.2} to {:>6.2} squared sigma",
            block.block, block.before, block.left
        );
    }
    out
}
