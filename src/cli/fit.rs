//! `haltere fit`: identification from flight logs.

use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Subcommand;

use super::{print, print_json};
use crate::config::Config;
use crate::fit::trim;
use crate::record::LogReader;
use crate::report::from_log;

/// Numbers of the vehicle from flight logs.
#[derive(Debug, Subcommand)]
pub(super) enum Fit {
    /// Trims of roll, pitch and yaw from a hover of half a minute.
    Trim {
        /// Flight log.
        log: PathBuf,
        /// Print as JSON.
        #[arg(long)]
        json: bool,
    },
}

impl Fit {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        match self {
            Fit::Trim { log, json } => {
                let name = log.display().to_string();
                let reader = LogReader::open(&log)?;
                // The drag law that was flown with: it takes the lean of a drift off.
                let config =
                    Config::from_toml("configuration in the log", &reader.session().config_toml)?;
                let (flight, _) = from_log::read(&reader);
                let trims = trim::fit(&flight, &config.control.drag).context(name)?;
                if json {
                    print_json(&trims)?;
                    return Ok(ExitCode::SUCCESS);
                }
                print(&format!(
                    "# from {:.0} s of hover in {} blocks; one sigma {:.2}, {:.2}, {:.2} deg\n\
                     [control.trims]\nroll_deg = {:.2}\npitch_deg = {:.2}\nyaw_deg = {:.2}\n",
                    trims.hover_s,
                    trims.blocks,
                    trims.roll.std_deg,
                    trims.pitch.std_deg,
                    trims.yaw.std_deg,
                    trims.roll.value_deg,
                    trims.pitch.value_deg,
                    trims.yaw.value_deg,
                ));
            }
        }
        Ok(ExitCode::SUCCESS)
    }
}
