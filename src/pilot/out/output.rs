//! Bytes on their way out: one buffer, in order, with the sequence number of each link.

use haltere_dialect::mav::haltere::{MavCmd, MavMessage};
use haltere_dialect::mav::known;
use haltere_dialect::mav_stream;

use crate::input::LinkId;

/// Most bytes for stations that one drain can find, and pieces: what a client asks for in one burst must
/// not become memory without end. Far above what everything due in one step takes.
const MOST_FOR_STATIONS_B: usize = 1 << 20;

/// MAVLink address of a sender.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Address {
    pub system_id: u8,
    pub component_id: u8,
}

/// What was queued for a link since the counts were last taken.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Sent {
    pub frames: u64,
    pub bytes: usize,
}

#[derive(Debug, Clone, Copy)]
struct PerLink {
    link: LinkId,
    /// Next sequence number: clients count gaps per link as loss.
    sequence: u8,
    sent: Sent,
    /// Frames that found no room.
    refused: u64,
}

/// Collects what one call to the core wants sent.
#[derive(Debug, Default)]
pub(crate) struct Outbox {
    bytes: Vec<u8>,
    /// Link and end of its piece in `bytes`.
    pieces: Vec<(LinkId, usize)>,
    links: Vec<PerLink>,
    /// Only what asks goes to the board.
    shadow: bool,
    /// What was kept from it.
    withheld: u64,
}

impl Outbox {
    /// Of a shadow: whatever the rest of the core wants, nothing goes to the board that arms or moves.
    pub fn of_shadow(shadow: bool) -> Self {
        Self { shadow, ..Self::default() }
    }

    /// Whether a frame is kept from the board; it is counted.
    fn withholds(&mut self, link: LinkId, asks: bool) -> bool {
        let withheld = self.shadow && link == LinkId::Board && !asks;
        self.withheld += u64::from(withheld);
        withheld
    }

    /// Frames that were kept from the board since the last call.
    pub fn take_withheld(&mut self) -> u64 {
        std::mem::take(&mut self.withheld)
    }

    /// Queues bytes as they are.
    pub fn raw(&mut self, link: LinkId, bytes: &[u8]) {
        if self.withholds(link, false) || self.is_full(link) {
            return;
        }
        self.bytes.extend_from_slice(bytes);
        self.finish(link, bytes.len());
    }

    /// Queues a message as a MAVLink 2 frame.
    pub fn message(&mut self, link: LinkId, from: Address, message: &MavMessage) {
        if self.withholds(link, only_asks(message)) || self.is_full(link) {
            return;
        }
        let sequence = self.next_sequence(link);
        let start = self.bytes.len();
        mav_stream::encode(&mut self.bytes, from.system_id, from.component_id, sequence, message);
        self.finish(link, self.bytes.len() - start);
    }

    /// What was queued for a link since the last call.
    pub fn take_sent(&mut self, link: LinkId) -> Sent {
        std::mem::take(&mut self.link(link).sent)
    }

    /// Whether there is no room for a frame to a station. Tag and board always have room: nothing that
    /// a station sends is answered there more than once.
    fn is_full(&mut self, link: LinkId) -> bool {
        let full = matches!(link, LinkId::Ground(_)) && self.bytes.len() >= MOST_FOR_STATIONS_B;
        if full {
            self.link(link).refused += 1;
        }
        full
    }

    /// Frames for a link that found no room since the last call.
    pub fn take_refused(&mut self, link: LinkId) -> u64 {
        std::mem::take(&mut self.link(link).refused)
    }

    fn finish(&mut self, link: LinkId, bytes: usize) {
        self.pieces.push((link, self.bytes.len()));
        let sent = &mut self.link(link).sent;
        sent.frames += 1;
        sent.bytes = sent.bytes.saturating_add(bytes);
    }

    fn link(&mut self, link: LinkId) -> &mut PerLink {
        let slot = match self.links.iter().position(|l| l.link == link) {
            Some(slot) => slot,
            None => {
                self.links.push(PerLink { link, sequence: 0, sent: Sent::default(), refused: 0 });
                self.links.len() - 1
            }
        };
        &mut self.links[slot]
    }

