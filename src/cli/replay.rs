//! `haltere replay`: flight logs, or flights in the UTIL layout.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::{FAILED, print, print_json};
use crate::{replay, util_flights};

/// Exit codes: 0 reproduced; 1 a log cannot be replayed; 3 outputs differ (--util: a flight
/// diverged); 4 the log has a hole or no outputs, so that not all could be checked.
#[derive(Debug, Args)]
#[command(after_help = "Exit codes: 0 reproduced; 1 a log cannot be replayed; 3 outputs differ \
                        (--util: a flight diverged); 4 not everything could be checked.")]
pub(super) struct Replay {
    /// Flight logs.
    #[arg(required_unless_present = "util", conflicts_with = "util")]
    log: Vec<PathBuf>,
    /// Run the estimator on the flights of this folder, against motion capture.
    #[arg(long, value_name = "DIR")]
    util: Option<PathBuf>,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

/// Some flight of `--util` diverged.
const DIVERGED: u8 = 3;

impl Replay {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        if let Some(folder) = &self.util {
            return self.run_util(folder);
        }
        let mut worst = 0;
        let mut reports = Vec::new();
        for log in &self.log {
            match replay::replay(log) {
                Ok(report) => {
                    worst = worst.max(report.exit_code());
                    if !self.json {
                        print(&report.to_string());
                    }
                    reports.push(report);
                }
                Err(error) => {
                    tracing::error!("{error}");
                    worst = worst.max(FAILED);
                }
            }
        }
        if self.json {
            print_json(&reports)?;
        }
        Ok(ExitCode::from(worst))
    }

    fn run_util(&self, folder: &std::path::Path) -> anyhow::Result<ExitCode> {
        let reports = util_flights::run(folder, &util_flights::util_profile())?;
        if self.json {
            print_json(&reports)?;
        } else {
            let mut table = String::new();
            util_flights::print_table(&mut table, &reports)?;
            print(&table);
        }
        let diverged = reports.iter().any(|report| report.diverged);
        Ok(ExitCode::from(if diverged { DIVERGED } else { 0 }))
    }
}
