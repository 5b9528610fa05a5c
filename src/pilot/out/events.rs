//! Events: what happened, as numbers that a station puts into words, and none of which is lost.
//!
//! Source: the guide's "Events Interface" page, and the receiver of the libevents project. Events
//! count in one sequence; a station that misses one asks for it. They go to the links whose stream
//! CURRENT_EVENT_SEQUENCE is on: all of identity `px4`, and whoever asks for that stream. Texts that
//! say the same end in a TAB there, by which such stations know not to show them twice (STATIONS.md).

use std::collections::VecDeque;

use haltere_dialect::mav::haltere::{
    CURRENT_EVENT_SEQUENCE_DATA, EVENT_DATA, MavEventCurrentSequenceFlags, MavEventErrorReason,
    MavMessage, REQUEST_EVENT_DATA, RESPONSE_EVENT_ERROR_DATA,
};

use haltere_core::time::HostTime;

use super::voice::Severity;
use super::{OWN_COMPONENT, Out};
use crate::input::LinkId;

/// CURRENT_EVENT_SEQUENCE.
pub const SEQUENCE_ID: u32 = 411;
/// Events that can be asked for again: several reports of all checks.
const MOST_KEPT: usize = 40;
/// Most events that are sent again for one request.
const MOST_AGAIN: u16 = 20;
/// State of the service.
#[derive(Debug, Default)]
pub(crate) struct Events {
    kept: VecDeque<EVENT_DATA>,
    /// Number of the newest event.
    newest: u16,
}

/// Arguments of an event, one after another.
fn packed(parts: &[&[u8]]) -> [u8; 40] {
    let mut arguments = [0; 40];
    for (slot, byte) in arguments.iter_mut().zip(parts.iter().copied().flatten()) {
        *slot = *byte;
    }
    arguments
}

/// The id of an event on the wire.
fn wire_id(number: u32) -> u32 {
    u32::from(OWN_COMPONENT) << 24 | number
}

/// How grave an event is, for the vehicle's log and for people.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Level(u8);

impl Level {
    /// What is no news for people (LogLevel::Protocol).
    pub const PROTOCOL: Self = Self(8 << 4 | 8);
}

impl From<Severity> for Level {
    fn from(severity: Severity) -> Self {
        Self((severity as u8) << 4 | severity as u8)
    }
}

impl Out {
    /// Tells what happened, by its number in `events.json`.
    pub(crate) fn event(&mut self, at: HostTime, number: u32, level: Level, parts: &[&[u8]]) {
        let events = &mut self.events;
        events.newest = events.newest.wrapping_add(1);
        let event = EVENT_DATA {
            id: wire_id(number),
            event_time_boot_ms: (at.as_us() / 1000) as u32,
            sequence: events.newest,
            destination_component: 0,
            destination_system: 0,
            log_levels: level.0,
            arguments: packed(parts),
        };
        if events.kept.len() == MOST_KEPT {
            events.kept.pop_front();
        }
        events.kept.push_back(event.clone());
        let message = MavMessage::EVENT(event);
        for n in 0..self.listeners.len() {
            if self.listeners[n].is_open && self.listeners[n].wants_events {
                self.message(self.listeners[n].link, &message);
            }
        }
    }

    /// CURRENT_EVENT_SEQUENCE. `is_known`: the station has been told where the numbers stand; the first on a link says
    /// that they have begun anew.
    pub(crate) fn event_sequence(&self, is_known: bool) -> MavMessage {
        let flags = if is_known {
            MavEventCurrentSequenceFlags::empty()
        } else {
            MavEventCurrentSequenceFlags::MAV_EVENT_CURRENT_SEQUENCE_FLAGS_RESET
        };
        let sequence = self.events.newest;
        MavMessage::CURRENT_EVENT_SEQUENCE(CURRENT_EVENT_SEQUENCE_DATA { sequence, flags })
    }

    /// REQUEST_EVENT: again what was lost on the way.
    pub(crate) fn events_again(
        &mut self,
        link: LinkId,
        peer: (u8, u8),
        request: &REQUEST_EVENT_DATA,
    ) {
        let count = request.last_sequence.wrapping_sub(request.first_sequence);
        for offset in 0..=count.min(MOST_AGAIN - 1) {
            let sequence = request.first_sequence.wrapping_add(offset);
            let events = &self.events;
            let message = match events.kept.iter().find(|e| e.sequence == sequence) {
                Some(event) => MavMessage::EVENT(event.clone()),
                None => MavMessage::RESPONSE_EVENT_ERROR(RESPONSE_EVENT_ERROR_DATA {
                    sequence,
                    sequence_oldest_available: events
                        .kept
                        .front()
                        .map_or(events.newest, |e| e.sequence),
                    target_system: peer.0,
                    target_component: peer.1,
                    reason: MavEventErrorReason::MAV_EVENT_ERROR_REASON_UNAVAILABLE,
                }),
            };
            self.message(link, &message);
        }
    }
}
