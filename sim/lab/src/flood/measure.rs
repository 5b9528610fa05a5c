//! What the companion wrote down about its own time, by phase.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use haltere_core::time::HostTime;
use haltere_log::record::{Entry, LogReader, RawInput};
use haltere_pilot::LinkId;

/// Period of the control step, µs: its deadlines lie on this grid from the core's start.
const PERIOD_US: u64 = 10_000;
/// A step later than this is late, µs: half a period, as the companion counts.
const LATE_US: u64 = 5_000;

/// One phase of the flight.
#[derive(Debug, Default)]
pub struct Phase {
    pub steps: u64,
    pub late: u64,
    /// When every step was due and when it began, µs, the most punctual first.
    steps_us: Vec<[u64; 2]>,
    pub longest_pause_ms: f64,
    /// Bytes of stations that reached the core.
    pub input_B: u64,
    /// Losses that the glue told, by reason, and all together.
    pub drops: BTreeMap<&'static str, u64>,
    pub dropped: u64,
    last: Option<HostTime>,
}

impl Phase {
    pub fn late_share(&self) -> f64 {
        self.late as f64 / self.steps.max(1) as f64
    }

    /// Lateness that this share of the steps does not exceed, ms.
    pub fn lateness_ms(&self, share: f64) -> f64 {
        let last = self.steps_us.len().saturating_sub(1);
        let at = (share * last as f64).round() as usize;
        self.steps_us.get(at).map_or(f64::NAN, |[due, began]| (began - due) as f64 * 1e-3)
    }

    /// Lateness of each step without what `stood_us` gives for the time from due to begun, ms.
    pub fn lateness_without(&self, stood_us: impl Fn(u64, u64) -> u64) -> Vec<f64> {
        let own_us = |[due, began]: &[u64; 2]| (began - due).saturating_sub(stood_us(*due, *began));
        self.steps_us.iter().map(|step| own_us(step) as f64 * 1e-3).collect()
    }

    fn sort(&mut self) {
        self.steps_us.sort_unstable_by_key(|[due, began]| began - due);
    }

    /// Both together.
    pub fn join(mut self, other: Self) -> Self {
        self.steps += other.steps;
        self.late += other.late;
        self.steps_us.extend(other.steps_us);
        self.sort();
        self.longest_pause_ms = self.longest_pause_ms.max(other.longest_pause_ms);
        self.input_B += other.input_B;
        self.dropped += other.dropped;
        for (reason, count) in other.drops {
            *self.drops.entry(reason).or_default() += count;
        }
        self
    }

    fn step(&mut self, at: HostTime, start: HostTime) {
        // A step that is late by more than a period has lost its grid point; the pause shows it.
        let late_us = at.as_us().wrapping_sub(start.as_us()) % PERIOD_US;
        self.steps += 1;
        self.steps_us.push([at.as_us().saturating_sub(late_us), at.as_us()]);
        let pause_us = self.last.map_or(0, |last| at.as_us().saturating_sub(last.as_us()));
        self.late += u64::from(late_us > LATE_US || pause_us > PERIOD_US + LATE_US);
        self.longest_pause_ms = self.longest_pause_ms.max(pause_us as f64 * 1e-3);
        self.last = Some(at);
    }
}

/// The phases between these times, µs.
pub fn phases(log: &Path, windows_us: &[[u64; 2]]) -> Result<Vec<Phase>> {
    let reader = LogReader::open(log)?;
    let start = reader.session().pilot_started_at;
    let mut phases: Vec<Phase> = windows_us.iter().map(|_| Phase::default()).collect();
    for entry in reader.entries() {
        let Entry::Input { at, input, .. } = entry else { continue };
        let us = at.as_us();
        let window = windows_us.iter().position(|[from, to]| (*from..*to).contains(&us));
        let Some(phase) = window.and_then(|n| phases.get_mut(n)) else { continue };
        match input {
            RawInput::Wake => phase.step(at, start),
            RawInput::Bytes { link: LinkId::Ground(_), bytes } => {
                phase.input_B += bytes.len() as u64;
            }
            RawInput::Lost { reason, count, .. } => {
                *phase.drops.entry(reason.name()).or_default() += count;
                phase.dropped += count;
            }
            _ => {}
        }
    }
    phases.iter_mut().for_each(Phase::sort);
    Ok(phases)
}
