//! What people are told: texts to every station and into the log, and no more of them than can be read.

use haltere_dialect::mav::haltere::{MavMessage, STATUSTEXT_DATA};

use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;
use haltere_core::topics::{TextRecord, Topic};

use super::{Listener, Out};
use crate::input::LinkId;

/// MAVLink severities in use.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub(crate) enum Severity {
    Emergency = 0,
    Critical = 2,
    Error = 3,
    Warning = 4,
    Info = 6,
}

/// Length of the text field of STATUSTEXT.
const TEXT_CHUNK: usize = 50;

impl Out {
    /// Tells the people at one station, and the log.
    pub(crate) fn say_to(&mut self, at: HostTime, link: LinkId, severity: Severity, text: &str) {
        let id = self.next_text_id();
        self.send_text(link, severity, text, id);
        self.record_text(at, severity, text.to_owned());
    }

    /// Whether one more text may be said that others have caused. If not, that is counted.
    pub(crate) fn may_echo(&mut self, at: HostTime) -> bool {
        let may = self.echoes.take(at);
        if !may {
            let core = self.drops.len() - 1;
            self.drops[core].add(DropReason::TextLimited, 1);
        }
        may
    }

    /// Tells people: to every station and into the log.
    pub(crate) fn say(&mut self, at: HostTime, severity: Severity, text: String) {
        if self.answering && severity == Severity::Warning && !self.may_echo(at) {
            return;
        }
        // Who asks at once is told that it is too early, which is no matter of concern.
        let early = self.answering && self.is_starting;
        let severity =
            if early && severity == Severity::Warning { Severity::Info } else { severity };
        let id = self.next_text_id();
        for n in 0..self.listeners.len() {
            if self.listeners[n].is_open {
                self.send_text(self.listeners[n].link, severity, &text, id);
            }
        }
        self.record_text(at, severity, text);
    }

    /// The same in words and as an event: stations that know events are told by a TAB not to show the words twice.
    pub(crate) fn say_of_event(&mut self, at: HostTime, severity: Severity, text: String) {
        let id = self.next_text_id();
        for n in 0..self.listeners.len() {
            let Listener { link, is_open, wants_events, .. } = self.listeners[n];
            if !is_open {
                continue;
            }
            if wants_events {
                self.send_text(link, severity, &format!("{text}\t"), id);
            } else {
                self.send_text(link, severity, &text, id);
            }
        }
        self.record_text(at, severity, text);
    }

    /// Tells it once for a link and a reason.
    pub(crate) fn tell_once(
        &mut self,
        at: HostTime,
        link: LinkId,
        reason: DropReason,
        text: String,
    ) {
        if !self.told.unheard.contains(&(link, reason)) {
            self.told.unheard.push((link, reason));
            self.say(at, Severity::Warning, text);
        }
    }

    fn next_text_id(&mut self) -> u16 {
        self.text_id = self.text_id.wrapping_add(1).max(1);
        self.text_id
    }

    fn record_text(&mut self, at: HostTime, severity: Severity, text: String) {
        self.record(|| Topic::Text(TextRecord { at, severity: severity as u8, text }));
    }

    /// Sends a text, in chunks if it is long.
    fn send_text(&mut self, link: LinkId, severity: Severity, text: &str, id: u16) {
        let bytes = text.as_bytes();
        let chunked = bytes.len() > TEXT_CHUNK;
        // A text that fills its last chunk exactly needs an empty one to end it.
        let end = if chunked && bytes.len().is_multiple_of(TEXT_CHUNK) {
            bytes.len() + 1
        } else {
            bytes.len()
        };
        for (chunk_seq, start) in (0..end.max(1)).step_by(TEXT_CHUNK).enumerate().take(255) {
            let mut field = [0; TEXT_CHUNK];
            let piece = bytes.get(start..bytes.len().min(start + TEXT_CHUNK)).unwrap_or(&[]);
            field[..piece.len()].copy_from_slice(piece);
            let message = MavMessage::STATUSTEXT(STATUSTEXT_DATA {
                severity: severity as u8,
                text: field.into(),
                id: if chunked { id } else { 0 },
                chunk_seq: chunk_seq as u8,
            });
            self.message(link, &message);
        }
    }
}

/// Words that others cause, such as those about a refusal: a client that asks a thousand times a second
/// must not fill every station's line and the log with them. What the vehicle says by itself is not held
/// back.
#[derive(Debug)]
pub(crate) struct Echoes {
    left: f64,
    at: HostTime,
}

impl Echoes {
    /// Texts at once, and in a second.
    const MOST: f64 = 30.0;
    const PER_S: f64 = 5.0;

    pub fn new(at: HostTime) -> Self {
        Self { left: Self::MOST, at }
    }

    fn take(&mut self, at: HostTime) -> bool {
        let filled = at.seconds_since(self.at).max(0.0) * Self::PER_S;
        self.left = (self.left + filled).min(Self::MOST);
        self.at = at;
        let some = self.left >= 1.0;
        if some {
            self.left -= 1.0;
        }
        some
    }
}
