//! Everything that went out, matched with what the replay sends by link and message.
//!
//! Two builds may send the same at another place: one more request to the board moves everything behind it, and
//! changes every sequence number of its link. So a message is looked for among those of its kind that were sent
//! at about the same time, and what is left over on either side is counted. Setpoints for the board carry the time of
//! their step, so a step is compared with the same step.

use std::collections::{BTreeMap, VecDeque};

use haltere_dialect::mav::haltere::SET_ATTITUDE_TARGET_DATA;
use haltere_dialect::mav_stream::{MavSplitter, name_of_id};
use serde::Serialize;

use super::compare::{Agreement, TOLERANCE, compare_messages, without_signatures};
use super::setpoints::{self, SetpointReport, target_of};
use haltere_core::time::HostTime;
use haltere_pilot::LinkId;

/// The same message sent so much earlier or later is the same message, µs: streams of 1 Hz may shift by their period.
const WINDOW_US: i64 = 1_000_000;
/// Messages whose numbers differ are the same one only within so much, µs: two control steps, as bytes that come
/// between two wake-ups are answered at the second.
pub(super) const SAME_US: i64 = 20_000;

/// Outputs of a kind on one side that wait: ten times those of the busiest link in that time. So many in so short a time
/// are of a log whose time stands still.
const MOST_WAITING: usize = 10_000;
/// The last moment there is.
const LAST: HostTime = HostTime::from_us(u64::MAX);

/// Messages of one kind that have no counterpart.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct OtherTraffic {
    /// Number of the link: 0 tag, 1 board, 2 and up ground endpoints.
    pub link: u8,
    /// Name of the message; `bytes` for what is none.
    pub message: String,
    /// Sent by both, with another content.
    pub differ: u64,
    /// Recorded, and not sent by the replay.
    pub missing: u64,
    /// Sent by the replay alone.
    pub additional: u64,
}

impl OtherTraffic {
    /// All of them.
    pub fn count(&self) -> u64 {
        self.differ + self.missing + self.additional
    }
}

/// One output.
#[derive(Debug)]
struct Piece {
    sequence: u64,
    at: HostTime,
    bytes: Vec<u8>,
    /// Sender and payload, if it is one whole frame; else the bytes.
    content: Vec<u8>,
    setpoint: Option<SET_ATTITUDE_TARGET_DATA>,
}

/// Outputs of one kind that wait for their counterpart.
#[derive(Debug, Default)]
struct Waiting {
    recorded: VecDeque<Piece>,
    replayed: VecDeque<Piece>,
    lost: u64,
    gained: u64,
}

/// Link and message (`None`: not one whole frame), and whether it is a setpoint.
type Kind = (LinkId, Option<u32>, bool);

/// A difference: place in the log, time, link, words.
pub(super) type Odd = (u64, HostTime, LinkId, String);

/// Both sides.
#[derive(Debug)]
pub(super) struct Traffic {
    start: HostTime,
    /// Setpoints may be so far apart.
    tolerance: f64,
    kinds: BTreeMap<Kind, Waiting>,
    /// Time of the newest wake-up.
    newest: HostTime,
    /// Outputs of which both sent the same bytes.
    pub identical: u64,
    /// Largest difference of a number of those that agree.
    pub worst: f64,
    pub rounding_flips: u64,
    /// What the board was told to do.
    pub setpoints: SetpointReport,
    pub first: Option<Odd>,
}

impl Traffic {
    pub fn new(start: HostTime, exact: bool) -> Self {
        Self {
            start,
            tolerance: if exact { 0.0 } else { TOLERANCE },
            kinds: BTreeMap::new(),
            newest: HostTime::default(),
            identical: 0,
            worst: 0.0,
            rounding_flips: 0,
            setpoints: SetpointReport::default(),
            first: None,
        }
    }

    pub fn recorded(&mut self, sequence: u64, at: HostTime, link: LinkId, bytes: &[u8]) {
        let (kind, piece) = piece(sequence, at, link, bytes);
        let waiting = self.kinds.entry(kind).or_default();
        waiting.recorded.push_back(piece);
        if waiting.recorded.len() > MOST_WAITING {
            self.judge(LAST, LAST);
        }
    }

    /// `sequence`: of the input that it follows.
    pub fn replayed(&mut self, sequence: u64, at: HostTime, link: LinkId, bytes: &[u8]) {
        let (kind, piece) = piece(sequence, at, link, bytes);
        let waiting = self.kinds.entry(kind).or_default();
        waiting.replayed.push_back(piece);
        // Where both send, those that were recorded reach their bound first, with each its counterpart.
        if waiting.replayed.len() > 2 * MOST_WAITING {
            self.judge(LAST, LAST);
        }
    }

