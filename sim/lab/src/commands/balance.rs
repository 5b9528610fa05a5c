//! `haltere-lab balance`: force balance of recorded flights.

use std::path::PathBuf;
use std::process::ExitCode;

use clap::{Args, ValueEnum};
use haltere::cli::{print, print_json};
use haltere_log::import::flapper;
use haltere_model::vehicle::Vehicle;

use crate::balance::{diagnose, terms::Part};

/// Says which force the nominal model lacks on recorded flights, and how far it shrinks on another.
///
/// Exit codes: 0 no gap, 10 named, 11 one of a set (always so without --held-out), 12 several, 13 not
/// in the library, 14 named with a remainder.
#[derive(Debug, Args)]
pub struct Balance {
    /// Flights to fit on (`.csv.gz` with motion capture, command and voltage).
    #[arg(required = true, value_name = "FLIGHT")]
    flights: Vec<PathBuf>,
    /// Flights that the fit does not see and that judge it.
    #[arg(long, value_name = "FLIGHT")]
    held_out: Vec<PathBuf>,
    /// Leaves a part out of the nominal model, to see whether it is found.
    #[arg(long, value_name = "PART")]
    without: Vec<Without>,
    /// Prints as JSON.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Without {
    /// Thrust does not depend on the voltage.
    Voltage,
    /// The air does not brake.
    Drag,
}

impl Balance {
    /// Fits, judges and prints.
    pub fn run(&self) -> anyhow::Result<ExitCode> {
        let read = |paths: &[PathBuf]| {
            paths.iter().map(|p| flapper::read(p)).collect::<Result<Vec<_>, _>>()
        };
        let without: Vec<Part> = self
            .without
            .iter()
            .map(|part| match part {
                Without::Voltage => Part::Voltage,
                Without::Drag => Part::Drag,
            })
            .collect();
        let report =
            diagnose(&read(&self.flights)?, &read(&self.held_out)?, &Vehicle::default(), &without)?;
        if self.json {
            print_json(&report)?;
        } else {
            print(&report.text())?;
        }
        Ok(ExitCode::from(report.outcome.exit_code()))
    }
}
