//! Bytes on their way out: one buffer, in order, with the sequence number of each link.

use haltere_dialect::mav::haltere::MavMessage;
use haltere_dialect::mav_stream;

use super::LinkId;

/// MAVLink address of a sender.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Address {
    pub system_id: u8,
    pub component_id: u8,
}

/// Collects what one call to the core wants sent.
#[derive(Debug, Default)]
pub(super) struct Outbox {
    bytes: Vec<u8>,
    /// Link and end of its piece in `bytes`.
    pieces: Vec<(LinkId, usize)>,
    /// Next sequence number per link: clients count gaps per link as loss.
    sequences: Vec<(LinkId, u8)>,
}

impl Outbox {
    /// Queues bytes as they are.
    pub fn raw(&mut self, link: LinkId, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
        self.pieces.push((link, self.bytes.len()));
    }

    /// Queues a message as a MAVLink 2 frame.
    pub fn message(&mut self, link: LinkId, from: Address, message: &MavMessage) {
        let sequence = self.next_sequence(link);
        mav_stream::encode(&mut self.bytes, from.system_id, from.component_id, sequence, message);
        self.pieces.push((link, self.bytes.len()));
    }

    /// Queues a payload that the dialect has no type for.
    pub fn payload(&mut self, link: LinkId, from: Address, msg_id: u32, payload: &[u8]) {
        let sequence = self.next_sequence(link);
        mav_stream::encode_payload(
            &mut self.bytes,
            from.system_id,
            from.component_id,
            sequence,
            msg_id,
            payload,
        );
        self.pieces.push((link, self.bytes.len()));
    }

    fn next_sequence(&mut self, link: LinkId) -> u8 {
        let slot = match self.sequences.iter().position(|(l, _)| *l == link) {
            Some(i) => i,
            None => {
                self.sequences.push((link, 0));
                self.sequences.len() - 1
            }
        };
        let sequence = self.sequences[slot].1;
        self.sequences[slot].1 = sequence.wrapping_add(1);
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
