//! What the end of a complete log says of it: its channels, how many messages each holds, where its chunks are.

use std::collections::BTreeMap;
use std::sync::Arc;

use mcap::records::{ChunkIndex, Record, op};

use super::forms::{RECORD_HEAD_BYTES, record};
use super::source::{Source, Window};

/// A footer: two offsets and a checksum.
const FOOTER_BYTES: u64 = 8 + 8 + 4;
/// A longer record of the summary is not read.
const LONGEST_BYTES: u64 = 1 << 22;

/// The summary of a log whose checksum holds.
#[derive(Debug, Default)]
pub(super) struct Tail {
    pub channels: BTreeMap<u16, Arc<str>>,
    pub counts: BTreeMap<u16, u64>,
    pub chunks: Vec<ChunkIndex>,
}

impl Tail {
    /// Whether it says where the messages of a channel are.
    pub fn tells_chunks(&self) -> bool {
        let told = self.chunks.iter().all(|chunk| !chunk.message_index_offsets.is_empty());
        told && !self.chunks.is_empty()
    }

    /// Begin and end of the chunks that hold messages of a channel.
    pub fn chunks_with(&self, channel: &str) -> impl Iterator<Item = (u64, u64)> {
        let ids: Vec<u16> = self
            .channels
            .iter()
            .filter(|(_, name)| ***name == *channel)
            .map(|(id, _)| *id)
            .collect();
        self.chunks
            .iter()
            .filter(move |chunk| ids.iter().any(|id| chunk.message_index_offsets.contains_key(id)))
            .map(|chunk| {
                let from = chunk.chunk_start_offset;
                (from, from.saturating_add(chunk.chunk_length))
            })
    }

    /// `None`: the log was not closed, or its end is damaged.
    pub fn read(source: &Source) -> Option<Self> {
        let mut window = Window::new(source);
        let magic = source.length().checked_sub(mcap::MAGIC.len() as u64)?;
        if window.get(magic, mcap::MAGIC.len()) != Some(mcap::MAGIC) {
            return None;
        }
        let footer = magic.checked_sub(RECORD_HEAD_BYTES + FOOTER_BYTES)?;
        let (opcode, body, _) = record(&mut window, footer)?;
        let start = window.u64_at(body)?;
        let crc = window.u32_at(body + 16)?;
        if opcode != op::FOOTER || start == 0 || start >= footer {
            return None;
        }
        // The checksum covers everything from there up to itself.
        if crc == 0 || window.crc32(start, body + 16)? != crc {
            return None;
        }
        let (mut tail, mut at) = (Self::default(), start);
        while at < footer {
            let (opcode, body, next) = record(&mut window, at)?;
            at = next;
            if !matches!(opcode, op::CHANNEL | op::CHUNK_INDEX | op::STATISTICS) {
                continue;
            }
            if next - body > LONGEST_BYTES {
                return None;
            }
            match mcap::read::parse_record(opcode, window.some(body, next - body)).ok()? {
                Record::Channel(channel) => {
                    tail.channels.insert(channel.id, channel.topic.into());
                }
                Record::ChunkIndex(chunk) => tail.chunks.push(chunk),
                Record::Statistics(told) => tail.counts = told.channel_message_counts,
                _ => {}
            }
        }
        Some(tail)
    }
}
