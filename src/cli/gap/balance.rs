//! `haltere gap diagnose --import`: flights of other vehicles and programs, judged without a simulator.

use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Context as _;
use clap::ValueEnum;

use super::own_simulator::OwnSimulator;
use crate::progress::Progress;
use crate::report::gap::balance as page;
use crate::vehicles;
use haltere_gap::balance::fill::{Filled, fill};
use haltere_gap::balance::flown::{FLIGHTS, Flown, fly_bank};
use haltere_gap::balance::{Hover, Report, diagnose};
use haltere_gap::outcome::Outcome;
use haltere_log::import::boards::{read_dataflash, read_ulog};
use haltere_log::import::motors::{
    self, Columns, Dropped, MotorFlight, MotorRow, read_table, read_usdlog,
};
use haltere_model::rotorcraft::Rotorcraft;

/// How long a simulator of the user's own may take for a hover of 15 s.
const ANSWER_WITHIN: Duration = Duration::from_secs(120);
/// Longest map of columns that is read, bytes.
const MOST_BYTES: u64 = 1 << 16;

/// Flights of other programs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Import {
    /// Logs of a Crazyflie's memory card, packed by gzip or not.
    Usdlog,
    /// Logs of PX4 (`.ulg`), packed by gzip or not.
    Ulog,
    /// Logs of ArduPilot (`.bin`), packed by gzip or not.
    Dataflash,
    /// Tables of text, whose columns `--columns` maps.
    Csv,
}

/// How flights are read.
pub(super) enum Source {
    Log(fn(&Path) -> Result<MotorFlight, motors::Error>),
    Table(Box<Columns>),
}

impl Import {
    /// With the map that it needs.
    pub fn source(self, columns: Option<&Path>) -> anyhow::Result<Source> {
        let read = match self {
            Import::Usdlog => read_usdlog,
            Import::Ulog => read_ulog,
            Import::Dataflash => read_dataflash,
            Import::Csv => return table(columns),
        };
        match columns {
            None => Ok(Source::Log(read)),
            Some(path) => anyhow::bail!(
                "--columns {}: a log names its own variables; leave it out",
                path.display()
            ),
        }
    }
}

/// Tables by the map that they need.
fn table(columns: Option<&Path>) -> anyhow::Result<Source> {
    let path = columns.context(
        "--import csv needs --columns FILE.toml, which says which column is what (docs/IMPORT.md)",
    )?;
    let name = || path.display().to_string();
    let text = haltere_log::intake::text(path, MOST_BYTES).with_context(name)?;
    Ok(Source::Table(Box::new(toml::from_str(&text).with_context(name)?)))
}

impl Source {
    fn read(&self, path: &Path) -> anyhow::Result<MotorFlight> {
        let flight = match self {
            Source::Log(read) => read(path)?,
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

/// What was found of a flight.
pub(super) enum Found {
    /// Its balance.
    Balance(Box<Report>),
    /// Why it has none, by the name of the flight.
    None(String, Outcome),
}

/// Judges the first flight by the references, and the explanation by the other flights; what causes do is flown by the command
/// `simulator`, where one is given.
pub(super) fn judge(
    source: &Source,
    flights: &[PathBuf],
    references: &[PathBuf],
    vehicle: &Path,
    simulator: Option<&str>,
) -> anyhow::Result<Found> {
    let vehicle = vehicles::rotorcraft(vehicle)?;
    let mut judged = Vec::new();
    for path in flights {
        judged.push(source.read(path)?);
    }
    let [first, others @ ..] = &judged[..] else { anyhow::bail!("no flight") };
    if let Some(why) = fault(first) {
        return Ok(Found::None(first.name.clone(), Outcome::Fault { why }));
    }
    let hover = match Hover::of(first, &vehicle) {
        Ok(hover) => hover,
        Err(why) => return Ok(Found::None(first.name.clone(), Outcome::NotTestable { why })),
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
    let flown = simulator.map(|command| flown(command, &vehicle)).transpose()?;
    let mut report = diagnose(&hover, &held_out, &accepted, &vehicle, flown.as_ref())?;
    report.not_checked.push(format!("of the log only {} were read", found(first)));
    Ok(Found::Balance(Box::new(report)))
}

/// The bank of a simulator of the user's own.
fn flown(command: &str, vehicle: &Rotorcraft) -> anyhow::Result<Flown> {
    let mut simulator = OwnSimulator::start(command, ANSWER_WITHIN)?;
    let progress = Progress::new("bank of --simulator");
    let mut done = 0;
    let bank = fly_bank(vehicle, &mut |request| {
        let answer = simulator.fly(request);
        done += 1;
        progress.at(done, FLIGHTS);
        answer
    });
    bank.map_err(|why| anyhow::anyhow!("--simulator: {why}"))
}

/// The file of a quadrotor from accepted flights: its new text, and what was found.
pub(super) fn filled(
    source: &Source,
    flights: &[PathBuf],
    vehicle: &Path,
) -> anyhow::Result<(String, Filled)> {
    let file = vehicles::rotorcraft(vehicle)?;
    let mut read = Vec::new();
    for path in flights {
        let flight = source.read(path)?;
        anyhow::ensure!(
            fault(&flight).is_none(),
            "{}: {}",
            path.display(),
            fault(&flight).unwrap_or_default()
        );
        read.push(flight);
    }
    let filled = fill(&read, &file)?;
    let text = vehicles::rotorcraft_text(vehicle).unwrap_or_default();
    Ok((filled.into_text(&text)?, filled))
}

impl Found {
    /// As text, as JSON and as a page.
    pub fn printed(&self) -> anyhow::Result<[String; 3]> {
        Ok(match self {
            Found::Balance(report) => {
                [report.text(), serde_json::to_string_pretty(report)?, page::render(report)]
            }
            Found::None(flight, outcome) => [
                format!("verdict    {}\n", outcome.sentence(str::to_owned)),
                serde_json::to_string_pretty(outcome)?,
                page::without(flight, outcome),
            ],
        })
    }

    /// Exit code.
    pub fn exit_code(&self) -> u8 {
        match self {
            Found::Balance(report) => report.outcome.exit_code(),
            Found::None(_, outcome) => outcome.exit_code(),
        }
    }
}

/// A flight that others are judged by.
fn sound(flight: &MotorFlight, path: &Path, vehicle: &Rotorcraft) -> anyhow::Result<Hover> {
    let why = fault(flight).map_or_else(|| Hover::of(flight, vehicle), Err);
    why.map_err(|why| anyhow::anyhow!("{}: cannot be used: {why}", path.display()))
}

/// What was found in a log.
fn found(flight: &MotorFlight) -> String {
    let is_there =
        |of: fn(&MotorRow) -> Option<f64>| flight.rows.iter().any(|row| of(row).is_some());
    let beside = [
        ("height", is_there(|row| row.height_m)),
        ("speed", is_there(|row| row.speed_mps)),
        ("voltage", is_there(|row| row.supply_v)),
        ("acceleration", is_there(|row| row.accel_g[2])),
    ];
    let there = beside.iter().filter(|(_, is)| *is).map(|(what, _)| format!(", {what}"));
    format!("{}{}", flight.commands, there.collect::<String>())
}

/// Why a log cannot be trusted.
fn fault(flight: &MotorFlight) -> Option<String> {
    let Dropped { unread_bytes, checksum_differs, .. } = flight.dropped;
    if checksum_differs || unread_bytes > 0 {
        return Some(format!(
            "{}{unread_bytes} bytes of the file cannot be read: it was cut off or changed",
            if checksum_differs { "the checksum is not that of the bytes, and " } else { "" }
        ));
    }
    None
}
