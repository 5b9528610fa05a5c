//! Replay: lives through a recorded flight again and says whether the same bytes go out.
//!
//! The core is built from the recorded configuration and survey and fed with the recorded inputs,
//! losses and wake-ups in their order. With the same build on the same processor every outgoing
//! byte must be the same (signatures excluded: keys are never stored). With another build decoded
//! messages must agree within [`TOLERANCE`].

mod compare;
mod parameters;
#[cfg(test)]
mod tests;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};

use serde::Serialize;
use thiserror::Error;

use self::compare::{Agreement, compare, without_signatures};
use crate::checks::Problems;
use crate::config::Config;
use crate::pilot::{LinkId, Mission, Pilot};
use crate::record::{BuildIdentity, Entry, LogEnd, LogError, LogReader, pb};
use crate::time::HostTime;
use crate::topics::Topic;

pub use compare::TOLERANCE;
pub use parameters::{ParameterChange, changed_parameters};

/// Why a log cannot be replayed at all.
#[derive(Debug, Error)]
pub enum ReplayError {
    /// The file.
    #[error(transparent)]
    Log(#[from] LogError),
    /// The recorded configuration is not understood, or not allowed any more.
    #[error(
        "{}: recorded with a configuration that this build refuses; replay it with the build \
         that wrote it (haltere {version}, source {source_hash}):\n{problems}", path.display()
    )]
    Config {
        /// Which log.
        path: PathBuf,
        /// Version that wrote it.
        version: String,
        /// Source that wrote it.
        source_hash: String,
        /// What is refused.
        problems: Problems,
    },
}

/// What must agree.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Demand {
    /// Same build, same processor: every byte.
    BitExact,
    /// Another build or processor: decoded messages, within [`TOLERANCE`].
    Decoded,
}

/// What came of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Every byte is the same.
    Identical,
    /// Another build, and decoded messages agree.
    WithinTolerance,
    /// Outputs differ by more than the demand allows.
    Different,
    /// The same up to a hole in the log; behind it nothing can be said.
    OnlyToHole,
    /// The log holds no output to compare with.
    NothingToCompare,
}

/// First place where outputs differ.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// Place in the order of the log.
    pub sequence: u64,
    /// Time since the start of the core, s.
    pub time_s: f64,
    /// Number of the link: 0 tag, 1 board, 2 and up ground endpoints.
    pub link: u8,
    /// What was recorded, what was replayed.
    pub what: String,
}

/// A hole in the log.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Hole {
    /// Time since the start of the core, s.
    pub from_s: f64,
    /// Time since the start of the core, s.
    pub to_s: f64,
    /// Inputs and outputs that are missing.
    pub lost_raw: u64,
    /// Decoded records that are missing.
    pub lost_topics: u64,
}

/// Result of one log.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// The log.
    pub log: PathBuf,
    /// What must agree.
    pub demand: Demand,
    /// Why the demand is not `bit_exact`.
    pub build_differences: Vec<String>,
    /// What came of it.
    pub verdict: Verdict,
    /// How the log ends: `complete`, `cut at byte …`, `damaged at byte …`.
    pub log_end: String,
    /// Recorded time, s.
    pub duration_s: f64,
    /// Inputs fed, wake-ups included.
    pub inputs: u64,
    /// Outputs compared.
    pub outputs: u64,
    /// Of these, the same bytes.
    pub outputs_identical: u64,
    /// Bytes compared.
    pub output_bytes: u64,
    /// Largest difference of a decoded number, relative where it exceeds 1.
    pub worst_difference: f64,
    /// Whole numbers that differ by one: a value rounded the other way.
    pub rounding_flips: u64,
    /// First difference that breaks the demand.
    pub first_difference: Option<Difference>,
    /// Holes. Nothing is compared behind the first.
    pub holes: Vec<Hole>,
}

impl Report {
    /// 0 reproduced, 3 different, 4 only partly checked.
    pub fn exit_code(&self) -> u8 {
        match self.verdict {
            Verdict::Identical | Verdict::WithinTolerance => 0,
            Verdict::Different => 3,
            Verdict::OnlyToHole | Verdict::NothingToCompare => 4,
        }
    }
}

/// Replays one log.
pub fn replay(path: &Path) -> Result<Report, ReplayError> {
    replay_log(&LogReader::open(path)?)
}

/// Replays a log that is read already.
pub fn replay_log(log: &LogReader) -> Result<Report, ReplayError> {
    replay_with(log, None).map(|(report, _)| report)
}