    /// Judges what is so old that its counterpart must have come.
    pub fn settle(&mut self, now: HostTime) {
        self.newest = now;
        self.judge(now.offset_us(-WINDOW_US), LAST);
    }

    /// A wake-up, before its outputs. Where time runs back, as in a log that was put together of parts, nothing more
    /// will come of what waits.
    pub fn woken(&mut self, now: HostTime) {
        if now < self.newest {
            self.judge(LAST, LAST);
        }
    }

    /// Judges everything. `until`: what the replay sends from then on was not recorded any more.
    pub fn end(&mut self, until: HostTime) {
        self.judge(LAST, until);
    }

    /// What found no counterpart beside the setpoints, most first.
    pub fn left_over(&self) -> Vec<OtherTraffic> {
        let kinds =
            self.kinds.iter().filter(|((.., setpoint), w)| !setpoint && w.lost + w.gained > 0);
        let mut rows: Vec<_> = kinds
            .map(|((link, id, _), w)| {
                let differ = w.lost.min(w.gained);
                OtherTraffic {
                    link: link.number(),
                    message: id.map_or_else(|| "bytes".to_owned(), name),
                    differ,
                    missing: w.lost - differ,
                    additional: w.gained - differ,
                }
            })
            .collect();
        rows.sort_by_key(|row| std::cmp::Reverse(row.count()));
        rows
    }

    fn judge(&mut self, due: HostTime, until: HostTime) {
        let mut kinds = std::mem::take(&mut self.kinds);
        for ((link, ..), waiting) in &mut kinds {
            while waiting.recorded.front().is_some_and(|piece| piece.at <= due) {
                let Some(piece) = waiting.recorded.pop_front() else { break };
                match &piece.setpoint {
                    Some(target) => self.step(*link, &piece, target, waiting),
                    None => self.message(*link, &piece, waiting),
                }
            }
            // Those that a later recorded one may still be the counterpart of stay.
            while waiting.replayed.front().is_some_and(|piece| piece.at.offset_us(WINDOW_US) <= due)
            {
                let Some(piece) = waiting.replayed.pop_front().filter(|piece| piece.at < until)
                else {
                    continue;
                };
                waiting.gained += 1;
                let what = if piece.setpoint.is_some() {
                    self.setpoints.additional += 1;
                    "the replay sends a setpoint, none was recorded".to_owned()
                } else {
                    format!("the replay sends more than was recorded: {}", words(&piece))
                };
                self.odd(*link, &piece, what);
            }
        }
        self.kinds = kinds;
    }

    /// A recorded setpoint.
    fn step(
        &mut self,
        link: LinkId,
        piece: &Piece,
        target: &SET_ATTITUDE_TARGET_DATA,
        waiting: &mut Waiting,
    ) {
        let stamp = |p: &Piece| p.setpoint.as_ref().map(|other| other.time_boot_ms);
        let same = |p: &Piece| stamp(p) == Some(target.time_boot_ms);
        let replayed = &mut waiting.replayed;
        let Some(other) = replayed.iter().position(same).and_then(|i| replayed.remove(i)) else {
            self.setpoints.missing += 1;
            return self.odd(link, piece, "recorded, but the replay sends no setpoint".to_owned());
        };
        self.setpoints.compared += 1;
        if without_signatures(&other.bytes) == without_signatures(&piece.bytes) {
            self.identical += 1;
            return;
        }
        let Some(sent) = &other.setpoint else { return };
        let (worst, agree) = setpoints::beside(target, sent, self.tolerance, &mut self.setpoints);
        if agree {
            self.worst = self.worst.max(worst);
        } else {
            self.setpoints.differ += 1;
            self.odd(link, piece, format!("recorded {target:?}, replayed {sent:?}"));
        }
    }

    /// Another recorded output.
    fn message(&mut self, link: LinkId, piece: &Piece, waiting: &mut Waiting) {
        match counterpart(piece, &mut waiting.replayed) {
            Some(Found::Same { bytes }) => self.identical += u64::from(bytes),
            Some(Found::Near { worst, flips }) => {
                self.worst = self.worst.max(worst);
                self.rounding_flips += flips;
            }
            None => {
                waiting.lost += 1;
                let beside = waiting.replayed.iter().find(|p| is_within(p, piece, WINDOW_US));
                let what = match beside {
                    Some(beside) => {
                        format!("recorded {}, replayed {}", words(piece), words(beside))
                    }
                    None => format!("recorded, but the replay does not send {}", words(piece)),
                };
                self.odd(link, piece, what);
            }
        }
    }

