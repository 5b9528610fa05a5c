//! Walks the records of a log and of its chunks. What is damaged is stepped over, and named.
//!
//! A chunk is believed when its checksum holds; one that does not is left out whole. Where the length of a record
//! cannot be, the next chunk is looked for by the form of its head. So 16 bad bytes cost a chunk at most.

use std::collections::BTreeMap;
use std::sync::Arc;

use mcap::records::{MessageHeader, Record, op};

use super::channels;
use super::errors::LogEnd;
use super::forms::{
    CHUNK_HEAD_BYTES, LONGEST_CHANNEL_BYTES, LONGEST_MESSAGE_BYTES, LONGEST_SMALL_BYTES,
    MESSAGE_HEAD_BYTES, RECORD_HEAD_BYTES, chunk_head, is_chunk, is_message_index, may_be_record,
    metadata, record, stands,
};
use super::source::{Source, Window};
use super::tail::Tail;

/// What is looked through at once for the next chunk, bytes.
const SEARCH_BYTES: u64 = 1 << 16;
/// A damaged file may hold any number of heads of chunks inside one another: so much is checked in vain, in lengths
/// of the file.
const PATIENCE: u64 = 4;
/// Places of damage that are kept; the rest is counted.
const MOST_PLACES: usize = 64;

/// One message of any channel.
#[derive(Debug)]
pub(super) struct Message<'a> {
    /// Offset in the file, for error messages.
    pub offset: u64,
    pub channel: Arc<str>,
    pub channel_id: u16,
    pub sequence: u32,
    pub log_time: u64,
    pub data: &'a [u8],
}

/// What was stepped over.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Damage {
    /// Where it begins.
    pub offset: u64,
    pub why: String,
}

/// How a walk ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum WalkEnd {
    /// With the end of the data, and the file with its closing magic.
    Complete,
    /// In mid-record.
    Cut(u64),
    /// There is nothing to be had from there on.
    Unreadable(u64, String),
}

/// Where a message lies.
struct Place {
    offset: u64,
    data_at: u64,
    data_bytes: usize,
    channel: Arc<str>,
    header: MessageHeader,
}

/// Records of one chunk.
#[derive(Debug)]
struct Chunk {
    at: u64,
    end: u64,
    /// It was never closed, or the file ends within it: nothing follows.
    open: bool,
}

/// The walk.
#[derive(Debug)]
pub(super) struct Messages<'a> {
    window: Window<'a>,
    at: u64,
    chunk: Option<Chunk>,
    channels: BTreeMap<u16, Arc<str>>,
    /// Channels as the end of the file has them: their own records may be what is damaged.
    spare: Option<&'a Tail>,
    damage: Vec<Damage>,
    more_damage: u64,
    patience: u64,
    end: Option<WalkEnd>,
}

impl<'a> Messages<'a> {
    pub fn new(source: &'a Source, spare: Option<&'a Tail>) -> Self {
        let length = source.length();
        Self {
            window: Window::new(source),
            at: mcap::MAGIC.len() as u64,
            chunk: None,
            channels: BTreeMap::new(),
            spare,
            damage: Vec::new(),
            more_damage: 0,
            patience: length.saturating_mul(PATIENCE).max(1 << 20),
            end: None,
        }
    }

    /// The same from a record of the file on, such as a chunk.
    pub fn from(source: &'a Source, spare: Option<&'a Tail>, at: u64) -> Self {
        Self { at, ..Self::new(source, spare) }
    }

    /// How it ended.
    pub fn end(&self) -> WalkEnd {
        self.end.clone().unwrap_or(WalkEnd::Cut(self.at))
    }

    /// Places of damage so far.
    pub fn damage(&self) -> &[Damage] {
        &self.damage
    }

    /// How the log ended.
    pub fn log_end(&self) -> LogEnd {
        let cut = match self.end() {
            WalkEnd::Complete => None,
            WalkEnd::Cut(offset) => Some(offset),
            WalkEnd::Unreadable(offset, why) => {
                return LogEnd::Damaged { offset, why, places: 1, cut: None };
            }
        };
        match (self.damage.first(), cut) {
            (None, None) => LogEnd::Complete,
            (None, Some(offset)) => LogEnd::Cut { offset },
            (Some(first), cut) => LogEnd::Damaged {
                offset: first.offset,
                why: first.why.clone(),
                places: self.damage.len() as u64 + self.more_damage,
                cut,
            },
        }
    }

