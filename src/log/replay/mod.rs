//! Replay: lives through a recorded flight again and says whether the same bytes go out.
//!
//! The core is built from the recorded configuration and survey and fed with the recorded inputs,
//! losses and wake-ups in their order. With the same build on the same processor every outgoing
//! byte must be the same (signatures excluded: keys are never stored). With another build decoded
//! messages must agree within [`TOLERANCE`], each with one of its link and kind. Either way it is said whether
//! the setpoints for the board agree, which a diagnosis rests on, or something else that was sent differs.

mod again;
mod airborne;
mod compare;
mod in_order;
mod inputs;
mod parameters;
mod report;
mod setpoints;
#[cfg(test)]
mod tests;
mod traffic;

use std::path::{Path, PathBuf};

use thiserror::Error;

use self::airborne::Airborne;
use self::in_order::InOrder;
use self::inputs::Inputs;
use self::traffic::Traffic;
use crate::record::{
    BuildIdentity, Entry, FlightPart, Flights, LogEnd, LogError, LogReader, RawInput, pb,
};
use haltere_core::checks::Problems;
use haltere_core::time::HostTime;
use haltere_core::topics::Topic;
use haltere_pilot::settings::Config;
use haltere_pilot::{LinkId, Mission, Pilot};

pub use again::live_again;
pub use compare::TOLERANCE;
pub use parameters::{ParameterChange, changed_parameters};
pub use report::{Demand, Difference, Differs, Hole, Report, Verdict};
pub use setpoints::{Setpoint, SetpointReport, setpoint_of};
pub use traffic::OtherTraffic;

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

/// Replays one log.
pub fn replay(path: &Path) -> Result<Report, ReplayError> {
    replay_log(&LogReader::open(path)?)
}

/// Replays a log that is read already.
pub fn replay_log(log: &LogReader) -> Result<Report, ReplayError> {
    replay_with(log, None).map(|(report, _)| report)
}

/// The same, and hands out what the core tells about itself in one part of the log: one that was recorded
/// without decoded topics has them again, and they are those of this build. Also gives the mission
/// that was in force at the end of that flight.
pub fn replay_observed(
    log: &LogReader,
    part: &FlightPart,
    mut watch: impl FnMut(Topic),
) -> Result<(Report, Mission), ReplayError> {
    replay_with(log, Some((part.clone(), &mut watch)))
}

/// The flights of a log: as it tells, or where it holds no changes of mode, as a replay tells.
pub fn flights(log: &LogReader) -> Result<Flights, ReplayError> {
    let recorded = Flights::recorded(log);
    if recorded.any_change() {
        return Ok(recorded);
    }
    let mut modes = Vec::new();
    let mut mode = |topic| {
        if let Topic::Mode(m) = topic {
            modes.push((m.at, m.mode));
        }
    };
    let (report, _) = replay_with(log, Some((FlightPart::whole(), &mut mode)))?;
    let end = log.session().pilot_started_at.offset_us((report.duration_s * 1e6) as i64);
    Ok(Flights::replayed(&modes, end))
}

