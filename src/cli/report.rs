//! `haltere report`: a flight log as one page.

use std::io::BufReader;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context as _;
use clap::Args;

use super::log_export::say_end;
use super::output::print;
use super::which_flight::{WhichFlight, tell};
use crate::report::errors::{axis_errors, legs};
use crate::report::flight::{Flight, ParameterRow};
use crate::report::svg::Limit;
use crate::report::{Page, from_log, truth};
use haltere_core::control::voltage::BaseThrust;
use haltere_log::log_file::shown_name;
use haltere_log::record::{FlightPart, Flights, LogEnd, LogReader};
use haltere_log::replay::{self, changed_parameters, recorded_config, replay_observed};
use haltere_log::written::{self, look};

/// Draws a flight log as a self-contained HTML page.
#[derive(Debug, Args)]
pub(super) struct Report {
    /// The log.
    log: PathBuf,
    #[command(flatten)]
    which: WhichFlight,
    /// Truth file of a simulated flight, from `haltere-sim serve --truth`.
    #[arg(long, value_name = "FILE")]
    truth: Option<PathBuf>,
    /// Page to write; else beside the log, with its name.
    #[arg(long, short, value_name = "FILE")]
    output: Option<PathBuf>,
}

impl Report {
    pub(super) fn run(self) -> anyhow::Result<ExitCode> {
        let output = self.output.unwrap_or_else(|| self.log.with_extension("html"));
        let inputs: Vec<&PathBuf> = std::iter::once(&self.log).chain(&self.truth).collect();
        // Before the log is lived through: it is known now.
        look(&output, &inputs)?;
        let log = LogReader::open(&self.log)?;
        let part = flights(&log, self.which)?;
        tell(&self.log, part.flight());
        let (mut flight, end) = from_log::read_part(&log, part.clone());
        if flight.ends().is_none() {
            relive(&mut flight, &log, &part);
        }
        flight.facts = from_log::facts(&log, &flight);
        add_configuration(&mut flight, &log);
        if let Some(path) = &self.truth {
            let name = || path.display().to_string();
            let file = haltere_log::intake::open(path).with_context(name)?;
            flight.truth = truth::read(BufReader::new(file)).with_context(name)?;
            if let Some((from, to)) = flight.ends() {
                flight.truth.retain(|row| row.at >= from && row.at <= to);
            }
        }
        say_end(&log, &end);
        let name = shown_name(&self.log);
        let one = part.flight().filter(|flight| flight.of > 1);
        let name = one.map_or(name.clone(), |flight| format!("{name}, {flight}"));
        let subtitle = match end {
            LogEnd::Complete => name,
            other => format!("{name}, log {other}: shown is what is whole"),
        };
        let known = !flight.truth.is_empty() || !flight.references.is_empty();
        let legs = if known { legs(&flight) } else { Vec::new() };
        let page = Page {
            title: "Flight",
            subtitle: &subtitle,
            checks: &[],
            errors: &axis_errors(&flight, &legs),
            paths: &[],
            flight: &flight,
        };
        written::write(&output, page.render(), &inputs)?;
        print(&format!("{}\n", output.display()))?;
        Ok(ExitCode::SUCCESS)
    }
}

/// The part to draw: of a log that this build cannot replay, whose topics do not tell its flights, all that is drawn.
fn flights(log: &LogReader, which: WhichFlight) -> anyhow::Result<FlightPart> {
    let flights = replay::flights(log).unwrap_or_else(|_| Flights::recorded(log));
    Ok(flights.part(log, which.number())?)
}

/// A log that was recorded without decoded topics has them again when the core lives through it.
fn relive(flight: &mut Flight, log: &LogReader, part: &FlightPart) {
    match replay_observed(log, part, |topic| flight.add_topic(topic)) {
        Ok((report, _)) if report.inputs > 0 => {
            tracing::info!(
                "the log holds no decoded topics: they are those of a replay by this build"
            );
            if report.exit_code() != 0 {
                tracing::warn!(
                    "the replay does not reproduce the flight: haltere replay {}",
                    log.path().display()
                );
            }
        }
        Ok(_) => {}
        Err(error) => tracing::warn!("the log holds no decoded topics: {error}"),
    }
}

/// What the recorded configuration tells beside the topics. A log whose configuration this build
/// refuses is drawn without.
fn add_configuration(flight: &mut Flight, log: &LogReader) {
    let config = match recorded_config(log) {
        Ok(config) => config,
        Err(error) => return tracing::warn!("drawn without its configuration: {error}"),
    };
    let voltage = &config.control.voltage;
    flight.base_nominal_frac = Some(BaseThrust::new(voltage).at_frac(voltage.nominal_v));
    let limits = &config.limits;
    flight.battery_limits =
        [("warning", limits.battery_low_v), ("lands", limits.battery_critical_v)]
            .map(|(name, y)| Limit { name: name.to_owned(), y })
            .into();
    let rows = config.differences().into_iter();
    flight.configuration = rows.map(|d| [d.key, d.value, d.default]).collect();
    let changes = changed_parameters(log).into_iter();
    flight.parameters = changes
        .map(|c| ParameterRow {
            at: c.at,
            name: c.name.to_owned(),
            from: c.from,
            to: c.to,
            unit: c.unit.to_owned(),
        })
        .collect();
}
