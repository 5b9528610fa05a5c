//! What is missing of a damaged log: which inputs and outputs, and which seconds.

use super::errors::LogEnd;
use super::messages::{Messages, WalkEnd};
use super::pb;
use super::tail::Tail;
use haltere_core::time::HostTime;

/// Parts that are told; a log may be damaged in any number of places.
const MOST_PARTS: usize = 1024;

/// Reads along with the messages of a log.
#[derive(Debug)]
pub(super) struct Gaps {
    start_us: u64,
    /// Newest input or output.
    last: u64,
    last_us: u64,
    /// Inputs and outputs so far.
    seen: u64,
    /// Of the whole log, as its end tells, and its last moment.
    told: Option<(u64, u64)>,
    /// Places of damage so far.
    places: u64,
    /// One of them may have cost what comes next.
    doubt: bool,
    missing: Vec<[u64; 2]>,
}

impl Gaps {
    pub fn new(start: HostTime, tail: Option<&Tail>) -> Self {
        let start_us = start.as_us();
        Self {
            start_us,
            last: 0,
            last_us: start_us,
            seen: 0,
            told: tail.map(|tail| (tail.inputs_and_outputs(), tail.end_ns / 1000)),
            places: 0,
            doubt: false,
            missing: Vec::new(),
        }
    }

    /// What is missing before a message. `places`: of damage up to there; `sequence` 0: it has none.
    pub fn before(&mut self, places: u64, sequence: u32, time_ns: u64) -> Option<pb::Hole> {
        self.look(places);
        if sequence == 0 {
            return None;
        }
        // The number in front of a message has 32 bits.
        #[allow(clippy::cast_possible_truncation)]
        let step = sequence.wrapping_sub(self.last as u32);
        let ahead = step < u32::MAX / 2;
        let next =
            if ahead { self.last.saturating_add(u64::from(step)) } else { u64::from(sequence) };
        let hole = (ahead && step > 1).then(|| self.hole(next - 1, time_ns / 1000)).flatten();
        self.doubt = false;
        (self.last, self.last_us) = (next, time_ns / 1000);
        self.seen += 1;
        hole
    }

    /// What is missing before the recorder's last word.
    pub fn closing(&mut self, places: u64, closing: &pb::Closing) -> Option<pb::Hole> {
        self.look(places);
        let hole = (closing.last_sequence > self.last)
            .then(|| self.hole(closing.last_sequence, closing.host_time_us))
            .flatten();
        self.doubt = false;
        hole
    }

    /// What is missing behind the last message.
    pub fn at_end(&mut self, messages: &Messages<'_>) -> Option<pb::Hole> {
        self.look(messages.places());
        let latest_us =
            messages.damage().iter().filter_map(|d| d.until_ns).max().map(|ns| ns / 1000);
        let (lost, until_us) = match (self.told, latest_us) {
            (Some((all, end_us)), _) => (all.saturating_sub(self.counted()), end_us),
            (None, Some(until_us)) => (u64::from(until_us > self.last_us), until_us),
            // That the file ends is all that is known.
            (None, None) => return None,
        };
        let hole =
            (lost > 0).then(|| self.hole(self.last.saturating_add(lost), until_us)).flatten();
        self.doubt = false;
        hole
    }

    /// How the log ended.
    pub fn end(&self, messages: &Messages<'_>) -> LogEnd {
        let cut = match messages.end() {
            WalkEnd::Complete => None,
            WalkEnd::Cut(offset) => Some(offset),
            WalkEnd::Unreadable(offset, why) => {
                return LogEnd::Damaged { offset, why, places: 1, missing: Vec::new(), cut: None };
            }
        };
        match (messages.damage().first(), cut) {
            (None, None) => LogEnd::Complete,
            (None, Some(offset)) => LogEnd::Cut { offset },
            (Some(first), cut) => LogEnd::Damaged {
                offset: first.offset,
                why: first.why.clone(),
                places: messages.places(),
                missing: self.missing.clone(),
                cut,
            },
        }
    }

    fn look(&mut self, places: u64) {
        self.doubt |= places > self.places;
        self.places = places;
    }

    /// Those that were found, and those of the holes.
    fn counted(&self) -> u64 {
        self.seen
    }

    fn hole(&mut self, last: u64, to_us: u64) -> Option<pb::Hole> {
        // A part of a log begins late, and what the recorder left out it says itself.
        if !self.doubt {
            return None;
        }
        let first = self.last.saturating_add(1);
        let lost_raw = last.saturating_sub(self.last);
        if self.missing.len() < MOST_PARTS {
            let since = |us: u64| us.saturating_sub(self.start_us);
            self.missing.push([since(self.last_us), since(to_us.max(self.last_us))]);
        }
        self.seen = self.seen.saturating_add(lost_raw);
        let (from_us, last_sequence) = (self.last_us, last);
        (self.last, self.last_us) = (last, to_us.max(self.last_us));
        Some(pb::Hole {
            from_us,
            to_us,
            first_sequence: first,
            last_sequence,
            lost_raw,
            lost_topics: 0,
        })
    }
}
