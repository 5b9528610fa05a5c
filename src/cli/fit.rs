//! `haltere fit`: identification from flight logs.

use std::io::BufReader;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Context as _;
use clap::{Args, Subcommand, ValueEnum};

use super::fit_program::ProgramCommand;
use super::log_export::say_end;
use super::output::{print, print_json};
use crate::fit::outcome::{Outcome, Refusal};
use crate::fit::source::Source;
use crate::fit::{tell, trim};
use crate::report::{from_log, truth};
use haltere_log::import::{columns, flapper, motion, stand};
use haltere_log::log_file::shown_name;
use haltere_log::record::LogReader;
use haltere_log::written;
use haltere_pilot::settings::Config;

/// The log does not hold what was asked; the sentence says which flight does.
const NOT_IN_LOG: u8 = 3;
/// Exponent of the discharge law when none is given: of physics.
const DISCHARGE_EXPONENT: f64 = -1.0;

/// Numbers of the vehicle from flight logs.
///
/// Exit codes: 0 fitted, 1 a file cannot be read, 2 wrong usage, 3 the log does not hold what was
/// asked (the message names the program to fly).
#[derive(Debug, Subcommand)]
pub(super) enum Fit {
    /// Drag along both axes, from angle steps or from recordings with motion capture.
    Drag {
        #[command(flatten)]
        files: Files,
    },
    /// Thrust command over battery voltage, from hover, recordings or a thrust stand.
    Thrust {
        #[command(flatten)]
        files: Files,
    },
    /// Ground effect, from a ladder of heights.
    Ground {
        #[command(flatten)]
        files: Files,
        /// Exponent of the command over the voltage, as `fit thrust` found it.
        #[arg(long, default_value_t = DISCHARGE_EXPONENT, allow_negative_numbers = true)]
        exponent: f64,
    },
    /// Delay and lag of the attitude.
    Lag {
        #[command(flatten)]
        files: Files,
    },
    /// Bias, noise and vibration of the inertial sensors.
    Imu {
        #[command(flatten)]
        files: Files,
    },
    /// Survey and range bias of every anchor; with --truth, or with motion capture in the log and
    /// --known, against known positions.
    Anchors {
        #[command(flatten)]
        files: Files,
        /// Positions are the motion capture in the log.
        #[arg(long)]
        known: bool,
    },
    /// Trims of roll, pitch and yaw from a hover of half a minute.
    Trim {
        /// Flight log.
        log: PathBuf,
        /// Print as JSON.
        #[arg(long)]
        json: bool,
    },
    /// Fits voltage and drag on the first file and judges them on the others, which it has not seen.
    CarryOver {
        #[command(flatten)]
        files: Files,
    },
    /// Prints the flight that shows what a fit needs, as a mission file for `haltere ctl mission`.
    Program(ProgramCommand),
}

/// Files and what to do with the answer.
#[derive(Debug, Args)]
pub(super) struct Files {
    /// Flight logs (`.mcap`), or recordings with --import.
    #[arg(required = true, value_name = "LOG")]
    logs: Vec<PathBuf>,
    /// The files are no logs of ours: their layout (docs/IMPORT.md).
    #[arg(long, value_name = "KIND")]
    import: Option<Import>,
    /// Truth file of a simulated flight, from `haltere-sim serve --truth`; one log only. Speeds and
    /// positions are then true ones.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Print as JSON.
    #[arg(long)]
    json: bool,
    /// Page to write: data, fit and tables in one HTML file.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Import {
    /// Our own CSV layout.
    Csv,
    /// Recordings in the layout of flapper_swarm3d, .csv.gz.
    Flapper,
    /// Thrust-stand tables in the layout of cf21_thrust_stand.
    Stand,
}

impl Fit {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        match self {
            Fit::Drag { files } => {
                let known = files.truth.is_some();
                files.answer(|sources| tell::drag::fit(sources, known))
            }
            Fit::Thrust { files } => files.answer(tell::thrust::fit),
            Fit::Ground { files, exponent } => {
                if !(-3.0..=3.0).contains(&exponent) {
                    anyhow::bail!("--exponent {exponent}, allowed -3 to 3");
                }
                let known = files.truth.is_some();
                files.answer(|sources| tell::ground::fit(sources, exponent, known))
            }
            Fit::Lag { files } => files.answer(tell::lag::fit),
            Fit::Imu { files } => files.answer(tell::imu::fit),
            Fit::Anchors { files, known } => {
                let known = known || files.truth.is_some();
                files.answer(|sources| tell::anchors::fit(sources, known))
            }
            Fit::Trim { log, json } => trims(&log, json),
            Fit::CarryOver { files } => files.answer(|sources| match sources {
                [train, tests @ ..] if !tests.is_empty() => tell::carry_over::fit(train, tests),
                _ => Err(Refusal::WrongKind {
                    why: "carry-over needs a file to fit on and at least one to judge on".into(),
                }),
            }),
            Fit::Program(program) => program.run(),
        }
    }
}

