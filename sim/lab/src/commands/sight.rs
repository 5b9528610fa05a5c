//! `haltere-lab sight`: blocked lines of sight in recorded UWB flights.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use crate::util_flights::file::{Flight, load_located};
use haltere::cli::{print, print_json};

use crate::lines_of_sight::{Limit, report, watch};

/// Names anchors whose line of sight to the tag was blocked, and when and where, or calls the flight
/// clear.
///
/// Exit codes: 0 clear, 10 one anchor named, 12 several anchors, 20 too few data; for several flights
/// the highest.
#[derive(Debug, Args)]
pub struct Sight {
    /// Recorded flights in the UTIL layout, or folders of them.
    #[arg(required = true, value_name = "DIR|FILE")]
    flights: Vec<PathBuf>,
    /// Flights of the same vehicle among the same anchors, known to be clear: the limit is then taken
    /// from them. From another layout it does not carry over.
    #[arg(long, value_name = "FILE")]
    reference: Vec<PathBuf>,
    /// Prints as JSON.
    #[arg(long)]
    json: bool,
}

impl Sight {
    pub fn run(self) -> anyhow::Result<ExitCode> {
        let read = |paths: &[PathBuf]| -> anyhow::Result<Vec<Flight>> {
            let mut flights = Vec::new();
            for path in paths {
                flights.extend(load_located(path)?);
            }
            Ok(flights)
        };
        let limit = match self.reference.is_empty() {
            true => Limit::default(),
            false => Limit::from_clear(&read(&self.reference)?),
        };
        let found: Vec<_> =
            read(&self.flights)?.iter().map(|flight| watch(flight, &limit)).collect();
        if self.json {
            print_json(&found)?;
        } else {
            print(&report::text(&found))?;
        }
        Ok(ExitCode::from(found.iter().map(|f| f.outcome.exit_code()).max().unwrap_or(0)))
    }
}
