//! How the flight of a mission ended, as its log tells it.

use std::path::Path;

use haltere_gap::flight::logs::{self, Flown};
use haltere_gap::flight::trace::Trace;
use haltere_log::replay::ReplayError;

/// Texts of a control step belong to a change of the mode, s.
const STEP_S: f64 = 0.01;
/// `MAV_SEVERITY_NOTICE` of MAVLink: whatever is graver has a smaller number, what is said in passing a larger one.
const NOTICE: u8 = 5;

/// The end of a flight.
#[derive(Debug, Clone, PartialEq)]
pub struct Ending {
    /// What ended its mission before the landing that it asks for; `None`: nothing did.
    pub early: Option<String>,
    /// Why the diagnosis does not take it; `None`: it does.
    pub refused: Option<String>,
}

impl Ending {
    /// Reads it from a log.
    pub fn of(log: &Path) -> Result<Self, ReplayError> {
        let Flown { trace, faults, .. } = logs::read(log)?;
        Ok(Self { early: early(&trace), refused: faults.into_iter().next() })
    }
}

fn early(trace: &Trace) -> Option<String> {
    let said = |from_s: f64, to_s: f64, most: u8| {
        let within = trace.texts.iter().filter(|text| {
            let at_s = text.at.as_us() as f64 * 1e-6;
            (from_s..=to_s).contains(&at_s) && text.severity <= most
        });
        within.map(|text| text.text.as_str()).collect::<Vec<_>>()
    };
    let Some(part) = trace.mission_part() else {
        let last = said(0.0, f64::INFINITY, NOTICE - 1).last().map_or("", |text| *text).to_owned();
        return Some(format!("its mission never began: {last}"));
    };
    if part.whole {
        return None;
    }
    let end_s = part.from.as_us() as f64 * 1e-6 + part.flown_s;
    let words = said(end_s - STEP_S, end_s + STEP_S, NOTICE).join("; ");
    let words = if words.is_empty() { "the flight took too long".to_owned() } else { words };
    Some(format!("its mission ended after {:.0} s: {words}", part.flown_s))
}