/// The same, and hands out what the core tells about itself on the way: a log that was recorded
/// without decoded topics has them again, and they are those of this build. Also gives the mission
/// that was in force at the end.
pub fn replay_observed(
    log: &LogReader,
    mut watch: impl FnMut(Topic),
) -> Result<(Report, Mission), ReplayError> {
    replay_with(log, Some(&mut watch))
}

/// The configuration that was flown.
pub fn recorded_config(log: &LogReader) -> Result<Config, ReplayError> {
    let session = log.session();
    Config::from_toml("recorded configuration", &session.config_toml)
        .and_then(|config| {
            let mut problems = Problems::new();
            config.check(&mut problems);
            problems.into_result().map(|()| config)
        })
        .map_err(|problems| ReplayError::Config {
            path: log.path().to_owned(),
            version: session.build.program_version.clone(),
            source_hash: session.build.source_hash.clone(),
            problems,
        })
}

fn replay_with(
    log: &LogReader,
    mut watch: Option<&mut dyn FnMut(Topic)>,
) -> Result<(Report, Mission), ReplayError> {
    let session = log.session();
    let config = recorded_config(log)?;
    let build_differences = BuildIdentity::current().differences(&session.build);
    let demand = if build_differences.is_empty() { Demand::BitExact } else { Demand::Decoded };
    let start = session.pilot_started_at;
    let pilot = Pilot::new(config.pilot(), session.survey.clone(), start);
    let pilot = if watch.is_some() { pilot } else { pilot.without_topics() };
    let mut run = Run::new(pilot, start, log.path().to_owned(), demand, build_differences);
    let mut entries = log.entries();
    for entry in entries.by_ref() {
        run.take(entry);
        if let Some(watch) = &mut watch {
            run.pilot.drain_topics(&mut **watch);
        }
    }
    let mission = run.pilot.mission().clone();
    Ok((run.finish(&entries.end()), mission))
}

struct Run {
    pilot: Pilot,
    start: HostTime,
    last: HostTime,
    sequence: u64,
    /// The recorder said that this is all.
    closed: bool,
    /// Replayed, and not recorded yet.
    pending: VecDeque<(LinkId, Vec<u8>)>,
    report: Report,
}

impl Run {
    fn new(
        pilot: Pilot,
        start: HostTime,
        log: PathBuf,
        demand: Demand,
        build_differences: Vec<String>,
    ) -> Self {
        Self {
            pilot,
            start,
            last: start,
            sequence: 0,
            closed: false,
            pending: VecDeque::new(),
            report: Report {
                log,
                demand,
                build_differences,
                verdict: Verdict::NothingToCompare,
                log_end: String::new(),
                duration_s: 0.0,
                inputs: 0,
                outputs: 0,
                outputs_identical: 0,
                output_bytes: 0,
                worst_difference: 0.0,
                rounding_flips: 0,
                first_difference: None,
                holes: Vec::new(),
            },
        }
    }

    fn take(&mut self, entry: Entry) {
        match entry {
            Entry::Input { sequence, at, input } => {
                self.step(sequence, at);
                if self.report.holes.is_empty() {
                    self.pilot.handle(at, input.as_input());
                    self.report.inputs += 1;
                    let pending = &mut self.pending;
                    self.pilot
                        .drain_output(|link, bytes| pending.push_back((link, bytes.to_vec())));
                }
            }
            Entry::Output { sequence, at, link, bytes } => {
                self.step(sequence, at);
                if self.report.holes.is_empty() {
                    self.output(sequence, at, link, &bytes);
                }
            }
            Entry::Hole(pb::Hole {
                from_us,
                to_us,
                first_sequence,
                last_sequence,
                lost_raw,
                lost_topics,
            }) => {
                // Decoded records alone may be missing: the replay does without them.
                if lost_raw > 0 {
                    let since = |us| HostTime::from_us(us).seconds_since(self.start);
                    let (from_s, to_s) = (since(from_us), since(to_us));
                    self.report.holes.push(Hole { from_s, to_s, lost_raw, lost_topics });
                    self.sequence = self.sequence.max(last_sequence).max(first_sequence);
                }
            }
            Entry::Closing(_) => self.closed = true,
            Entry::Decoded(_) => {}
        }
    }

    /// Numbers must follow one another; a gap that the recorder did not own up to is a hole too.
    fn step(&mut self, sequence: u64, at: HostTime) {
        // A hole may claim any number, the largest too.
        let expected = self.sequence.saturating_add(1);
        if sequence > expected {
            self.report.holes.push(Hole {
                from_s: self.last.seconds_since(self.start),
                to_s: at.seconds_since(self.start),
                lost_raw: sequence - expected,
                lost_topics: 0,
            });
        }
        self.sequence = sequence;
        self.last = self.last.max(at);
    }

