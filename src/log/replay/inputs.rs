//! Whether what a log holds fits together: no entry twice or out of its order, no time that runs back, no counter
//! that jumps.
//!
//! For a log of another build this is all that can be asked of it: that build alone sends the same bytes again.

use haltere_dialect::mav_stream::MavSplitter;

use crate::record::{Decoded, Entry, RawInput, pb};
use haltere_core::time::HostTime;
use haltere_pilot::LinkId;

/// An input that is stamped so much later than the wake-up behind it does not belong there, µs: the clock is read
/// for both within a millisecond.
const AHEAD_US: i64 = 1_000_000;
/// Our component on the board's link (INTERFACES.md section 2).
const COMPANION: u8 = 191;
/// Contradictions that are told; the rest is counted.
const MOST_TOLD: usize = 5;
/// Wake-ups, and counts of control steps, that wait to be held against one another: 40 s of a flight, of which one
/// count a second is told; what is decoded stands within a second of its wake-up.
const MOST_WAITING: usize = 4_096;

/// Reads along.
#[derive(Debug)]
pub(super) struct Inputs {
    start: HostTime,
    sequence: u64,
    last_wake: HostTime,
    newest_input: HostTime,
    /// Sequence number of our newest frame to the board.
    to_board: Option<u8>,
    /// Control steps as told, by time, and the times of wake-ups: what is decoded may stand behind or before them.
    steps: Vec<(HostTime, u64)>,
    wakes: Vec<HostTime>,
    told: Vec<String>,
    more: u64,
}

impl Inputs {
    pub fn new(start: HostTime) -> Self {
        Self {
            start,
            sequence: 0,
            last_wake: start,
            newest_input: start,
            to_board: None,
            steps: Vec::new(),
            wakes: Vec::new(),
            told: Vec::new(),
            more: 0,
        }
    }

    /// One entry.
    pub fn take(&mut self, entry: &Entry) {
        match entry {
            Entry::Input { sequence, at, input } => {
                self.count(*sequence, *at);
                if *input == RawInput::Wake {
                    self.wake(*at);
                } else {
                    self.newest_input = self.newest_input.max(*at);
                }
            }
            Entry::Output { sequence, at, link, bytes } => {
                self.count(*sequence, *at);
                if *link == LinkId::Board {
                    self.frames(*at, bytes);
                }
            }
            Entry::Decoded(Decoded::Health(health)) => self.health(health),
            Entry::Hole(hole) => {
                self.sequence = self.sequence.max(hole.last_sequence);
                self.begin_anew();
            }
            Entry::Closing(closing) => {
                if closing.last_sequence < self.sequence {
                    let (last, end) = (closing.last_sequence, self.sequence);
                    self.say(format!("the log was closed at entry {last}, and ends at {end}"));
                }
            }
            Entry::Decoded(_) => {}
        }
    }

    /// What does not fit, for people.
    pub fn end(mut self) -> Vec<String> {
        self.count_steps();
        if self.more > 0 {
            self.told.push(format!("and {} contradictions more", self.more));
        }
        self.told
    }

    fn count(&mut self, sequence: u64, at: HostTime) {
        if sequence <= self.sequence {
            let (at_s, last) = (self.seconds(at), self.sequence);
            self.say(format!("at {at_s:.2} s: entry {sequence} stands behind entry {last}"));
        } else if sequence - self.sequence > 1 {
            self.begin_anew();
        }
        self.sequence = self.sequence.max(sequence);
    }

    /// Something is missing, which the replay tells.
    fn begin_anew(&mut self) {
        self.to_board = None;
        self.count_steps();
    }

    fn wake(&mut self, at: HostTime) {
        self.wakes.push(at);
        self.settle();
        let at_s = self.seconds(at);
        if at < self.last_wake {
            let by_s = self.last_wake.seconds_since(at);
            self.say(format!("at {at_s:.2} s: the time of wake-ups runs back by {by_s:.3} s"));
        } else if self.newest_input > at.offset_us(AHEAD_US) {
            let by_s = self.newest_input.seconds_since(at);
            self.say(format!(
                "at {at_s:.2} s: an input is stamped {by_s:.3} s after the wake-up behind it"
            ));
        }
        self.newest_input = at;
        self.last_wake = at;
    }

