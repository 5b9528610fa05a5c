//! The payload of FILE_TRANSFER_PROTOCOL: a header of 12 bytes, then up to 239 of data.
//!
//! Source: the guide's "File Transfer Protocol (FTP)" page. Little-endian: sequence number u16,
//! session u8, opcode u8, size u8, opcode asked for u8, burst complete u8, padding u8, offset u32.

use haltere_dialect::mav::haltere::{FILE_TRANSFER_PROTOCOL_DATA, MavFtpErr, MavFtpOpcode};

/// Most data of one payload.
pub const MOST_DATA: usize = 239;
const HEADER: usize = 12;
/// A full reply on the wire, bytes: header 10, payload 254, checksum 2.
pub const FRAME_BYTES: usize = 266;

/// One request or reply.
#[derive(Debug, Clone, PartialEq)]
pub struct Packet {
    pub seq: u16,
    pub session: u8,
    pub opcode: u8,
    /// Of data, or wanted by a read.
    pub size: u8,
    pub asked: u8,
    pub burst_complete: bool,
    pub offset: u32,
    pub data: Vec<u8>,
}

impl Packet {
    /// From the wire. Never longer than what is there.
    pub fn decode(payload: &[u8; 251]) -> Self {
        let at = |i: usize| payload.get(i).copied().unwrap_or_default();
        let size = at(4);
        let data = payload.get(HEADER..HEADER + usize::from(size).min(MOST_DATA));
        Self {
            seq: u16::from_le_bytes([at(0), at(1)]),
            session: at(2),
            opcode: at(3),
            size,
            asked: at(5),
            burst_complete: at(6) != 0,
            offset: u32::from_le_bytes([at(8), at(9), at(10), at(11)]),
            data: data.unwrap_or_default().to_vec(),
        }
    }

    /// For the wire, to a client.
    pub fn encode(
        &self,
        (target_system, target_component): (u8, u8),
    ) -> FILE_TRANSFER_PROTOCOL_DATA {
        let mut payload = [0; 251];
        let [s0, s1] = self.seq.to_le_bytes();
        let [o0, o1, o2, o3] = self.offset.to_le_bytes();
        let complete = u8::from(self.burst_complete);
        let header =
            [s0, s1, self.session, self.opcode, self.size, self.asked, complete, 0, o0, o1, o2, o3];
        for (slot, byte) in payload.iter_mut().zip(header.iter().chain(&self.data)) {
            *slot = *byte;
        }
        FILE_TRANSFER_PROTOCOL_DATA { target_network: 0, target_system, target_component, payload }
    }

    /// The path in the data: up to a zero.
    pub fn path(&self) -> Option<&str> {
        let end = self.data.iter().position(|c| *c == 0).unwrap_or(self.data.len());
        std::str::from_utf8(self.data.get(..end)?).ok()
    }

    /// "Done", with data.
    pub fn ack(&self, data: Vec<u8>) -> Self {
        self.reply(MavFtpOpcode::MAV_FTP_OPCODE_ACK, data)
    }

    /// "No", with the reason.
    pub fn nak(&self, why: MavFtpErr) -> Self {
        self.reply(MavFtpOpcode::MAV_FTP_OPCODE_NAK, vec![why as u8])
    }

    fn reply(&self, opcode: MavFtpOpcode, mut data: Vec<u8>) -> Self {
        data.truncate(MOST_DATA);
        Self {
            seq: self.seq.wrapping_add(1),
            session: self.session,
            opcode: opcode as u8,
            size: data.len() as u8,
            asked: self.opcode,
            burst_complete: false,
            offset: self.offset,
            data,
        }
    }
}

/// FTP requests that change nothing on the disk.
pub(crate) fn reads(opcode: u8) -> bool {
    use MavFtpOpcode as O;
    [
        O::MAV_FTP_OPCODE_NONE,
        O::MAV_FTP_OPCODE_TERMINATESESSION,
        O::MAV_FTP_OPCODE_RESETSESSION,
        O::MAV_FTP_OPCODE_LISTDIRECTORY,
        O::MAV_FTP_OPCODE_OPENFILERO,
        O::MAV_FTP_OPCODE_READFILE,
        O::MAV_FTP_OPCODE_CALCFILECRC,
        O::MAV_FTP_OPCODE_BURSTREADFILE,
    ]
    .into_iter()
    .any(|allowed| allowed as u8 == opcode)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The bytes of the guide's table, by hand: ListDirectory "/", sequence number 258.
    #[test]
    fn val_layout() {
        let mut payload = [0; 251];
        payload[..13].copy_from_slice(&[2, 1, 7, 3, 1, 0, 0, 0, 4, 3, 2, 1, b'/']);
        let packet = Packet::decode(&payload);
        assert_eq!((packet.seq, packet.session, packet.opcode, packet.size), (258, 7, 3, 1));
        assert_eq!((packet.offset, packet.path()), (0x0102_0304, Some("/")));
        assert_eq!(packet.encode((255, 190)).payload, payload);
        let nak = packet.nak(MavFtpErr::MAV_FTP_ERR_EOF);
        assert_eq!((nak.seq, nak.opcode, nak.asked, nak.data), (259, 129, 3, vec![6]));
    }

    #[test]
    fn prop_sizes_that_lie_are_harmless() {
        for size in 0..=255 {
            let mut payload = [b'x'; 251];
            payload[4] = size;
            assert!(Packet::decode(&payload).data.len() <= MOST_DATA);
        }
    }
}
