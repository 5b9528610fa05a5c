//! `haltere-lab recorded`: studies of the estimator on recorded flights.

use std::path::PathBuf;
use std::process::ExitCode;

use crate::util_flights::{Flown, load_all};
use clap::{ArgGroup, Args};
use haltere::cli::{print, print_json};
use haltere::progress::Progress;

use crate::recorded::cold::{cold_starts, print_cold};
use crate::recorded::document::document;
use crate::recorded::ingredients::{ingredients, print_ingredients};
use crate::recorded::integrity::{integrity, print_integrity};
use crate::recorded::ranging::{beside_simulated, print_ranging};
use crate::recorded::search::{leave_one_out, print_left_out};

/// Studies the estimator on recorded flights with motion capture, in the UTIL layout. How it fares on each says
/// `haltere-lab util DIR`.
#[derive(Debug, Args)]
#[command(group = ArgGroup::new("study").required(true))]
pub struct Recorded {
    /// UTIL, or its `full` (with IMU) or `tdoa_pos` (TDOA alone).
    dir: PathBuf,
    /// Choose the parameters for each flight by search on the others.
    #[arg(long, group = "study")]
    leave_one_out: bool,
    /// Every ingredient of the estimator on and off on every flight.
    #[arg(long, group = "study")]
    ingredients: bool,
    /// Switch the estimator on in flight and tell it neither position nor heading.
    #[arg(long, group = "study")]
    cold: bool,
    /// Break something in the middle of every flight and see whether health warns before the estimate is wrong.
    #[arg(long, group = "study")]
    faults: bool,
    /// What errors of ranging look like on every flight, and in the simulator's rooms: docs/RANGING.md.
    #[arg(long, group = "study")]
    ranging: bool,
    /// Measure all of this and write it as a page (Markdown).
    #[arg(long, group = "study", value_name = "FILE", conflicts_with = "json")]
    document: Option<PathBuf>,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
}

impl Recorded {
    /// Runs the study and prints it.
    pub fn run(&self) -> anyhow::Result<ExitCode> {
        let flights = load_all(&self.dir)?;
        let flown = Flown::by_default()?.estimator;
        let progress = Progress::new("flights");
        let tell = |done: usize, of: usize, what: &str| progress.doing(done, of, what);
        let mut table = String::new();
        if let Some(path) = &self.document {
            let page = document(&flights, &flown, tell);
            haltere_log::written::write::<&std::path::Path>(path, page, &[])?;
            eprintln!("wrote {}", path.display());
        } else if self.leave_one_out {
            if flights.len() < 2 {
                anyhow::bail!(
                    "{}: {} flight, at least 2 needed to leave one out; name UTIL, or its folder full \
                     or tdoa_pos",
                    self.dir.display(),
                    flights.len()
                );
            }
            let left_out = leave_one_out(&flights, &flown, tell);
            if self.json {
                print_json(&left_out)?;
            }
            print_left_out(&mut table, &left_out, &flown)?;
        } else if self.ingredients {
            let rows = ingredients(&flights, &flown, tell);
            if self.json {
                print_json(&rows)?;
            }
            print_ingredients(&mut table, &rows)?;
        } else if self.ranging {
            let rows = beside_simulated(&flights)?;
            if self.json {
                print_json(&rows)?;
            }
            print_ranging(&mut table, &rows)?;
        } else if self.faults {
            // With and without IMU are two filters; their warnings are not added up.
            let (with_imu, unaided): (Vec<_>, Vec<_>) =
                flights.into_iter().partition(|f| f.has_imu());
            let mut tell = tell;
            let mut rows = Vec::new();
            for (title, kind) in [("with IMU", with_imu), ("TDOA alone", unaided)] {
                if !kind.is_empty() {
                    rows.push((title, integrity(&kind, &flown, &mut tell)));
                }
            }
            if self.json {
                print_json(&rows)?;
            }
            print_integrity(&mut table, &rows)?;
        } else {
            let starts = cold_starts(&flights, &flown, tell);
            if self.json {
                print_json(&starts)?;
            }
            print_cold(&mut table, &starts)?;
        }
        progress.end();
        if !self.json {
            print(&table)?;
        }
        Ok(ExitCode::SUCCESS)
    }
}
