//! `haltere-lab advise`: what the advice of `haltere gap advise` is worth.

use std::process::ExitCode;

use clap::Args;
use haltere::cli::{print, print_json};
use haltere::progress::Progress;
use haltere_gap::scene::Scene;

use crate::trial;

/// Measures the advice itself on simulated ambiguous cases: how often the right effect is named after the
/// recommended flight, and after one chosen by chance.
#[derive(Debug, Args)]
pub struct Advise {
    /// Cases.
    #[arg(long, value_name = "N")]
    check: usize,
    /// Prints as JSON.
    #[arg(long)]
    json: bool,
}

impl Advise {
    /// Flies the cases and prints what came of them.
    pub fn run(self) -> anyhow::Result<ExitCode> {
        let progress = Progress::new("cases");
        let scene = Scene::lab().map_err(anyhow::Error::new)?;
        let result = trial::run(&scene, self.check, |done, of| progress.at(done, of));
        if self.json {
            print_json(&result)?;
        } else {
            print(&result.table())?;
        }
        Ok(ExitCode::SUCCESS)
    }
}