    fn next_sequence(&mut self, link: LinkId) -> u8 {
        let slot = self.link(link);
        let sequence = slot.sequence;
        slot.sequence = sequence.wrapping_add(1);
        sequence
    }

    /// Yields everything in order and forgets it; the memory stays.
    pub fn drain(&mut self, mut send: impl FnMut(LinkId, &[u8])) {
        let mut start = 0;
        for (link, end) in self.pieces.drain(..) {
            send(link, &self.bytes[start..end]);
            start = end;
        }
        self.bytes.clear();
    }
}

/// What may be sent to the board all the same: who we are, what time it is, questions, and how often to answer.
pub(crate) fn only_asks(message: &MavMessage) -> bool {
    match message {
        MavMessage::HEARTBEAT(_) | MavMessage::TIMESYNC(_) | MavMessage::PARAM_REQUEST_READ(_) => {
            true
        }
        MavMessage::COMMAND_LONG(m) => matches!(
            known(m.command),
            Some(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL | MavCmd::MAV_CMD_REQUEST_MESSAGE)
        ),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use haltere_dialect::mav::haltere::COMMAND_LONG_DATA;

    #[test]
    fn prop_nothing_of_a_shadow_arms_or_moves_and_what_is_kept_back_is_counted() {
        let mut out = Outbox::of_shadow(true);
        let from = Address { system_id: 2, component_id: 192 };
        out.raw(LinkId::Board, &[1, 2, 3]);
        out.message(LinkId::Board, from, &MavMessage::SET_ATTITUDE_TARGET(Default::default()));
        out.drain(|link, bytes| panic!("{link:?} {bytes:?}"));
        assert_eq!((out.take_withheld(), out.take_withheld()), (2, 0));
        out.message(LinkId::Board, from, &MavMessage::HEARTBEAT(Default::default()));
        out.raw(LinkId::Ground(0), &[1]);
        out.raw(LinkId::Tag, b"b");
        let mut went = 0;
        out.drain(|_, _| went += 1);
        assert_eq!((went, out.take_withheld()), (3, 0));
    }

    #[test]
    fn prop_what_waits_for_stations_is_bounded_and_the_board_goes_first() {
        let mut out = Outbox::default();
        let piece = [7; 1000];
        for _ in 0..10_000 {
            out.raw(LinkId::Ground(1), &piece);
        }
        out.raw(LinkId::Board, &[1, 2, 3]);
        let (mut stations_B, mut board_B) = (0, 0);
        out.drain(|link, bytes| match link {
            LinkId::Board => board_B += bytes.len(),
            _ => stations_B += bytes.len(),
        });
        assert_eq!(board_B, 3);
        assert!(stations_B <= MOST_FOR_STATIONS_B + piece.len(), "{stations_B}");
        let refused = out.take_refused(LinkId::Ground(1));
        assert_eq!(refused as usize, 10_000 - stations_B / piece.len());
        // Once drained there is room again.
        out.raw(LinkId::Ground(1), &piece);
        assert_eq!(out.take_refused(LinkId::Ground(1)), 0);
    }

    #[test]
    fn prop_only_questions_pass() {
        let command = |command: MavCmd| {
            only_asks(&MavMessage::COMMAND_LONG(COMMAND_LONG_DATA {
                command: command as u16,
                ..Default::default()
            }))
        };
        assert!(command(MavCmd::MAV_CMD_SET_MESSAGE_INTERVAL));
        assert!(command(MavCmd::MAV_CMD_REQUEST_MESSAGE));
        for moves in [
            MavCmd::MAV_CMD_COMPONENT_ARM_DISARM,
            MavCmd::MAV_CMD_DO_SET_MODE,
            MavCmd::MAV_CMD_INJECT_FAILURE,
            MavCmd::MAV_CMD_DO_FLIGHTTERMINATION,
        ] {
            assert!(!command(moves), "{moves:?}");
        }
        assert!(!only_asks(&MavMessage::SET_ATTITUDE_TARGET(Default::default())));
        assert!(!only_asks(&MavMessage::PARAM_SET(Default::default())));
        assert!(!only_asks(&MavMessage::MANUAL_CONTROL(Default::default())));
        assert!(only_asks(&MavMessage::HEARTBEAT(Default::default())));
    }
}
