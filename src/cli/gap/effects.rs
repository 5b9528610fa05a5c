//! `haltere gap effects`: what the effects of the library are.

use std::fmt::Write as _;
use std::process::ExitCode;

use clap::Args;

use crate::cli::output::print;
use haltere_gap::advice::experiments::EXPERIMENTS;
use haltere_gap::bank::library::whole;
use haltere_model::effects::document;

/// Says what an effect is, what it shows as, its usual causes, what to do, what it is taken for and which flight or bench test
/// shows it. Without an id all effects are listed, those that the diagnosis chooses from with a star.
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
            out.push('\n');
        }
        print(&out)?;
        Ok(ExitCode::SUCCESS)
    }
}
