//! `haltere check`: what would spoil a flight, and the way out.

use std::process::ExitCode;

use clap::Args;
use serde::Serialize;

use super::fly::Configuration;
use super::output::{FAILED, print, print_json};
use super::style::Style;
use crate::preflight::{self, Finding, Status};

/// Only warnings were found.
const WARNINGS: u8 = 3;
/// Longest live measurement, s.
const LONGEST_LIVE_S: f64 = 600.0;

/// Examines configuration, survey, ports, system and disk. Nothing is moved.
#[derive(Debug, Args)]
#[command(after_help = "Exit codes: 0 all is well; 1 something must be put right; 2 wrong usage; \
                        3 warnings only.")]
pub(super) struct Check {
    #[command(flatten)]
    configuration: Configuration,
    /// Run links and filter for so many seconds and measure what tag and board really send. The board
    /// is asked for its streams, and never armed.
    #[arg(long, value_name = "SECONDS", num_args = 0..=1, default_missing_value = "5")]
    live: Option<f64>,
    /// Print the resolved configuration as TOML, and look no further.
    #[arg(long)]
    resolved: bool,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Serialize)]
struct Report<'a> {
    ok: bool,
    problems: usize,
    warnings: usize,
    findings: &'a [Finding],
}

impl Check {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        if self.live.is_some_and(|s| !(s > 0.0 && s <= LONGEST_LIVE_S)) {
            anyhow::bail!("--live: above 0 and up to {LONGEST_LIVE_S} s");
        }
        let findings = match self.configuration.read() {
            Err(problems) => problems
                .lines()
                .iter()
                .map(|line| {
                    let way_out = "change it as told; docs/CONFIGURATION.md has every key";
                    Finding::problem("configuration", line, way_out)
                })
                .collect(),
            Ok(loaded) if self.resolved => {
                if self.json {
                    print_json(&loaded.config)?;
                } else {
                    print(&loaded.config.to_toml())?;
                }
                return Ok(ExitCode::SUCCESS);
            }
            Ok(loaded) => {
                let mut findings = preflight::examine(&loaded);
                match self.live {
                    Some(seconds) => {
                        tracing::info!("listening to tag and board for {seconds} s");
                        findings.extend(preflight::rates::examine(&loaded, seconds));
                    }
                    None => findings.push(Finding::not_checked(
                        "tag and board",
                        "what they really send was not measured",
                        "haltere check --live",
                    )),
                }
                findings
            }
        };
        let count = |status| findings.iter().filter(|f| f.status == status).count();
        let (problems, warnings) = (count(Status::Problem), count(Status::Warning));
        if self.json {
            let ok = problems == 0 && warnings == 0;
            print_json(&Report { ok, problems, warnings, findings: &findings })?;
        } else {
            print(&table(&findings, Style::of_stdout()))?;
            let worth = format!("{warnings} worth a look");
            print(&match (problems, warnings) {
                (0, 0) => "everything is in order\n".to_owned(),
                (0, _) => format!("{worth}; it can fly like this\n"),
                (n, _) => format!("{n} to put right, {worth}\n"),
            })?;
        }
        Ok(match preflight::worst(&findings) {
            Status::Problem => ExitCode::from(FAILED),
            Status::Warning => ExitCode::from(WARNINGS),
            Status::Ok | Status::NotChecked => ExitCode::SUCCESS,
        })
    }
}

fn table(findings: &[Finding], style: Style) -> String {
    let width = findings.iter().map(|f| f.what.chars().count()).max().unwrap_or(0);
    let mut text = String::new();
    for finding in findings {
        let word = match finding.status {
            Status::Ok => style.good("ok  "),
            Status::NotChecked => style.faint("--  "),
            Status::Warning => style.warning("look"),
            Status::Problem => style.bad("FIX "),
        };
        text += &format!("{word}  {:width$}  {}\n", finding.what, finding.found);
        if !finding.way_out.is_empty() {
            let arrow = style.faint("->");
            text += &format!("{:6}{:width$}  {arrow} {}\n", "", "", finding.way_out);
        }
    }
    text
}
