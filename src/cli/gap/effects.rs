//! `haltere gap effects`: what the effects of the library are.

use std::fmt::Write as _;
use std::process::ExitCode;

use clap::Args;

use crate::cli::output::print;
use haltere_gap::advice::experiments::EXPERIMENTS;
use haltere_gap::bank::library::whole;
use haltere_gap::bank::workshop::{default_folder, latest};
use haltere_gap::places::signature;
use haltere_model::effects::{Block, document};

/// Longest bar, and the sigma that make a mark of it.
const LONGEST: usize = 40;
const SIGMA_PER_MARK: f64 = 0.5;

/// Says what an effect is, what it shows as, its usual causes, what to do, what it is taken for and which flight or bench test
/// shows it, and, where a bank was flown on this computer, how loud it is in each block. Without an id all effects are listed, those that the diagnosis chooses from with a star.
#[derive(Debug, Args)]
pub struct Effects {
    /// Ids, as a verdict has them.
    #[arg(value_name = "ID")]
    ids: Vec<String>,
}

impl Effects {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let all = whole();
        let mut out = String::new();
        let bank = self.ids.first().and_then(|_| latest(&default_folder()));
        for spec in all.iter().filter(|_| self.ids.is_empty()) {
            let star = if spec.deviation().is_some_and(|of| of.standard) { "*" } else { " " };
            let _ = writeln!(out, "{:<4}{star} {:<13} {}", spec.id, spec.block.name(), spec.name);
        }
        for id in &self.ids {
            let Some(spec) = all.iter().find(|spec| spec.id.eq_ignore_ascii_case(id)) else {
                anyhow::bail!("{id}: no such effect; `haltere gap effects` lists them");
            };
            let _ = writeln!(out, "{}", document::section(spec).trim());
            let shows = |sets: &[&[&str]]| sets.iter().any(|set| set.contains(&spec.id));
            let tests: Vec<&str> =
                EXPERIMENTS.iter().filter(|e| shows(e.separates)).map(|e| e.id).collect();
            if !tests.is_empty() {
                let _ = writeln!(
                    out,
                    "\nTold from its neighbours by: {} (`haltere gap advise --list`).",
                    tests.join(", ")
                );
            }
            out.push_str(
                &bank.as_ref().map_or_else(String::new, |bank| bars(&signature(bank, spec.id))),
            );
            out.push('\n');
        }
        print(&out)?;
        Ok(ExitCode::SUCCESS)
    }
}

/// What an effect does to each block, as bars.
fn bars(signature: &[(Block, f64)]) -> String {
    let mut out = String::new();
    for (block, sigma) in signature {
        if out.is_empty() {
            out.push_str(
                "\nIn a flight of the bank with a middling size, sigma of healthy flights:\n\n",
            );
        }
        let marks = ((sigma / SIGMA_PER_MARK) as usize).min(LONGEST);
        let more = if marks == LONGEST { "+" } else { "" };
        let _ = writeln!(out, "{:<13} {sigma:>6.1} {}{more}", block.name(), "#".repeat(marks));
    }
    out
}
