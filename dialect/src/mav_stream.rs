//! MAVLink frames, versions 1 and 2, in and out of byte streams.
//!
//! The splitter yields every frame, those with unknown ids too, because a router must pass on what
//! it cannot read. The checksum of an unknown id cannot be verified: one byte of its input
//! (CRC_EXTRA) is a property of the message definition. But some value of that byte must exist
//! that fits, which all but one in 256 false frames fail; so unknown ids are held to that.
//!
//! What cannot be avoided: a marker byte inside damaged bytes starts a false frame that passes its
//! checksum by chance (2^-16 for a known id, 2^-8 for an unknown one) and takes the bytes of good
//! frames with it (measured in the tests: below one in a thousand damaged frames). And a byte lost
//! inside the 13 bytes of a signature, which no checksum covers, takes the next marker with it.

use mavlink::{MavlinkVersion, Message, MessageData, error::ParserError};

use crate::crc;
use crate::mav::haltere::{HEARTBEAT_DATA, MavMessage};
use crate::scanner::{Found, Scanner, Verdict};

const MARKER_V1: u8 = 0xFE;
pub(crate) const MARKER_V2: u8 = 0xFD;
const HEADER_V1: usize = 6;
pub(crate) const HEADER_V2: usize = 10;
pub(crate) const CHECKSUM: usize = 2;
/// Link id, 48-bit timestamp and 48-bit signature.
const SIGNATURE: usize = 13;
const MAX_PAYLOAD: usize = 255;
/// The only incompatibility flag we can read: the frame is signed.
pub(crate) const FLAG_SIGNED: u8 = 0x01;

/// Longest frame: version 2, full payload, signed.
pub const MAX_FRAME: usize = HEADER_V2 + MAX_PAYLOAD + CHECKSUM + SIGNATURE;

/// Something lost on a MAVLink link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MavLoss {
    /// Bytes that belong to no frame, those of every frame below included.
    GarbageBytes(usize),
    /// A marker whose frame has a wrong checksum. While damaged bytes are searched, a marker byte
    /// inside them may be counted too.
    BadChecksum {
        /// Id as it stands in the frame.
        msg_id: u32,
    },
    /// The id is in no dialect of ours.
    UnknownId {
        /// The id.
        msg_id: u32,
    },
    /// Intact, but with a value that our definition does not know, such as a new enum entry.
    Undecodable {
        /// The id.
        msg_id: u32,
    },
    /// A marker whose frame flags a feature we cannot read.
    Incompatible,
}

/// Header of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MavHeader {
    /// System that sent it.
    pub system_id: u8,
    /// Component that sent it.
    pub component_id: u8,
    /// Counts the frames of that component, wraps.
    pub sequence: u8,
    /// Id of the message.
    pub msg_id: u32,
    /// Version of the frame.
    pub version: MavlinkVersion,
}

/// A frame in the buffer of its splitter.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MavFrame<'a> {
    /// The header.
    pub header: MavHeader,
    /// The payload as sent: version 2 cuts trailing zeros.
    pub payload: &'a [u8],
    /// The whole frame, marker to checksum or signature.
    pub raw: &'a [u8],
    /// The checksum is right. `false`: the id is unknown, it cannot be verified in full.
    pub checked: bool,
    /// The frame carries a signature, which nobody has verified.
    pub signed: bool,
}

impl MavFrame<'_> {
    /// The message.
    pub fn decode(&self) -> Result<MavMessage, MavLoss> {
        let msg_id = self.header.msg_id;
        if !self.checked {
            return Err(MavLoss::UnknownId { msg_id });
        }
        MavMessage::parse(self.header.version, msg_id, self.payload).map_err(|e| match e {
            ParserError::UnknownMessage { .. } => MavLoss::UnknownId { msg_id },
            _ => MavLoss::Undecodable { msg_id },
        })
    }

    /// Link id and timestamp (10 µs since 2015-01-01) of the signature.
    pub fn signature(&self) -> Option<(u8, u64)> {
        let signature = self.raw.last_chunk::<SIGNATURE>().filter(|_| self.signed)?;
        let [link_id, t0, t1, t2, t3, t4, t5, ..] = *signature;
        Some((link_id, u64::from_le_bytes([t0, t1, t2, t3, t4, t5, 0, 0])))
    }
}

/// The message of a payload alone. `None`: unknown id, or a value that our definition does not know.
pub fn parse_payload(msg_id: u32, payload: &[u8]) -> Option<MavMessage> {
    MavMessage::parse(MavlinkVersion::V2, msg_id, payload).ok()
}

/// Id of a message by its name, such as `RADIO_STATUS`.
pub fn id_of_name(name: &str) -> Option<u32> {
    MavMessage::message_id_from_name(name)
}

/// Name of a message by its id.
pub fn name_of_id(msg_id: u32) -> Option<&'static str> {
    MavMessage::default_message_from_id(msg_id).map(|message| message.message_name())
}

/// System and component that a message is addressed to; 0 is everyone.
pub fn target(message: &MavMessage) -> (u8, u8) {
    (message.target_system_id().unwrap_or(0), message.target_component_id().unwrap_or(0))
}

/// The HEARTBEAT that a frame is; `None` for any other message.
pub fn heartbeat_of(frame: &MavFrame<'_>) -> Option<HEARTBEAT_DATA> {
    // Asked of every frame of the board, five times: none but a heartbeat is decoded for it.
    if frame.header.msg_id != HEARTBEAT_DATA::ID {
        return None;
    }
    match frame.decode() {
        Ok(MavMessage::HEARTBEAT(beat)) => Some(beat),
        _ => None,
    }
}

