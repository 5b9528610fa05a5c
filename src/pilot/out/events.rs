//! Events: what happened, as numbers that a station puts into words, and none of which is lost.
//!
//! Source: the guide's "Events Interface" page, and the receiver of the libevents project. Events
//! count in one sequence; a station that misses one asks for it. They go to the links whose stream
//! CURRENT_EVENT_SEQUENCE is on: all of identity `px4`, and whoever asks for that stream. Texts that
//! say the same end in a TAB there, by which such stations know not to show them twice (GROUND.md).

use std::collections::VecDeque;

use haltere_dialect::mav::haltere::{
    CURRENT_EVENT_SEQUENCE_DATA, EVENT_DATA, MavEventCurrentSequenceFlags, MavEventErrorReason,
    MavMessage, REQUEST_EVENT_DATA, RESPONSE_EVENT_ERROR_DATA,
};

use haltere_core::time::HostTime;
use haltere_core::topics::{TextRecord, Topic};

use super::event_list as list;
use super::voice::Severity;
use crate::Pilot;
use crate::flight::at_rest::{AT_REST, Look, Quantity};
use crate::flight::change::Cause;
use crate::flight::modes::Mode;
use crate::input::LinkId;
use crate::stations::mission_transfer::Client;
use crate::stations::telemetry::send_text;

/// CURRENT_EVENT_SEQUENCE.
pub const SEQUENCE_ID: u32 = 411;
/// Events that can be asked for again: several reports of all checks.
const MOST_KEPT: usize = 40;
/// Least time between two reports of the checks, s: states that flicker must not fill a link.
const REPORT_S: f64 = 1.0;
/// Most events that are sent again for one request.
const MOST_AGAIN: u16 = 20;
/// Log level of what is no news for people (LogLevel::Protocol), for the vehicle's log and for them.
const PROTOCOL: u8 = 8 << 4 | 8;

/// State of the service.
#[derive(Debug, Default)]
pub(crate) struct Events {
    kept: VecDeque<EVENT_DATA>,
    /// Number of the newest event.
    newest: u16,
    /// Checks that failed, and that warned, when they were last reported, as bits of health.
    reported: Option<(u32, u32)>,
    reported_at: HostTime,
}

fn level(severity: Severity) -> u8 {
    (severity as u8) << 4 | severity as u8
}

/// Arguments of an event, one after another.
fn packed(parts: &[&[u8]]) -> [u8; 40] {
    let mut arguments = [0; 40];
    for (slot, byte) in arguments.iter_mut().zip(parts.iter().copied().flatten()) {
        *slot = *byte;
    }
    arguments
}

impl Pilot {
    fn wants_events(&mut self, link: LinkId) -> bool {
        self.ground_mut(link).is_some_and(|g| g.is_open && g.streams.interval_us(SEQUENCE_ID) > 0)
    }

    fn event(&mut self, at: HostTime, number: u32, log_levels: u8, parts: &[&[u8]]) {
        let events = &mut self.stations.services.events;
        events.newest = events.newest.wrapping_add(1);
        let event = EVENT_DATA {
            id: list::wire_id(number),
            event_time_boot_ms: (at.as_us() / 1000) as u32,
            sequence: events.newest,
            destination_component: 0,
            destination_system: 0,
            log_levels,
            arguments: packed(parts),
        };
        if events.kept.len() == MOST_KEPT {
            events.kept.pop_front();
        }
        events.kept.push_back(event.clone());
        let message = MavMessage::EVENT(event);
        for n in 0..self.stations.grounds.len() {
            let link = self.stations.grounds[n].link;
            if self.wants_events(link) {
                self.out.outbox.message(link, self.out.own, &message);
            }
        }
    }

    /// Tells that the mode has changed: as an event, and as a text.
    pub(crate) fn tell_transition(&mut self, at: HostTime, from: Mode, to: Mode, cause: Cause) {
        let Cause { because, severity, number } = cause;
        let (from_number, to_number) = (list::mode_number(from), list::mode_number(to));
        let arguments = [from_number, to_number, number];
        self.event(at, list::MODE_CHANGED, level(severity), &[&arguments]);
        let text = format!("{}: {because}", to.name());
        self.out.text_id = self.out.text_id.wrapping_add(1).max(1);
        let id = self.out.text_id;
        for n in 0..self.stations.grounds.len() {
            let link = self.stations.grounds[n].link;
            if !self.stations.grounds[n].is_open {
                continue;
            }
            if self.wants_events(link) {
                send_text(
                    &mut self.out.outbox,
                    self.out.own,
                    link,
                    severity as u8,
                    &format!("{text}\t"),
                    id,
                );
            } else {
                send_text(&mut self.out.outbox, self.out.own, link, severity as u8, &text, id);
            }
        }
        self.record(|| Topic::Text(TextRecord { at, severity: severity as u8, text }));
    }

