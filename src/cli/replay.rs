//! `haltere replay`: flight logs, or flights in the UTIL layout.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Args;

use super::progress::Progress;
use super::{FAILED, print, print_json};
use crate::{replay, util_flights};

/// Lives through flights again and says whether the same goes out.
///
/// The build that wrote a log must send every byte of it again. For a log of another build each message is looked
/// for among those of its link and kind, numbers within a tolerance, so that one message more does not move the
/// rest. Either way it is said whether the setpoints for the board differ, or only other traffic does: `gap
/// diagnose` rests on the setpoints alone, and judges those recorded where another build flew.
///
/// Exit codes: 0 reproduced; 1 a log cannot be replayed; 3 outputs differ (--util: a flight
/// diverged); 4 the log has a hole or no outputs, so that not all could be checked.
#[derive(Debug, Args)]
#[command(after_help = "Exit codes: 0 reproduced; 1 a log cannot be replayed; 3 outputs differ \
                        (--util: a flight diverged); 4 not everything could be checked.")]
pub(super) struct Replay {
    /// Flight logs.
    #[arg(required_unless_present = "util", conflicts_with = "util")]
    log: Vec<PathBuf>,
    /// Run the estimator on the flights of this folder, against motion capture: UTIL, or its `full`
    /// (with IMU) or `tdoa_pos` (TDOA alone).
    #[arg(long, value_name = "DIR")]
    util: Option<PathBuf>,
    /// With --util: choose the parameters for each flight by search on the others.
    #[arg(long, requires = "util", conflicts_with_all = ["ingredients", "cold", "document"])]
    leave_one_out: bool,
    /// With --util: every ingredient of the estimator on and off on every flight.
    #[arg(long, requires = "util", conflicts_with_all = ["cold", "document"])]
    ingredients: bool,
    /// With --util: switch the estimator on in flight and tell it neither position nor heading.
    #[arg(long, requires = "util", conflicts_with = "document")]
    cold: bool,
    /// With --util: break something in the middle of every flight and see whether health warns before the
    /// estimate is wrong.
    #[arg(long, requires = "util", conflicts_with_all = ["leave_one_out", "ingredients", "cold", "document"])]
    faults: bool,
    /// With --util: measure all of this and write it as a page (Markdown).
    #[arg(long, requires = "util", value_name = "FILE", conflicts_with = "json")]
    document: Option<PathBuf>,
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

    fn run_util(&self, folder: &Path) -> anyhow::Result<ExitCode> {
        let flights = util_flights::load_all(folder)?;
        let mut progress = Progress::default();
        let tell = |done: usize, of: usize, what: &str| progress.tell(done, of, what);
        let mut table = String::new();
        if let Some(path) = &self.document {
            let page = util_flights::document(&flights, tell);
            std::fs::write(path, page).with_context(|| path.display().to_string())?;
            tracing::info!("wrote {}", path.display());
        } else if self.leave_one_out {
            // With and without IMU are two sets of parameters; a folder with both is taken with IMU.
            let with_imu = flights.iter().any(|f| f.has_imu());
            let kind: Vec<_> = flights.into_iter().filter(|f| f.has_imu() == with_imu).collect();
            if kind.len() < 2 {
                anyhow::bail!(
                    "{}: {} flight, at least 2 needed to leave one out; name UTIL, or its folder full \
                     or tdoa_pos",
                    folder.display(),
                    kind.len()
                );
            }
            let left_out = util_flights::leave_one_out(&kind, tell);
            if self.json {
                print_json(&left_out)?;
            }
            util_flights::print_left_out(&mut table, &left_out)?;
        } else if self.ingredients {
            let rows = util_flights::ingredients(&flights, tell);
            if self.json {
                print_json(&rows)?;
            }
            util_flights::print_ingredients(&mut table, &rows)?;
        } else if self.faults {
            // With and without IMU are two filters; their warnings are not added up.
            let (with_imu, unaided): (Vec<_>, Vec<_>) =
                flights.into_iter().partition(|f| f.has_imu());
            let mut tell = tell;
            let mut rows = Vec::new();
            for kind in [with_imu, unaided].into_iter().filter(|kind| !kind.is_empty()) {
                rows.push(util_flights::integrity(&kind, &mut tell));
            }
            if self.json {
                print_json(&rows)?;
            }
            for kind in &rows {
                util_flights::print_integrity(&mut table, kind)?;
                table.push('\n');
            }
        } else if self.cold {
            let profile = util_flights::util_profile();
            let starts = util_flights::cold_starts(&flights, &profile, tell);
            if self.json {
                print_json(&starts)?;
            }
            util_flights::print_cold(&mut table, &starts)?;
        } else {
            let reports: Vec<_> = flights
                .iter()
                .map(|flight| util_flights::run_flight(flight, &util_flights::shipped(flight)))
                .collect();
            if self.json {
                print_json(&reports)?;
            }
            util_flights::print_table(&mut table, &reports)?;
            if !self.json {
                print(&table);
            }
            let diverged = reports.iter().any(|report| report.diverged);
            return Ok(ExitCode::from(if diverged { DIVERGED } else { 0 }));
        }
        progress.clear();
        if !self.json {
            print(&table);
        }
        Ok(ExitCode::SUCCESS)
    }
}
