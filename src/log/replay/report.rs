//! What a replay came to, for people and scripts.

use std::path::PathBuf;

use serde::Serialize;

use super::compare::TOLERANCE;
use super::setpoints::SetpointReport;
use super::traffic::OtherTraffic;

/// What must agree.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Demand {
    /// Same build, same processor: every byte.
    #[default]
    BitExact,
    /// Another build or processor: decoded messages, within [`TOLERANCE`].
    Decoded,
}

/// What came of it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Every byte is the same.
    Identical,
    /// Another build, and decoded messages agree.
    WithinTolerance,
    /// Outputs differ by more than the demand allows.
    Different,
    /// The same up to a hole in the log or damage of it; behind it nothing can be said.
    OnlyToHole,
    /// The log holds no output to compare with.
    #[default]
    NothingToCompare,
}

/// What differs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Differs {
    /// The setpoints for the board agree, and something else that was sent does not.
    OtherTraffic,
    /// What the board was told to do.
    Setpoints,
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
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
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
    /// Recorded time, what is missing or damaged included as far as the log tells it, s.
    pub duration_s: f64,
    /// Of this, replayed and compared, s.
    pub compared_s: f64,
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
    /// Holes, the first of them. Nothing is compared behind the first.
    pub holes: Vec<Hole>,
    /// Those that are not listed.
    pub more_holes: u64,
    /// Whether the build that wrote the log was made of the same source, so that nothing may differ.
    pub same_source: bool,
    /// What differs; absent: nothing.
    pub differs: Option<Differs>,
    /// What the board was told to do.
    pub setpoints: SetpointReport,
    /// Everything else that has no counterpart, by link and message, most first.
    pub other_traffic: Vec<OtherTraffic>,
    /// Where inputs do not fit one another: places, times, counters.
    pub input_faults: Vec<String>,
}

impl Report {
    /// Before the first entry.
    pub fn new(
        log: PathBuf,
        demand: Demand,
        build_differences: Vec<String>,
        same_source: bool,
    ) -> Self {
        Self { log, demand, build_differences, same_source, ..Self::default() }
    }

    /// One hole more; a damaged log may have any number.
    pub(super) fn hole(&mut self, hole: Hole) {
        if self.holes.len() < MOST_HOLES {
            self.holes.push(hole);
        } else {
            self.more_holes += 1;
        }
    }

    /// Other traffic that differs, in words; `None`: none does.
    pub fn other_traffic_words(&self) -> Option<String> {
        let count: u64 = self.other_traffic.iter().map(OtherTraffic::count).sum();
        let kinds: Vec<_> =
            self.other_traffic.iter().take(MOST_KINDS).map(ToString::to_string).collect();
        let more = match self.other_traffic.len().saturating_sub(MOST_KINDS) {
            0 => String::new(),
            n => format!(", and {n} kinds more"),
        };
        let s = if count == 1 { "" } else { "s" };
        (count > 0).then(|| format!("{count} message{s}: {}{more}", kinds.join(", ")))
    }

    /// 0 reproduced, 3 different, 4 only partly checked.
    pub fn exit_code(&self) -> u8 {
        match self.verdict {
            Verdict::Identical | Verdict::WithinTolerance => 0,
            Verdict::Different => 3,
            Verdict::OnlyToHole | Verdict::NothingToCompare => 4,
        }
    }
}

impl std::fmt::Display for Report {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: ", self.log.display())?;
        match self.verdict {
            Verdict::Identical => writeln!(f, "reproduced bit for bit")?,
            Verdict::WithinTolerance => {
                writeln!(f, "reproduced within the tolerance for another build")?;
            }
            Verdict::Different => writeln!(f, "NOT reproduced")?,
            Verdict::OnlyToHole => writeln!(
                f,
                "NOT checked whole: {:.1} s flown, {:.1} s compared, and these are reproduced; behind them the log {}",
                self.duration_s,
                self.compared_s,
                if self.holes.is_empty() { "is damaged" } else { "has a hole" }
            )?,
            Verdict::NothingToCompare => writeln!(f, "not checked: the log holds no output")?,
        }
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
        match self.differs {
            Some(Differs::Setpoints) => writeln!(f, "  setpoints differ: {}", self.setpoints)?,
            Some(Differs::OtherTraffic) if self.setpoints.compared == 0 => {
                writeln!(f, "  no setpoints: the vehicle was never armed")?;
            }
            Some(Differs::OtherTraffic) => {
                writeln!(f, "  setpoints agree, all {} of them", self.setpoints.compared)?;
            }
            None => {}
        }
        if let Some(words) = self.other_traffic_words() {
            writeln!(f, "  other traffic differs: {words}")?;
        }
        for fault in &self.input_faults {
            writeln!(f, "  inputs do not fit: {fault}")?;
        }
        for hole in &self.holes {
            writeln!(
                f,
                "  hole from {:.3} to {:.3} s: {} inputs and outputs are missing",
                hole.from_s, hole.to_s, hole.lost_raw
            )?;
        }
        if self.more_holes > 0 {
            writeln!(f, "  and {} holes more", self.more_holes)?;
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

impl std::fmt::Display for SetpointReport {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { compared, differ, missing, additional, worst_deg, worst_thrust_frac, first_s } =
            self;
        write!(
            f,
            "{differ} of {compared}, by up to {worst_deg:.2} deg and {worst_thrust_frac:.3} of thrust"
        )?;
        if missing + additional > 0 {
            write!(f, "; {missing} are not sent by the replay, {additional} more are")?;
        }
        match first_s {
            Some(s) => write!(f, "; from {s:.2} s on"),
            None => Ok(()),
        }
    }
}

impl std::fmt::Display for OtherTraffic {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { link, message, differ, missing, additional } = self;
        write!(f, "{message} on link {link}")?;
        for (count, what) in [(differ, "otherwise"), (missing, "not sent"), (additional, "more")] {
            if *count > 0 {
                write!(f, " {count} {what}")?;
            }
        }
        Ok(())
    }
}

/// Holes that are told.
const MOST_HOLES: usize = 64;
/// Kinds of messages that are told.
const MOST_KINDS: usize = 6;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn regress_a_log_of_any_number_of_holes_is_told_in_some_lines() {
        let mut report = Report::new(PathBuf::new(), Demand::BitExact, Vec::new(), true);
        for _ in 0..5_000 {
            report.hole(Hole { from_s: 0.0, to_s: 1.0, lost_raw: 1, lost_topics: 0 });
        }
        let text = report.to_string();
        assert!(text.lines().count() < 80 && text.contains("and 4936 holes more"), "{text}");
    }
}