    /// The next message.
    pub fn next(&mut self) -> Option<Message<'_>> {
        let place = self.place()?;
        let data = self.window.get(place.data_at, place.data_bytes)?;
        Some(Message {
            offset: place.offset,
            channel: place.channel,
            channel_id: place.header.channel_id,
            sequence: place.header.sequence,
            log_time: place.header.log_time,
            data,
        })
    }

    /// Something is stepped over; the walk goes on.
    pub fn note(&mut self, offset: u64, why: String) {
        if self.damage.len() < MOST_PLACES {
            self.damage.push(Damage { offset, why });
        } else {
            self.more_damage += 1;
        }
    }

    fn place(&mut self) -> Option<Place> {
        while self.end.is_none() {
            let found = if self.chunk.is_some() { self.in_chunk() } else { self.in_file() };
            if found.is_some() {
                return found;
            }
        }
        None
    }

    fn in_chunk(&mut self) -> Option<Place> {
        let Chunk { at, end, open } = *self.chunk.as_ref()?;
        let record = record(&mut self.window, at).filter(|(_, _, next)| *next <= end);
        let Some((opcode, body_at, next)) = record else {
            self.chunk = None;
            if open || at != end {
                // The file ends in mid-record, or the disk was full in one.
                self.torn(at, "no record has this length".into(), true);
            }
            return None;
        };
        if let Some(chunk) = &mut self.chunk {
            chunk.at = next;
        }
        match opcode {
            op::MESSAGE => match self.message(at, body_at, next) {
                Ok(place) => return place,
                Err(why) if open => {
                    self.chunk = None;
                    self.torn(at, why, false);
                }
                Err(why) => self.note(at, why),
            },
            op::CHANNEL => {
                if let Err(why) = self.channel(body_at, next) {
                    self.note(at, why);
                }
            }
            op::SCHEMA => {}
            other => {
                self.chunk = None;
                let why = match other {
                    op::HEADER..=op::DATA_END => format!("opcode {other:#04x} out of place"),
                    _ => format!("no record has opcode {other:#04x}"),
                };
                if open {
                    self.torn(at, why, false);
                } else {
                    self.note(at, why);
                }
            }
        }
        None
    }

    /// An open chunk goes no further: the end, unless chunks follow that are whole.
    fn torn(&mut self, at: u64, why: String, cut: bool) {
        match self.search(at) {
            Some(next) => {
                self.note(at, why);
                self.at = next;
            }
            None if cut && may_be_record(&mut self.window, at) => self.end = Some(WalkEnd::Cut(at)),
            None => {
                self.note(at, why);
                self.end = Some(self.last());
            }
        }
    }

    fn in_file(&mut self) -> Option<Place> {
        let at = self.at;
        if at >= self.window.end() {
            self.end = Some(WalkEnd::Cut(at));
            return None;
        }
        let opcode = self.window.get(at, 1).and_then(<[u8]>::first).copied();
        if opcode == Some(op::CHUNK) {
            self.enter(at);
            return None;
        }
        let Some((opcode, body_at, next)) = record(&mut self.window, at) else {
            let cut = may_be_record(&mut self.window, at);
            match self.search(at) {
                Some(next) => {
                    self.note(at, "a record that is longer than the file".into());
                    self.at = next;
                }
                None if cut => self.end = Some(WalkEnd::Cut(at)),
                None => {
                    self.note(at, "no record has this length".into());
                    self.end = Some(self.last());
                }
            }
            return None;
        };
        let bytes = next - body_at;
        let told = match opcode {
            op::DATA_END if bytes == 4 => {
                self.data_end(at, next);
                return None;
            }
            op::MESSAGE => match self.message(at, body_at, next) {
                Ok(place) => {
                    self.at = next;
                    return place;
                }
                Err(why) => Err(why),
            },
            op::CHANNEL => self.channel(body_at, next),
            // Skipped, so it must be what it says: a chunk whose opcode is damaged is not.
            op::MESSAGE_INDEX if !is_message_index(&mut self.window, body_at, bytes) => {
                Err("a message index of the wrong length".into())
            }
            op::METADATA => self.metadata(body_at, next),
            op::HEADER..=op::DATA_END => Ok(()),
            other => Err(format!("no record has opcode {other:#04x}")),
        };
        match told {
            Ok(()) => self.at = next,
            Err(why) => self.lost(at, why),
        }
        None
    }

    /// The walk does not know where the next record is.
    fn lost(&mut self, at: u64, why: String) {
        self.note(at, why);
        match self.search(at + 1) {
            Some(next) => self.at = next,
            None => self.end = Some(self.last()),
        }
    }

    /// Nothing is left: the file was closed, or not.
    fn last(&mut self) -> WalkEnd {
        let end = self.window.end();
        let magic = end.checked_sub(mcap::MAGIC.len() as u64);
        let closed = magic.and_then(|at| self.window.get(at, mcap::MAGIC.len()));
        if closed == Some(mcap::MAGIC) { WalkEnd::Complete } else { WalkEnd::Cut(end) }
    }

    /// Behind the data: index, closing magic, and in a file that was put together of two the next one.
    fn data_end(&mut self, at: u64, mut next: u64) {
        let magic = mcap::MAGIC.len() as u64;
        while let Some((opcode, body_at, end)) = record(&mut self.window, next) {
            if opcode == op::FOOTER {
                let follows = end + magic;
                if self.window.get(end, mcap::MAGIC.len()) == Some(mcap::MAGIC)
                    && self.window.get(follows, mcap::MAGIC.len()) == Some(mcap::MAGIC)
                {
                    self.channels.clear();
                    self.spare = None;
                    self.at = follows + magic;
                    return;
                }
                break;
            }
            if !(op::HEADER..=op::DATA_END).contains(&opcode) || end - body_at > LONGEST_SMALL_BYTES
            {
                break;
            }
            next = end;
        }
        // Nothing of ours follows, but without the index and the closing magic most viewers refuse the file.
        self.end = Some(match self.last() {
            WalkEnd::Cut(_) => WalkEnd::Cut(at),
            end => end,
        });
    }

    fn enter(&mut self, at: u64) {
        let Some(head) = chunk_head(&mut self.window, at) else {
            self.end = Some(WalkEnd::Cut(at));
            return;
        };
        let records_at = at + RECORD_HEAD_BYTES + CHUNK_HEAD_BYTES;
        if !head.is_plain() {
            let name_at = at + RECORD_HEAD_BYTES + 32;
            let name = self.window.some(name_at, u64::from(head.name_bytes.min(8))).to_vec();
            if head.name_bytes <= 8 && !name.is_empty() && name.is_ascii() {
                let why = format!(
                    "chunk compressed with {}; run `mcap compress --compression none` on the file first",
                    String::from_utf8_lossy(&name)
                );
                self.end = Some(WalkEnd::Unreadable(at, why));
            } else {
                self.lost(at, "a chunk whose head cannot be".into());
            }
            return;
        }
        let file_end = self.window.end();
        let open = head.is_untold()
            || (head.agrees() && head.records > file_end.saturating_sub(records_at));
        if open {
            // There is no checksum of a part, so what was torn in it is only noticed by its form.
            if records_at < file_end && !may_be_record(&mut self.window, records_at) {
                return self.lost(at, "a chunk whose head cannot be".into());
            }
            (self.chunk, self.at) =
                (Some(Chunk { at: records_at, end: file_end, open: true }), file_end);
            return;
        }
        // One of the two lengths may be what is damaged.
        let by_told = head.told.checked_sub(CHUNK_HEAD_BYTES);
        let mut stood = None;
        for records in
            [Some(head.records), by_told.filter(|_| !head.agrees())].into_iter().flatten()
        {
            let Some(end) = records_at.checked_add(records).filter(|end| *end <= file_end) else {
                continue;
            };
            let stands = stands(&mut self.window, end);
            if !stands {
                let Some(left) = self.patience.checked_sub(records) else { continue };
                self.patience = left;
            } else if stood.is_none() {
                stood = Some(end);
            }
            let whole = head.crc == 0 && head.agrees()
                || self.window.crc32(records_at, end) == Some(head.crc);
            if whole {
                (self.chunk, self.at) = (Some(Chunk { at: records_at, end, open: false }), end);
                return;
            }
        }
        match stood {
            Some(end) => {
                self.note(at, "chunk with a wrong checksum".into());
                self.names(records_at, end);
                self.at = end;
            }
            None => self.lost(at, "chunk with a wrong checksum".into()),
        }
    }

    /// The next place from `from` on that has the form of a chunk's head.
    fn search(&mut self, from: u64) -> Option<u64> {
        let mut at = from;
        while at < self.window.end() {
            let piece = self.window.some(at, SEARCH_BYTES);
            let length = piece.len() as u64;
            let found: Vec<u64> =
                (at..).zip(piece).filter(|(_, b)| **b == op::CHUNK).map(|(p, _)| p).collect();
            for place in found {
                if is_chunk(&mut self.window, place) {
                    return Some(place);
                }
            }
            at += length.max(1);
        }
        None
    }

    fn message(&mut self, offset: u64, body_at: u64, next: u64) -> Result<Option<Place>, String> {
        let data_at = body_at + MESSAGE_HEAD_BYTES;
        let Some(data_bytes) = next.checked_sub(data_at).filter(|n| *n <= LONGEST_MESSAGE_BYTES)
        else {
            return Err("a message of absurd length".into());
        };
        let head = self.window.get(body_at, 22).and_then(|head| head.first_chunk::<22>());
        let Some([a, b, c, d, e, f, rest @ ..]) = head else { return Ok(None) };
        let (channel_id, sequence) =
            (u16::from_le_bytes([*a, *b]), u32::from_le_bytes([*c, *d, *e, *f]));
        let [time, published] = [0, 8].map(|from| {
            rest.get(from..from + 8)
                .and_then(|b| b.first_chunk::<8>())
                .map_or(0, |b| u64::from_le_bytes(*b))
        });
        let channel = match (self.channels.get(&channel_id), self.spare) {
            (Some(channel), _) => channel.clone(),
            (None, Some(tail)) if tail.channels.contains_key(&channel_id) => {
                self.channels.extend(tail.channels.iter().map(|(id, name)| (*id, name.clone())));
                self.channels.get(&channel_id).cloned().unwrap_or_default()
            }
            _ => return Err(format!("message on unknown channel {channel_id}")),
        };
        let header =
            MessageHeader { channel_id, sequence, log_time: time, publish_time: published };
        let data_bytes = usize::try_from(data_bytes).unwrap_or_default();
        Ok(Some(Place { offset, data_at, data_bytes, channel, header }))
    }

    fn channel(&mut self, body_at: u64, next: u64) -> Result<(), String> {
        let bytes = next - body_at;
        if bytes > LONGEST_CHANNEL_BYTES {
            return Err("a channel record of absurd length".into());
        }
        match mcap::read::parse_record(op::CHANNEL, self.window.some(body_at, bytes)) {
            Ok(Record::Channel(channel)) => {
                self.channels.insert(channel.id, channel.topic.into());
                Ok(())
            }
            Ok(_) => Ok(()),
            Err(error) => Err(error.to_string()),
        }
    }

    /// Channels whose records are in a chunk that is bad: of a log of an older build nothing else tells them. A name
    /// that is not one of ours to the letter is not taken.
    fn names(&mut self, mut at: u64, end: u64) {
        if self.spare.is_some() {
            return;
        }
        while let Some((opcode, body_at, next)) = record(&mut self.window, at) {
            let bytes = next - body_at;
            if next > end || !matches!(opcode, op::SCHEMA | op::CHANNEL | op::MESSAGE) {
                return;
            }
            if opcode == op::CHANNEL
                && bytes <= LONGEST_CHANNEL_BYTES
                && let Ok(Record::Channel(found)) =
                    mcap::read::parse_record(opcode, self.window.some(body_at, bytes))
                && channels::schema_of(&found.topic).is_some()
            {
                self.channels.entry(found.id).or_insert_with(|| found.topic.into());
            }
            at = next;
        }
    }

    /// Names of the channels, told again in case that the chunk with their records is bad.
    fn metadata(&mut self, body_at: u64, next: u64) -> Result<(), String> {
        let bytes = next - body_at;
        if bytes > LONGEST_SMALL_BYTES {
            return Err("a metadata record of absurd length".into());
        }
        let Some(told) = metadata(&mut self.window, body_at, bytes) else { return Ok(()) };
        if let Some(names) = channels::from_metadata(&told) {
            for (id, name) in names {
                self.channels.entry(id).or_insert_with(|| name.into());
            }
        }
        Ok(())
    }
}
