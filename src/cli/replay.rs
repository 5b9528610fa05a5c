//! `haltere replay`: flight logs, the filter on logs with truth, or on flights in the UTIL layout.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Args;

use super::{FAILED, print, print_json, vehicle};
use crate::progress::Progress;
use crate::sources::Sources;
use crate::util_flights::{self, FlightReport, Flown, quadrotor};
use haltere_log::record::LogReader;
use haltere_log::replay;

/// Lives through flights again and says whether the same goes out.
///
/// The build that wrote a log must send every byte of it again. For a log of another build each message is looked
/// for among those of its link and kind, numbers within a tolerance, so that one message more does not move the
/// rest. Either way it is said whether the setpoints for the board differ, or only other traffic does: `gap
/// diagnose` rests on the setpoints alone, and judges those recorded where another build flew.
///
/// Exit codes: 0 reproduced; 1 a log cannot be replayed; 3 outputs differ (--util, --flights: a flight
/// diverged); 4 the log has a hole or no outputs, so that not all could be checked.
#[derive(Debug, Args)]
#[command(after_help = "Exit codes: 0 reproduced; 1 a log cannot be replayed; 3 outputs differ \
                        (--util, --flights: a flight diverged); 4 not everything could be checked.")]
pub(super) struct Replay {
    /// Flight logs.
    #[arg(required_unless_present_any = ["util", "flights"], conflicts_with_all = ["util", "flights"])]
    log: Vec<PathBuf>,
    /// Run the filter that flies on the flights of this folder, against motion capture: UTIL, or its `full` (with IMU)
    /// or `tdoa_pos` (TDOA alone).
    #[arg(long, value_name = "DIR")]
    util: Option<PathBuf>,
    /// Run the filter on the logs of this folder (or on one log), against --truth: the page of --util for one's own
    /// flights. Where no --config is named, the configuration in each log counts; the anchors are always those of the log.
    #[arg(long, value_name = "DIR", requires = "truth", conflicts_with = "util")]
    flights: Option<PathBuf>,
    /// Truth of --flights (docs/IMPORT.md): a folder with NAME.truth.csv or NAME.csv for NAME.mcap, or the file of a
    /// single log. Without a value NAME.truth.csv beside the log. Else motion capture in the log.
    #[arg(long, value_name = "WHERE", num_args = 0..=1, requires = "flights")]
    truth: Option<Option<PathBuf>>,
    /// Configuration of the filter for --util and --flights, as of `haltere fly`; several may be given, later ones win.
    #[arg(long, value_name = "FILE")]
    config: Vec<PathBuf>,
    /// The recorded vehicle for --util and --flights, over --config: keys of the configuration that are a vehicle's, or a
    /// vehicle file, or the name of a built-in vehicle. Default: the quadrotor of UTIL; the vehicle in the log.
    #[arg(long, value_name = "FILE")]
    vehicle: Option<PathBuf>,
    /// One value for --util or --flights, over all others.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

/// Some flight of `--util` or `--flights` diverged.
const DIVERGED: u8 = 3;
/// Some flight of `--flights` could not be held against a truth, or only in part.
const NOT_ALL: u8 = 4;

impl Replay {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        if let Some(folder) = &self.util {
            return self.run_util(folder);
        }
        if let (Some(folder), Some(place)) = (&self.flights, &self.truth) {
            return self.run_flights(folder, place.as_deref());
        }
        if !self.config.is_empty() || !self.set.is_empty() || self.vehicle.is_some() {
            anyhow::bail!(
                "--config, --vehicle and --set belong to --util and --flights: a log is replayed with what it was flown with"
            );
        }
        let mut worst = 0;
        let mut reports = Vec::new();
        for log in &self.log {
            match replay::replay(log) {
                Ok(report) => {
                    worst = worst.max(report.exit_code());
                    if !self.json {
                        print(&report.to_string())?;
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

    fn run_util(&self, folder: &Path) -> anyhow::Result<ExitCode> {
        let vehicle = self.vehicle.as_deref().map_or_else(|| Ok(quadrotor()), vehicle::keys)?;
        let flown = Flown::read(Sources {
            vehicle: Some(vehicle),
            ..Sources::new(self.config.clone(), self.set.clone())
        })?;
        let flights = util_flights::load_all(folder)?;
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

    fn run_flights(&self, folder: &Path, place: Option<&Path>) -> anyhow::Result<ExitCode> {
        let here = || folder.display().to_string();
        let logs = util_flights::logs(folder).with_context(here)?;
        if logs.is_empty() {
            anyhow::bail!("{}: no log (*.mcap); name the folder of the logs, or one log", here());
        }
        if let (Some(file), true) = (place.filter(|place| !place.is_dir()), logs.len() > 1) {
            anyhow::bail!(
                "--truth {}: no folder, and {} holds {} logs; name the folder of their truths, or a single log with --flights",
                file.display(),
                here(),
                logs.len()
            );
        }
        let vehicle = self.vehicle.as_deref().map(vehicle::keys).transpose()?;
        let sources = Sources { vehicle, ..Sources::new(self.config.clone(), self.set.clone()) };
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
            code = FAILED;
        } else if reports.iter().any(|report| report.diverged) {
            code = DIVERGED;
        }
        if self.json {
            print_json(&reports)?;
        } else if !reports.is_empty() {
            let mut table = String::new();
            util_flights::print_table(&mut table, &reports)?;
            util_flights::print_truth(&mut table, &reports)?;
            self.print_filter(&mut table, &reports, &told)?;
            print(&table)?;
        }
        Ok(ExitCode::from(code))
    }

    /// What the filter was told for which flights.
    fn print_filter(
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