/// What a recording is taken as, and what of it is not taken.
fn remarks(source: &Source) -> Vec<String> {
    let Source::Recording(recording) = source else { return Vec::new() };
    let mut all = Vec::new();
    let (name, skipped) = (&recording.name, &recording.skipped);
    if skipped.total() > 0 {
        all.push(format!("{name}: {} rows were left out: {skipped}", skipped.total()));
    }
    if motion::begins_in_flight(recording) {
        all.push(format!(
            "{name}: begins in flight; the floor is where it rests later, or else the plane of the origin"
        ));
    }
    all
}

impl Files {
    fn answer(
        self,
        fit: impl FnOnce(&[Source]) -> Result<Outcome, Refusal>,
    ) -> anyhow::Result<ExitCode> {
        if self.truth.is_some() && (self.logs.len() != 1 || self.import.is_some()) {
            anyhow::bail!("--truth goes with one log of ours, {} files given", self.logs.len());
        }
        let inputs: Vec<&PathBuf> = self.logs.iter().chain(&self.truth).collect();
        if let Some(path) = &self.report {
            written::look(path, &inputs)?;
        }
        let mut sources = Vec::new();
        for path in &self.logs {
            tracing::info!("reading {}", path.display());
            sources.push(self.read(path)?);
        }
        let outcome = match fit(&sources) {
            Ok(mut outcome) => {
                outcome.notes.extend(sources.iter().flat_map(remarks));
                outcome
            }
            Err(refusal) => {
                use std::io::Write as _;
                let _ = writeln!(std::io::stderr(), "haltere: {refusal}");
                return Ok(ExitCode::from(NOT_IN_LOG));
            }
        };
        if let Some(path) = &self.report {
            written::write(path, outcome.html(), &inputs)?;
            tracing::info!("wrote {}", path.display());
        }
        if self.json {
            print_json(&outcome)?;
        } else {
            print(&outcome.text())?;
        }
        Ok(ExitCode::SUCCESS)
    }

    fn read(&self, path: &Path) -> anyhow::Result<Source> {
        Ok(match self.import {
            Some(Import::Csv) => Source::Recording(columns::read(path)?),
            Some(Import::Flapper) => Source::Recording(flapper::read(path)?),
            Some(Import::Stand) => Source::Stand(stand::read(path)?),
            None => {
                let reader = LogReader::open(path).context(
                    "no log of ours; for other files say --import csv, flapper or stand",
                )?;
                let config =
                    Config::as_recorded("configuration in the log", &reader.session().config_toml)?;
                let (mut flight, end) = from_log::read(&reader);
                say_end(&reader, &end);
                if let Some(path) = &self.truth {
                    let name = || path.display().to_string();
                    let file = haltere_log::intake::open(path).with_context(name)?;
                    flight.truth = truth::read(BufReader::new(file)).with_context(name)?;
                }
                let name = shown_name(path);
                Source::Log { name, flight: Box::new(flight), config: Box::new(config) }
            }
        })
    }
}

fn trims(log: &Path, json: bool) -> anyhow::Result<ExitCode> {
    let name = log.display().to_string();
    let reader = LogReader::open(log)?;
    // The drag law that was flown with: it takes the lean of a drift off.
    let config = Config::as_recorded("configuration in the log", &reader.session().config_toml)?;
    let (flight, end) = from_log::read(&reader);
    say_end(&reader, &end);
    let trims = trim::fit(&flight, &config.control.drag).context(name)?;
    if json {
        print_json(&trims)?;
        return Ok(ExitCode::SUCCESS);
    }
    print(&format!(
        "# from {:.0} s of hover in {} blocks; one sigma {:.2}, {:.2}, {:.2} deg\n\
         [control.trims]\nroll_deg = {:.2}\npitch_deg = {:.2}\nyaw_deg = {:.2}\n",
        trims.hover_s,
        trims.blocks,
        trims.roll.std_deg,
        trims.pitch.std_deg,
        trims.yaw.std_deg,
        trims.roll.value_deg,
        trims.pitch.value_deg,
        trims.yaw.value_deg,
    ))?;
    Ok(ExitCode::SUCCESS)
}