/// The configuration that was flown.
pub fn recorded_config(log: &LogReader) -> Result<Config, ReplayError> {
    let session = log.session();
    Config::as_recorded("recorded configuration", &session.config_toml)
        .and_then(|mut config| {
            config.limits.resolve_to_anchors(&session.survey);
            let mut problems = Problems::new();
            config.check("", &mut problems);
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
    mut watch: Option<(FlightPart, &mut dyn FnMut(Topic))>,
) -> Result<(Report, Mission), ReplayError> {
    let session = log.session();
    let config = recorded_config(log)?;
    let here = BuildIdentity::current();
    let build_differences = here.differences(&session.build);
    let same_source = here.source_hash == session.build.source_hash;
    let demand = if build_differences.is_empty() { Demand::BitExact } else { Demand::Decoded };
    let start = session.pilot_started_at;
    let pilot = Pilot::new(config.pilot(), session.survey.clone(), start);
    let pilot = if watch.is_some() { pilot } else { pilot.without_topics() };
    let report = Report::new(log.path().to_owned(), demand, build_differences, same_source);
    let airborne = if same_source { Airborne::default() } else { Airborne::flown(log) };
    let mut run = Run::new(pilot, start, report, airborne);
    // What the core told is told by the replay; of what the log says of it, changes of mode bound a flight and counts of steps must fit.
    let mut entries = log.entries_with(|channel| matches!(channel, "/mode" | "/health"));
    let mut mission = None;
    for entry in entries.by_ref() {
        let Some((part, watch)) = &mut watch else {
            run.take(&entry);
            continue;
        };
        part.holds(&entry);
        run.take(&entry);
        run.pilot.drain_topics(|topic| {
            if part.holds_topic(&topic) {
                watch(topic);
            }
        });
        if part.is_over() && mission.is_none() {
            mission = Some(run.pilot.mission().clone());
        }
    }
    let mission = mission.unwrap_or_else(|| run.pilot.mission().clone());
    Ok((run.finish(&entries.end()), mission))
}

struct Run {
    pilot: Pilot,
    start: HostTime,
    last: HostTime,
    last_output: HostTime,
    /// Up to there everything was fed and compared.
    compared: HostTime,
    sequence: u64,
    /// The recorder said that this is all.
    closed: bool,
    airborne: Airborne,
    inputs: Inputs,
    /// Of the same build alone.
    in_order: Option<InOrder>,
    traffic: Traffic,
    report: Report,
}

impl Run {
    fn new(pilot: Pilot, start: HostTime, report: Report, airborne: Airborne) -> Self {
        let exact = report.demand == Demand::BitExact;
        Self {
            pilot,
            start,
            last: start,
            last_output: start,
            compared: start,
            sequence: 0,
            closed: false,
            airborne,
            inputs: Inputs::new(start),
            in_order: exact.then(InOrder::default),
            traffic: Traffic::new(start, exact),
            report,
        }
    }

    fn take(&mut self, entry: &Entry) {
        self.inputs.take(entry);
        match entry {
            Entry::Input { sequence, at, input } => {
                self.step(*sequence, *at);
                if self.report.holes.is_empty() {
                    self.input(*sequence, *at, input);
                }
            }
            Entry::Output { sequence, at, link, bytes } => {
                self.step(*sequence, *at);
                if self.report.holes.is_empty() {
                    self.output(*sequence, *at, *link, bytes);
                }
            }
            Entry::Hole(hole) => {
                let pb::Hole {
                    from_us,
                    to_us,
                    first_sequence,
                    last_sequence,
                    lost_raw,
                    lost_topics,
                } = *hole;
                // Decoded records alone may be missing: the replay does without them.
                if lost_raw > 0 {
                    let since = |us| HostTime::from_us(us).seconds_since(self.start);
                    let (from_s, to_s) = (since(from_us), since(to_us));
                    self.last = self.last.max(HostTime::from_us(to_us));
                    self.report.hole(Hole { from_s, to_s, lost_raw, lost_topics });
                    self.sequence = self.sequence.max(last_sequence).max(first_sequence);
                }
            }
            Entry::Closing(closing) => self.closing(closing),
            Entry::Decoded(_) => {}
        }
    }

    /// The recorder's last word says how many there were.
    fn closing(&mut self, closing: &pb::Closing) {
        self.closed = true;
        let lost_raw = closing.last_sequence.saturating_sub(self.sequence);
        if lost_raw > 0 {
            let at = HostTime::from_us(closing.host_time_us).max(self.last);
            let [from_s, to_s] = [self.last, at].map(|t| t.seconds_since(self.start));
            self.last = at;
            self.report.hole(Hole { from_s, to_s, lost_raw, lost_topics: 0 });
        }
    }

    /// Numbers must follow one another; a gap that the recorder did not own up to is a hole too.
    fn step(&mut self, sequence: u64, at: HostTime) {
        // A hole may claim any number, the largest too.
        let expected = self.sequence.saturating_add(1);
        if sequence > expected {
            self.report.hole(Hole {
                from_s: self.last.seconds_since(self.start),
                to_s: at.seconds_since(self.start),
                lost_raw: sequence - expected,
                lost_topics: 0,
            });
        }
        self.sequence = sequence;
        self.last = self.last.max(at);
    }

    fn input(&mut self, sequence: u64, at: HostTime, input: &RawInput) {
        let wakes = *input == RawInput::Wake;
        if wakes {
            self.traffic.woken(at);
        }
        if let Some(airborne) = self.airborne.told(at).filter(|_| wakes) {
            self.pilot.set_airborne_as_flown(airborne);
        }
        self.pilot.handle(at, input.as_input());
        self.report.inputs += 1;
        self.compared = self.compared.max(at);
        let Self { pilot, in_order, traffic, .. } = self;
        pilot.drain_output(|link, bytes| {
            if let Some(in_order) = in_order {
                in_order.replayed(link, bytes);
            }
            traffic.replayed(sequence, at, link, bytes);
        });
        if wakes {
            self.traffic.settle(at);
        }
    }

    fn output(&mut self, sequence: u64, at: HostTime, link: LinkId, recorded: &[u8]) {
        self.report.outputs += 1;
        self.report.output_bytes += recorded.len() as u64;
        self.last_output = at;
        if let Some(differs) = self.in_order.as_mut().and_then(|o| o.recorded(link, recorded)) {
            self.differ(sequence, at, link, differs);
        }
        self.traffic.recorded(sequence, at, link, recorded);
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
        let whole = *end == LogEnd::Complete && self.closed && self.report.holes.is_empty();
        // Of damage without the recorder's last word behind it nobody knows what it cost.
        let unknown = matches!(end, LogEnd::Damaged { .. }) && !self.closed;
        // What is sent between two wake-ups is recorded at the second, which may be the one that was cut.
        let until = if whole {
            HostTime::from_us(u64::MAX)
        } else {
            self.last_output.offset_us(-traffic::SAME_US)
        };
        self.traffic.end(until);
        match self.in_order.take() {
            Some(in_order) => {
                if let Some((link, what)) = in_order.left().filter(|_| whole) {
                    self.differ(self.sequence, self.last, link, what);
                }
                self.report.outputs_identical = in_order.identical;
                self.report.worst_difference = in_order.worst;
                self.report.rounding_flips = in_order.rounding_flips;
            }
            // Another build: each message beside one of its kind.
            None => {
                self.report.outputs_identical = self.traffic.identical;
                self.report.worst_difference = self.traffic.worst;
                self.report.rounding_flips = self.traffic.rounding_flips;
                if let Some((sequence, at, link, what)) = self.traffic.first.take() {
                    self.differ(sequence, at, link, what);
                }
            }
        }
        let report = &mut self.report;
        report.log_end = end.to_string();
        report.duration_s = self.last.seconds_since(self.start);
        report.compared_s = self.compared.seconds_since(self.start);
        report.verdict = if report.first_difference.is_some() {
            Verdict::Different
        } else if !report.holes.is_empty() || unknown {
            Verdict::OnlyToHole
        } else if report.outputs == 0 {
            Verdict::NothingToCompare
        } else if report.outputs_identical == report.outputs {
            Verdict::Identical
        } else {
            Verdict::WithinTolerance
        };
        if report.verdict == Verdict::Different {
            let other = self.traffic.setpoints.agree();
            report.differs = Some(if other { Differs::OtherTraffic } else { Differs::Setpoints });
        }
        report.other_traffic = self.traffic.left_over();
        report.setpoints = self.traffic.setpoints;
        report.input_faults = self.inputs.end();
        self.report
    }
}
