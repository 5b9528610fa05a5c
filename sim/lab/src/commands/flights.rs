//! `haltere-lab util` and `haltere-lab flights`: the filter on recorded flights, against their truth.

use std::fmt::Write as _;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Args;
use haltere::cli::{print, print_json, vehicle};
use haltere::progress::Progress;
use haltere::sources::Sources;
use haltere_log::record::LogReader;

use crate::util_flights::{self, FlightReport, Flown, quadrotor};

/// What the filter is told.
#[derive(Debug, Args)]
struct Filter {
    /// Configuration of the filter, as of `haltere fly`; several may be given, later ones win.
    #[arg(long, value_name = "FILE")]
    config: Vec<PathBuf>,
    /// The recorded vehicle, over --config: keys of the configuration that are a vehicle's, or a vehicle file, or the name
    /// of a built-in vehicle. Default: the quadrotor of UTIL; the vehicle in the log.
    #[arg(long, value_name = "FILE")]
    vehicle: Option<PathBuf>,
    /// One value, over all others.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// Runs the filter that flies on recorded flights, against motion capture.
///
/// Exit codes: 0 done; 2 something went wrong; 3 a flight diverged.
#[derive(Debug, Args)]
pub struct Util {
    /// UTIL, or its `full` (with IMU) or `tdoa_pos` (TDOA alone).
    dir: PathBuf,
    #[command(flatten)]
    filter: Filter,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

/// Runs the filter on the logs of a folder (or on one log), against their truth: the page of `util` for one's own flights.
/// Where no --config is named, the configuration in each log counts; the anchors are always those of the log.
///
/// Exit codes: 0 done; 1 no flight has a row; 2 something went wrong; 3 a flight diverged; 4 a flight could not be held
/// against a truth, or only in part.
#[derive(Debug, Args)]
pub struct Flights {
    /// Folder of the logs, or one log.
    dir: PathBuf,
    /// Truth of the flights (docs/IMPORT.md): a folder with NAME.truth.csv or NAME.csv for NAME.mcap, or the file of a
    /// single log. Without a value NAME.truth.csv beside the log. Else motion capture in the log.
    #[arg(long, value_name = "WHERE", num_args = 0..=1, required = true)]
    truth: Option<Option<PathBuf>>,
    #[command(flatten)]
    filter: Filter,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

/// No flight could be held against a truth.
const NONE: u8 = 1;
/// Some flight diverged.
const DIVERGED: u8 = 3;
/// Some flight could not be held against a truth, or only in part.
const NOT_ALL: u8 = 4;

impl Util {
    /// Runs it and prints the page.
    pub fn run(&self) -> anyhow::Result<ExitCode> {
        let vehicle =
            self.filter.vehicle.as_deref().map_or_else(|| Ok(quadrotor()), vehicle::keys)?;
        let flown = Flown::read(Sources {
            vehicle: Some(vehicle),
            ..Sources::new(self.filter.config.clone(), self.filter.set.clone())
        })?;
        let flights = util_flights::load_all(&self.dir)?;
        let reports: Vec<_> = flights.iter().map(|flight| flown.run(flight)).collect();
        if self.json {
            print_json(&reports)?;
        } else {
            let mut table = String::new();
            util_flights::print_table(&mut table, &reports)?;
            flown.print(&mut table)?;
            print(&table)?;
        }
        let diverged = reports.iter().any(|report| report.diverged);
        Ok(ExitCode::from(if diverged { DIVERGED } else { 0 }))
    }
}

impl Flights {
    /// Runs it and prints the page.
    pub fn run(&self) -> anyhow::Result<ExitCode> {
        let (folder, place) = (&self.dir, self.truth.as_ref().and_then(|place| place.as_deref()));
        let here = || folder.display().to_string();
        let logs = util_flights::logs(folder).with_context(here)?;
        if logs.is_empty() {
            anyhow::bail!("{}: no log (*.mcap); name the folder of the logs, or one log", here());
        }
        if let (Some(file), true) = (place.filter(|place| !place.is_dir()), logs.len() > 1) {
            anyhow::bail!(
                "--truth {}: no folder, and {} holds {} logs; name the folder of their truths, or a single log",
                file.display(),
                here(),
                logs.len()
            );
        }
        let vehicle = self.filter.vehicle.as_deref().map(vehicle::keys).transpose()?;
        let sources = Sources {
            vehicle,
            ..Sources::new(self.filter.config.clone(), self.filter.set.clone())
        };
        let (mut reports, mut told) = (Vec::new(), Vec::new());
        let mut code = 0;
        let progress = Progress::new("flights");
        for (i, log) in logs.iter().enumerate() {
            progress.doing(i, logs.len(), &log.display().to_string());
            let flown = |log: &LogReader| Flown::read_for(log, sources.clone());
            match util_flights::run_log(log, place, flown) {
                Ok((report, flown)) => {
                    reports.push(report);
                    told.push(flown);
                }
                Err(error) => {
                    tracing::error!("{error}");
                    code = NOT_ALL;
                }
            }
        }
        progress.end();
        let lost = |report: &FlightReport| report.truth.as_ref().is_some_and(|t| t.lost_inputs > 0);
        if reports.iter().any(lost) {
            code = NOT_ALL;
        }
        if reports.is_empty() {
            code = NONE;
        } else if reports.iter().any(|report| report.diverged) {
            code = DIVERGED;
        }
        if self.json {
            print_json(&reports)?;
        } else if !reports.is_empty() {
            let mut table = String::new();
            util_flights::print_table(&mut table, &reports)?;
            util_flights::print_truth(&mut table, &reports)?;
            self.filter.print(&mut table, &reports, &told)?;
            print(&table)?;
        }
        Ok(ExitCode::from(code))
    }
}

impl Filter {
    /// What the filter was told for which flights.
    fn print(
        &self,
        out: &mut String,
        reports: &[FlightReport],
        told: &[Flown],
    ) -> anyhow::Result<()> {
        let files = self.config.iter().map(|file| format!("--config {}", file.display()));
        let base: Vec<String> = files.collect();
        let base = if base.is_empty() { "as flown, by each log".into() } else { base.join(" ") };
        let over: String = self.set.iter().map(|set| format!(", over it --set {set}")).collect();
        writeln!(out, "the filter: {base}{over}; anchors, links and board as in each log")?;
        let mut vehicles: Vec<(String, Vec<&str>)> = Vec::new();
        for (report, flown) in reports.iter().zip(told) {
            let mut text = String::new();
            flown.print_vehicle(&mut text)?;
            match vehicles.iter_mut().find(|(known, _)| *known == text) {
                Some((_, flights)) => flights.push(&report.flight),
                None => vehicles.push((text, vec![&report.flight])),
            }
        }
        for (text, flights) in vehicles {
            write!(out, "the vehicle of {}\n{text}", flights.join(", "))?;
        }
        Ok(())
    }
}
