//! `haltere replay`: flight logs, or flights in the UTIL layout.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use clap::Args;

use super::{FAILED, moved, print, print_json, vehicle};
use crate::sources::Sources;
use crate::util_flights::{self, Flown, quadrotor};
use haltere_log::replay;

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
    /// Run the filter that flies on the flights of this folder, against motion capture: UTIL, or its `full` (with IMU)
    /// or `tdoa_pos` (TDOA alone).
    #[arg(long, value_name = "DIR")]
    util: Option<PathBuf>,
    /// Configuration of the filter for --util, as of `haltere fly`; several may be given, later ones win.
    #[arg(long, value_name = "FILE")]
    config: Vec<PathBuf>,
    /// The recorded vehicle for --util, over --config: keys of the configuration that are a vehicle's, or a vehicle
    /// file, or the name of a built-in vehicle. Default: the quadrotor of UTIL.
    #[arg(long, value_name = "FILE")]
    vehicle: Option<PathBuf>,
    /// One value for --util, over all others.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// The laboratory's, as the four below.
    #[arg(long, hide = true)]
    leave_one_out: bool,
    #[arg(long, hide = true)]
    ingredients: bool,
    #[arg(long, hide = true)]
    cold: bool,
    #[arg(long, hide = true)]
    faults: bool,
    #[arg(long, hide = true)]
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
        if !self.config.is_empty() || !self.set.is_empty() || self.vehicle.is_some() {
            anyhow::bail!(
                "--config, --vehicle and --set belong to --util: a log is replayed with what it was flown with"
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
        if let Some(study) = self.study() {
            let was = format!("haltere replay --util DIR {study}");
            return Ok(moved::say(&was, &format!("haltere-lab recorded DIR {study}")));
        }
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

    /// A study that was asked for, which the laboratory has now.
    fn study(&self) -> Option<&'static str> {
        let studies = [
            (self.leave_one_out, "--leave-one-out"),
            (self.ingredients, "--ingredients"),
            (self.cold, "--cold"),
            (self.faults, "--faults"),
            (self.document.is_some(), "--document FILE"),
        ];
        studies.into_iter().find(|(asked, _)| *asked).map(|(_, option)| option)
    }
}