/// Splits a byte stream into frames.
#[derive(Debug, Default, Clone)]
pub struct MavSplitter {
    scanner: Scanner,
}

impl MavSplitter {
    /// With an empty buffer.
    pub fn new() -> Self {
        Self::default()
    }

    /// Appends bytes, in any chunking. Read with [`next`](Self::next) until it gives `None`
    /// before the next push: of more than 64 KiB that wait, the oldest are dropped as garbage.
    pub fn push(&mut self, bytes: &[u8]) {
        self.scanner.push(bytes);
    }

    /// Gives up waiting: the bytes that look like the beginning of a frame are searched again.
    /// For links that went quiet, and after each datagram, where a frame never continues.
    pub fn flush(&mut self) {
        self.scanner.flush();
    }

    /// Bytes neither delivered nor reported yet.
    pub fn pending(&self) -> usize {
        self.scanner.pending()
    }

    /// The next frame or loss; `None` when more bytes are needed.
    #[allow(clippy::should_implement_trait)] // lends from the buffer, which `Iterator` cannot
    #[inline]
    pub fn next(&mut self) -> Option<Result<MavFrame<'_>, MavLoss>> {
        let found = self.scanner.next(|b| b == MARKER_V1 || b == MARKER_V2, judge)?;
        Some(match found {
            Found::Garbage(n) => Err(MavLoss::GarbageBytes(n)),
            Found::Failed(loss) => Err(loss),
            Found::Frame(range, Judged { header, payload_at, payload_len, checked, signed }) => {
                let raw = self.scanner.at(range);
                let payload = raw.get(payload_at..payload_at + payload_len).unwrap_or_default();
                Ok(MavFrame { header, payload, raw, checked, signed })
            }
        })
    }
}

struct Judged {
    header: MavHeader,
    payload_at: usize,
    payload_len: usize,
    checked: bool,
    signed: bool,
}

#[inline]
fn judge(bytes: &[u8]) -> Verdict<Judged, MavLoss> {
    let (header, payload_at, payload_len, signed) = match *bytes {
        [MARKER_V2, len, incompat, _, sequence, system_id, component_id, i0, i1, i2, ..] => {
            if incompat & !FLAG_SIGNED != 0 {
                return Verdict::Failed(MavLoss::Incompatible);
            }
            let header = MavHeader {
                system_id,
                component_id,
                sequence,
                msg_id: u32::from_le_bytes([i0, i1, i2, 0]),
                version: MavlinkVersion::V2,
            };
            (header, HEADER_V2, usize::from(len), incompat & FLAG_SIGNED != 0)
        }
        [MARKER_V1, len, sequence, system_id, component_id, msg_id, ..] => {
            let header = MavHeader {
                system_id,
                component_id,
                sequence,
                msg_id: u32::from(msg_id),
                version: MavlinkVersion::V1,
            };
            (header, HEADER_V1, usize::from(len), false)
        }
        _ => return Verdict::Incomplete,
    };
    let body_end = payload_at + payload_len;
    let total = body_end + CHECKSUM + if signed { SIGNATURE } else { 0 };
    let (Some(body), Some([low, high]), true) =
        (bytes.get(1..body_end), bytes.get(body_end..body_end + CHECKSUM), bytes.len() >= total)
    else {
        return Verdict::Incomplete;
    };
    let msg_id = header.msg_id;
    let sent = u16::from_le_bytes([*low, *high]);
    let crc = crc::checksum(body);
    let (checked, fits) = match crc_extra(msg_id) {
        Some(extra) => (true, crc::step(crc, extra) == sent),
        None => (false, crc::reachable(crc, sent)),
    };
    if fits {
        Verdict::Frame(total, Judged { header, payload_at, payload_len, checked, signed })
    } else {
        Verdict::Failed(MavLoss::BadChecksum { msg_id })
    }
}

/// CRC_EXTRA of a message; `None` when its id is unknown.
#[inline]
pub(crate) fn crc_extra(msg_id: u32) -> Option<u8> {
    // The generated function answers 0 for unknown ids, which may be a true value as well.
    match MavMessage::extra_crc(msg_id) {
        0 => MavMessage::all_ids().contains(&msg_id).then_some(0),
        extra => Some(extra),
    }
}

/// Appends a MAVLink 2 frame, unsigned.
pub fn encode(
    out: &mut Vec<u8>,
    system_id: u8,
    component_id: u8,
    sequence: u8,
    message: &MavMessage,
) {
    let mut payload = [0u8; MAX_PAYLOAD];
    let len = message.ser(MavlinkVersion::V2, &mut payload);
    let payload = payload.get(..len).unwrap_or_default();
    encode_payload(out, system_id, component_id, sequence, message.message_id(), payload);
}

/// Appends a MAVLink 2 frame, unsigned, around a payload that is already on-wire bytes: for a
/// message with a value that the dialect has no name for. At most 255 bytes of it are used.
pub fn encode_payload(
    out: &mut Vec<u8>,
    system_id: u8,
    component_id: u8,
    sequence: u8,
    msg_id: u32,
    payload: &[u8],
) {
    let payload = payload.get(..payload.len().min(MAX_PAYLOAD)).unwrap_or_default();
    let [i0, i1, i2, _] = msg_id.to_le_bytes();
    let begin = out.len();
    let len = payload.len() as u8;
    let header = [MARKER_V2, len, 0, 0, sequence, system_id, component_id, i0, i1, i2];
    out.extend_from_slice(&header);
    out.extend_from_slice(payload);
    let crc = crc::checksum(out.get(begin + 1..).unwrap_or_default());
    out.extend_from_slice(&crc::step(crc, MavMessage::extra_crc(msg_id)).to_le_bytes());
}

#[cfg(test)]
mod tests;
