//! Before a flight: what of configuration, survey, ports, system and disk would spoil it, and the way
//! out. Nothing is moved; with live measurement the board is spoken to, and never armed.

pub mod crazyflie;
pub mod disk;
pub mod first;
pub mod key;
pub mod ports;
pub mod probe;
pub mod rates;
pub mod stations;
pub mod survey;
pub mod system;

use serde::Serialize;

use crate::sources::Loaded;

/// Outcome of one look.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// As it should be.
    Ok,
    /// Could not be looked at; never counts as as it should be.
    NotChecked,
    /// One can fly like this, but should know.
    Warning,
    /// Must be put right first.
    Problem,
}

/// What was looked at and found.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Finding {
    /// What was looked at: a key of the configuration where there is one.
    pub what: String,
    /// Outcome.
    pub status: Status,
    /// What was found, with unit and what is expected.
    pub found: String,
    /// What to do about it; empty where nothing is to be done.
    pub way_out: String,
}

impl Finding {
    /// As it should be.
    pub fn ok(what: impl Into<String>, found: impl Into<String>) -> Self {
        Self::with(Status::Ok, what, found, "")
    }

    /// Worth knowing.
    pub fn warning(
        what: impl Into<String>,
        found: impl Into<String>,
        way_out: impl Into<String>,
    ) -> Self {
        Self::with(Status::Warning, what, found, way_out)
    }

    /// To be put right.
    pub fn problem(
        what: impl Into<String>,
        found: impl Into<String>,
        way_out: impl Into<String>,
    ) -> Self {
        Self::with(Status::Problem, what, found, way_out)
    }

    /// Could not be looked at.
    pub fn not_checked(
        what: impl Into<String>,
        why: impl Into<String>,
        way_out: impl Into<String>,
    ) -> Self {
        Self::with(Status::NotChecked, what, why, way_out)
    }

    fn with(
        status: Status,
        what: impl Into<String>,
        found: impl Into<String>,
        way_out: impl Into<String>,
    ) -> Self {
        Self { what: what.into(), status, found: found.into(), way_out: way_out.into() }
    }
}

/// The worst of all.
pub fn worst(findings: &[Finding]) -> Status {
    let told = findings.iter().map(|f| f.status).filter(|s| *s != Status::NotChecked);
    told.max().unwrap_or(Status::Ok)
}

/// Looks at everything that needs no measurement over time but the timer's.
pub fn examine(loaded: &Loaded) -> Vec<Finding> {
    let mut findings = Vec::new();
    let files: Vec<_> = loaded.files.iter().map(|f| f.display().to_string()).collect();
    findings.push(Finding::ok("configuration", files.join(", ")));
    for note in &loaded.notes {
        findings.push(if note.way_out.is_empty() {
            Finding::ok(note.subject, &note.text)
        } else {
            Finding::warning(note.subject, &note.text, note.way_out)
        });
    }
    findings.extend(survey::examine(loaded));
    findings.extend(ports::examine(&loaded.config));
    findings.extend(system::examine(&loaded.config.timing));
    findings.extend(disk::examine(&loaded.config));
    findings.extend(key::examine(&loaded.config));
    findings
}

#[cfg(test)]
mod tests;
