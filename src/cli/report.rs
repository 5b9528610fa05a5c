//! `haltere report`: a flight log as one page.

use std::fs::File;
use std::io::BufReader;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Args;

use super::print;
use crate::record::{LogEnd, LogReader};
use crate::report::{Page, from_log, truth};

/// Draws a flight log as a self-contained HTML page.
#[derive(Debug, Args)]
pub(super) struct Report {
    /// The log.
    log: PathBuf,
    /// Truth file of a simulated flight, from `haltere-sim serve --truth`.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Page to write; else beside the log, with its name.
    #[arg(long, short, value_name = "FILE")]
    output: Option<PathBuf>,
}

impl Report {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let log = LogReader::open(&self.log)?;
        let (mut flight, end) = from_log::read(&log);
        if let Some(path) = &self.truth {
            let name = || path.display().to_string();
            let file = File::open(path).with_context(name)?;
            flight.truth = truth::read(BufReader::new(file)).with_context(name)?;
            if let Some((from, to)) = flight.ends() {
                flight.truth.retain(|row| row.at >= from && row.at <= to);
            }
        }
        let name = self.log.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let subtitle = match end {
            LogEnd::Complete => name,
            other => format!("{name}, log {other}: shown up to its last complete record"),
        };
        let page = Page {
            title: "Flight",
            subtitle: &subtitle,
            checks: &[],
            errors: &[],
            paths: &[],
            flight: &flight,
        };
        let output = self.output.unwrap_or_else(|| self.log.with_extension("html"));
        std::fs::write(&output, page.render()).with_context(|| output.display().to_string())?;
        print(&format!("{}\n", output.display()));
        Ok(ExitCode::SUCCESS)
    }
}