    /// Keeps the earliest difference.
    fn odd(&mut self, link: LinkId, piece: &Piece, what: String) {
        if piece.setpoint.is_some() {
            let at_s = piece.at.seconds_since(self.start);
            self.setpoints.first_s = Some(self.setpoints.first_s.map_or(at_s, |s| s.min(at_s)));
        }
        if self.first.as_ref().is_none_or(|(sequence, ..)| piece.sequence < *sequence) {
            self.first = Some((piece.sequence, piece.at, link, what));
        }
    }
}

enum Found {
    /// The same message, and whether byte for byte.
    Same { bytes: bool },
    /// The same but for numbers within the tolerance.
    Near { worst: f64, flips: u64 },
}

/// Takes the counterpart of a recorded output out of what the replay sent.
fn counterpart(piece: &Piece, replayed: &mut VecDeque<Piece>) -> Option<Found> {
    let same = |p: &Piece| p.content == piece.content && is_within(p, piece, WINDOW_US);
    if let Some(other) = replayed.iter().position(same).and_then(|i| replayed.remove(i)) {
        let bytes = without_signatures(&other.bytes) == without_signatures(&piece.bytes);
        return Some(Found::Same { bytes });
    }
    let near = replayed.iter().enumerate().filter(|(_, p)| is_within(p, piece, SAME_US));
    let found = near.map(|(i, p)| (i, compare_messages(&piece.bytes, &p.bytes))).find_map(
        |(i, agreement)| match agreement {
            Agreement::Numbers { worst, rounding_flips, .. } if worst <= TOLERANCE => {
                Some((i, Found::Near { worst, flips: rounding_flips }))
            }
            _ => None,
        },
    );
    let (i, found) = found?;
    replayed.remove(i);
    Some(found)
}

fn is_within(a: &Piece, b: &Piece, most_us: i64) -> bool {
    a.at.offset_us(most_us) >= b.at && b.at.offset_us(most_us) >= a.at
}

fn piece(sequence: u64, at: HostTime, link: LinkId, bytes: &[u8]) -> (Kind, Piece) {
    let (id, content) = match frame(link, bytes) {
        Some((id, content)) => (Some(id), content),
        None => (None, bytes.to_vec()),
    };
    let setpoint = target_of(link, bytes);
    let kind = (link, id, setpoint.is_some());
    (kind, Piece { sequence, at, bytes: bytes.to_vec(), content, setpoint })
}

/// Id, and sender with payload, if the bytes are one whole frame and nothing else.
fn frame(link: LinkId, bytes: &[u8]) -> Option<(u32, Vec<u8>)> {
    if link == LinkId::Tag {
        return None;
    }
    let mut frames = MavSplitter::new();
    frames.push(bytes);
    let frame = frames.next()?.ok()?;
    let mut content = vec![frame.header.system_id, frame.header.component_id];
    content.extend_from_slice(frame.payload);
    let id = frame.header.msg_id;
    (frame.raw.len() == bytes.len()).then_some((id, content))
}

/// For people.
fn words(piece: &Piece) -> String {
    let mut frames = MavSplitter::new();
    frames.push(&piece.bytes);
    match frames.next().and_then(Result::ok).and_then(|frame| frame.decode().ok()) {
        Some(message) => format!("{message:?}"),
        None => format!("{:02x?}, which is no MAVLink message", piece.bytes),
    }
}

fn name(id: u32) -> String {
    name_of_id(id).map_or_else(|| format!("message {id}"), str::to_owned)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A log that was put together of parts of one flight filled the memory: what waits was never old enough.
    #[test]
    fn regress_what_waits_is_bounded_where_time_runs_back_or_stands_still() {
        for still in [false, true] {
            let mut traffic = Traffic::new(HostTime::default(), false);
            let mut most = 0;
            for round in 0..40 {
                for step in 0..1_000_u64 {
                    let at = HostTime::from_us(if still { 7 } else { step * 10_000 });
                    let bytes = [round, step.to_le_bytes()[0]];
                    traffic.woken(at);
                    traffic.replayed(step, at, LinkId::Board, &bytes);
                    traffic.settle(at);
                    traffic.recorded(step, at, LinkId::Board, &bytes);
                    let waiting =
                        traffic.kinds.values().map(|w| w.recorded.len() + w.replayed.len());
                    most = most.max(waiting.sum());
                }
            }
            traffic.end(LAST);
            assert_eq!(traffic.identical, 40_000, "{:?}", traffic.first);
            let bound = if still { 2 * MOST_WAITING } else { 250 };
            assert!(most <= bound + 2, "{most} wait");
        }
    }
}
