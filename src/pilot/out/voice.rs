//! What people are told: texts to every station and into the log, and no more of them than can be read.

use haltere_core::drops::DropReason;
use haltere_core::time::HostTime;
use haltere_core::topics::{TextRecord, Topic};

use crate::Pilot;
use crate::input::LinkId;
use crate::stations::telemetry;

/// People are told again that frames are kept out after this time, s.
const KEPT_OUT_TELL_S: f64 = 10.0;
/// Control steps of the first second, in which tag and board are being found.
const FIRST_STEPS: u64 = 1_000_000 / crate::schedule::CONTROL_PERIOD_US.cast_unsigned();

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

impl Pilot {
    /// Tells the people at one station, and the log.
    pub(crate) fn say_to(&mut self, at: HostTime, link: LinkId, severity: Severity, text: &str) {
        self.out.text_id = self.out.text_id.wrapping_add(1).max(1);
        telemetry::send_text(
            &mut self.out.outbox,
            self.out.own,
            link,
            severity as u8,
            text,
            self.out.text_id,
        );
        let text = text.to_owned();
        self.record(|| Topic::Text(TextRecord { at, severity: severity as u8, text }));
    }

    /// Whether one more text may be said that others have caused. If not, that is counted.
    pub(crate) fn may_echo(&mut self, at: HostTime) -> bool {
        let may = self.out.echoes.take(at);
        if !may {
            let core = self.out.drops.len() - 1;
            self.out.drops[core].add(DropReason::TextLimited, 1);
        }
        may
    }

    /// Tells people: to every station and into the log.
    pub(crate) fn say(&mut self, at: HostTime, severity: Severity, text: String) {
        if self.out.answering && severity == Severity::Warning && !self.may_echo(at) {
            return;
        }
        // Who asks at once is told that it is too early, which is no matter of concern.
        let early = self.out.answering && self.clock.control_steps < FIRST_STEPS;
        let severity =
            if early && severity == Severity::Warning { Severity::Info } else { severity };
        self.out.text_id = self.out.text_id.wrapping_add(1).max(1);
        for ground in self.stations.grounds.iter().filter(|g| g.is_open) {
            telemetry::send_text(
                &mut self.out.outbox,
                self.out.own,
                ground.link,
                severity as u8,
                &text,
                self.out.text_id,
            );
        }
        self.record(|| Topic::Text(TextRecord { at, severity: severity as u8, text }));
    }

    /// Somebody who means well would wait for ever otherwise.
    pub(crate) fn tell_kept_out(&mut self, at: HostTime, link: LinkId, reason: DropReason) {
        let what = match reason {
            DropReason::MavWrongPeer => return self.tell_other_address(at, link),
            DropReason::MavUnsigned => "unsigned frames are kept out: give the station the key",
            DropReason::MavBadSignature => "frames with another key are kept out",
            DropReason::MavReplayed => "signed frames that come twice or late are kept out",
            DropReason::MavStaleTime => {
                "frames signed over a minute ago are kept out: set the station's clock"
            }
            DropReason::SigningSetup => "a new signing key was refused: signing.setup",
            DropReason::RateLimited => "a station sends more than ground.most_frames_per_s allows",
            _ => return,
        };
        if self.out.told.kept_out_at.is_none_or(|t| at.seconds_since(t) > KEPT_OUT_TELL_S) {
            self.out.told.kept_out_at = Some(at);
            self.say(at, Severity::Warning, format!("link {}: {what}", link.number()));
        }
    }

    /// Somebody speaks from another address than the one that we send to. Told once: every datagram would say so.
    fn tell_other_address(&mut self, at: HostTime, link: LinkId) {
        let is_station = matches!(link, LinkId::Ground(_));
        let told = self.out.told.other_address.get_mut(usize::from(is_station));
        if told.is_none_or(|told| std::mem::replace(told, true)) {
            return;
        }
        let text = if is_station {
            let number = self.ground_mut(link).map_or(0, |g| g.endpoint_number);
            format!(
                "a station is not heard: it answers from another address than ground.endpoints[{number}] \
                 sends to; write that one, or udpin"
            )
        } else {
            "a board is not heard: it answers from another address than board.address; write that one, or udpin"
                .to_owned()
        };
        self.say(at, Severity::Warning, text);
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
