//! `haltere gap diagnose --import`: flights of other vehicles and programs, judged without a simulator.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use clap::ValueEnum;

use crate::cli::output::{print, print_json};
use crate::vehicles;
use haltere_gap::balance::{Hover, diagnose};
use haltere_gap::outcome::Outcome;
use haltere_log::import::motors::{Columns, Dropped, MotorFlight, read_table, read_usdlog};
use haltere_model::rotorcraft::Rotorcraft;

/// Longest map of columns that is read, bytes.
const MOST_BYTES: u64 = 1 << 16;

/// Flights of other programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Import {
    /// Logs of a Crazyflie's memory card, packed by gzip or not.
    Usdlog,
    /// Tables of text, whose columns `--columns` maps.
    Csv,
}

/// How flights are read.
pub(super) enum Source {
    Usdlog,
    Table(Box<Columns>),
}

impl Import {
    /// With the map that it needs.
    pub fn source(self, columns: Option<&Path>) -> anyhow::Result<Source> {
        match (self, columns) {
            (Import::Usdlog, None) => Ok(Source::Usdlog),
            (Import::Usdlog, Some(path)) => anyhow::bail!(
                "--columns {}: a usdlog names its own variables; leave it out",
                path.display()
            ),
            (Import::Csv, None) => anyhow::bail!(
                "--import csv needs --columns FILE.toml, which says which column is what (docs/IMPORT.md)"
            ),
            (Import::Csv, Some(path)) => {
                let name = || path.display().to_string();
                let text = haltere_log::intake::text(path, MOST_BYTES).with_context(name)?;
                Ok(Source::Table(Box::new(toml::from_str(&text).with_context(name)?)))
            }
        }
    }
}

impl Source {
    fn read(&self, path: &Path) -> anyhow::Result<MotorFlight> {
        let flight = match self {
            Source::Usdlog => read_usdlog(path)?,
            Source::Table(columns) => read_table(path, columns)?,
        };
        let Dropped { unreadable, time_backwards, .. } = flight.dropped;
        if unreadable + time_backwards > 0 {
            eprintln!(
                "{}: left out: {unreadable} rows without a number for each motor, {time_backwards} not later than the row before",
                path.display()
            );
        }
        Ok(flight)
    }
}

/// Judges the first flight by the references, and the explanation by the other flights.
pub(super) fn run(
    source: &Source,
    flights: &[PathBuf],
    references: &[PathBuf],
    vehicle: &Path,
    json: bool,
) -> anyhow::Result<ExitCode> {
    let vehicle = vehicles::rotorcraft(vehicle)?;
    let mut judged = Vec::new();
    for path in flights {
        judged.push(source.read(path)?);
    }
    let [first, others @ ..] = &judged[..] else { anyhow::bail!("no flight") };
    if let Some(why) = fault(first) {
        return end(&Outcome::Fault { why }, json);
    }
    let hover = match Hover::of(first, &vehicle) {
        Ok(hover) => hover,
        Err(why) => return end(&Outcome::NotTestable { why }, json),
    };
    let mut accepted = Vec::new();
    for path in references {
        let flight = source.read(path)?;
        if judged.iter().any(|judged| judged.rows == flight.rows) {
            eprintln!("not counted: {}: is a flight that is judged", path.display());
            continue;
        }
        accepted.push(sound(&flight, path, &vehicle)?);
    }
    let mut held_out = Vec::new();
    for (flight, path) in others.iter().zip(flights.iter().skip(1)) {
        held_out.push(sound(flight, path, &vehicle)?);
    }
    let mut report = diagnose(&hover, &held_out, &accepted, &vehicle)?;
    report
        .not_checked
        .push(format!("of the log only {}, height and voltage were read", first.commands));
    match json {
        true => print_json(&report)?,
        false => print(&report.text())?,
    }
    Ok(ExitCode::from(report.outcome.exit_code()))
}

/// A flight that others are judged by.
fn sound(flight: &MotorFlight, path: &Path, vehicle: &Rotorcraft) -> anyhow::Result<Hover> {
    let why = fault(flight).map_or_else(|| Hover::of(flight, vehicle), Err);
    why.map_err(|why| anyhow::anyhow!("{}: cannot be used: {why}", path.display()))
}

/// Why a log cannot be trusted.
fn fault(flight: &MotorFlight) -> Option<String> {
    let Dropped { unread_bytes, checksum_differs, .. } = flight.dropped;
    if checksum_differs || unread_bytes > 0 {
        return Some(format!(
            "the checksum of the file {}, and {unread_bytes} bytes at its end cannot be read: it was cut off or changed",
            if checksum_differs { "is not that of its bytes" } else { "is right" }
        ));
    }
    None
}

/// An outcome without a balance.
fn end(outcome: &Outcome, json: bool) -> anyhow::Result<ExitCode> {
    match json {
        true => print_json(outcome)?,
        false => print(&format!("verdict    {}\n", outcome.sentence(str::to_owned)))?,
    }
    Ok(ExitCode::from(outcome.exit_code()))
}