    fn output(&mut self, sequence: u64, at: HostTime, link: LinkId, recorded: &[u8]) {
        self.report.outputs += 1;
        self.report.output_bytes += recorded.len() as u64;
        let differs = match self.pending.pop_front() {
            None => Some("recorded, but the replay sends nothing".to_owned()),
            Some((replayed_link, _)) if replayed_link != link => {
                Some(format!("the replay sends on link {} instead", replayed_link.number()))
            }
            Some((_, replayed)) if replayed == recorded => {
                self.report.outputs_identical += 1;
                None
            }
            Some((_, replayed)) => self.judge(link, recorded, &replayed),
        };
        if let Some(what) = differs {
            self.differ(sequence, at, link, what);
        }
    }

    /// Bytes that are not the same: `Some` with the reason when the demand is not met.
    fn judge(&mut self, link: LinkId, recorded: &[u8], replayed: &[u8]) -> Option<String> {
        if link != LinkId::Tag && without_signatures(recorded) == without_signatures(replayed) {
            self.report.outputs_identical += 1;
            return None;
        }
        match compare(recorded, replayed) {
            Agreement::Numbers { worst, rounding_flips, what } => {
                self.report.worst_difference = self.report.worst_difference.max(worst);
                self.report.rounding_flips += rounding_flips;
                let met = self.report.demand == Demand::Decoded && worst <= TOLERANCE;
                (!met).then_some(what)
            }
            Agreement::None(what) => Some(what),
        }
    }

    fn differ(&mut self, sequence: u64, at: HostTime, link: LinkId, what: String) {
        let time_s = at.seconds_since(self.start);
        self.report.first_difference.get_or_insert(Difference {
            sequence,
            time_s,
            link: link.number(),
            what,
        });
    }

    fn finish(mut self, end: &LogEnd) -> Report {
        // A log that was closed holds every output; one that was cut ends anywhere.
        // So may the recovered copy of one, and a part of a log: these do not hold the recorder's
        // last word.
        if *end == LogEnd::Complete
            && self.closed
            && self.report.holes.is_empty()
            && let Some((link, bytes)) = self.pending.pop_front()
        {
            let what = format!(
                "the replay sends {} bytes more than were recorded, in {} pieces",
                bytes.len(),
                1 + self.pending.len()
            );
            self.differ(self.sequence, self.last, link, what);
        }
        let report = &mut self.report;
        report.log_end = end.to_string();
        report.duration_s = self.last.seconds_since(self.start);
        report.verdict = if report.first_difference.is_some() {
            Verdict::Different
        } else if !report.holes.is_empty() {
            Verdict::OnlyToHole
        } else if report.outputs == 0 {
            Verdict::NothingToCompare
        } else if report.outputs_identical == report.outputs {
            Verdict::Identical
        } else {
            Verdict::WithinTolerance
        };
        self.report
    }
}

impl std::fmt::Display for Report {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let verdict = match self.verdict {
            Verdict::Identical => "reproduced bit for bit",
            Verdict::WithinTolerance => "reproduced within the tolerance for another build",
            Verdict::Different => "NOT reproduced",
            Verdict::OnlyToHole => "reproduced up to a hole in the log, not checked behind it",
            Verdict::NothingToCompare => "not checked: the log holds no output",
        };
        writeln!(f, "{}: {verdict}", self.log.display())?;
        match self.demand {
            Demand::BitExact => writeln!(f, "  demand: same build and processor, every byte")?,
            Demand::Decoded => writeln!(
                f,
                "  demand: decoded messages within {TOLERANCE:e} ({})",
                self.build_differences.join("; ")
            )?,
        }
        writeln!(
            f,
            "  {:.3} s, log {}; {} inputs fed, {} outputs compared ({} bytes), {} identical",
            self.duration_s,
            self.log_end,
            self.inputs,
            self.outputs,
            self.output_bytes,
            self.outputs_identical
        )?;
        if self.worst_difference > 0.0 || self.rounding_flips > 0 {
            writeln!(
                f,
                "  worst decoded difference {:.3e}, {} whole numbers rounded the other way",
                self.worst_difference, self.rounding_flips
            )?;
        }
        for hole in &self.holes {
            writeln!(
                f,
                "  hole from {:.3} to {:.3} s: {} inputs and outputs are missing",
                hole.from_s, hole.to_s, hole.lost_raw
            )?;
        }
        if let Some(difference) = &self.first_difference {
            writeln!(
                f,
                "  first difference at {:.6} s, link {}, entry {}: {}",
                difference.time_s, difference.link, difference.sequence, difference.what
            )?;
        }
        Ok(())
    }
}
