//! What head and tail of a closed log say of it: how many messages of each kind, from when to when, and the few that
//! are asked for by the name of their channel. What lies between is not read, so damage there is not seen.

use std::collections::BTreeMap;

use mcap::records::{ChunkIndex, Record, op};

use super::channels;
use super::entry::{Entry, decode};
use super::forms::{CHUNK_HEAD_BYTES, MESSAGE_HEAD_BYTES, RECORD_HEAD_BYTES, record};
use super::messages::Message;
use super::source::{Source, Window};
use super::tail::Tail;
use haltere_core::time::HostTime;

/// What is read at once, bytes: an index of a channel, or a message; chosen, a page of memory.
const WINDOW_BYTES: u64 = 4096;
/// A longer index is not read, bytes: chosen, far beyond that of any chunk that we write.
const LONGEST_BYTES: u64 = 1 << 22;

/// A log at a glance.
#[derive(Debug)]
pub struct Outline<'a> {
    source: &'a Source,
    tail: &'a Tail,
    /// First and last input or output of the core.
    pub span: Option<[HostTime; 2]>,
}

impl<'a> Outline<'a> {
    /// `None`: the tail does not tell it, or does not fit what is there.
    pub(super) fn of(source: &'a Source, tail: &'a Tail) -> Option<Self> {
        let plain = tail.chunks.iter().all(|chunk| chunk.compression.is_empty());
        if !plain || !tail.tells_chunks() {
            return None;
        }
        let mut outline = Self { source, tail, span: None };
        let ids = outline.ids(channels::is_raw);
        let holds =
            |chunk: &&ChunkIndex| ids.iter().any(|id| chunk.message_index_offsets.contains_key(id));
        let with = || tail.chunks.iter().filter(holds);
        let Some(first) = with().min_by_key(|chunk| chunk.message_start_time) else {
            return Some(outline);
        };
        let last = with().max_by_key(|chunk| chunk.message_end_time)?;
        let (mut begin_ns, mut end_ns) = (u64::MAX, 0);
        for id in &ids {
            for (time_ns, _) in outline.places(first, *id)? {
                begin_ns = begin_ns.min(time_ns);
            }
            for (time_ns, _) in outline.places(last, *id)? {
                end_ns = end_ns.max(time_ns);
            }
        }
        outline.span = Some([begin_ns, end_ns].map(|ns| HostTime::from_us(ns / 1000)));
        Some(outline)
    }

    /// How many messages each channel holds.
    pub fn counts(&self) -> BTreeMap<&str, u64> {
        let mut counts = BTreeMap::new();
        for (id, name) in &self.tail.channels {
            let count = self.tail.counts.get(id).copied().unwrap_or_default();
            let sum: &mut u64 = counts.entry(&**name).or_default();
            *sum = sum.saturating_add(count);
        }
        counts
    }

    /// The entries of one channel, in their order. `None`: the index does not fit what is there.
    pub fn entries(&self, channel: &str) -> Option<Vec<Entry>> {
        let mut found = Vec::new();
        let mut window = Window::reaching(self.source, WINDOW_BYTES);
        let ids = self.ids(|name| name == channel);
        // An index may claim the same message any number of times.
        let mut ends: BTreeMap<u16, u64> = BTreeMap::new();
        for chunk in &self.tail.chunks {
            let records_at =
                chunk.chunk_start_offset.checked_add(RECORD_HEAD_BYTES + CHUNK_HEAD_BYTES)?;
            for id in &ids {
                for (time_ns, offset) in self.places(chunk, *id)? {
                    let at = records_at.checked_add(offset)?;
                    let end = ends.entry(*id).or_default();
                    if at < *end {
                        return None;
                    }
                    let (entry, next) = message(&mut window, at, *id, time_ns, channel)?;
                    *end = next;
                    found.extend(entry);
                }
            }
        }
        Some(found)
    }

    fn ids(&self, wanted: impl Fn(&str) -> bool) -> Vec<u16> {
        let channels = self.tail.channels.iter();
        channels.filter(|(_, name)| wanted(name)).map(|(id, _)| *id).collect()
    }

    /// Times, ns, and places of the messages of a channel in a chunk.
    fn places(&self, chunk: &ChunkIndex, id: u16) -> Option<Vec<(u64, u64)>> {
        let Some(at) = chunk.message_index_offsets.get(&id) else { return Some(Vec::new()) };
        let mut window = Window::reaching(self.source, WINDOW_BYTES);
        let (opcode, body, next) = record(&mut window, *at)?;
        if opcode != op::MESSAGE_INDEX || next - body > LONGEST_BYTES {
            return None;
        }
        match mcap::read::parse_record(opcode, window.some(body, next - body)).ok()? {
            Record::MessageIndex(index) if index.channel_id == id => {
                let mut places: Vec<_> =
                    index.records.iter().map(|entry| (entry.log_time, entry.offset)).collect();
                places.sort_unstable_by_key(|(_, offset)| *offset);
                Some(places)
            }
            _ => None,
        }
    }
}

/// The message that the index says is there, and where it ends; the inner `None` is one that this build does not know.
fn message(
    window: &mut Window<'_>,
    at: u64,
    id: u16,
    time_ns: u64,
    channel: &str,
) -> Option<(Option<Entry>, u64)> {
    let (opcode, body, next) = record(window, at)?;
    let data_at = body + MESSAGE_HEAD_BYTES;
    if opcode != op::MESSAGE || window.u64_at(body + 6)? != time_ns {
        return None;
    }
    let told = window.get(body, 2)?.first_chunk::<2>().map(|b| u16::from_le_bytes(*b))?;
    let sequence = window.u32_at(body + 2)?;
    let bytes = next.checked_sub(data_at).filter(|bytes| *bytes <= LONGEST_BYTES)?;
    if told != id {
        return None;
    }
    let message = Message {
        offset: at,
        channel: channel.into(),
        channel_id: id,
        sequence,
        log_time: time_ns,
        data: window.some(data_at, bytes),
    };
    Some((decode(&message).ok()?, next))
}

#[cfg(test)]
mod tests {
    use super::super::tests::in_memory;
    use super::super::{LogReader, pb};
    use super::*;

    /// A hostile index of 4 MB that names one message of 4 MB would fill the memory.
    #[test]
    fn regress_an_index_that_names_a_message_twice_tells_nothing() {
        let (memory, mut log) = in_memory();
        for sequence in 1..=20 {
            let at = HostTime::from_us(sequence * 1_000_000);
            let wake = pb::Wake { sequence, host_time_us: at.as_us() };
            log.put(channels::WAKE, at, sequence, &wake).unwrap();
        }
        log.finish().unwrap();
        let mut bytes = memory.bytes();
        let found = |bytes: &[u8]| {
            let log = LogReader::from_bytes("log.mcap".into(), bytes.to_vec()).unwrap();
            log.outline().unwrap().entries(channels::WAKE.0).map(|entries| entries.len())
        };
        assert_eq!(found(&bytes), Some(20));
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        let (id, _) = summary.channels.iter().find(|(_, c)| c.topic == channels::WAKE.0).unwrap();
        let chunk = summary.chunk_indexes.iter().find(|c| c.message_index_offsets.contains_key(id));
        // Opcode, length, channel, length of the list; then time and place of each.
        let list = chunk.unwrap().message_index_offsets[id] as usize + 1 + 8 + 2 + 4;
        bytes.copy_within(list..list + 16, list + 16);
        assert_eq!(found(&bytes), None);
    }
}