    /// Tells that a condition of the supervisor's list begins or ends, as an event.
    pub(crate) fn condition_event(
        &mut self,
        at: HostTime,
        index: usize,
        begins: bool,
        severity: Severity,
    ) {
        let number = if begins { list::CONDITION_BEGINS } else { list::CONDITION_ENDS };
        let argument = [u8::try_from(index).unwrap_or(u8::MAX)];
        self.event(at, number, level(severity), &[&argument]);
    }

    /// CURRENT_EVENT_SEQUENCE. The first on a link says that the numbers have begun anew.
    pub(crate) fn event_sequence(&mut self, link: LinkId) -> MavMessage {
        let is_known = self
            .ground_mut(link)
            .is_some_and(|g| std::mem::replace(&mut g.event_sequence_told, true));
        let flags = if is_known {
            MavEventCurrentSequenceFlags::empty()
        } else {
            MavEventCurrentSequenceFlags::MAV_EVENT_CURRENT_SEQUENCE_FLAGS_RESET
        };
        let sequence = self.stations.services.events.newest;
        MavMessage::CURRENT_EVENT_SEQUENCE(CURRENT_EVENT_SEQUENCE_DATA { sequence, flags })
    }

    /// REQUEST_EVENT: again what was lost on the way.
    pub(crate) fn events_again(&mut self, client: Client, request: &REQUEST_EVENT_DATA) {
        let count = request.last_sequence.wrapping_sub(request.first_sequence);
        for offset in 0..=count.min(MOST_AGAIN - 1) {
            let sequence = request.first_sequence.wrapping_add(offset);
            let events = &self.stations.services.events;
            let message = match events.kept.iter().find(|e| e.sequence == sequence) {
                Some(event) => MavMessage::EVENT(event.clone()),
                None => MavMessage::RESPONSE_EVENT_ERROR(RESPONSE_EVENT_ERROR_DATA {
                    sequence,
                    sequence_oldest_available: events
                        .kept
                        .front()
                        .map_or(events.newest, |e| e.sequence),
                    target_system: client.peer.0,
                    target_component: client.peer.1,
                    reason: MavEventErrorReason::MAV_EVENT_ERROR_REASON_UNAVAILABLE,
                }),
            };
            self.out.outbox.message(client.link, self.out.own, &message);
        }
    }

    /// Once a control step: reports the checks when one of them has changed. In flight nobody arms.
    pub(crate) fn event_tick(&mut self, at: HostTime) {
        let events = &self.stations.services.events;
        if self.flight.mode != Mode::Disarmed
            || events.reported.is_some() && at.seconds_since(events.reported_at) < REPORT_S
        {
            return;
        }
        self.report_checks(at, false);
    }

    /// The report of all checks; `anyway`: even if nothing has changed.
    pub(crate) fn report_checks(&mut self, at: HostTime, anyway: bool) {
        let (mut failed, mut warned): (Vec<&Quantity>, Vec<&Quantity>) = Default::default();
        for (row, look) in self.at_rest(at) {
            match look {
                Look::Refused(_) => failed.push(row),
                Look::Told(_) => warned.push(row),
                Look::Fits(_) => {}
            }
        }
        let of = |rows: &[&Quantity]| rows.iter().map(|row| list::health_bit(row)).sum::<u32>();
        let (errors, warnings) = (of(&failed), of(&warned));
        let events = &mut self.stations.services.events;
        events.reported_at = at;
        if events.reported.replace((errors, warnings)) == Some((errors, warnings)) && !anyway {
            return;
        }
        let all = AT_REST.iter().map(list::health_bit).sum::<u32>();
        let modes = list::all_modes();
        let can = if failed.is_empty() { modes } else { 0 };
        let [errors, all, warnings, modes, can] =
            [errors, all, warnings, modes, can].map(|word: u32| word.to_le_bytes());
        self.event(at, list::ARMING_SUMMARY, PROTOCOL, &[&[0], &errors, &warnings, &can, &can]);
        let failed = failed.into_iter().map(|row| (row, Severity::Error));
        let warned = warned.into_iter().map(|row| (row, Severity::Warning));
        for (row, severity) in failed.chain(warned) {
            let index = list::health_index(row);
            let number = list::FIRST_CHECK + u32::from(index) - 1;
            self.event(at, number, level(severity), &[&modes, &[index]]);
        }
        self.event(at, list::HEALTH_SUMMARY, PROTOCOL, &[&[0], &all, &errors, &warnings]);
    }
}