    /// Our frames to the board are numbered without a gap; what is passed on has a sender of its own.
    fn frames(&mut self, at: HostTime, bytes: &[u8]) {
        let mut frames = MavSplitter::new();
        frames.push(bytes);
        while let Some(found) = frames.next() {
            let Ok(frame) = found else { continue };
            if frame.header.component_id != COMPANION {
                continue;
            }
            let number = frame.header.sequence;
            let before = self.to_board.replace(number);
            if let Some(before) = before.filter(|before| before.wrapping_add(1) != number) {
                let at_s = self.seconds(at);
                self.say(format!(
                    "at {at_s:.2} s: frame {number} to the board follows frame {before}"
                ));
            }
        }
    }

    fn health(&mut self, health: &pb::Health) {
        self.steps.push((HostTime::from_us(health.at_us), health.control_steps));
        self.settle();
    }

    /// Where much waits, all but the newest count and the wake-ups that it may need are looked at.
    fn settle(&mut self) {
        if self.wakes.len().max(self.steps.len()) < MOST_WAITING {
            return;
        }
        let newest = self.steps.pop();
        let before = self.steps.last().copied();
        let kept = before.map(|(since, _)| {
            self.wakes.iter().copied().filter(|at| *at > since).collect::<Vec<_>>()
        });
        self.count_steps();
        // Where no count has come for long, nothing can be held against the wake-ups since.
        if let Some(kept) = kept.filter(|kept| kept.len() < MOST_WAITING / 2) {
            self.steps.extend(before.into_iter().chain(newest));
            self.wakes = kept;
        }
    }

    /// No more control steps than wake-ups: otherwise wake-ups are missing. Looked at up to a hole, or the end.
    fn count_steps(&mut self) {
        let (steps, wakes) = (std::mem::take(&mut self.steps), std::mem::take(&mut self.wakes));
        for pair in steps.windows(2) {
            let [(from, before), (to, now)] = pair else { continue };
            let since = now.saturating_sub(*before);
            // Times of a damaged log may be in any order.
            let until = |end: &HostTime| wakes.partition_point(|at| at <= end);
            let woken = until(to).saturating_sub(until(from));
            if since > woken as u64 {
                let at_s = self.seconds(*to);
                self.say(format!(
                    "at {at_s:.2} s: {since} control steps were counted, and {woken} wake-ups recorded"
                ));
            }
        }
    }

    fn seconds(&self, at: HostTime) -> f64 {
        at.seconds_since(self.start)
    }

    fn say(&mut self, what: String) {
        if self.told.len() < MOST_TOLD {
            self.told.push(what);
        } else {
            self.more += 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Wake-ups at 100 Hz with a count of control steps each second; of some second a wake-up is missing.
    fn hours(count_s: u64, missing_at_s: Option<u64>) -> Inputs {
        let mut inputs = Inputs::new(HostTime::from_us(0));
        let mut sequence = 0;
        for s in 1..=count_s {
            for step in 0..100 {
                if step == 50 && missing_at_s == Some(s) {
                    continue;
                }
                let at = HostTime::from_us(s * 1_000_000 + step * 10_000);
                sequence += 1;
                inputs.take(&Entry::Input { sequence, at, input: RawInput::Wake });
            }
            let at_us = s * 1_000_000 + 990_000;
            let health = pb::Health { at_us, control_steps: s * 100, ..pb::Health::default() };
            inputs.take(&Entry::Decoded(Decoded::Health(health)));
        }
        inputs
    }

    #[test]
    fn regress_what_waits_is_bounded_however_long_the_log() {
        let whole = hours(2_000, None);
        assert!(whole.wakes.len().max(whole.steps.len()) < MOST_WAITING);
        assert_eq!(whole.end(), [] as [&str; 0]);
        for at_s in [2, 39, 40, 41, 1_000, 2_000] {
            let told = hours(2_000, Some(at_s)).end();
            let says = "100 control steps were counted, and 99 wake-ups recorded";
            assert!(told.len() == 1 && told[0].contains(says), "{at_s} s: {told:?}");
        }
        // Nothing but wake-ups: nothing is held against them.
        let mut bare = Inputs::new(HostTime::from_us(0));
        for sequence in 1..=10_000 {
            let at = HostTime::from_us(sequence * 10_000);
            bare.take(&Entry::Input { sequence, at, input: RawInput::Wake });
        }
        assert!(bare.wakes.len() < MOST_WAITING);
        assert_eq!(bare.end(), [] as [&str; 0]);
    }
}
