//! Forms of the records of a file: whether what stands at a place can be one.

use mcap::records::{Metadata, Record, op};

use super::source::{Source, Window};

/// Opcode and length before each record.
pub(super) const RECORD_HEAD_BYTES: u64 = 9;
/// Longest record of those that are no chunk, message or attachment; a longer one is damage.
pub(super) const LONGEST_SMALL_BYTES: u64 = 1 << 24;
/// Longest channel record.
pub(super) const LONGEST_CHANNEL_BYTES: u64 = 1 << 16;
/// Longest message: a batch of the recorder holds less.
pub(super) const LONGEST_MESSAGE_BYTES: u64 = 1 << 28;
/// Channel id, sequence number and two times before the data of a message.
pub(super) const MESSAGE_HEAD_BYTES: u64 = 2 + 4 + 8 + 8;
/// Head of a chunk without compression: two times, length, checksum, an empty name, length.
pub(super) const CHUNK_HEAD_BYTES: u64 = 8 + 8 + 8 + 4 + 4 + 8;
/// What a chunk's head says.
pub(super) struct ChunkHead {
    pub told: u64,
    pub crc: u32,
    pub name_bytes: u32,
    pub records: u64,
}

impl ChunkHead {
    pub(super) fn is_plain(&self) -> bool {
        self.name_bytes == 0
    }

    pub(super) fn agrees(&self) -> bool {
        self.records.checked_add(CHUNK_HEAD_BYTES) == Some(self.told)
    }

    /// The disk was full or the power failed before it was told how long it is.
    pub(super) fn is_untold(&self) -> bool {
        self.is_plain() && self.records == u64::MAX
    }
}

/// A metadata record. `None`: it is none.
pub(super) fn metadata(window: &mut Window<'_>, body_at: u64, bytes: u64) -> Option<Metadata> {
    match mcap::read::parse_record(
        op::METADATA,
        window.some(body_at, bytes.min(LONGEST_SMALL_BYTES)),
    ) {
        Ok(Record::Metadata(told)) => Some(told),
        _ => None,
    }
}

/// Opcode, begin of the body and end of the record at a place. `None`: it is not whole.
pub(super) fn record(window: &mut Window<'_>, at: u64) -> Option<(u8, u64, u64)> {
    let opcode = *window.get(at, 1)?.first()?;
    let next = record_ends(window, at).filter(|next| *next <= window.end())?;
    Some((opcode, at + RECORD_HEAD_BYTES, next))
}

pub(super) fn record_ends(window: &mut Window<'_>, at: u64) -> Option<u64> {
    (at + RECORD_HEAD_BYTES).checked_add(window.u64_at(at + 1)?)
}

/// Whether a record could begin there of which the file does not hold the end.
pub(super) fn may_be_record(window: &mut Window<'_>, at: u64) -> bool {
    let Some(opcode) = window.get(at, 1).and_then(<[u8]>::first).copied() else { return true };
    let most = match opcode {
        op::MESSAGE => LONGEST_MESSAGE_BYTES,
        op::CHUNK | op::ATTACHMENT => u64::MAX,
        op::HEADER..=op::DATA_END => LONGEST_SMALL_BYTES,
        _ => return false,
    };
    window.u64_at(at + 1).is_none_or(|length| length <= most)
}

pub(super) fn chunk_head(window: &mut Window<'_>, at: u64) -> Option<ChunkHead> {
    let body = at + RECORD_HEAD_BYTES;
    Some(ChunkHead {
        told: window.u64_at(at + 1)?,
        crc: window.u32_at(body + 24)?,
        name_bytes: window.u32_at(body + 28)?,
        records: window.u64_at(body + 32)?,
    })
}

/// Whether what is there has the form of a chunk, its first record included.
pub(super) fn is_chunk(window: &mut Window<'_>, at: u64) -> bool {
    let Some(head) = chunk_head(window, at) else { return false };
    let records_at = at + RECORD_HEAD_BYTES + CHUNK_HEAD_BYTES;
    let first = window.get(records_at, 1).and_then(<[u8]>::first).copied();
    head.is_plain()
        && (head.agrees() || (head.is_untold() && head.told == u64::MAX))
        && matches!(first, Some(op::SCHEMA | op::CHANNEL | op::MESSAGE))
        && may_be_record(window, records_at)
}

/// Whether a record can stand behind a chunk at that place, or the file ends there.
pub(super) fn stands(window: &mut Window<'_>, at: u64) -> bool {
    if at == window.end() {
        return true;
    }
    let Some(opcode) = window.get(at, 1).and_then(<[u8]>::first).copied() else { return false };
    if opcode == op::CHUNK {
        return is_chunk(window, at);
    }
    match (record(window, at), opcode) {
        (Some((_, body, next)), op::MESSAGE_INDEX) => is_message_index(window, body, next - body),
        (Some((_, body, next)), op::DATA_END) => next - body == 4,
        (Some((_, body, next)), op::METADATA) => metadata(window, body, next - body).is_some(),
        (Some((_, body, next)), op::HEADER..=op::DATA_END) => next - body <= LONGEST_SMALL_BYTES,
        // The file was cut in it.
        (None, op::HEADER..=op::DATA_END) => may_be_record(window, at),
        _ => false,
    }
}

/// Channel u16, then the length in bytes u32 of what follows.
pub(super) fn is_message_index(window: &mut Window<'_>, body_at: u64, bytes: u64) -> bool {
    window.u32_at(body_at + 2).is_some_and(|length| bytes.checked_sub(6) == Some(u64::from(length)))
}

/// The records of the first chunk, whether or not its checksum holds: for the head of a log of an older build, which
/// is there once. Gives what is said on `channel`.
pub(super) fn unchecked(source: &Source, channel: &str) -> Option<(Metadata, Vec<u8>)> {
    let mut window = Window::new(source);
    let (mut at, mut about) = (mcap::MAGIC.len() as u64, None);
    // Header, metadata, and the chunk.
    while let Some((opcode, body, next)) =
        record(&mut window, at).filter(|(opcode, ..)| *opcode != op::CHUNK)
    {
        if opcode == op::METADATA && about.is_none() {
            about = metadata(&mut window, body, next - body);
        }
        at = next;
    }
    let about = about?;
    let mut at = at + RECORD_HEAD_BYTES + CHUNK_HEAD_BYTES;
    let mut id = None;
    while let Some((opcode, body, next)) = record(&mut window, at) {
        match opcode {
            op::SCHEMA => {}
            op::CHANNEL if next - body <= LONGEST_CHANNEL_BYTES => {
                let parsed = mcap::read::parse_record(opcode, window.some(body, next - body));
                let Ok(Record::Channel(found)) = parsed else { return None };
                if found.topic == channel {
                    id = Some(found.id);
                }
            }
            op::MESSAGE if next - body <= LONGEST_SMALL_BYTES => {
                let told = window
                    .get(body, 2)
                    .and_then(|b| b.first_chunk::<2>())
                    .map(|b| u16::from_le_bytes(*b));
                if told != id {
                    return None;
                }
                let data = window.some(body, next - body).get(22..)?.to_vec();
                return Some((about, data));
            }
            _ => return None,
        }
        at = next;
    }
    None
}
